//! The spin of an uneven ball: it precesses about an axis of the ball, and about its angular momentum.
//!
//! A ball whose moments of inertia about one axis `b` and across it differ by the ratio `1 + e`
//! (a seam, a thicker cap, a logo's ink) turns, without torque, as a symmetric top: seen from the ball
//! its angular velocity circles `b` at the constant rate `e` times its component along `b` (L. D.
//! Landau, E. M. Lifshitz, "Mechanics", 3rd ed. 1976, Sec. 33 and 36). The orientation is the product
//! of two even turns,
//!
//! ```text
//! R(t) = exp([p]x t) R(0) exp([q]x t),      w(t) = p + R(t) q
//! ```
//!
//! with `p` fixed in space (along the angular momentum) and `q` fixed in the ball (along `b`), `|q| =
//! |e w_b|`. The mean spin lies along `p` and is `p + u (u . R(0) q)`, `u = p / |p|`.
//!
//! Air slows the ball down: with the torque `-c I w` on every axis the motion is the same at the times
//! `tau(t) = (1 - exp(-c t)) / c` for `t`, as in [`super::decay`].
//!
//! The ten parameters `R(0), p, q, c` are fitted by maximum likelihood under the mixture of
//! [`super::robust`] (how, `spin::mixture` says). Across the spin, `q` shows at once, as a drift of the
//! spin's axis through the ball; along it, only where the axis has gone a good part of its circle. Each
//! component of `q` therefore has the prior `N(0, (a w)^2)`: `a` is the expected unevenness. The decay has
//! a normal prior as well.
//!
//! # Starts
//! The constant spin of [`super::robust`], split between `p` and `q` at every ratio that the sequence
//! can distinguish; and short runs, from which the fit grows over the sequence.
//!
//! # Evidence
//! A ball that does not precess is the case `q = 0`, with a decay of its own. The odds for a precession
//! are by Laplace's method
//!
//! ```text
//! ln B = ln L(precessing) - ln L(not) + ln N(q; 0, (a w)^2) + 3/2 ln(2 pi) + 1/2 ln det cov(q)
//! ```
//!
//! (R. E. Kass, A. E. Raftery, "Bayes factors", J. Am. Stat. Assoc. 90, 1995, eq. 5), both likelihoods
//! at one noise. Odds of 20 to 1 or more are evidence; with less the answer is
//! [`PrecessionOutcome::Constant`], with the drift that is still possible.
//!
//! Guaranteed: no precession without evidence; most of the frames agree, and more than chance explains
//! (`spin::chance`, with the precessions that can be distinguished as further hypotheses). Not
//! guaranteed: a ball with three different moments is described to first order in the unevenness
//! only; other torques than that of the air are not modeled; errors that frames share ([`super::shared`]) count as motion.

use nalgebra::{Matrix3, SMatrix, SVector};

use super::alias::AliasConfig;
use super::chance::expected_by_chance;
use super::decay::elapsed;
use super::mixture::{
    Path, Prior, Settled, duration, grow, held_by_most, is_majority, ln_likelihood_of_outliers,
    settle,
};
use super::refine::{NoisePrior, Residual, axis_and_rate, jacobian as constant_jacobian};
use super::robust::{RobustEstimator, RobustSpinConfig, TIE_MARGIN};
use super::simulate::decayed_time;
use super::summary::SpinSummary;
use super::windows::{WindowFit, spin_over_time};
use super::{Fit, Interval, Measurement, Motion, SpinRejection, check, require};
use crate::concurrency;
use crate::geometry::{Rotation, Vec3, left_jacobian};

type Vec10 = SVector<f64, 10>;
type Mat10 = SMatrix<f64, 10, 10>;
type Mat3x10 = SMatrix<f64, 3, 10>;

