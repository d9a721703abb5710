//! Blotches: irregular patches of paint, as on the balls that animals run on.
//!
//! A blotch is a cluster of overlapping spots, each stretched another way. Blotches are added until they cover the share of the ball that
//! is wanted.

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::spot::Spot;
use crate::geometry::{Vec3, random_direction, spiral_directions, tangent_frame};

/// Spots of a blotch.
const SPOTS: std::ops::RangeInclusive<usize> = 2..=6;
/// Places at which it is looked up what is covered.
const PLACES: usize = 1_000;
/// Blotches at most.
const MOST: usize = 2_000;

/// How a ball is painted. Pairs are `[minimum, maximum]`; a value is drawn once for a ball, sizes once for a blotch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Blotches {
    /// Share of the ball that is covered.
    pub coverage: [f64; 2],
    /// Angular width of a blotch, radians.
    pub width_rad: [f64; 2],
}

impl Default for Blotches {
    /// 20 to 60 % covered by blotches of 5 to 40 degrees.
    fn default() -> Self {
        Self {
            coverage: [0.2, 0.6],
            width_rad: [0.09, 0.7],
        }
    }
}

impl Blotches {
    /// The spots of a ball's blotches.
    pub fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> Vec<Spot> {
        let [low, high] = self.coverage;
        let wanted = low + (high - low) * rng.random::<f64>();
        let [narrow, wide] = self.width_rad;
        let places: Vec<Vec3> = spiral_directions(PLACES).collect();
        let mut covered = vec![false; places.len()];
        let mut spots = Vec::new();
        for _ in 0..MOST {
            let share = covered.iter().filter(|c| **c).count() as f64 / PLACES as f64;
            if share >= wanted {
                break;
            }
            let middle = random_direction(rng);
            let [e1, e2] = tangent_frame(&middle);
            let width = narrow * (wide / narrow).powf(rng.random());
            // Some paint is thinner.
            let darkness = if rng.random_bool(0.7) {
                rng.random_range(0.85..1.0)
            } else {
                rng.random_range(0.3..0.7)
            };
            for _ in 0..rng.random_range(SPOTS) {
                let mut off = || 0.3 * width * rng.random_range(-1.0..1.0);
                let at = (middle + e1 * off() + e2 * off()).normalize();
                let radius = width * rng.random_range(0.12..0.35);
                let soft = radius * rng.random_range(0.02..0.2);
                let spot = Spot::round(at, radius, soft, darkness)
                    .stretched(random_direction(rng), rng.random_range(0.0..0.4));
                let within = radius.cos();
                for (place, covered) in places.iter().zip(&mut covered) {
                    *covered |= place.dot(&at) > within;
                }
                spots.push(spot);
            }
        }
        spots
    }
}
