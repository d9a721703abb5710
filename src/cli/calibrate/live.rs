//! `spindoe calibrate --live -`: a ball without a table while it is filmed, until all of it is shown.

use std::sync::atomic::{AtomicBool, Ordering};

use super::clip::{CalibratedClip, IdentifiedFrames};
use super::unknown::{say_decided, stand_in};
use super::{Arguments, no_answer};
use crate::ball::Ball;
use crate::calibrate::live::{LiveClip, LivePattern};
use crate::calibrate::{CalibrationConfig, KnownDots, MissingSide, Survey, UnknownRejection};
use crate::cli::pipe::Pipe;
use crate::error::{Error, Result, counted};
use crate::image::Picture;
use crate::source::Frame;
use crate::vision::Prior;

/// Frames without a ball after which that is said.
const EMPTY: u64 = 60;

/// Reads frames until they show the whole ball, or end.
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
        arguments.images.max_pixels,
    )?;
    let answer = "spindoe: no more frames are taken; once more ends at once";
    let stop = crate::cli::interrupt::stop_on_interrupt(answer)?;
    let mut clip = LiveClip::new(stand_in(arguments, config)?, known, config.clone());
    let found = filmed(&mut pipe, &mut clip, &prior, arguments, &stop)?;
    // From here on a signal ends the process.
    stop.store(true, Ordering::Relaxed);
    if let Some(found) = found {
        return Ok(found.into());
    }
    let survey = clip.finish()?;
    errln!("{}", so_far(&survey));
    let refused = |why: &UnknownRejection, side: Option<&MissingSide>| {
        let mut reason = why.to_string();
        if let Some(side) = side {
            let there = side.now.words();
            reason += &format!("; what is missing was {there} in the last frame");
        }
        if why.is_of_marks() {
            reason += "; to name the dots (--marks) give the clip as a file";
        }
        no_answer(pipe.name.clone(), &reason)
    };
    let decided = survey.decided();
    let missing = survey.missing;
    let built = survey.pattern;
    let built = built.map_err(|why| refused(&why, missing.as_ref()))?;
    say_decided(arguments, decided);
    let found = clip.confirm(built)?;
    Ok(found.map_err(|why| refused(&why, why.side()))?.into())
}

/// Takes frames in, and says what they show, until a pattern is confirmed; `None` where they end before.
fn filmed(
    pipe: &mut Pipe,
    clip: &mut LiveClip,
    prior: &Prior,
    arguments: &Arguments,
    stop: &AtomicBool,
) -> Result<Option<LivePattern>> {
    let mut frame = Frame::default();
    let mut taken = 0;
    let found = loop {
        if stop.load(Ordering::Relaxed) {
            break None;
        }
        if clip.is_full() {
            errln!("{} frames of the ball: no more are taken", clip.frames());
            break None;
        }
        let time_s = match pipe.next_frame(&mut frame) {
            Ok(Some(time_s)) => time_s,
            Ok(None) => break None,
            // Ctrl-C ends the camera's command, too, and cuts its last frame.
            Err(_) if stop.load(Ordering::Relaxed) => break None,
            Err(problem) if clip.frames() > 0 => {
                errln!("note: {problem}: what was filmed until then is judged");
                break None;
            }
            Err(problem) => return Err(problem),
        };
        if arguments.images.bright_dots {
            frame.convert(Picture::negative);
        }
        let picture = frame.picture.as_ref().map_err(|e| e.to_string());
        let picture = picture.map_err(Error::Internal)?;
        let view = picture.view()?;
        arguments.images.check_size([view.width(), view.height()])?;
        clip.push(picture, prior, time_s)?;
        taken += 1;
        if taken == EMPTY && clip.frames() == 0 {
            errln!("{EMPTY} frames, and none shows a ball");
        }
        let Some(survey) = clip.poll()? else { continue };
        say(&survey);
        let decided = survey.decided();
        if let Ok(built) = survey.pattern {
            match clip.confirm(built)? {
                Ok(found) => {
                    say_decided(arguments, decided);
                    break Some(found);
                }
                Err(why) => errln!("not yet: {}", and_now(&why, why.side())),
            }
        }
    };
    pipe.say_dropped(taken);
    Ok(found)
}

/// What is shown so far, and what to turn to the camera.
fn say(survey: &Survey) {
    let so_far = so_far(survey);
    match &survey.pattern {
        Ok(_) => errln!("{so_far}: all of it"),
        Err(why) => errln!("{so_far}; {}", and_now(why, survey.missing.as_ref())),
    }
}

/// What is shown so far.
fn so_far(survey: &Survey) -> String {
    // Print is among them until it is known which are dots.
    let what = match survey.pattern {
        Ok(_) => "dot",
        Err(_) => "mark",
    };
    format!(
        "{} of {} frames placed, {:.1} % of the ball shown, {}",
        survey.placed.len(),
        survey.frames,
        100.0 * survey.shown,
        counted(survey.dots, what)
    )
}

/// What to turn to the camera, else what is wrong.
fn and_now(why: &UnknownRejection, side: Option<&MissingSide>) -> String {
    match side {
        Some(side) => format!("now show what is {}", side.now.words()),
        None => why.to_string(),
    }
}

impl From<LivePattern> for CalibratedClip {
    fn from(found: LivePattern) -> Self {
        Self {
            dot_radius_rad: Some(found.built.middle_radius_rad()),
            ball: Ball::new(found.built.pattern.clone()),
            is_design: false,
            surface: None,
            frames: IdentifiedFrames {
                estimates: found.frames,
                files: Vec::new(),
                times_s: Some(found.times_s),
            },
            calibration: found.calibration,
        }
    }
}