/// Minimum number of orientations: ten parameters are more than three of them.
pub const MIN_ORIENTATIONS: usize = 6;
/// Angle between the starts' rotations about the ball's axis at the end of a sequence, radians.
const START_STEP_RAD: f64 = 1.5;
/// Starts to either side of none; beyond it those with the fastest precession are left out.
const MAX_STARTS: f64 = 64.0;
/// Starts go up to so many standard deviations of the prior.
const START_REACH: f64 = 2.5;
/// Runs from which the fit grows.
const RUNS: usize = 3;
/// A component of the precession is open where the orientations leave more than this share of the
/// prior's standard deviation.
const OPEN: f64 = 0.5;
/// Unevenness of an even ball: next to none, so that its fit is that of a precession held at none.
const NO_UNEVENNESS: f64 = 1e-6;
/// Step of the differences, in standard deviations of a parameter.
const DIFFERENCE: f64 = 1e-3;

/// Settings of [`fit_precession`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PrecessionConfig {
    /// Largest spin, noise and so on.
    pub robust: RobustSpinConfig,
    /// Orientations in a run whose spin is taken as constant.
    pub window: usize,
    /// Expected relative difference of the ball's moments of inertia: its standard deviation.
    pub unevenness: f64,
    /// Expected rate at which the spin decays, 1/s: its standard deviation about none.
    pub decay_sigma_per_s: f64,
}

impl Default for PrecessionConfig {
    /// Runs of ten orientations; moments of inertia that differ by 5 %; decays of 0.2 per second, twice
    /// what air does to a table tennis ball.
    fn default() -> Self {
        Self {
            robust: RobustSpinConfig::default(),
            window: 10,
            unevenness: 0.05,
            decay_sigma_per_s: 0.2,
        }
    }
}

impl PrecessionConfig {
    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`SpinRejection::Setting`] naming the first that is outside.
    pub fn check(&self) -> Result<(), SpinRejection> {
        self.robust.check()?;
        let inside = self.window >= MIN_ORIENTATIONS;
        require(inside, "window", "6 or more", self.window as f64)?;
        let e = self.unevenness;
        let inside = e > 0.0 && e <= 0.5;
        let expected = "more than 0 and at most 0.5";
        require(inside, "unevenness", expected, e)?;
        let c = self.decay_sigma_per_s;
        let inside = c > 0.0 && c.is_finite();
        require(inside, "decay_sigma_per_s", "a positive number", c)
    }
}

/// The outcome of a precession fit.
// One a sequence: half a kilobyte is less trouble than a box.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PrecessionOutcome {
    /// There is evidence for a precession.
    Precessing(PrecessionFit),
    /// There is none: a constant spin explains the orientations.
    Constant(SteadyFit),
}

/// A spin without evidence for a precession.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SteadyFit {
    /// The constant spin.
    pub fit: Fit,
    /// The 95 % limit of the speed at which the spin's axis may drift through the ball, rad/s; `None`
    /// where the orientations leave it open (a ball that hardly turns, a short sequence).
    pub max_drift_rad_s: Option<f64>,
    /// Natural logarithm of the odds for a precession; `None` where it is open.
    pub ln_bayes_factor: Option<f64>,
}

/// A precessing spin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PrecessionFit {
    path: Precessing,
    /// The constant spin that explains the orientations best; the mean one where none does.
    pub constant: Motion,
    /// The mean spin, at the first measurement's time: along the angular momentum, camera frame. With
    /// its covariance (the precession being estimated as well), the noise and the number of inliers.
    pub mean: Fit,
    /// The rotation that is fixed in the ball, pattern frame, rad/s: the spin turns about it, against
    /// its sense, as the ball sees it.
    pub body_rate: Vec3,
    /// Its covariance, (rad/s)^2.
    pub body_rate_covariance: Matrix3<f64>,
    /// Rate of the precession, the length of `body_rate`, rad/s: its 95 % interval. `None` where the
    /// axis has not gone far enough on its circle to say.
    pub rate_interval_rad_s: Option<Interval>,
    /// Speed at which the spin's axis drifts through the ball, rad/s: the part of `body_rate` across
    /// the spin.
    pub drift_rad_s: f64,
    /// Its 95 % interval, rad/s.
    pub drift_interval_rad_s: Interval,
    /// Rate at which the spin decays, 1/s.
    pub decay_per_s: f64,
    /// Its 95 % interval, 1/s.
    pub decay_interval_per_s: Interval,
    /// Natural logarithm of the odds for a precession against none.
    pub ln_bayes_factor: f64,
}

