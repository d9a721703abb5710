//! Colors in linear light.

use rand::{Rng, RngExt};

/// Red, green, blue, linear light; 1 is a white surface in full light.
pub type Color = [f32; 3];

/// Gray of a color (ITU-R BT.709).
pub fn luma(c: Color) -> f32 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

/// The color between `a` and `b` at the fraction `share`.
pub(super) fn mix(a: Color, b: Color, share: f32) -> Color {
    [0, 1, 2].map(|k| a[k] + share * (b[k] - a[k]))
}

/// The color at another brightness.
pub(super) fn scaled(c: Color, factor: f32) -> Color {
    c.map(|x| x * factor)
}

/// A color whose channels each differ from `base` by up to `spread` of themselves.
pub(super) fn near<R: Rng + ?Sized>(base: Color, spread: f32, rng: &mut R) -> Color {
    base.map(|c| (c * (1.0 + spread * rng.random_range(-1.0..1.0f32))).max(0.0))
}

/// Light of a color temperature: from a warm bulb to a cool sky.
pub(super) fn tint<R: Rng + ?Sized>(rng: &mut R) -> Color {
    let warm = rng.random_range(-1.0..1.0f32);
    let green = rng.random_range(-0.06..0.06f32);
    [1.0 + 0.18 * warm, 1.0 + green, 1.0 - 0.25 * warm]
}
