//! A clip that lies in files: its frames, the ball that fits them, and its calibration.

use std::path::{Path, PathBuf};

use super::unknown::{self, UnknownBall};
use super::{Arguments, no_answer};
use crate::ball::{Ball, DesignRecord};
use crate::calibrate::{
    Calibration, CalibrationConfig, KnownDots, MarkedSurface, calibrate, identify_frames,
};
use crate::cli::inputs::{self, Counting, by_input};
use crate::clip::{self, Batch, BatchConfig, BatchFrame};
use crate::error::{Error, Result};
use crate::vision::{Estimator, FrameEstimate};

/// A ball, and what the frames of a clip say of it.
pub(super) struct CalibratedClip {
    /// The ball before.
    pub ball: Ball,
    /// Whether it was drawn from a design, rather than found by the clip alone.
    pub is_design: bool,
    /// Where it was found by the clip, its surface with all marks.
    pub surface: Option<MarkedSurface>,
    pub frames: IdentifiedFrames,
    pub calibration: Calibration,
    /// Angular radius of its dots, radians, where it is known.
    pub dot_radius_rad: Option<f64>,
}

/// Frames identified with one ball.
pub(super) struct IdentifiedFrames {
    pub estimates: Vec<FrameEstimate>,
    /// The file of each; empty of a pipe.
    pub files: Vec<PathBuf>,
    /// Their times, where these are known.
    pub times_s: Option<Vec<f64>>,
}

impl IdentifiedFrames {
    fn of(mut batch: Batch<()>) -> Self {
        let files = inputs::files_of(&batch);
        let frames = batch.frames.iter_mut();
        let estimates = frames.map(BatchFrame::take_estimate).collect();
        Self {
            times_s: batch.times_s(),
            files,
            estimates,
        }
    }
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
    let settings = arguments.batch()?;
    if arguments.is_unknown() {
        match unknown::find(arguments, &settings, &designs, known, config)? {
            UnknownBall::Design(design) => designs = vec![designs.swap_remove(design)],
            UnknownBall::Built(clip) => {
                if !designs.is_empty() {
                    errln!("the ball is none of these designs");
                }
                let ball = Ball::new(clip.built.pattern.clone());
                let batch = estimated(arguments, &settings, &ball, config)?;
                inputs::say_camera(batch.focal_doubt.as_ref());
                let frames = IdentifiedFrames::of(batch);
                return Ok(CalibratedClip {
                    calibration: clip.calibrated(arguments, &frames, config)?,
                    dot_radius_rad: Some(clip.built.middle_radius_rad()),
                    ball,
                    is_design: false,
                    surface: clip.surface,
                    frames,
                });
            }
        }
    }
    let (ball, path, frames) = best(arguments, &settings, designs, config)?;
    if arguments.is_unknown() || several {
        errln!("the ball is drawn from {}", path.display());
    }
    let times = frames.times_s.as_deref();
    let found = calibrate(ball.pattern(), &frames.estimates, times, config)?;
    Ok(CalibratedClip {
        calibration: found.map_err(|rejection| {
            let is_identified = |k: usize| frames.estimates[k].pose().is_some();
            let clip = &arguments.clip;
            let each = by_input(clip, &frames.files, "identified", is_identified);
            no_answer(inputs::named(clip), &format!("{rejection}{each}"))
        })?,
        dot_radius_rad: ball.design().map(DesignRecord::dot_radius_rad),
        ball,
        is_design: true,
        surface: None,
        frames,
    })
}

/// The frames of the clip, identified with a ball.
fn estimated(
    arguments: &Arguments,
    settings: &BatchConfig,
    ball: &Ball,
    config: &CalibrationConfig,
) -> Result<Batch<()>> {
    let estimator = Estimator::for_ball(ball, config.estimator, arguments.images.detector()?)?;
    let counting = Counting::new(&arguments.clip, ()).of_dots(ball.pattern().len());
    let batch = clip::run(&estimator, &arguments.clip, settings, &counting)?;
    counting.finish();
    inputs::say_not_increasing(&batch, &arguments.clip, "the times are not used");
    if let Some(problem) = batch.times.problem() {
        errln!("note: {problem}: give --fps");
    }
    Ok(batch)
}

/// The ball that fits the frames best, and the frames as it identifies them.
fn best<'a>(
    arguments: &Arguments,
    settings: &BatchConfig,
    designs: Vec<(Ball, &'a Path)>,
    config: &CalibrationConfig,
) -> Result<(Ball, &'a Path, IdentifiedFrames)> {
    let mut designs = designs.into_iter();
    let (mut ball, mut path) = designs
        .next()
        .ok_or_else(|| Error::argument("table", "expected a table"))?;
    let batch = estimated(arguments, settings, &ball, config)?;
    inputs::say(&batch, settings)?;
    let mut frames = IdentifiedFrames::of(batch);
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