impl PrecessionFit {
    /// The rotation that is fixed in space, along the angular momentum: camera frame, rad/s.
    pub fn space_rate(&self) -> Vec3 {
        self.path.motion.spin
    }

    /// The orientation at `time_s`, pattern to camera.
    pub fn at(&self, time_s: f64) -> Rotation {
        self.path.at(time_s)
    }

    /// Angle between the spin and the axis of the precession, radians.
    pub fn tilt_rad(&self) -> f64 {
        (self.drift_rad_s / self.body_rate.norm())
            .clamp(0.0, 1.0)
            .asin()
    }

    /// What the sequence says of its mean spin. The measurements without the turn that is fixed in the
    /// ball follow a constant spin, whose aliases are those of the mean spin.
    pub fn summary(
        &self,
        measurements: &[Measurement],
        config: &AliasConfig,
        frames: usize,
    ) -> SpinSummary {
        let straight: Vec<Measurement> = measurements
            .iter()
            .map(|m| self.path.straightened(m))
            .collect();
        let constant = Fit {
            motion: self.path.motion,
            ..self.mean
        };
        let mut summary = SpinSummary::new(&straight, &constant, config, frames);
        summary.fit = self.mean;
        for alternative in &mut summary.alternatives {
            let motion = Motion {
                spin: alternative.spin,
                ..self.path.motion
            };
            alternative.spin = Precessing {
                motion,
                ..self.path
            }
            .mean_spin();
        }
        summary
    }
}

/// Fits a precessing spin and compares it with a constant one.
///
/// # Errors
/// A [`SpinRejection`] where the settings or measurements are invalid, or the measurements fewer
/// than one run, or where neither a constant nor a precessing spin agrees with most of the frames and
/// with more than chance explains.
pub fn fit_precession(
    measurements: &[Measurement],
    config: &PrecessionConfig,
) -> Result<PrecessionOutcome, SpinRejection> {
    config.check()?;
    check(measurements, MIN_ORIENTATIONS)?;
    let constant = RobustEstimator::new(config.robust).fit(measurements);
    let constant_motion = constant.as_ref().ok().map(|fit| fit.motion);
    let window = config.window.min(measurements.len());
    let runs = spin_over_time(measurements, window, &config.robust)?;
    let Some(best) = best(measurements, constant_motion, &runs, config) else {
        let fit = held_by_most(constant?, measurements, config.robust.max_rps)?;
        return Ok(PrecessionOutcome::Constant(SteadyFit {
            fit,
            max_drift_rad_s: None,
            ln_bayes_factor: None,
        }));
    };
    let body = best.covariance.fixed_view::<3, 3>(6, 6).into_owned();
    let scale = best.path.scale;
    let ln_even = ln_posterior_of_even(measurements, constant_motion, &best, config);
    let ln_occam = 0.5 * body.determinant().ln() - 3.0 * scale.ln();
    let ln_bayes_factor = best.log_posterior - ln_even + ln_occam;
    if ln_bayes_factor > TIE_MARGIN {
        let fit = precession_fit(&best, constant_motion, ln_bayes_factor);
        return Ok(PrecessionOutcome::Precessing(fit));
    }
    let fit = held_by_most(constant?, measurements, config.robust.max_rps)?;
    let across = across_the_spin(&body, &best.path);
    let determined = across.std < OPEN * scale;
    Ok(PrecessionOutcome::Constant(SteadyFit {
        fit,
        max_drift_rad_s: determined.then(|| Interval::normal(across.mean, across.std).high),
        ln_bayes_factor: determined.then_some(ln_bayes_factor),
    }))
}

/// The parameters: orientation and the spin fixed in space at a reference time, and the turn fixed in
/// the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Precessing {
    motion: Motion,
    body_rate: Vec3,
    /// Rate of decay, 1/s.
    decay: f64,
    /// Standard deviation of each component of `body_rate` before the fit, rad/s.
    scale: f64,
}

