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
use crate::design::config::DesignConfig;
use crate::design::descent::{Cost, Descent};
use crate::design::objective::{Evaluation, OrientationBound, basis};
use crate::design::state::Candidate;
use crate::error::Result;
use crate::geometry::{Vec3, random_direction};
use crate::pattern::{Pattern, random_pattern};
use crate::recognize::robust::RobustRecognizer;
use crate::validate::{Proportion, Trials, Validation};

/// Maximum displacement of the dots of an existing pattern that makes a start, radians.
const SHAKE_RAD: f64 = 0.05;
/// From the second round on, every start except each of this number begins from the best so far.
const FRESH_EVERY: usize = 4;
/// Maximum number of dots of a good pattern that are moved elsewhere to make a start.
const MAX_MOVED: usize = 4;

/// The weighted sum that a descent lowers.
struct DesignCost<'a>(&'a DesignConfig);

impl Cost for DesignCost<'_> {
    fn cost(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let config = self.0;
        let mut at = config.objective.cost(dots)?;
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
fn first_pattern(config: &DesignConfig, pool: &[Candidate], start: usize) -> Result<Pattern> {
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
    pool: &[Candidate],
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

/// A pattern with its values.
fn candidate(
    config: &DesignConfig,
    start: usize,
    before: f64,
    pattern: &Pattern,
) -> Result<Candidate> {
    Ok(Candidate {
        start,
        value_before: before,
        value: config.objective.evaluate_at(pattern.dots())?.value,
        cost: DesignCost(config).cost(pattern.dots())?.value,
        missed: config.constraints.missed(pattern),
        short_of_goal: config.bound_goal.is_some_and(|goal| {
            let bound = OrientationBound::default().summary(pattern.dots());
            !(bound.mean <= goal.mean && bound.worst <= goal.worst)
        }),
        identity: None,
        dots: pattern.dots().iter().map(|d| [d.x, d.y, d.z]).collect(),
    })
}

/// A start after its first steps, or after as many as there were before the stop.
pub(super) fn scout(
    config: &DesignConfig,
    pool: &[Candidate],
    start: usize,
    stop: &AtomicBool,
) -> Result<Candidate> {
    let first = first_pattern(config, pool, start)?;
    let before = config.objective.evaluate_at(first.dots())?.value;
    let descent = Descent {
        stop,
        ..Descent::of_steps(config.scout_steps)
    };
    let found = descent.run(&first, &DesignCost(config), &config.constraints)?;
    candidate(config, start, before, &found)
}

/// A scouted start, taken down to the end, or until the stop.
pub(super) fn climb(
    config: &DesignConfig,
    scouted: &Candidate,
    stop: &AtomicBool,
) -> Result<Candidate> {
    let descent = Descent {
        stop,
        ..Descent::of_steps(config.climb_steps)
    };
    let found = descent.run(
        &scouted.pattern()?,
        &DesignCost(config),
        &config.constraints,
    )?;
    candidate(config, scouted.start, scouted.value_before, &found)
}

/// A candidate's rate ([`Candidate::identity`]) with the robust recognizer.
pub(super) fn rate(
    config: &DesignConfig,
    candidate: &Candidate,
    seed: u64,
    samples: u64,
) -> Result<Proportion> {
    let pattern = candidate.pattern()?;
    let trials = Trials::first(&pattern, *config.protocol.view(), seed, samples);
    let robust = RobustRecognizer::new(&pattern, trials.view.into())?;
    let found = trials.run(&robust, &|_| {})?;
    let found = Validation::of(&found, config.protocol.name(), &trials);
    Ok(match config.constraints.drawn {
        0 => found.identity,
        _ => found.answered_right(),
    })
}

/// Adds trials to a candidate's.
pub(super) fn attempt(
    config: &DesignConfig,
    candidate: &mut Candidate,
    seed: u64,
    samples: u64,
) -> Result<()> {
    let new = rate(config, candidate, seed, samples)?;
    let (successes, trials) = candidate
        .identity
        .map_or((0, 0), |p| (p.successes, p.trials));
    candidate.identity = Some(Proportion::new(
        successes + new.successes,
        trials + new.trials,
    ));
    Ok(())
}
