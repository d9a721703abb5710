//! `spindoe calibrate --live -`: a ball without a table while it is filmed, until all of it is shown.

use std::sync::atomic::Ordering;

use super::{Arguments, Clip, Origin};
use crate::ball::Ball;
use crate::calibrate::live::{LiveClip, LivePattern};
use crate::calibrate::{CalibrationConfig, Survey, UnknownRejection};
use crate::cli::images::is_file;
use crate::error::{Error, Result};
use crate::image::DEFAULT_MAX_PIXELS;
use crate::source::grab::{Grabber, WhenFull};
use crate::source::pipe::{PipeFormat, PipeReader};
use crate::source::{Frame, FrameSource};
use crate::vision::Prior;

/// Reads frames until they show the whole ball.
pub(super) fn read(arguments: &Arguments, config: &CalibrationConfig) -> Result<Clip> {
    let [path] = &arguments.clip[..] else {
        let problem = "expected one input, a file or - for standard input";
        return Err(Error::argument("--live", problem));
    };
    let (outline, circles) = arguments.images.outlines()?;
    if circles.is_some() {
        let problem = "expected U,V,R with --live, found a table of frames";
        return Err(Error::argument("circle", problem));
    }
    let fps = arguments.images.fps;
    if fps.is_none() && is_file(path) {
        let problem = "expected for a file: its frames do not arrive at their times";
        return Err(Error::argument("--fps", problem));
    }
    let prior = Prior {
        outline,
        region: arguments.images.roi()?,
        ..Prior::default()
    };
    let input = crate::cli::open_input(path)?;
    let format = arguments.raw.unwrap_or(PipeFormat::Images);
    let reader = PipeReader::new(input.reader, &input.name, format, DEFAULT_MAX_PIXELS)?;
    let when_full = fps.map_or(WhenFull::DropOldest, |_| WhenFull::Wait);
    let mut grabber = Grabber::start(reader, when_full)?;
    let answer = "spindoe: no more frames are taken; once more ends at once";
    let stop = crate::cli::interrupt::stop_on_interrupt(answer)?;
    let mut clip = LiveClip::new(arguments.stand_in(config)?, arguments.dots, config.clone());
    let mut frame = Frame::default();
    while !stop.load(Ordering::Relaxed) && grabber.next_frame(&mut frame)? {
        let time_s = fps.map(|rate| frame.number as f64 / rate).or(frame.time_s);
        let picture = frame.picture.as_ref().map_err(|e| e.to_string());
        let picture = picture.map_err(Error::Internal)?;
        clip.push(picture, &prior, time_s.unwrap_or_default())?;
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
    let built = survey.pattern.map_err(|r| no_answer(&input.name, &r))?;
    let found = clip.confirm(built)?;
    Ok(found.map_err(|why| no_answer(&input.name, &why))?.into())
}

fn no_answer(input: &std::path::Path, reason: &dyn std::fmt::Display) -> Error {
    Error::NoAnswer {
        path: input.to_path_buf(),
        reason: reason.to_string(),
    }
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

impl From<LivePattern> for Clip {
    fn from(found: LivePattern) -> Self {
        Self {
            ball: Ball::new(found.built.pattern.clone()),
            origin: Origin::Clip(found.built),
            frames: found.frames,
            times_s: Some(found.times_s),
        }
    }
}
