//! Logos: marks other than dots, as makers print them and players draw them.
//!
//! A logo is made of strokes, arcs, discs and bars in a plane that touches the ball at the logo's
//! middle; a point at the angle `theta` from it lies at the distance `theta` in the plane
//! (azimuthal equidistant). Its ink is drawn once into a square raster, from which the renderer
//! interpolates.

use std::f32::consts::{PI, TAU};

use rand::{Rng, RngExt};

/// Side of a logo's raster.
const RASTER: usize = 64;

/// A shape in the logo's plane; lengths relative to the logo's radius.
#[derive(Debug, Clone, Copy, PartialEq)]
enum LogoShape {
    Stroke {
        from: [f32; 2],
        to: [f32; 2],
        half_width: f32,
    },
    Arc {
        middle: [f32; 2],
        radius: f32,
        start: f32,
        sweep: f32,
        half_width: f32,
    },
    Disc {
        middle: [f32; 2],
        radius: f32,
    },
    Bar {
        middle: [f32; 2],
        half: [f32; 2],
        angle: f32,
    },
}

impl LogoShape {
    /// Signed distance of a point, negative inside.
    fn distance(&self, p: [f32; 2]) -> f32 {
        match *self {
            Self::Stroke {
                from,
                to,
                half_width,
            } => {
                let (d, q) = (minus(to, from), minus(p, from));
                let along = (dot(d, q) / dot(d, d).max(1e-9)).clamp(0.0, 1.0);
                length([q[0] - along * d[0], q[1] - along * d[1]]) - half_width
            }
            Self::Arc {
                middle,
                radius,
                start,
                sweep,
                half_width,
            } => {
                let q = minus(p, middle);
                let angle = (q[1].atan2(q[0]) - start).rem_euclid(TAU);
                if angle <= sweep {
                    return (length(q) - radius).abs() - half_width;
                }
                let end = |a: f32| {
                    let tip = [radius * a.cos(), radius * a.sin()];
                    length(minus(q, tip))
                };
                end(start).min(end(start + sweep)) - half_width
            }
            Self::Disc { middle, radius } => length(minus(p, middle)) - radius,
            Self::Bar {
                middle,
                half,
                angle,
            } => {
                let q = minus(p, middle);
                let (s, c) = angle.sin_cos();
                let x = (c * q[0] + s * q[1]).abs() - half[0];
                let y = (c * q[1] - s * q[0]).abs() - half[1];
                length([x.max(0.0), y.max(0.0)]) + x.max(y).min(0.0)
            }
        }
    }
}

fn minus(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn length(a: [f32; 2]) -> f32 {
    dot(a, a).sqrt()
}

/// What kind of mark a logo is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogoKind {
    /// Letters in one or two lines.
    Text,
    /// A smile, a swoosh or concentric arcs.
    Arcs,
    /// A ring, whole or broken, with something in it.
    Ring,
    /// Three stars or so in a row, with a word below.
    Stars,
    /// A filled bar or badge.
    Badge,
    /// Round blobs that look like dots.
    Blobs,
    /// Rim, hub and spokes; no ball's logo.
    Wheel,
}

impl LogoKind {
    /// What a ball may carry.
    const ON_BALLS: [Self; 6] = [
        Self::Text,
        Self::Arcs,
        Self::Ring,
        Self::Stars,
        Self::Badge,
        Self::Blobs,
    ];

    /// Any kind that a ball may carry.
    pub fn random<R: Rng + ?Sized>(rng: &mut R) -> Self {
        Self::ON_BALLS[rng.random_range(0..Self::ON_BALLS.len())]
    }
}

/// A logo's ink.
#[derive(Debug, Clone, PartialEq)]
pub struct Logo {
    /// Its kind.
    pub kind: LogoKind,
    raster: Vec<f32>,
}

