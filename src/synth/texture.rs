//! Surfaces in the background: two colors and a texture between them.
//!
//! Positions and lengths are in ball radii.

use std::f32::consts::TAU;

use rand::{Rng, RngExt};

use super::color::{Color, mix};
use super::noise::{hash, turbulence, value};

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
    /// Squares of two colors with joints between them: tiles, a board, a court.
    Tiles {
        /// Side of a square, ball radii.
        side: f32,
        /// Half the width of a joint, ball radii.
        half_joint: f32,
        /// Whether the squares' colors alternate; they are one color otherwise.
        is_board: bool,
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
    pub(super) fn random<R: Rng + ?Sized>(rng: &mut R) -> Self {
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

    /// One of those of floors and tables.
    pub(super) fn of_ground<R: Rng + ?Sized>(rng: &mut R) -> Self {
        match rng.random_range(0..4) {
            0 => Self::Plain,
            1 => Self::random(rng),
            _ => Self::Tiles {
                side: rng.random_range(0.5..6.0),
                half_joint: rng.random_range(0.01..0.12),
                is_board: rng.random_bool(0.5),
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
            Self::Tiles {
                side,
                half_joint,
                is_board,
            } => {
                let off = |p: f32| (p / side - (p / side).round()).abs() * side;
                if off(x).min(off(y)) < half_joint {
                    return 1.0;
                }
                let cells = (x / side).floor() + (y / side).floor();
                f32::from(is_board) * 0.8 * cells.rem_euclid(2.0)
            }
            Self::Clouds { size } => turbulence(x / size, y / size, seed),
            Self::Noise { cell } => {
                hash((x / cell).floor() as i32, (y / cell).floor() as i32, seed)
            }
        }
    }
}

/// A textured surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// First and second color, linear light.
    pub colors: [Color; 2],
    /// How they alternate.
    pub texture: Texture,
    /// The angle by which the texture is turned, radians.
    pub angle_rad: f32,
    /// Seed of the texture.
    pub seed: u32,
}

impl Material {
    /// One color (linear light) all over.
    pub fn plain(color: Color) -> Self {
        Self {
            colors: [color; 2],
            texture: Texture::Plain,
            angle_rad: 0.0,
            seed: 0,
        }
    }

    /// Its color at a point.
    pub(super) fn at(&self, [x, y]: [f32; 2]) -> Color {
        let [first, second] = self.colors;
        let (s, c) = self.angle_rad.sin_cos();
        let p = [c * x + s * y, c * y - s * x];
        match self.texture {
            Texture::Plain => first,
            Texture::Crowd { frequency } => self.crowd(p.map(|x| frequency * x)),
            texture => mix(first, second, texture.at(p, self.seed)),
        }
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

/// Gray, wood, skin, grass, a blue or a red wall: a color of brightness about 1.
pub(super) fn hue<R: Rng + ?Sized>(rng: &mut R) -> Color {
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
