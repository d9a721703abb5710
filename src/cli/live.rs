//! `spindoe live`: frames as they come, a JSON line for each at once.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use clap::{ArgMatches, Args};
use serde_json::{Value, json};

use super::estimate::balls::{self, shot_line, strobe_json, strobe_numbers, strobe_rows};
use super::estimate::format::ForeignFormat;
use super::estimate::verdict::VerdictWords;
use super::estimate::written::{WrittenRow, ball_json, circle_json, own_row};
use super::estimate::{Asked, check_painted, painted};
use super::images::read_ball;
use super::inputs::say_camera;
use super::pipe::{Pipe, pipe_format};
use crate::clip::painted::painted_row;
use crate::clip::{
    BallEstimate, BallTracks, BallsEstimator, Judgment, LiveCheck, NamedFrame, PaintedStream,
    SequenceConfig, Strobe, Tracker, TrackerConfig, sort_from_left,
};
use crate::error::{Error, Result, require};
use crate::geometry::CameraFrame;
use crate::image::{ImageView, Picture};
use crate::source::Frame;
use crate::source::pipe::PipeFormat;
use crate::spin::clock::Clock;
use crate::spin::fictrac::FicTrac;
use crate::spin::orientations::OrientationRow;
use crate::spin::{Fit, SpinRejection};
use crate::surface::SurfaceMap;
use crate::vision::Estimator;
use crate::vision::frame::estimate::FrameRejection;
use crate::vision::frame::prior::{Budget, OutlinePrior};

#[derive(Debug, Args)]
#[command(after_help = "\
One line of JSON a frame goes to standard output, the counts at the end to standard error. One ball is followed from frame to
frame; a line has its orientation, and the spin of the last quarter of a second. With
--balls a line has all of them, with --strobe-ms the flashes of its exposure; with --as a line is what another program reads. Where
--table is the surface of a painted ball, this is followed. Fields are those of `spindoe estimate --json`,
and latency_ms, the time from the frame's arrival to its line.

Without --fps a frame's time is that of its arrival; frames that come faster than they can be processed are then dropped
and counted. A file needs --fps; of one that grows, `tail -c +1 -f FILE` makes a pipe. The end of the input ends the command.

Examples:
  ffmpeg -i CAMERA -f rawvideo -pix_fmt gray - |
      spindoe live --table my-ball - --raw 640x480,gray
  spindoe live --table dots20 stream.pgm --fps 350 --max-latency-ms 20")]
pub struct Arguments {
    /// The frames: a pipe, a device or a file; - is standard input.
    #[arg(value_name = "-|DEVICE|FILE")]
    input: PathBuf,
    /// The frames are raw video of this size, 8 bits a channel: gray, rgb or bgr [default: image files one after another,
    /// PNG, JPEG, PGM or PPM].
    #[arg(long, value_name = "WxH,PIXEL", value_parser = pipe_format)]
    raw: Option<PipeFormat>,
    /// The most time for a frame, milliseconds: then the search for the ball ends, and the frame has no answer [default:
    /// no limit].
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    max_latency_ms: Option<f64>,
    #[command(flatten)]
    asked: Asked,
}

pub fn run(arguments: &Arguments, given: Option<&ArgMatches>) -> Result<()> {
    let asked = &arguments.asked;
    asked.check()?;
    let inputs = std::slice::from_ref(&arguments.input);
    asked.source.settle_camera(inputs, arguments.raw)?;
    if let Some(surface) = asked.surface()? {
        check_painted(given)?;
        return painted_ball(arguments, surface);
    }
    if !asked.is_several() {
        return one_ball(arguments);
    }
    let strobe = balls::strobe(asked)?;
    let estimators = asked.estimators(false)?;
    match balls::estimator(asked, &estimators, strobe.as_ref())? {
        Some(several) => all_balls(arguments, &several, strobe.as_ref()),
        None => one_ball(arguments),
    }
}

impl Arguments {
    /// The ball's outline in all frames, where it is given.
    fn outline(&self) -> Result<Option<OutlinePrior>> {
        match self.asked.source.outlines()? {
            (outline, None) => Ok(outline),
            (_, Some(_)) => {
                let problem = "expected U,V,R for frames that come, found a table of frames";
                Err(Error::argument("circle", problem))
            }
        }
    }