impl Precessing {
    /// A constant spin, of which the share `body` (rad/s, about the spin's axis) is fixed in the ball.
    fn split(motion: Motion, body: f64, unevenness: f64) -> Self {
        let (axis, rate) = axis_and_rate(&motion.spin);
        Self {
            motion: Motion {
                spin: axis * (rate - body),
                ..motion
            },
            body_rate: motion.orientation.inverse() * axis * body,
            decay: 0.0,
            scale: unevenness * rate,
        }
    }

    /// Time in which the ball would turn as far without a decay, from the reference time.
    fn elapsed(&self, time_s: f64) -> f64 {
        decayed_time(time_s - self.motion.time_s, self.decay)
    }

    /// The measurement of a ball that turns with the part fixed in space alone, and does not slow down.
    fn straightened(&self, m: &Measurement) -> Measurement {
        let tau = self.elapsed(m.time_s);
        Measurement {
            time_s: self.motion.time_s + tau,
            orientation: m.orientation * Rotation::from_scaled_axis(self.body_rate * -tau),
            ..*m
        }
    }

    fn at(&self, time_s: f64) -> Rotation {
        let tau = self.elapsed(time_s);
        self.motion.at(self.motion.time_s + tau) * Rotation::from_scaled_axis(self.body_rate * tau)
    }

    /// The same motion with another reference time.
    fn rebased(&self, time_s: f64) -> Self {
        let slowed = (-self.decay * (time_s - self.motion.time_s)).exp();
        Self {
            motion: Motion {
                time_s,
                orientation: self.at(time_s),
                spin: self.motion.spin * slowed,
            },
            body_rate: self.body_rate * slowed,
            ..*self
        }
    }

    /// The spin's axis as the ball sees it at the reference time, pattern frame.
    fn axis_in_body(&self) -> Vec3 {
        self.motion.orientation.inverse() * axis_and_rate(&self.motion.spin).0
    }

    fn mean_spin(&self) -> Vec3 {
        let (axis, rate) = axis_and_rate(&self.motion.spin);
        axis * (rate + self.axis_in_body().dot(&self.body_rate))
    }

    /// The part of the body's rate across the spin, pattern frame.
    fn across(&self) -> Vec3 {
        let axis = self.axis_in_body();
        self.body_rate - axis * axis.dot(&self.body_rate)
    }

    fn motion_with_mean(&self) -> Motion {
        Motion {
            spin: self.mean_spin(),
            ..self.motion
        }
    }

    /// Derivative of a function of the parameters, by differences of a small share of their standard
    /// deviations.
    fn derivative(&self, covariance: &Mat10, of: impl Fn(&Self) -> Vec3) -> Mat3x10 {
        let mut derivative = Mat3x10::zeros();
        for i in 0..10 {
            let mut change = Vec10::zeros();
            change[i] = DIFFERENCE * covariance[(i, i)].sqrt();
            let slope = (of(&self.moved(&change)) - of(&self.moved(&-change))) / (2.0 * change[i]);
            derivative.set_column(i, &slope);
        }
        derivative
    }
}

impl Path<10> for Precessing {
    fn residual(&self, m: &Measurement) -> (Vec3, Mat3x10) {
        let (axis, rate) = axis_and_rate(&self.motion.spin);
        let (tau, by_decay) = elapsed(m.time_s - self.motion.time_s, self.decay);
        let straight = self.straightened(m);
        let r = Residual::new(&self.motion, &axis, rate, &straight);
        let turned = self.motion.at(straight.time_s).to_rotation_matrix();
        let mut jacobian = Mat3x10::zeros();
        jacobian
            .fixed_view_mut::<3, 6>(0, 0)
            .copy_from(&constant_jacobian(&axis, &r));
        // R exp(q + d) = exp(R J d) R exp(q).
        let of_body = turned.matrix() * left_jacobian(&(self.body_rate * tau)) * tau;
        jacobian.fixed_view_mut::<3, 3>(0, 6).copy_from(&of_body);
        // exp([q]x tau) leaves q as it is.
        let spin = self.motion.spin + turned * self.body_rate;
        jacobian.set_column(9, &(spin * by_decay));
        (r.error, jacobian)
    }

