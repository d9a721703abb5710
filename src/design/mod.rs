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
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::pattern::{MAX_DOTS, MIN_DOTS, Pattern};
use crate::recognise::robust::RobustRecogniser;
use crate::validate::{Protocol, ProtocolName, Validation, validate};
use descent::{Constraints, coordinates, descend, random_pattern};
use objective::MeanNearestNeighbour;

/// What a descent climbs.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    serde::Serialize,
    serde::Deserialize,
    clap::ValueEnum,
)]
#[serde(rename_all = "kebab-case")]
pub enum ObjectiveName {
    /// The mean distance from each hash feature to its nearest neighbour, as in the SpinDOE paper.
    #[default]
    MeanNn,
}

impl std::fmt::Display for ObjectiveName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::MeanNn => f.pad("mean-nn"),
        }
    }
}

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
    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        if !(MIN_DOTS..=MAX_DOTS).contains(&self.dots) {
            let problem = format!("expected {MIN_DOTS} to {MAX_DOTS}, found {}", self.dots);
            return Err(Error::argument("dots", problem));
        }
        for (name, value) in [
            ("starts", self.starts as u64),
            ("steps", self.steps),
            ("samples", self.samples),
        ] {
            if value == 0 {
                return Err(Error::argument(name, "expected at least 1, found 0"));
            }
        }
        self.constraints.check_demand(self.dots)
    }

    /// Seed of the trials that choose among candidates.
    pub fn selection_seed(&self) -> u64 {
        self.seed ^ 0x5e1e_c700
    }

    /// Seed of the trials that are reported; never used before the winner is known.
    pub fn report_seed(&self) -> u64 {
        self.seed ^ 0x4e90_4700
    }
}

/// A pattern that came out of one start.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Candidate {
    /// Which start, counted from 0.
    pub start: usize,
    /// The pattern (left out of reports, which would swell).
    #[serde(skip)]
    pub pattern: Pattern,
    /// The objective's value at the random start.
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
    ///
    /// # Errors
    /// Whatever the observer meets; it ends the search.
    fn candidate(&mut self, _candidate: &Candidate, _best: Option<&Candidate>) -> Result<()> {
        Ok(())
    }
}

impl DesignObserver for () {}

/// What a search came to.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignOutcome {
    /// The feasible candidate with the highest identity rate on the selection's trials.
    pub best: Candidate,
    /// All candidates, in the order of their starts.
    pub candidates: Vec<Candidate>,
    /// Whether the search was stopped before all starts were tried.
    pub stopped: bool,
}

/// Searches for a pattern. Setting `stop` ends the search after the descents at hand.
///
/// Starts run in parallel; their order, and with it the result, does not depend on the threads.
///
/// # Errors
/// [`Error::Argument`] where a parameter is out of its domain or no feasible pattern was found.
pub fn design(
    config: &DesignConfig,
    stop: &AtomicBool,
    observer: &mut dyn DesignObserver,
) -> Result<DesignOutcome> {
    config.check()?;
    let mut best: Option<usize> = None;
    let mut candidates: Vec<Candidate> = Vec::with_capacity(config.starts);
    let stopped = || stop.load(Ordering::Relaxed);
    let batch = rayon::current_num_threads();
    for first in (0..config.starts).step_by(batch) {
        if stopped() {
            break;
        }
        let starts = first..(first + batch).min(config.starts);
        let descended: Vec<_> = starts
            .into_par_iter()
            .map(|start| Descended::from_start(config, start))
            .collect();
        for found in descended {
            if stopped() {
                break;
            }
            let candidate = found?.judged(config)?;
            let rate = candidate.validation.identity.rate;
            let better = best.is_none_or(|b| rate > candidates[b].validation.identity.rate);
            if candidate.feasible && better {
                best = Some(candidates.len());
            }
            candidates.push(candidate);
            let last = candidates.len() - 1;
            observer.candidate(&candidates[last], best.map(|b| &candidates[b]))?;
        }
    }
    let Some(best) = best else {
        let problem = if candidates.len() < config.starts {
            "stopped before the first candidate that satisfies the constraints"
        } else {
            "no start led to a pattern that satisfies the constraints; ask for less separation, fewer \
             visible dots or more starts"
        };
        return Err(Error::argument("design", problem));
    };
    Ok(DesignOutcome {
        best: candidates[best].clone(),
        stopped: candidates.len() < config.starts,
        candidates,
    })
}

/// A start after its descent, not judged yet.
struct Descended {
    start: usize,
    pattern: Pattern,
    objective_before: f64,
    objective: f64,
}

impl Descended {
    fn from_start(config: &DesignConfig, start: usize) -> Result<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        rng.set_stream(start as u64);
        let separation = config.constraints.least_separation_rad;
        let first = random_pattern(config.dots, separation, &mut rng)?;
        let pattern = descend(&first, &config.objective, &config.constraints, config.steps)?;
        Ok(Self {
            start,
            objective_before: config.objective.evaluate(&coordinates(&first))?.value,
            objective: config.objective.evaluate(&coordinates(&pattern))?.value,
            pattern,
        })
    }

    /// Judges the pattern on the selection's trials.
    fn judged(self, config: &DesignConfig) -> Result<Candidate> {
        let protocol = Protocol::standard(config.protocol);
        let recogniser = RobustRecogniser::new(&self.pattern, protocol.recogniser_config())?;
        let seed = config.selection_seed();
        let found = validate(&self.pattern, &recogniser, &protocol, seed, config.samples)?;
        Ok(Candidate {
            start: self.start,
            objective_before: self.objective_before,
            objective: self.objective,
            feasible: config.constraints.check(&self.pattern),
            validation: found.untimed(),
            pattern: self.pattern,
        })
    }
}
