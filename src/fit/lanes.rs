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
pub(crate) type LaneSums<S, const N: usize> = Sums<N, f64x4<S>>;

impl<S: Simd, const N: usize> LaneSums<S, N> {
    /// Of nothing.
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        Self::from_zero(f64x4::splat(simd, 0.0))
    }

    /// The sums over all lanes.
    #[inline(always)]
    pub fn total(&self) -> Sums<N> {
        let sum = |lanes: &f64x4<S>| lanes.as_slice().iter().sum::<f64>();
        Sums {
            information: self
                .information
                .each_ref()
                .map(|row| row.each_ref().map(sum)),
            gradient: self.gradient.each_ref().map(sum),
            squares: sum(&self.squares),
            weights: sum(&self.weights),
        }
    }
}

/// Pixels by fours, with `K` numbers each.
#[derive(Debug)]
pub(crate) struct LanePixels<const K: usize> {
    fours: Vec<FourPixels<K>>,
    count: usize,
}

/// Four pixels, with `K` numbers each.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FourPixels<const K: usize> {
    pub numbers: [[f64; LANES]; K],
    /// 1 for each, 0 where a lane is empty.
    pub counts: [f64; LANES],
}

impl<const K: usize> FourPixels<K> {
    /// One pixel, in all lanes that follow, too, so that these are finite.
    pub fn one(numbers: &[f64; K]) -> Self {
        let mut counts = [0.0; LANES];
        counts[0] = 1.0;
        Self {
            numbers: numbers.map(|x| [x; LANES]),
            counts,
        }
    }

    /// A pixel in a lane.
    pub fn set(&mut self, lane: usize, numbers: &[f64; K]) {
        for (lanes, x) in self.numbers.iter_mut().zip(numbers) {
            lanes[lane] = *x;
        }
        self.counts[lane] = 1.0;
    }
}

impl<const K: usize> LanePixels<K> {
    /// Room for as many.
    pub fn with_capacity(pixels: usize) -> Self {
        Self {
            fours: Vec::with_capacity(pixels / LANES),
            count: 0,
        }
    }

    pub fn len(&self) -> usize {
        self.count
    }

    pub fn fours(&self) -> &[FourPixels<K>] {
        &self.fours
    }

    /// The numbers of each pixel.
    pub fn each(&self) -> impl Iterator<Item = [f64; K]> {
        let of = |k: usize| self.fours[k / LANES].numbers.map(|lanes| lanes[k % LANES]);
        (0..self.count).map(of)
    }

    pub fn clear(&mut self) {
        self.fours.clear();
        self.count = 0;
    }

    pub fn push(&mut self, numbers: &[f64; K]) {
        let lane = self.count % LANES;
        match self.fours.last_mut().filter(|_| lane > 0) {
            Some(four) => four.set(lane, numbers),
            None => self.fours.push(FourPixels::one(numbers)),
        }
        self.count += 1;
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
