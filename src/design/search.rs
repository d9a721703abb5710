//! The search: rounds of many starts, each screened, climbed, tried by Monte Carlo and halved.
//!
//! A round takes a number of starts down a few steps (cheap), takes the best quarter down to the end, and
//! tries the best of those by Monte Carlo. The first round starts at random; later ones put a few dots of
//! the best so far elsewhere, and one start in four stays random. The best few of all rounds so far meet again in a last
//! trial, where each halving doubles the trials of those that remain. All trials of one stage of one round
//! share their seed, so that candidates are compared on the same views, and no other stage ever uses it:
//! a candidate cannot have been lucky twice.
//!
//! The search is a deterministic function of its configuration, and its [`State`] after every batch of
//! descents says all that is needed to continue.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::checkpoint::State;
use super::constraints::Constraints;
use super::objective::{Objective, confusion};
use super::work::{attempt, climb, scout};
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::pattern::{MAX_DOTS, MIN_DOTS, Pattern};
use crate::validate::{Proportion, Protocol, ProtocolName};

/// Candidates that a round sends on to the last trial.
const SENT_ON: usize = 3;
/// Candidates kept for the last trial.
const POOL: usize = 12;

/// How a design is searched.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DesignConfig {
    /// Dots of the pattern.
    pub dots: usize,
    /// Seed of the random starts; the trials' seeds are derived from it.
    pub seed: u64,
    /// Random starts a round.
    pub starts: usize,
    /// Rounds.
    pub rounds: usize,
    /// Descent steps of every start.
    pub scout_steps: u64,
    /// Further descent steps of the best quarter.
    pub climb_steps: u64,
    /// Monte Carlo trials a candidate; the last ones get eight times as many.
    pub samples: u64,
    /// The views that candidates are tried on.
    pub protocol: Protocol,
    /// What a pattern must satisfy.
    pub constraints: Constraints,
    /// What a descent works on.
    pub objective: Objective,
    /// Weight of the orientation bound's worst direction beside the objective; 0 leaves it out.
    pub bound_weight: f64,
    /// A pattern to improve instead of random starts.
    pub from: Option<Vec<[f64; 3]>>,
}

impl Default for DesignConfig {
    /// 20 dots, one round of 16 starts, 10 000 trials of `sparse` each, `confusion` beside the
    /// orientation bound.
    fn default() -> Self {
        Self {
            dots: 20,
            seed: 0,
            starts: 16,
            rounds: 1,
            scout_steps: 20,
            climb_steps: 60,
            samples: 10_000,
            protocol: Protocol::standard(ProtocolName::Sparse),
            constraints: Constraints::default(),
            objective: Objective::default(),
            bound_weight: 1.0,
            from: None,
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
            ("rounds", self.rounds as u64),
            ("steps", self.scout_steps.min(self.climb_steps)),
            ("samples", self.samples),
        ] {
            if value == 0 {
                return Err(Error::argument(name, "expected at least 1, found 0"));
            }
        }
        if !(self.bound_weight >= 0.0 && self.bound_weight.is_finite()) {
            let problem = format!("expected a number not below 0, found {}", self.bound_weight);
            return Err(Error::argument("bound weight", problem));
        }
        if !self.objective.name().suits(self.dots) {
            let problem = format!(
                "confusion is worked out for at most {} dots, found {}; choose another",
                confusion::MOST_DOTS,
                self.dots
            );
            return Err(Error::argument("objective", problem));
        }
        self.protocol.check()?;
        self.constraints.check_demand(self.dots)
    }

    /// Seed of the trials of one stage of one round, or of the last trial's halvings.
    pub fn selection_seed(&self, round: usize, halving: usize) -> u64 {
        let stage = (round as u64) << 8 | halving as u64;
        self.seed ^ (0x5e1e_c700 + (stage << 32))
    }

    /// Seed of the trials that are reported; never used before the winner is known.
    pub fn report_seed(&self) -> u64 {
        self.seed ^ 0x4e90_4700
    }
}

