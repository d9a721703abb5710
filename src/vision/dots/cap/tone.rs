//! What the dots of an image share: the tone curve, and a dot's size and sharpness.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f64x4};

use crate::vision::optics::camera::BallView;

/// Standard deviations of radius and blur, of these: of the first dot, and of one on a ball whose other dots are known.
const SPREAD: [[f64; 2]; 2] = [[1.0, 1.0], [0.15, 0.25]];

/// The blur's deviation that a fit starts from: pixels, or this part of the ball's radius where that is more.
const BLUR: (f64, f64) = (0.7, 0.02);

/// Standard deviation of the bend that a dot's edge shows beside the tone curve's: ink and turning make edges uneven, too.
const DOT_ERROR: f64 = 0.3;

/// What is known of the tone curve: the bend `q`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tone {
    pub bend: f64,
    pub variance: f64,
}

impl Default for Tone {
    /// Anything between a line and sRGB's.
    fn default() -> Self {
        Self {
            bend: 0.6,
            variance: 0.25,
        }
    }
}

impl Tone {
    /// The square root of the light.
    #[cfg(test)]
    pub fn of_root() -> Self {
        Self {
            bend: 1.0,
            variance: 0.01,
        }
    }

    /// What is known after a dot whose fit, from this, ended at a bend of a variance.
    pub fn after_dot(&self, bend: f64, variance: f64) -> Self {
        let gained = variance.recip() - self.variance.recip();
        if gained.is_nan() || gained <= 0.0 {
            return *self;
        }
        // What the dot alone says.
        let own = gained.recip();
        let measured = self.bend + (bend - self.bend) * (self.variance + own) / self.variance;
        let gain = self.variance / (self.variance + own + DOT_ERROR * DOT_ERROR);
        Self {
            bend: (self.bend + gain * (measured - self.bend)).clamp(0.0, 1.0),
            variance: (1.0 - gain) * self.variance,
        }
    }

    /// The light that is stored as `value`.
    pub fn light(bend: f64, value: f64) -> f64 {
        (1.0 - bend + bend * value) * value
    }

    /// How light is stored, and the curve's slope there.
    pub fn shown(bend: f64, light: f64) -> (f64, f64) {
        let straight = 1.0 - bend;
        let root = (straight * straight + 4.0 * bend * light).sqrt();
        (2.0 * light / (straight + root), 1.0 / root)
    }

    /// The same of several.
    #[inline(always)]
    pub fn shown_each<S: Simd>(bend: f64, light: f64x4<S>) -> [f64x4<S>; 2] {
        let straight = 1.0 - bend;
        let root = (light * (4.0 * bend) + straight * straight).sqrt();
        let rate = f64x4::splat(light.simd, 1.0) / root;
        [light * 2.0 / (root + straight), rate]
    }
}

/// A cap's size and sharpness, and the tone curve.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CapShape {
    /// Angular radius, radians.
    pub radius: f64,
    /// Standard deviation of the edge's blur, pixels.
    pub blur: f64,
    pub tone: Tone,
    /// Whether a dot of the ball had it.
    pub is_known: bool,
}

impl CapShape {
    /// Where nothing but about the radius is known of a dot.
    pub fn first(radius: f64, view: &BallView) -> Self {
        Self {
            radius,
            blur: BLUR.0.max(BLUR.1 * view.circle().radius),
            tone: Tone::default(),
            is_known: false,
        }
    }

    /// Where an outline alone says how sharp the image is: by the width of its edge, and the side of a pixel of the image that it was
    /// fitted in, pixels.
    pub fn of_edge(width: f64, side: f64) -> Self {
        // A Gaussian's edge is as wide as its greatest slope has it; the fit smooths it by about a pixel of its own.
        let blur = width / std::f64::consts::TAU.sqrt();
        Self {
            radius: 0.0,
            blur: (blur * blur - side * side)
                .max(0.0)
                .sqrt()
                .max(BLUR.0 * side),
            tone: Tone::default(),
            is_known: false,
        }
    }

    /// Its unknowns and their variances.
    pub fn expected(&self) -> [(f64, f64); 3] {
        let [of_radius, of_blur] = SPREAD[usize::from(self.is_known)];
        [
            (self.radius, (of_radius * self.radius).powi(2)),
            (self.blur, (of_blur * self.blur).powi(2)),
            (self.tone.bend, self.tone.variance),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dot_counts_by_what_it_alone_says() {
        let before = Tone::default();
        // A dot that says 0.1 with a deviation of 0.2, as a fit from `before` ends.
        let (own, said) = (0.04, 0.1);
        let ended = (before.bend / before.variance + said / own)
            / (before.variance.recip() + f64::recip(own));
        let variance = (before.variance.recip() + f64::recip(own)).recip();
        let after = before.after_dot(ended, variance);
        let counted: f64 = own + DOT_ERROR * DOT_ERROR;
        let expected = (before.variance.recip() + counted.recip()).recip();
        assert!((after.variance - expected).abs() < 1e-12);
        let bend = expected * (before.bend / before.variance + said / counted);
        assert!((after.bend - bend).abs() < 1e-12);
        // One that says nothing changes nothing.
        let same = before.after_dot(0.2, before.variance);
        assert_eq!((same.bend, same.variance), (before.bend, before.variance));
    }
}
