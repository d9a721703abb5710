//! The global part of the robust fit: it enumerates and scores candidate spins.
//!
//! Two inliers `a` then `b`, a time `T` apart, allow a discrete set of spins: with `R_b R_a^T =
//! exp(phi [n]x)`, `phi` in [0, pi], they are `n (phi + 2 pi k) / T` for every whole `k`. Each that
//! is within the permitted magnitude is a hypothesis, and is scored on the frames that did not
//! define it. At time `t` it predicts an orientation whose variance per axis, to first order, is
//! `sigma^2 ((1-u)^2 + u^2)` with `u = (t - t_a) / T`; the scored frame adds its own `sigma^2`. The
//! score is the log-likelihood ratio of inlier to outlier, truncated at 0:
//!
//! ```text
//! sum_k max(0, ln( p N(e_k; 0, v_k I) / ((1-p) / 8 pi^2) )),   v_k = sigma^2 (1 + (1-u)^2 + u^2)
//! ```
//!
//! to which comes the logarithm of how much likelier the spin is beforehand than the fastest (all decades equally likely): of
//! many aliases those kept are the slowest, whose axes a pair knows best.
//!
//! (the volume of SO(3) in rotation vectors near the identity is 8 pi^2). Unlike a count of inliers
//! it discounts the easy agreement of an imprecise hypothesis.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Quaternion, Vector4};

use super::Measurement;
use super::mixture::{MAX_GAINFUL_VARIANCE, RateSpread, peak_gain};
use super::motion::ConstantSpin;
use crate::geometry::Vec3;

/// Hypotheses kept for refinement. Aliases of the best one compete for places, so that there must
/// be several; beyond this many a tie is not useful.
pub(super) const KEPT: usize = 8;

/// Frames that score a pair's hypotheses; of more within its reach every second, third and so on does.
const MAX_JUDGES: usize = 256;

/// A hypothesis whose score trails the best by more than this (natural log units) is not refined:
/// the score is a log-likelihood but for linearization, which costs a few units at most.
pub(super) const SCORE_MARGIN: f64 = 20.0;

/// A spin that two frames allow, with its score on the others.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpinHypothesis {
    /// Index of the earlier and the later frame.
    pub pair: (usize, usize),
    /// Spin, camera frame, rad/s.
    pub spin: Vec3,
    /// Log-likelihood ratio, summed over the other frames, with the prior.
    pub score: f64,
    /// Share of the frames within reach that agree, each by what its agreement is worth.
    pub share: f64,
    /// Whether a fit has started from it.
    pub is_tried: bool,
}

impl SpinHypothesis {
    /// The motion from the pair's earlier frame, and how far its predictions are off: as along the axis, where
    /// two frames of unit variance leave `(1-u)^2 + u^2`.
    pub(super) fn start(
        &self,
        measurements: &[Measurement],
        sigma_rad: f64,
    ) -> (ConstantSpin, RateSpread<3>) {
        let (first, second) = (&measurements[self.pair.0], &measurements[self.pair.1]);
        let interval = second.time_s - first.time_s;
        let variance = sigma_rad * sigma_rad;
        let motion = ConstantSpin {
            time_s: first.time_s,
            orientation: first.orientation,
            spin: self.spin,
        };
        let spread = RateSpread {
            level: 0.5 * variance,
            center: Matrix3::from_diagonal_element(0.5 * interval),
            rates: Matrix3::from_diagonal_element(2.0 * variance / (interval * interval)),
        };
        (motion, spread)
    }
}

/// The best few hypotheses, best first, no two of them the same spin.
#[derive(Debug, Clone)]
pub(super) struct Shortlist {
    items: [Option<SpinHypothesis>; KEPT],
}

