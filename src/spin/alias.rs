//! Aliases: other spins that the sampling cannot distinguish from the estimated one.
//!
//! Turning about the same axis faster by `delta` (rad/s) changes the orientation at time `t_k` by
//! the angle `delta (t_k - t)`. The orientations are the same where these are full turns at all
//! frames, that is where the spectral window of the sampling,
//!
//! ```text
//! W(delta) = | sum_k p_k exp(i delta t_k) | / sum_k p_k
//! ```
//!
//! reaches 1 (J. D. Scargle, "Studies in astronomical time series analysis II", Astrophys. J. 263,
//! 1982, appendix D; `p_k` is the probability that frame k is an inlier). For even times `T` apart
//! the peaks lie at `2 pi k / T`: with them go the faster spins of the same sense and, beyond half
//! a turn, those about the reversed axis. Uneven times lower the peaks. Each peak is refined and
//! its likelihood compared with that of the estimate.
//!
//! What else is known of a spin, such as how far its dots are smeared or what a rolling shutter does to them, decides where the orientations are tied:
//! [`SpinEvidence`].
//!
//! Not covered: where the ball turns by less than the noise between all frames (or by whole turns),
//! its axis is not determined, and full turns about any axis would explain the same orientations.
//! The alternatives listed are then examples.

use nalgebra::Complex;

use super::mixture::{Mixture, Noise, RatePrior};
use super::motion::{ConstantSpin, axis_and_rate};
use super::{Fit, MIN_FRAMES, Measurement};
use crate::geometry::{Rotation, Vec3};

/// Steps of the scan over `delta` per reciprocal of the sequence's duration: fine enough that no
/// orientation is off by more than 0.2 rad at the node next to a peak.
const NODES_PER_CYCLE: f64 = 8.0;
/// Minimum spectral window at a node that is worth a refinement. At a true tie's nearest node it is
/// 0.98.
const MIN_WINDOW: f64 = 0.7;

/// Frames times nodes of the scan, about; beyond it only the leading frames are used.
const MAX_WORK: f64 = 2e7;

/// Settings of [`alternatives`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AliasConfig {
    /// Largest spin listed, revolutions per second.
    pub max_rps: f64,
    /// Minimum log-likelihood ratio to the estimate that is listed (natural log).
    pub min_log_ratio: f64,
    /// Noise of an orientation per axis, radians, where the estimate has none of its own.
    pub sigma_rad: f64,
}

impl Default for AliasConfig {
    /// Up to 350 revolutions per second (twice the default of the estimators: one turn a frame at
    /// 350 frames per second), odds down to one in a thousand, 2 deg.
    fn default() -> Self {
        Self {
            max_rps: 350.0,
            min_log_ratio: -1000f64.ln(),
            sigma_rad: 2f64.to_radians(),
        }
    }
}

/// Another spin that explains the orientations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alternative {
    /// Spin, camera frame, rad/s.
    pub spin: Vec3,
    /// Natural logarithm of its likelihood over that of the estimate: 0 is a tie, positive means
    /// that the data alone prefer it.
    pub log_likelihood_ratio: f64,
}

/// The spins about the same axis that explain `measurements` nearly as well as `fit`, likeliest
/// first, of equals the slower first.
///
/// Of very long sequences only the first frames are used (thousands at even times). Spins that
/// these distinguish are no aliases, and the rest would need a spin more constant than any ball's.
/// Where even three frames are so far apart that their aliases are beyond counting, none are
/// listed.
pub fn alternatives(
    measurements: &[Measurement],
    fit: &Fit,
    options: &AliasConfig,
) -> Vec<Alternative> {
    let Some(measurements) = affordable(measurements, options.max_rps) else {
        return Vec::new();
    };
    let mixture = Mixture {
        measurements,
        noise: Noise::known(fit.sigma_rad.unwrap_or(options.sigma_rad)),
        prior: RatePrior::none(),
    };
    // From the maximum itself each alias is a maximum too, but for the peak's place on the grid.
    let Ok(own) = mixture.settle(fit.motion) else {
        return Vec::new();
    };
    let right = mixture.probabilities(&own);
    let (_, rate) = axis_and_rate(&own.motion.spin);
    let window = Window::new(measurements, &right);
    let limit = options.max_rps * std::f64::consts::TAU;
    // Spins nearer than half a cycle over the whole sequence are one peak.
    let apart = std::f64::consts::PI / window.duration;
    let mut found: Vec<Alternative> = Vec::new();
    for delta in window.peaks(-limit - rate, limit - rate) {
        let start = aliased(&own.motion, &window, delta);
        let Ok(refined) = mixture.settle(start) else {
            continue;
        };
        let spin = refined.motion.spin;
        let log_likelihood_ratio = refined.log_likelihood - own.log_likelihood;
        let known = (spin - own.motion.spin).norm() < apart
            || found.iter().any(|a| (spin - a.spin).norm() < apart);
        if !known && spin.norm() <= limit && log_likelihood_ratio >= options.min_log_ratio {
            found.push(Alternative {
                spin,
                log_likelihood_ratio,
            });
        }
    }
    sort(&mut found);
    found
}