/// A pattern on its way through the search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The start it came from, counted over all rounds.
    pub start: usize,
    /// The objective's figure at the start.
    pub figure_before: f64,
    /// The objective's figure now.
    pub figure: f64,
    /// The cost now: objective and bound.
    pub cost: f64,
    /// The demand that it misses, if any; such a candidate is never chosen.
    pub missed: Option<String>,
    /// Identity rate over all trials so far, if it was tried.
    pub identity: Option<Proportion>,
    /// The dots.
    pub dots: Vec<[f64; 3]>,
}

impl Candidate {
    /// The pattern.
    ///
    /// # Errors
    /// [`Error::Argument`] where the dots are none (only in a tampered checkpoint).
    pub fn pattern(&self) -> Result<Pattern> {
        Pattern::new(self.dots.iter().map(|d| Vec3::from(*d)).collect())
    }

    fn rate(&self) -> f64 {
        self.identity.map_or(-1.0, |p| p.rate)
    }
}

/// What a search is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// All starts of the round, a few steps each.
    Scout,
    /// The best quarter, to the end.
    Climb,
    /// Monte Carlo trials of the round's best.
    Try,
    /// The best of all rounds, with more and more trials.
    Halve,
}

/// The best so far, at some time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Milestone {
    /// Seconds since the search began, over all its runs.
    pub elapsed_s: f64,
    /// Rounds completed.
    pub rounds: usize,
    /// The best candidate's identity rate.
    pub identity: Proportion,
}

/// Follows a search; all methods are optional.
pub trait DesignObserver {
    /// Some work of a stage of a round is done.
    ///
    /// # Errors
    /// Whatever the observer meets; it ends the search.
    fn progress(&mut self, _state: &State, _stage: Stage) -> Result<()> {
        Ok(())
    }

    /// Whether another round should be begun; asked after each round that is not the last.
    fn another_round(&mut self, _state: &State) -> bool {
        true
    }
}

impl DesignObserver for () {}

/// What a search came to.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignOutcome {
    /// The winner of the last trial.
    pub best: Candidate,
    /// Those that it met there, best first; itself included.
    pub finalists: Vec<Candidate>,
    /// Starts tried.
    pub starts: usize,
    /// The best rate over time.
    pub milestones: Vec<Milestone>,
    /// Whether the search was stopped before its end.
    pub stopped: bool,
}

/// Searches for a pattern, from the beginning or from where `state` was left. Setting `stop` ends the
/// search after the work at hand with the best so far.
///
/// Descents run in parallel; the result does not depend on the number of threads.
///
/// # Errors
/// [`Error::Argument`] where a parameter is out of its domain or no pattern was found that satisfies the
/// constraints.
pub fn design(
    config: &DesignConfig,
    state: &mut State,
    stop: &AtomicBool,
    observer: &mut dyn DesignObserver,
) -> Result<DesignOutcome> {
    config.check()?;
    let mut search = Search {
        config,
        stop,
        observer,
        clock: Instant::now(),
        before_s: state.elapsed_s,
    };
    let mut stopped = false;
    while state.round < config.rounds && !stopped {
        stopped = !search.round(state)?;
        let more = state.round < config.rounds;
        if !stopped && more && !search.observer.another_round(state) {
            break;
        }
    }
    let finalists = search.halve(state)?;
    let Some(best) = finalists.first().cloned() else {
        return Err(nothing_found(state, stopped));
    };
    Ok(DesignOutcome {
        best,
        finalists,
        starts: state.round * config.starts + state.scouted.len(),
        milestones: state.milestones.clone(),
        stopped,
    })
}

fn nothing_found(state: &State, stopped: bool) -> Error {
    if stopped {
        return Error::argument("design", "stopped before the first candidate was tried");
    }
    let missed = state
        .missed
        .as_ref()
        .map_or(String::new(), |m| format!(" (the last one missed: {m})"));
    let problem = format!(
        "no start led to a pattern that satisfies the constraints{missed}; ask for less separation, \
         fewer visible dots, a smaller seam margin, or more starts"
    );
    Error::argument("design", problem)
}

struct Search<'a> {
    config: &'a DesignConfig,
    stop: &'a AtomicBool,
    observer: &'a mut dyn DesignObserver,
    clock: Instant,
    before_s: f64,
}

