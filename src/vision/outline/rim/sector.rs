//! A piece of the rim: where its edge lies, by its pixels.

use std::sync::LazyLock;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f64x4};
use nalgebra::{SVector, Vector2};

use super::{MAX_CHANGE, SECTORS};
use crate::fit::{FourPixels, LANES, LanePixels, LaneSums, Sums, normal_cdf_and_density};
use crate::geometry::Vec3;
use crate::stats;
use crate::vision::optics::camera::{BallView, Pixel};

/// Fewer pixels say nothing of a sector.
pub(super) const MIN_PIXELS: usize = 12;
/// Steps of a sector's fit.
pub(super) const STEPS: usize = 3;
/// The blur's standard deviation, of that of the dots.
pub(super) const BLUR_SPREAD: f64 = 0.1;
/// Standard deviation of a sector's place beyond what its pixels say, pixels: what is behind the ball is not even.
pub(super) const SECTOR_ERROR: f64 = 0.03;
/// A sector that is known worse says nothing, pixels.
pub(super) const MAX_SECTOR_ERROR: f64 = 0.6;
/// The least variance of a sector's values.
pub(super) const LEAST_VARIANCE: f64 = 1e-8;
/// Background, step, shading, place and blur.
pub(super) const UNKNOWNS: usize = 5;

/// Added to the tone curve's slope where a pixel is weighed: a small slope is not known well.
const SOFT_SLOPE: f64 = 0.1;
/// The least slope of a curve whose likelihood is compared with another's.
const LEAST_SLOPE: f64 = 0.02;
/// Capacity for pixels of a sector beforehand.
pub(super) const EXPECTED_PIXELS: usize = 192;

/// The pixels near a sector's rim: how many pixels each lies within the outline, and its value.
pub(super) type RimPixels = LanePixels<2>;

/// Minus two ln of how much larger the density of a sector's values is than that of their lights, as they are weighed: the noise is the values'.
pub(super) fn density_cost(pixels: &RimPixels, bend: f64) -> f64 {
    let cost = |four: &FourPixels<2>| {
        let ratio = |lane: usize| {
            let slope = 1.0 - bend + 2.0 * bend * four.numbers[1][lane];
            1.0 + four.counts[lane] * ((slope + SOFT_SLOPE) / slope.max(LEAST_SLOPE) - 1.0)
        };
        2.0 * (0..LANES).map(ratio).product::<f64>().ln()
    };
    pixels.fours().iter().map(cost).sum()
}

/// Lights and weights of pixels where the tone curve has this bend.
#[inline(always)]
fn light_and_weight<S: Simd>(simd: S, four: &FourPixels<2>, bend: f64) -> [f64x4<S>; 2] {
    let value = f64x4::simd_from(simd, four.numbers[1]);
    let soft = value * (2.0 * bend) + (1.0 - bend + SOFT_SLOPE);
    let weight = f64x4::simd_from(simd, four.counts) / (soft * soft);
    [(value * bend + (1.0 - bend)) * value, weight]
}

/// Tangents of the sectors' borders in an octant.
const BORDERS: [f64; 3] = [
    0.198_912_367_379_658,
    0.414_213_562_373_095,
    0.668_178_637_919_299,
];
const _: () = assert!(SECTORS == 8 * (BORDERS.len() + 1));

/// The sector of a place of the view frame.
pub(super) fn sector_of(at: &Vector2<f64>) -> usize {
    let (quadrant, x, y) = match (at.x > 0.0, at.y >= 0.0) {
        (true, true) => (0, at.x, at.y),
        (false, true) => (1, at.y, -at.x),
        (false, false) => (2, -at.x, -at.y),
        (true, false) => (3, -at.y, at.x),
    };
    let passed = |x: f64, y: f64| BORDERS.iter().filter(|b| y >= *b * x).count();
    let within = match y <= x {
        true => passed(x, y),
        false => SECTORS / 4 - 1 - passed(y, x),
    };
    quadrant * (SECTORS / 4) + within
}

/// A piece of the rim.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sector {
    /// Outwards, unit vector in the image.
    pub(super) normal: Vector2<f64>,
    /// Ball radii along a pixel.
    pub(super) scale: f64,
}

/// Where a sector's rim is: pixels beyond the outline, and its variance.
pub(super) type Place = Option<(f64, f64)>;

/// The piece of the rim at an angle of the view frame.
pub(super) fn sector_at(view: &BallView, angle: f64) -> Option<Sector> {
    let out = (1.0 - view.horizon().powi(2)).sqrt();
    let at = view.project(&Vec3::new(
        out * angle.cos(),
        out * angle.sin(),
        view.horizon(),
    ));
    let radii = |du: f64, dv: f64| {
        let pixel = Pixel {
            u: at.u + du,
            v: at.v + dv,
        };
        view.aside(pixel).norm()
    };
    let by_pixel = Vector2::new(
        radii(0.5, 0.0) - radii(-0.5, 0.0),
        radii(0.0, 0.5) - radii(0.0, -0.5),
    );
    let scale = by_pixel.norm();
    (scale > 0.0).then(|| Sector {
        normal: by_pixel / scale,
        scale,
    })
}

/// What light there is about a sector's rim.
#[derive(Debug, Clone, Copy)]
pub(super) struct Profile {
    /// Behind the ball, the step to the ball, and the shading.
    pub(super) light: [f64; 3],
    /// Pixels beyond the outline.
    pub(super) at: f64,
    pub(super) blur: f64,
}

