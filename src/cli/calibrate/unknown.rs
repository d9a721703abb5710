//! A ball without a table: its pattern by the clip alone.

use std::path::Path;

use super::{Arguments, marks, no_answer};
use crate::ball::Ball;
use crate::calibrate::{
    BuiltPattern, Calibration, CalibrationConfig, KnownDots, MissingSide, SurfaceObserver, Survey,
    UnknownRejection, confirmed, matching_design, survey,
};
use crate::error::Result;
use crate::geometry::spiral_directions;
use crate::pattern::Pattern;
use crate::vision::estimator::estimate_inputs;
use crate::vision::painted::PaintedFrame;
use crate::vision::{Estimator, FrameEstimate, NamedDetector};

/// Directions of the pattern that stands in where none is known: only its detections are used.
const STAND_IN_DOTS: usize = 20;

/// What ball a clip shows.
pub(super) enum UnknownBall {
    /// One of the designs, by its index.
    Design(usize),
    /// Another.
    Built(BuiltClip),
}

/// A pattern built from a clip.
pub(super) struct BuiltClip {
    pub built: BuiltPattern,
    /// What the frames show of the ball, and their names.
    shown: Vec<PaintedFrame>,
    names: Vec<String>,
}

impl BuiltClip {
    /// The calibration, where the pixels of all frames confirm it.
    pub fn confirmed(
        &self,
        arguments: &Arguments,
        calibration: Calibration,
        times_s: Option<&[f64]>,
        config: &CalibrationConfig,
    ) -> Result<Calibration> {
        let confirmed = confirmed(calibration, &self.built, &self.shown, times_s, config)?;
        confirmed.map_err(|rejection| {
            let side = match &rejection {
                UnknownRejection::Unconfirmed { first, .. } => first.as_ref(),
                _ => None,
            };
            let reason = lacking(&rejection, side, &self.names);
            no_answer(&arguments.clip[0], &reason)
        })
    }
}

/// An estimator for its detections only.
pub(super) fn stand_in(
    arguments: &Arguments,
    config: &CalibrationConfig,
) -> Result<Estimator<NamedDetector>> {
    let pattern = Pattern::new(spiral_directions(STAND_IN_DOTS).collect())?;
    Estimator::new(&pattern, config.estimator, arguments.images.detector()?)
}

/// The design that the clip shows, else the pattern built from the clip.
pub(super) fn find(
    arguments: &Arguments,
    designs: &[(Ball, &Path)],
    known: &KnownDots,
    config: &CalibrationConfig,
) -> Result<UnknownBall> {
    let estimator = stand_in(arguments, config)?;
    let settings = SurfaceObserver::settings(arguments.batch()?);
    let observer = SurfaceObserver::default();
    let batch = estimate_inputs(&estimator, &arguments.clip, &settings, &observer)?;
    let names: Vec<String> = batch.frames.iter().map(|f| f.name.clone()).collect();
    let frames = batch.frames.into_iter().map(|f| (f.estimate, f.kept));
    let (frames, shown): (Vec<FrameEstimate>, Vec<PaintedFrame>) = frames.unzip();
    let built = built(
        arguments,
        survey(&frames, &shown, known, config)?,
        known,
        &names,
    )?;
    let patterns: Vec<Pattern> = designs.iter().map(|d| d.0.pattern().clone()).collect();
    Ok(match matching_design(&built.pattern, &patterns)? {
        Some(design) => UnknownBall::Design(design),
        None => UnknownBall::Built(BuiltClip {
            built,
            shown,
            names,
        }),
    })
}

/// The pattern of a survey, whose marks are drawn into the folder.
fn built(
    arguments: &Arguments,
    survey: Survey,
    known: &KnownDots,
    names: &[String],
) -> Result<BuiltPattern> {
    // What the numbers are of that a person gave stays.
    let is_other = matches!(survey.pattern, Err(UnknownRejection::OtherMarks { .. }));
    let surface = survey.surface.as_ref().filter(|_| !is_other);
    let write = |surface| marks::write(&arguments.output, surface);
    let picture = surface.map(write).transpose()?;
    let picture = picture.as_ref().map(|p| p.display());
    match survey.pattern {
        Ok(built) => {
            if *known == KnownDots::Nothing
                && let Some(picture) = picture
            {
                // Print that looks like a dot is one to every test.
                errln!(
                    "spindoe: {} dots were found: compare that with the ball and with {picture}; where it differs name \
                     the dots (--overwrite --marks)",
                    built.pattern.len()
                );
            }
            Ok(built)
        }
        Err(rejection) => {
            let mut reason = lacking(&rejection, survey.missing.as_ref(), names);
            reason += &match picture {
                Some(picture) if rejection.is_of_marks() => {
                    format!("; name the dots by their numbers in {picture} (--marks)")
                }
                Some(picture) => format!("; {picture} shows the ball's surface"),
                None if is_other => "; run it without --marks and look at marks.png".to_owned(),
                None => String::new(),
            };
            Err(no_answer(&arguments.clip[0], &reason))
        }
    }
}

/// Why there is no answer, and where what is missing lies in the frames of these names, if it is a side of the ball.
fn lacking(rejection: &UnknownRejection, side: Option<&MissingSide>, names: &[String]) -> String {
    match side {
        Some(side) => {
            let (there, frame) = (side.there.words(), &names[side.nearest]);
            format!("{rejection}: what is missing lies {there} in frame {frame}")
        }
        None => rejection.to_string(),
    }
}
