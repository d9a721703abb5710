//! The Cramér-Rao bound: the minimum covariance that any unbiased estimate of the spin can have.
//!
//! With the model of [`spindoe::spin::robust`] and known outliers, the Fisher information of (R0, w) from
//! inliers at times `t_k` with noise `sigma_k` per axis separates like the normal equations. Along
//! the axis it is that of a straight line,
//!
//! ```text
//! var(w_along) = 1 / sum_k (t_k - mean)^2 / sigma_k^2
//! ```
//!
//! and for each of the two components across it, with `E_k = exp(i theta_k)` and
//! `g_k = t_k (E_k - 1) / (i theta_k)`, `theta_k = |w| t_k`,
//!
//! ```text
//! var(w_across) = S00 / (S00 S11 - |S01|^2),  S00 = sum 1/sigma_k^2,  S01 = sum conj(E_k) g_k / sigma_k^2,
//!                                             S11 = sum |g_k|^2 / sigma_k^2
//! ```
//!
//! (S. M. Kay, "Fundamentals of Statistical Signal Processing: Estimation Theory", 1993, eq. 3.31,
//! for Gaussian noise). Noise of a few degrees is small enough that the curvature of SO(3) changes
//! this by `sigma^2 / 12`, a ten-thousandth.

use nalgebra::Complex;
use spindoe::geometry::Vec3;
use spindoe::spin::Measurement;

/// Steps of the quadrature for [`SpinBound::probability_within`]; Simpson's rule is then exact to
/// 1e-9.
const QUADRATURE_STEPS: usize = 256;

/// A determinant below this share of what frames in all phases of a turn would give counts as 0:
/// the turns between the frames are whole to within a millionth of their angle.
const MIN_DETERMINANT: f64 = 1e-12;

/// The bound on a spin's covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpinBound {
    /// Standard deviation along the axis (of the magnitude), rad/s.
    pub along_rad_s: f64,
    /// Standard deviation of each of the two components across the axis, rad/s.
    pub across_rad_s: f64,
}

impl SpinBound {
    /// The bound for inliers at `times_s` (seconds) with noise `sigmas_rad` per axis (radians).
    /// `None` where they do not determine the spin: fewer than two, or only full turns between all
    /// of them. Then any spin about another axis with as many turns is as good.
    pub fn new(spin: &Vec3, times_s: &[f64], sigmas_rad: &[f64]) -> Option<Self> {
        let rate = spin.norm();
        let (mut s, mut st, mut stt) = (0.0, 0.0, 0.0);
        let (mut c01, mut c11) = (Complex::new(0.0, 0.0), 0.0);
        let origin = *times_s.first()?;
        for (time, sigma) in times_s.iter().zip(sigmas_rad) {
            let t = time - origin;
            let w = 1.0 / (sigma * sigma);
            let half = 0.5 * rate * t;
            // g = t sinc(half) exp(i half): the same as above, without cancellation.
            let sinc = if half.abs() < 1e-8 {
                1.0
            } else {
                half.sin() / half
            };
            let g = Complex::from_polar(t * sinc, half);
            let turn = Complex::from_polar(1.0, 2.0 * half);
            s += w;
            st += w * t;
            stt += w * t * t;
            c01 += turn.conj() * g * w;
            c11 += g.norm_sqr() * w;
        }
        let det_along = s * stt - st * st;
        let det_across = s * c11 - c01.norm_sqr();
        let open = MIN_DETERMINANT * s * stt;
        // Not `<=`: it would let a NaN pass.
        let determined = det_along > open && det_across > open;
        if !determined {
            return None;
        }
        let (along, across) = (s / det_along, s / det_across);
        let valid = |v: f64| v.is_finite() && v > 0.0;
        (valid(along) && valid(across)).then(|| Self {
            along_rad_s: along.sqrt(),
            across_rad_s: across.sqrt(),
        })
    }

    /// The bound for the measurements chosen by `right`, with `sigma_rad` times their noise scales.
    pub fn of(
        spin: &Vec3,
        measurements: &[Measurement],
        sigma_rad: f64,
        right: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let chosen = || measurements.iter().enumerate().filter(|(i, _)| right(*i));
        let times: Vec<f64> = chosen().map(|(_, m)| m.time_s).collect();
        let sigmas: Vec<f64> = chosen().map(|(_, m)| sigma_rad * m.sigma_scale).collect();
        Self::new(spin, &times, &sigmas)
    }

    /// Expected squared length of the error, (rad/s)^2.
    pub fn mean_square(&self) -> f64 {
        self.along_rad_s.powi(2) + 2.0 * self.across_rad_s.powi(2)
    }

    /// Probability that a Gaussian error with this covariance is shorter than `radius` (rad/s).
    ///
    /// The two components across the axis have a Rayleigh distribution, which leaves one integral:
    /// `int N(x; 0, along^2) (1 - exp(-(radius^2 - x^2) / (2 across^2))) dx` over |x| < radius,
    /// done by Simpson's rule with `x = radius sin u`.
    pub fn probability_within(&self, radius: f64) -> f64 {
        let integrand = |u: f64| {
            let (x, c) = (radius * u.sin(), radius * u.cos());
            let z = x / self.along_rad_s;
            let normal = (-0.5 * z * z).exp() / (self.along_rad_s * std::f64::consts::TAU.sqrt());
            normal * -(-0.5 * (c / self.across_rad_s).powi(2)).exp_m1() * c
        };
        // Beyond nine standard deviations there is nothing; do not spend nodes there.
        let reach = (9.0 * self.along_rad_s / radius).min(1.0).asin();
        let step = 2.0 * reach / QUADRATURE_STEPS as f64;
        let sum: f64 = (0..=QUADRATURE_STEPS)
            .map(|i| {
                let weight = match i {
                    0 | QUADRATURE_STEPS => 1.0,
                    i if i % 2 == 1 => 4.0,
                    _ => 2.0,
                };
                weight * integrand(-reach + i as f64 * step)
            })
            .sum();
        (sum * step / 3.0).clamp(0.0, 1.0)
    }
}
