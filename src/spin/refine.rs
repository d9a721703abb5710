//! The local part of the robust fit: expectation-maximization with Gauss-Newton steps on SO(3) x
//! R^3.
//!
//! Model: `R_k = exp([e_k]x) exp([w]x t_k) R_0`, `t_k` counted from the reference time, with
//! `e_k ~ N(0, sigma^2 s_k^2 I)` with probability `p_k`, else uniform on SO(3). For a change of the
//! parameters `R_0 -> exp([a]x) R_0`, `w -> w + d` the error changes by
//!
//! ```text
//! Exp(w t) a + t J(w t) d,    J the left Jacobian of SO(3)
//! ```
//!
//! (J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in robotics", arXiv
//! 1812.01537, eq. 143-145). Along the spin's axis this is `a + t d`. Across it, with vectors as
//! complex numbers in a right-handed frame and `theta = |w| t`, it is
//!
//! ```text
//! exp(i theta) a + g d,    g = t (exp(i theta) - 1) / (i theta) = t (sin theta + i (1 - cos theta)) / theta
//! ```
//!
//! so that the 6 x 6 normal equations separate into a real and a complex 2 x 2 system. The weights
//! are the posterior probabilities that the frames are inliers. While the parameters are still poor
//! the variance of the prediction is added to the noise, and frames whose prediction is too
//! uncertain wait: the fit grows from the two frames it started with to the whole sequence.

use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix6, Quaternion, SMatrix, UnitQuaternion};

use super::search::{CONFIDENCE_LIMIT, ROTATION_VOLUME};
use super::{Measurement, Motion};
use crate::geometry::{Rotation, Vec3, tangent_frame};

/// A prediction less certain than this (radians, per axis) is not linear any more: the frame waits.
pub(super) const PREDICTION_LIMIT: f64 = 0.35;
/// The noise is taken to be at most this many times what was expected: a mixture free to widen its
/// noise accepts any frame as an inlier.
pub(super) const MAX_NOISE: f64 = 5.0;
/// Steps while the fit grows. The reach multiplies by about `PREDICTION_LIMIT / sigma` in each.
const GROWTH_STEPS: usize = 12;
/// Steps under the final mixture; it converges in two or three.
const FINAL_STEPS: usize = 12;
/// A step shorter than this fraction of the noise ends the iteration.
const CONVERGED: f64 = 1e-4;
/// Below this angle (radians) series replace quotients: the next term is below 1e-18.
const SMALL_ANGLE: f64 = 1e-4;

/// Knowledge of the noise: a scaled inverse chi-squared distribution for its variance.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoisePrior {
    /// Noise per axis, radians.
    pub sigma_rad: f64,
    /// Weight of the prior, in degrees of freedom; infinite: the noise is known.
    pub degrees: f64,
}

/// A fit at its maximum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refined {
    pub motion: Motion,
    /// Noise per axis, radians.
    pub sigma_rad: f64,
    /// Log-likelihood, density with respect to the rotation vector.
    pub log_likelihood: f64,
    /// Sum of the probabilities that the frames are inliers.
    pub support: f64,
    /// Degrees of freedom of `sigma_rad`.
    pub degrees: f64,
}

/// Parameters' covariance in units of the noise, along the axis: (orientation, both, rate).
#[derive(Debug, Clone, Copy)]
struct Along {
    a: f64,
    ad: f64,
    d: f64,
}

impl Along {
    fn variance(&self, t: f64) -> f64 {
        self.a + t * (2.0 * self.ad + t * self.d)
    }
}

/// The sums of one Gauss-Newton step.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    w: f64,
    wt: f64,
    wtt: f64,
    we: f64,
    wte: f64,
    c01: Complex<f64>,
    c11: f64,
    r0: Complex<f64>,
    r1: Complex<f64>,
    /// Posterior probabilities and weighted squares, for the noise.
    support: f64,
    squares: f64,
    log_likelihood: f64,
}

