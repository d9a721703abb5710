//! A piece of the rim: where its edge lies, by its pixels.

use std::sync::LazyLock;

use nalgebra::{SVector, Vector2};

use super::MAX_CHANGE;
use crate::fit::Sums;
use crate::geometry::Vec3;
use crate::stats::normal_cdf_and_density;
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

/// A pixel near the rim.
#[derive(Debug, Clone, Copy)]
pub(super) struct RimPixel {
    pub(super) sector: usize,
    /// Pixels within the outline.
    pub(super) within: f64,
    pub(super) value: f64,
    /// By the tone curve in hand.
    pub(super) light: f64,
    pub(super) weight: f64,
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
    /// The light of a pixel, and its derivatives.
    pub(super) fn shown(&self, pixel: &RimPixel) -> (f64, [f64; UNKNOWNS]) {
        let [behind, step, shading] = self.light;
        let depth = (pixel.within + self.at) / self.blur;
        let (covered, density) = normal_cdf_and_density(depth.clamp(-6.0, 6.0));
        let (root, by_depth) = blurred_root(depth);
        let unit = self.blur.sqrt();
        let root = root * unit;
        let by_depth = step * density + shading * by_depth * unit;
        let by_blur = (0.5 * shading * root - by_depth * depth) / self.blur;
        let by = [1.0, covered, root, by_depth / self.blur, by_blur];
        (behind + step * covered + shading * root, by)
    }
}

/// Where the rim is in a sector, and the weighted squares that its light leaves.
pub(super) fn place(pixels: &[RimPixel], blur: f64) -> (Place, f64) {
    let mut squares = 0.0;
    let found = place_with(pixels, blur, &mut squares);
    (found, squares)
}

pub(super) fn place_with(pixels: &[RimPixel], blur: f64, squares: &mut f64) -> Place {
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
        let mut sums = Sums::<UNKNOWNS>::default();
        for pixel in pixels {
            let (shown, by) = profile.shown(pixel);
            sums.add(&by, pixel.light - shown, pixel.weight);
        }
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
            (x + n).max(0.0).sqrt() * normal_cdf_and_density(n).1 * 0.01
        });
        terms.sum()
    })
});

/// `E sqrt(max(0, x + n))` and its derivative.
pub(super) fn blurred_root(x: f64) -> (f64, f64) {
    let at = (x - TABLE.0) / TABLE.1;
    if at < 0.0 {
        return (0.0, 0.0);
    }
    let k = at as usize;
    if k + 1 >= TABLE.2 {
        let root = x.sqrt();
        return (root - 0.125 / (x * root), 0.5 / root);
    }
    let by = ROOTS[k + 1] - ROOTS[k];
    (ROOTS[k] + by * (at - k as f64), by / TABLE.1)
}
