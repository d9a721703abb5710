//! A spin that decays: `|w|(t) = |w0| exp(-c (t - t0))` about a fixed axis, fitted to a long flight.
//!
//! The ball has then turned as far as one of constant spin w0 would in the time
//!
//! ```text
//! tau(t) = (1 - exp(-c (t - t0))) / c,    R(t) = exp([w0]x tau(t)) R(t0)
//! ```
//!
//! and the orientation's derivative with respect to c is the angle `|w0| dtau/dc` about the axis. The
//! seven parameters are fitted by maximum likelihood under the mixture of [`super::robust`]. Over a long
//! flight a wrong rate loses whole turns, so that the fit starts from the spins of short runs
//! ([`super::windows`]): a robust line through the logarithms of their rates gives w0 and c well enough to
//! go on from the middle run outwards, a frame being used once its prediction is good enough, as in the
//! fit of a constant spin.
//!
//! Guarantees: the interval is that of the likelihood's curvature, with the noise estimated from the
//! residuals. Not guaranteed: a slow drift of the axis (gyroscopic effects on an uneven ball) is taken for
//! noise.

use nalgebra::{SMatrix, SVector};

use super::refine::{
    MAX_NOISE, PREDICTION_LIMIT, Residual, axis_and_rate, jacobian as constant_jacobian, posterior,
};
use super::robust::RobustSpinConfig;
use super::simulate::decayed_time;
use super::windows::{WindowFit, spin_over_time};
use super::{Fit, Measurement, Motion, SpinRejection};
use crate::geometry::{Rotation, Vec3, angle_between};

type Vec7 = SVector<f64, 7>;
type Mat7 = SMatrix<f64, 7, 7>;
type Mat3x7 = SMatrix<f64, 3, 7>;

/// Rate of decay's standard deviation while the fit grows, 1/s, where the runs do not say better.
const PRIOR_DECAY: f64 = 0.5;
/// Steps while the fit grows from its first run to the whole flight.
const GROWTH_STEPS: usize = 40;
/// Steps under the final mixture.
const FINAL_STEPS: usize = 40;
/// A step whose effect is shorter than this fraction of the noise ends the iteration.
const CONVERGED: f64 = 1e-4;
/// Axes of runs further apart than this (radians) do not belong to one motion.
const SAME_AXIS: f64 = 0.3;
/// The two-sided 95 % quantile of the standard normal distribution.
const Z95: f64 = 1.959_963_984_540_054;

/// Settings of [`fit_decay`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecayConfig {
    /// Largest spin, noise and so on.
    pub robust: RobustSpinConfig,
    /// Orientations in a run whose spin is taken as constant.
    pub window: usize,
}

impl Default for DecayConfig {
    /// Runs of ten orientations: at 350 frames per second a spin loses less than 0.3 % in one.
    fn default() -> Self {
        Self {
            robust: RobustSpinConfig::default(),
            window: 10,
        }
    }
}

/// A decaying spin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecayFit {
    /// Orientation and spin at the first measurement's time, with the spin's covariance (the decay
    /// being estimated as well), the noise and the number of inliers.
    pub start: Fit,
    /// Rate of decay c, 1/s.
    pub decay_per_s: f64,
    /// Its standard deviation, 1/s.
    pub std_per_s: f64,
    /// Ends of its 95 % interval, 1/s.
    pub interval_per_s: (f64, f64),
}

impl DecayFit {
    /// Magnitude of the spin at `time_s`, rad/s.
    pub fn rate_at(&self, time_s: f64) -> f64 {
        let start = &self.start.motion;
        start.spin.norm() * (-self.decay_per_s * (time_s - start.time_s)).exp()
    }
}

/// Fits a decaying spin.
///
/// # Errors
/// A [`SpinRejection`] where the measurements are invalid or fewer than one run, agree on nothing, or leave
/// the decay open.
pub fn fit_decay(
    measurements: &[Measurement],
    options: &DecayConfig,
) -> Result<DecayFit, SpinRejection> {
    let runs = spin_over_time(measurements, options.window, &options.robust)?;
    let none = SpinRejection::NoConsensus {
        agreeing: 0,
        frames: measurements.len(),
        max_rps: options.robust.max_rps,
    };
    let (state, covariance) = State::from_runs(&runs, &options.robust).ok_or(none)?;
    let open = |inliers| SpinRejection::DecayOpen { inliers };
    let grown = grow(measurements, state, covariance, options).ok_or(open(0))?;
    let fit = settle(measurements, grown.at(measurements[0].time_s), options);
    fit.map_err(open)
}

/// The parameters: orientation and spin at a reference time, and the rate of decay.
#[derive(Debug, Clone, Copy)]
struct State {
    motion: Motion,
    decay: f64,
}

