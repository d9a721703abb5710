//! `--balls` and `--strobe-ms`: all balls of every frame, or all images of one ball in each exposure.

mod report;

use std::str::FromStr;

use super::Asked;
use crate::clip::{BallsEstimator, Strobe};
use crate::error::Result;
use crate::vision::Estimator;
use crate::vision::frame::config::{CameraDistance, CameraModel};
#[cfg(feature = "plot")]
pub(super) use report::BallRows;
pub(super) use report::BallsReport;
pub(in crate::cli) use report::{shot_line, strobe_json, strobe_numbers, strobe_rows};

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
pub(in crate::cli) enum BallCount {
    /// As many as there are.
    Auto,
    /// So many.
    Of(usize),
}

pub(in crate::cli) fn count(text: &str) -> std::result::Result<BallCount, String> {
    match usize::from_str(text) {
        _ if text == "auto" => Ok(BallCount::Auto),
        Ok(count @ 1..=16) => Ok(BallCount::Of(count)),
        _ => Err("expected 1 to 16, or auto".into()),
    }
}

/// All balls of a frame, or all images of one by flashes, where these are asked for.
pub(in crate::cli) fn estimator(
    asked: &Asked,
    estimators: &[Estimator],
    strobe: Option<&Strobe>,
) -> Result<Option<BallsEstimator>> {
    let count = match (asked.balls, strobe) {
        (Some(BallCount::Of(count)), _) => Some(count),
        (Some(BallCount::Auto), _) => None,
        (None, Some(strobe)) => Some(strobe.times_s().len()),
        (None, None) => return Ok(None),
    };
    BallsEstimator::new(estimators.to_vec(), count).map(Some)
}

/// The flashes, where a frame is an exposure with several.
pub(in crate::cli) fn strobe(asked: &Asked) -> Result<Option<Strobe>> {
    let Some(flashes) = &asked.strobe_ms else {
        return Ok(None);
    };
    Strobe::new(flashes.times_s.clone(), asked.flight, asked.spin()).map(Some)
}
