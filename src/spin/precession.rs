//! The precession of an uneven ball, fitted to a sequence.
//!
//! The motion is [`PrecessingSpin`]; how it is fitted and compared with a ball that does not precess but may
//! decay, the case `q = 0`, says [`super::evidence`]. Across the spin, `q` shows at once, as a drift of
//! the spin's axis through the ball; along it, only where the axis has gone a good part of its circle.
//! Each component of `q` therefore has the prior `N(0, (a w)^2)`: `a` is the expected unevenness. The
//! decay has a normal prior as well. The share of the prior that the measurements leave to `q` is
//! `sqrt(det cov(q)) / (a w)^3`.
//!
//! The fit starts from the constant spin split between `p` and `q` at every ratio that the sequence can
//! distinguish, and from short runs.
//!
//! Guaranteed: no precession without evidence. Not guaranteed: a ball with three different moments is
//! described to first order in the unevenness only; other torques than that of the air are not modeled;
//! errors that frames share count as motion as far as neither [`SpinConfig::shared`] nor a lack of fit shows them.

use nalgebra::{Matrix3, SMatrix, SVector};

use super::alias::AliasConfig;
use super::decay::decay_prior;
use super::evidence::{MotionFit, Outcome, Richer, compare};
use super::mixture::{Blocks, Mixture, NoiseVariance, RatePrior, ln_likelihood_of_outliers};
use super::motion::{ConstantSpin, DecayingSpin, Motion, PrecessingSpin, axis_and_rate};
use super::robust::SpinConfig;
use super::summary::SpinSummary;
use super::{Fit, Interval, Measurement, SpinRejection};
use crate::geometry::Vec3;

/// Minimum number of orientations: ten parameters are more than three of them.
pub const MIN_ORIENTATIONS: usize = 6;
/// Where the rate fixed in the ball and the decay are among the rates of a [`PrecessingSpin`].
const BODY: usize = 3;
const DECAY: usize = 6;
/// Angle between the starts' rotations about the ball's axis at the end of a sequence, radians.
const START_STEP_RAD: f64 = 1.5;
/// Starts to either side of none; beyond it those with the fastest precession are left out.
const MAX_STARTS: f64 = 64.0;
/// Starts go up to so many standard deviations of the prior.
const START_REACH: f64 = 2.5;
/// A component of the precession is open where the orientations leave more than this share of the
/// prior's standard deviation.
const OPEN: f64 = 0.5;
/// Step of the differences, in standard deviations of a parameter.
const DIFFERENCE: f64 = 1e-3;

/// The outcome of [`fit_precession`].
pub type PrecessionOutcome = Outcome<PrecessingSpin, 7>;
/// A precessing spin.
pub type PrecessionFit = MotionFit<PrecessingSpin, 7>;

/// Fits a precessing spin and compares it with a constant one.
///
/// # Errors
/// A [`SpinRejection`] where the settings or measurements are invalid, or the measurements fewer
/// than six, or where neither a constant nor a precessing spin agrees with most of the frames and
/// with more than chance explains.
pub fn fit_precession(
    measurements: &[Measurement],
    config: &SpinConfig,
) -> Result<PrecessionOutcome, SpinRejection> {
    compare(measurements, config)
}

/// A value and its standard deviation.
struct Estimate {
    mean: f64,
    std: f64,
}

impl PrecessionFit {
    /// The mean spin, at the first measurement's time: along the angular momentum, camera frame. With
    /// its covariance (the precession being estimated as well), the noise and the number of inliers.
    pub fn mean(&self) -> Fit {
        self.mean_at(self.motion.space.time_s)
    }

    /// The same at another time, seconds.
    pub fn mean_at(&self, time_s: f64) -> Fit {
        let elapsed = time_s - self.motion.space.time_s;
        // The decay slows all of the motion alike.
        let spin =
            |motion: &PrecessingSpin| motion.mean().spin * (-motion.decay_per_s * elapsed).exp();
        Fit {
            motion: ConstantSpin {
                time_s,
                orientation: self.motion.at(time_s),
                spin: spin(&self.motion),
            },
            spin_covariance: Some(self.covariance_of(spin)),
            sigma_rad: Some(self.sigma_rad),
            log_likelihood: Some(self.log_likelihood),
            inliers: self.inliers,
            lack_of_fit: self.lack_of_fit,
        }
    }

