//! The background: surfaces, lines, people, lamps, other balls, the ground.
//!
//! Positions and lengths are in ball radii about a fixed pixel, so that textures keep their scale
//! against the ball in crops and whole frames alike, and stand still while the ball moves.

use std::f32::consts::TAU;

use rand::{Rng, RngExt};

use super::color::{Color, mix, scaled};
use super::config::{SynthConfig, SynthKind};
use super::ground::Ground;
use super::texture::{Material, Texture, hue};
use crate::vision::optics::camera::Pixel;

/// Something round in the background.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BackgroundDisc {
    /// Its middle.
    pub at: [f32; 2],
    /// Its radius.
    pub radius: f32,
    /// Half the width of its edge over its radius.
    pub softness: f32,
    /// Its color, linear light.
    pub color: Color,
    /// Whether it is shaded as a ball is; a lamp or a disc is not.
    pub is_ball: bool,
}

/// The background of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    /// The pixel at which positions are 0.
    pub origin: Pixel,
    /// A ball radius, pixels.
    pub radius_px: f64,
    /// What is behind everything.
    pub wall: Material,
    /// Change of brightness per ball radius, along u and v.
    pub slope: [f32; 2],
    /// What the ball lies or flies above, before the wall.
    pub ground: Option<Ground>,
    /// Things in it.
    pub discs: Vec<BackgroundDisc>,
}

impl Background {
    /// One color (linear light) all over.
    pub fn plain(color: Color) -> Self {
        Self {
            origin: Pixel::default(),
            radius_px: 1.0,
            wall: Material::plain(color),
            slope: [0.0; 2],
            ground: None,
            discs: Vec::new(),
        }
    }

    /// A random background about a ball whose brightest part has the gray `brightest`; `reach` is
    /// half the image's larger side in ball radii.
    pub(super) fn random<R: Rng + ?Sized>(
        brightest: f32,
        reach: f32,
        config: &SynthConfig,
        rng: &mut R,
    ) -> Self {
        let level = match rng.random_range(0..10) {
            0..4 => rng.random_range(0.0..0.06),
            4..7 => rng.random_range(0.05..0.4),
            _ => rng.random_range(0.3..1.3f32),
        }
        .min(config.max_background as f32)
            * brightest;
        let first = scaled(hue(rng), level);
        let is_textured = rng.random_bool(config.texture_share);
        let is_cluttered = rng.random_bool(config.clutter_share);
        let texture = Texture::random(rng);
        let max = config.max_background as f32 * brightest;
        let second = mix(
            first,
            scaled(hue(rng), max.min(level * rng.random_range(0.2..3.0f32))),
            rng.random_range(0.1..1.0),
        );
        let (texture, second) = match config.kind {
            SynthKind::Noise => {
                let cell = reach / rng.random_range(4.0..60.0f32);
                let noise = match rng.random_range(0..3) {
                    0 => Texture::Clouds { size: 4.0 * cell },
                    _ => Texture::Noise { cell },
                };
                (
                    noise,
                    scaled(hue(rng), brightest * rng.random_range(0.1..1.5f32)),
                )
            }
            _ if is_textured => (texture, second),
            _ => (Texture::Plain, second),
        };
        // As many about the ball in a whole frame as in a crop, up to a bound on the cost.
        let max_count = (6.0 * (0.5 * reach).max(1.0)).min(40.0) as u32;
        let count = rng.random_range(1..=max_count) * u32::from(is_cluttered);
        Self {
            origin: Pixel::default(),
            radius_px: 1.0,
            slope: [0, 1].map(|_| rng.random_range(-0.25..0.25) / reach.max(1.0)),
            wall: Material {
                colors: [first, second],
                texture,
                angle_rad: rng.random_range(0.0..TAU),
                seed: rng.random(),
            },
            ground: None,
            discs: (0..count)
                .map(|_| BackgroundDisc::random(brightest, level, reach, config, rng))
                .collect(),
        }
    }

    /// Light of the background at a pixel.
    pub(super) fn at(&self, u: usize, v: usize) -> Color {
        let x = ((u as f64 - self.origin.u) / self.radius_px) as f32;
        let y = ((v as f64 - self.origin.v) / self.radius_px) as f32;
        let tilt = 1.0 + self.slope[0] * x + self.slope[1] * y;
        let mut color = self.wall.at([x, y]);
        for disc in &self.discs {
            color = disc.over(color, [x, y]);
        }
        if let Some(ground) = &self.ground {
            color = ground.over(color, [x, y]);
        }
        color.map(|c| (c * tilt).max(0.0))
    }
}

impl BackgroundDisc {
    fn random<R: Rng + ?Sized>(
        brightest: f32,
        level: f32,
        reach: f32,
        config: &SynthConfig,
        rng: &mut R,
    ) -> Self {
        let place = 1.2 * reach;
        let at = [0, 1].map(|_| rng.random_range(-1.0..1.0f32) * place);
        let max = config.max_background as f32 * brightest;
        let color = hue(rng);
        match rng.random_range(0..4) {
            // A lamp is brighter than what it lights, unless only dark backgrounds are wanted.
            0 => Self {
                at,
                radius: rng.random_range(0.15..1.5),
                softness: rng.random_range(0.02..0.5),
                color: [max.min(rng.random_range(1.0..4.0) * brightest); 3],
                is_ball: false,
            },
            1 => Self {
                at,
                radius: rng.random_range(0.3..1.3),
                softness: 0.03,
                color: scaled(color, max.min(rng.random_range(0.2..1.1) * brightest)),
                is_ball: true,
            },
            _ => Self {
                at,
                radius: rng.random_range(0.1..2.0),
                softness: rng.random_range(0.02..0.3),
                color: scaled(color, max.min(rng.random_range(0.1..3.0) * level)),
                is_ball: false,
            },
        }
    }

    fn over(&self, behind: Color, [x, y]: [f32; 2]) -> Color {
        let [dx, dy] = [
            (x - self.at[0]) / self.radius,
            (y - self.at[1]) / self.radius,
        ];
        let out = (dx * dx + dy * dy).sqrt();
        let covered = (0.5 + 0.5 * (1.0 - out) / self.softness).clamp(0.0, 1.0);
        if covered <= 0.0 {
            return behind;
        }
        let shade = if self.is_ball {
            let depth = (1.0 - out * out).max(0.0).sqrt();
            (0.3 + 0.5 * depth - 0.35 * dy - 0.2 * dx).max(0.05)
        } else {
            1.0
        };
        mix(behind, scaled(self.color, shade), covered)
    }
}
