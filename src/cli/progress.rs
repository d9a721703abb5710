//! How `spindoe design` shows its search, and keeps it on disk while it runs.

use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::design::checkpoint::State;
use crate::design::{DesignConfig, DesignObserver, Stage};
use crate::error::Result;

/// The search's checkpoint within the folder.
pub(super) const CHECKPOINT: &str = "search.json";

/// Shows a search: a bar on a terminal, plain lines elsewhere; and keeps it on disk.
pub(super) struct Progress<'a> {
    config: &'a DesignConfig,
    dir: &'a Path,
    budget: Option<Duration>,
    bar: ProgressBar,
    /// The start of the pattern on disk.
    saved: Option<usize>,
    said: Instant,
    /// When the round at hand began, in seconds of the search.
    round_began_s: f64,
}

/// Plain lines come no more often than this, seconds.
const SILENCE_S: f64 = 2.0;
/// Part of a budget that is kept for the last trial and the proof.
const RESERVE: f64 = 0.15;

impl<'a> Progress<'a> {
    pub fn new(
        config: &'a DesignConfig,
        dir: &'a Path,
        budget: Option<Duration>,
        state: &State,
    ) -> Self {
        let bar = ProgressBar::new(1000);
        // The template is a constant; were it wrong, the default style would do.
        if let Ok(style) =
            ProgressStyle::with_template("{bar:25} {elapsed} gone, {eta} left  {msg}")
        {
            bar.set_style(style);
        }
        Self {
            config,
            dir,
            budget,
            bar,
            saved: None,
            said: Instant::now(),
            round_began_s: state.elapsed_s,
        }
    }

    pub fn say(&self, what: &str) {
        if self.bar.is_hidden() {
            errln!("{what}");
        } else {
            self.bar.set_message(what.to_owned());
        }
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// Share of the search that is done, in [0, 1].
    fn share(&self, state: &State, stage: Stage) -> f64 {
        if let Some(budget) = self.budget {
            return (state.elapsed_s / budget.as_secs_f64()).min(1.0);
        }
        let starts = self.config.starts as f64;
        // Scouting and climbing take about as long as each other.
        let in_round = match stage {
            Stage::Scout => 0.45 * state.scouted.len() as f64 / starts,
            Stage::Climb => 0.45 + 0.45 * 4.0 * state.climbed.len() as f64 / starts,
            Stage::Try => 0.9,
            Stage::Halve => 1.0,
        };
        ((state.round as f64 + in_round) / self.config.rounds as f64).min(1.0)
    }
}

impl DesignObserver for Progress<'_> {
    fn progress(&mut self, state: &State, stage: Stage) -> Result<()> {
        state.save(&self.dir.join(CHECKPOINT), self.config)?;
        if let Some(best) = state.pool.first()
            && self.saved != Some(best.start)
        {
            best.pattern()?.write_csv(&self.dir.join("pattern.csv"))?;
            self.saved = Some(best.start);
        }
        let best = match state.pool.first().and_then(|c| c.identity) {
            Some(rate) => format!("best {rate}"),
            None => "none tried yet".to_owned(),
        };
        let what = format!(
            "round {}: {} of {} starts scouted, {} climbed; {} identity: {best}",
            state.round + 1,
            state.scouted.len(),
            self.config.starts,
            state.climbed.len(),
            self.config.protocol.name,
        );
        self.bar
            .set_position((1000.0 * self.share(state, stage)) as u64);
        if !self.bar.is_hidden() {
            self.bar.set_message(what);
        } else if self.said.elapsed().as_secs_f64() > SILENCE_S {
            errln!("{what}");
            self.said = Instant::now();
        }
        Ok(())
    }

    fn another_round(&mut self, state: &State) -> bool {
        let Some(budget) = self.budget else {
            return true;
        };
        let round_s = state.elapsed_s - self.round_began_s;
        self.round_began_s = state.elapsed_s;
        state.elapsed_s + round_s < (1.0 - RESERVE) * budget.as_secs_f64()
    }
}