    /// Covariance of the rotation that is fixed in the ball, pattern frame, (rad/s)^2.
    pub fn body_rate_covariance(&self) -> Matrix3<f64> {
        of_body(&self.covariance)
    }

    /// Rate of the precession, the length of the body's rate, rad/s: its 95 % interval. `None` where the
    /// axis has not gone far enough on its circle to say.
    pub fn rate_interval_rad_s(&self) -> Option<Interval> {
        let (axis, rate) = axis_and_rate(&self.motion.body_rate);
        let std = std_along(&axis, &self.body_rate_covariance());
        (std < OPEN * self.scale).then(|| Interval::normal(rate, std))
    }

    /// Speed at which the spin's axis drifts through the ball, rad/s: its 95 % interval.
    pub fn drift_interval_rad_s(&self) -> Interval {
        let (direction, drift) = axis_and_rate(&self.motion.across());
        let covariance = self.covariance_of(PrecessingSpin::across);
        Interval::normal(drift, std_along(&direction, &covariance))
    }

    /// The 95 % limit of that speed, rad/s, the spin's axis taken as known: for a motion without evidence.
    pub fn max_drift_rad_s(&self) -> f64 {
        let across = across_the_spin(&self.motion, &self.covariance);
        Interval::normal(across.mean, across.std).high
    }

    /// Rate at which the spin decays, 1/s: its 95 % interval.
    pub fn decay_interval_per_s(&self) -> Interval {
        let variance = self.covariance.rates[(DECAY, DECAY)].max(0.0);
        Interval::normal(self.motion.decay_per_s, variance.sqrt())
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
            .map(|m| self.motion.straightened(m))
            .collect();
        let mean = self.mean();
        let constant = Fit {
            motion: self.motion.space,
            ..mean
        };
        let mut summary = SpinSummary::new(&straight, &constant, config, frames);
        summary.fit = mean;
        for alternative in &mut summary.alternatives {
            let space = ConstantSpin {
                spin: alternative.spin,
                ..self.motion.space
            };
            let alias = PrecessingSpin {
                space,
                ..self.motion
            };
            alternative.spin = alias.mean().spin;
        }
        summary
    }

    /// Covariance of a function of the motion, by differences of a small share of its parameters' standard
    /// deviations.
    fn covariance_of(&self, of: impl Fn(&PrecessingSpin) -> Vec3) -> Matrix3<f64> {
        let slope = |turn: Vec3, rates: SVector<f64, 7>, step: f64| {
            let [ahead, back] =
                [1.0, -1.0].map(|s| of(&self.motion.retract(&(turn * s), &(rates * s))));
            (ahead - back) / (2.0 * step)
        };
        let mut by_turn = Matrix3::zeros();
        for i in 0..3 {
            let step = DIFFERENCE * self.covariance.turn[(i, i)].sqrt();
            by_turn.set_column(i, &slope(Vec3::ith(i, step), SVector::zeros(), step));
        }
        let mut by_rates = SMatrix::<f64, 3, 7>::zeros();
        for i in 0..7 {
            let step = DIFFERENCE * self.covariance.rates[(i, i)].sqrt();
            by_rates.set_column(i, &slope(Vec3::zeros(), SVector::ith(i, step), step));
        }
        self.covariance.propagated(&by_turn, &by_rates)
    }
}

/// The part of a covariance that is the body's rate.
fn of_body(covariance: &Blocks<7>) -> Matrix3<f64> {
    covariance.rates.fixed_view::<3, 3>(BODY, BODY).into_owned()
}

fn std_along(direction: &Vec3, covariance: &Matrix3<f64>) -> f64 {
    direction.dot(&(covariance * direction)).max(0.0).sqrt()
}

