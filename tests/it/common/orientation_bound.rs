//! Bound on the orientation error of given dots with known correspondences: what recognizers are
//! measured against, in tests and studies alike.
//!
//! A small rotation `w` (camera frame) moves a dot at `q` by `w x q`. Dots displaced independently
//! by noise whose components along the tangent axes `t` have the variances `s^2` give the
//! information `H = sum (q x t)(q x t)^T / s^2`, and `H^-1` is the covariance of the least-squares
//! estimate, which for Gaussian noise is the Cramér-Rao bound. The expected error is that of
//! `e ~ N(0, H^-1)`:
//!
//! ```text
//! E|e| = 1/sqrt(pi) int_0^inf (1 - prod_i (1 + 2 s^2 l_i)^(-1/2)) / s^2 ds,   l_i eigenvalues of H^-1
//! ```
//!
//! For a rotation about a random axis ([`Noise::RandomAxis`]) the displacement's density has a pole
//! at 0: its Fisher information is infinite and a Cramér-Rao bound in the strict sense does not
//! exist. The bound here is then that of Gaussian noise of the same covariance, `sigma^2 / 3` per
//! tangent axis: what least squares attains, and what an estimator that knows the density can beat.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Matrix3;

use spindoe::geometry::{Vec3, tangent_frame};
use spindoe::pattern::Pattern;
use spindoe::view::{Noise, Trial};

/// Nodes of the quadrature; the error is below 1e-6 of the result.
const NODES: usize = 400;

/// Information about the orientation, 1/rad^2, camera frame, in dots whose true directions are
/// given.
pub fn orientation_information(directions: &[Vec3], noise: &Noise) -> Matrix3<f64> {
    let mut information = Matrix3::zeros();
    for q in directions {
        let ([a, b], sigma) = match *noise {
            Noise::RandomAxis { .. } | Noise::HeavyTailed { .. } => {
                (tangent_frame(q), noise.tangent_sigma_rad())
            }
            // The image coordinates themselves are what is measured: orthographic x and y.
            Noise::Pixel {
                sigma_px,
                radius_px,
            } => ([Vec3::x(), Vec3::y()], sigma_px / radius_px),
        };
        for axis in [a, b] {
            let row = q.cross(&axis) / sigma;
            information += row * row.transpose();
        }
    }
    information
}

/// Expected length of a normal vector with this covariance; `None` where that is not positive
/// definite.
pub fn mean_length(covariance: &Matrix3<f64>) -> Option<f64> {
    let eigenvalues = covariance.symmetric_eigenvalues();
    let largest = eigenvalues.max();
    if !(eigenvalues.min() > 0.0 && largest.is_finite()) {
        return None;
    }
    // s = tan(t) / sqrt(2 largest) makes both ends of the integral finite.
    let scale = (2.0 * largest).sqrt().recip();
    let sum: f64 = (0..NODES)
        .map(|k| {
            let t = (k as f64 + 0.5) * FRAC_PI_2 / NODES as f64;
            let s = scale * t.tan();
            let product: f64 = eigenvalues.iter().map(|l| 1.0 + 2.0 * s * s * l).product();
            (1.0 - product.sqrt().recip()) / (s * s) * scale / t.cos().powi(2)
        })
        .sum();
    Some(sum * FRAC_PI_2 / NODES as f64 / PI.sqrt())
}

/// The expected orientation error of a trial (radians) if its real dots' identities were known;
/// `None` where they do not determine the orientation.
pub fn expected_error(pattern: &Pattern, trial: &Trial, noise: &Noise) -> Option<f64> {
    let real = trial.truth.iter().flatten();
    let directions: Vec<Vec3> = real
        .map(|&j| trial.rotation * pattern.dots()[usize::from(j)])
        .collect();
    let information = orientation_information(&directions, noise);
    mean_length(&information.cholesky()?.inverse())
}