impl State {
    /// From the runs whose axes agree, and the covariance of its parameters.
    fn from_runs(runs: &[WindowFit], options: &RobustSpinConfig) -> Option<(Self, Mat7)> {
        let axis = |r: &WindowFit| axis_and_rate(&r.fit.motion.spin).0;
        let fellows = |a: &WindowFit| -> Vec<&WindowFit> {
            let near = |b: &&WindowFit| angle_between(&axis(a), &axis(b)) < SAME_AXIS;
            runs.iter().filter(near).collect()
        };
        let chosen = runs.iter().map(fellows).max_by_key(Vec::len)?;
        let pivot = chosen[chosen.len() / 2];
        let points: Vec<(f64, f64)> = chosen
            .iter()
            .map(|r| (r.time_s - pivot.time_s, r.fit.motion.spin.norm().ln()))
            .collect();
        let (level, slope, spread) = robust_line(&points);
        let motion = Motion {
            time_s: pivot.time_s,
            orientation: pivot.fit.motion.at(pivot.time_s),
            spin: axis(pivot) * level.exp(),
        };
        let state = Self {
            motion,
            decay: -slope,
        };
        let mut covariance = Mat7::zeros();
        let sigma = pivot.fit.sigma_rad.unwrap_or(options.sigma_rad);
        let turn = covariance.fixed_view_mut::<3, 3>(0, 0);
        { turn }.fill_diagonal(sigma * sigma);
        let spin = pivot.fit.spin_covariance?;
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&spin);
        covariance[(6, 6)] = spread.min(PRIOR_DECAY).powi(2);
        Some((state, covariance))
    }

    /// Time in which a constant spin would turn as far as this one in `t`, and its derivative with
    /// respect to the decay.
    fn elapsed(&self, t: f64) -> (f64, f64) {
        let (c, tau) = (self.decay, decayed_time(t, self.decay));
        let x = c * t;
        let derivative = if x.abs() < 1e-3 {
            // (t exp(-x) - tau) / c by its series: the next term is below 1e-13.
            t * t * (-0.5 + x * (1.0 / 3.0 + x * (-1.0 / 8.0 + x / 30.0)))
        } else {
            (t * (-x).exp() - tau) / c
        };
        (tau, derivative)
    }

    /// Error of a measurement and its derivative's negative.
    fn residual(&self, m: &Measurement) -> (Vec3, Mat3x7) {
        let (axis, rate) = axis_and_rate(&self.motion.spin);
        let (tau, change) = self.elapsed(m.time_s - self.motion.time_s);
        let start = &self.motion.orientation;
        let r = Residual::after(tau, start, &axis, rate, &m.orientation);
        let mut jacobian = Mat3x7::zeros();
        jacobian
            .fixed_view_mut::<3, 6>(0, 0)
            .copy_from(&constant_jacobian(&axis, &r));
        jacobian.set_column(6, &(axis * (rate * change)));
        (r.error, jacobian)
    }

    fn step(&mut self, change: &Vec7) {
        let turn = Vec3::new(change[0], change[1], change[2]);
        let q = Rotation::from_scaled_axis(turn) * self.motion.orientation;
        self.motion.orientation = Rotation::new_normalize(q.into_inner());
        self.motion.spin += Vec3::new(change[3], change[4], change[5]);
        self.decay += change[6];
    }

    /// The same motion with another reference time.
    fn at(&self, time_s: f64) -> Self {
        let t = time_s - self.motion.time_s;
        let turned = Rotation::from_scaled_axis(self.motion.spin * self.elapsed(t).0);
        Self {
            motion: Motion {
                time_s,
                orientation: turned * self.motion.orientation,
                spin: self.motion.spin * (-self.decay * t).exp(),
            },
            decay: self.decay,
        }
    }
}

/// Level at x = 0, slope, and the slope's standard error by Theil and Sen's medians: half the points
/// may lie anywhere (P. K. Sen, J. Am. Stat. Assoc. 63, 1968).
fn robust_line(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let mut slopes = Vec::new();
    for (i, a) in points.iter().enumerate() {
        for b in &points[..i] {
            slopes.push((a.1 - b.1) / (a.0 - b.0));
        }
    }
    let slope = crate::validate::median(&mut slopes);
    let mut levels: Vec<f64> = points.iter().map(|p| p.1 - slope * p.0).collect();
    let level = crate::validate::median(&mut levels);
    let mut residuals: Vec<f64> = levels.iter().map(|l| (l - level).abs()).collect();
    // The median absolute deviation of a normal law is 0.6745 standard deviations.
    let scatter = crate::validate::median(&mut residuals) / 0.6745;
    let moment: f64 = points.iter().map(|p| p.0 * p.0).sum();
    // Runs overlap by half: twice the variance. Three points or fewer say nothing of the scatter.
    let spread = match points.len() {
        0..=3 => f64::INFINITY,
        _ => scatter * (2.0 / moment).sqrt(),
    };
    (level, slope, spread)
}