/// What else than the orientations says of a spin.
pub trait SpinEvidence {
    /// Natural logarithm of the likelihood of a spin (frame of the orientations, rad/s), up to a constant.
    fn ln_likelihood(&self, spin: &Vec3) -> f64;
}

/// Pieces of evidence that are independent of each other.
pub struct Together<'a>(pub Vec<&'a dyn SpinEvidence>);

impl SpinEvidence for Together<'_> {
    fn ln_likelihood(&self, spin: &Vec3) -> f64 {
        self.0.iter().map(|one| one.ln_likelihood(spin)).sum()
    }
}

/// Weighs the alternatives to `spin` by further evidence, too; the likeliest first, those with a ratio under the minimum are
/// left out.
pub fn weigh(
    alternatives: &mut Vec<Alternative>,
    spin: &Vec3,
    evidence: &dyn SpinEvidence,
    min_log_ratio: f64,
) {
    let own = evidence.ln_likelihood(spin);
    for alternative in alternatives.iter_mut() {
        alternative.log_likelihood_ratio += evidence.ln_likelihood(&alternative.spin) - own;
    }
    alternatives.retain(|a| a.log_likelihood_ratio >= min_log_ratio);
    sort(alternatives);
}

/// The likeliest first, of equals the slower.
fn sort(alternatives: &mut [Alternative]) {
    // Ties differ by rounding: compare to a thousandth.
    let likelihood = |a: &Alternative| (1e3 * a.log_likelihood_ratio).round() as i64;
    alternatives.sort_by(|a, b| {
        let slower = a.spin.norm().total_cmp(&b.spin.norm());
        likelihood(b).cmp(&likelihood(a)).then(slower)
    });
}

/// The motion with the spin of an alias of `fit`, before it is refined.
pub(super) fn alias_near(measurements: &[Measurement], fit: &Fit, spin: &Vec3) -> ConstantSpin {
    let (axis, rate) = axis_and_rate(&fit.motion.spin);
    let window = Window::new(measurements, &vec![1.0; measurements.len()]);
    aliased(&fit.motion, &window, axis.dot(spin) - rate)
}

/// The motion about the same axis, faster by `delta`, rad/s, that is nearest to it at the frames.
fn aliased(own: &ConstantSpin, window: &Window, delta: f64) -> ConstantSpin {
    let (axis, rate) = axis_and_rate(&own.spin);
    let middle = own.rebased(window.center);
    let phase = window.at(delta).arg();
    ConstantSpin {
        orientation: Rotation::from_scaled_axis(axis * -phase) * middle.orientation,
        spin: axis * (rate + delta),
        ..middle
    }
}

/// The leading frames for which a scan to `max_rps` costs no more than [`MAX_WORK`]; none for fewer
/// than three.
fn affordable(measurements: &[Measurement], max_rps: f64) -> Option<&[Measurement]> {
    let work = |n: usize| {
        let duration = measurements[n - 1].time_s - measurements[0].time_s;
        2.0 * max_rps * NODES_PER_CYCLE * duration * n as f64
    };
    let n = (MIN_FRAMES..=measurements.len())
        .take_while(|n| work(*n) <= MAX_WORK)
        .last()?;
    Some(&measurements[..n])
}

/// The sampling's spectral window about its weighted mean time.
struct Window {
    /// Times from the center (s) and weights that sum to 1.
    nodes: Vec<(f64, f64)>,
    center: f64,
    duration: f64,
}

impl Window {
    fn new(measurements: &[Measurement], right: &[f64]) -> Self {
        let total: f64 = right.iter().sum();
        let weighted = || measurements.iter().zip(right);
        let center = weighted().map(|(m, p)| m.time_s * p).sum::<f64>() / total;
        let used = || weighted().filter(|(_, p)| **p > 0.5).map(|(m, _)| m.time_s);
        let first = used().fold(f64::INFINITY, f64::min);
        let last = used().fold(f64::NEG_INFINITY, f64::max);
        Self {
            nodes: weighted()
                .map(|(m, p)| (m.time_s - center, p / total))
                .collect(),
            center,
            duration: last - first,
        }
    }

    fn at(&self, delta: f64) -> Complex<f64> {
        self.nodes
            .iter()
            .map(|(t, p)| Complex::from_polar(*p, delta * t))
            .sum()
    }

    /// Nodes of a scan from `low` to `high` (rad/s) where the window is high and higher than
    /// beside.
    fn peaks(&self, low: f64, high: f64) -> Vec<f64> {
        let step = std::f64::consts::TAU / (NODES_PER_CYCLE * self.duration);
        // No duration (fewer than two inliers): nothing can be compared.
        if !(step.is_finite() && step > 0.0) {
            return Vec::new();
        }
        let (first, last) = ((low / step).floor() as i64, (high / step).ceil() as i64);
        let height = |i: i64| self.at(i as f64 * step).norm();
        let (mut before, mut here) = (height(first - 1), height(first));
        let mut peaks = Vec::new();
        for i in first..=last {
            let after = height(i + 1);
            if here >= MIN_WINDOW && here >= before && here > after {
                peaks.push(i as f64 * step);
            }
            (before, here) = (here, after);
        }
        peaks
    }
}