impl Search<'_> {
    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn note(&mut self, state: &mut State, stage: Stage) -> Result<()> {
        state.elapsed_s = self.before_s + self.clock.elapsed().as_secs_f64();
        self.observer.progress(state, stage)
    }

    /// One round, or the rest of it; `false` if stopped before its end.
    fn round(&mut self, state: &mut State) -> Result<bool> {
        let config = self.config;
        let first = state.round * config.starts;
        while state.scouted.len() < config.starts {
            if self.stopped() {
                break;
            }
            let from = first + state.scouted.len();
            let to = (from + rayon::current_num_threads()).min(first + config.starts);
            let pool = &state.pool;
            let found: Result<Vec<_>> = (from..to)
                .into_par_iter()
                .map(|s| scout(config, pool, s))
                .collect();
            state.scouted.extend(found?);
            self.note(state, Stage::Scout)?;
        }
        let mut best: Vec<&Candidate> = state.scouted.iter().collect();
        best.sort_by(|a, b| a.cost.total_cmp(&b.cost).then(a.start.cmp(&b.start)));
        let chosen: Vec<Candidate> = best
            .into_iter()
            .take(config.starts.div_ceil(4))
            .cloned()
            .collect();
        while state.climbed.len() < chosen.len() {
            // Stopped: what has been scouted is tried as it is.
            if self.stopped() {
                break;
            }
            let from = state.climbed.len();
            let to = (from + rayon::current_num_threads()).min(chosen.len());
            let found: Result<Vec<_>> = chosen[from..to]
                .par_iter()
                .map(|c| climb(config, c))
                .collect();
            state.climbed.extend(found?);
            self.note(state, Stage::Climb)?;
        }
        let complete = state.scouted.len() == config.starts && state.climbed.len() == chosen.len();
        let mut tried = if state.climbed.is_empty() {
            chosen
        } else {
            state.climbed.clone()
        };
        state.missed = tried.iter().rev().find_map(|c| c.missed.clone());
        tried.retain(|c| c.missed.is_none());
        tried.sort_by(|a, b| a.cost.total_cmp(&b.cost).then(a.start.cmp(&b.start)));
        tried.truncate(2 * SENT_ON);
        let seed = config.selection_seed(state.round + 1, 0);
        for candidate in &mut tried {
            attempt(config, candidate, seed, config.samples)?;
            self.note(state, Stage::Try)?;
        }
        sort_by_rate(&mut tried);
        tried.truncate(SENT_ON);
        state.pool.append(&mut tried);
        sort_by_rate(&mut state.pool);
        state.pool.truncate(POOL);
        if complete {
            state.round += 1;
            state.scouted.clear();
            state.climbed.clear();
        }
        self.milestone(state);
        self.note(state, Stage::Try)?;
        Ok(complete)
    }

    fn milestone(&mut self, state: &mut State) {
        if let Some(identity) = state.pool.first().and_then(|c| c.identity) {
            state.milestones.push(Milestone {
                elapsed_s: self.before_s + self.clock.elapsed().as_secs_f64(),
                rounds: state.round,
                identity,
            });
        }
    }

    /// The last trial: the pool meets on fresh views, and each halving doubles them.
    fn halve(&mut self, state: &mut State) -> Result<Vec<Candidate>> {
        let config = self.config;
        let mut field = state.pool.clone();
        let mut out: Vec<Candidate> = Vec::new();
        let mut halving = 0;
        while field.len() > 1 {
            let seed = config.selection_seed(0, halving);
            let samples = config.samples << halving.min(3);
            for candidate in &mut field {
                attempt(config, candidate, seed, samples)?;
                self.note(state, Stage::Halve)?;
            }
            sort_by_rate(&mut field);
            let half = field.len() / 2;
            out.splice(0..0, field.split_off(half));
            halving += 1;
        }
        field.append(&mut out);
        Ok(field)
    }
}

/// Best rate first; ties by cost, then by start.
fn sort_by_rate(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| {
        b.rate()
            .total_cmp(&a.rate())
            .then(a.cost.total_cmp(&b.cost))
            .then(a.start.cmp(&b.start))
    });
}
