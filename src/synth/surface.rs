//! What is drawn on the ball: dots, a logo, dirt.
//!
//! Positions are unit vectors in the pattern's frame. A dot is a cap of the angular radius `rho`; its edge is soft: ink falls from 1
//! to 0 between `rho - s` and `rho + s`, as the cosine of the angle, which is what is cheap to work out.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::logo::{Logo, LogoKind};
use super::scene::SynthConfig;
use crate::geometry::{Vec3, random_direction, tangent_frame};
use crate::pattern::Pattern;

/// A round mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its middle.
    pub middle: Vec3,
    /// Its angular radius, radians.
    pub radius: f64,
    /// Half the angle over which its edge fades, radians.
    pub softness: f64,
    /// Share of the light that its ink takes, in [0, 1].
    pub darkness: f32,
}

/// A logo on the ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// What it looks like.
    pub logo: Logo,
    /// Its middle.
    pub middle: Vec3,
    /// The axes of its plane.
    pub axes: [Vec3; 2],
    /// Its angular radius, radians.
    pub radius: f64,
    /// Its color, linear light.
    pub color: [f32; 3],
}

/// All that is drawn on a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Color of the ball, linear light.
    pub ball: [f32; 3],
    /// Color of the dots' ink.
    pub ink: [f32; 3],
    /// The pattern's dots as drawn, by index; `None` where one was left out.
    pub dots: Vec<Option<Spot>>,
    /// Stains, which are no dots.
    pub stains: Vec<Spot>,
    /// The logo, if any.
    pub mark: Option<Mark>,
}

impl Surface {
    /// A random ball with the pattern drawn on it by hand.
    pub fn random<R: Rng + ?Sized>(pattern: &Pattern, config: &SynthConfig, rng: &mut R) -> Self {
        let ball = ball_color(rng);
        let dark = rng.random_range(0.02..0.16f32);
        let ink = [0, 1, 2].map(|_| dark * rng.random_range(0.8..1.2f32));
        let dots = draw_dots(pattern, config, rng);
        let mark = rng
            .random_bool(config.logo_probability)
            .then(|| random_mark(config, rng));
        let stains = (0..rng.random_range(0..=3))
            .map(|_| Spot {
                middle: random_direction(rng),
                radius: rng.random_range(0.01..0.04),
                softness: 0.012,
                darkness: rng.random_range(0.05..0.4),
            })
            .filter(|_| config.stains)
            .collect();
        Self {
            ball,
            ink,
            dots,
            stains,
            mark,
        }
    }
}

fn draw_dots<R: Rng + ?Sized>(
    pattern: &Pattern,
    config: &SynthConfig,
    rng: &mut R,
) -> Vec<Option<Spot>> {
    let between =
        |range: [f64; 2], rng: &mut R| range[0] + (range[1] - range[0]) * rng.random::<f64>();
    let radius = between(config.dot_radius_rad, rng);
    let misplaced = between(config.misplacement_rad, rng);
    let uneven = rng.random_range(0.02..0.12);
    let softness = radius * rng.random_range(0.05..0.35);
    let darkness = rng.random_range(0.75..1.0f32);
    pattern
        .dots()
        .iter()
        .map(|dot| {
            let left_out = rng.random_bool(config.left_out);
            let [e1, e2] = tangent_frame(dot);
            let mut off = || rng.sample::<f64, _>(StandardNormal);
            let moved = dot + (e1 * off() + e2 * off()) * misplaced;
            let scale = (1.0 + uneven * off()).max(0.5);
            let spot = Spot {
                middle: moved.normalize(),
                radius: radius * scale,
                softness,
                darkness: (darkness * (1.0 + 0.05 * off() as f32)).clamp(0.3, 1.0),
            };
            (!left_out).then_some(spot)
        })
        .collect()
}

fn random_mark<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Mark {
    let middle = random_direction(rng);
    let [e1, e2] = tangent_frame(&middle);
    let (s, c) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
    let dark = rng.random_range(0.02..0.25f32);
    let color = if rng.random_bool(0.6) {
        [dark; 3]
    } else {
        // A colored print: one channel may stay bright.
        [0, 1, 2].map(|_| dark * rng.random_range(0.5..2.5f32))
    };
    let [low, high] = config.logo_radius_rad;
    Mark {
        logo: Logo::random(LogoKind::random(rng), rng),
        middle,
        axes: [e1 * c + e2 * s, e2 * c - e1 * s],
        radius: rng.random_range(low..high),
        color,
    }
}

/// White, orange, yellow, or any color bright enough for dark dots.
fn ball_color<R: Rng + ?Sized>(rng: &mut R) -> [f32; 3] {
    let base: [f32; 3] = match rng.random_range(0..10) {
        0..4 => [0.85, 0.85, 0.82],
        4..8 => [0.80, 0.32, 0.06],
        8 => [0.80, 0.70, 0.12],
        _ => [
            rng.random_range(0.2..0.9),
            rng.random_range(0.3..0.9),
            rng.random_range(0.2..0.9),
        ],
    };
    base.map(|c| (c * rng.random_range(0.85..1.12f32)).clamp(0.02, 0.98))
}
