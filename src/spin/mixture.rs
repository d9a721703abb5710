//! Maximum likelihood of a motion with any parameters under the mixture of noise and outliers.
//!
//! A motion is a [`Path`]: it predicts orientations and says how they change with its parameters.
//! [`settle`] climbs to the likelihood's maximum by damped Gauss-Newton steps that are taken only
//! where the likelihood rises (D. W. Marquardt, "An algorithm for least-squares estimation of
//! nonlinear parameters", J. SIAM 11, 1963), until the next one would be shorter than a hundredth of
//! its standard deviation, in turn with an estimate of the noise from the residuals. A fit that does
//! not converge is rejected. [`grow`] leads to a start: from a path that is good near its reference
//! time outwards, a frame being used once its prediction is good enough.
//!
//! Covariances are the inverse of the observed information: the part from uncertain membership is
//! subtracted (T. A. Louis, J. R. Stat. Soc. B 44, 1982, eq. 3.1).

use nalgebra::{SMatrix, SVector};

use super::refine::{
    MAX_NOISE, NoisePrior, PREDICTION_LIMIT, posterior, settle as settle_constant,
};
use super::search::{CONFIDENCE_LIMIT, ROTATION_VOLUME};
use super::{Fit, Measurement, Motion, SpinRejection};
use crate::geometry::Vec3;

/// Steps while a fit grows from its first run to the whole sequence.
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

/// A motion with `N` parameters.
pub(super) trait Path<const N: usize>: Copy {
    /// Error of a measurement (rotation vector from the prediction, camera frame) and the
    /// prediction's derivative.
    fn residual(&self, m: &Measurement) -> (Vec3, SMatrix<f64, 3, N>);

    /// The path after a change of its parameters.
    fn moved(&self, change: &SVector<f64, N>) -> Self;

    /// The parameters that may have a prior; 0 for all others.
    fn parameters(&self) -> SVector<f64, N>;
}

/// Independent normal priors of some parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior<const N: usize> {
    pub mean: SVector<f64, N>,
    /// Inverse variances; 0 for a parameter without a prior.
    pub weight: SVector<f64, N>,
}

impl<const N: usize> Prior<N> {
    /// No prior of any parameter.
    pub fn none() -> Self {
        Self {
            mean: SVector::zeros(),
            weight: SVector::zeros(),
        }
    }

    /// Log-density at the parameters, up to a constant, and its gradient.
    fn pull(&self, parameters: &SVector<f64, N>) -> (f64, SVector<f64, N>) {
        let off = self.mean - parameters;
        let gradient = self.weight.component_mul(&off);
        (-0.5 * off.dot(&gradient), gradient)
    }
}

/// A maximum of the likelihood.
#[derive(Debug, Clone, Copy)]
pub(super) struct Settled<P, const N: usize> {
    pub path: P,
    /// Noise per axis, radians.
    pub sigma_rad: f64,
    /// Covariance of the parameters, widened where the noise is estimated.
    pub covariance: SMatrix<f64, N, N>,
    pub inliers: usize,
    /// Log-likelihood without any prior.
    pub log_likelihood: f64,
    /// Log-likelihood with the priors of the parameters, up to a constant.
    pub log_posterior: f64,
    /// The same with the prior of the noise, by which maxima are compared.
    pub objective: f64,
}

/// The sums of a Gauss-Newton step under the mixture.
#[derive(Debug, Clone, Copy)]
struct Sums<const N: usize> {
    information: SMatrix<f64, N, N>,
    /// The information less what uncertain membership costs (Louis' formula).
    observed: SMatrix<f64, N, N>,
    gradient: SVector<f64, N>,
    support: f64,
    squares: f64,
    log_likelihood: f64,
    objective: f64,
    inliers: usize,
}

