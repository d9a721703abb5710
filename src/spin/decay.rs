//! A spin that decays: `|w|(t) = |w0| exp(-c (t - t0))` about a fixed axis, fitted to a long
//! sequence.
//!
//! The motion is [`DecayingSpin`]; how it is fitted and compared with a constant spin, the case c = 0, says
//! [`super::evidence`]. With a uniform prior of c in `[-m, m]` the share of the prior that the measurements
//! leave is `sqrt(2 pi) std(c) / (2 m)`.
//!
//! Guaranteed: no decay without evidence; no spin faster than permitted at either end. The interval is
//! that of the likelihood's curvature, with the noise estimated from the residuals; `docs/measurements/spin.md`
//! shows its coverage. Not guaranteed: a drift of the axis, as that of an uneven ball, counts as
//! noise; see [`super::precession`].

use nalgebra::{SMatrix, SVector};

use super::evidence::{MotionFit, Outcome, Richer, compare};
use super::mixture::{
    Blocks, Mixture, NoiseVariance, RatePrior, duration, ln_likelihood_of_outliers,
};
use super::motion::{ConstantSpin, DecayingSpin, Motion};
use super::robust::SpinConfig;
use super::{Fit, Interval, Measurement, SpinRejection};

/// The rate of decay among the rates of a [`DecayingSpin`].
const DECAY: usize = 3;
/// Rate of decay's standard deviation while a fit grows, 1/s.
const GROWTH_SIGMA: f64 = 0.5;
/// The decay counts as determined where its standard deviation changes the sequence's last spin by
/// less than this fraction. Beyond it the likelihood is no Gaussian of the decay.
const MAX_RELATIVE_STD: f64 = 0.2;

/// The outcome of [`fit_decay`].
pub type DecayOutcome = Outcome<DecayingSpin, 4>;
/// A decaying spin.
pub type DecayFit = MotionFit<DecayingSpin, 4>;

/// Fits a decaying spin and compares it with a constant one.
///
/// # Errors
/// A [`SpinRejection`] where the settings or measurements are invalid, or the measurements fewer
/// than one run, or where neither a constant nor a decaying spin agrees with most of the frames and
/// with more than chance explains.
pub fn fit_decay(
    measurements: &[Measurement],
    config: &SpinConfig,
) -> Result<DecayOutcome, SpinRejection> {
    compare(measurements, config)
}

impl DecayOutcome {
    /// The spin at the first measurement's time.
    pub fn start(&self) -> Fit {
        match self {
            Self::Found { fit, .. } => fit.start(),
            Self::Constant { fit, .. } => *fit,
        }
    }
}

impl DecayFit {
    /// Orientation and spin at the first measurement's time, with the spin's covariance (the decay
    /// being estimated as well).
    pub fn start(&self) -> Fit {
        self.at(self.motion.start.time_s)
    }

    /// The same at another time, seconds.
    pub fn at(&self, time_s: f64) -> Fit {
        let motion = self.motion.rebased(time_s).start;
        let elapsed = time_s - self.motion.start.time_s;
        let slowed = (-self.motion.decay_per_s * elapsed).exp();
        // In the frame of the spin, its axis last: exp(-c t) w by w and c.
        let mut by_rates = SMatrix::<f64, 3, 4>::identity() * slowed;
        by_rates[(2, DECAY)] = -elapsed * motion.spin.norm();
        let basis = self.motion.local_frame().basis;
        let of_spin = by_rates * self.covariance.rates * by_rates.transpose();
        Fit {
            motion,
            spin_covariance: Some(basis * of_spin * basis.transpose()),
            sigma_rad: Some(self.sigma_rad),
            log_likelihood: Some(self.log_likelihood),
            inliers: self.inliers,
            lack_of_fit: self.lack_of_fit,
        }
    }

    /// Standard deviation of the rate of decay, 1/s.
    pub fn std_per_s(&self) -> f64 {
        std_per_s(&self.covariance)
    }

    /// The 95 % interval of the rate of decay, 1/s.
    pub fn interval_per_s(&self) -> Interval {
        Interval::normal(self.motion.decay_per_s, self.std_per_s())
    }
}

fn std_per_s(covariance: &Blocks<4>) -> f64 {
    covariance.rates[(DECAY, DECAY)].max(0.0).sqrt()
}

/// A normal prior of the decay about none.
pub(super) fn decay_prior(sigma_per_s: f64) -> RatePrior<4> {
    RatePrior {
        mean: SVector::zeros(),
        weight: SVector::<f64, 4>::new(0.0, 0.0, 0.0, sigma_per_s.powi(-2)),
    }
}

impl Richer<4> for DecayingSpin {
    fn needed(config: &SpinConfig) -> usize {
        config.window
    }

    fn of_constant(constant: &ConstantSpin) -> Self {
        Self {
            start: *constant,
            decay_per_s: 0.0,
        }
    }

    fn prior(_: &ConstantSpin, config: &SpinConfig) -> (f64, RatePrior<4>) {
        (config.max_decay_per_s, RatePrior::none())
    }

    fn growth_prior(_: f64, _: &SpinConfig) -> RatePrior<4> {
        decay_prior(GROWTH_SIGMA)
    }

    fn rebased(&self, time_s: f64) -> Self {
        DecayingSpin::rebased(self, time_s)
    }

    fn is_permitted(&self, last_s: f64, config: &SpinConfig) -> bool {
        let last = self.rebased(last_s);
        self.decay_per_s.abs() <= config.max_decay_per_s
            && self.start.rps() <= config.max_rps
            && last.start.rps() <= config.max_rps
    }

    /// Within `T` a decay c shifts the last angle by about `w c T^2 / 2`, and what the noise allows is some
    /// three standard deviations to each side.
    fn distinguished(max_decay_per_s: f64, duration_s: f64, sigma_rad: f64, c: &SpinConfig) -> f64 {
        let rate = c.max_rps * std::f64::consts::TAU;
        1.0 + rate * max_decay_per_s * duration_s.powi(2) / (6.0 * sigma_rad)
    }

    fn ln_simpler(
        &self,
        measurements: &[Measurement],
        sigma_rad: f64,
        constant: Option<&ConstantSpin>,
        _: &SpinConfig,
    ) -> f64 {
        let mixture = Mixture {
            measurements,
            noise: NoiseVariance::known(sigma_rad),
            prior: RatePrior::none(),
        };
        let middle_s = self.start.time_s + 0.5 * duration(measurements);
        let starts = constant
            .copied()
            .into_iter()
            .chain([self.rebased(middle_s).start]);
        starts
            .map(|start| mixture.ln_maximum(start))
            .fold(ln_likelihood_of_outliers(measurements), f64::max)
    }

    fn weight_of_evidence(&self, independent: &Blocks<4>, widened: &Blocks<4>) -> f64 {
        (std_per_s(independent) / std_per_s(widened)).powi(2)
    }

    fn ln_occam(covariance: &Blocks<4>, max_decay_per_s: f64, _: &SpinConfig) -> f64 {
        let range = 2.0 * max_decay_per_s;
        (std::f64::consts::TAU.sqrt() * std_per_s(covariance) / range).ln()
    }

    fn is_determined(&self, covariance: &Blocks<4>, _: f64, duration_s: f64) -> bool {
        std_per_s(covariance) * duration_s < MAX_RELATIVE_STD
    }
}
