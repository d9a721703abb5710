//! Occluders: fingers, a hand, a bat, a net or cords before the ball, and their shadow on it.
//!
//! Shapes are signed distances in the image, in ball radii about the outline's center, x right and
//! y down. A finger, hand or bat comes from one side to a given depth; a net lies below its tape;
//! cords cross the whole ball.

use std::f32::consts::TAU;

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::color::{Color, near, scaled};
use super::config::SynthConfig;
use super::random::between_f32;

/// What hides a part of the ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OccluderKind {
    /// A finger.
    Finger,
    /// Several fingers.
    Hand,
    /// The blade of a bat.
    Bat,
    /// A net with its tape.
    Net,
    /// Cords, or a net without a tape, across the whole ball.
    Cords,
}

/// Something before the ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Occluder {
    /// What it is.
    pub kind: OccluderKind,
    /// Its color, linear light.
    pub color: Color,
    shapes: Vec<OccluderShape>,
    shadow: Option<OccluderShadow>,
}

/// The shadow of an occluder: its shape, moved and with a soft edge.
#[derive(Debug, Clone, Copy, PartialEq)]
struct OccluderShadow {
    offset: [f32; 2],
    softness: f32,
    depth: f32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum OccluderShape {
    Capsule {
        from: [f32; 2],
        to: [f32; 2],
        half_width: f32,
    },
    Disc {
        middle: [f32; 2],
        radius: f32,
    },
    /// Threads along two directions below a line, the tape, which is a band.
    Net {
        along: [f32; 2],
        spacing: f32,
        half_width: f32,
        tape: [f32; 2],
    },
}

impl OccluderShape {
    /// Signed distance, negative inside.
    fn distance(&self, [x, y]: [f32; 2]) -> f32 {
        match *self {
            Self::Capsule {
                from,
                to,
                half_width,
            } => {
                let (d, q) = (
                    [to[0] - from[0], to[1] - from[1]],
                    [x - from[0], y - from[1]],
                );
                let length = (d[0] * d[0] + d[1] * d[1]).max(1e-9);
                let along = ((d[0] * q[0] + d[1] * q[1]) / length).clamp(0.0, 1.0);
                (q[0] - along * d[0]).hypot(q[1] - along * d[1]) - half_width
            }
            Self::Disc { middle, radius } => (x - middle[0]).hypot(y - middle[1]) - radius,
            Self::Net {
                along: [c, s],
                spacing,
                half_width,
                tape: [start, end],
            } => {
                let (a, b) = (c * x + s * y, c * y - s * x);
                let thread =
                    |p: f32| (p / spacing - (p / spacing).round()).abs() * spacing - half_width;
                let mesh = thread(a).min(thread(b)).max(start - b);
                mesh.min((start - b).max(b - end))
            }
        }
    }
}

/// A finger that reaches in to `tip`; `place` leads from along and across it to the ball's frame.
fn finger<R: Rng + ?Sized>(
    tip: f32,
    place: impl Fn(f32, f32) -> [f32; 2],
    rng: &mut R,
) -> Vec<OccluderShape> {
    let half_width = rng.random_range(0.2..0.5);
    let across = rng.random_range(-0.7..0.7);
    vec![OccluderShape::Capsule {
        from: place(tip + half_width, across),
        to: place(6.0, across + rng.random_range(-2.0..2.0)),
        half_width,
    }]
}

/// Two to four fingers side by side.
fn hand<R: Rng + ?Sized>(
    tip: f32,
    place: impl Fn(f32, f32) -> [f32; 2],
    rng: &mut R,
) -> Vec<OccluderShape> {
    let half_width = rng.random_range(0.18..0.35f32);
    let middle = rng.random_range(-0.5..0.5f32);
    let fingers = rng.random_range(2..=4);
    let finger = |k| {
        let off = k as f32 - 0.5 * (fingers - 1) as f32;
        let across = middle + 2.15 * half_width * off;
        let short = rng.random_range(0.0..0.5f32);
        OccluderShape::Capsule {
            from: place(tip + half_width + short, across),
            to: place(5.0, 1.2 * across),
            half_width,
        }
    };
    (0..fingers).map(finger).collect()
}

/// A bat's edge.
fn bat<R: Rng + ?Sized>(
    tip: f32,
    place: impl Fn(f32, f32) -> [f32; 2],
    rng: &mut R,
) -> (OccluderKind, [f32; 3], Vec<OccluderShape>) {
    let radius = rng.random_range(1.5..5.0);
    let shape = OccluderShape::Disc {
        middle: place(tip + radius, rng.random_range(-0.4..0.4)),
        radius,
    };
    let base = match rng.random_range(0..3) {
        0 => [0.5, 0.03, 0.03],
        1 => [0.02, 0.02, 0.02],
        _ => [0.5, 0.3, 0.12],
    };
    (OccluderKind::Bat, near(base, 0.3, rng), vec![shape])
}

/// A net with its tape.
fn net<R: Rng + ?Sized>(rng: &mut R) -> (OccluderKind, [f32; 3], Vec<OccluderShape>) {
    let (s, c) = rng.random_range(-0.4..0.4f32).sin_cos();
    let spacing = rng.random_range(0.25..0.7);
    let start = rng.random_range(-1.5..1.0);
    let shape = OccluderShape::Net {
        along: [c, s],
        spacing,
        half_width: spacing * rng.random_range(0.03..0.1),
        tape: [start, start + rng.random_range(0.0..0.35)],
    };
    let base = [rng.random_range(0.02..0.7f32); 3];
    (OccluderKind::Net, near(base, 0.15, rng), vec![shape])
}

impl Occluder {
    /// A random one.
    pub(super) fn random<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Self {
        let (sin, cos) = (TAU * rng.random::<f32>()).sin_cos();
        // How far it reaches over the diameter; the tip is then at 1 - 2 depth from the center.
        let tip = 1.0 - 2.0 * between_f32([0.0, config.max_occlusion], rng);
        let place =
            |along: f32, across: f32| [cos * along - sin * across, sin * along + cos * across];
        let skin = skin(rng);
        let brightness = rng.random_range(0.3..1.1f32);
        let (kind, color, shapes) = match rng.random_range(0..4) {
            0 => (OccluderKind::Finger, skin, finger(tip, place, rng)),
            1 => (OccluderKind::Hand, skin, hand(tip, place, rng)),
            2 => bat(tip, place, rng),
            _ => net(rng),
        };
        Self {
            kind,
            color: scaled(color, brightness),
            shapes,
            shadow: rng
                .random_bool(config.occluder_shadow_share)
                .then(|| OccluderShadow::random(rng)),
        }
    }

