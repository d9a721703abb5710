//! A clip that lies in files: its frames, the ball that fits them, and its calibration.

use std::path::{Path, PathBuf};

use super::unknown::{self, UnknownBall};
use super::{Arguments, no_answer};
use crate::ball::Ball;
use crate::calibrate::{Calibration, CalibrationConfig, KnownDots, calibrate, identify_frames};
use crate::cli::images::order_warning;
use crate::error::{Error, Result};
use crate::vision::estimator::{SequenceOutcome, estimate_inputs};
use crate::vision::{Estimator, FrameEstimate};

/// A ball, and what the frames of a clip say of it.
pub(super) struct CalibratedClip {
    /// The ball before.
    pub ball: Ball,
    pub origin: Origin,
    pub frames: IdentifiedFrames,
    pub calibration: Calibration,
}

/// Where a ball comes from.
pub(super) enum Origin {
    /// A file.
    Design,
    /// The clip itself, whose marks lie in the folder.
    Clip,
    /// A clip that was looked at while it was filmed.
    Live,
}

/// Frames identified with one ball.
pub(super) struct IdentifiedFrames {
    pub estimates: Vec<FrameEstimate>,
    /// Their times, where these are known.
    pub times_s: Option<Vec<f64>>,
}

/// Finds the ball that the clip shows, and calibrates it.
pub(super) fn read(
    arguments: &Arguments,
    balls: Vec<Ball>,
    known: &KnownDots,
    config: &CalibrationConfig,
) -> Result<CalibratedClip> {
    let paths = arguments.table.iter().map(PathBuf::as_path);
    let mut designs: Vec<(Ball, &Path)> = balls.into_iter().zip(paths).collect();
    let several = designs.len() > 1;
    if arguments.is_unknown() {
        match unknown::find(arguments, &designs, known, config)? {
            UnknownBall::Design(design) => designs = vec![designs.swap_remove(design)],
            UnknownBall::Built(clip) => {
                if !designs.is_empty() {
                    errln!("the ball is none of these designs");
                }
                let ball = Ball::new(clip.built.pattern.clone());
                let frames = identified(arguments, &ball, config)?;
                let calibration = calibrated(arguments, &ball, &frames, config)?;
                let times = frames.times_s.as_deref();
                return Ok(CalibratedClip {
                    calibration: clip.confirmed(arguments, calibration, times, config)?,
                    ball,
                    origin: Origin::Clip,
                    frames,
                });
            }
        }
    }
    let (ball, path, frames) = best(arguments, designs, config)?;
    if arguments.is_unknown() || several {
        errln!("the ball is drawn from {}", path.display());
    }
    Ok(CalibratedClip {
        calibration: calibrated(arguments, &ball, &frames, config)?,
        ball,
        origin: Origin::Design,
        frames,
    })
}

/// The ball as these frames measure it.
fn calibrated(
    arguments: &Arguments,
    ball: &Ball,
    frames: &IdentifiedFrames,
    config: &CalibrationConfig,
) -> Result<Calibration> {
    let times = frames.times_s.as_deref();
    let found = calibrate(ball.pattern(), &frames.estimates, times, config)?;
    found.map_err(|rejection| no_answer(&arguments.clip[0], &rejection))
}

/// The frames of the clip, identified with a ball.
fn identified(
    arguments: &Arguments,
    ball: &Ball,
    config: &CalibrationConfig,
) -> Result<IdentifiedFrames> {
    let estimator = Estimator::for_ball(ball, config.estimator, arguments.images.detector()?)?;
    let batch = estimate_inputs(&estimator, &arguments.clip, &arguments.batch()?, &())?;
    if matches!(batch.sequence, SequenceOutcome::TimesNotIncreasing) {
        errln!("spindoe: the times do not increase from frame to frame: they are not used");
    }
    if let Some(problem) = batch.times.problem() {
        errln!("spindoe: {problem}: give --fps");
    }
    if let Some(warning) = order_warning(batch.frames.iter().map(|f| f.name.as_str())) {
        errln!("spindoe: {warning}");
    }
    Ok(IdentifiedFrames {
        times_s: batch.times_s(),
        estimates: batch.frames.into_iter().map(|f| f.estimate).collect(),
    })
}

/// The ball that fits the frames best, and the frames as it identifies them.
fn best<'a>(
    arguments: &Arguments,
    designs: Vec<(Ball, &'a Path)>,
    config: &CalibrationConfig,
) -> Result<(Ball, &'a Path, IdentifiedFrames)> {
    let mut designs = designs.into_iter();
    let (mut ball, mut path) = designs
        .next()
        .ok_or_else(|| Error::argument("table", "expected a table"))?;
    let mut frames = identified(arguments, &ball, config)?;
    for (other, its_path) in designs {
        let estimates = identify_frames(&other, &config.estimator, &frames.estimates)?;
        if trust(&estimates) > trust(&frames.estimates) {
            (ball, path, frames.estimates) = (other, its_path, estimates);
        }
    }
    Ok((ball, path, frames))
}

/// The sum of the poses' probabilities: the expected number of frames identified correctly.
fn trust(frames: &[FrameEstimate]) -> f64 {
    let poses = frames.iter().filter_map(FrameEstimate::pose);
    poses.map(|p| p.confidence).sum()
}
