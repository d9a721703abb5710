//! A whole design: the search, the evaluation of its winner, and the output folder.
//!
//! During the run the folder holds `search.json`, from which a stopped or killed search continues.
//! At the end it holds all that [`DesignEvaluation`] writes, and the stencil. A job that is stopped
//! finishes with the best so far. Whatever interrupts it, a full disk too, no two results stand
//! beside each other, and no part of one: results are written aside and moved in together in place
//! of earlier ones, `report.json` last, and a lock keeps other jobs out of the folder.
//!
//! What it does not do: limit its time. Budgets belong to the observer
//! ([`DesignObserver::another_round`]).
//!
//! ```no_run
//! use std::sync::atomic::AtomicBool;
//!
//! use spindoe::report::{DesignJob, JobStart};
//!
//! # fn main() -> spindoe::Result<()> {
//! let job = DesignJob::new("my-ball");
//! let found = job.run(JobStart::Fresh, &AtomicBool::new(false), &mut ())?;
//! println!("{}", found.report.validation[0].validation.answered);
//! # Ok(())
//! # }
//! ```

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::page::DesignPage;
use super::{DesignEvaluation, DotPlace, EvaluationConfig, REPORT, evaluate};
use crate::ball::DesignRecord;
use crate::design::state::{Checkpoint, ShardRecord};
use crate::design::{
    CameraRecord, CameraRequest, DesignCandidate, DesignConfig, DesignObserver, DesignOutcome,
    SearchState, Shard, Stage, design, search_rounds,
};
use crate::error::{Error, Result};
use crate::files::{self, FolderLock, Replacement};
use crate::stencil::{Stencil, StencilConfig};

/// The search's checkpoint within the folder.
pub const CHECKPOINT: &str = "search.json";
/// The pattern within the folder.
const PATTERN: &str = "pattern.csv";
/// What a design may lack: that of an earlier one is not to stand beside it.
const OPTIONAL: [&str; 2] = ["stencil", ADDED];
/// The picture of dots that are to be drawn beside others.
const ADDED: &str = "added.png";
/// Trials of each protocol and recognizer after a stop: who stops waits for them.
const STOPPED_SAMPLES: u64 = 200;

/// Configuration of a design and its output folder.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignJob {
    /// Configuration of the search.
    pub config: DesignConfig,
    /// Configuration of the winner's evaluation.
    pub evaluation: EvaluationConfig,
    /// Configuration of the stencil.
    pub stencil: StencilConfig,
    /// The camera that ranks the finalists; `None` where the protocol's rates do.
    pub camera: Option<CameraRequest>,
    /// The output folder.
    pub dir: PathBuf,
    /// Formats in which the ball, its features, rates and their course are drawn too.
    #[cfg(feature = "plot")]
    pub pictures: Vec<super::plots::PictureFormat>,
}

/// Where a job starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobStart {
    /// From the beginning, in a folder without a design.
    Fresh,
    /// From the saved search in the folder; the number of rounds may be larger.
    Resume,
}

/// Observes a job; all methods are optional.
pub trait JobObserver: DesignObserver {
    /// The search begins, or continues, from this state.
    fn begins(&mut self, _state: &SearchState) {}

    /// The job's current work, in words.
    ///
    /// # Errors
    /// Those of the observer; they end the job.
    fn step(&mut self, _what: &str) -> Result<()> {
        Ok(())
    }

    /// A camera begins to rank the finalists, on so many frames; what it returns learns how many more are
    /// read or spared.
    ///
    /// # Errors
    /// Those of the observer; they end the job.
    fn ranks(&mut self, _frames: u64) -> Result<Arc<dyn Fn(u64) + Send + Sync>> {
        self.step("ranking the finalists for the camera")?;
        Ok(Arc::new(|_| ()))
    }

    /// The command that reproduces the completed search, for the report; `None` where there is
    /// none.
    fn command(&self, _searched: &DesignConfig) -> Option<String> {
        None
    }
}

impl JobObserver for () {}

/// The merge of a search's shards.
#[derive(Debug, Clone, PartialEq)]
pub struct ShardedJob {
    /// The job of the whole search.
    pub job: DesignJob,
    /// The command that runs the whole search, where a command ran the shards.
    pub command: Option<String>,
}

impl DesignJob {
    /// The default design in this folder.
    pub fn new(dir: impl Into<PathBuf>) -> Self {
        Self {
            config: DesignConfig::default(),
            evaluation: EvaluationConfig::default(),
            stencil: StencilConfig::default(),
            camera: None,
            dir: dir.into(),
            #[cfg(feature = "plot")]
            pictures: Vec::new(),
        }
    }