    fn tracker(&self) -> Result<TrackerConfig> {
        let mut sequence = SequenceConfig::default();
        sequence.spin.max_rps = self.asked.max_rps();
        Ok(TrackerConfig {
            sequence,
            max_latency: max_latency(self.max_latency_ms)?,
            ..TrackerConfig::default()
        })
    }
}

/// Follows one ball.
fn one_ball(arguments: &Arguments) -> Result<()> {
    let asked = &arguments.asked;
    let [table] = &asked.table[..] else {
        let problem = "expected one table: a stream is not judged as a whole";
        return Err(Error::argument("--table", problem));
    };
    let estimator = Arc::new(asked.estimator(&read_ball(table)?, false)?);
    let outline = arguments.outline()?;
    let shown_in = asked.frame()?;
    let config = arguments.tracker()?;
    let mut check = LiveCheck::new(estimator.camera());
    let mut said = None;
    let mut tracker = Tracker::new(estimator, config)?;
    if let Some(roi) = asked.source.roi()? {
        tracker = tracker.within(roi);
    }
    let mut fictrac = asked.fictrac()?.map(FicTrac::new);
    asked.say_format()?;
    let followed = each_frame(arguments, |image, number, time_s, arrived| {
        let rows = image.height();
        let state = tracker.update(image, time_s, outline.as_ref())?;
        say_camera(check.push(rows, [state.frame]).as_ref());
        say_verdict(&mut said, state.judgment, &asked.table);
        let is_identified = state.frame.pose().is_some();
        let row = own_row(NamedFrame::of(time_s, state.frame), shown_in);
        let line = match &mut fictrac {
            Some(fictrac) => fictrac_line(fictrac, number, &row, arrived)?,
            None => {
                let json = ball_json(&row, shown_in, state.frame);
                let spin = (state.spin, state.clock);
                Some(line(json, (number, time_s, arrived), spin, shown_in))
            }
        };
        Ok((is_identified, line))
    });
    say_camera(check.end().as_ref());
    followed
}

/// Says why frames keep no pose, where that is new.
fn say_verdict(said: &mut Option<FrameRejection>, judgment: &Judgment, tables: &[PathBuf]) {
    let now = judgment.rejection();
    if now != *said
        && now.is_some()
        && let Some(words) = VerdictWords::new(judgment, tables).rejection()
    {
        errln!("note: {words}");
    }
    *said = now;
}

/// Follows one painted ball by its surface.
fn painted_ball(arguments: &Arguments, surface: SurfaceMap) -> Result<()> {
    let asked = &arguments.asked;
    let outline = arguments.outline()?;
    let axes = asked.frame()?;
    let estimator = Arc::new(painted::estimator(asked)?);
    let mut stream = PaintedStream::new(estimator, surface, arguments.tracker()?)?;
    if let Some(roi) = asked.source.roi()? {
        stream = stream.within(roi);
    }
    let mut fictrac = asked.fictrac()?.map(FicTrac::new);
    asked.say_format()?;
    each_frame(arguments, |image, number, time_s, arrived| {
        let state = stream.update(image, time_s, outline.as_ref())?;
        let row = own_row(NamedFrame::of(time_s, state.frame), axes);
        let row = painted_row(row, state.pose.as_ref().ok(), axes);
        let line = match &mut fictrac {
            Some(fictrac) => fictrac_line(fictrac, number, &row, arrived)?,
            None => {
                let mut json = painted::of_frame(row, &state.pose, axes).json;
                json["circle"] = json!(state.frame.circle.as_ref().map(circle_json));
                let spin = (state.spin, state.clock);
                Some(line(json, (number, time_s, arrived), spin, axes))
            }
        };
        Ok((state.pose.is_ok(), line))
    })
}

