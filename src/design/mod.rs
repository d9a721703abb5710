//! Designing patterns: the objective with its gradient, the descent, and the search over many starts.
//!
//! Each start is a random pattern, improved by L-BFGS on the objective and then judged by Monte Carlo
//! on trials that belong to the selection's seed; the best candidate by that rate wins. What is reported
//! afterwards must come from other seeds: the winner of many is lucky on the trials that chose it.

pub mod descent;
pub mod objective;

use std::sync::atomic::{AtomicBool, Ordering};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::error::{Error, Result};
use crate::pattern::Pattern;
use crate::recognise::robust::RobustRecogniser;
use crate::validate::{Protocol, ProtocolName, Validation, validate};
use descent::{Constraints, coordinates, descend, random_pattern};
use objective::MeanNearestNeighbour;

/// How a design runs.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DesignConfig {
    /// Dots of the pattern.
    pub dots: usize,
    /// Seed of the random starts; the trials' seeds are derived from it.
    pub seed: u64,
    /// Random starts.
    pub starts: usize,
    /// Steps of L-BFGS a start.
    pub steps: u64,
    /// Monte Carlo trials a candidate.
    pub samples: u64,
    /// The protocol whose identity rate chooses among candidates.
    pub protocol: ProtocolName,
    /// What a pattern must satisfy.
    pub constraints: Constraints,
    /// The objective.
    pub objective: MeanNearestNeighbour,
}

impl Default for DesignConfig {
    /// 20 dots, 12 starts of 60 steps, 10 000 trials of `sparse` each.
    fn default() -> Self {
        Self {
            dots: 20,
            seed: 0,
            starts: 12,
            steps: 60,
            samples: 10_000,
            protocol: ProtocolName::Sparse,
            constraints: Constraints::default(),
            objective: MeanNearestNeighbour::default(),
        }
    }
}

impl DesignConfig {
    /// Seed of the trials that choose among candidates.
    pub fn selection_seed(&self) -> u64 {
        self.seed ^ 0x5e1e_c710_4e5e_ed00
    }

    /// Seed of the trials that are reported; never used before the winner is known.
    pub fn report_seed(&self) -> u64 {
        self.seed ^ 0x4e90_47ed_5eed_0000
    }
}

/// A pattern that came out of one start.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Which start, counted from 0.
    pub start: usize,
    /// The pattern.
    pub pattern: Pattern,
    /// The objective before and after the descent.
    pub objective_before: f64,
    /// The objective's value at the pattern.
    pub objective: f64,
    /// Whether the constraints hold.
    pub feasible: bool,
    /// The trials that judge it, on the selection's seed.
    pub validation: Validation,
}

/// Follows a search; all methods are optional.
pub trait DesignObserver {
    /// A candidate has been judged; `best` is the best feasible one so far.
    fn candidate(&mut self, _candidate: &Candidate, _best: Option<&Candidate>) {}
}

impl DesignObserver for () {}

/// Searches for a pattern. Setting `stop` ends the search after the candidate at hand.
///
/// # Errors
/// [`Error::Argument`] where a parameter is out of its domain or no feasible pattern was found.
pub fn design(
    config: &DesignConfig,
    stop: &AtomicBool,
    observer: &mut dyn DesignObserver,
) -> Result<Candidate> {
    if config.starts == 0 {
        return Err(Error::argument("starts", "expected at least 1"));
    }
    if config.samples == 0 {
        return Err(Error::argument("samples", "expected at least 1 trial"));
    }
    let mut best: Option<Candidate> = None;
    for start in 0..config.starts {
        if stop.load(Ordering::Relaxed) && best.is_some() {
            break;
        }
        let candidate = try_start(config, start)?;
        let better = best
            .as_ref()
            .is_none_or(|b| candidate.validation.identity.rate > b.validation.identity.rate);
        if candidate.feasible && better {
            best = Some(candidate.clone());
        }
        observer.candidate(&candidate, best.as_ref());
    }
    best.ok_or_else(|| {
        Error::argument(
            "constraints",
            "no start led to a pattern that satisfies them; ask for less separation, fewer visible dots or more starts",
        )
    })
}

fn try_start(config: &DesignConfig, start: usize) -> Result<Candidate> {
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    rng.set_stream(start as u64);
    let separation = config.constraints.least_separation_rad;
    let first = random_pattern(config.dots, separation, &mut rng)?;
    let pattern = descend(&first, &config.objective, &config.constraints, config.steps)?;
    let protocol = Protocol::standard(config.protocol);
    let recogniser = RobustRecogniser::new(&pattern, protocol.recogniser_config())?;
    Ok(Candidate {
        start,
        objective_before: config.objective.evaluate(&coordinates(&first))?.value,
        objective: config.objective.evaluate(&coordinates(&pattern))?.value,
        feasible: config.constraints.check(&pattern),
        validation: validate(
            &pattern,
            &recogniser,
            &protocol,
            config.selection_seed(),
            config.samples,
        )?,
        pattern,
    })
}
