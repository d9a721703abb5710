//! The background: surfaces, lines, people, lamps, other balls.
//!
//! Positions and lengths are in ball radii about a fixed pixel, so that textures keep their scale
//! against the ball in crops and whole frames alike, and stand still while the ball moves.

use std::f32::consts::TAU;

use rand::{Rng, RngExt};

use super::color::{Color, mix, scaled};
use super::config::{SynthConfig, SynthKind};
use super::noise::{hash, turbulence, value};
use crate::vision::camera::Pixel;

/// The texture of a surface: how far its second color shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Texture {
    /// One color.
    Plain,
    /// Waves: waves per ball radius.
    Waves {
        /// Waves per ball radius.
        frequency: f32,
    },
    /// Grain of wood: rings per ball radius.
    Wood {
        /// Rings per ball radius.
        frequency: f32,
    },
    /// Threads that cross.
    Fabric {
        /// Threads per ball radius.
        frequency: f32,
    },
    /// Blobs of many colors: people, leaves, a shelf.
    Crowd {
        /// Blobs per ball radius.
        frequency: f32,
    },
    /// Lines on a floor or a table.
    Lines {
        /// Distance of the lines, ball radii.
        spacing: f32,
        /// Half their width, ball radii.
        half_width: f32,
    },
    /// Clouds: shades without a form.
    Clouds {
        /// Size, ball radii.
        size: f32,
    },
    /// Another gray at every cell.
    Noise {
        /// Side of a cell, ball radii.
        cell: f32,
    },
}

impl Texture {
    fn random<R: Rng + ?Sized>(rng: &mut R) -> Self {
        match rng.random_range(0..7) {
            0 => Self::Waves {
                frequency: rng.random_range(0.3..4.0),
            },
            1 => Self::Wood {
                frequency: rng.random_range(0.5..5.0),
            },
            2 => Self::Fabric {
                frequency: rng.random_range(2.0..15.0),
            },
            3 => Self::Crowd {
                frequency: rng.random_range(0.4..4.0),
            },
            4 | 5 => Self::Lines {
                spacing: rng.random_range(1.0..10.0),
                half_width: rng.random_range(0.03..0.3),
            },
            _ => Self::Clouds {
                size: rng.random_range(0.3..3.0),
            },
        }
    }

    /// The share of the second color at a point, in [0, 1].
    fn at(self, [x, y]: [f32; 2], seed: u32) -> f32 {
        match self {
            Self::Plain => 0.0,
            Self::Waves { frequency } => 0.5 + 0.5 * (TAU * frequency * x).sin(),
            Self::Wood { frequency } => {
                let bend = 1.5 * turbulence(0.25 * x, 0.7 * y, seed);
                let ring = 0.5 + 0.5 * (TAU * (frequency * y + bend)).sin();
                let fiber = value(0.7 * x, 9.0 * frequency * y, seed ^ 7);
                0.6 * ring + 0.4 * fiber
            }
            Self::Fabric { frequency } => {
                let (a, b) = ((TAU * frequency * x).sin(), (TAU * frequency * y).sin());
                0.5 + 0.35 * a * b + 0.3 * (turbulence(x, y, seed) - 0.5)
            }
            Self::Crowd { .. } => 0.0,
            Self::Lines {
                spacing,
                half_width,
            } => {
                let off = (x / spacing - (x / spacing).round()).abs() * spacing;
                let edge = 0.02 + 0.1 * half_width;
                let line = ((half_width - off) / edge + 0.5).clamp(0.0, 1.0);
                line.max(0.25 * turbulence(2.0 * x, 2.0 * y, seed))
            }
            Self::Clouds { size } => turbulence(x / size, y / size, seed),
            Self::Noise { cell } => {
                hash((x / cell).floor() as i32, (y / cell).floor() as i32, seed)
            }
        }
    }
}

/// Something round in the background.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
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
    /// First and second color, linear light.
    pub colors: [Color; 2],
    /// Change of brightness per ball radius, along u and v.
    pub slope: [f32; 2],
    /// Texture, and the angle by which it is turned, radians.
    pub texture: (Texture, f32),
    /// Seed of the texture.
    pub seed: u32,
    /// Things in it.
    pub discs: Vec<Disc>,
}

impl Background {
    /// One color (linear light) all over.
    pub fn plain(color: Color) -> Self {
        Self {
            origin: Pixel::default(),
            radius_px: 1.0,
            colors: [color; 2],
            slope: [0.0; 2],
            texture: (Texture::Plain, 0.0),
            seed: 0,
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
            colors: [first, second],
            slope: [0, 1].map(|_| rng.random_range(-0.25..0.25) / reach.max(1.0)),
            texture: (texture, rng.random_range(0.0..TAU)),
            seed: rng.random(),
            discs: (0..count)
                .map(|_| Disc::random(brightest, level, reach, config, rng))
                .collect(),
        }
    }

    /// Light of the background at a pixel.
    pub(super) fn at(&self, u: usize, v: usize) -> Color {
        let x = ((u as f64 - self.origin.u) / self.radius_px) as f32;
        let y = ((v as f64 - self.origin.v) / self.radius_px) as f32;
        let tilt = 1.0 + self.slope[0] * x + self.slope[1] * y;
        let (texture, angle) = self.texture;
        let mut color = match texture {
            Texture::Plain => self.colors[0],
            _ => {
                let (s, c) = angle.sin_cos();
                self.textured([c * x + s * y, c * y - s * x])
            }
        };
        for disc in &self.discs {
            color = disc.over(color, [x, y]);
        }
        color.map(|c| (c * tilt).max(0.0))
    }

    fn textured(&self, p: [f32; 2]) -> Color {
        let [first, second] = self.colors;
        if let Texture::Crowd { frequency } = self.texture.0 {
            return self.crowd(p.map(|x| frequency * x));
        }
        mix(first, second, self.texture.0.at(p, self.seed))
    }

    /// The color of the nearest of scattered points (S. Worley, SIGGRAPH 1996).
    fn crowd(&self, [x, y]: [f32; 2]) -> Color {
        let (i, j) = (x.floor() as i32, y.floor() as i32);
        let (mut nearest, mut cell) = (f32::INFINITY, [0; 2]);
        for dj in -1..=1 {
            for di in -1..=1 {
                let (a, b) = (i.wrapping_add(di), j.wrapping_add(dj));
                let dx = a as f32 + hash(a, b, self.seed) - x;
                let dy = b as f32 + hash(a, b, self.seed ^ 5) - y;
                let away = dx * dx + dy * dy;
                if away < nearest {
                    (nearest, cell) = (away, [a, b]);
                }
            }
        }
        let [a, b] = cell;
        let share = hash(a, b, self.seed ^ 11);
        let color = mix(self.colors[0], self.colors[1], share);
        let hues = [12, 13, 14].map(|k| 0.6 + 0.8 * hash(a, b, self.seed ^ k));
        let round = 1.0 - 0.5 * nearest.min(1.0);
        [0, 1, 2].map(|k| color[k] * hues[k] * round)
    }
}

impl Disc {
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

/// Gray, wood, skin, grass, a blue or a red wall: a color of brightness about 1.
fn hue<R: Rng + ?Sized>(rng: &mut R) -> Color {
    let base: Color = match rng.random_range(0..8) {
        0 => [0.4, 1.0, 0.6],
        1 => [0.5, 0.7, 1.0],
        2 => [1.0, 0.6, 0.3],
        3 => [1.0, 0.4, 0.35],
        4 => [0.2, 0.35, 0.9],
        _ => [1.0; 3],
    };
    base.map(|c| c * rng.random_range(0.75..1.25f32))
}