/// Follows all balls of the frames, or reads the flashes of each.
fn all_balls(
    arguments: &Arguments,
    estimator: &BallsEstimator,
    strobe: Option<&Strobe>,
) -> Result<()> {
    let asked = &arguments.asked;
    let shown_in = asked.frame()?;
    let max_latency = max_latency(arguments.max_latency_ms)?;
    let region = asked.source.roi()?;
    asked.say_format()?;
    let mut tracks = BallTracks::new(asked.spin());
    let mut ws = estimator.workspace()?;
    let camera = estimator.estimators().first().map(Estimator::camera);
    let mut check = camera.map(LiveCheck::new);
    let followed = each_frame(arguments, |image, number, time_s, arrived| {
        let height = image.height();
        let budget = max_latency.map_or_else(Budget::default, Budget::within);
        let mut balls = match strobe {
            Some(strobe) => estimator.estimate_strobed(image, region, strobe, &budget, &mut ws),
            None => {
                let expected = tracks.expected(time_s);
                estimator.estimate(image, region, &expected, &budget, &mut ws)
            }
        };
        let mut line = json!({ "frame": number, "time_s": time_s });
        let mut shot = None;
        let mut rows = match strobe {
            None => tracked_rows(asked, shown_in, &mut tracks, time_s, &mut balls),
            Some(strobe) => {
                sort_from_left(&mut balls);
                let found = strobe.read(&balls, shown_in);
                let numbers = strobe_numbers(&balls, &found);
                shot = shot_line(number + 1, &found, shown_in);
                line["strobe"] = strobe_json(asked, strobe, shown_in, &found, &numbers);
                strobe_rows(asked, shown_in, ("", time_s), &balls, &found, &numbers)
            }
        };
        let check = check.as_mut();
        let doubt = check.and_then(|c| c.push(height, balls.iter().map(|b| &b.frame)));
        say_camera(doubt.as_ref());
        let is_identified = balls.iter().any(|b| b.frame.pose().is_some());
        let shown = rows.iter_mut().map(|row| row.json.take());
        line["balls"] = shown.collect();
        line["latency_ms"] = (1e3 * arrived.elapsed().as_secs_f64()).into();
        // Where shots are asked for, an exposure without one is not answered.
        Ok(match asked.is_as(ForeignFormat::Gspro) {
            true => (shot.is_some(), shot),
            false => (is_identified, Some(line.to_string())),
        })
    });
    say_camera(check.and_then(|mut c| c.end()).as_ref());
    followed
}

/// The rows of the balls of a frame, by their numbers.
fn tracked_rows(
    asked: &Asked,
    shown_in: CameraFrame,
    tracks: &mut BallTracks,
    time_s: f64,
    balls: &mut [BallEstimate],
) -> Vec<WrittenRow> {
    let numbers = tracks.update(time_s, balls);
    tracks.reject_foreign(balls, &numbers);
    let row = |(number, ball): (Option<usize>, &BallEstimate)| {
        let row = own_row(NamedFrame::of(time_s, &ball.frame), shown_in);
        let mut row = WrittenRow::of_ball(asked, shown_in, row, number, ball);
        if let Some((table, share)) = number.and_then(|n| tracks.table(n)) {
            row.json["table"] = asked.table[table].display().to_string().into();
            row.json["table_probability"] = share.into();
        }
        (number, row)
    };
    let mut rows: Vec<_> = numbers.into_iter().zip(&*balls).map(row).collect();
    rows.sort_by_key(|(number, _)| *number);
    rows.into_iter().map(|(_, row)| row).collect()
}

/// When a frame that has arrived was taken, ms since midnight (UTC), by the clock of the computer.
fn taken_ms(arrived: Instant) -> Option<f64> {
    let taken = SystemTime::now().checked_sub(arrived.elapsed())?;
    let since = taken.duration_since(SystemTime::UNIX_EPOCH).ok()?;
    Some(1e3 * (since.as_secs_f64() % 86_400.0))
}

