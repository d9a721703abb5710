//! What is known of the noise, and the density of an orientation that may be wrong.

use std::f64::consts::{PI, TAU};

use crate::spin::Measurement;

/// Volume of SO(3) in the measure that is d^3(rotation vector) near the identity.
pub(in crate::spin) const ROTATION_VOLUME: f64 = 8.0 * PI * PI;
/// Confidences are clamped to this distance from 0 and 1: no identifier is calibrated beyond it.
const CONFIDENCE_LIMIT: f64 = 0.02;
/// The noise is taken to be at most this many times what was expected: a mixture free to widen its
/// noise accepts any frame as an inlier.
const MAX_NOISE: f64 = 5.0;

/// Knowledge of the noise: a scaled inverse chi-squared distribution for its variance.
#[derive(Debug, Clone, Copy)]
pub(in crate::spin) struct NoiseVariance {
    /// Noise per axis, radians.
    pub sigma_rad: f64,
    /// Weight of the prior, in degrees of freedom; infinite: the noise is known.
    pub degrees: f64,
}

impl NoiseVariance {
    /// Noise that is known.
    pub fn known(sigma_rad: f64) -> Self {
        Self {
            sigma_rad,
            degrees: f64::INFINITY,
        }
    }

    /// The noise and its degrees of freedom after `support` inliers with the weighted squared errors
    /// `squares`, less those that `parameters` took.
    pub fn updated(&self, support: f64, squares: f64, parameters: usize) -> (f64, f64) {
        if self.degrees.is_infinite() {
            return (self.sigma_rad, self.degrees);
        }
        let degrees = self.degrees + (3.0 * support - parameters as f64).max(0.0);
        let squares = self.degrees * self.sigma_rad.powi(2) + squares;
        (self.limited((squares / degrees).sqrt()), degrees)
    }

    /// The noise after `support` inliers with these weighted squared errors across a circle.
    pub fn of_circle(&self, support: f64, squares: f64) -> f64 {
        if self.degrees.is_infinite() {
            return self.sigma_rad;
        }
        // Two errors each, less the four numbers of the circle.
        let degrees = self.degrees + (2.0 * support - 4.0).max(0.0);
        let squares = self.degrees * self.sigma_rad.powi(2) + squares;
        self.limited((squares / degrees).sqrt())
    }

    /// The noise, no larger than is taken to be possible.
    pub(super) fn limited(&self, sigma_rad: f64) -> f64 {
        sigma_rad.min(MAX_NOISE * self.sigma_rad)
    }

    /// Log-density of the noise, up to a constant, with the likelihood's integral over `parameters`:
    /// what [`Self::updated`] maximizes together with the likelihood.
    pub fn ln_prior(&self, sigma_rad: f64, parameters: usize) -> f64 {
        if self.degrees.is_infinite() {
            return 0.0;
        }
        let ratio = (self.sigma_rad / sigma_rad).powi(2);
        0.5 * self.degrees * (ratio.ln() - ratio) + parameters as f64 * sigma_rad.ln()
    }
}

/// Probability that a frame with the squared error `square` is an inlier.
pub(in crate::spin) fn inlier_probability(confidence: f64, square: f64, variance: f64) -> f64 {
    posterior(confidence, square, variance).0
}

/// Probability that a frame with the squared error `square` is an inlier, and the mixture's density.
pub(super) fn posterior(confidence: f64, square: f64, variance: f64) -> (f64, f64) {
    let p = trusted(confidence);
    let x = TAU * variance;
    let good = p / (x * x.sqrt()) * (-0.5 * square / variance).exp();
    let stray = (1.0 - p) / ROTATION_VOLUME;
    let total = good + stray;
    (good / total, total)
}

/// Beyond this variance, rad^2, no agreement is worth anything: [`peak_gain`] at the largest confidence is
/// 0 at 38.9.
pub(in crate::spin) const MAX_GAINFUL_VARIANCE: f64 = 39.0;

/// `ln( p N(0; 0, v I) / ((1-p) / 8 pi^2) )`: what an exact agreement is worth.
pub(in crate::spin) fn peak_gain(confidence: f64, variance: f64) -> f64 {
    let p = trusted(confidence);
    let normal = (TAU * variance).powi(-3).sqrt();
    (p / (1.0 - p) * ROTATION_VOLUME * normal).ln()
}

/// The log-likelihood with all frames as outliers.
pub(in crate::spin) fn ln_likelihood_of_outliers(measurements: &[Measurement]) -> f64 {
    let outlier = |m: &Measurement| {
        let p = trusted(m.confidence);
        ((1.0 - p) / ROTATION_VOLUME).ln()
    };
    measurements.iter().map(outlier).sum()
}

/// A confidence as far as one is believed.
pub(in crate::spin) fn trusted(confidence: f64) -> f64 {
    confidence.clamp(CONFIDENCE_LIMIT, 1.0 - CONFIDENCE_LIMIT)
}
