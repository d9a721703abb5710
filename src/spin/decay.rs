//! A spin that decays: `|w|(t) = |w0| exp(-c (t - t0))` about a fixed axis, fitted to a long
//! sequence.
//!
//! The ball has then turned as far as one of constant spin w0 would in the time
//!
//! ```text
//! tau(t) = (1 - exp(-c (t - t0))) / c,    R(t) = exp([w0]x tau(t)) R(t0)
//! ```
//!
//! and the orientation's derivative with respect to c is the angle `|w0| dtau/dc` about the axis.
//! The seven parameters are fitted by maximum likelihood under the mixture of [`super::robust`].
//!
//! # Starts
//! Over a long sequence a wrong rate loses full turns. The fit therefore starts twice: from the
//! constant spin of [`super::robust`], and from the spins of short runs ([`super::windows`]). For
//! the second start a robust line through the logarithms of their rates gives w0 and c well enough
//! to go on from the middle run outwards. How a start climbs, `spin::mixture` says.
//!
//! # Evidence
//! A constant spin is the case c = 0. With a uniform prior of c in `[-m, m]`, the odds for a decay
//! are by Laplace's method
//!
//! ```text
//! ln B = ln L(decay) - ln L(constant) + ln( sqrt(2 pi) std(c) / (2 m) )
//! ```
//!
//! (R. E. Kass, A. E. Raftery, "Bayes factors", J. Am. Stat. Assoc. 90, 1995, eq. 5), both
//! likelihoods at one noise. Odds of 20 to 1 or more are evidence; with less the answer is
//! [`DecayOutcome::Constant`], with the interval in which a decay may still lie.
//!
//! Guaranteed: no decay without evidence; no spin faster than permitted at either end; no more
//! agreement claimed than chance explains (`spin::chance`, with the decays that can be
//! distinguished as further hypotheses), and most of the frames agree. The interval is that of the
//! likelihood's curvature, with the noise estimated from the residuals; `docs/measurements/spin.md`
//! shows its coverage. Not guaranteed: a drift of the axis, as that of an uneven ball, counts as
//! noise; see [`super::precession`].

use nalgebra::{SMatrix, SVector};

use super::chance::expected_by_chance;
use super::mixture::{
    self, Path, Prior, duration, grow, held_by_most, is_majority, ln_likelihood_of_constant,
};
use super::refine::{Residual, axis_and_rate, jacobian as constant_jacobian};
use super::robust::{RobustEstimator, RobustSpinConfig, TIE_MARGIN};
use super::simulate::decayed_time;
use super::windows::{WindowFit, spin_over_time};
use super::{Fit, Interval, MIN_FRAMES, Measurement, Motion, SpinRejection, require};
use crate::geometry::{Rotation, Vec3, angle_between};

type Vec7 = SVector<f64, 7>;
type Mat7 = SMatrix<f64, 7, 7>;
type Mat3x7 = SMatrix<f64, 3, 7>;

/// Rate of decay's standard deviation while the fit grows, 1/s, where the runs do not say better.
const PRIOR_DECAY: f64 = 0.5;
/// The decay counts as determined where its standard deviation changes the sequence's last spin by
/// less than this fraction. Beyond it the likelihood is no Gaussian of the decay.
const MAX_RELATIVE_STD: f64 = 0.2;
/// Axes of runs further apart than this (radians) do not belong to one motion.
const SAME_AXIS: f64 = 0.3;
/// Variance of the decay below which the fit of the runs is not believed while it grows, 1/s^2.
const MIN_DECAY_VARIANCE: f64 = 1e-8;

/// Settings of [`fit_decay`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecayConfig {
    /// Largest spin, noise and so on.
    pub robust: RobustSpinConfig,
    /// Orientations in a run whose spin is taken as constant.
    pub window: usize,
    /// Largest rate of decay or growth considered, 1/s. The prior is uniform within it.
    pub max_decay_per_s: f64,
}