impl Shortlist {
    pub(super) fn new() -> Self {
        Self {
            items: [None; KEPT],
        }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &SpinHypothesis> {
        self.items.iter().flatten()
    }

    /// Share of the frames within reach that agree with the best hypothesis.
    pub(super) fn best_share(&self) -> f64 {
        self.items[0].map_or(0.0, |h| h.share)
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut SpinHypothesis> {
        self.items.iter_mut().flatten()
    }

    pub(super) fn clear(&mut self) {
        self.items = [None; KEPT];
    }

    fn min_score(&self) -> f64 {
        self.items[KEPT - 1].map_or(0.0, |h| h.score)
    }

    /// A score that is not worth having.
    fn hopeless_score(&self) -> f64 {
        let best = self.items[0].map_or(0.0, |h| h.score);
        self.min_score().max(best - SCORE_MARGIN)
    }

    /// Takes `h` in, unless a better one is within `radius` (rad/s); worse ones within it go.
    fn offer(&mut self, h: SpinHypothesis, radius: f64) {
        if h.score <= self.min_score() {
            return;
        }
        let near = |other: &SpinHypothesis| (other.spin - h.spin).norm_squared() < radius * radius;
        let mut slot = KEPT - 1;
        for (i, item) in self.items.iter().enumerate() {
            match item {
                Some(other) if near(other) && other.score >= h.score => return,
                Some(other) if near(other) => {
                    slot = i;
                    break;
                }
                None => {
                    slot = i;
                    break;
                }
                _ => {}
            }
        }
        self.items[slot] = Some(h);
        while slot > 0 {
            let better = match (&self.items[slot - 1], &self.items[slot]) {
                (Some(a), Some(b)) => b.score > a.score,
                (None, _) => true,
                _ => false,
            };
            if !better {
                break;
            }
            self.items.swap(slot - 1, slot);
            slot -= 1;
        }
    }
}

/// What the search needs beside the measurements.
#[derive(Debug, Clone, Copy)]
pub(super) struct SearchConfig {
    /// Orientation noise per axis, radians.
    pub sigma_rad: f64,
    /// Largest spin, rad/s.
    pub max_spin: f64,
    /// Slower spins are as likely as this one, rad/s.
    pub slowest: f64,
    /// Whether all decades are equally likely, or the magnitude has another prior.
    pub is_slower_likelier: bool,
}

impl SearchConfig {
    /// Logarithm of how much likelier a spin is beforehand than the fastest.
    fn prior_gain(&self, rate: f64) -> f64 {
        match self.is_slower_likelier {
            true => (self.max_spin / rate.abs().max(self.slowest)).ln().max(0.0),
            false => 0.0,
        }
    }
}

/// One frame as a hypothesis' pair sees it: `cos(x/2) a + sin(x/2) b` is the cosine of half the
/// angle between the frame and a prediction that has turned by x since the pair's first frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct SeenTurn {
    half_time: f64,
    a: f64,
    b: f64,
    peak: f64,
    inverse_variance: f64,
}

/// Scores every spin that the frames `pair` allow, and offers each to the shortlist.
pub(super) fn judge_pair(
    measurements: &[Measurement],
    pair: (usize, usize),
    settings: &SearchConfig,
    seen: &mut Vec<SeenTurn>,
    shortlist: &mut Shortlist,
) {
    let (first, second) = (&measurements[pair.0], &measurements[pair.1]);
    let interval = second.time_s - first.time_s;
    let relative = second.orientation.into_inner() * first.orientation.into_inner().conjugate();
    let (axis, phi) = axis_angle(&relative);
    score_hypothesis(measurements, pair, &axis, settings, seen);

    let radius = pair_radius(settings.sigma_rad, interval);
    let max_gain: f64 = seen.iter().map(|s| s.peak).sum();
    // The same error may push a permitted spin over the limit; refinement decides.
    let limit = settings.max_spin * interval + pair_radius(settings.sigma_rad, 1.0);
    let (fewest, most) = ((limit + phi) / TAU, (limit - phi) / TAU);
    for k in -(fewest.floor() as i64)..=(most.floor() as i64) {
        let rate = (phi + TAU * k as f64) / interval;
        let hopeless = shortlist.hopeless_score();
        let slower = settings.prior_gain(rate);
        let (mut score, mut agreed, mut left) = (slower, 0.0, max_gain);
        for s in seen.iter() {
            if score + left < hopeless {
                break;
            }
            left -= s.peak;
            let (sin, cos) = (rate * s.half_time).sin_cos();
            let c = cos * s.a + sin * s.b;
            // 4 sin^2 of half the angle: the angle squared, up to 9 % at one radian.
            let gain = s.peak - 2.0 * (1.0 - c * c) * s.inverse_variance;
            if gain > 0.0 {
                score += gain;
                agreed += s.peak;
            }
        }
        if agreed == 0.0 {
            continue;
        }
        let hypothesis = SpinHypothesis {
            pair,
            spin: axis * rate,
            score,
            share: agreed / max_gain,
            is_tried: false,
        };
        shortlist.offer(hypothesis, radius);
    }
}

/// Spins that a pair of frames this far apart (s) allows are the same within this radius (rad/s):
/// they err by about `sqrt(2) sigma / interval` per axis.
pub(super) fn pair_radius(sigma_rad: f64, interval: f64) -> f64 {
    3.0 * std::f64::consts::SQRT_2 * sigma_rad / interval
}

/// The frames whose prediction from a pair may be good enough to gain from an agreement: the cost of a
/// hypothesis does not grow with the sequence.
fn within_reach(
    measurements: &[Measurement],
    pair: (usize, usize),
    sigma_rad: f64,
) -> std::ops::Range<usize> {
    let (first, second) = (&measurements[pair.0], &measurements[pair.1]);
    let interval = second.time_s - first.time_s;
    // (1-u)^2 + u^2 = 1/2 + 2 (u - 1/2)^2 times the pair's smaller variance is a part of the whole.
    let scale = sigma_rad * first.sigma_scale.min(second.sigma_scale);
    let reach = (0.5 * MAX_GAINFUL_VARIANCE).sqrt() / scale * interval;
    let middle = 0.5 * (first.time_s + second.time_s);
    let before = |time_s: f64| measurements.partition_point(|m| m.time_s < time_s);
    before(middle - reach)..before(middle + reach)
}

/// Fills `seen` with the frames outside the pair.
fn score_hypothesis(
    measurements: &[Measurement],
    pair: (usize, usize),
    axis: &Vec3,
    settings: &SearchConfig,
    seen: &mut Vec<SeenTurn>,
) {
    let first = &measurements[pair.0];
    let interval = measurements[pair.1].time_s - first.time_s;
    let q0 = first.orientation.into_inner();
    let quarter = Quaternion::from_parts(0.0, *axis) * q0;
    let (start, turned): (Vector4<f64>, Vector4<f64>) = (q0.coords, quarter.coords);
    let (scale0, scale1) = (first.sigma_scale, measurements[pair.1].sigma_scale);
    let variance = settings.sigma_rad * settings.sigma_rad;
    seen.clear();
    let reach = within_reach(measurements, pair, settings.sigma_rad);
    let stride = reach.len().div_ceil(MAX_JUDGES).max(1);
    for k in reach.step_by(stride) {
        if k == pair.0 || k == pair.1 {
            continue;
        }
        let m = &measurements[k];
        let elapsed = m.time_s - first.time_s;
        let u = elapsed / interval;
        let (w0, w1) = (scale0 * (1.0 - u), scale1 * u);
        let v = variance * (m.sigma_scale * m.sigma_scale + w0 * w0 + w1 * w1);
        let peak = peak_gain(m.confidence, v);
        if peak > 0.0 {
            seen.push(SeenTurn {
                half_time: 0.5 * elapsed,
                a: start.dot(&m.orientation.coords),
                b: turned.dot(&m.orientation.coords),
                peak,
                inverse_variance: 1.0 / v,
            });
        }
    }
}

/// Axis (a unit vector; x where the angle vanishes) and angle in [0, pi] of a unit quaternion.
fn axis_angle(q: &Quaternion<f64>) -> (Vec3, f64) {
    let v = q.imag();
    let norm = v.norm();
    if norm < 1e-12 {
        return (Vec3::x(), 0.0);
    }
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    (v * (sign / norm), 2.0 * norm.atan2(q.w.abs()))
}