/// A frame's residual under the current parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual {
    /// Rotation vector from the prediction to the measurement, camera frame.
    pub error: Vec3,
    /// Time since the reference.
    pub t: f64,
    /// cos and sin of the angle turned.
    pub turn: Complex<f64>,
    /// Angle turned.
    theta: f64,
    /// Sine of half of it.
    half_sine: f64,
}

impl Residual {
    pub(super) fn new(motion: &Motion, axis: &Vec3, rate: f64, m: &Measurement) -> Self {
        let t = m.time_s - motion.time_s;
        Self::after(t, &motion.orientation, axis, rate, &m.orientation)
    }

    /// The residual of `measured` for a ball that has turned at `rate` for `t` since `start`.
    pub(super) fn after(
        t: f64,
        start: &Rotation,
        axis: &Vec3,
        rate: f64,
        measured: &Rotation,
    ) -> Self {
        let theta = rate * t;
        let (s, c) = (0.5 * theta).sin_cos();
        let predicted = Quaternion::from_parts(c, axis * s) * start.into_inner();
        let delta = measured.into_inner() * predicted.conjugate();
        Self {
            error: rotation_vector(&delta),
            t,
            turn: Complex::new(c * c - s * s, 2.0 * s * c),
            theta,
            half_sine: s,
        }
    }

    /// `g` of the module's head.
    pub(super) fn lever(&self) -> Complex<f64> {
        if self.theta.abs() < SMALL_ANGLE {
            let x = self.theta;
            return Complex::new(1.0 - x * x / 6.0, 0.5 * x) * self.t;
        }
        // 1 - cos theta = 2 sin^2(theta / 2) without cancellation.
        Complex::new(self.turn.im, 2.0 * self.half_sine * self.half_sine) * (self.t / self.theta)
    }
}

/// The rotation vector of a unit quaternion, the shorter of the two.
pub(super) fn rotation_vector(q: &Quaternion<f64>) -> Vec3 {
    let v = q.imag();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let n2 = v.norm_squared();
    // 2 asin(n) / n by its series where that is exact to 1e-10 (n < 0.03), else without shortcuts.
    if n2 < 1e-3 {
        return v * (sign * (2.0 + n2 * (1.0 / 3.0 + n2 * (3.0 / 20.0 + n2 * (5.0 / 56.0)))));
    }
    let n = n2.sqrt();
    v * (sign * 2.0 * n.atan2(q.w.abs()) / n)
}

/// Axis and rate of a spin; x where it vanishes.
pub(super) fn axis_and_rate(spin: &Vec3) -> (Vec3, f64) {
    let rate = spin.norm();
    if rate < 1e-9 {
        (Vec3::x(), 0.0)
    } else {
        (spin / rate, rate)
    }
}

/// Fits from the hypothesis that the frames `pair` are inliers and the spin is near `spin`.
///
/// `probabilities` receives, for each frame, the probability that it is an inlier. `None` where the
/// equations do not determine the parameters.
pub(super) fn refine(
    measurements: &[Measurement],
    pair: (usize, usize),
    spin: Vec3,
    prior: &NoisePrior,
    probabilities: &mut Vec<f64>,
) -> Option<Refined> {
    let first = &measurements[pair.0];
    let interval = measurements[pair.1].time_s - first.time_s;
    let motion = Motion {
        time_s: first.time_s,
        orientation: first.orientation,
        spin,
    };
    // Two frames of unit variance: the inverse of [[2, T], [T, T^2]].
    let covariance = Along {
        a: 1.0,
        ad: -1.0 / interval,
        d: 2.0 / (interval * interval),
    };
    let motion = grow(measurements, motion, covariance, prior, probabilities)?;
    settle(measurements, motion, prior, probabilities)
}

/// Expands the set of frames in use until all whose prediction is good are in.
fn grow(
    measurements: &[Measurement],
    mut motion: Motion,
    mut covariance: Along,
    prior: &NoisePrior,
    probabilities: &mut Vec<f64>,
) -> Option<Motion> {
    for _ in 0..GROWTH_STEPS {
        let sums = accumulate(
            measurements,
            &motion,
            prior.sigma_rad,
            Some(&covariance),
            probabilities,
        );
        let (step, next) = step(&mut motion, &sums)?;
        let before = reach(measurements, &motion, &covariance, prior);
        covariance = next;
        let after = reach(measurements, &motion, &covariance, prior);
        // All that can be reached is in, and the fit no longer moves by more than the noise.
        if before == after && step < 0.3 * prior.sigma_rad {
            break;
        }
    }
    Some(motion)
}

