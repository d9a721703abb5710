//! The search: rounds of many starts, each descended and evaluated by Monte Carlo; the best meet on fresh trials.
//!
//! A round takes a number of starts down a few steps (cheap), and the best quarter by their cost down to convergence.
//! Every pattern that a start has come to and that meets the constraints is a candidate and is evaluated by Monte Carlo,
//! whatever its cost.
//! The first round starts at random. Later rounds move a few dots of the best patterns so far, and one start in four
//! stays random. The best few of all rounds meet in a last trial, where each halving doubles the trials of those that
//! remain.
//!
//! All trials of one round share their seed, so candidates are compared on the same views, and so do those of one
//! halving. No other stage uses that seed, and each halving counts its own trials alone: a candidate cannot profit from
//! the same luck twice.
//!
//! The search is a deterministic function of its configuration. Its [`SearchState`] after every
//! batch of descents holds everything needed to continue. It does not guarantee the global optimum.

pub mod feasible;
pub mod start;
mod work;

use std::sync::atomic::{AtomicBool, Ordering};

use self::feasible::check_feasible_until;
use self::work::{climb, rate, scout};
use super::config::DesignConfig;
use super::constraints::NO_STENCIL;
use super::state::{DesignCandidate, Milestone, SearchState, sort_by_rate};
use crate::concurrency::{self, Stopwatch};
use crate::error::{Error, Result};

/// Candidates that a round sends on to the last trial.
const SENT_ON: usize = 3;
/// Candidates kept for the last trial.
const POOL: usize = 12;
/// Trials of a milestone, in units of the configuration's samples.
const MILESTONE_VIEWS: u64 = 2;

/// The current stage of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// A few steps from every start of the round.
    Scout,
    /// The best quarter, until convergence.
    Climb,
    /// Monte Carlo trials of the round's best.
    Try,
    /// The best of all rounds, with more and more trials.
    Halve,
}

/// Observes a search; all methods are optional.
pub trait DesignObserver {
    /// Some work of a stage of a round is done.
    ///
    /// # Errors
    /// Any error of the observer; it ends the search.
    fn progress(&mut self, _state: &SearchState, _stage: Stage) -> Result<()> {
        Ok(())
    }

    /// Puts the finalists of the last trial, the best first, into another order. By default they
    /// stay as their rates have them.
    ///
    /// # Errors
    /// Any error of the observer; it ends the search.
    fn rank(&mut self, _finalists: &mut [DesignCandidate]) -> Result<()> {
        Ok(())
    }

    /// Whether another round begins; called after each round but the last.
    fn another_round(&mut self, _state: &SearchState) -> bool {
        true
    }
}

impl DesignObserver for () {}

/// Result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignOutcome {
    /// The winner of the last trial.
    pub best: DesignCandidate,
    /// The finalists, best first.
    pub finalists: Vec<DesignCandidate>,
    /// Starts tried.
    pub starts: usize,
    /// The best rate over time.
    pub milestones: Vec<Milestone>,
    /// Whether the search was stopped before its end.
    pub stopped: bool,
}

/// Searches for a pattern, from the beginning or from where `state` was left. Setting `stop` ends
/// the search after the current work with the best so far.
///
/// Descents run in parallel; the result does not depend on the number of threads.
///
/// # Errors
/// [`Error::Argument`] where a parameter is out of its domain or no pattern was found that
/// satisfies the constraints.
pub fn design(
    config: &DesignConfig,
    state: &mut SearchState,
    stop: &AtomicBool,
    observer: &mut dyn DesignObserver,
) -> Result<DesignOutcome> {
    let mut search = StartSearch::new(config, state, stop, observer)?;
    let stopped = !search.rounds(state)?;
    let mut finalists = search.halve(state)?;
    if !finalists.is_empty() {
        search.observer.rank(&mut finalists)?;
    }
    let Some(winner) = finalists.first() else {
        return Err(nothing_found(state, stopped));
    };
    Ok(DesignOutcome {
        best: winner.clone(),
        starts: state.shards.max(1) * state.round * config.starts + state.scouted.len(),
        milestones: state.milestones.clone(),
        stopped: stopped || stop.load(Ordering::Relaxed),
        finalists,
    })
}

/// The rounds of a search alone, without its last trial: what a shard runs. `false` if stopped before
/// the last of them has ended.
///
/// # Errors
/// As [`design`].
pub fn search_rounds(
    config: &DesignConfig,
    state: &mut SearchState,
    stop: &AtomicBool,
    observer: &mut dyn DesignObserver,
) -> Result<bool> {
    let mut search = StartSearch::new(config, state, stop, observer)?;
    Ok(search.rounds(state)? && state.round == config.rounds)
}

