//! Points of a standard normal distribution in three dimensions, in opposite pairs: the additive
//! recurrence of M. Roberts' R3 sequence ("The unreasonable effectiveness of quasirandom sequences",
//! 2018), taken to directions and to quantiles of the radius. The same number gives the same bits.
//!
//! ```text
//! (u, v, w)_k = 1/2 + k (1/g, 1/g^2, 1/g^3) mod 1,   g^4 = g + 1
//! ```

use std::f64::consts::{PI, SQRT_2, TAU};

use crate::geometry::Vec3;

/// The root of x^4 = x + 1.
const ROOT: f64 = 1.220_744_084_605_759_5;

/// The first points.
pub(super) fn normal_nodes<const N: usize>() -> [Vec3; N] {
    let steps = [ROOT.recip(), ROOT.powi(-2), ROOT.powi(-3)];
    std::array::from_fn(|k| {
        let [u, v, w] = steps.map(|step| (0.5 + step * (k / 2 + 1) as f64).fract());
        let z = 2.0 * v - 1.0;
        let across = (1.0 - z * z).max(0.0).sqrt();
        let (s, c) = (TAU * w).sin_cos();
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        Vec3::new(across * c, across * s, z) * (sign * chi_quantile(u))
    })
}

/// The radius within which a share `u` of a standard normal distribution in three dimensions lies, by
/// bisection.
fn chi_quantile(u: f64) -> f64 {
    let within = |r: f64| libm::erf(r / SQRT_2) - (2.0 / PI).sqrt() * r * (-0.5 * r * r).exp();
    let (mut low, mut high) = (0.0, 10.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if within(middle) < u {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn the_nodes_have_the_moments_of_the_normal_distribution() {
        let nodes: [Vec3; 512] = normal_nodes();
        let mean: Vec3 = nodes.iter().sum::<Vec3>() / 512.0;
        assert!(mean.norm() < 1e-12, "{mean}");
        let covariance: Matrix3<f64> = nodes
            .iter()
            .map(|x| x * x.transpose())
            .sum::<Matrix3<f64>>()
            / 512.0;
        assert!(
            (covariance - Matrix3::identity()).norm() < 0.05,
            "{covariance}"
        );
    }
}