impl Default for DecayConfig {
    /// Runs of ten orientations: at 350 frames per second a spin loses less than 0.3 % in one.
    /// Decays up to 2 per second, twenty times what air does to a table tennis ball.
    fn default() -> Self {
        Self {
            robust: RobustSpinConfig::default(),
            window: 10,
            max_decay_per_s: 2.0,
        }
    }
}

impl DecayConfig {
    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`SpinRejection::Setting`] naming the first that is outside.
    pub fn check(&self) -> Result<(), SpinRejection> {
        self.robust.check()?;
        let inside = self.window >= MIN_FRAMES;
        require(inside, "window", "3 or more", self.window as f64)?;
        let c = self.max_decay_per_s;
        let inside = c > 0.0 && c.is_finite();
        require(inside, "max_decay_per_s", "a positive number", c)
    }
}

/// The outcome of a decay fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DecayOutcome {
    /// There is evidence for a decay (or a growth).
    Decaying(DecayFit),
    /// There is no evidence for a decay: a constant spin explains the orientations.
    Constant(ConstantFit),
}

impl DecayOutcome {
    /// The spin at the first measurement's time.
    pub fn start(&self) -> &Fit {
        match self {
            Self::Decaying(d) => &d.start,
            Self::Constant(c) => &c.fit,
        }
    }

    /// The 95 % interval of the rate of decay, 1/s; `None` where the orientations do not determine
    /// it.
    pub fn interval_per_s(&self) -> Option<Interval> {
        match self {
            Self::Decaying(d) => Some(d.interval_per_s),
            Self::Constant(c) => c.interval_per_s,
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
    /// Its 95 % interval, 1/s.
    pub interval_per_s: Interval,
    /// Natural logarithm of the odds for a decay against a constant spin.
    pub ln_bayes_factor: f64,
}

impl DecayFit {
    /// Magnitude of the spin at `time_s`, rad/s.
    pub fn rate_at(&self, time_s: f64) -> f64 {
        let start = &self.start.motion;
        start.spin.norm() * (-self.decay_per_s * (time_s - start.time_s)).exp()
    }
}

/// A spin without evidence for a decay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantFit {
    /// The constant spin.
    pub fit: Fit,
    /// The 95 % interval in which the rate of decay may still lie, 1/s; `None` where the
    /// orientations do not determine it (a ball that hardly turns, a short sequence).
    pub interval_per_s: Option<Interval>,
    /// Natural logarithm of the odds for a decay; `None` where it is open.
    pub ln_bayes_factor: Option<f64>,
}

/// Fits a decaying spin and compares it with a constant one.
///
/// # Errors
/// A [`SpinRejection`] where the settings or measurements are invalid, or the measurements fewer
/// than one run, or where neither a constant nor a decaying spin agrees with most of the frames and
/// with more than chance explains.
pub fn fit_decay(
    measurements: &[Measurement],
    config: &DecayConfig,
) -> Result<DecayOutcome, SpinRejection> {
    config.check()?;
    let runs = spin_over_time(measurements, config.window, &config.robust)?;
    let constant = RobustEstimator::new(config.robust).fit(measurements);
    let time_s = measurements[0].time_s;
    let from_runs = State::from_runs(&runs, &config.robust).and_then(|(state, covariance)| {
        let mut prior = Prior::none();
        prior.mean[6] = state.decay;
        prior.weight[6] = 1.0 / covariance[(6, 6)].max(MIN_DECAY_VARIANCE);
        grow(
            measurements,
            state,
            covariance,
            &prior,
            config.robust.sigma_rad,
        )
    });
    let from_constant = constant.as_ref().ok().map(|fit| State {
        motion: fit.motion,
        decay: 0.0,
    });
    let best = [from_constant, from_runs]
        .into_iter()
        .flatten()
        .filter_map(|start| Settled::from(measurements, start.at(time_s), config))
        .filter(|s| s.permitted(measurements, config))
        .max_by(|a, b| a.fit.objective.total_cmp(&b.fit.objective));
    let Some(best) = best else {
        // The decay is open: a ball that hardly turns.
        let fit = held_by_most(constant?, measurements, config.robust.max_rps)?;
        return Ok(DecayOutcome::Constant(ConstantFit {
            fit,
            interval_per_s: None,
            ln_bayes_factor: None,
        }));
    };
    let middle = time_s + 0.5 * duration(measurements);
    let starts = constant.as_ref().ok().map(|c| c.motion);
    let starts = starts.into_iter().chain([best.fit.path.at(middle).motion]);
    let ln_constant = ln_likelihood_of_constant(measurements, starts, best.fit.sigma_rad);
    let width = std::f64::consts::TAU.sqrt() * best.std_per_s / (2.0 * config.max_decay_per_s);
    let ln_bayes_factor = best.fit.log_likelihood - ln_constant + width.ln();
    let determined = best.std_per_s * duration(measurements) < MAX_RELATIVE_STD;
    if determined && ln_bayes_factor > TIE_MARGIN {
        return Ok(DecayOutcome::Decaying(best.decay_fit(ln_bayes_factor)));
    }
    let fit = held_by_most(constant?, measurements, config.robust.max_rps)?;
    Ok(DecayOutcome::Constant(ConstantFit {
        fit,
        interval_per_s: determined.then(|| best.interval_per_s()),
        ln_bayes_factor: determined.then_some(ln_bayes_factor),
    }))
}

/// The parameters: orientation and spin at a reference time, and the rate of decay.
#[derive(Debug, Clone, Copy)]
struct State {
    motion: Motion,
    decay: f64,
}

impl State {
    /// From the runs whose axes agree, and the covariance of its parameters.
    fn from_runs(runs: &[WindowFit], config: &RobustSpinConfig) -> Option<(Self, Mat7)> {
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
        let sigma = pivot.fit.sigma_rad.unwrap_or(config.sigma_rad);
        let turn = covariance.fixed_view_mut::<3, 3>(0, 0);
        { turn }.fill_diagonal(sigma * sigma);
        let spin = pivot.fit.spin_covariance?;
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&spin);
        covariance[(6, 6)] = spread.min(PRIOR_DECAY).powi(2);
        Some((state, covariance))
    }

