//! What a sequence says of its spin, all at once: the estimate and how well it is known, the other
//! spins that explain the orientations as well, and up to which spin the sampling has one answer.
//!
//! # Limit
//! Turning faster by `delta` about the same axis leaves no trace where the spectral window of the
//! sampling `|W(delta)|` is 1 (see [`alias`](super::alias)). A drop below 1 is seen where it costs
//! evidence: `n` orientations with the noise `sigma` lose `n (1 - |W|) / sigma^2` nats. The lowest
//! `delta` whose loss stays below [`EVIDENCE`] has an alias; a spin and its alias lie `delta` apart,
//! so that spins below half of it, `delta / 2`, have no slower one. Equal intervals `T` give `1 / (2
//! T)` revolutions per second; uneven ones more.

use std::f64::consts::TAU;

use nalgebra::Complex;

use super::alias::{AliasConfig, Alternative, SpinEvidence, alternatives, weigh};
use super::clock::Clock;
use super::{Fit, Measurement};
use crate::geometry::Rotation;

/// Nats that count as evidence: odds of 20 to 1.
pub const EVIDENCE: f64 = 3.0;
/// Steps of the scan per reciprocal of the sequence's duration.
const STEPS_PER_CYCLE: f64 = 16.0;
/// Frames times steps of the scan; beyond it only the leading frames are used.
const MAX_WORK: f64 = 2e7;
/// Halvings of a bracket around a peak.
const HALVINGS: usize = 60;

/// What a sequence says of its spin.
#[derive(Debug, Clone, PartialEq)]
pub struct SpinSummary {
    /// The estimate.
    pub fit: Fit,
    /// Other spins within the evidence, the likeliest first.
    pub alternatives: Vec<Alternative>,
    /// Spins up to this magnitude, revolutions per second, have no alias that is slower; `None`
    /// where that holds for all spins considered.
    pub unique_up_to_rps: Option<f64>,
    /// Root mean square angle between the agreeing orientations and the motion, radians.
    pub residual_rad: f64,
    /// Frames of the sequence.
    pub frames: usize,
    /// Those with an orientation.
    pub orientations: usize,
    /// What was found wrong with the times, and mended.
    pub clock: Clock,
}

impl SpinSummary {
    /// The summary of a fit to `measurements`, which come from `frames` frames.
    pub fn new(
        measurements: &[Measurement],
        fit: &Fit,
        config: &AliasConfig,
        frames: usize,
    ) -> Self {
        let times: Vec<f64> = measurements.iter().map(|m| m.time_s).collect();
        let sigma_rad = fit.sigma_rad.unwrap_or(config.sigma_rad);
        Self {
            fit: *fit,
            alternatives: alternatives(measurements, fit, config),
            unique_up_to_rps: unique_up_to_rps(&times, sigma_rad, config.max_rps),
            residual_rad: residual_rad(measurements, fit.inliers, |t| fit.motion.at(t)),
            frames,
            orientations: measurements.len(),
            clock: Clock::default(),
        }
    }

    /// With the alternatives weighed by further evidence, too: see [`weigh`].
    #[must_use]
    pub fn weighed(mut self, evidence: &dyn SpinEvidence, config: &AliasConfig) -> Self {
        let spin = self.fit.motion.spin;
        weigh(
            &mut self.alternatives,
            &spin,
            evidence,
            config.min_log_ratio,
        );
        self
    }

    /// The same in another camera frame, which `turn` leads to.
    #[must_use]
    pub fn turned(mut self, turn: &Rotation) -> Self {
        self.fit = self.fit.turned(turn);
        for alternative in &mut self.alternatives {
            alternative.spin = turn * alternative.spin;
        }
        self
    }
}

/// Root mean square angle between a motion and the orientations that agree with it, the nearest so many, radians.
pub(super) fn residual_rad(
    measurements: &[Measurement],
    inliers: usize,
    motion: impl Fn(f64) -> Rotation,
) -> f64 {
    let angle = |m: &Measurement| motion(m.time_s).angle_to(&m.orientation);
    let mut angles: Vec<f64> = measurements.iter().map(angle).collect();
    angles.sort_unstable_by(f64::total_cmp);
    angles.truncate(inliers);
    let squares: f64 = angles.iter().map(|a| a * a).sum();
    (squares / angles.len().max(1) as f64).sqrt()
}

/// The spin, revolutions per second, up to which orientations at these times (seconds, increasing)
/// with this noise have no slower alias; `None` where that holds up to `max_rps`.
pub fn unique_up_to_rps(times_s: &[f64], sigma_rad: f64, max_rps: f64) -> Option<f64> {
    let work = |n: usize| {
        let duration = times_s[n - 1] - times_s[0];
        2.0 * max_rps * STEPS_PER_CYCLE * duration * n as f64
    };
    let n = (2..=times_s.len())
        .take_while(|&n| work(n) <= MAX_WORK)
        .last()?;
    let times = &times_s[..n];
    let duration = times[n - 1] - times[0];
    let window = |delta: f64| {
        let sum: Complex<f64> = times
            .iter()
            .map(|t| Complex::from_polar(1.0, delta * (t - times[0])))
            .sum();
        sum.norm() / n as f64
    };
    let lost = EVIDENCE * sigma_rad * sigma_rad / n as f64;
    let step = TAU / (STEPS_PER_CYCLE * duration);
    let (mut before, mut here) = (1.0, window(step));
    // Differences of two spins, each at most the maximum.
    let last = (2.0 * max_rps * TAU / step).ceil() as usize;
    for i in 1..=last {
        let after = window((i + 1) as f64 * step);
        // The main lobe falls from 1: only a peak after it counts.
        if here >= before && here > after && here > 0.5 {
            let (mut low, mut high) = ((i - 1) as f64 * step, (i + 1) as f64 * step);
            for _ in 0..HALVINGS {
                let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
                if window(a) < window(b) {
                    low = a
                } else {
                    high = b
                }
            }
            let peak = 0.5 * (low + high);
            if 1.0 - window(peak) <= lost {
                // The search for the peak ends at rounding.
                return Some(0.5 * peak / TAU).filter(|rps| *rps < max_rps * (1.0 + 1e-6));
            }
        }
        (before, here) = (here, after);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_intervals_are_unique_up_to_half_their_rate() {
        let sigma = 2f64.to_radians();
        for (fps, n) in [(60.0, 10), (60.0, 3), (350.0, 30), (29.97, 100)] {
            let times: Vec<f64> = (0..n).map(|k| 5.0 + f64::from(k) / fps).collect();
            let found = unique_up_to_rps(&times, sigma, 350.0).expect("a limit");
            assert!((found - 0.5 * fps).abs() < 1e-4 * fps, "{fps} fps: {found}");
        }
    }

    #[test]
    fn uneven_intervals_raise_the_limit() {
        let sigma = 2f64.to_radians();
        // Even but for one frame that is a third of an interval late.
        let mut times: Vec<f64> = (0..10).map(|k| f64::from(k) / 60.0).collect();
        times[4] += 1.0 / 180.0;
        let found = unique_up_to_rps(&times, sigma, 350.0).expect("a limit");
        assert!((found - 90.0).abs() < 0.1, "{found}");
        // No common divisor within reach.
        let times = [0.0, 0.0101, 0.0239, 0.0317, 0.0473, 0.0611];
        assert_eq!(unique_up_to_rps(&times, sigma, 100.0), None);
    }
}
