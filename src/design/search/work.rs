//! The units of work of a search: a start, its descent, its trials.
//!
//! Each is a function of the configuration, the start's number and, from the second round on, the
//! best patterns so far. The result does not depend on the thread or the time of the work.

use std::sync::atomic::AtomicBool;

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::feasible::start_separation;
use super::start::{add_dots, move_dots};
use crate::ball::Ball;
use crate::design::config::DesignConfig;
use crate::design::descent::{Cost, Descent};
use crate::design::objective::{Evaluation, Objective, OrientationBound, basis};
use crate::design::state::DesignCandidate;
use crate::error::{Error, Result};
use crate::geometry::{Vec3, random_direction};
use crate::pattern::{Pattern, random_pattern};
use crate::recognize::NamedRecognizer;
use crate::validate::{Proportion, ValidationConfig};

/// Maximum displacement of the dots of an existing pattern that makes a start, radians.
const SHAKE_RAD: f64 = 0.05;
/// From the second round on, every start except each of this number begins from the best so far.
const FRESH_EVERY: usize = 4;
/// Maximum number of dots of a good pattern that are moved elsewhere to make a start.
const MAX_MOVED: usize = 4;

/// The weighted sum that a descent lowers.
struct DesignCost<'a> {
    config: &'a DesignConfig,
    objective: Objective,
}

impl<'a> DesignCost<'a> {
    /// For first steps.
    fn soft(config: &'a DesignConfig) -> Self {
        Self {
            config,
            objective: config.objective.clone(),
        }
    }

    /// For last ones.
    fn sharp(config: &'a DesignConfig) -> Self {
        Self {
            config,
            objective: config.objective.clone().sharpened(),
        }
    }
}

impl Cost for DesignCost<'_> {
    fn cost(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let config = self.config;
        let mut at = self.objective.cost(dots)?;
        let mut add = |weight: f64, term: &Evaluation, slope: f64| {
            at.value += weight * term.value;
            for (g, t) in at.gradient.iter_mut().zip(&term.gradient) {
                *g += weight * slope * t;
            }
        };
        if config.bound_weight > 0.0 {
            let bound = OrientationBound::default().cost(dots);
            add(config.bound_weight, &bound, 1.0);
        }
        if config.basis_weight > 0.0 {
            // Its logarithm, as of the objective.
            let mut bases = basis::evaluate(dots);
            let slope = 1.0 / bases.value;
            bases.value = bases.value.ln();
            add(config.basis_weight, &bases, slope);
        }
        Ok(at)
    }
}

/// A start: random; the given pattern with displaced dots (start 0: unchanged); or, once there are
/// good ones, one of them with some dots placed elsewhere.
fn first_pattern(config: &DesignConfig, pool: &[DesignCandidate], start: usize) -> Result<Pattern> {
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    rng.set_stream(start as u64);
    let separation = config.constraints.min_separation_rad;
    if config.constraints.drawn > 0 {
        return added_pattern(config, pool, start, &mut rng);
    }
    let improve = config.from.is_none() && !pool.is_empty();
    if improve && !start.is_multiple_of(FRESH_EVERY) {
        let good = pool[rng.random_range(0..pool.len())].pattern()?;
        let moved = rng.random_range(1..=MAX_MOVED.min(good.len()));
        return move_dots(&good, moved, separation, &mut rng);
    }
    let Some(from) = &config.from else {
        let separation = start_separation(config.dots, separation);
        return random_pattern(config.dots, separation, &mut rng);
    };
    let shake = if start == 0 { 0.0 } else { SHAKE_RAD };
    Pattern::new(
        from.iter()
            .map(|d| (Vec3::from(*d) + shake * random_direction(&mut rng)).normalize())
            .collect(),
    )
}