    /// The same motion with another reference time.
    fn at(&self, time_s: f64) -> Self {
        let t = time_s - self.motion.time_s;
        let turned = Rotation::from_scaled_axis(self.motion.spin * elapsed(t, self.decay).0);
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

/// Time in which a constant spin would turn as far as one with the decay `c` (1/s) in `t`, and its
/// derivative with respect to the decay.
pub(super) fn elapsed(t: f64, c: f64) -> (f64, f64) {
    let tau = decayed_time(t, c);
    let x = c * t;
    let derivative = if x.abs() < 1e-3 {
        // (t exp(-x) - tau) / c by its series: the next term is below 1e-13.
        t * t * (-0.5 + x * (1.0 / 3.0 + x * (-1.0 / 8.0 + x / 30.0)))
    } else {
        (t * (-x).exp() - tau) / c
    };
    (tau, derivative)
}

impl Path<7> for State {
    fn residual(&self, m: &Measurement) -> (Vec3, Mat3x7) {
        let (axis, rate) = axis_and_rate(&self.motion.spin);
        let (tau, change) = elapsed(m.time_s - self.motion.time_s, self.decay);
        let start = &self.motion.orientation;
        let r = Residual::after(tau, start, &axis, rate, &m.orientation);
        let mut jacobian = Mat3x7::zeros();
        jacobian
            .fixed_view_mut::<3, 6>(0, 0)
            .copy_from(&constant_jacobian(&axis, &r));
        jacobian.set_column(6, &(axis * (rate * change)));
        (r.error, jacobian)
    }

    fn moved(&self, change: &Vec7) -> Self {
        let turn = Vec3::new(change[0], change[1], change[2]);
        let q = Rotation::from_scaled_axis(turn) * self.motion.orientation;
        Self {
            motion: Motion {
                time_s: self.motion.time_s,
                orientation: Rotation::new_normalize(q.into_inner()),
                spin: self.motion.spin + Vec3::new(change[3], change[4], change[5]),
            },
            decay: self.decay + change[6],
        }
    }

    fn parameters(&self) -> Vec7 {
        let mut parameters = Vec7::zeros();
        parameters[6] = self.decay;
        parameters
    }
}

/// Level at x = 0, slope, and the slope's standard error by Theil and Sen's medians: half the
/// points may lie anywhere (P. K. Sen, J. Am. Stat. Assoc. 63, 1968).
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
    // The median absolute deviation of a normal distribution is 0.6745 standard deviations.
    let scatter = crate::validate::median(&mut residuals) / 0.6745;
    let moment: f64 = points.iter().map(|p| p.0 * p.0).sum();
    // Runs overlap by half: twice the variance. Three points or fewer say nothing of the scatter.
    let spread = match points.len() {
        0..=3 => f64::INFINITY,
        _ => scatter * (2.0 / moment).sqrt(),
    };
    (level, slope, spread)
}

/// A decaying spin at its maximum.
struct Settled {
    fit: mixture::Settled<State, 7>,
    std_per_s: f64,
}

impl Settled {
    /// The maximum that this start leads to, if any.
    fn from(measurements: &[Measurement], start: State, config: &DecayConfig) -> Option<Self> {
        let noise = config.robust.noise();
        let fit = mixture::settle(measurements, start, &Prior::none(), &noise)?;
        let std_per_s = fit.covariance[(6, 6)].sqrt();
        Some(Self { fit, std_per_s })
    }