/// Hands each frame of the pipe with its number, time and arrival to `work`, and writes the line that it makes, if it does, at once; `work` says
/// whether the frame was identified, too.
fn each_frame(
    arguments: &Arguments,
    mut work: impl FnMut(ImageView<'_>, u64, f64, Instant) -> Result<(bool, Option<String>)>,
) -> Result<()> {
    let asked = &arguments.asked;
    let mut pipe = Pipe::open(
        "input",
        std::slice::from_ref(&arguments.input),
        arguments.raw,
        asked.source.fps,
        asked.source.max_pixels,
    )?;
    let mut stdout = std::io::stdout().lock();
    let (mut followed, mut identified) = (0u64, 0u64);
    let mut frame = Frame::default();
    while let Some(time_s) = pipe.next_frame(&mut frame)? {
        if asked.mirrored {
            frame.convert(Picture::mirrored);
        }
        if asked.source.bright_dots {
            frame.convert(Picture::negative);
        }
        let picture = frame.picture.as_ref().map_err(|e| e.to_string());
        let picture = picture.map_err(Error::Internal)?;
        let view = picture.view()?;
        asked.source.check_size([view.width(), view.height()])?;
        let (is_identified, line) = work(view, frame.number, time_s, frame.arrived)?;
        followed += 1;
        identified += u64::from(is_identified);
        let Some(line) = line else {
            continue;
        };
        writeln!(stdout, "{line}")
            .and_then(|()| stdout.flush())
            .map_err(crate::cli::stdout_error)?;
    }
    finish(&pipe, followed, identified)
}

fn max_latency(ms: Option<f64>) -> Result<Option<Duration>> {
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
fn finish(pipe: &Pipe, frames: u64, identified: u64) -> Result<()> {
    let words = counts(frames, pipe.dropped(), identified);
    let path = pipe.name.clone();
    if identified == 0 {
        return Err(Error::NoAnswer {
            path,
            reason: words,
        });
    }
    errln!("{}: {words}", path.display());
    Ok(())
}

/// How many frames of those that came are identified: so many were processed, and so many dropped.
fn counts(processed: u64, dropped: u64, identified: u64) -> String {
    let lost = match dropped {
        0 => String::new(),
        _ => format!("; {dropped} came faster than they can be processed, and were dropped"),
    };
    match (processed + dropped, identified) {
        (0, _) => "no frame arrived".to_owned(),
        (arrived, 0) => format!("none of {arrived} frames is identified{lost}"),
        (arrived, _) => format!("{identified} of {arrived} frames identified{lost}"),
    }
}

/// The row of a followed frame in FicTrac's columns; frames that were dropped before it count.
fn fictrac_line(
    fictrac: &mut FicTrac,
    number: u64,
    row: &OrientationRow,
    arrived: Instant,
) -> Result<Option<String>> {
    fictrac.miss(number - fictrac.frames());
    let row = fictrac.push(row, taken_ms(arrived))?;
    Ok(row.map(|row| row.to_string()))
}

/// What is seen of a followed ball as a line: with the frame's number and time, the spin now or why there is none, and the latency.
fn line(
    mut json: Value,
    (number, time_s, arrived): (u64, f64, Instant),
    (spin, clock): (&std::result::Result<Fit, SpinRejection>, &Clock),
    axes: CameraFrame,
) -> String {
    json["frame"] = number.into();
    json["time_s"] = time_s.into();
    match spin {
        Ok(fit) => {
            let turned = fit.turned(&axes.turn());
            json["spin"] = crate::cli::spin_summary::fit_json(&turned, axes);
            if !clock.is_right() {
                json["spin"]["clock"] = json!(clock.words());
            }
        }
        Err(rejection) => json["spin_refusal"] = rejection.to_string().into(),
    }
    json["latency_ms"] = (1e3 * arrived.elapsed().as_secs_f64()).into();
    json.to_string()
}

#[cfg(test)]
mod tests {
    use super::counts;

    #[test]
    fn dropped_frames_count_among_those_that_came() {
        assert_eq!(counts(0, 0, 0), "no frame arrived");
        assert_eq!(counts(13, 0, 13), "13 of 13 frames identified");
        let words = counts(13, 37, 13);
        assert!(
            words.starts_with("13 of 50 frames identified; 37 came"),
            "{words}"
        );
        assert!(counts(5, 2, 0).starts_with("none of 7 frames is identified; 2 came"));
    }
}