    /// The job of a search: its winner is evaluated on as many trials as its candidates were tried on, and
    /// has the stencil of the constraints.
    pub fn of(config: DesignConfig, dir: impl Into<PathBuf>) -> Self {
        Self {
            evaluation: EvaluationConfig::of_search(&config),
            stencil: config.constraints.stencil.clone().unwrap_or_default(),
            config,
            ..Self::new(dir)
        }
    }

    /// The job that merges shards: that of the first one's search.
    ///
    /// # Errors
    /// As [`Checkpoint::load`]; [`Error::Input`] for a search of one piece.
    pub fn of_shards(shards: &[PathBuf], dir: impl Into<PathBuf>) -> Result<ShardedJob> {
        let first = shards.first().map(PathBuf::as_path);
        let (file, record) = read_shard(&checkpoint_of(first.unwrap_or(Path::new(""))))?;
        Ok(ShardedJob {
            job: Self {
                camera: record.camera,
                ..Self::of(file.config, dir)
            },
            command: record.command,
        })
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
        start: JobStart,
        stop: &AtomicBool,
        observer: &mut dyn JobObserver,
    ) -> Result<DesignEvaluation> {
        self.check()?;
        let state_before = self.state(start, None)?;
        let _lock = FolderLock::take(&self.dir)?;
        // Another job may have ended in the folder before the lock was taken.
        let state = match start {
            JobStart::Resume => state_before,
            JobStart::Fresh => self.state(start, None)?,
        };
        self.run_from(state, stop, observer)
    }

    /// Runs one shard's rounds, and leaves its checkpoint in the folder; `false` if stopped before
    /// their end.
    ///
    /// # Errors
    /// As [`DesignJob::run`]; [`crate::Error::Input`] also for the checkpoint of another shard.
    pub fn run_shard(
        &self,
        shard: Shard,
        start: JobStart,
        stop: &AtomicBool,
        observer: &mut dyn JobObserver,
    ) -> Result<bool> {
        self.check()?;
        let mut state = self.state(start, Some(shard))?;
        let _lock = FolderLock::take(&self.dir)?;
        observer.begins(&state);
        let record = ShardRecord {
            shard,
            command: observer.command(&self.config),
            camera: self.camera.clone(),
        };
        let mut keeper = CheckpointKeeper::new(self, Some(record), stop, observer);
        let done = search_rounds(&shard.config(&self.config), &mut state, stop, &mut keeper)?;
        keeper.save(&state)?;
        Ok(done)
    }

    /// Merges finished shards: the best of all meet in the last trial; evaluates the winner and writes
    /// everything. [`JobStart::Resume`] continues a merge of the same shards that was interrupted, if one
    /// has begun.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a shard that is missing, twice there, not finished or of another
    /// search, and for the checkpoint of anything but a merge of these; else those of
    /// [`DesignJob::run`].
    pub fn merge(
        &self,
        shards: &[PathBuf],
        start: JobStart,
        stop: &AtomicBool,
        observer: &mut dyn JobObserver,
    ) -> Result<DesignEvaluation> {
        self.check()?;
        let merged = SearchState::merged(&self.config, finished_shards(self, shards)?);
        self.merge_state(merged.clone(), start)?;
        let _lock = FolderLock::take(&self.dir)?;
        // Another job may have ended in the folder before the lock was taken.
        let state = self.merge_state(merged, start)?;
        self.run_from(state, stop, observer)
    }

    /// Where a merge starts: from `merged`, or from its own checkpoint.
    fn merge_state(&self, merged: SearchState, start: JobStart) -> Result<SearchState> {
        let path = self.dir.join(CHECKPOINT);
        if start == JobStart::Fresh || !path.exists() {
            self.reject_taken()?;
            return Ok(merged);
        }
        let begun = Checkpoint::load(&path)?.resume(&path, &self.config, None)?;
        // The finalists stay as they are until the end.
        if begun.shards != merged.shards || begun.pool != merged.pool {
            let problem = "is no merge of these shards; choose another folder";
            return Err(Error::input(path, "shards", problem));
        }
        Ok(begun)
    }

    fn check(&self) -> Result<()> {
        self.stencil.validate()?;
        self.evaluation.check()?;
        if let Some(request) = &self.camera {
            check_camera(request)?;
        }
        self.config.check()
    }