    /// Whether the decay and the spins at both ends are within what is considered, and most of the
    /// frames agree, and more than chance explains.
    fn permitted(&self, measurements: &[Measurement], config: &DecayConfig) -> bool {
        let max_rps = config.robust.max_rps;
        let (state, inliers, sigma_rad) = (&self.fit.path, self.fit.inliers, self.fit.sigma_rad);
        let last = state.at(state.motion.time_s + duration(measurements));
        let chance = expected_by_chance(measurements, inliers, sigma_rad, max_rps)
            * decays_apart(measurements, sigma_rad, config);
        state.decay.abs() <= config.max_decay_per_s
            && state.motion.rps() <= max_rps
            && last.motion.rps() <= max_rps
            && inliers >= MIN_FRAMES
            && is_majority(inliers, measurements)
            && chance <= config.robust.false_alarms
    }

    fn interval_per_s(&self) -> Interval {
        Interval::normal(self.fit.path.decay, self.std_per_s)
    }

    fn decay_fit(&self, ln_bayes_factor: f64) -> DecayFit {
        let fit = &self.fit;
        DecayFit {
            start: Fit {
                motion: fit.path.motion,
                spin_covariance: Some(fit.covariance.fixed_view::<3, 3>(3, 3).into_owned()),
                sigma_rad: Some(fit.sigma_rad),
                log_likelihood: Some(fit.log_likelihood),
                inliers: fit.inliers,
            },
            decay_per_s: fit.path.decay,
            std_per_s: self.std_per_s,
            interval_per_s: self.interval_per_s(),
            ln_bayes_factor,
        }
    }
}

/// Number of decays that a sequence can distinguish at the fastest spin: each is a clock of its own
/// on which as many constant spins may agree by chance. Within `T` a decay c shifts the last angle
/// by about `w c T^2 / 2`, and what the noise allows is some three standard deviations to each
/// side.
fn decays_apart(measurements: &[Measurement], sigma_rad: f64, config: &DecayConfig) -> f64 {
    let rate = config.robust.max_rps * std::f64::consts::TAU;
    let shift = rate * config.max_decay_per_s * duration(measurements).powi(2);
    1.0 + shift / (6.0 * sigma_rad)
}