/// Takes in frame after frame, from the reference time outwards.
fn grow(
    measurements: &[Measurement],
    mut state: State,
    mut covariance: Mat7,
    options: &DecayConfig,
) -> Option<State> {
    let sigma = options.robust.sigma_rad;
    let prior_mean = state.decay;
    let prior_weight = 1.0 / covariance[(6, 6)].max(1e-8);
    let mut used_before = 0;
    for _ in 0..GROWTH_STEPS {
        let mut information = Mat7::zeros();
        let mut gradient = Vec7::zeros();
        let mut used = 0;
        for m in measurements {
            let (error, jacobian) = state.residual(m);
            let extra = (jacobian * covariance * jacobian.transpose()).trace() / 3.0;
            if extra > PREDICTION_LIMIT * PREDICTION_LIMIT {
                continue;
            }
            used += 1;
            let own = (sigma * m.sigma_scale).powi(2);
            let (right, _) = posterior(m.confidence, error.norm_squared(), own + extra);
            information += jacobian.transpose() * jacobian * (right / own);
            gradient += jacobian.transpose() * error * (right / own);
        }
        information[(6, 6)] += prior_weight;
        gradient[6] += prior_weight * (prior_mean - state.decay);
        covariance = information.cholesky()?.inverse();
        let change = covariance * gradient;
        state.step(&change);
        if used == used_before && change.dot(&gradient) < 1e-2 {
            break;
        }
        used_before = used;
    }
    Some(state)
}

/// Maximizes the likelihood of the mixture; fails with the number of inliers.
fn settle(
    measurements: &[Measurement],
    mut state: State,
    options: &DecayConfig,
) -> Result<DecayFit, usize> {
    let robust = &options.robust;
    let mut sigma = robust.sigma_rad;
    let mut degrees = robust.sigma_degrees;
    let mut sums = Sums::new(measurements, &state, sigma);
    for _ in 0..FINAL_STEPS {
        let solved = sums.information.cholesky().ok_or(sums.inliers)?;
        let change = solved.solve(&sums.gradient);
        // The step's length in standard deviations, squared.
        let length = change.dot(&sums.gradient);
        state.step(&change);
        let mut drift = 0.0;
        if robust.sigma_degrees.is_finite() {
            degrees = robust.sigma_degrees + (3.0 * sums.support - 7.0).max(0.0);
            let squares = robust.sigma_degrees * robust.sigma_rad.powi(2) + sums.squares;
            let next = (squares / degrees).sqrt().min(MAX_NOISE * robust.sigma_rad);
            drift = (next / sigma - 1.0).abs();
            sigma = next;
        }
        sums = Sums::new(measurements, &state, sigma);
        if length < CONVERGED * CONVERGED && drift < CONVERGED {
            break;
        }
    }
    let solved = sums.observed.cholesky().or(sums.information.cholesky());
    let widening = match degrees {
        d if d.is_finite() => d / (d - 2.0).max(1.0),
        _ => 1.0,
    };
    let covariance = solved.ok_or(sums.inliers)?.inverse() * widening;
    let std_per_s = covariance[(6, 6)].sqrt();
    Ok(DecayFit {
        start: Fit {
            motion: state.motion,
            spin_covariance: Some(covariance.fixed_view::<3, 3>(3, 3).into_owned()),
            sigma_rad: Some(sigma),
            log_likelihood: Some(sums.log_likelihood),
            inliers: sums.inliers,
        },
        decay_per_s: state.decay,
        std_per_s,
        interval_per_s: (state.decay - Z95 * std_per_s, state.decay + Z95 * std_per_s),
    })
}

/// The sums of a Gauss-Newton step under the mixture.
struct Sums {
    information: Mat7,
    /// The information less what uncertain membership costs (Louis' formula).
    observed: Mat7,
    gradient: Vec7,
    support: f64,
    squares: f64,
    log_likelihood: f64,
    inliers: usize,
}

impl Sums {
    fn new(measurements: &[Measurement], state: &State, sigma: f64) -> Self {
        let mut sums = Self {
            information: Mat7::zeros(),
            observed: Mat7::zeros(),
            gradient: Vec7::zeros(),
            support: 0.0,
            squares: 0.0,
            log_likelihood: 0.0,
            inliers: 0,
        };
        for m in measurements {
            let (error, jacobian) = state.residual(m);
            let scale = m.sigma_scale * m.sigma_scale;
            let inverse = 1.0 / (sigma * sigma * scale);
            let (right, log_likelihood) =
                posterior(m.confidence, error.norm_squared(), 1.0 / inverse);
            let squared = jacobian.transpose() * jacobian * (right * inverse);
            let score = jacobian.transpose() * error * inverse;
            sums.information += squared;
            sums.observed += squared - score * score.transpose() * (right * (1.0 - right));
            sums.gradient += score * right;
            sums.support += right;
            sums.log_likelihood += log_likelihood;
            sums.squares += right * error.norm_squared() / scale;
            sums.inliers += usize::from(right > 0.5);
        }
        sums
    }
}
