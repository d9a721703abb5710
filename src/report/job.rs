//! A whole design: the search, the evaluation of its winner, and the output folder.
//!
//! During the run the folder holds `search.json`, from which a stopped or killed search continues,
//! and `pattern.csv`, the best so far. At the end it holds all that [`DesignEvaluation`] writes,
//! and the stencil. A job that is stopped finishes with the best so far. Whatever interrupts it, no
//! two results stand beside each other: what an earlier run left goes when another pattern comes,
//! the new results are written aside and moved in together, `report.json` last, and a lock keeps
//! other jobs out of the folder.
//!
//! What it does not do: limit its time. Budgets belong to the observer
//! ([`DesignObserver::another_round`]).
//!
//! ```no_run
//! use std::sync::atomic::AtomicBool;
//!
//! use spindoe::report::{DesignJob, Start};
//!
//! # fn main() -> spindoe::Result<()> {
//! let job = DesignJob::new("my-ball");
//! let found = job.run(Start::Fresh, &AtomicBool::new(false), &mut ())?;
//! println!("{}", found.report.validation[0].validation.identity);
//! # Ok(())
//! # }
//! ```

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::page::DesignPage;
use super::{DesignEvaluation, EvaluationConfig, evaluate};
use crate::design::checkpoint::SearchState;
use crate::design::{DesignConfig, DesignObserver, Stage, design};
use crate::error::Result;
use crate::files::{self, FolderLock, Replacement};
use crate::stencil::StencilConfig;

/// The search's checkpoint within the folder.
pub const CHECKPOINT: &str = "search.json";
/// The pattern within the folder.
const PATTERN: &str = "pattern.csv";
/// The report within the folder; the last file to appear.
const REPORT: &str = "report.json";
/// What depends on the pattern, the mark of a whole result first.
const RESULTS: [&str; 5] = [
    REPORT,
    "report.html",
    "stencil",
    "table.npz",
    "sensitivity.csv",
];

/// Configuration of a design and its output folder.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignJob {
    /// Configuration of the search.
    pub config: DesignConfig,
    /// Configuration of the winner's evaluation.
    pub evaluation: EvaluationConfig,
    /// Configuration of the stencil.
    pub stencil: StencilConfig,
    /// The output folder.
    pub dir: PathBuf,
}

/// Where a job starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// From the beginning, in a folder without a design.
    Fresh,
    /// From the saved search in the folder; the number of rounds, also of polishing, may be larger.
    Resume,
}

/// Observes a job; all methods are optional.
pub trait JobObserver: DesignObserver {
    /// The search begins, or continues, from this state.
    fn begins(&mut self, _state: &SearchState) {}

    /// The job's current work, in words.
    fn step(&mut self, _what: &str) {}

    /// The command that reproduces the completed search, for the report; `None` where there is
    /// none.
    fn command(&self, _searched: &DesignConfig) -> Option<String> {
        None
    }
}

impl JobObserver for () {}

impl DesignJob {
    /// The default design in this folder.
    pub fn new(dir: impl Into<PathBuf>) -> Self {
        Self {
            config: DesignConfig::default(),
            evaluation: EvaluationConfig::default(),
            stencil: StencilConfig::default(),
            dir: dir.into(),
        }
    }

    /// Searches, evaluates and writes everything. Setting `stop` ends the search after the current
    /// work.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a parameter outside its domain, a folder that is taken, or
    /// where no pattern was found; [`crate::Error::Input`] for a checkpoint of another search;
    /// [`crate::Error::Write`] on an I/O failure; those of the observer.
    pub fn run(
        &self,
        start: Start,
        stop: &AtomicBool,
        observer: &mut dyn JobObserver,
    ) -> Result<DesignEvaluation> {
        self.stencil.validate()?;
        self.config.check()?;
        let state_before = self.state(start)?;
        let _lock = FolderLock::take(&self.dir)?;
        // Another job may have ended in the folder before the lock was taken.
        let mut state = match start {
            Start::Resume => state_before,
            Start::Fresh => self.state(start)?,
        };
        let clock = Instant::now();
        observer.begins(&state);
        let mut keeper = Keeper {
            job: self,
            observer,
            saved: None,
        };
        let outcome = design(&self.config, &mut state, stop, &mut keeper)?;
        let search_s = clock.elapsed().as_secs_f64();
        if outcome.stopped {
            observer.step("stopped: finishing with the best so far; Ctrl-C again leaves at once");
        }
        let searched = DesignConfig {
            rounds: state.round.max(1),
            polish: outcome.polish.len(),
            ..self.config.clone()
        };
        let command = observer.command(&searched);
        let mut found = evaluate(&outcome, &searched, &self.evaluation, &mut |what| {
            observer.step(what);
        })?;
        found.report.command = command;
        found.report.timing.search_s = search_s;
        let results = Replacement::begin(&self.dir)?;
        observer.step("drawing the plots");
        found.write(results.path(), &self.stencil)?;
        observer.step("making the stencil");
        found.write_stencil(results.path(), &self.stencil)?;
        DesignPage::read(results.path())?.write(results.path())?;
        // The pattern is replaced at once: it is what a search leaves at any time.
        results.publish(&[PATTERN], REPORT)?;
        Ok(found)
    }

    fn state(&self, start: Start) -> Result<SearchState> {
        match start {
            Start::Resume => SearchState::load(&self.dir.join(CHECKPOINT), &self.config),
            Start::Fresh => {
                files::reject_taken(
                    &self.dir,
                    &[PATTERN, REPORT, CHECKPOINT],
                    "a design",
                    "choose another folder, or --resume it",
                )?;
                Ok(SearchState::default())
            }
        }
    }
}

/// Saves a search on disk before its observer is called.
struct Keeper<'a> {
    job: &'a DesignJob,
    observer: &'a mut dyn JobObserver,
    /// The dots of the pattern on disk.
    saved: Option<Vec<[f64; 3]>>,
}

impl Keeper<'_> {
    fn path(&self, name: &str) -> PathBuf {
        Path::join(&self.job.dir, name)
    }
}

impl DesignObserver for Keeper<'_> {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> Result<()> {
        state.save(&self.path(CHECKPOINT), &self.job.config)?;
        if let Some(best) = state.best(stage)
            && self.saved.as_ref() != Some(&best.dots)
        {
            let zones = self.job.config.constraints.keep_out.clone();
            let pattern = best.pattern()?.with_keep_out(zones)?;
            let path = self.path(PATTERN);
            if files::read_bytes(&path).ok().as_deref() != Some(pattern.to_csv().as_bytes()) {
                for name in RESULTS {
                    files::remove_any(&self.path(name))?;
                }
                pattern.write_csv(&path)?;
            }
            self.saved = Some(best.dots.clone());
        }
        self.observer.progress(state, stage)
    }

    fn another_round(&mut self, state: &SearchState) -> bool {
        self.observer.another_round(state)
    }

    fn another_polish(&mut self, state: &SearchState) -> bool {
        self.observer.another_polish(state)
    }
}
