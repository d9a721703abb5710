//! `spindoe estimate --balls` and `--strobe-ms`: all balls of every frame, or all images of one ball in each exposure.

mod report;

use std::str::FromStr;

use serde_json::json;

use super::written::own_row;
use super::{Arguments, follow};
use crate::cli::inputs::say_camera;
use crate::clip::{
    BallEstimate, BallTracks, BallsEstimator, LiveCheck, NamedFrame, Strobe, sort_from_left,
};
use crate::error::Result;
use crate::spin::robust::SpinConfig;
use crate::vision::Estimator;
use crate::vision::frame::config::{CameraDistance, CameraModel};
use crate::vision::frame::prior::Budget;
pub(super) use report::Report;
use report::{Row, strobe_json, strobe_numbers, strobe_rows};

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

/// All balls of a frame, or all images of one by flashes, where these are asked for.
pub(super) fn estimator(
    arguments: &Arguments,
    estimators: &[Estimator],
    strobe: Option<&Strobe>,
) -> Result<Option<BallsEstimator>> {
    let count = match (arguments.balls, strobe) {
        (Some(Count::Of(count)), _) => Some(count),
        (Some(Count::Auto), _) => None,
        (None, Some(strobe)) => Some(strobe.times_s().len()),
        (None, None) => return Ok(None),
    };
    BallsEstimator::new(estimators.to_vec(), count).map(Some)
}

/// The flashes, where a frame is an exposure with several.
pub(super) fn strobe(arguments: &Arguments) -> Result<Option<Strobe>> {
    let Some(flashes) = &arguments.strobe_ms else {
        return Ok(None);
    };
    let spin = SpinConfig {
        max_rps: arguments.max_spin_rps(),
        ..SpinConfig::default()
    };
    Strobe::new(flashes.times_s.clone(), arguments.flight, spin).map(Some)
}

/// Follows several balls through the frames of a pipe.
pub(super) fn follow_balls(
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
    let camera = estimator.estimators().first().map(Estimator::camera);
    let mut check = camera.map(LiveCheck::new);
    let followed = follow::each_frame(arguments, |image, number, time_s, arrived| {
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
        let mut rows = match strobe {
            None => {
                let numbers = tracks.update(time_s, &balls);
                tracks.reject_foreign(&mut balls, &numbers);
                let numbered = numbers.into_iter().zip(&balls);
                let row = |(number, ball): (Option<usize>, &BallEstimate)| {
                    let row = own_row(NamedFrame::of(time_s, &ball.frame), shown_in);
                    let mut row = Row::new(arguments, shown_in, row, number, ball);
                    if let Some((table, share)) = number.and_then(|n| tracks.table(n)) {
                        row.json["table"] = arguments.table[table].display().to_string().into();
                        row.json["table_probability"] = share.into();
                    }
                    (number, row)
                };
                let mut rows: Vec<_> = numbered.map(row).collect();
                rows.sort_by_key(|(number, _)| *number);
                rows.into_iter().map(|(_, row)| row).collect()
            }
            Some(strobe) => {
                sort_from_left(&mut balls);
                let found = strobe.read(&balls, shown_in);
                let numbers = strobe_numbers(&balls, &found);
                line["strobe"] = strobe_json(arguments, strobe, shown_in, &found, &numbers);
                strobe_rows(arguments, shown_in, ("", time_s), &balls, &found, &numbers)
            }
        };
        let check = check.as_mut();
        let doubt = check.and_then(|c| c.push(height, balls.iter().map(|b| &b.frame)));
        say_camera(doubt.as_ref());
        let is_identified = balls.iter().any(|b| b.frame.pose().is_some());
        let shown = rows.iter_mut().map(|row| row.json.take());
        line["balls"] = shown.collect();
        line["latency_ms"] = (1e3 * arrived.elapsed().as_secs_f64()).into();
        Ok((is_identified, line))
    });
    say_camera(check.and_then(|mut c| c.end()).as_ref());
    followed
}
