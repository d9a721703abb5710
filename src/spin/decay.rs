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
//! to go on from the middle run outwards, a frame being used once its prediction is good enough.
//! Each start climbs by damped Gauss-Newton steps that are taken only where the likelihood rises
//! (D. W. Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", J. SIAM
//! 11, 1963), until the next one would be shorter than a hundredth of its standard deviation. A fit
//! that has not converged is rejected.
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
//! shows its coverage. Not guaranteed: a slow drift of the axis (gyroscopic effects on an uneven
//! ball) counts as noise.

use nalgebra::{SMatrix, SVector};

use super::chance::expected_by_chance;
use super::refine::{
    MAX_NOISE, NoisePrior, PREDICTION_LIMIT, Residual, axis_and_rate,
    jacobian as constant_jacobian, posterior, settle as settle_constant,
};
use super::robust::{RobustEstimator, RobustSpinConfig, TIE_MARGIN};
use super::search::CONFIDENCE_LIMIT;
use super::simulate::decayed_time;
use super::windows::{WindowFit, spin_over_time};
use super::{Fit, MIN_FRAMES, Measurement, Motion, SpinRejection, require};
use crate::geometry::{Rotation, Vec3, angle_between};

type Vec7 = SVector<f64, 7>;
type Mat7 = SMatrix<f64, 7, 7>;
type Mat3x7 = SMatrix<f64, 3, 7>;

/// Rate of decay's standard deviation while the fit grows, 1/s, where the runs do not say better.
const PRIOR_DECAY: f64 = 0.5;
/// Steps while the fit grows from its first run to the whole sequence.
const GROWTH_STEPS: usize = 40;
/// Rounds of climbing and estimating the noise; three or four do.
const NOISE_ROUNDS: usize = 40;
/// Steps of a climb, the rejected ones included; a good start needs three.
const CLIMB_STEPS: usize = 100;
/// Damping (a share of the information's diagonal) at a climb's start, and when it gives up.
const FIRST_DAMPING: f64 = 1e-3;
const LAST_DAMPING: f64 = 1e10;
/// A climb ends where the next step's square length, in standard deviations, is below this.
const CONVERGED: f64 = 1e-4;
/// The noise has settled when it changes by less than this fraction.
const NOISE_CONVERGED: f64 = 1e-4;
/// The decay counts as determined where its standard deviation changes the sequence's last spin by
/// less than this fraction. Beyond it the likelihood is no Gaussian of the decay.
const MAX_RELATIVE_STD: f64 = 0.2;
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

/// A range of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
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
    let from_runs = State::from_runs(&runs, &config.robust)
        .and_then(|(state, covariance)| grow(measurements, state, covariance, config));
    let from_constant = constant.as_ref().ok().map(|fit| State {
        motion: fit.motion,
        decay: 0.0,
    });
    let best = [from_constant, from_runs]
        .into_iter()
        .flatten()
        .filter_map(|start| settle(measurements, start.at(time_s), config))
        .filter(|s| s.permitted(measurements, config))
        .max_by(|a, b| a.objective.total_cmp(&b.objective));
    let Some(best) = best else {
        // The decay is open: a ball that hardly turns.
        let fit = held_by_most(constant?, measurements, config)?;
        return Ok(DecayOutcome::Constant(ConstantFit {
            fit,
            interval_per_s: None,
            ln_bayes_factor: None,
        }));
    };
    let ln_constant = ln_likelihood_of_constant(measurements, &constant, &best);
    let width = std::f64::consts::TAU.sqrt() * best.std_per_s / (2.0 * config.max_decay_per_s);
    let ln_bayes_factor = best.ln_likelihood() - ln_constant + width.ln();
    let determined = best.std_per_s * duration(measurements) < MAX_RELATIVE_STD;
    if determined && ln_bayes_factor > TIE_MARGIN {
        return Ok(DecayOutcome::Decaying(best.decay_fit(ln_bayes_factor)));
    }
    let fit = held_by_most(constant?, measurements, config)?;
    Ok(DecayOutcome::Constant(ConstantFit {
        fit,
        interval_per_s: determined.then(|| best.interval_per_s()),
        ln_bayes_factor: determined.then_some(ln_bayes_factor),
    }))
}

