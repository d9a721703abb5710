//! Hand-drawn dots: with a placement error, uneven, streaked.

use std::f64::consts::TAU;

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::config::SynthConfig;
use super::random::{between, between_f32};
pub use super::spot::{Spot, Streaks};
use crate::geometry::{Vec3, random_direction, tangent_frame};
use crate::pattern::Pattern;

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