/// Frames whose prediction is good enough to be used.
fn reach(m: &[Measurement], motion: &Motion, covariance: &Along, prior: &NoisePrior) -> usize {
    let limit = (PREDICTION_LIMIT / prior.sigma_rad).powi(2);
    let near = |m: &&Measurement| covariance.variance(m.time_s - motion.time_s) < limit;
    m.iter().filter(near).count()
}

/// Maximizes the likelihood of the mixture proper.
pub(super) fn settle(
    measurements: &[Measurement],
    mut motion: Motion,
    prior: &NoisePrior,
    probabilities: &mut Vec<f64>,
) -> Option<Refined> {
    let mut sigma = prior.sigma_rad;
    let mut degrees = prior.degrees;
    for _ in 0..FINAL_STEPS {
        let sums = accumulate(measurements, &motion, sigma, None, probabilities);
        let (step, _) = step(&mut motion, &sums)?;
        let mut change = 0.0;
        if prior.degrees.is_finite() {
            degrees = prior.degrees + (3.0 * sums.support - 6.0).max(0.0);
            let squares = prior.degrees * prior.sigma_rad.powi(2) + sums.squares;
            let next = (squares / degrees).sqrt().min(MAX_NOISE * prior.sigma_rad);
            change = (next - sigma).abs();
            sigma = next;
        }
        if step < CONVERGED * sigma && change < CONVERGED * sigma {
            break;
        }
    }
    let sums = accumulate(measurements, &motion, sigma, None, probabilities);
    Some(Refined {
        motion,
        sigma_rad: sigma,
        log_likelihood: sums.log_likelihood,
        support: sums.support,
        degrees,
    })
}

/// Residuals, weights and the sums of the normal equations, in one pass.
fn accumulate(
    measurements: &[Measurement],
    motion: &Motion,
    sigma: f64,
    covariance: Option<&Along>,
    probabilities: &mut Vec<f64>,
) -> Sums {
    let (axis, rate) = axis_and_rate(&motion.spin);
    let [e1, e2] = tangent_frame(&axis);
    let mut sums = Sums::default();
    probabilities.clear();
    for m in measurements {
        let extra = covariance.map_or(0.0, |c| c.variance(m.time_s - motion.time_s));
        if extra * sigma * sigma > PREDICTION_LIMIT * PREDICTION_LIMIT {
            probabilities.push(0.0);
            continue;
        }
        let r = Residual::new(motion, &axis, rate, m);
        let scale = m.sigma_scale * m.sigma_scale;
        let variance = sigma * sigma * (scale + extra);
        let e2_norm = r.error.norm_squared();
        let (right, log_likelihood) = posterior(m.confidence, e2_norm, variance);
        probabilities.push(right);
        sums.support += right;
        sums.log_likelihood += log_likelihood;
        let w = right / scale;
        sums.squares += w * e2_norm;
        let along = axis.dot(&r.error);
        let across = Complex::new(e1.dot(&r.error), e2.dot(&r.error));
        let lever = r.lever();
        sums.w += w;
        sums.wt += w * r.t;
        sums.wtt += w * r.t * r.t;
        sums.we += w * along;
        sums.wte += w * r.t * along;
        sums.c01 += r.turn.conj() * lever * w;
        sums.c11 += lever.norm_sqr() * w;
        sums.r0 += r.turn.conj() * across * w;
        sums.r1 += lever.conj() * across * w;
    }
    sums
}

/// Probability that a frame with squared error `e2` is an inlier, and the log of the mixture's
/// density.
pub(super) fn posterior(confidence: f64, e2: f64, variance: f64) -> (f64, f64) {
    let p = confidence.clamp(CONFIDENCE_LIMIT, 1.0 - CONFIDENCE_LIMIT);
    let x = TAU * variance;
    let good = p / (x * x.sqrt()) * (-0.5 * e2 / variance).exp();
    let stray = (1.0 - p) / ROTATION_VOLUME;
    let total = good + stray;
    (good / total, total.ln())
}

