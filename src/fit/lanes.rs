//! Normal equations of pixels, four at a time.
//!
//! Code above is compiled for every SIMD level that `fearless_simd` knows and chosen at run time. Nothing is fused, so that all levels
//! give the same numbers.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f64x4};

use super::Sums;
use crate::stats::{TAIL, TAIL_SCALE};

/// Pixels at a time.
pub(crate) const LANES: usize = 4;

/// [`Sums`] over pixels, each lane its own.
pub(crate) struct LaneSums<S: Simd, const N: usize> {
    information: [[f64x4<S>; N]; N],
    gradient: [f64x4<S>; N],
    squares: f64x4<S>,
    weights: f64x4<S>,
}

impl<S: Simd, const N: usize> LaneSums<S, N> {
    /// Of nothing.
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let zero = f64x4::splat(simd, 0.0);
        Self {
            information: [[zero; N]; N],
            gradient: [zero; N],
            squares: zero,
            weights: zero,
        }
    }

    /// Adds a pixel in each lane.
    #[inline(always)]
    pub fn add(&mut self, by: &[f64x4<S>; N], residual: f64x4<S>, weight: f64x4<S>) {
        for (k, row) in self.information.iter_mut().enumerate() {
            let weighted = weight * by[k];
            for (cell, other) in row[..=k].iter_mut().zip(by) {
                *cell += weighted * *other;
            }
            self.gradient[k] += weighted * residual;
        }
        self.squares += weight * residual * residual;
        self.weights += weight;
    }

    /// The sums over all lanes.
    #[inline(always)]
    pub fn total(&self) -> Sums<N> {
        let sum = |lanes: &f64x4<S>| lanes.as_slice().iter().sum::<f64>();
        Sums {
            information: std::array::from_fn(|k| {
                std::array::from_fn(|i| sum(&self.information[k][i]))
            }),
            gradient: std::array::from_fn(|k| sum(&self.gradient[k])),
            squares: sum(&self.squares),
            weights: sum(&self.weights),
        }
    }
}

/// Beyond so many standard deviations the distribution is taken for flat.
const FARTHEST: f64 = 6.0;
/// The exponential's argument is divided by two to this power, and its value squared as often.
const SQUARINGS: usize = 6;

/// [`normal_cdf_and_density`](crate::stats::normal_cdf_and_density) of each lane; of what lies farther off than 6, that at 6.
#[inline(always)]
pub(crate) fn normal_cdf_and_density<S: Simd>(x: f64x4<S>) -> [f64x4<S>; 2] {
    let x = x.max(-FARTHEST).min(FARTHEST);
    // exp(-x^2 / 2) by nine terms of the exponential's series.
    let small = x * x * (-0.5 / f64::from(1 << SQUARINGS));
    let mut power = small * (1.0 / 9.0) + 1.0;
    for k in (1..9).rev() {
        power = power * small * (1.0 / f64::from(k)) + 1.0;
    }
    for _ in 0..SQUARINGS {
        power *= power;
    }
    let density = power * std::f64::consts::TAU.sqrt().recip();
    let t = f64x4::splat(x.simd, 1.0) / (x.abs() * TAIL_SCALE + 1.0);
    let mut sum = t * TAIL[0] + TAIL[1];
    for term in &TAIL[2..] {
        sum = sum * t + *term;
    }
    let beyond = density * t * sum;
    let covered = x.simd_lt(0.0).select(beyond, -beyond + 1.0);
    [covered, density]
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;
    use crate::stats;

    #[inline(always)]
    fn at<S: Simd>(simd: S, x: [f64; LANES]) -> [[f64; LANES]; 2] {
        normal_cdf_and_density(f64x4::simd_from(simd, x)).map(Into::into)
    }

    #[test]
    fn lanes_are_the_normal_distribution() {
        for level in [Level::new(), Level::baseline()] {
            for k in -140..140 {
                let x: [f64; LANES] =
                    std::array::from_fn(|i| 0.05 * f64::from(k) + 0.0125 * i as f64);
                let [covered, density] = dispatch!(level, simd => at(simd, x));
                for i in 0..LANES {
                    let (p, d) = stats::normal_cdf_and_density(x[i].clamp(-6.0, 6.0));
                    assert!((covered[i] - p).abs() < 1e-10, "{}", x[i]);
                    assert!((density[i] - d).abs() < 1e-10, "{}", x[i]);
                }
            }
        }
    }

    #[inline(always)]
    fn summed<S: Simd>(simd: S, pixels: &[[f64; 5]]) -> Sums<3> {
        let mut sums = LaneSums::<S, 3>::new(simd);
        for four in pixels.chunks_exact(LANES) {
            let [a, b, c, residual, weight] =
                std::array::from_fn(|k| f64x4::from_fn(simd, |lane| four[lane][k]));
            sums.add(&[a, b, c], residual, weight);
        }
        sums.total()
    }

    #[test]
    fn lanes_sum_as_pixels_one_by_one() {
        let pixels: Vec<[f64; 5]> = (0..64)
            .map(|k| {
                std::array::from_fn(|i| ((k * 5 + i) as f64).sin() + if i == 4 { 2.0 } else { 0.0 })
            })
            .collect();
        let found = dispatch!(Level::new(), simd => summed(simd, &pixels));
        let mut expected = Sums::<3>::default();
        for [a, b, c, residual, weight] in &pixels {
            expected.add(&[*a, *b, *c], *residual, *weight);
        }
        assert!((found.symmetric() - expected.symmetric()).norm() < 1e-12);
        assert!((found.gradient[2] - expected.gradient[2]).abs() < 1e-12);
        assert!((found.scatter() - expected.scatter()).abs() < 1e-12);
    }
}
