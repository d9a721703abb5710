//! What a residual counts for.

#[cfg(feature = "vision")]
use fearless_simd::prelude::*;
#[cfg(feature = "vision")]
use fearless_simd::{Simd, f64x4};

use crate::stats::SIGMA_PER_MAD;

/// Student's distribution of residuals: errors with heavy tails (K. Lange et al., "Robust statistical modeling using the t distribution",
/// JASA 84, 1989).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Student {
    degrees: f64,
    dimension: f64,
}

impl Student {
    /// With so many degrees of freedom, of residuals of so many dimensions.
    pub const fn new(degrees: u32, dimension: u32) -> Self {
        Self {
            degrees: degrees as f64,
            dimension: dimension as f64,
        }
    }

    /// The weight of a residual by the square of its length, in standard deviations.
    pub fn weight(&self, square: f64) -> f64 {
        (self.degrees + self.dimension) / (self.degrees + square)
    }

    /// [`Student::weight`] of each lane.
    #[cfg(feature = "vision")]
    #[inline(always)]
    pub fn weight_each<S: Simd>(&self, square: f64x4<S>) -> f64x4<S> {
        f64x4::splat(square.simd, self.degrees + self.dimension) / (square + self.degrees)
    }

    /// Minus two logarithms of a residual's likelihood over that of none.
    pub fn cost(&self, square: f64) -> f64 {
        (self.degrees + self.dimension) * (1.0 + square / self.degrees).ln()
    }

    /// The information of a residual over what its weight says, on average (Lange et al., Appendix B).
    pub const fn information(&self) -> f64 {
        (self.degrees + self.dimension) / (self.degrees + self.dimension + 2.0)
    }
}

/// Tukey's biweight of a residual over its reach: 1 for none, 0 from the reach on.
pub(crate) fn biweight(over_reach: f64) -> f64 {
    (1.0 - over_reach * over_reach).max(0.0).powi(2)
}

/// Bins of the sizes of residuals.
const BINS: usize = 128;

/// The standard deviation of normal residuals by the median of their sizes, each counted by its weight: `[size, weight]`. 0 for none. Reorders
/// its input.
pub(crate) fn weighted_sigma(sizes: &mut [[f64; 2]]) -> f64 {
    let sum = |sizes: &[[f64; 2]]| sizes.iter().map(|s| s[1]).sum::<f64>();
    let half = 0.5 * sum(sizes);
    let mut below = 0.0;
    // The bin in which the median lies, and what it holds.
    let most = sizes.iter().fold(0.0, |most, s| f64::max(most, s[0]));
    let scale = (BINS - 1) as f64 / most;
    let bin = |size: f64| ((size * scale) as i32 as usize).min(BINS - 1);
    let mut weights = [0.0; BINS];
    sizes.iter().for_each(|s| weights[bin(s[0])] += s[1]);
    let middle = weights.iter().position(|weight| {
        let holds = below + weight >= half;
        below += if holds { 0.0 } else { *weight };
        holds
    });
    let middle = middle.unwrap_or(BINS - 1);
    let mut held = 0;
    for k in 0..sizes.len() {
        if bin(sizes[k][0]) == middle {
            sizes.swap(held, k);
            held += 1;
        }
    }
    let mut rest = &mut sizes[..held];
    // The half in which the median lies is looked through further.
    while rest.len() > 1 {
        let middle = rest.len() / 2;
        rest.select_nth_unstable_by(middle, |a, b| a[0].total_cmp(&b[0]));
        let (small, large) = std::mem::take(&mut rest).split_at_mut(middle);
        let with_small = below + sum(small);
        if with_small >= half {
            rest = small;
        } else {
            (below, rest) = (with_small, large);
        }
    }
    SIGMA_PER_MAD * rest.first().map_or(0.0, |m| m[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_weighted_median_is_that_of_sorted_sizes() {
        let number = |k: usize| (k as f64 * 0.618_034).fract();
        for count in (0..40).chain([500, 1_001]) {
            let mut sizes: Vec<[f64; 2]> = (0..count)
                .map(|k| [number(k).powi(3), number(7 * k + 3)])
                .collect();
            let mut sorted = sizes.clone();
            sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
            let half = 0.5 * sorted.iter().map(|s| s[1]).sum::<f64>();
            let mut below = 0.0;
            let middle = sorted.iter().find(|s| {
                below += s[1];
                below >= half
            });
            let expected = SIGMA_PER_MAD * middle.map_or(0.0, |m| m[0]);
            assert_eq!(weighted_sigma(&mut sizes), expected, "{count}");
        }
        assert_eq!(weighted_sigma(&mut [[0.0, 1.0]; 3]), 0.0);
    }

    #[test]
    fn a_weight_is_the_slope_of_its_cost() {
        let loss = Student::new(5, 2);
        for square in [0.0, 0.7, 4.0, 90.0] {
            let step = 1e-6;
            let slope = (loss.cost(square + step) - loss.cost(square)) / step;
            assert!((slope - loss.weight(square)).abs() < 1e-6, "{square}");
        }
    }

    /// By the integral over the distribution itself, in one dimension: `E (d ln p / de)^2`.
    #[test]
    fn the_information_is_that_of_the_distribution() {
        let loss = Student::new(4, 1);
        let (mut all, mut information, mut weights) = (0.0, 0.0, 0.0);
        for k in -200_000..200_000 {
            let e = 1e-3 * (f64::from(k) + 0.5);
            let density = (-0.5 * loss.cost(e * e)).exp();
            all += density;
            information += density * (loss.weight(e * e) * e).powi(2);
            weights += density * loss.weight(e * e);
        }
        assert!((weights / all - 1.0).abs() < 1e-3, "{}", weights / all);
        let expected = loss.information();
        assert!((information / all - expected).abs() < 1e-3, "{expected}");
    }
}
