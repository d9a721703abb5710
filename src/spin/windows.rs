//! Spin over time: the spin of short runs of a long sequence, each taken as constant, and the stretches over
//! which it is constant.
//!
//! Runs overlap by half, so that neighbors are not independent. A run that the estimator rejects
//! leaves a gap. Stretches do not overlap: a run is extended to twice its length, from the spin that it has, for
//! as long as most of it agrees with one spin, so that a stretch is found to half its length. The cost is linear
//! in the orientations.

use std::ops::Range;

use super::mixture::is_majority;
use super::repeated::Merged;
use super::robust::{RobustEstimator, SpinConfig};
use super::{Fit, MIN_FRAMES, Measurement, SpinRejection, check};

/// A stretch's noise is at most so many times that of its half, and at least this share of the orientations
/// that agreed there agrees: else the spin changes.
const MAX_WIDENING: f64 = 2.0;
const MIN_SHARE: f64 = 0.8;

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
    options: &SpinConfig,
) -> Result<Vec<WindowFit>, SpinRejection> {
    let length = length.max(MIN_FRAMES);
    check(measurements, length)?;
    let merged = Merged::of(measurements, options.sigma_rad);
    let measurements = &*merged.measurements;
    let mut estimator = RobustEstimator::new(*options);
    let last = measurements.len() - length;
    // The last run ends with the sequence, so that no orientation is left out.
    let starts = (0..last).step_by((length / 2).max(1)).chain([last]);
    let fit = |start: usize| {
        let run = &measurements[start..start + length];
        let fit = estimator.fit_part(run).ok()?;
        let time_s = run.iter().map(|m| m.time_s).sum::<f64>() / length as f64;
        Some(WindowFit { time_s, fit })
    };
    Ok(starts.filter_map(fit).collect())
}

/// A stretch of a sequence with a constant spin.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Its orientations among those of the sequence.
    pub orientations: Range<usize>,
    /// Their spin.
    pub fit: Fit,
}

/// The stretches of a sequence over which one constant spin holds, each from a run of `config.window`
/// orientations on.
///
/// # Errors
/// A [`SpinRejection`] where the settings or measurements are invalid, or the measurements fewer than one run.
pub fn constant_stretches(
    measurements: &[Measurement],
    config: &SpinConfig,
) -> Result<Vec<Stretch>, SpinRejection> {
    config.check()?;
    check(measurements, config.window)?;
    let merged = Merged::of(measurements, config.sigma_rad);
    let measurements = &*merged.measurements;
    let mut estimator = RobustEstimator::new(*config);
    let mut stretches = Vec::new();
    let mut from = 0;
    while from + config.window <= measurements.len() {
        let mut held: Option<Stretch> = None;
        let mut length = config.window;
        loop {
            let orientations = from..(from + length).min(measurements.len());
            let part = &measurements[orientations.clone()];
            let fit = match &held {
                None => estimator.fit_part(part),
                Some(held) => estimator.extend(part, held.orientations.len(), &held.fit),
            };
            let Ok(fit) = fit else {
                break;
            };
            let noise = |fit: &Fit| fit.sigma_rad.unwrap_or(config.sigma_rad);
            let share = |s: &Stretch| s.fit.inliers as f64 / s.orientations.len() as f64;
            let is_last = orientations.end == measurements.len();
            let next = Stretch { orientations, fit };
            let is_worse = held.as_ref().is_some_and(|held| {
                noise(&fit) > MAX_WIDENING * noise(&held.fit)
                    || share(&next) < MIN_SHARE * share(held)
            });
            if is_worse || !is_majority(fit.inliers, part) {
                break;
            }
            held = Some(next);
            if is_last {
                break;
            }
            length *= 2;
        }
        from = held
            .as_ref()
            .map_or(from + config.window, |s| s.orientations.end);
        stretches.extend(held.map(|held| Stretch {
            orientations: merged.given(&held.orientations),
            ..held
        }));
    }
    Ok(stretches)
}