    /// Continues from this state, in the folder that the caller has locked.
    fn run_from(
        &self,
        mut state: SearchState,
        stop: &AtomicBool,
        observer: &mut dyn JobObserver,
    ) -> Result<DesignEvaluation> {
        let clock = Instant::now();
        observer.begins(&state);
        let mut keeper = CheckpointKeeper::new(self, None, stop, observer);
        let mut outcome = design(&self.config, &mut state, stop, &mut keeper)?;
        let camera = keeper.camera;
        let search_s = clock.elapsed().as_secs_f64();
        let searched = DesignConfig {
            rounds: state.round.max(1),
            ..self.config.clone()
        };
        let command = observer.command(&searched);
        let mut found = self.evaluated(&mut outcome, &searched, stop, observer)?;
        found = found.with_design(self.record(camera.as_ref()))?;
        let ball_mm = self.stencil.ball_diameter_mm;
        let drawn = self.config.constraints.drawn;
        found.report.added = DotPlace::added(found.ball.pattern().dots(), drawn, ball_mm);
        found.report.command = command;
        found.report.camera = camera;
        found.timing.search_s = search_s;
        let results = Replacement::begin(&self.dir)?;
        found.write(results.path())?;
        #[cfg(feature = "plot")]
        super::plots::write_all(results.path(), &found.report, &found.ball, &self.pictures)?;
        #[cfg(feature = "plot")]
        if !found.report.added.is_empty() {
            super::plots::to_draw(&results.path().join(ADDED), &found, &self.stencil)?;
        }
        self.write_stencil(&found, results.path(), observer)?;
        DesignPage::read(results.path())?.write(results.path())?;
        results.publish(&OPTIONAL, REPORT)?;
        Ok(found)
    }

    /// Evaluates the winner; where `stop` ends that, or ended the search, by a few trials.
    fn evaluated(
        &self,
        outcome: &mut DesignOutcome,
        searched: &DesignConfig,
        stop: &AtomicBool,
        observer: &mut dyn JobObserver,
    ) -> Result<DesignEvaluation> {
        if !outcome.stopped {
            let mut says = |what: &str| observer.step(what);
            match evaluate(outcome, searched, &self.evaluation, stop, &mut says) {
                Err(Error::Stopped) => outcome.stopped = true,
                found => return found,
            }
        }
        observer.step("stopped: evaluating the best so far")?;
        let few = EvaluationConfig::of_search(&DesignConfig {
            samples: self.evaluation.samples.min(STOPPED_SAMPLES),
            ..searched.clone()
        });
        let never = AtomicBool::new(false);
        evaluate(outcome, searched, &few, &never, &mut |_| Ok(()))
    }

    /// Makes the stencil. Beside drawn dots, whose places nobody chose for one, it is left out where none is possible.
    fn write_stencil(
        &self,
        found: &DesignEvaluation,
        dir: &Path,
        observer: &mut dyn JobObserver,
    ) -> Result<()> {
        if self.config.constraints.drawn > 0
            && Stencil::check(found.ball.pattern(), &self.stencil).is_err()
        {
            return Ok(());
        }
        observer.step("making the stencil")?;
        found.write_stencil(dir, &self.stencil)
    }

    /// What the pattern is designed for.
    fn record(&self, camera: Option<&CameraRecord>) -> DesignRecord {
        DesignRecord {
            ball_diameter_mm: self.stencil.ball_diameter_mm,
            dot_diameter_mm: self.stencil.hole_diameter_mm,
            camera: camera.map(|camera| camera.request.conditions.clone()),
            criterion: Some(match camera {
                Some(_) => "error on frames of the camera".to_owned(),
                None => format!(
                    "right orientations of all views, protocol {}",
                    self.config.views
                ),
            }),
        }
    }

    /// Where the search, or a shard of it, starts.
    fn state(&self, start: JobStart, shard: Option<Shard>) -> Result<SearchState> {
        match start {
            JobStart::Resume => {
                let path = self.dir.join(CHECKPOINT);
                Checkpoint::load(&path)?.resume(&path, &self.config, shard)
            }
            JobStart::Fresh => {
                self.reject_taken()?;
                Ok(SearchState::default())
            }
        }
    }

    /// Rejects a folder that holds a design.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] of the parameter `out`.
    pub(crate) fn reject_taken(&self) -> Result<()> {
        reject_design(&self.dir, "choose another folder, or --resume it")
    }
}

/// Rejects a folder that holds a design, whole or not; `advice` ends the message.
///
/// # Errors
/// [`crate::Error::Argument`] of the parameter `out`.
pub(crate) fn reject_design(dir: &Path, advice: &str) -> Result<()> {
    let what = match dir.join(CHECKPOINT).exists() && !dir.join(REPORT).exists() {
        true => "an incomplete design",
        false => "a design",
    };
    files::reject_taken(dir, &[REPORT, CHECKPOINT, PATTERN], what, advice)
}

