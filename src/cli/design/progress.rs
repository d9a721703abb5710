//! Progress of `spindoe design`, and the division of its time budget.

use std::time::{Duration, Instant};

use super::Arguments;
use crate::cli::output::Progress;
use crate::design::{DesignConfig, DesignObserver, Milestone, SearchState, Shard, Stage};
use crate::error::Result;
use crate::report::{DesignJob, JobObserver};

/// Shows the progress of a design, and ends it when its budget is spent.
pub(super) struct DesignProgress<'a> {
    config: &'a DesignConfig,
    arguments: &'a Arguments,
    line: Progress,
    /// What is said once the arguments are known to be good.
    warning: Option<String>,
    /// When work began, and the share that was done by then.
    began: Option<(Instant, f64)>,
    /// Start of the current round, in seconds of the search.
    round_began_s: f64,
    /// The shard that runs, from 0, and their number.
    shard: (usize, usize),
    /// Steps of the evaluation that have begun, and their number.
    evaluated: (usize, usize),
    /// Share of all work that the bar shows, and that it showed when the evaluation began.
    shown: f64,
    searched: f64,
}

/// Steps of the bar.
const STEPS: u64 = 1000;
/// Minimum time between plain lines.
const SILENCE: Duration = Duration::from_secs(2);
/// Fraction of a budget after which no round of the search begins; the remaining time is for the
/// last trial and the evaluation.
const SEARCH_SHARE: f64 = 0.9;
/// How long the evaluation takes, in rounds of the search.
const EVALUATION_ROUNDS: f64 = 0.7;

impl<'a> DesignProgress<'a> {
    pub fn new(job: &'a DesignJob, arguments: &'a Arguments) -> Self {
        let template = "{bar:12} {gone}{left}  {wide_msg}";
        Self {
            config: &job.config,
            arguments,
            line: Progress::new(STEPS, template, SILENCE),
            warning: arguments.dot_size_warning(),
            began: None,
            round_began_s: 0.0,
            shard: (0, 1),
            evaluated: (
                0,
                job.evaluation.steps() + 1 + usize::from(job.camera.is_some()),
            ),
            shown: 0.0,
            searched: 0.0,
        }
    }

    /// One of several shards begins.
    pub fn begin_shard(&mut self, shard: Shard) {
        self.shard = (shard.index.saturating_sub(1), shard.count);
        let done = self.position(0.0);
        self.line.say(done, &format!("shard {shard}"));
    }

    /// The bar's position when this share of all work is done: it never goes back.
    fn position(&mut self, share: f64) -> u64 {
        self.shown = self.shown.max(share.min(1.0));
        (STEPS as f64 * self.shown) as u64
    }

    pub fn finish(&self) {
        self.line.finish();
    }

    /// Share of all work that is done while the search goes on, in [0, 1].
    fn share(&self, state: &SearchState, stage: Stage) -> f64 {
        let (shard, shards) = self.shard;
        let starts = self.config.starts as f64;
        // Scouting and climbing take about as long as each other.
        let in_round = match stage {
            Stage::Scout => 0.45 * state.scouted.len() as f64 / starts,
            Stage::Climb => 0.45 + 0.45 * 4.0 * state.climbed.len() as f64 / starts,
            Stage::Try | Stage::Halve => 0.0,
        };
        let rounds = match self.arguments.budget {
            Some(budget) => {
                let (began_s, budget_s) = (self.round_began_s, SEARCH_SHARE * budget.as_secs_f64());
                rounds_within(budget_s, state.round, began_s, state.elapsed_s, in_round)
            }
            None => self.config.rounds as f64,
        };
        let (before, all) = (shard as f64 * rounds, shards as f64 * rounds);
        (before + state.round as f64 + in_round) / (all + EVALUATION_ROUNDS)
    }

    /// Stage and best rate, in words.
    fn words(&self, state: &SearchState, stage: Stage) -> String {
        let what = match stage {
            Stage::Scout | Stage::Climb | Stage::Try => {
                let (starts, climbs) = (self.config.starts, self.config.starts.div_ceil(4));
                format!(
                    "round {}: scouted {} of {starts}, climbed {} of {climbs}",
                    (state.round + 1).min(self.config.rounds),
                    state.scouted.len(),
                    state.climbed.len()
                )
            }
            Stage::Halve => "last trial of the best".to_owned(),
        };
        match state.milestones.last() {
            Some(m) => format!("{what}, best {:.2} %", 100.0 * m.answered.rate),
            None => what,
        }
    }

    /// What a plain line adds to that: the best rate whole.
    fn more(&self, state: &SearchState) -> String {
        let protocol = self.config.views;
        match state.milestones.last() {
            Some(Milestone { answered, .. }) => {
                let [low, high] = [answered.low, answered.high].map(|rate| 100.0 * rate);
                format!(" [{low:.2}, {high:.2}], protocol {protocol}")
            }
            None => String::new(),
        }
    }
}

/// How many rounds are begun within a budget, after `done` of them; the one that began at `began_s` has come as far as
/// `in_round`, from 0 to 1.
fn rounds_within(budget_s: f64, done: usize, began_s: f64, elapsed_s: f64, in_round: f64) -> f64 {
    let round_s = match (done, in_round > 0.0) {
        (_, true) => (elapsed_s - began_s) / in_round,
        (0, false) => return 1.0,
        (_, false) => began_s / done as f64,
    };
    // The round that has begun is finished, whatever its budget.
    let more = ((budget_s - began_s) / round_s.max(f64::MIN_POSITIVE)).floor();
    done as f64 + more.max(1.0)
}

/// Estimated time left from the share done, and that when work began, in words; empty while there is no estimate.
fn left((began, before): (Instant, f64), share: f64) -> String {
    if share - before < 0.02 {
        return String::new();
    }
    let left = began.elapsed().as_secs_f64() * (1.0 - share) / (share - before);
    format!("; {left:.0} s left")
}

impl JobObserver for DesignProgress<'_> {
    fn begins(&mut self, state: &SearchState) {
        self.round_began_s = state.elapsed_s;
        let share = self.share(state, Stage::Scout);
        self.began.get_or_insert((Instant::now(), share));
        let done = self.position(share);
        self.line.begin(done);
        if let Some(warning) = self.warning.take() {
            errln!("spindoe: {warning}");
        }
    }

    fn step(&mut self, what: &str) {
        let (begun, steps) = self.evaluated;
        if begun == 0 {
            self.searched = self.shown;
            let done = self.position(0.0);
            self.line.begin(done);
        }
        let share = begun as f64 / steps as f64;
        let done = self.position(self.searched + (1.0 - self.searched) * share);
        self.evaluated.0 += 1;
        self.line.say(done, what);
    }

    fn command(&self, searched: &DesignConfig) -> Option<String> {
        Some(self.arguments.command(searched))
    }
}

impl DesignObserver for DesignProgress<'_> {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> Result<()> {
        let share = self.share(state, stage);
        let what = self.words(state, stage);
        let done = self.position(share);
        let began = *self.began.get_or_insert((Instant::now(), share));
        let more = self.more(state);
        let more = || format!("{more}{}", left(began, share));
        self.line.show(done, &what, more);
        Ok(())
    }

    fn another_round(&mut self, state: &SearchState) -> bool {
        let round_s = state.elapsed_s - self.round_began_s;
        self.round_began_s = state.elapsed_s;
        self.arguments
            .budget
            .is_none_or(|budget| state.elapsed_s + round_s < SEARCH_SHARE * budget.as_secs_f64())
    }
}
