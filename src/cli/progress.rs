//! How `spindoe design` shows its search, and keeps it on disk while it runs.

use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::design::checkpoint::SearchState;
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
    /// The dots of the pattern on disk.
    saved: Option<Vec<[f64; 3]>>,
    said: Instant,
    /// When the round at hand began, in seconds of the search.
    round_began_s: f64,
}

/// Plain lines come no more often than this, seconds.
const SILENCE_S: f64 = 2.0;
/// Part of a budget after which no round of the search is begun; the rest is for the last trial,
/// polishing and the proof.
const SEARCH_SHARE: f64 = 0.7;
/// Part of a budget after which no round of polishing is begun.
const POLISH_SHARE: f64 = 0.9;

impl<'a> Progress<'a> {
    pub fn new(
        config: &'a DesignConfig,
        dir: &'a Path,
        budget: Option<Duration>,
        state: &SearchState,
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
    fn share(&self, state: &SearchState, stage: Stage) -> f64 {
        if let Some(budget) = self.budget {
            return (state.elapsed_s / budget.as_secs_f64()).min(1.0);
        }
        let starts = self.config.starts as f64;
        // Scouting and climbing take about as long as each other, and a round of polishing as both.
        let in_round = match stage {
            Stage::Scout => 0.45 * state.scouted.len() as f64 / starts,
            Stage::Climb => 0.45 + 0.45 * 4.0 * state.climbed.len() as f64 / starts,
            Stage::Try | Stage::Halve | Stage::Polish => 0.0,
        };
        let polished = match stage {
            Stage::Polish => state.polish.as_ref().map_or(0, |p| p.steps.len()),
            _ => 0,
        };
        let all = self.config.rounds + self.config.polish;
        ((state.round as f64 + in_round + polished as f64) / all as f64).min(1.0)
    }

    /// Whether something that takes so long ends before this share of the budget.
    fn time_for(&self, state: &SearchState, seconds: f64, share: f64) -> bool {
        self.budget
            .is_none_or(|budget| state.elapsed_s + seconds < share * budget.as_secs_f64())
    }

    /// Stage and best rate, in words.
    fn words(&self, state: &SearchState, stage: Stage) -> String {
        let what = match stage {
            Stage::Scout | Stage::Climb | Stage::Try => format!(
                "round {}: {} of {} starts scouted, {} climbed",
                state.round + 1,
                state.scouted.len(),
                self.config.starts,
                state.climbed.len()
            ),
            Stage::Halve => "last trial of the best".to_owned(),
            Stage::Polish => {
                let steps = state.polish.as_ref().map_or(&[][..], |p| &p.steps);
                let taken = steps.iter().filter(|s| s.taken).count();
                format!("polishing, round {}: {taken} gains", steps.len())
            }
        };
        let best = match state.milestones.last() {
            Some(m) => format!("best {}", m.identity),
            None => "none tried yet".to_owned(),
        };
        format!("{what}; {} identity: {best}", self.config.protocol.name)
    }

    /// Time left by the share that is done, in words; empty while there is nothing to go by.
    fn left(&self, state: &SearchState, share: f64) -> String {
        if share < 0.02 {
            return String::new();
        }
        let left = state.elapsed_s * (1.0 - share) / share;
        format!("; {left:.0} s left of the search")
    }
}

impl DesignObserver for Progress<'_> {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> Result<()> {
        state.save(&self.dir.join(CHECKPOINT), self.config)?;
        let polished = state.polish.as_ref().map(|p| &p.at);
        if let Some(best) = polished.or(state.pool.first())
            && self.saved.as_ref() != Some(&best.dots)
        {
            best.pattern()?.write_csv(&self.dir.join("pattern.csv"))?;
            self.saved = Some(best.dots.clone());
        }
        let share = self.share(state, stage);
        self.bar.set_position((1000.0 * share) as u64);
        let what = self.words(state, stage);
        if !self.bar.is_hidden() {
            self.bar.set_message(what);
        } else if self.said.elapsed().as_secs_f64() > SILENCE_S {
            errln!("{what}{}", self.left(state, share));
            self.said = Instant::now();
        }
        Ok(())
    }

    fn another_round(&mut self, state: &SearchState) -> bool {
        let round_s = state.elapsed_s - self.round_began_s;
        self.round_began_s = state.elapsed_s;
        self.time_for(state, round_s, SEARCH_SHARE)
    }

    fn another_polish(&mut self, state: &SearchState) -> bool {
        let steps = state.polish.as_ref().map_or(0, |p| p.steps.len());
        // The first is tried whatever it takes; the last trial before it is none of its time.
        let round_s = if steps == 0 {
            0.0
        } else {
            state.elapsed_s - self.round_began_s
        };
        self.round_began_s = state.elapsed_s;
        self.time_for(state, round_s, POLISH_SHARE)
    }
}
