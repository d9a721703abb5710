//! `spindoe calibrate --live -`: a ball without a table while it is filmed, until all of it is shown.

use std::sync::atomic::Ordering;

use super::clip::{CalibratedClip, IdentifiedFrames, Origin};
use super::unknown::stand_in;
use super::{Arguments, no_answer};
use crate::ball::Ball;
use crate::calibrate::live::{LiveClip, LivePattern};
use crate::calibrate::{CalibrationConfig, KnownDots, Survey, UnknownRejection};
use crate::cli::pipe::Pipe;
use crate::error::{Error, Result};
use crate::image::DEFAULT_MAX_PIXELS;
use crate::source::Frame;
use crate::vision::Prior;

/// Reads frames until they show the whole ball.
pub(super) fn read(
    arguments: &Arguments,
    known: KnownDots,
    config: &CalibrationConfig,
) -> Result<CalibratedClip> {
    let (outline, circles) = arguments.images.outlines()?;
    if circles.is_some() {
        let problem = "expected U,V,R with --live, found a table of frames";
        return Err(Error::argument("circle", problem));
    }
    let prior = Prior {
        outline,
        region: arguments.images.roi()?,
        ..Prior::default()
    };
    let fps = arguments.images.fps;
    let mut pipe = Pipe::open(
        "--live",
        &arguments.clip,
        arguments.raw,
        fps,
        DEFAULT_MAX_PIXELS,
    )?;
    let answer = "spindoe: no more frames are taken; once more ends at once";
    let stop = crate::cli::interrupt::stop_on_interrupt(answer)?;
    let mut clip = LiveClip::new(stand_in(arguments, config)?, known, config.clone());
    let mut frame = Frame::default();
    while !stop.load(Ordering::Relaxed) {
        let time_s = match pipe.next_frame(&mut frame) {
            Ok(Some(time_s)) => time_s,
            Ok(None) => break,
            // Ctrl-C ends the camera's command, too, and cuts its last frame.
            Err(_) if stop.load(Ordering::Relaxed) => break,
            Err(problem) => return Err(problem),
        };
        let picture = frame.picture.as_ref().map_err(|e| e.to_string());
        let picture = picture.map_err(Error::Internal)?;
        clip.push(picture, &prior, time_s)?;
        if let Some(survey) = clip.poll()? {
            say(&survey);
            if let Ok(built) = survey.pattern {
                match clip.confirm(built)? {
                    Ok(found) => return Ok(found.into()),
                    Err(why) => errln!("not yet: {why}"),
                }
            }
        }
    }
    let survey = clip.finish()?;
    say(&survey);
    let built = survey.pattern.map_err(|r| match r.is_of_marks() {
        true => no_answer(
            &pipe.name,
            &format!("{r}; to name the dots (--marks) give the clip as a file"),
        ),
        false => no_answer(&pipe.name, &r),
    })?;
    let found = clip.confirm(built)?;
    Ok(found.map_err(|why| no_answer(&pipe.name, &why))?.into())
}

/// What is shown so far, and what to turn to the camera.
fn say(survey: &Survey) {
    let so_far = format!(
        "{} of {} frames placed, {:.0} % of the ball shown, {} dots",
        survey.placed,
        survey.frames,
        100.0 * survey.shown,
        survey.dots
    );
    match (&survey.pattern, survey.missing) {
        (Ok(_), _) => errln!("{so_far}: all of it"),
        (Err(UnknownRejection::TooFewFrames { .. }), _) => {
            errln!("{} frames: go on", survey.frames)
        }
        (Err(_), Some(side)) => errln!("{so_far}; now show what is {}", side.now.words()),
        (Err(why), None) => errln!("{so_far}; {why}"),
    }
}

impl From<LivePattern> for CalibratedClip {
    fn from(found: LivePattern) -> Self {
        Self {
            ball: Ball::new(found.built.pattern.clone()),
            origin: Origin::Live,
            frames: IdentifiedFrames {
                estimates: found.frames,
                times_s: Some(found.times_s),
            },
            calibration: found.calibration,
        }
    }
}
