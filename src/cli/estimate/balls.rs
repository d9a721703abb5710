//! `spindoe estimate --balls` and `--strobe-ms`: all balls of every frame, or all images of one ball in each exposure.

mod report;

use std::str::FromStr;

use serde_json::json;

#[cfg(feature = "plot")]
use super::overlay;
use super::{Arguments, Pictures, follow};
use crate::cli::images::{order_warning, read_balls};
use crate::cli::inputs;
use crate::cli::output::Counter;
use crate::clip::ball_tracks::BallTracks;
use crate::clip::balls::BallsEstimator;
use crate::clip::balls_batch::estimate_ball_inputs;
use crate::clip::strobe::Strobe;
use crate::error::{Error, Result};
use crate::files;
use crate::spin::robust::SpinConfig;
use crate::vision::frame::config::{CameraDistance, CameraModel};
use crate::vision::frame::prior::Budget;
use report::{Report, ball_json, sort_from_left, strobe_json, strobe_numbers};

/// A golf ball's radius over the distances of a launch monitor's camera, 0.4 to 0.6 m: their middle and a standard deviation.
const GOLF_CAMERA: CameraDistance = CameraDistance {
    inverse_distance: 0.0434,
    sigma: 0.006,
};

/// What a launch monitor's camera is taken to be.
pub(super) fn golf_camera() -> CameraModel {
    CameraModel::Unknown(GOLF_CAMERA)
}

/// How many balls a frame has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Count {
    /// As many as there are.
    Auto,
    /// So many.
    Of(usize),
}

pub(super) fn count(text: &str) -> std::result::Result<Count, String> {
    match usize::from_str(text) {
        _ if text == "auto" => Ok(Count::Auto),
        Ok(count @ 1..=16) => Ok(Count::Of(count)),
        _ => Err("expected 1 to 16, or auto".into()),
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let strobe = strobe(arguments)?;
    let estimators = read_balls(&arguments.table)?;
    let estimators = estimators.iter().map(|ball| arguments.estimator(ball));
    let estimators = estimators.collect::<Result<Vec<_>>>()?;
    let count = match arguments.balls {
        Some(Count::Of(count)) => Some(count),
        Some(Count::Auto) => None,
        None => strobe.as_ref().map(|s| s.times_s().len()),
    };
    let estimator = BallsEstimator::new(estimators, count)?;
    if arguments.follow {
        return follow_balls(arguments, &estimator, strobe.as_ref());
    }
    let config = arguments.batch()?;
    let file = arguments.output.as_deref().map(files::OutputFile::create);
    let file = file.transpose()?;
    #[cfg(feature = "plot")]
    let overlay = arguments.overlay.as_deref().map(overlay::Target::new);
    #[cfg(feature = "plot")]
    let overlay = overlay.transpose()?;
    let pictures = Pictures {
        #[cfg(feature = "plot")]
        wanted: overlay.is_some(),
        #[cfg(not(feature = "plot"))]
        wanted: false,
        counter: Counter::new(0, "frames"),
    };
    let images = &arguments.images;
    let mut batch = estimate_ball_inputs(&estimator, images, &config, strobe.as_ref(), &pictures)?;
    pictures.counter.finish();
    if let Some(warning) = order_warning(batch.frames.iter().map(|f| f.frame.name.as_str())) {
        errln!("note: {warning}");
    }
    if batch.is_disordered() && strobe.is_none() && !arguments.no_sequence {
        inputs::say_not_increasing();
    }
    let report = Report::new(arguments, &mut batch, strobe.as_ref())?;
    #[cfg(feature = "plot")]
    if let Some(target) = overlay {
        let frame = |k: usize| report.drawn(k, estimator.estimators());
        target.draw(report.times(), report.frames(), frame)?;
    }
    arguments.write(file, &report.to_csv(), || report.to_json())?;
    report.say();
    match report.identified() {
        0 => Err(Error::NoAnswer {
            path: arguments.images[0].clone(),
            reason: format!("no ball of {} frames is identified", report.frames()),
        }),
        _ => Ok(()),
    }
}

/// The flashes, where a frame is an exposure with several.
fn strobe(arguments: &Arguments) -> Result<Option<Strobe>> {
    let Some(flashes) = &arguments.strobe_ms else {
        return Ok(None);
    };
    let spin = SpinConfig {
        max_rps: arguments.max_spin_rps(),
        ..SpinConfig::default()
    };
    Strobe::new(flashes.times_s.clone(), arguments.flight, spin).map(Some)
}

fn follow_balls(
    arguments: &Arguments,
    estimator: &BallsEstimator,
    strobe: Option<&Strobe>,
) -> Result<()> {
    let shown_in = arguments.frame()?;
    let max_latency = follow::max_latency(arguments.max_latency_ms)?;
    let region = arguments.source.roi()?;
    let spin = SpinConfig {
        max_rps: arguments.max_spin_rps(),
        ..SpinConfig::default()
    };
    let mut tracks = BallTracks::new(spin);
    let mut ws = estimator.workspace()?;
    follow::each_frame(arguments, |image, number, time_s, arrived| {
        let budget = max_latency.map_or_else(Budget::default, Budget::within);
        let mut balls = match strobe {
            Some(strobe) => estimator.estimate_strobed(image, region, strobe, &budget, &mut ws),
            None => {
                let expected = tracks.expected(time_s);
                estimator.estimate(image, region, &expected, &budget, &mut ws)
            }
        };
        let mut line = json!({ "frame": number, "time_s": time_s });
        let numbers = match strobe {
            None => {
                let numbers = tracks.update(time_s, &balls);
                tracks.reject_foreign(&mut balls, &numbers);
                numbers
            }
            Some(strobe) => {
                sort_from_left(&mut balls);
                let found = strobe.read(&balls, shown_in);
                let numbers = strobe_numbers(&balls, &found);
                line["strobe"] = strobe_json(arguments, strobe, shown_in, &found, &numbers);
                numbers
            }
        };
        let is_identified = balls.iter().any(|b| b.frame.pose().is_some());
        let mut numbered: Vec<_> = numbers.into_iter().zip(&balls).collect();
        numbered.sort_by_key(|(number, _)| *number);
        let shown = numbered.iter().map(|(number, ball)| {
            let mut json = ball_json(arguments, shown_in, *number, ball);
            if let Some((table, share)) = number.and_then(|n| tracks.table(n)) {
                json["table"] = arguments.table[table].display().to_string().into();
                json["table_probability"] = share.into();
            }
            json
        });
        line["balls"] = shown.collect();
        line["latency_ms"] = (1e3 * arrived.elapsed().as_secs_f64()).into();
        Ok((is_identified, line))
    })
}