fn nothing_found(state: &SearchState, stopped: bool) -> Error {
    if stopped {
        return Error::argument("design", "stopped before the first candidate was tried");
    }
    let missed = state
        .missed
        .as_ref()
        .map_or(String::new(), |m| format!(" (the last one missed: {m})"));
    // The demands were found possible one by one before the search: what is missing is its luck.
    let cure = if state
        .missed
        .as_deref()
        .is_some_and(|m| m.starts_with(NO_STENCIL))
    {
        "more separation or smaller holes"
    } else {
        "less of that"
    };
    let problem = format!(
        "no start led to a pattern that satisfies the constraints{missed}; ask for {cure}, or for more starts"
    );
    Error::argument("design", problem)
}

struct StartSearch<'a> {
    config: &'a DesignConfig,
    stop: &'a AtomicBool,
    observer: &'a mut dyn DesignObserver,
    clock: Stopwatch,
    before_s: f64,
    /// The result of a stopped round. It takes part in the last trial of this run. The state leaves
    /// it out, so a resumed search finds the same as one that was never stopped.
    unfinished: Vec<DesignCandidate>,
}

impl<'a> StartSearch<'a> {
    fn new(
        config: &'a DesignConfig,
        state: &SearchState,
        stop: &'a AtomicBool,
        observer: &'a mut dyn DesignObserver,
    ) -> Result<Self> {
        config.check()?;
        match check_feasible_until(&config.constraints, config.dots, stop) {
            // What an earlier run has found is kept.
            Err(Error::Stopped) => {}
            checked => checked?,
        }
        Ok(Self {
            config,
            stop,
            observer,
            clock: Stopwatch::start(),
            before_s: state.elapsed_s,
            unfinished: Vec::new(),
        })
    }
}