impl Logo {
    /// A random logo of a kind.
    pub fn random<R: Rng + ?Sized>(kind: LogoKind, rng: &mut R) -> Self {
        let mut shapes = Vec::new();
        match kind {
            LogoKind::Text => {
                text(&mut shapes, [0.0, rng.random_range(-0.2..0.3)], 0.85, rng);
                if rng.random_bool(0.5) {
                    text(&mut shapes, [0.0, -0.45], rng.random_range(0.3..0.7), rng);
                }
            }
            LogoKind::Arcs => arcs(&mut shapes, rng),
            LogoKind::Ring => ring(&mut shapes, rng),
            LogoKind::Stars => {
                stars(&mut shapes, rng);
                text(&mut shapes, [0.0, -0.35], rng.random_range(0.4..0.9), rng);
            }
            LogoKind::Badge => {
                shapes.push(LogoShape::Bar {
                    middle: [0.0, 0.0],
                    half: [rng.random_range(0.3..0.85), rng.random_range(0.12..0.45)],
                    angle: 0.0,
                });
                if rng.random_bool(0.4) {
                    text(&mut shapes, [0.0, -0.7], 0.6, rng);
                }
            }
            LogoKind::Wheel => wheel(&mut shapes, rng),
            LogoKind::Blobs => {
                for _ in 0..rng.random_range(1..=4) {
                    shapes.push(LogoShape::Disc {
                        middle: [rng.random_range(-0.7..0.7), rng.random_range(-0.7..0.7)],
                        radius: rng.random_range(0.12..0.3),
                    });
                }
            }
        }
        let softness = rng.random_range(0.02..0.08);
        Self {
            kind,
            raster: rasterize(&shapes, softness),
        }
    }

    /// Ink at a point of the plane, in [0, 1]; 0 beyond the unit square.
    pub fn ink(&self, x: f32, y: f32) -> f32 {
        let scale = 0.5 * (RASTER - 1) as f32;
        let (u, v) = ((x + 1.0) * scale, (y + 1.0) * scale);
        if !(u >= 0.0 && v >= 0.0) {
            return 0.0;
        }
        let (i, j) = (u as usize, v as usize);
        if i + 1 >= RASTER || j + 1 >= RASTER {
            return 0.0;
        }
        let (fu, fv) = (u - i as f32, v - j as f32);
        let at = |i: usize, j: usize| self.raster[j * RASTER + i];
        let low = at(i, j) * (1.0 - fu) + at(i + 1, j) * fu;
        let high = at(i, j + 1) * (1.0 - fu) + at(i + 1, j + 1) * fu;
        low * (1.0 - fv) + high * fv
    }
}

fn rasterize(shapes: &[LogoShape], softness: f32) -> Vec<f32> {
    let scale = 2.0 / (RASTER - 1) as f32;
    (0..RASTER * RASTER)
        .map(|k| {
            let p = [
                (k % RASTER) as f32 * scale - 1.0,
                (k / RASTER) as f32 * scale - 1.0,
            ];
            let nearest = shapes
                .iter()
                .map(|s| s.distance(p))
                .fold(f32::INFINITY, f32::min);
            (0.5 - nearest / softness).clamp(0.0, 1.0)
        })
        .collect()
}

/// A word: letters of two to four strokes each.
fn text<R: Rng + ?Sized>(
    shapes: &mut Vec<LogoShape>,
    middle: [f32; 2],
    half_length: f32,
    rng: &mut R,
) {
    let letters = rng.random_range(3..=8);
    let pitch = 2.0 * half_length / letters as f32;
    let height = pitch * rng.random_range(0.7..1.6);
    let half_width = pitch * rng.random_range(0.07..0.16);
    for i in 0..letters {
        let left = middle[0] - half_length + (i as f32 + 0.12) * pitch;
        let corner = |x: f32, y: f32| [left + 0.76 * pitch * x, middle[1] + height * (y - 0.5)];
        for _ in 0..rng.random_range(2..=4) {
            let grid = |rng: &mut R| {
                corner(
                    rng.random_range(0..=1) as f32,
                    rng.random_range(0..=2) as f32 / 2.0,
                )
            };
            if rng.random_bool(0.25) {
                shapes.push(LogoShape::Arc {
                    middle: corner(0.5, 0.5),
                    radius: 0.36 * pitch,
                    start: rng.random_range(0.0..TAU),
                    sweep: rng.random_range(PI..TAU),
                    half_width,
                });
            } else {
                let (from, to) = (grid(rng), grid(rng));
                shapes.push(LogoShape::Stroke {
                    from,
                    to,
                    half_width,
                });
            }
        }
    }
}

