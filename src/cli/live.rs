//! `spindoe estimate --follow -`: frames from a pipe, a JSON line for each at once.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::Arguments;
use super::written::{ball_json, own_row};
use crate::cli::images::read_ball;
use crate::cli::inputs::say_camera;
use crate::cli::pipe::Pipe;
use crate::clip::{LiveCheck, NamedFrame, SequenceConfig, Tracker, TrackerConfig, TrackerState};
use crate::error::{Error, Result, require};
use crate::geometry::CameraFrame;
use crate::image::{ImageView, Picture};
use crate::source::Frame;

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let [table] = &arguments.table[..] else {
        let problem = "expected one table: a stream is not judged as a whole";
        return Err(Error::argument("--table", problem));
    };
    let estimator = Arc::new(arguments.estimator(&read_ball(table)?)?);
    let (outline, circles) = arguments.source.outlines()?;
    if circles.is_some() {
        let problem = "expected U,V,R with --follow, found a table of frames";
        return Err(Error::argument("circle", problem));
    }
    let shown_in = arguments.frame()?;
    let mut sequence = SequenceConfig::default();
    sequence.spin.max_rps = arguments.max_spin_rps();
    let config = TrackerConfig {
        sequence,
        max_latency: max_latency(arguments.max_latency_ms)?,
        ..TrackerConfig::default()
    };
    let mut check = LiveCheck::new(estimator.camera());
    let mut tracker = Tracker::new(estimator, config)?;
    if let Some(roi) = arguments.source.roi()? {
        tracker = tracker.within(roi);
    }
    let followed = each_frame(arguments, |image, number, time_s, arrived| {
        let rows = image.height();
        let state = tracker.update(image, time_s, outline.as_ref())?;
        say_camera(check.push(rows, [state.frame]).as_ref());
        let is_identified = state.frame.pose().is_some();
        Ok((
            is_identified,
            line(shown_in, number, time_s, &state, arrived),
        ))
    });
    say_camera(check.end().as_ref());
    followed
}

/// Hands each frame of the pipe with its number, time and arrival to `work`, and writes the line that it makes at once; `work` says
/// whether the frame was identified, too.
pub(super) fn each_frame(
    arguments: &Arguments,
    mut work: impl FnMut(ImageView<'_>, u64, f64, Instant) -> Result<(bool, Value)>,
) -> Result<()> {
    let mut pipe = Pipe::open(
        "--follow",
        &arguments.images,
        arguments.raw,
        arguments.source.fps,
        arguments.source.max_pixels,
    )?;
    let mut stdout = std::io::stdout().lock();
    let (mut followed, mut identified) = (0u64, 0u64);
    let mut frame = Frame::default();
    while let Some(time_s) = pipe.next_frame(&mut frame)? {
        if arguments.mirrored {
            let picture = std::mem::replace(&mut frame.picture, Ok(Picture::default()));
            frame.picture = picture.and_then(Picture::mirrored);
        }
        let picture = frame.picture.as_ref().map_err(|e| e.to_string());
        let picture = picture.map_err(Error::Internal)?;
        let view = picture.view()?;
        arguments.source.check_size([view.width(), view.height()])?;
        let (is_identified, line) = work(view, frame.number, time_s, frame.arrived)?;
        followed += 1;
        identified += u64::from(is_identified);
        writeln!(stdout, "{line}")
            .and_then(|()| stdout.flush())
            .map_err(crate::cli::stdout_error)?;
    }
    pipe.say_dropped(followed);
    finish(&pipe.name, followed, identified)
}

pub(super) fn max_latency(ms: Option<f64>) -> Result<Option<Duration>> {
    let Some(ms) = ms else {
        return Ok(None);
    };
    let inside = ms > 0.0 && ms <= 1e6;
    require(
        inside,
        "--max-latency-ms",
        "a positive number up to 1000000",
        ms,
    )?;
    Ok(Some(Duration::from_secs_f64(1e-3 * ms)))
}

/// Summarizes the frames on standard error.
fn finish(input: &Path, frames: u64, identified: u64) -> Result<()> {
    if identified > 0 {
        errln!(
            "{}: {identified} of {frames} frames identified",
            input.display()
        );
        return Ok(());
    }
    let reason = match frames {
        0 => "no frame arrived".to_owned(),
        _ => format!("none of {frames} frames is identified"),
    };
    Err(Error::NoAnswer {
        path: input.to_path_buf(),
        reason,
    })
}

fn line(
    shown_in: CameraFrame,
    number: u64,
    time_s: f64,
    state: &TrackerState<'_>,
    arrived: Instant,
) -> Value {
    let frame = state.frame;
    let row = own_row(NamedFrame::of(time_s, frame), shown_in);
    let mut json = ball_json(&row, shown_in, frame);
    json["frame"] = number.into();
    json["time_s"] = time_s.into();
    match state.spin {
        Ok(fit) => {
            let turned = fit.turned(&shown_in.turn());
            json["spin"] = crate::cli::spin_summary::fit_json(&turned, shown_in);
            if !state.clock.is_right() {
                json["spin"]["clock"] = json!(state.clock.words());
            }
        }
        Err(rejection) => json["spin_refusal"] = rejection.to_string().into(),
    }
    json["latency_ms"] = (1e3 * arrived.elapsed().as_secs_f64()).into();
    json
}
