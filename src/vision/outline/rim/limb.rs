//! The light of the limb: what the surface shows at a depth within the outline, blurred as a whole.
//!
//! At `x` pixels within the outline of a ball of `r` pixels the surface faces the camera by `z = sqrt(2 x / r - (x / r)^2)`. It is lit
//! like `1`, `z` and `z^2` with unknown shares, and of a lacquered or a plastic ball less light leaves at grazing angles, as
//! `1 - p (1 - z)^5` (C. Schlick, "An Inexpensive BRDF Model for Physically-based Rendering", Computer Graphics Forum 13, 1994). Of the blurred
//! light the derivative by the blur's deviation `s` is `s` times the second one by `x` (the heat equation).

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f64x4};

use crate::fit::LANES;

/// How the light goes with the facing: `1`, `z`, `z^2`.
pub(super) const TERMS: usize = 3;
/// Values of a depth: the terms, their first and second derivatives, and those by the darkening.
const VALUES: usize = 4 * TERMS;
/// Depths by a deviation of the blur.
const FINE: f64 = 8.0;
/// The blur reaches so many deviations.
const REACH: f64 = 4.5;
/// Depths of a table, at most.
const MAX_DEPTHS: usize = 768;
const KERNEL: usize = 2 * (REACH * FINE) as usize + 1;

/// The limb's light by depth.
#[derive(Debug)]
pub(super) struct LimbTable {
    /// From this depth on, pixels, in steps of that.
    first: f64,
    step: f64,
    depths: Vec<[f64; VALUES]>,
    /// The terms before they are blurred, and how they are darkened.
    sharp: Vec<[f64; 2 * TERMS]>,
    kernel: [f64; KERNEL],
}

impl Default for LimbTable {
    fn default() -> Self {
        let at = |k: usize| (k as f64 - REACH * FINE) / FINE;
        let mut kernel = std::array::from_fn(|k| (-0.5 * at(k) * at(k)).exp());
        let sum: f64 = kernel.iter().sum();
        kernel.iter_mut().for_each(|weight| *weight /= sum);
        Self {
            first: 0.0,
            step: 1.0,
            depths: Vec::with_capacity(MAX_DEPTHS),
            sharp: Vec::with_capacity(MAX_DEPTHS + KERNEL),
            kernel,
        }
    }
}

/// Of each lane: the terms, their derivatives by depth and by blur, and by the darkening.
pub(super) struct LimbLight<S: Simd> {
    pub terms: [f64x4<S>; TERMS],
    pub by_depth: [f64x4<S>; TERMS],
    pub by_blur: [f64x4<S>; TERMS],
    pub by_darkening: [f64x4<S>; TERMS],
}

impl LimbTable {
    /// Makes the table for a ball of a radius, a blur's deviation (pixels) and a darkening, from one depth to another.
    pub fn make(&mut self, radius: f64, blur: f64, darkening: f64, [from, to]: [f64; 2]) {
        let step = (blur / FINE).max((to - from) / (MAX_DEPTHS - 4) as f64);
        // The edge lies on a depth of the table.
        let before = (-from / step).ceil() as usize + 1;
        let count = (before + (to / step).ceil() as usize + 2).min(MAX_DEPTHS);
        (self.first, self.step) = (-(before as f64) * step, step);
        let half = KERNEL / 2;
        let edge = before + half;
        self.sharp.clear();
        self.sharp.extend((0..count + 2 * half).map(|k| {
            let depth = (k as f64 - edge as f64) * step / radius;
            let share = match k.cmp(&edge) {
                std::cmp::Ordering::Less => return [0.0; 2 * TERMS],
                std::cmp::Ordering::Equal => 0.5,
                std::cmp::Ordering::Greater => 1.0,
            };
            let z = ((2.0 - depth) * depth).clamp(0.0, 1.0).sqrt();
            let grazing = (1.0 - z).powi(5);
            let kept = share * (1.0 - darkening * grazing);
            let lost = -share * grazing;
            [kept, kept * z, kept * z * z, lost, lost * z, lost * z * z]
        }));
        self.depths.clear();
        for k in 0..count {
            let mut blurred = [0.0; 2 * TERMS];
            for (sharp, weight) in self.sharp[k..].iter().zip(&self.kernel) {
                for (sum, value) in blurred.iter_mut().zip(sharp) {
                    *sum += weight * value;
                }
            }
            let mut values = [0.0; VALUES];
            values[..TERMS].copy_from_slice(&blurred[..TERMS]);
            values[3 * TERMS..].copy_from_slice(&blurred[TERMS..]);
            self.depths.push(values);
        }
        self.derive(blur);
    }