/// Applies a Gauss-Newton step; returns its size (radians, over the frames in use) and the
/// covariance along the axis.
fn step(motion: &mut Motion, s: &Sums) -> Option<(f64, Along)> {
    let (axis, _) = axis_and_rate(&motion.spin);
    let [e1, e2] = tangent_frame(&axis);
    let det = s.w * s.wtt - s.wt * s.wt;
    let det_across = s.w * s.c11 - s.c01.norm_sqr();
    // Both are products of weights with a squared time: compare to what fractions of a frame give.
    let small = 1e-12 * s.w * s.wtt;
    let solvable = det > small && det_across > small;
    if !solvable {
        return None;
    }
    let a = (s.wtt * s.we - s.wt * s.wte) / det;
    let d = (s.w * s.wte - s.wt * s.we) / det;
    let a_across = (s.r0 * s.c11 - s.c01 * s.r1) / det_across;
    let d_across = (s.r1 * s.w - s.c01.conj() * s.r0) / det_across;
    let vector = |along: f64, across: Complex<f64>| axis * along + e1 * across.re + e2 * across.im;
    let (turn, change) = (vector(a, a_across), vector(d, d_across));
    let orientation = Rotation::from_scaled_axis(turn) * motion.orientation;
    motion.orientation = UnitQuaternion::new_normalize(orientation.into_inner());
    motion.spin += change;
    let spread = (s.wtt / s.w).sqrt();
    let covariance = Along {
        a: s.wtt / det,
        ad: -s.wt / det,
        d: s.w / det,
    };
    Some((turn.norm() + change.norm() * spread, covariance))
}

/// Moves the reference time; the motion stays the same.
pub(super) fn rebase(motion: &Motion, time_s: f64) -> Motion {
    Motion {
        time_s,
        orientation: motion.at(time_s),
        spin: motion.spin,
    }
}

/// Curvature of the mixture's negative log-likelihood: the observed information of
/// (orientation, spin), 6 x 6, camera frame.
///
/// The part from uncertain membership is subtracted (T. A. Louis, "Finding the observed information
/// matrix when using the EM algorithm", J. R. Stat. Soc. B 44, 1982, eq. 3.1).
pub(super) fn observed_information(
    measurements: &[Measurement],
    motion: &Motion,
    sigma: f64,
    probabilities: &[f64],
    subtract_missing: bool,
) -> Matrix6<f64> {
    let (axis, rate) = axis_and_rate(&motion.spin);
    let mut information = Matrix6::zeros();
    for (m, &p) in measurements.iter().zip(probabilities) {
        if p < 1e-9 {
            continue;
        }
        let r = Residual::new(motion, &axis, rate, m);
        let jacobian = jacobian(&axis, &r);
        let inverse = 1.0 / (sigma * m.sigma_scale).powi(2);
        information += jacobian.transpose() * jacobian * (p * inverse);
        if subtract_missing {
            let score = jacobian.transpose() * r.error * inverse;
            information -= score * score.transpose() * (p * (1.0 - p));
        }
    }
    information
}

/// Derivative of the predicted rotation with respect to (orientation, spin).
pub(super) fn jacobian(axis: &Vec3, r: &Residual) -> SMatrix<f64, 3, 6> {
    let along = axis * axis.transpose();
    let across = nalgebra::Matrix3::identity() - along;
    let cross = axis.cross_matrix();
    let g = r.lever();
    let mut j = SMatrix::<f64, 3, 6>::zeros();
    j.fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&(along + across * r.turn.re + cross * r.turn.im));
    j.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(along * r.t + across * g.re + cross * g.im));
    j
}

/// For each frame, the probability that it is an inlier under `motion`.
pub(super) fn probabilities(
    measurements: &[Measurement],
    motion: &Motion,
    prior: &NoisePrior,
    into: &mut Vec<f64>,
) {
    accumulate(measurements, motion, prior.sigma_rad, None, into);
}
