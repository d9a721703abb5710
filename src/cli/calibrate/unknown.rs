//! A ball without a table: its pattern by the clip alone.

use std::path::{Path, PathBuf};

use super::clip::IdentifiedFrames;
use super::marks::MarkNumbers;
use super::{Arguments, marks, no_answer};
use crate::ball::Ball;
use crate::calibrate::{
    BuiltPattern, Calibration, CalibrationConfig, DecidedMarks, KnownDots, MarkedSurface,
    MissingSide, SurfaceObserver, Survey, UnknownRejection, calibrate_built, matching_design,
    survey,
};
use crate::cli::inputs::{self, Counting, by_input};
use crate::cli::output::{command_line, is_quiet};
use crate::clip::{self, Batch, BatchConfig};
use crate::error::{Error, Result, are, counted};
use crate::pattern::Pattern;
use crate::surface::PaintedFrame;
use crate::vision::{Estimator, FrameEstimate};

/// The frames of a clip, and what they show of the ball.
struct SeenClip {
    frames: Vec<FrameEstimate>,
    shown: Vec<PaintedFrame>,
    names: Vec<String>,
    files: Vec<PathBuf>,
}

impl SeenClip {
    fn of(mut batch: Batch<PaintedFrame>, arguments: &Arguments) -> Self {
        let (files, names) = (
            inputs::files_of(&batch),
            inputs::names(&batch, &arguments.clip),
        );
        let frames = batch.frames.iter_mut();
        let frames = frames.map(|f| (f.take_estimate(), std::mem::take(&mut f.kept)));
        let (frames, shown) = frames.unzip();
        Self {
            frames,
            shown,
            names,
            files,
        }
    }

    /// What they show of it.
    fn survey(&self, known: &KnownDots, config: &CalibrationConfig) -> Result<Survey> {
        if !is_quiet() {
            errln!(
                "laying {} on one ball, to find its dots",
                counted(self.frames.len(), "frame")
            );
        }
        survey(&self.frames, &self.shown, known, config)
    }
}

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
    pub surface: Option<MarkedSurface>,
    /// What the frames show of the ball, and their names.
    shown: Vec<PaintedFrame>,
    names: Vec<String>,
}

impl BuiltClip {
    /// The pattern as the clip's frames measure it.
    pub fn calibrated(
        &self,
        arguments: &Arguments,
        frames: &IdentifiedFrames,
        config: &CalibrationConfig,
    ) -> Result<Calibration> {
        let times = frames.times_s.as_deref();
        let (built, shown) = (&self.built, &self.shown);
        let found = calibrate_built(built, &frames.estimates, shown, times, config)?;
        found.map_err(|why| {
            let reason = lacking(&why, why.side(), &self.names);
            refused(arguments, &why, reason, self.surface.as_ref())
        })
    }
}

/// An estimator for its detections only.
pub(super) fn stand_in(arguments: &Arguments, config: &CalibrationConfig) -> Result<Estimator> {
    estimator_of(&SurfaceObserver::stand_in()?, arguments, config)
}

/// An estimator of a pattern that no table has.
fn estimator_of(
    pattern: &Pattern,
    arguments: &Arguments,
    config: &CalibrationConfig,
) -> Result<Estimator> {
    Estimator::new(pattern, config.estimator, arguments.images.detector()?)
}

/// The frames of a clip as an estimator sees them, and what they show of the ball.
fn look(
    arguments: &Arguments,
    settings: &BatchConfig,
    estimator: &Estimator,
) -> Result<Batch<PaintedFrame>> {
    let observer = Counting::new(&arguments.clip, SurfaceObserver::default());
    let batch = clip::run(estimator, &arguments.clip, settings, &observer)?;
    observer.finish();
    Ok(batch)
}

/// The design that the clip shows, else the pattern built from the clip.
pub(super) fn find(
    arguments: &Arguments,
    settings: &BatchConfig,
    designs: &[(Ball, &Path)],
    known: &KnownDots,
    config: &CalibrationConfig,
) -> Result<UnknownBall> {
    let detecting = SurfaceObserver::settings(settings.clone());
    let batch = look(arguments, &detecting, &stand_in(arguments, config)?)?;
    inputs::say(&batch, &detecting)?;
    let mut seen = SeenClip::of(batch, arguments);
    let mut survey = seen.survey(known, config)?;
    if let Some(likely) = survey.likely.take() {
        // Which outline is the ball's the dots show, once they are known. What the frames show is up to 2 GiB: one look at a time.
        drop(seen);
        let estimator = estimator_of(&likely, arguments, config)?;
        seen = SeenClip::of(look(arguments, settings, &estimator)?, arguments);
        survey = seen.survey(known, config)?;
    }
    let SeenClip {
        shown,
        names,
        files,
        ..
    } = seen;
    say_decided(arguments, survey.decided());
    let Survey {
        pattern,
        surface,
        missing,
        placed,
        ..
    } = survey;
    let built = pattern.map_err(|why| {
        let mut reason = lacking(&why, missing.as_ref(), &names);
        let is_placed = |k: usize| placed.binary_search(&k).is_ok();
        reason += &by_input(&arguments.clip, &files, "placed", is_placed);
        refused(arguments, &why, reason, surface.as_ref())
    })?;
    let patterns: Vec<Pattern> = designs.iter().map(|d| d.0.pattern().clone()).collect();
    Ok(match matching_design(&built.pattern, &patterns)? {
        Some(design) => UnknownBall::Design(design),
        None => UnknownBall::Built(BuiltClip {
            built,
            surface,
            shown,
            names,
        }),
    })
}

/// Why there is no answer, with the ball's marks left in the folder; those that a person has named by their numbers stay.
fn refused(
    arguments: &Arguments,
    why: &UnknownRejection,
    mut reason: String,
    surface: Option<&MarkedSurface>,
) -> Error {
    let surface = surface.filter(|_| arguments.marks.is_none());
    let picture = surface.map(|surface| marks::leave(&arguments.output, surface));
    reason += &match picture {
        Some(Err(problem)) => return problem,
        Some(Ok(picture)) if why.is_of_marks() => {
            let proposed = surface.and_then(|s| MarkNumbers::proposed(s, arguments.dots));
            let (picture, command) = (picture.display(), command_line());
            let named = match proposed {
                Some(numbers) => {
                    format!("if they are the likeliest: `{command} --marks {numbers}`")
                }
                None => format!("as in `{command} --marks 0-17,19`"),
            };
            format!(
                "; look which of the numbered marks in {picture} are your dots, and name them, {named}"
            )
        }
        Some(Ok(picture)) => format!("; {} shows the ball's surface", picture.display()),
        None if matches!(why, UnknownRejection::OtherMarks { .. }) => {
            "; run it without --marks and look at marks.png".to_owned()
        }
        None => String::new(),
    };
    no_answer(inputs::named(&arguments.clip), &reason)
}

/// Says what the number of dots has decided.
pub(super) fn say_decided(arguments: &Arguments, marks: DecidedMarks) {
    let DecidedMarks { dots, others } = marks;
    if let Some(number) = arguments.dots
        && arguments.marks.is_none()
        && dots + others > 0
    {
        errln!(
            "note: {number} dots, as --dots says: of {} in doubt {dots} {} taken",
            counted(dots + others, "mark"),
            are(dots)
        );
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