    /// Fills in the derivatives.
    fn derive(&mut self, blur: f64) {
        let last = self.depths.len() - 1;
        for k in 0..=last {
            // Beyond the ends all is straight.
            let at = k.clamp(1, last - 1);
            for term in 0..TERMS {
                let [before, here, after] = [at - 1, at, at + 1].map(|k| self.depths[k][term]);
                self.depths[k][TERMS + term] = (after - before) / (2.0 * self.step);
                let bend = (after - 2.0 * here + before) / (self.step * self.step);
                self.depths[k][2 * TERMS + term] = blur * bend;
            }
        }
    }

    /// The light at depths, pixels; that of the ends beyond them.
    #[inline(always)]
    pub fn at<S: Simd>(&self, depth: f64x4<S>) -> LimbLight<S> {
        let simd = depth.simd;
        let last = (self.depths.len() - 2) as f64;
        let place = ((depth - self.first) * self.step.recip())
            .max(0.0)
            .min(last);
        let mut near: [[f64; LANES]; VALUES] = [[0.0; LANES]; VALUES];
        for (lane, place) in place.as_slice().iter().enumerate() {
            let k = *place as usize;
            let share = *place - k as f64;
            let [from, to] = [&self.depths[k], &self.depths[k + 1]];
            for (value, (from, to)) in near.iter_mut().zip(from.iter().zip(to)) {
                value[lane] = from + share * (to - from);
            }
        }
        let part = |from: usize| {
            std::array::from_fn(|term| f64x4::simd_from(simd, near[from * TERMS + term]))
        };
        LimbLight {
            terms: part(0),
            by_depth: part(1),
            by_blur: part(2),
            by_darkening: part(3),
        }
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;
    use crate::stats::normal_cdf_and_density;

    #[inline(always)]
    fn read<S: Simd>(simd: S, table: &LimbTable, depth: f64) -> [[f64; TERMS]; 4] {
        let light = table.at(f64x4::splat(simd, depth));
        let first = |of: [f64x4<S>; TERMS]| of.map(|lanes| lanes.as_slice()[0]);
        [
            first(light.terms),
            first(light.by_depth),
            first(light.by_blur),
            first(light.by_darkening),
        ]
    }

    fn at(table: &LimbTable, depth: f64) -> [[f64; TERMS]; 4] {
        dispatch!(Level::new(), simd => read(simd, table, depth))
    }

    #[test]
    fn an_even_limb_is_the_normal_distribution() {
        let mut table = LimbTable::default();
        table.make(60.0, 1.3, 0.0, [-5.0, 8.0]);
        for k in -40..60 {
            let depth = 0.1 * f64::from(k);
            let (covered, density) = normal_cdf_and_density(depth / 1.3);
            let [terms, by_depth, by_blur, _] = at(&table, depth);
            assert!((terms[0] - covered).abs() < 2e-3, "{depth}");
            assert!((by_depth[0] - density / 1.3).abs() < 3e-3, "{depth}");
            let expected = -depth / (1.3 * 1.3) * density;
            assert!((by_blur[0] - expected).abs() < 6e-3, "{depth}");
        }
    }

    #[test]
    fn derivatives_are_those_of_the_light() {
        let make = |blur: f64, darkening: f64| {
            let mut table = LimbTable::default();
            table.make(45.0, blur, darkening, [-4.0, 7.0]);
            table
        };
        let (blur, darkening, step) = (0.9, 0.4, 1e-2);
        let table = make(blur, darkening);
        let [less, more] = [-step, step].map(|d| make(blur + d, darkening));
        let [brighter, darker] = [-step, step].map(|d| make(blur, darkening + d));
        for depth in [-1.5, -0.4, 0.0, 0.7, 1.9, 5.0] {
            let [_, by_depth, by_blur, by_darkening] = at(&table, depth);
            for term in 0..TERMS {
                let slope = |a: &LimbTable, b: &LimbTable, d: f64| {
                    (at(b, depth + d)[0][term] - at(a, depth - d)[0][term]) / (2.0 * step)
                };
                assert!((slope(&table, &table, step) - by_depth[term]).abs() < 6e-3);
                assert!((slope(&less, &more, 0.0) - by_blur[term]).abs() < 1e-2);
                assert!((slope(&brighter, &darker, 0.0) - by_darkening[term]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_grazing_surface_is_darker() {
        let mut table = LimbTable::default();
        table.make(100.0, 0.5, 1.0, [-3.0, 9.0]);
        let [terms, ..] = at(&table, 1.5);
        let z = (2.0f64 * 0.015 - 0.015 * 0.015).sqrt();
        assert!((terms[0] - (1.0 - (1.0 - z).powi(5))).abs() < 0.03);
    }
}
