//! The pieces of work that a search is made of: a start, its descent, its trials.
//!
//! Each is a function of the configuration, the start's number and, from the second round on, the best so
//! far: whichever thread does it, and whenever, it comes out the same.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::objective::{Evaluation, OrientationBound};
use super::scp::{Cost, descend};
use super::search::{Candidate, DesignConfig};
use super::start::{move_dots, random_pattern};
use crate::error::Result;
use crate::geometry::{Vec3, random_direction};
use crate::hash::{HashTable, PairRule, RecogniserParams};
use crate::pattern::Pattern;
use crate::recognise::RecogniserName;
use crate::validate::{Proportion, validate_named};

/// How far the dots of an existing pattern are shaken to make a start of it, radians.
const SHAKE_RAD: f64 = 0.05;
/// From the second round on, all starts but each of this number are made from the best so far.
const FRESH_EVERY: usize = 4;
/// Most dots of a good pattern that are put elsewhere to make a start of it.
const MOST_MOVED: usize = 4;

/// The weighted sum that a descent lowers.
struct DesignCost<'a>(&'a DesignConfig);

impl Cost for DesignCost<'_> {
    fn cost(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let mut at = self.0.objective.cost(dots)?;
        let weight = self.0.bound_weight;
        if weight > 0.0 {
            let bound = OrientationBound::default().cost(dots);
            at.value += weight * bound.value;
            for (g, b) in at.gradient.iter_mut().zip(&bound.gradient) {
                *g += weight * b;
            }
        }
        Ok(at)
    }
}

/// A start: random; the given pattern shaken (start 0: as it is); or, once there are good ones, one of
/// them with some dots put elsewhere.
fn first_pattern(config: &DesignConfig, pool: &[Candidate], start: usize) -> Result<Pattern> {
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    rng.set_stream(start as u64);
    let separation = config.constraints.least_separation_rad;
    let improve = config.from.is_none() && !pool.is_empty();
    if improve && !start.is_multiple_of(FRESH_EVERY) {
        let good = pool[rng.random_range(0..pool.len())].pattern()?;
        let moved = rng.random_range(1..=MOST_MOVED.min(good.len()));
        return move_dots(&good, moved, separation, &mut rng);
    }
    let Some(from) = &config.from else {
        return random_pattern(config.dots, separation, &mut rng);
    };
    let shake = if start == 0 { 0.0 } else { SHAKE_RAD };
    Pattern::new(
        from.iter()
            .map(|d| (Vec3::from(*d) + shake * random_direction(&mut rng)).normalize())
            .collect(),
    )
}

fn candidate(
    config: &DesignConfig,
    start: usize,
    before: f64,
    pattern: &Pattern,
) -> Result<Candidate> {
    Ok(Candidate {
        start,
        figure_before: before,
        figure: config.objective.figure(pattern.dots())?.value,
        cost: DesignCost(config).cost(pattern.dots())?.value,
        missed: config.constraints.missed(pattern),
        identity: None,
        dots: pattern.dots().iter().map(|d| [d.x, d.y, d.z]).collect(),
    })
}

/// A start after its first steps.
pub(super) fn scout(config: &DesignConfig, pool: &[Candidate], start: usize) -> Result<Candidate> {
    let first = first_pattern(config, pool, start)?;
    let before = config.objective.figure(first.dots())?.value;
    let found = descend(
        &first,
        &DesignCost(config),
        &config.constraints,
        config.scout_steps,
    )?;
    candidate(config, start, before, &found)
}

/// A scouted start, taken down to the end.
pub(super) fn climb(config: &DesignConfig, scouted: &Candidate) -> Result<Candidate> {
    let pattern = scouted.pattern()?;
    let found = descend(
        &pattern,
        &DesignCost(config),
        &config.constraints,
        config.climb_steps,
    )?;
    candidate(config, scouted.start, scouted.figure_before, &found)
}

/// Adds trials to a candidate's.
pub(super) fn attempt(
    config: &DesignConfig,
    candidate: &mut Candidate,
    seed: u64,
    samples: u64,
) -> Result<()> {
    let table = HashTable::build(
        candidate.pattern()?,
        PairRule::default(),
        RecogniserParams::default(),
    )?;
    let robust = RecogniserName::Robust;
    let found = validate_named(&table, robust, &config.protocol, seed, samples)?;
    let new = found.validation.identity;
    let (successes, trials) = candidate
        .identity
        .map_or((0, 0), |p| (p.successes, p.trials));
    candidate.identity = Some(Proportion::new(
        successes + new.successes,
        trials + new.trials,
    ));
    Ok(())
}