/// Rejects a camera that cannot rank finalists.
#[cfg(feature = "vision")]
fn check_camera(request: &CameraRequest) -> Result<()> {
    crate::camera::requested_conditions(request).map(drop)
}

/// Rejects a camera: without images there are no frames to rank by.
#[cfg(not(feature = "vision"))]
fn check_camera(_: &CameraRequest) -> Result<()> {
    let problem = "ranks finalists on rendered frames, which this build does not have";
    Err(Error::argument("camera", problem))
}

/// The folder's checkpoint, or the file itself.
fn checkpoint_of(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join(CHECKPOINT)
    } else {
        path.to_path_buf()
    }
}

/// A shard's checkpoint, with what it says of the shard.
fn read_shard(path: &Path) -> Result<(Checkpoint, ShardRecord)> {
    let mut file = Checkpoint::load(path)?;
    let record = file.shard.take().ok_or_else(|| {
        let problem = "expected a shard's search, found one of one piece";
        Error::input(path, "shard", problem)
    })?;
    Ok((file, record))
}

/// The states of all shards of a search, in their order.
fn finished_shards(job: &DesignJob, paths: &[PathBuf]) -> Result<Vec<SearchState>> {
    let config = &job.config;
    let mut found: Vec<(PathBuf, Shard, SearchState)> = Vec::new();
    for path in paths {
        let path = checkpoint_of(path);
        let (file, ShardRecord { shard, camera, .. }) = read_shard(&path)?;
        let reject = |problem: String| Err(Error::input(&path, "shard", problem));
        if file.config != *config || camera != job.camera {
            return reject(format!(
                "shard {shard} belongs to a search with other arguments"
            ));
        }
        if file.state.round < config.rounds {
            let (done, all) = (file.state.round, config.rounds);
            return reject(format!(
                "shard {shard} has {done} of {all} rounds: --resume it first"
            ));
        }
        if let Some((other, ..)) = found.iter().find(|(_, s, _)| s.index == shard.index) {
            return reject(format!("shard {shard} is also in {}", other.display()));
        }
        let expected = found.first().map_or(shard.count, |(_, s, _)| s.count);
        if shard.count != expected {
            return reject(format!("expected one of {expected} shards, found {shard}"));
        }
        found.push((path, shard, file.state));
    }
    let Some(count) = found.first().map(|(_, shard, _)| shard.count) else {
        return Err(Error::argument(
            "shards",
            "expected at least one, found none",
        ));
    };
    let is_missing = |k: &usize| found.iter().all(|(_, shard, _)| shard.index != *k);
    if let Some(missing) = (1..=count).find(is_missing) {
        let problem = format!("expected all {count} of them, shard {missing}/{count} is missing");
        return Err(Error::argument("shards", problem));
    }
    found.sort_by_key(|(_, shard, _)| shard.index);
    Ok(found.into_iter().map(|(.., state)| state).collect())
}

/// Saves a search on disk before its observer is called.
struct CheckpointKeeper<'a> {
    job: &'a DesignJob,
    shard: Option<ShardRecord>,
    /// Ends the ranking by a camera.
    #[cfg_attr(not(feature = "vision"), expect(dead_code))]
    stop: &'a AtomicBool,
    observer: &'a mut dyn JobObserver,
    /// How a camera ranks the finalists.
    camera: Option<CameraRecord>,
}

impl<'a> CheckpointKeeper<'a> {
    fn new(
        job: &'a DesignJob,
        shard: Option<ShardRecord>,
        stop: &'a AtomicBool,
        observer: &'a mut dyn JobObserver,
    ) -> Self {
        Self {
            job,
            shard,
            stop,
            observer,
            camera: None,
        }
    }

    fn save(&self, state: &SearchState) -> Result<()> {
        let (config, shard) = (self.job.config.clone(), self.shard.clone());
        Checkpoint::new(config, state.clone(), shard).save(&self.job.dir.join(CHECKPOINT))
    }
}

impl DesignObserver for CheckpointKeeper<'_> {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> Result<()> {
        self.save(state)?;
        self.observer.progress(state, stage)
    }

    fn rank(&mut self, finalists: &mut [DesignCandidate]) -> Result<()> {
        #[cfg(feature = "vision")]
        if let Some(request) = &self.job.camera {
            let frames = crate::camera::RaceConfig::of_frames(request.frames).frames();
            let done = self
                .observer
                .ranks(frames.saturating_mul(finalists.len() as u64))?;
            self.camera = crate::camera::rank_finalists(request, finalists, self.stop, &*done)?;
        }
        self.observer.rank(finalists)
    }

    fn another_round(&mut self, state: &SearchState) -> bool {
        self.observer.another_round(state)
    }
}