/// The drawn dots with others at random; or, once there are good ones, one of them with some of its added dots
/// placed elsewhere.
fn added_pattern(
    config: &DesignConfig,
    pool: &[DesignCandidate],
    start: usize,
    rng: &mut ChaCha8Rng,
) -> Result<Pattern> {
    let drawn = config.constraints.drawn;
    let mut dots: Vec<Vec3> = config
        .from
        .iter()
        .flatten()
        .map(|d| Vec3::from(*d))
        .collect();
    if !pool.is_empty() && !start.is_multiple_of(FRESH_EVERY) {
        let mut good = pool[rng.random_range(0..pool.len())]
            .pattern()?
            .dots()
            .to_vec();
        good[drawn..].shuffle(rng);
        let moved = rng.random_range(1..=MAX_MOVED.min(good.len() - drawn));
        good.truncate(good.len() - moved);
        dots = good;
    }
    add_dots(&mut dots, config.dots, &config.constraints, rng)?;
    Pattern::new(dots)
}

/// A pattern with its values. Costs are compared as the end of a descent has them.
fn candidate(
    config: &DesignConfig,
    start: usize,
    before: f64,
    pattern: &Pattern,
) -> Result<DesignCandidate> {
    let cost = DesignCost::sharp(config);
    Ok(DesignCandidate {
        start,
        value_before: before,
        value: cost.objective.evaluate_at(pattern.dots())?.value,
        cost: cost.cost(pattern.dots())?.value,
        missed: config.constraints.missed(pattern),
        short_of_goal: config.bound_goal.is_some_and(|goal| {
            let bound = OrientationBound::default().summary(pattern.dots());
            !(bound.mean <= goal.mean && bound.worst <= goal.worst)
        }),
        answered: None,
        dots: pattern.dots().iter().map(|d| [d.x, d.y, d.z]).collect(),
    })
}

/// A start after its first steps, or after as many as there were before the stop.
pub(super) fn scout(
    config: &DesignConfig,
    pool: &[DesignCandidate],
    start: usize,
    stop: &AtomicBool,
) -> Result<DesignCandidate> {
    let first = first_pattern(config, pool, start)?;
    let cost = DesignCost::soft(config);
    let before = DesignCost::sharp(config)
        .objective
        .evaluate_at(first.dots())?
        .value;
    let found =
        descent(config, config.scout_steps, stop).run(&first, &cost, &config.constraints)?;
    candidate(config, start, before, &found)
}

/// A scouted start, taken down to the end, or until the stop.
pub(super) fn climb(
    config: &DesignConfig,
    scouted: &DesignCandidate,
    stop: &AtomicBool,
) -> Result<DesignCandidate> {
    let cost = DesignCost::sharp(config);
    let descent = descent(config, config.climb_steps, stop);
    let found = descent.run(&scouted.pattern()?, &cost, &config.constraints)?;
    candidate(config, scouted.start, scouted.value_before, &found)
}

fn descent<'a>(config: &DesignConfig, steps: u64, stop: &'a AtomicBool) -> Descent<'a> {
    Descent {
        method: config.descent,
        steps,
        stop,
    }
}

/// Right orientations of all views of a candidate: of each protocol an equal part of `samples` trials.
pub(super) fn rate(
    config: &DesignConfig,
    candidate: &DesignCandidate,
    (seed, samples): (u64, u64),
    stop: &AtomicBool,
) -> Result<Option<Proportion>> {
    let ball = Ball::new(candidate.pattern()?);
    let (mut successes, mut trials) = (0, 0);
    for &protocol in &config.protocols {
        let part = ValidationConfig {
            recognizer: config.recognizer,
            protocol,
            seed,
            samples: samples.div_ceil(config.protocols.len() as u64),
        };
        let view = part.protocol.view();
        let recognizer = NamedRecognizer::for_orientations(part.recognizer, &ball, view)?;
        let found = match part.run_by(&recognizer, &ball, Some(stop)) {
            Err(Error::Stopped) => return Ok(None),
            found => found?.validation.answered,
        };
        successes += found.successes;
        trials += found.trials;
    }
    Ok(Some(Proportion::new(successes, trials)))
}
