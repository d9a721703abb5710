//! Progress of `spindoe design`, and the division of its time budget.

use std::sync::Arc;
use std::time::Instant;

use super::Arguments;
use crate::cli::output::{Progress, STEPS, is_quiet, left};
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
    /// Likewise: which number of dots suits which camera.
    hint: Option<&'static str>,
    /// How long the parts of a design for a camera take.
    forecast: Option<Forecast>,
    /// Frames of the camera for each finalist.
    frames: u64,
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

/// How long the parts of a design for a camera take, as far as it can be foreseen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Forecast {
    /// What is behind, s.
    pub gone_s: f64,
    /// A frame of the camera on all cores, s.
    pub frame_s: f64,
    /// The search, s, where there is an estimate before it begins.
    pub search_s: Option<f64>,
}

/// Finalists that a camera ranks, of a search of one round.
const FINALISTS: f64 = 3.0;

#[cfg(feature = "vision")]
impl Forecast {
    /// With this time for a frame.
    pub fn new(frame_s: f64) -> Self {
        Self {
            gone_s: 0.0,
            frame_s,
            search_s: None,
        }
    }

    /// A search that takes so long, and all behind it, with so many frames a finalist.
    pub fn after(&self, search_s: f64, frames: u64) -> f64 {
        search_s * (1.0 + EVALUATION_ROUNDS) + self.ranking_s(frames)
    }

    /// The ranking of the finalists.
    fn ranking_s(&self, frames: u64) -> f64 {
        FINALISTS * frames as f64 * self.frame_s
    }
}

/// Fraction of a budget after which no round of the search begins; the remaining time is for the
/// last trial and the evaluation.
const SEARCH_SHARE: f64 = 0.9;
/// How long the evaluation takes, in rounds of the search.
const EVALUATION_ROUNDS: f64 = 0.7;

impl<'a> DesignProgress<'a> {
    pub fn new(job: &'a DesignJob, arguments: &'a Arguments) -> Self {
        Self {
            config: &job.config,
            arguments,
            line: Progress::of_design(),
            forecast: None,
            frames: job.camera.as_ref().map_or(0, |camera| camera.frames),
            warning: arguments.dot_size_warning(),
            hint: super::number_of_dots(arguments),
            began: None,
            round_began_s: 0.0,
            shard: (0, 1),
            evaluated: (0, job.evaluation.steps() + 1),
            shown: 0.0,
            searched: 0.0,
        }
    }

    /// What has been seen of a camera before the search.
    #[cfg(feature = "vision")]
    pub fn with_forecast(mut self, forecast: Option<Forecast>) -> Self {
        self.forecast = forecast;
        self
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
        let in_round = in_round(state, stage, self.config.starts);
        let rounds = match self.arguments.budget {
            Some(budget) => {
                let (began_s, budget_s) = (self.round_began_s, SEARCH_SHARE * budget.as_secs_f64());
                rounds_within(budget_s, state.round, began_s, state.elapsed_s, in_round)
            }
            None => self.config.rounds as f64,
        };
        let (before, all) = (shard as f64 * rounds, shards as f64 * rounds);
        let done = before + state.round as f64 + in_round;
        let Some(forecast) = self.forecast else {
            return done / (all + EVALUATION_ROUNDS);
        };
        // In seconds: a camera's frames do not take as long as rounds do.
        let foreseen = forecast.search_s.map(|seconds| seconds / rounds.max(1.0));
        let round_s = match done > 0.1 {
            true => state.elapsed_s / done,
            false => foreseen.unwrap_or(0.0),
        };
        if round_s == 0.0 {
            return 0.0;
        }
        let (gone, left) = (forecast.gone_s + state.elapsed_s, (all - done) * round_s);
        let ranking = FINALISTS * self.frames as f64 * forecast.frame_s;
        gone / (gone + left + ranking + EVALUATION_ROUNDS * round_s)
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

/// The share of a round that is done.
pub(super) fn in_round(state: &SearchState, stage: Stage, starts: usize) -> f64 {
    let starts = starts as f64;
    // Scouting and climbing take about as long as each other.
    match stage {
        Stage::Scout => 0.45 * state.scouted.len() as f64 / starts,
        Stage::Climb => 0.45 + 0.45 * 4.0 * state.climbed.len() as f64 / starts,
        Stage::Try | Stage::Halve => 0.0,
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

impl JobObserver for DesignProgress<'_> {
    fn begins(&mut self, state: &SearchState) {
        self.round_began_s = state.elapsed_s;
        let share = self.share(state, Stage::Scout);
        self.began.get_or_insert((Instant::now(), share));
        let done = self.position(share);
        self.line.begin(done);
        if let Some(warning) = self.warning.take() {
            errln!("note: {warning}");
        }
        if let Some(hint) = self.hint.take().filter(|_| !is_quiet()) {
            errln!("{hint}");
        }
    }

    fn step(&mut self, what: &str) -> Result<()> {
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
        Ok(())
    }

    fn ranks(&mut self, frames: u64) -> Result<Arc<dyn Fn(u64) + Send + Sync>> {
        let what = "the camera ranks the finalists";
        let Some(forecast) = self.forecast else {
            self.step(what)?;
            return Ok(Arc::new(|_| ()));
        };
        let (began, _) = *self.began.get_or_insert((Instant::now(), 0.0));
        // The evaluation is the rest.
        let search_s = began.elapsed().as_secs_f64();
        let ranking = frames as f64 * forecast.frame_s;
        let gone = forecast.gone_s + search_s;
        let all = gone + ranking + EVALUATION_ROUNDS * search_s;
        let from = self.shown.max(gone / all);
        self.shown = from.max((gone + ranking) / all);
        let ends = [from, self.shown];
        Ok(Arc::new(self.line.count(frames, ends, what)))
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