fn arcs<R: Rng + ?Sized>(shapes: &mut Vec<LogoShape>, rng: &mut R) {
    let start = rng.random_range(0.0..TAU);
    for _ in 0..rng.random_range(1..=3) {
        shapes.push(LogoShape::Arc {
            middle: [rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2)],
            radius: rng.random_range(0.3..0.85),
            start: start + rng.random_range(-0.4..0.4),
            sweep: rng.random_range(0.8..3.5),
            half_width: rng.random_range(0.03..0.15),
        });
    }
    for _ in 0..rng.random_range(0..=3) {
        shapes.push(LogoShape::Disc {
            middle: [rng.random_range(-0.7..0.7), rng.random_range(-0.7..0.7)],
            radius: rng.random_range(0.08..0.2),
        });
    }
}

fn ring<R: Rng + ?Sized>(shapes: &mut Vec<LogoShape>, rng: &mut R) {
    shapes.push(LogoShape::Arc {
        middle: [0.0, 0.0],
        radius: rng.random_range(0.5..0.9),
        start: rng.random_range(0.0..TAU),
        sweep: if rng.random_bool(0.6) {
            TAU
        } else {
            rng.random_range(3.0..6.0)
        },
        half_width: rng.random_range(0.03..0.12),
    });
    if rng.random_bool(0.6) {
        text(shapes, [0.0, 0.0], 0.5, rng);
    } else {
        shapes.push(LogoShape::Disc {
            middle: [0.0, 0.0],
            radius: rng.random_range(0.1..0.35),
        });
    }
}

/// Each star is five strokes from its middle.
fn stars<R: Rng + ?Sized>(shapes: &mut Vec<LogoShape>, rng: &mut R) {
    let count = rng.random_range(1..=3);
    let size = rng.random_range(0.14..0.28);
    for i in 0..count {
        let x = (i as f32 - 0.5 * (count - 1) as f32) * 2.2 * size;
        for k in 0..5 {
            let angle = PI * (0.5 + 0.4 * k as f32);
            shapes.push(LogoShape::Stroke {
                from: [x, 0.25],
                to: [x + size * angle.cos(), 0.25 + size * angle.sin()],
                half_width: 0.25 * size,
            });
        }
    }
}

/// The azimuthal equidistant plane is a disc of radius 1, which the rim fills to its edge.
fn wheel<R: Rng + ?Sized>(shapes: &mut Vec<LogoShape>, rng: &mut R) {
    let rim = rng.random_range(0.04..0.14);
    shapes.push(LogoShape::Arc {
        middle: [0.0, 0.0],
        radius: 0.85 - rim,
        start: 0.0,
        sweep: TAU,
        half_width: rim,
    });
    let hub = rng.random_range(0.05..0.2);
    shapes.push(LogoShape::Disc {
        middle: [0.0, 0.0],
        radius: hub,
    });
    let spokes = rng.random_range(3..=12);
    let half_width = rng.random_range(0.01..0.06);
    let has_bolts = rng.random_bool(0.5);
    for k in 0..spokes {
        let (s, c) = (TAU * k as f32 / spokes as f32).sin_cos();
        shapes.push(LogoShape::Stroke {
            from: [0.0, 0.0],
            to: [0.8 * c, 0.8 * s],
            half_width,
        });
        if has_bolts {
            shapes.push(LogoShape::Disc {
                middle: [1.6 * hub * c, 1.6 * hub * s],
                radius: 0.3 * hub,
            });
        }
    }
}
