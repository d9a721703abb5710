//! What a camera shows of a pattern, in the few numbers that an objective needs.

use nalgebra::{Matrix2, Vector2};

use super::conditions::CameraConditions;
use super::model::{DetectionModel, Terms, can_be_found};
use crate::design::constraints::max_separation;
use crate::design::objective::Coverage;
use crate::error::Result;
use crate::pattern::crowding::crowds;
use crate::pattern::random_pattern;
use crate::synth::dataset::frame_rng;

/// Scenes that are looked at.
const SCENES: u64 = 400;
/// Their seed: the same for every design.
const SEED: u64 = 15_500_001;
/// Minimum weight of a dot in the fit, where it is all but certain or impossible.
const CLEAR: f64 = 0.01;
/// Probability that a dot in the middle is found where nothing prevents it.
const MAX_PROBABILITY: f64 = 0.98;
/// Slopes of a logit by z, between which the fit stays.
const SLOPES: [f64; 2] = [2.0, 50.0];
/// Largest loss to a neighbor.
const MAX_CROWDING: f64 = 5.0;

/// The assumptions of [`Coverage`] for so many dots before a camera: a logistic curve in z for the
/// probability that a dot is found, whose limit varies from scene to scene.
///
/// # Errors
/// [`crate::Error::Argument`] for conditions outside their domain.
pub fn coverage(
    model: &DetectionModel,
    conditions: &CameraConditions,
    dots: usize,
) -> Result<Coverage> {
    conditions.check()?;
    // As near to each other as on random patterns that can be drawn.
    let nearest = (3.0 * conditions.dot_diameter).min(0.5 * max_separation(dots));
    let mut terms = Terms::default();
    let mut found = Detections::default();
    for k in 0..SCENES {
        let pattern = random_pattern(dots, nearest, &mut frame_rng(SEED, k | 1 << 60))?;
        let crowds = crowds(pattern.dots());
        let ball = conditions.scene(&pattern, SEED, k)?.seen()?;
        let mut rng = frame_rng(SEED, k | 1 << 61);
        // Without an outline there are no dots.
        if model.detect(&ball, None, &mut terms, &mut rng).is_none() {
            continue;
        }
        found.shared_variance += model.shared_shift(&ball, &mut terms).powi(2);
        let dots = ball.dots.iter().filter(|d| can_be_found(d));
        let chances = dots.map(|dot| {
            let logit = model.likely_logit(&dot.observables, &mut terms);
            let p = 1.0 / (1.0 + (-logit).exp());
            Chance {
                by: Vector2::new(dot.truth.facing, crowds[dot.truth.index]),
                logit,
                weight: (p * (1.0 - p)).max(CLEAR),
            }
        });
        found.chances.push(chances.collect());
    }
    Ok(found.summary())
}

/// A dot that could be found: its z and how crowded it is, the logit of the probability that it is, and its weight in a
/// fit.
#[derive(Debug, Clone, Copy)]
struct Chance {
    by: Vector2<f64>,
    logit: f64,
    weight: f64,
}

/// What is found in many scenes.
#[derive(Debug, Default)]
struct Detections {
    /// By scene.
    chances: Vec<Vec<Chance>>,
    /// Variance of the logit that the dots of a scene share beyond what is known of it.
    shared_variance: f64,
}

impl Detections {
    /// A logistic curve of one width for all scenes, whose limit differs from scene to scene.
    fn summary(&self) -> Coverage {
        let scenes = || self.chances.iter().map(|scene| mean_of(scene));
        let (mut products, mut squares) = (Vector2::zeros(), Matrix2::identity() * 1e-9);
        for (scene, mean) in self.chances.iter().zip(scenes()) {
            for c in scene {
                let off = c.by - mean.by;
                products += c.weight * (c.logit - mean.logit) * off;
                squares += c.weight * off * off.transpose();
            }
        }
        let slopes = squares.try_inverse().unwrap_or_default() * products;
        let slope = slopes.x.clamp(SLOPES[0], SLOPES[1]);
        let crowding = (-slopes.y).clamp(0.0, MAX_CROWDING);
        let limits: Vec<f64> = scenes()
            .filter(|mean| mean.weight > 0.0)
            .map(|mean| mean.by.x - (mean.logit + crowding * mean.by.y) / slope)
            .collect();
        let count = limits.len().max(1) as f64;
        let limit = limits.iter().sum::<f64>() / count;
        let spread = limits.iter().map(|l| (l - limit).powi(2)).sum::<f64>() / count;
        let shared = self.shared_variance / count / (slope * slope);
        Coverage {
            visibility_limit: limit.clamp(-0.5, 0.9),
            softness: 1.0 / slope,
            limit_spread: (spread + shared).sqrt(),
            detection_probability: MAX_PROBABILITY,
            crowding,
        }
    }
}

/// The weighted means of a scene, and the sum of the weights.
fn mean_of(scene: &[Chance]) -> Chance {
    let weight: f64 = scene.iter().map(|c| c.weight).sum();
    let mean = |f: &dyn Fn(&Chance) -> f64| {
        scene.iter().map(|c| c.weight * f(c)).sum::<f64>() / weight.max(1e-12)
    };
    Chance {
        by: Vector2::new(mean(&|c| c.by.x), mean(&|c| c.by.y)),
        logit: mean(&|c| c.logit),
        weight,
    }
}