    /// Random cords.
    pub(super) fn cords<R: Rng + ?Sized>(rng: &mut R) -> Self {
        let color = near([rng.random_range(0.02..0.9f32); 3], 0.15, rng);
        let angle = rng.random_range(0.0..TAU);
        let shapes = if rng.random_bool(0.5) {
            let (s, c) = angle.sin_cos();
            let spacing = rng.random_range(0.25..1.5);
            vec![OccluderShape::Net {
                along: [c, s],
                spacing,
                half_width: spacing * rng.random_range(0.02..0.1),
                tape: [f32::NEG_INFINITY; 2],
            }]
        } else {
            let count = rng.random_range(1..=4);
            let spread = rng.random_range(0.05..0.8);
            (0..count)
                .map(|_| {
                    let (s, c) = (angle + spread * rng.random_range(-1.0..1.0f32)).sin_cos();
                    let across = rng.random_range(-1.0..1.0f32);
                    let place = |along: f32| [along * c - across * s, along * s + across * c];
                    OccluderShape::Capsule {
                        from: place(-20.0),
                        to: place(20.0),
                        half_width: 0.01 * 12f32.powf(rng.random::<f32>()),
                    }
                })
                .collect()
        };
        Self {
            kind: OccluderKind::Cords,
            color,
            shapes,
            shadow: None,
        }
    }

    fn distance(&self, point: [f32; 2]) -> f32 {
        let distances = self.shapes.iter().map(|s| s.distance(point));
        distances.fold(f32::INFINITY, f32::min)
    }

    /// Share of the light that its shadow leaves at a point of the ball.
    pub(super) fn leaves(&self, [x, y]: [f32; 2]) -> f32 {
        self.shadow.map_or(1.0, |s| {
            let inside = -self.distance([x - s.offset[0], y - s.offset[1]]) / s.softness;
            1.0 - s.depth * (0.5 + inside).clamp(0.0, 1.0)
        })
    }

    /// How much of a pixel of the given side (ball radii) about a point is hidden, in [0, 1], and
    /// the light that is seen instead.
    pub fn at(&self, point: [f32; 2], pixel: f32) -> (f32, Color) {
        let nearest = self.distance(point);
        let covered = (0.5 - nearest / pixel).clamp(0.0, 1.0);
        // Round things are darker at their edge.
        let shade = match self.kind {
            OccluderKind::Finger | OccluderKind::Hand => 0.55 + (-2.0 * nearest).clamp(0.0, 0.45),
            OccluderKind::Bat | OccluderKind::Net | OccluderKind::Cords => 1.0,
        };
        (covered, scaled(self.color, shade))
    }
}

impl OccluderShadow {
    fn random<R: Rng + ?Sized>(rng: &mut R) -> Self {
        let (s, c) = rng.random_range(0.0..TAU).sin_cos();
        let away = rng.random_range(0.0..0.6f32);
        Self {
            offset: [away * c, away * s],
            softness: rng.random_range(0.02..0.5),
            depth: rng.random_range(0.2..0.9),
        }
    }
}

fn skin<R: Rng + ?Sized>(rng: &mut R) -> Color {
    let light = rng.random_range(0.08..0.75f32);
    near([light, 0.62 * light, 0.45 * light], 0.12, rng)
}
