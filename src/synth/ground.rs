//! The ground: a table, a floor or a court below the ball, and the ball's shadow on it.
//!
//! Positions and lengths are in ball radii about the ball's center, x right and y down. A camera that looks down under the
//! elevation `e` sees a ball that lies on the ground touch it at `y = cos(e)`, and a round shadow there flattened by
//! `sin(e)`.

use std::f32::consts::FRAC_PI_2;

use rand::{Rng, RngExt};

use super::color::{Color, mix, scaled};
use super::config::SynthConfig;
use super::texture::{Material, Texture, hue};

/// Width of the ground's edge.
const EDGE: f32 = 0.03;

/// The shadow of a ball that lies on the ground or flies low.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Its middle.
    pub at: [f32; 2],
    /// Half its width and half its height.
    pub half_axes: [f32; 2],
    /// Width of its edge over its size, at most 1.
    pub softness: f32,
    /// Share of the ground's light that it takes.
    pub depth: f32,
}

/// The ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// The way from the ball's center to the ground's edge, down the image, which is turned by `tilt_rad`.
    pub edge: f32,
    /// The angle by which the edge leaves the horizontal, radians.
    pub tilt_rad: f32,
    /// Its surface.
    pub surface: Material,
    /// The ball's shadow.
    pub contact: Option<Contact>,
}

impl Ground {
    /// Random ground below a ball whose brightest part has the gray `brightest`.
    pub(super) fn random<R: Rng + ?Sized>(
        brightest: f32,
        config: &SynthConfig,
        rng: &mut R,
    ) -> Self {
        let most = config.max_background.min(1.0) as f32 * brightest;
        let mut color = || scaled(hue(rng), most * rng.random::<f32>().powi(2));
        let colors = [color(), color()];
        let elevation = rng.random_range(0.05..FRAC_PI_2);
        let (sin, cos) = elevation.sin_cos();
        let size = rng.random_range(0.5..1.4f32);
        // Mostly near the place where the ball touches the ground.
        let aside = 0.5 * rng.random_range(-1.0..1.0f32).powi(3);
        let contact = Contact {
            at: [aside, cos + 0.3 * rng.random::<f32>().powi(2)],
            half_axes: [size, size * sin.max(0.1)],
            softness: rng.random_range(0.1..1.0),
            depth: rng.random_range(0.2..0.95),
        };
        let has_contact = rng.random_bool(0.7);
        Self {
            // Seen flat, its edge is near the ball; from above, it fills the image.
            edge: cos - rng.random_range(0.0..3.0f32) - 6.0 * sin * rng.random::<f32>(),
            tilt_rad: rng.random_range(-0.2..0.2),
            surface: Material {
                colors,
                texture: Texture::of_ground(rng),
                angle_rad: rng.random_range(0.0..std::f32::consts::TAU),
                seed: rng.random(),
            },
            contact: has_contact.then_some(contact),
        }
    }

    /// The light at a point with the given light behind.
    pub(super) fn over(&self, behind: Color, [x, y]: [f32; 2]) -> Color {
        let (s, c) = self.tilt_rad.sin_cos();
        let below = c * y + s * x - self.edge;
        let covered = (0.5 + below / EDGE).clamp(0.0, 1.0);
        if covered <= 0.0 {
            return behind;
        }
        let left = self.contact.map_or(1.0, |shadow| shadow.leaves([x, y]));
        mix(behind, scaled(self.surface.at([x, y]), left), covered)
    }
}

impl Contact {
    /// Share of the light that it leaves at a point.
    fn leaves(&self, [x, y]: [f32; 2]) -> f32 {
        let [a, b] = self.half_axes;
        let out = ((x - self.at[0]) / a).hypot((y - self.at[1]) / b);
        let inside = ((1.0 - out) / self.softness).clamp(0.0, 1.0);
        1.0 - self.depth * inside
    }
}