/// The length of the body's rate across the spin, the spin's axis taken as known.
fn across_the_spin(motion: &PrecessingSpin, covariance: &Blocks<7>) -> Estimate {
    let axis = motion.axis_in_body();
    let flat = Matrix3::identity() - axis * axis.transpose();
    let worst = (flat * of_body(covariance) * flat)
        .symmetric_eigenvalues()
        .max();
    Estimate {
        mean: motion.drift_rad_s(),
        std: worst.max(0.0).sqrt(),
    }
}

impl Richer<7> for PrecessingSpin {
    fn needed(_: &SpinConfig) -> usize {
        MIN_ORIENTATIONS
    }

    fn of_constant(constant: &ConstantSpin) -> Self {
        PrecessingSpin::split(*constant, 0.0)
    }

    /// The constant spin, split at every ratio that a sequence of this duration can distinguish.
    fn starts(constant: &ConstantSpin, duration_s: f64, config: &SpinConfig) -> Vec<Self> {
        let reach = START_REACH * config.unevenness * constant.spin.norm();
        let step = START_STEP_RAD / duration_s;
        let count = (reach / step).ceil().min(MAX_STARTS) as i64;
        (-count..=count)
            .map(|k| PrecessingSpin::split(*constant, k as f64 * step))
            .collect()
    }

    fn prior(constant: &ConstantSpin, config: &SpinConfig) -> (f64, RatePrior<7>) {
        let scale = config.unevenness * constant.spin.norm();
        (scale, Self::growth_prior(scale, config))
    }

    fn growth_prior(scale: f64, config: &SpinConfig) -> RatePrior<7> {
        let mut prior = RatePrior::<7>::none();
        prior.weight.fixed_rows_mut::<3>(BODY).fill(scale.powi(-2));
        prior.weight[DECAY] = config.decay_sigma_per_s.powi(-2);
        prior
    }

    fn rebased(&self, time_s: f64) -> Self {
        PrecessingSpin::rebased(self, time_s)
    }

    fn is_permitted(&self, _: f64, config: &SpinConfig) -> bool {
        self.mean().rps() <= config.max_rps
    }

    /// Each component turns the last frame by the rate times the duration, and the noise allows some three
    /// standard deviations to each side.
    fn distinguished(scale: f64, duration_s: f64, sigma_rad: f64, _: &SpinConfig) -> f64 {
        let range = 2.0 * START_REACH * scale * duration_s;
        (1.0 + range / (6.0 * sigma_rad)).powi(3)
    }

    fn ln_simpler(
        &self,
        measurements: &[Measurement],
        sigma_rad: f64,
        constant: Option<&ConstantSpin>,
        config: &SpinConfig,
    ) -> f64 {
        let mixture = Mixture {
            measurements,
            noise: NoiseVariance::known(sigma_rad),
            prior: decay_prior(config.decay_sigma_per_s),
        };
        let motions = constant.copied().into_iter().chain([self.mean()]);
        let starts = motions.flat_map(|start| {
            [0.0, self.decay_per_s].map(|decay_per_s| DecayingSpin { start, decay_per_s })
        });
        starts
            .map(|start| mixture.ln_maximum(start.rebased(self.space.time_s)))
            .fold(ln_likelihood_of_outliers(measurements), f64::max)
    }

    fn weight_of_evidence(&self, independent: &Blocks<7>, widened: &Blocks<7>) -> f64 {
        let square = |covariance: &Blocks<7>| {
            let solved = of_body(covariance).cholesky()?.solve(&self.body_rate);
            Some(self.body_rate.dot(&solved))
        };
        let squares = square(widened).zip(square(independent));
        // Without a precession there is nothing to weigh.
        squares.map_or(0.0, |(wide, own)| if own > 0.0 { wide / own } else { 1.0 })
    }

    fn ln_occam(covariance: &Blocks<7>, scale: f64, _: &SpinConfig) -> f64 {
        0.5 * of_body(covariance).determinant().ln() - 3.0 * scale.ln()
    }

    fn is_determined(&self, covariance: &Blocks<7>, scale: f64, _: f64) -> bool {
        across_the_spin(self, covariance).std < OPEN * scale
    }
}
