//! Information of the visible dots about the orientation: the Cramér-Rao bound by viewing
//! direction.
//!
//! With known correspondences and Gaussian noise of sigma per tangent axis, the dots in view give the
//! information `H(v) = sum_i s_i(v) (I - p_i p_i^T)`, and no unbiased estimate of the rotation has
//! a mean squared error below `sigma^2 tr H(v)^-1` (S. M. Kay, "Fundamentals of Statistical Signal
//! Processing: Estimation Theory", 1993, eq. 3.31). The values here are for sigma = 1: root mean
//! square error in units of the dots' noise.

use nalgebra::Matrix3;

use super::evaluation::Evaluation;
use crate::geometry::{Vec3, spiral_directions};

/// Power of the mean that approximates the worst direction in the smooth cost.
const WORST_POWER: i32 = 8;

/// Which directions and dots count.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OrientationBound {
    /// Minimum z of a visible dot.
    pub visibility_limit: f64,
    /// Width in z over which a dot fades at the limit, in the smooth cost.
    pub softness: f64,
    /// Viewing directions on a spiral.
    pub views: usize,
}

impl Default for OrientationBound {
    /// Dots with z > 0, as in the `paper` protocol; 400 directions.
    fn default() -> Self {
        Self {
            visibility_limit: 0.0,
            softness: 0.04,
            views: 400,
        }
    }
}

/// The bound over all viewing directions, in units of the dots' noise.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BoundSummary {
    /// Mean over the directions of the root of `tr H^-1`.
    #[serde(deserialize_with = "crate::stats::or_infinite")]
    pub mean: f64,
    /// Its largest value.
    #[serde(deserialize_with = "crate::stats::or_infinite")]
    pub worst: f64,
}

impl OrientationBound {
    /// The root of `tr H(v)^-1` for each direction of the spiral, without fading dots;
    /// infinite where fewer than two dots are in view.
    pub fn by_direction(&self, dots: &[Vec3], views: usize) -> Vec<f64> {
        spiral_directions(views)
            .map(|v| {
                let h: Matrix3<f64> = dots
                    .iter()
                    .filter(|d| d.dot(&v) > self.visibility_limit)
                    .map(|d| Matrix3::identity() - d * d.transpose())
                    .sum();
                h.try_inverse()
                    .map_or(f64::INFINITY, |inverse| inverse.trace().sqrt())
            })
            .collect()
    }

    /// Mean and worst over 20 000 directions.
    pub fn summary(&self, dots: &[Vec3]) -> BoundSummary {
        let all = self.by_direction(dots, 20_000);
        BoundSummary {
            mean: all.iter().sum::<f64>() / all.len() as f64,
            worst: all.iter().copied().fold(0.0, f64::max),
        }
    }

    /// A smooth approximation of the worst direction: the logarithm of the power mean (exponent 8)
    /// over the directions of `sqrt(tr H^-1)`, with dots that fade at the limit.
    pub fn cost(&self, dots: &[Vec3]) -> Evaluation {
        let n = dots.len();
        let half_power = WORST_POWER / 2;
        let mut sum = 0.0;
        let mut gradient = vec![Vec3::zeros(); n];
        for v in spiral_directions(self.views) {
            let seen: Vec<f64> = dots
                .iter()
                .map(|d| 1.0 / (1.0 + (-(d.dot(&v) - self.visibility_limit) / self.softness).exp()))
                .collect();
            let h: Matrix3<f64> = dots
                .iter()
                .zip(&seen)
                .map(|(d, &s)| (Matrix3::identity() - d * d.transpose()) * s)
                .sum();
            let Some(inverse) = h.try_inverse() else {
                continue;
            };
            let trace = inverse.trace();
            sum += trace.powi(half_power);
            let slope = f64::from(half_power) * trace.powi(half_power - 1);
            let squared = inverse * inverse;
            for ((g, d), &s) in gradient.iter_mut().zip(dots).zip(&seen) {
                let by_seen = -(squared.trace() - d.dot(&(squared * d)));
                let by_z = by_seen * s * (1.0 - s) / self.softness;
                *g += slope * (by_z * v + 2.0 * s * (squared * d));
            }
        }
        let power = f64::from(WORST_POWER);
        gradient.iter_mut().for_each(|g| *g /= power * sum);
        Evaluation {
            value: (sum / self.views as f64).ln() / power,
            gradient,
        }
    }
}