impl StartSearch<'_> {
    /// All rounds, or as many as the observer wants; `false` if stopped before their end.
    fn rounds(&mut self, state: &mut SearchState) -> Result<bool> {
        while state.round < self.config.rounds {
            // A search of one round that goes on has none yet.
            self.milestone(state)?;
            if !self.round(state)? {
                return Ok(false);
            }
            let more = state.round < self.config.rounds;
            if more && !self.observer.another_round(state) {
                break;
            }
        }
        // That of the last round, where a stop cut it.
        self.milestone(state)?;
        Ok(true)
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn elapsed_s(&self) -> f64 {
        self.before_s + self.clock.elapsed().as_secs_f64()
    }

    fn note(&mut self, state: &mut SearchState, stage: Stage) -> Result<()> {
        state.elapsed_s = self.elapsed_s();
        self.observer.progress(state, stage)
    }

    /// One round, or the rest of it; `false` if stopped before its end.
    fn round(&mut self, state: &mut SearchState) -> Result<bool> {
        let config = self.config;
        self.scout(state)?;
        let mut best: Vec<&DesignCandidate> = state.scouted.iter().collect();
        best.sort_unstable_by(|a, b| a.cost.total_cmp(&b.cost).then(a.start.cmp(&b.start)));
        let chosen: Vec<DesignCandidate> = best
            .into_iter()
            .take(config.starts.div_ceil(4))
            .cloned()
            .collect();
        self.climb(state, &chosen)?;
        let reached = reached(state, std::mem::take(&mut self.unfinished));
        if self.stopped() {
            self.unfinished = self.best_tried(state, reached)?;
            return Ok(false);
        }
        let mut tried = self.best_tried(state, reached)?;
        if self.stopped() {
            self.unfinished = tried;
            return Ok(false);
        }
        state.pool.append(&mut tried);
        sort_by_rate(&mut state.pool);
        state.pool.truncate(POOL);
        state.round += 1;
        state.scouted.clear();
        state.climbed.clear();
        self.milestone(state)?;
        self.note(state, Stage::Try)?;
        Ok(true)
    }

    /// The first steps of all starts of the round that have not made them.
    fn scout(&mut self, state: &mut SearchState) -> Result<()> {
        let (config, stop) = (self.config, self.stop);
        let first = state.round * config.starts;
        while state.scouted.len() < config.starts && !self.stopped() {
            let from = first + state.scouted.len();
            let to = (from + concurrency::threads()).min(first + config.starts);
            let pool = &state.pool;
            let work = |s| scout(config, pool, s as usize, stop);
            let found = concurrency::map_range(from as u64..to as u64, work);
            let found: Result<Vec<_>> = found.into_iter().collect();
            self.keep(found?, &mut state.scouted);
            self.note(state, Stage::Scout)?;
        }
        Ok(())
    }

    /// The further steps of the best, as far as they have not made them.
    fn climb(&mut self, state: &mut SearchState, chosen: &[DesignCandidate]) -> Result<()> {
        let (config, stop) = (self.config, self.stop);
        while state.climbed.len() < chosen.len() && !self.stopped() {
            let from = state.climbed.len();
            let to = (from + concurrency::threads()).min(chosen.len());
            let found = concurrency::map(&chosen[from..to], |c| climb(config, c, stop));
            let found: Result<Vec<_>> = found.into_iter().collect();
            self.keep(found?, &mut state.climbed);
            self.note(state, Stage::Climb)?;
        }
        Ok(())
    }

    /// Keeps what descents have found; those that were cut short, for this run only.
    fn keep(&mut self, mut found: Vec<DesignCandidate>, whole: &mut Vec<DesignCandidate>) {
        if self.stopped() {
            self.unfinished.append(&mut found);
        } else {
            whole.append(&mut found);
        }
    }

    /// The best of a round by their rates, after trials of all that meet the constraints, or of those that a stop leaves time for.
    fn best_tried(
        &mut self,
        state: &mut SearchState,
        mut tried: Vec<DesignCandidate>,
    ) -> Result<Vec<DesignCandidate>> {
        let config = self.config;
        state.missed = tried.iter().rev().find_map(|c| c.missed.clone());
        tried.retain(|c| c.missed.is_none());
        let seed = config.selection_seed(state.round + 1, 0);
        for candidate in &mut tried {
            candidate.answered = rate(config, candidate, (seed, config.samples), self.stop)?;
            if self.stopped() {
                break;
            }
            self.note(state, Stage::Try)?;
        }
        sort_by_rate(&mut tried);
        tried.truncate(SENT_ON);
        Ok(tried)
    }

    /// Records the rate of the best after the last round, where that is not the only one: one round has no course.
    fn milestone(&mut self, state: &mut SearchState) -> Result<()> {
        let config = self.config;
        let is_known = state
            .milestones
            .last()
            .is_some_and(|m| m.rounds == state.round);
        let Some(best) = state
            .pool
            .first()
            .filter(|_| config.rounds > 1 && !is_known)
        else {
            return Ok(());
        };
        let samples = MILESTONE_VIEWS * config.samples;
        let trials = (config.progress_seed(), samples);
        let Some(answered) = rate(config, best, trials, self.stop)? else {
            return Ok(());
        };
        state.milestones.push(Milestone {
            elapsed_s: Some(self.elapsed_s()),
            rounds: state.round,
            answered,
        });
        Ok(())
    }

    /// The last trial: the pool meets on fresh views, and each halving doubles them. A stop leaves the order of the last whole halving.
    fn halve(&mut self, state: &mut SearchState) -> Result<Vec<DesignCandidate>> {
        let config = self.config;
        let mut field = state.pool.clone();
        field.append(&mut self.unfinished);
        let mut out: Vec<DesignCandidate> = Vec::new();
        let mut halving = 0;
        sort_by_rate(&mut field);
        while field.len() > 1 {
            let seed = config.selection_seed(0, halving);
            let samples = config.samples << halving.min(3);
            let mut rates = Vec::with_capacity(field.len());
            for candidate in &field {
                rates.extend(rate(config, candidate, (seed, samples), self.stop)?);
                if self.stopped() {
                    field.append(&mut out);
                    return Ok(field);
                }
                self.note(state, Stage::Halve)?;
            }
            for (candidate, rate) in field.iter_mut().zip(rates) {
                candidate.answered = Some(rate);
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

/// Where each start of the round has come to: to the end of its descent, or to its first steps where it went no
/// further or left the constraints.
fn reached(state: &SearchState, unfinished: Vec<DesignCandidate>) -> Vec<DesignCandidate> {
    let whole = state.scouted.iter().chain(&state.climbed).cloned();
    let mut reached: Vec<DesignCandidate> = Vec::with_capacity(state.scouted.len());
    for candidate in whole.chain(unfinished) {
        match reached.iter_mut().find(|r| r.start == candidate.start) {
            Some(before) if candidate.missed.is_none() => *before = candidate,
            Some(_) => {}
            None => reached.push(candidate),
        }
    }
    reached
}