    fn moved(&self, change: &Vec10) -> Self {
        let part = |at: usize| Vec3::new(change[at], change[at + 1], change[at + 2]);
        let q = Rotation::from_scaled_axis(part(0)) * self.motion.orientation;
        Self {
            motion: Motion {
                orientation: Rotation::new_normalize(q.into_inner()),
                spin: self.motion.spin + part(3),
                ..self.motion
            },
            body_rate: self.body_rate + part(6),
            decay: self.decay + change[9],
            ..*self
        }
    }

    fn parameters(&self) -> Vec10 {
        let mut parameters = Vec10::zeros();
        parameters.fixed_rows_mut::<3>(6).copy_from(&self.body_rate);
        parameters[9] = self.decay;
        parameters
    }
}

/// The priors of the body's rate, zero with the standard deviation `scale`, and of the decay.
fn prior(scale: f64, config: &PrecessionConfig) -> Prior<10> {
    let mut prior = Prior::<10>::none();
    prior.weight.fixed_rows_mut::<3>(6).fill(scale.powi(-2));
    prior.weight[9] = config.decay_sigma_per_s.powi(-2);
    prior
}

/// The log posterior of a ball that does not precess, at the noise of the precessing one: the same
/// fit, with no room for a precession. Its lower bound is that of outliers only.
fn ln_posterior_of_even(
    measurements: &[Measurement],
    constant: Option<Motion>,
    best: &Settled<Precessing, 10>,
    config: &PrecessionConfig,
) -> f64 {
    let noise = NoisePrior {
        sigma_rad: best.sigma_rad,
        degrees: f64::INFINITY,
    };
    let motions = constant.into_iter().chain([best.path.motion_with_mean()]);
    let decays = [0.0, best.path.decay];
    let starts = motions.flat_map(|motion| {
        decays.map(|decay| Precessing {
            decay,
            ..Precessing::split(motion, 0.0, NO_UNEVENNESS)
        })
    });
    starts
        .filter_map(|start| {
            let start = start.rebased(best.path.motion.time_s);
            settle(measurements, start, &prior(start.scale, config), &noise)
        })
        .map(|settled| settled.log_posterior)
        .fold(ln_likelihood_of_outliers(measurements), f64::max)
}

/// The best of all starts that is permitted.
fn best(
    measurements: &[Measurement],
    constant: Option<Motion>,
    runs: &[WindowFit],
    config: &PrecessionConfig,
) -> Option<Settled<Precessing, 10>> {
    let time_s = measurements[0].time_s;
    let mut starts = Vec::new();
    if let Some(motion) = constant {
        starts.extend(splits(motion, duration(measurements), config.unevenness));
    }
    let chosen = (0..RUNS).filter_map(|k| runs.get((2 * k + 1) * runs.len() / (2 * RUNS)));
    starts.extend(chosen.filter_map(|run| grown(measurements, run, config)));
    // A start with its own noise may call most frames outliers; the climb is with the noise given.
    let noise = config.robust.noise();
    concurrency::map(&starts, |start| {
        let start = start.rebased(time_s);
        settle(measurements, start, &prior(start.scale, config), &noise)
            .filter(|s| is_permitted(s, measurements, config))
    })
    .into_iter()
    .flatten()
    .max_by(|a, b| a.objective.total_cmp(&b.objective))
}

/// The constant spin, split at every ratio that a sequence of this duration can distinguish.
fn splits(motion: Motion, duration: f64, unevenness: f64) -> Vec<Precessing> {
    let reach = START_REACH * unevenness * motion.spin.norm();
    let step = START_STEP_RAD / duration;
    let count = (reach / step).ceil().min(MAX_STARTS) as i64;
    (-count..=count)
        .map(|k| Precessing::split(motion, k as f64 * step, unevenness))
        .collect()
}

