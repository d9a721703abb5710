//! The settings of the spin estimators, and what is taken to be likely before the measurements.

use std::f64::consts::TAU;

use super::mixture::NoiseVariance;
use super::shared::SharedError;
use super::{MIN_FRAMES, SpinRejection, require};

/// Slower spins are as likely as this one before the measurements, revolutions per second.
pub(super) const SLOWEST_RPS: f64 = 0.01;

/// A prior of the spin's magnitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagnitudePrior {
    /// Expected magnitude, revolutions per second.
    pub rps: f64,
    /// Its standard deviation, revolutions per second.
    pub std_rps: f64,
}

impl MagnitudePrior {
    /// Log-density of a magnitude, up to a constant.
    pub fn log_density(&self, rps: f64) -> f64 {
        -0.5 * ((rps - self.rps) / self.std_rps).powi(2)
    }
}

/// What the times of a sequence are from, which decides what frames that are missing without a gap mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeOrigin {
    /// A rate, a table, names: frames that are lost were not counted, and all that follow are late.
    #[default]
    Stated,
    /// A video's own time stamps: as a whole they are right, and a program that brought the clip to another rate left out
    /// or repeated images.
    Video,
}

/// How spins are estimated: the settings of [`RobustEstimator`](super::robust::RobustEstimator), [`fit_decay`](super::decay::fit_decay) and
/// [`fit_precession`](super::precession::fit_precession).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpinConfig {
    /// Largest spin considered, revolutions per second.
    pub max_rps: f64,
    /// Noise of an orientation per axis, radians.
    pub sigma_rad: f64,
    /// Weight of `sigma_rad`, in degrees of freedom, when the noise is estimated from the
    /// residuals; infinite: the noise is known and fixed.
    pub sigma_degrees: f64,
    /// An error that frames share, if there is one: it widens the covariance.
    pub shared: Option<SharedError>,
    /// Prior of the magnitude, if there is one.
    pub prior: Option<MagnitudePrior>,
    /// What the times are from.
    pub times: TimeOrigin,
    /// Relative standard deviation of the rate of the clock that the times are from.
    pub clock_rate_std: f64,
    /// Expected number of spins with as much agreement by chance that is still accepted.
    pub false_alarms: f64,
    /// Orientations in a run whose spin is taken as constant, whatever the motion.
    pub window: usize,
    /// Largest rate of decay or growth considered, 1/s. Its prior is uniform within it.
    pub max_decay_per_s: f64,
    /// Expected relative difference of an uneven ball's moments of inertia: its standard deviation.
    pub unevenness: f64,
    /// Expected rate at which the spin of an uneven ball decays, 1/s: its standard deviation about none.
    pub decay_sigma_per_s: f64,
}

impl Default for SpinConfig {
    /// 175 revolutions per second (the paper's limit: half a turn a frame at 350 frames per second)
    /// and 2 deg of noise (the paper's mean orientation error is 2.4 deg over all three axes), with
    /// a weak weight: at half or twice that noise the residuals of ten frames dominate. Runs of ten
    /// orientations: at 350 frames per second a spin loses less than 0.3 % in one. Decays up to 2 per
    /// second, twenty times what air does to a table tennis ball; moments of inertia that differ by 5 %, with decays of
    /// 0.2 per second.
    fn default() -> Self {
        Self {
            max_rps: 175.0,
            sigma_rad: 2f64.to_radians(),
            sigma_degrees: 4.0,
            shared: None,
            prior: None,
            times: TimeOrigin::Stated,
            clock_rate_std: 0.0,
            false_alarms: 0.2,
            window: 10,
            max_decay_per_s: 2.0,
            unevenness: 0.05,
            decay_sigma_per_s: 0.2,
        }
    }
}

impl SpinConfig {
    /// What is known of the noise.
    pub(super) fn noise(&self) -> NoiseVariance {
        NoiseVariance {
            sigma_rad: self.sigma_rad,
            degrees: self.sigma_degrees,
        }
    }

    /// Log-density of a magnitude before the measurements, up to a constant; without a prior of it all decades are equally
    /// likely.
    pub(super) fn ln_prior(&self, rps: f64) -> f64 {
        let by_decades = -rps.max(SLOWEST_RPS).ln();
        self.prior.map_or(by_decades, |p| p.log_density(rps))
    }

    /// Density of a spin's rate before the measurements, s/rad.
    pub(super) fn rate_density(&self, rate: f64) -> f64 {
        match self.prior {
            None => {
                let decades = (self.max_rps / SLOWEST_RPS).ln().max(1.0);
                1.0 / (rate.max(SLOWEST_RPS * TAU) * decades)
            }
            Some(p) => p.log_density(rate / TAU).exp() / (TAU.sqrt() * p.std_rps * TAU),
        }
    }

    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`SpinRejection::Setting`] naming the first that is outside.
    pub fn check(&self) -> Result<(), SpinRejection> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let rps = self.max_rps;
        require(positive(rps), "max_rps", "a positive number", rps)?;
        // More noise than that is no orientation, and would allow any number of turns.
        let sigma = self.sigma_rad;
        let inside = sigma > 0.0 && sigma <= std::f64::consts::FRAC_PI_2;
        let degrees = sigma.to_degrees();
        require(
            inside,
            "sigma_rad",
            "more than 0 and at most 90 deg",
            degrees,
        )?;
        // Infinite is a meaning of its own.
        let degrees = self.sigma_degrees;
        require(degrees > 0.0, "sigma_degrees", "a positive number", degrees)?;
        let alarms = self.false_alarms;
        require(
            positive(alarms),
            "false_alarms",
            "a positive number",
            alarms,
        )?;
        let std = self.clock_rate_std;
        require(
            (0.0..1.0).contains(&std),
            "clock_rate_std",
            "0 or more, and less than 1",
            std,
        )?;
        let inside = self.window >= MIN_FRAMES;
        require(inside, "window", "3 or more", self.window as f64)?;
        for (setting, rate) in [
            ("max_decay_per_s", self.max_decay_per_s),
            ("decay_sigma_per_s", self.decay_sigma_per_s),
        ] {
            require(positive(rate), setting, "a positive number", rate)?;
        }
        let e = self.unevenness;
        let expected = "more than 0 and at most 0.5";
        require(e > 0.0 && e <= 0.5, "unevenness", expected, e)?;
        let Some(prior) = self.prior else {
            return Ok(());
        };
        let inside = prior.rps >= 0.0 && prior.rps.is_finite();
        require(inside, "prior_rps", "0 or more", prior.rps)?;
        let std = prior.std_rps;
        require(positive(std), "prior_std_rps", "a positive number", std)
    }
}
