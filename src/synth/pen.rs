//! Hand-drawn dots: with a placement error, uneven, streaked.
//!
//! A dot is a cap of the angular radius `rho` with a soft edge. Its ink falls from 1 to 0 between
//! `rho - s` and `rho + s`, linearly in the cosine of the angle, which is cheap to compute. A
//! stretched dot has the radius `rho (1 + e cos(2 phi))`, `phi` the angle from its longer axis.

use std::f64::consts::TAU;

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::config::SynthConfig;
use super::random::{between, between_f32};
use crate::geometry::{Vec3, random_direction, tangent_frame};
use crate::pattern::Pattern;

/// A round or nearly round mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its middle.
    pub middle: Vec3,
    /// Its longer and its shorter axis, unit tangents at the middle.
    pub axes: [Vec3; 2],
    /// Its angular radius, radians.
    pub radius: f64,
    /// Half the angle over which its edge fades, radians.
    pub softness: f64,
    /// Share of the light that its ink takes, in [0, 1].
    pub darkness: f32,
    /// (long axis - short axis) / (long + short).
    pub elongation: f32,
    /// Streaks of the pen.
    pub streaks: Streaks,
}

/// Lines that a pen leaves thinner.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Streaks {
    /// Maximum part of the ink that is missing, in [0, 1].
    pub depth: f32,
    /// Lines over the dot's radius.
    pub frequency: f32,
    /// Their phase, radians.
    pub phase: f32,
}

impl Spot {
    /// A round mark of even ink.
    pub fn round(middle: Vec3, radius: f64, softness: f64, darkness: f32) -> Self {
        Self {
            middle,
            axes: tangent_frame(&middle),
            radius,
            softness,
            darkness,
            elongation: 0.0,
            streaks: Streaks::default(),
        }
    }

    /// The mark, stretched along the part of `along` that is tangent to the ball.
    pub fn stretched(mut self, along: Vec3, elongation: f32) -> Self {
        let tangent = along - self.middle * along.dot(&self.middle);
        if let Some(axis) = tangent.try_normalize(1e-6) {
            self.axes = [axis, self.middle.cross(&axis)];
        }
        self.elongation = elongation;
        self
    }

    /// Angle from the middle beyond which there is no ink, radians.
    pub fn reach(&self) -> f64 {
        self.radius * (1.0 + f64::from(self.elongation)) + self.softness
    }
}

/// What a pen's dots have in common.
struct Pen {
    radius: f64,
    spread: f64,
    placement_sigma: f64,
    softness: f64,
    density: f32,
    elongation: f32,
    streaks: f32,
}

impl Pen {
    fn random<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Self {
        let radius = between(config.dot_radius_rad, rng);
        Self {
            radius,
            spread: between(config.dot_radius_spread, rng),
            placement_sigma: between(config.placement_sigma_rad, rng),
            softness: radius * rng.random_range(0.05..0.35),
            density: between_f32(config.ink_density, rng),
            elongation: between_f32([0.0, config.max_dot_elongation], rng),
            streaks: between_f32([0.0, config.max_streaks], rng) * rng.random::<f32>(),
        }
    }

    /// The dot meant for the direction `at`. It takes the same number of random numbers whatever
    /// they are.
    fn dot<R: Rng + ?Sized>(&self, at: &Vec3, rng: &mut R) -> Spot {
        let [e1, e2] = tangent_frame(at);
        let mut off = || rng.sample::<f64, _>(StandardNormal);
        let moved = at + (e1 * off() + e2 * off()) * self.placement_sigma;
        let scale = (1.0 + self.spread * off()).clamp(0.5, 1.6);
        let density = self.density * (1.0 + 0.06 * off() as f32);
        let (s, c) = (TAU * rng.random::<f64>()).sin_cos();
        let spot = Spot::round(
            moved.normalize(),
            self.radius * scale,
            self.softness,
            density.clamp(0.2, 1.0),
        );
        let mut spot = spot.stretched(e1 * c + e2 * s, self.elongation * rng.random::<f32>());
        spot.streaks = Streaks {
            depth: self.streaks,
            frequency: rng.random_range(3.0..9.0),
            phase: rng.random_range(0.0..6.0),
        };
        spot
    }
}

/// The pattern's dots as drawn, by index; `None` where one was left out.
pub(super) fn draw_pattern<R: Rng + ?Sized>(
    pattern: &Pattern,
    config: &SynthConfig,
    pen: &mut R,
    rng: &mut R,
) -> Vec<Option<Spot>> {
    let pen = Pen::random(config, pen);
    let dots = pattern.dots().iter();
    dots.map(|dot| {
        let left_out = rng.random_bool(config.left_out);
        let spot = pen.dot(dot, rng);
        (!left_out).then_some(spot)
    })
    .collect()
}

/// The dots of a random pattern: 8 to 32, with a minimum separation.
pub(super) fn draw_strangers<R: Rng + ?Sized>(
    config: &SynthConfig,
    pen: &mut R,
    rng: &mut R,
) -> Vec<Spot> {
    let pen = Pen::random(config, pen);
    let count: u32 = rng.random_range(8..=32);
    let apart = (1.3 / f64::from(count).sqrt()).cos();
    let mut middles: Vec<Vec3> = Vec::new();
    // Dart throwing; what does not fit after so many throws is left out.
    for _ in 0..50 * count {
        let at = random_direction(rng);
        if middles.len() < count as usize && middles.iter().all(|m| m.dot(&at) < apart) {
            middles.push(at);
        }
    }
    middles.iter().map(|m| pen.dot(m, rng)).collect()
}