/// A start from a run, grown over the sequence.
fn grown(
    measurements: &[Measurement],
    run: &WindowFit,
    config: &PrecessionConfig,
) -> Option<Precessing> {
    let motion = Motion {
        time_s: run.time_s,
        orientation: run.fit.motion.at(run.time_s),
        spin: run.fit.motion.spin,
    };
    let start = Precessing::split(motion, 0.0, config.unevenness);
    let sigma = run.fit.sigma_rad.unwrap_or(config.robust.sigma_rad);
    let mut covariance = Mat10::zeros();
    covariance[(9, 9)] = config.decay_sigma_per_s.powi(2);
    for i in 0..3 {
        covariance[(i, i)] = sigma * sigma;
        covariance[(6 + i, 6 + i)] = start.scale.powi(2);
    }
    let of_spin = run.fit.spin_covariance?;
    covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&of_spin);
    let prior = prior(start.scale, config);
    grow(
        measurements,
        start,
        covariance,
        &prior,
        config.robust.sigma_rad,
    )
}

/// Whether the spin is within what is considered, and most of the frames agree, and more than chance
/// explains.
fn is_permitted(
    settled: &Settled<Precessing, 10>,
    measurements: &[Measurement],
    config: &PrecessionConfig,
) -> bool {
    let (inliers, sigma_rad) = (settled.inliers, settled.sigma_rad);
    let max_rps = config.robust.max_rps;
    let chance = expected_by_chance(measurements, inliers, sigma_rad, max_rps)
        * precessions_apart(settled.path.scale, measurements, sigma_rad);
    settled.path.motion_with_mean().rps() <= max_rps
        && inliers >= MIN_ORIENTATIONS
        && is_majority(inliers, measurements)
        && chance <= config.robust.false_alarms
}

/// Number of precessions that a sequence can distinguish: each component turns the last frame by the
/// rate times the duration, and the noise allows some three standard deviations to each side.
fn precessions_apart(scale: f64, measurements: &[Measurement], sigma_rad: f64) -> f64 {
    let range = 2.0 * START_REACH * scale * duration(measurements);
    (1.0 + range / (6.0 * sigma_rad)).powi(3)
}

/// A value and its standard deviation.
struct Estimate {
    mean: f64,
    std: f64,
}

/// The length of the body's rate across the spin, the spin's axis taken as known.
fn across_the_spin(covariance: &Matrix3<f64>, path: &Precessing) -> Estimate {
    let axis = path.axis_in_body();
    let flat = Matrix3::identity() - axis * axis.transpose();
    let worst = (flat * covariance * flat).symmetric_eigenvalues().max();
    Estimate {
        mean: path.across().norm(),
        std: worst.max(0.0).sqrt(),
    }
}

fn precession_fit(
    best: &Settled<Precessing, 10>,
    constant: Option<Motion>,
    ln_bayes_factor: f64,
) -> PrecessionFit {
    let (path, covariance) = (best.path, best.covariance);
    let propagated = |derivative: Mat3x10| derivative * covariance * derivative.transpose();
    let body = covariance.fixed_view::<3, 3>(6, 6).into_owned();
    let along = |direction: &Vec3, covariance: &Matrix3<f64>| {
        direction.dot(&(covariance * direction)).max(0.0).sqrt()
    };
    let rate = path.body_rate.norm();
    let rate_std = along(&axis_and_rate(&path.body_rate).0, &body);
    let across = path.across();
    let of_across = propagated(path.derivative(&covariance, Precessing::across));
    let drift = across.norm();
    let drift_std = along(&axis_and_rate(&across).0, &of_across);
    PrecessionFit {
        path,
        constant: constant.unwrap_or(path.motion_with_mean()),
        mean: Fit {
            motion: path.motion_with_mean(),
            spin_covariance: Some(propagated(
                path.derivative(&covariance, Precessing::mean_spin),
            )),
            sigma_rad: Some(best.sigma_rad),
            log_likelihood: Some(best.log_likelihood),
            inliers: best.inliers,
        },
        body_rate: path.body_rate,
        body_rate_covariance: body,
        rate_interval_rad_s: (rate_std < OPEN * path.scale)
            .then(|| Interval::normal(rate, rate_std)),
        drift_rad_s: drift,
        drift_interval_rad_s: Interval::normal(drift, drift_std),
        decay_per_s: path.decay,
        decay_interval_per_s: Interval::normal(path.decay, covariance[(9, 9)].max(0.0).sqrt()),
        ln_bayes_factor,
    }
}