impl Profile {
    /// The light of pixels, and its derivatives.
    #[inline(always)]
    fn shown<S: Simd>(&self, within: f64x4<S>) -> (f64x4<S>, [f64x4<S>; UNKNOWNS]) {
        let [behind, step, shading] = self.light;
        let depth = (within + self.at) / self.blur;
        let [covered, density] = normal_cdf_and_density(depth);
        let unit = self.blur.sqrt();
        let [root, by_depth] = blurred_roots(depth.into());
        let root = f64x4::simd_from(depth.simd, root) * unit;
        let by_depth = density * step + f64x4::simd_from(depth.simd, by_depth) * (shading * unit);
        let by_blur = (root * (0.5 * shading) - by_depth * depth) / self.blur;
        let one = f64x4::splat(depth.simd, 1.0);
        let by = [one, covered, root, by_depth / self.blur, by_blur];
        (covered * step + root * shading + behind, by)
    }
}

/// The sums over a sector's pixels.
#[inline(always)]
pub(super) fn sums<S: Simd>(
    simd: S,
    pixels: &RimPixels,
    profile: &Profile,
    bend: f64,
) -> Sums<UNKNOWNS> {
    let mut sums = LaneSums::new(simd);
    for four in pixels.fours() {
        let [light, weight] = light_and_weight(simd, four, bend);
        let (shown, by) = profile.shown(f64x4::simd_from(simd, four.numbers[0]));
        sums.add(&by, light - shown, weight);
    }
    sums.total()
}

/// Where the rim is in a sector whose pixels' tone curve has this bend, and the weighted squares that its light leaves.
pub(super) fn place(level: Level, pixels: &RimPixels, blur: f64, bend: f64) -> (Place, f64) {
    let mut squares = 0.0;
    let found = place_with(level, pixels, blur, bend, &mut squares);
    (found, squares)
}

fn place_with(level: Level, pixels: &RimPixels, blur: f64, bend: f64, squares: &mut f64) -> Place {
    if pixels.len() < MIN_PIXELS {
        return None;
    }
    let mut profile = Profile {
        light: [0.0; 3],
        at: 0.0,
        blur,
    };
    let mut last = None;
    for round in 0..=STEPS {
        let sums = dispatch!(level, simd => sums(simd, pixels, &profile, bend));
        *squares = sums.squares;
        let variance = (sums.squares / (pixels.len() - UNKNOWNS) as f64).max(LEAST_VARIANCE);
        let mut information = sums.symmetric();
        let mut gradient = SVector::from(sums.gradient);
        if round == 0 {
            // At first the light alone.
            (3..UNKNOWNS).for_each(|k| information[(k, k)] += 1e9 * sums.weights);
        }
        // Shading is weakly bound: where it is not seen it is none.
        information[(2, 2)] += 1e-3 * sums.weights / pixels.len() as f64;
        let known = variance / (BLUR_SPREAD * blur).powi(2);
        information[(4, 4)] += known;
        gradient[4] += known * (blur - profile.blur);
        let factor = information.cholesky()?;
        let change = factor.solve(&gradient);
        if round == STEPS {
            last = Some(factor.inverse()[(3, 3)] * variance);
        }
        for (value, by) in profile.light.iter_mut().zip(change.iter()) {
            *value += by;
        }
        profile.at += change[3].clamp(-0.7, 0.7);
        profile.blur = (profile.blur + change[4]).clamp(0.5 * blur, 2.0 * blur);
    }
    let (at, variance) = (profile.at, last?);
    let is_clear = at.abs() < MAX_CHANGE + 0.5 && variance < MAX_SECTOR_ERROR * MAX_SECTOR_ERROR;
    is_clear.then_some((at, variance + SECTOR_ERROR * SECTOR_ERROR))
}

/// From this depth on, in steps of that, in deviations of the blur.
pub(super) const TABLE: (f64, f64, usize) = (-4.0, 0.05, 241);

/// `E sqrt(max(0, x + n))`.
pub(super) static ROOTS: LazyLock<[f64; TABLE.2]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        let x = TABLE.0 + TABLE.1 * k as f64;
        let terms = (-500..=500).map(|i| {
            let n = 0.01 * f64::from(i);
            (x + n).max(0.0).sqrt() * stats::normal_cdf_and_density(n).1 * 0.01
        });
        terms.sum()
    })
});

/// `E sqrt(max(0, x + n))` and its derivative, of each lane.
fn blurred_roots(x: [f64; LANES]) -> [[f64; LANES]; 2] {
    let roots: &[f64; TABLE.2] = &ROOTS;
    let mut found = [[0.0; LANES]; 2];
    for (lane, x) in x.into_iter().enumerate() {
        let at = (x - TABLE.0) / TABLE.1;
        let k = at.max(0.0) as usize;
        let [root, by] = match roots.get(k..k + 2) {
            _ if at < 0.0 => [0.0, 0.0],
            Some(near) => {
                let by = near[1] - near[0];
                [near[0] + by * (at - k as f64), by / TABLE.1]
            }
            None => {
                let root = x.sqrt();
                [root - 0.125 / (x * root), 0.5 / root]
            }
        };
        (found[0][lane], found[1][lane]) = (root, by);
    }
    found
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn sectors_are_those_of_the_angle() {
        for k in 0..3600 {
            let angle = TAU * (f64::from(k) + 0.3) / 3600.0;
            let at = Vector2::new(angle.cos(), angle.sin()) * 1.3;
            let expected = (angle / TAU * SECTORS as f64) as usize;
            assert_eq!(sector_of(&at), expected, "{angle}");
        }
    }
}