/// The constant spin, if most of the sequence agrees on it: a decaying one passes for constant over
/// a part of its sequence.
fn held_by_most(
    fit: Fit,
    measurements: &[Measurement],
    config: &DecayConfig,
) -> Result<Fit, SpinRejection> {
    if is_majority(fit.inliers, measurements) {
        return Ok(fit);
    }
    Err(SpinRejection::NoConsensus {
        agreeing: fit.inliers,
        frames: measurements.len(),
        max_rps: config.robust.max_rps,
    })
}

/// Whether these are at least half of the expected inliers.
fn is_majority(inliers: usize, measurements: &[Measurement]) -> bool {
    let expected: f64 = measurements.iter().map(|m| m.confidence).sum();
    inliers as f64 >= 0.5 * expected
}

/// From the first measurement to the last, seconds.
fn duration(measurements: &[Measurement]) -> f64 {
    match measurements {
        [first, .., last] => last.time_s - first.time_s,
        _ => 0.0,
    }
}

/// The best log-likelihood of a constant spin at the decaying one's noise. Its lower bound is the
/// likelihood with all frames as outliers.
fn ln_likelihood_of_constant(
    measurements: &[Measurement],
    constant: &Result<Fit, SpinRejection>,
    decaying: &Settled,
) -> f64 {
    let noise = NoisePrior {
        sigma_rad: decaying.sigma_rad,
        degrees: f64::INFINITY,
    };
    let outlier = |m: &Measurement| {
        let p = m.confidence.clamp(CONFIDENCE_LIMIT, 1.0 - CONFIDENCE_LIMIT);
        ((1.0 - p) / super::search::ROTATION_VOLUME).ln()
    };
    let outliers: f64 = measurements.iter().map(outlier).sum();
    let middle = decaying.state.motion.time_s + 0.5 * duration(measurements);
    let starts = [
        constant.as_ref().ok().map(|c| c.motion),
        Some(decaying.state.at(middle).motion),
    ];
    let mut scratch = Vec::new();
    let mut settled = |start| settle_constant(measurements, start, &noise, &mut scratch);
    starts
        .into_iter()
        .flatten()
        .filter_map(|start| settled(start).map(|r| r.log_likelihood))
        .fold(outliers, f64::max)
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

/// Takes in frame after frame, from the reference time outwards.
fn grow(
    measurements: &[Measurement],
    mut state: State,
    mut covariance: Mat7,
    config: &DecayConfig,
) -> Option<State> {
    let sigma = config.robust.sigma_rad;
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

/// A maximum of the likelihood.
struct Settled {
    state: State,
    sigma_rad: f64,
    covariance: Mat7,
    std_per_s: f64,
    sums: Sums,
    /// Log-likelihood and the noise's log prior, by which maxima are compared.
    objective: f64,
}

impl Settled {
    /// Whether the decay and the spins at both ends are within what is considered, and most of the
    /// frames agree, and more than chance explains.
    fn permitted(&self, measurements: &[Measurement], config: &DecayConfig) -> bool {
        let max_rps = config.robust.max_rps;
        let last = self
            .state
            .at(self.state.motion.time_s + duration(measurements));
        let chance = expected_by_chance(measurements, self.sums.inliers, self.sigma_rad, max_rps)
            * decays_apart(measurements, self.sigma_rad, config);
        self.state.decay.abs() <= config.max_decay_per_s
            && self.state.motion.rps() <= max_rps
            && last.motion.rps() <= max_rps
            && self.sums.inliers >= MIN_FRAMES
            && is_majority(self.sums.inliers, measurements)
            && chance <= config.robust.false_alarms
    }

    fn ln_likelihood(&self) -> f64 {
        self.sums.log_likelihood
    }

    fn interval_per_s(&self) -> Interval {
        let half = Z95 * self.std_per_s;
        Interval {
            low: self.state.decay - half,
            high: self.state.decay + half,
        }
    }

    fn decay_fit(&self, ln_bayes_factor: f64) -> DecayFit {
        let spin = self.covariance.fixed_view::<3, 3>(3, 3).into_owned();
        DecayFit {
            start: Fit {
                motion: self.state.motion,
                spin_covariance: Some(spin),
                sigma_rad: Some(self.sigma_rad),
                log_likelihood: Some(self.ln_likelihood()),
                inliers: self.sums.inliers,
            },
            decay_per_s: self.state.decay,
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

/// Maximizes the likelihood of the mixture and estimates the noise; `None` where it does not
/// converge or the maximum is flat.
fn settle(measurements: &[Measurement], start: State, config: &DecayConfig) -> Option<Settled> {
    let robust = &config.robust;
    let mut state = start;
    let mut sigma = robust.sigma_rad;
    let mut degrees = robust.sigma_degrees;
    let mut converged = false;
    let mut sums = Sums::new(measurements, &state, sigma);
    for _ in 0..NOISE_ROUNDS {
        (state, sums) = climb(measurements, state, sums, sigma)?;
        if converged || !robust.sigma_degrees.is_finite() {
            converged = true;
            break;
        }
        degrees = robust.sigma_degrees + (3.0 * sums.support - 7.0).max(0.0);
        let squares = robust.sigma_degrees * robust.sigma_rad.powi(2) + sums.squares;
        let next = (squares / degrees).sqrt().min(MAX_NOISE * robust.sigma_rad);
        // One more climb at the noise that is reported.
        converged = (next / sigma - 1.0).abs() < NOISE_CONVERGED;
        sigma = next;
        sums = Sums::new(measurements, &state, sigma);
    }
    if !converged {
        return None;
    }
    // Student's distribution with d degrees of freedom has the variance d / (d - 2).
    let (widening, ln_prior) = match degrees {
        d if d.is_finite() => {
            let ratio = (robust.sigma_rad / sigma).powi(2);
            let ln_prior = 0.5 * robust.sigma_degrees * (ratio.ln() - ratio);
            (d / (d - 2.0).max(1.0), ln_prior)
        }
        _ => (1.0, 0.0),
    };
    let covariance = sums.observed.cholesky()?.inverse() * widening;
    Some(Settled {
        state,
        sigma_rad: sigma,
        covariance,
        std_per_s: covariance[(6, 6)].sqrt(),
        objective: sums.log_likelihood + ln_prior,
        sums,
    })
}

/// Climbs to a maximum of the likelihood at a given noise; `None` where it does not get there.
fn climb(
    measurements: &[Measurement],
    mut state: State,
    mut sums: Sums,
    sigma: f64,
) -> Option<(State, Sums)> {
    let mut damping = FIRST_DAMPING;
    for _ in 0..CLIMB_STEPS {
        // A ball that does not turn says nothing of its decay: no step may be taken along it.
        let step = sums.information.cholesky()?.solve(&sums.gradient);
        if step.dot(&sums.gradient) < CONVERGED * CONVERGED {
            return Some((state, sums));
        }
        let mut damped = sums.information;
        for i in 0..7 {
            damped[(i, i)] *= 1.0 + damping;
        }
        let change = damped.cholesky()?.solve(&sums.gradient);
        let mut next = state;
        next.step(&change);
        let reached = Sums::new(measurements, &next, sigma);
        if reached.log_likelihood > sums.log_likelihood {
            (state, sums) = (next, reached);
            damping *= 0.1;
        } else if damping > LAST_DAMPING {
            return None;
        } else {
            damping = 10.0 * damping.max(1e-6);
        }
    }
    None
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
