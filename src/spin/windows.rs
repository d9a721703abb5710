//! Spin over time: the spin of short runs of a long sequence, each taken as constant.
//!
//! Runs overlap by half, so that neighbors are not independent. A run that the estimator rejects
//! leaves a gap.

use super::robust::{RobustEstimator, RobustSpinConfig};
use super::{Fit, MIN_FRAMES, Measurement, SpinRejection, check};

/// A run's spin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowFit {
    /// Mean time of the run's orientations, seconds.
    pub time_s: f64,
    /// The estimate.
    pub fit: Fit,
}

/// The spin of every run of `length` orientations, half a run apart.
///
/// # Errors
/// A [`SpinRejection`] where the measurements are invalid or fewer than one run.
pub fn spin_over_time(
    measurements: &[Measurement],
    length: usize,
    options: &RobustSpinConfig,
) -> Result<Vec<WindowFit>, SpinRejection> {
    let length = length.max(MIN_FRAMES);
    check(measurements, length)?;
    let mut estimator = RobustEstimator::new(*options);
    let last = measurements.len() - length;
    // The last run ends with the sequence, so that no orientation is left out.
    let starts = (0..last).step_by((length / 2).max(1)).chain([last]);
    let fit = |start: usize| {
        let run = &measurements[start..start + length];
        let fit = estimator.fit(run).ok()?;
        let time_s = run.iter().map(|m| m.time_s).sum::<f64>() / length as f64;
        Some(WindowFit { time_s, fit })
    };
    Ok(starts.filter_map(fit).collect())
}
