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

use super::config::SpinConfig;
use super::mixture::{Mixture, NoiseVariance, RatePrior};
use super::motion::{ConstantSpin, axis_and_rate};
use super::robust::ALIASES;
use super::{Fit, MIN_FRAMES, Measurement};
use crate::geometry::{Rotation, Vec3};

/// Steps of the scan over `delta` per reciprocal of the sequence's duration: fine enough that no
/// orientation is off by more than 0.2 rad at the node next to a peak.
const NODES_PER_CYCLE: f64 = 8.0;
/// Minimum spectral window at a node that is worth a refinement. At a true tie's nearest node it is
/// 0.98.
const MIN_WINDOW: f64 = 0.7;

/// Frames times nodes of the scan, about, of the leading frames; each of their peaks is then followed over the others.
const LEADING_WORK: f64 = 2e3;
/// As much for the fewest frames leaves more aliases than are worth a list.
const MAX_WORK: f64 = 2e7;
/// As many times as long is the part of the sequence that a peak is followed over next.
const WIDENING: f64 = 4.0;
/// A gap that makes it longer than this many times leaves more aliases than are worth a list: the frames before it are used.
const MAX_GAP: f64 = 64.0;

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

impl AliasConfig {
    /// As far as a spin by these settings is looked for, and with its noise.
    pub fn of(config: &SpinConfig) -> Self {
        Self {
            max_rps: config.max_rps,
            sigma_rad: config.sigma_rad,
            ..Self::default()
        }
    }
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
/// Where even three frames are so far apart that their aliases are beyond counting, none are
/// listed.
pub fn alternatives(
    measurements: &[Measurement],
    fit: &Fit,
    options: &AliasConfig,
) -> Vec<Alternative> {
    let mixture = Mixture {
        measurements,
        noise: NoiseVariance::known(fit.sigma_rad.unwrap_or(options.sigma_rad)),
        prior: RatePrior::none(),
    };
    // From the maximum itself each alias is a maximum too, but for the peak's place on the grid.
    let Ok(own) = mixture.settle(fit.motion) else {
        return Vec::new();
    };
    let right = mixture.probabilities(&own);
    let (_, rate) = axis_and_rate(&own.motion.spin);
    let mut window = SpectralWindow::new();
    window.load(measurements, |k| right[k] > 0.5);
    let limit = options.max_rps * std::f64::consts::TAU;
    // Spins nearer than that are one peak.
    let apart = window.half_cycle();
    let mut found: Vec<Alternative> = Vec::new();
    window.scan(-limit - rate, limit - rate);
    for &delta in &window.peaks {
        let start = window.aliased(&own.motion, delta);
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
    let mut window = SpectralWindow::new();
    window.load(measurements, |_| true);
    window.aliased(&fit.motion, axis.dot(spin) - rate)
}

/// The sampling's spectral window, and where it is high.
#[derive(Debug, Clone)]
pub(super) struct SpectralWindow {
    /// Times of the frames used, seconds, from their mean.
    times: Vec<f64>,
    center: f64,
    /// Where the window is high, rad/s, in order.
    pub peaks: Vec<f64>,
    followed: Vec<f64>,
}

impl SpectralWindow {
    pub fn new() -> Self {
        Self {
            times: Vec::new(),
            center: 0.0,
            peaks: Vec::with_capacity(ALIASES),
            followed: Vec::with_capacity(ALIASES),
        }
    }

    /// Takes the frames that are used.
    pub fn load(&mut self, measurements: &[Measurement], is_used: impl Fn(usize) -> bool) {
        self.times.clear();
        // By the frames, not by those used: a sequence as long then needs no more.
        self.times.reserve(measurements.len());
        let numbered = measurements.iter().enumerate();
        let used = numbered.filter(|(k, _)| is_used(*k)).map(|(_, m)| m.time_s);
        self.times.extend(used);
        self.center = self.times.iter().sum::<f64>() / self.times.len().max(1) as f64;
        for t in &mut self.times {
            *t -= self.center;
        }
    }

    /// The motion about the same axis, faster by `delta`, rad/s, that is nearest to it at the frames.
    pub fn aliased(&self, own: &ConstantSpin, delta: f64) -> ConstantSpin {
        let (axis, rate) = axis_and_rate(&own.spin);
        let middle = own.rebased(self.center);
        let phase = self.at(self.times.len(), delta).arg();
        ConstantSpin {
            orientation: Rotation::from_scaled_axis(axis * -phase) * middle.orientation,
            spin: axis * (rate + delta),
            ..middle
        }
    }

    /// Finds all peaks from `low` to `high` (rad/s): on the leading frames node by node, then about each peak over more and
    /// more of the others, which splits it or leaves it.
    pub fn scan(&mut self, low: f64, high: f64) {
        self.peaks.clear();
        let work = |n: usize| (high - low) / self.step(n) * n as f64;
        if self.times.len() < MIN_FRAMES || work(MIN_FRAMES) > MAX_WORK {
            return;
        }
        let more = MIN_FRAMES..=self.times.len();
        let leading = more.take_while(|n| work(*n) <= LEADING_WORK).last();
        let mut n = leading.unwrap_or(MIN_FRAMES);
        let mut step = self.step(n);
        // No duration: nothing can be compared.
        if !(step.is_finite() && step > 0.0) {
            return;
        }
        self.followed.clear();
        self.add_peaks(n, (low, high), step);
        std::mem::swap(&mut self.peaks, &mut self.followed);
        while n < self.times.len() {
            let reach = WIDENING * self.duration(n);
            let first = self.times[0];
            let longer = self
                .times
                .partition_point(|t| t - first <= reach)
                .max(n + 1);
            if self.duration(longer) > MAX_GAP * self.duration(n) {
                break;
            }
            let finer = self.step(longer);
            self.followed.clear();
            for i in 0..self.peaks.len() {
                let near = (self.peaks[i] - step, self.peaks[i] + step);
                self.add_peaks(longer, near, finer);
            }
            std::mem::swap(&mut self.peaks, &mut self.followed);
            (n, step) = (longer, finer);
        }
    }

    /// Adds the nodes of a scan where the window of the first `n` frames is high and higher than beside to those followed.
    fn add_peaks(&mut self, n: usize, (low, high): (f64, f64), step: f64) {
        let (first, last) = ((low / step).floor() as i64, (high / step).ceil() as i64);
        let Self {
            times, followed, ..
        } = self;
        let height = |i: i64| sampled(&times[..n], i as f64 * step).norm();
        let (mut before, mut here) = (height(first - 1), height(first));
        for i in first..=last {
            let after = height(i + 1);
            let node = i as f64 * step;
            let is_new = followed.last().is_none_or(|last| node > *last);
            if here >= MIN_WINDOW && here >= before && here > after && is_new {
                followed.push(node);
            }
            (before, here) = (here, after);
        }
    }

    fn at(&self, n: usize, delta: f64) -> Complex<f64> {
        sampled(&self.times[..n], delta)
    }

    fn duration(&self, n: usize) -> f64 {
        match n {
            0 => 0.0,
            _ => self.times[n - 1] - self.times[0],
        }
    }

    /// Half a cycle over all frames, rad/s.
    pub fn half_cycle(&self) -> f64 {
        std::f64::consts::PI / self.duration(self.times.len())
    }

    /// Distance of the nodes for the first `n` frames, rad/s.
    fn step(&self, n: usize) -> f64 {
        std::f64::consts::TAU / (NODES_PER_CYCLE * self.duration(n))
    }
}

/// The mean of a phase that grows by `delta`, rad/s.
fn sampled(times_s: &[f64], delta: f64) -> Complex<f64> {
    let terms = times_s.iter().map(|t| Complex::cis(delta * t));
    terms.sum::<Complex<f64>>() / times_s.len() as f64
}
