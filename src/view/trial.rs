//! One simulated view of a pattern, with its ground truth.

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson};

use super::{Detection, FalseDots, ObservedDot, ViewModel};
use crate::geometry::{Rotation, Vec3, random_direction_above, random_rotation};

/// Where in a trial's stream the random numbers of one more dot begin: beyond those that any trial draws.
const ONE_MORE: u128 = 1 << 40;

/// A view and its truth.
#[derive(Debug, Clone, Default)]
pub struct Trial {
    /// Maps pattern to camera.
    pub rotation: Rotation,
    /// The dots as given to the recognizer.
    pub dots: Vec<ObservedDot>,
    /// Each dot's index in the pattern, or `None` for a false dot.
    pub truth: Vec<Option<u16>>,
    given: Vec<(ObservedDot, Option<u16>)>,
}

impl Trial {
    /// Dots that are the pattern's.
    pub fn real_dots(&self) -> usize {
        self.truth.iter().flatten().count()
    }
}

/// Draws the trials of a view model: trial `i` of seed `s` uses stream `i` of a ChaCha8 generator
/// seeded with `s`, so that any trial can be drawn on its own. Every trial shows the ball.
#[derive(Debug, Clone)]
pub struct TrialGenerator<'p> {
    dots: &'p [Vec3],
    view: ViewModel,
    rng: ChaCha8Rng,
}

impl<'p> TrialGenerator<'p> {
    /// A generator of the trials of a pattern's dots (unit vectors) that belong to `seed`.
    pub fn new(dots: &'p [Vec3], view: ViewModel, seed: u64) -> Self {
        Self {
            dots,
            view,
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Shows one more dot in trial `index`, which was just drawn: as the pattern's next number, by random numbers that the
    /// trial itself does not use, so that nothing else of it changes. Where a fixed number of dots is given, it is not.
    pub fn show_one_more(&mut self, dot: &Vec3, index: u64, trial: &mut Trial) {
        let Self { dots, view, rng } = self;
        let Detection::Each { probability } = view.detection else {
            return;
        };
        rng.set_stream(index);
        rng.set_word_pos(ONE_MORE);
        let q = trial.rotation * dot;
        let is_detected = rng.random::<f64>() >= 1.0 - probability;
        if q.z > view.visibility_limit && is_detected {
            trial
                .dots
                .push(view.noise.displaced(&q, view.noise_scale, rng));
            trial.truth.push(Some(dots.len() as u16));
        }
    }

    /// Draws trial number `index`, independent of earlier calls.
    pub fn generate(&mut self, index: u64, trial: &mut Trial) {
        let Self { dots, view, rng } = self;
        rng.set_stream(index);
        rng.set_word_pos(0);
        trial.rotation = random_rotation(rng);
        let mut given = std::mem::take(&mut trial.given);
        given.clear();
        for (j, dot) in dots.iter().enumerate() {
            let q = trial.rotation * dot;
            if q.z > view.visibility_limit {
                let seen = view.noise.displaced(&q, view.noise_scale, rng);
                given.push((seen, Some(j as u16)));
            }
        }
        match view.detection {
            Detection::Each { probability } if probability < 1.0 => {
                given.retain(|_| rng.random::<f64>() >= 1.0 - probability);
            }
            Detection::Each { .. } => {}
            Detection::Given { dots } => {
                given.shuffle(rng);
                let enough = given.len() >= dots;
                given.truncate(if enough { dots } else { 0 });
            }
        }
        let false_dots = match view.false_dots {
            FalseDots::Usual(number) => usize::from(number),
            // A mean that is none has been refused by the model's check.
            FalseDots::Poisson(mean) => Poisson::new(mean).map_or(0, |p| p.sample(rng) as usize),
        };
        for _ in 0..false_dots {
            let direction = random_direction_above(rng, view.false_dot_limit);
            given.push((view.noise.observed(direction), None));
        }
        given.shuffle(rng);
        trial.dots.clear();
        trial.truth.clear();
        for &(dot, index) in &given {
            trial.dots.push(dot);
            trial.truth.push(index);
        }
        trial.given = given;
    }
}