impl<const N: usize> Sums<N> {
    fn new<P: Path<N>>(
        measurements: &[Measurement],
        path: &P,
        prior: &Prior<N>,
        sigma: f64,
    ) -> Self {
        let (ln_prior, gradient) = prior.pull(&path.parameters());
        let information = SMatrix::from_diagonal(&prior.weight);
        let mut sums = Self {
            information,
            observed: information,
            gradient,
            support: 0.0,
            squares: 0.0,
            log_likelihood: 0.0,
            objective: 0.0,
            inliers: 0,
        };
        for m in measurements {
            let (error, jacobian) = path.residual(m);
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
        sums.objective = sums.log_likelihood + ln_prior;
        sums
    }
}

/// Takes in frame after frame, from the reference time outwards, beginning with the parameters'
/// covariance there.
pub(super) fn grow<P: Path<N>, const N: usize>(
    measurements: &[Measurement],
    mut path: P,
    mut covariance: SMatrix<f64, N, N>,
    prior: &Prior<N>,
    sigma_rad: f64,
) -> Option<P> {
    let mut used_before = 0;
    for _ in 0..GROWTH_STEPS {
        let mut information = SMatrix::from_diagonal(&prior.weight);
        let mut gradient = prior.pull(&path.parameters()).1;
        let mut used = 0;
        for m in measurements {
            let (error, jacobian) = path.residual(m);
            let extra = (jacobian * covariance * jacobian.transpose()).trace() / 3.0;
            if extra > PREDICTION_LIMIT * PREDICTION_LIMIT {
                continue;
            }
            used += 1;
            let own = (sigma_rad * m.sigma_scale).powi(2);
            let (right, _) = posterior(m.confidence, error.norm_squared(), own + extra);
            information += jacobian.transpose() * jacobian * (right / own);
            gradient += jacobian.transpose() * error * (right / own);
        }
        covariance = information.cholesky()?.inverse();
        let change = covariance * gradient;
        path = path.moved(&change);
        if used == used_before && change.dot(&gradient) < 1e-2 {
            break;
        }
        used_before = used;
    }
    Some(path)
}

/// Maximizes the likelihood of the mixture and estimates the noise; `None` where it does not
/// converge or the maximum is flat.
pub(super) fn settle<P: Path<N>, const N: usize>(
    measurements: &[Measurement],
    start: P,
    prior: &Prior<N>,
    noise: &NoisePrior,
) -> Option<Settled<P, N>> {
    let mut path = start;
    let mut sigma = noise.sigma_rad;
    let mut degrees = noise.degrees;
    let mut converged = false;
    let mut sums = Sums::new(measurements, &path, prior, sigma);
    for _ in 0..NOISE_ROUNDS {
        (path, sums) = climb(measurements, path, sums, prior, sigma)?;
        if converged || !noise.degrees.is_finite() {
            converged = true;
            break;
        }
        degrees = noise.degrees + (3.0 * sums.support - N as f64).max(0.0);
        let squares = noise.degrees * noise.sigma_rad.powi(2) + sums.squares;
        let next = (squares / degrees).sqrt().min(MAX_NOISE * noise.sigma_rad);
        // One more climb at the noise that is reported.
        converged = (next / sigma - 1.0).abs() < NOISE_CONVERGED;
        sigma = next;
        sums = Sums::new(measurements, &path, prior, sigma);
    }
    if !converged {
        return None;
    }
    // Student's distribution with d degrees of freedom has the variance d / (d - 2).
    let (widening, ln_noise) = match degrees {
        d if d.is_finite() => {
            let ratio = (noise.sigma_rad / sigma).powi(2);
            let ln_noise = 0.5 * noise.degrees * (ratio.ln() - ratio);
            (d / (d - 2.0).max(1.0), ln_noise)
        }
        _ => (1.0, 0.0),
    };
    Some(Settled {
        path,
        sigma_rad: sigma,
        covariance: sums.observed.cholesky()?.inverse() * widening,
        inliers: sums.inliers,
        log_likelihood: sums.log_likelihood,
        log_posterior: sums.objective,
        objective: sums.objective + ln_noise,
    })
}

/// Climbs to a maximum of the likelihood at a given noise; `None` where it does not get there.
fn climb<P: Path<N>, const N: usize>(
    measurements: &[Measurement],
    mut path: P,
    mut sums: Sums<N>,
    prior: &Prior<N>,
    sigma: f64,
) -> Option<(P, Sums<N>)> {
    let mut damping = FIRST_DAMPING;
    for _ in 0..CLIMB_STEPS {
        // What the measurements leave open has no step: no maximum either.
        let step = sums.information.cholesky()?.solve(&sums.gradient);
        if step.dot(&sums.gradient) < CONVERGED * CONVERGED {
            return Some((path, sums));
        }
        let mut damped = sums.information;
        for i in 0..N {
            damped[(i, i)] *= 1.0 + damping;
        }
        let change = damped.cholesky()?.solve(&sums.gradient);
        let next = path.moved(&change);
        let reached = Sums::new(measurements, &next, prior, sigma);
        if reached.objective > sums.objective {
            (path, sums) = (next, reached);
            damping *= 0.1;
        } else if damping > LAST_DAMPING {
            return None;
        } else {
            damping = 10.0 * damping.max(1e-6);
        }
    }
    None
}

/// The best log-likelihood of a constant spin at the noise `sigma_rad`, from these starts. Its lower
/// bound is the likelihood with all frames as outliers.
pub(super) fn ln_likelihood_of_constant(
    measurements: &[Measurement],
    starts: impl Iterator<Item = Motion>,
    sigma_rad: f64,
) -> f64 {
    let noise = NoisePrior {
        sigma_rad,
        degrees: f64::INFINITY,
    };
    let mut scratch = Vec::new();
    starts
        .filter_map(|start| settle_constant(measurements, start, &noise, &mut scratch))
        .map(|settled| settled.log_likelihood)
        .fold(ln_likelihood_of_outliers(measurements), f64::max)
}

/// The log-likelihood with all frames as outliers.
pub(super) fn ln_likelihood_of_outliers(measurements: &[Measurement]) -> f64 {
    let outlier = |m: &Measurement| {
        let p = m.confidence.clamp(CONFIDENCE_LIMIT, 1.0 - CONFIDENCE_LIMIT);
        ((1.0 - p) / ROTATION_VOLUME).ln()
    };
    measurements.iter().map(outlier).sum()
}

/// Whether these are at least half of the expected inliers.
pub(super) fn is_majority(inliers: usize, measurements: &[Measurement]) -> bool {
    let expected: f64 = measurements.iter().map(|m| m.confidence).sum();
    inliers as f64 >= 0.5 * expected
}

/// A constant spin, if most of the sequence agrees on it: another motion passes for a constant one
/// over a part of its sequence.
pub(super) fn held_by_most(
    fit: Fit,
    measurements: &[Measurement],
    max_rps: f64,
) -> Result<Fit, SpinRejection> {
    if is_majority(fit.inliers, measurements) {
        return Ok(fit);
    }
    Err(SpinRejection::NoConsensus {
        agreeing: fit.inliers,
        frames: measurements.len(),
        max_rps,
    })
}

/// From the first measurement to the last, seconds.
pub(super) fn duration(measurements: &[Measurement]) -> f64 {
    match measurements {
        [first, .., last] => last.time_s - first.time_s,
        _ => 0.0,
    }
}
