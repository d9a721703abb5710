//! Searches for patterns.

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::json;
use spindoe::Error;
use spindoe::design::{DesignConfig, DesignObserver, DesignRequest, SearchState, Shard, Stage};
use spindoe::report::plots::PictureFormat;
use spindoe::report::{JobObserver, JobStart, ShardedJob};

use crate::errors::OrRaise;
use crate::pattern::{HashTable, Pattern, overlay, to_json};
use crate::work::abandonable;

/// A design, checked.
#[pyclass(frozen, module = "spindoe._native")]
pub struct DesignJob(spindoe::DesignJob);

fn start(resume: bool) -> JobStart {
    if resume {
        JobStart::Resume
    } else {
        JobStart::Fresh
    }
}

/// What flags of `spindoe design` ask for: the pattern to improve, and the rest as JSON.
#[pyfunction]
pub fn design_request(flags: Vec<OsString>) -> PyResult<(Option<Pattern>, String)> {
    let request = spindoe::cli::design_request(flags).map_err(PyValueError::new_err)?;
    let settings = to_json(&request)?;
    Ok((request.pattern.map(Pattern), settings))
}

/// Runs work under an observer that calls Python, and maps what it ended with. Ctrl-C raises at once; the work ends by itself with its
/// present step, and holds its folder until then.
fn observed<T: Send + 'static>(
    py: Python<'_>,
    callback: Option<Py<PyAny>>,
    budget_s: Option<f64>,
    command: Option<String>,
    work: impl FnOnce(&'static AtomicBool, &mut Observer) -> spindoe::Result<T> + Send + 'static,
) -> PyResult<T> {
    let budget = budget_s.map(Duration::try_from_secs_f64).transpose();
    let budget = budget.map_err(|e| PyValueError::new_err(format!("budget_s: {e}")))?;
    let (outcome, raised) = abandonable(py, move |stop| {
        let stop = stop.flag();
        let mut observer = Observer {
            callback,
            stop,
            raised: None,
            begun: Instant::now(),
            budget,
            command,
        };
        let outcome = work(stop, &mut observer);
        (outcome, observer.raised)
    })?;
    match (outcome, raised) {
        (_, Some(error)) => Err(error),
        (outcome, None) => outcome.or_raise(),
    }
}

/// Merges the shards in these folders into a design, or continues that; the table, and the report as
/// JSON.
#[pyfunction]
#[pyo3(signature = (shards, out, resume, callback))]
pub fn merge(
    py: Python<'_>,
    shards: Vec<PathBuf>,
    out: PathBuf,
    resume: bool,
    callback: Option<Py<PyAny>>,
) -> PyResult<(HashTable, String)> {
    let ShardedJob { job, command } = spindoe::DesignJob::of_shards(&shards, out).or_raise()?;
    let found = observed(py, callback, None, command, move |stop, observer| {
        job.merge(&shards, start(resume), stop, observer)
    })?;
    Ok((HashTable::new(found.ball), to_json(&found.report)?))
}

/// Passes the search's progress on to Python, and ends the search when Python says so.
struct Observer {
    callback: Option<Py<PyAny>>,
    stop: &'static AtomicBool,
    raised: Option<PyErr>,
    begun: Instant,
    budget: Option<Duration>,
    command: Option<String>,
}

impl Observer {
    fn report(&mut self, event: &serde_json::Value) -> spindoe::Result<()> {
        // Ctrl-C ends it here: what was found so far is on disk.
        if self.stop.load(Ordering::Relaxed) {
            return Err(Error::Internal("interrupted".to_owned()));
        }
        let Some(callback) = &self.callback else {
            return Ok(());
        };
        let called = Python::attach(|py| callback.call1(py, (event.to_string(),)).map(drop));
        called.map_err(|error| {
            self.raised = Some(error);
            Error::Internal("the callback raised".to_owned())
        })
    }

    fn has_time(&self) -> bool {
        self.budget
            .is_none_or(|budget| self.begun.elapsed() < budget)
    }
}

impl DesignObserver for Observer {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> spindoe::Result<()> {
        self.report(&json!({
            "stage": stage,
            "rounds": state.round,
            "scouted": state.scouted.len(),
            "climbed": state.climbed.len(),
            "best": state.best(),
            "elapsed_s": state.elapsed_s,
        }))
    }

    fn another_round(&mut self, _: &SearchState) -> bool {
        self.has_time()
    }
}

impl JobObserver for Observer {
    fn step(&mut self, what: &str) -> spindoe::Result<()> {
        self.report(&json!({ "stage": "finish", "step": what }))
    }

    fn command(&self, _: &DesignConfig) -> Option<String> {
        self.command.clone()
    }
}

#[pymethods]
impl DesignJob {
    /// The job of a request, whose other fields than the pattern are JSON.
    #[new]
    fn new(
        dir: PathBuf,
        pattern: Option<&Pattern>,
        settings: &str,
        pictures: Vec<String>,
        unlimited: bool,
    ) -> PyResult<Self> {
        let mut request: DesignRequest = overlay(&DesignRequest::default(), settings)?;
        request.pattern = pattern.map(|pattern| pattern.0.clone());
        if unlimited {
            request.rounds = DesignRequest::UNLIMITED_ROUNDS;
        }
        let formats = pictures.iter().map(|name| name.parse::<PictureFormat>());
        Ok(Self(spindoe::DesignJob {
            pictures: formats.collect::<spindoe::Result<_>>().or_raise()?,
            ..spindoe::DesignJob::of(request.config().or_raise()?, dir)
        }))
    }

    /// Runs it; the table, and the report as JSON.
    fn run(
        &self,
        py: Python<'_>,
        callback: Option<Py<PyAny>>,
        resume: bool,
        budget_s: Option<f64>,
    ) -> PyResult<(HashTable, String)> {
        let job = self.0.clone();
        let found = observed(py, callback, budget_s, None, move |stop, observer| {
            job.run(start(resume), stop, observer)
        })?;
        Ok((HashTable::new(found.ball), to_json(&found.report)?))
    }

    /// Runs shard `index` of `count`.
    fn run_shard(
        &self,
        py: Python<'_>,
        index: usize,
        count: usize,
        callback: Option<Py<PyAny>>,
        resume: bool,
    ) -> PyResult<()> {
        let shard = Shard::new(index, count).or_raise()?;
        let job = self.0.clone();
        observed(py, callback, None, None, move |stop, observer| {
            job.run_shard(shard, start(resume), stop, observer)
        })?;
        Ok(())
    }
}
