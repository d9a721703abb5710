//! Searches for patterns.

use std::ffi::OsString;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::json;
use spindoe::Error;
use spindoe::design::checkpoint::SearchState;
use spindoe::design::{DesignObserver, Stage};
use spindoe::report::{JobObserver, Start};

use crate::errors::to_python;
use crate::pattern::{HashTable, to_json};
use crate::work::interruptible;

/// A design as `spindoe design` with the same flags runs it.
#[pyclass(frozen, module = "spindoe._native")]
pub struct DesignJob {
    job: spindoe::DesignJob,
    start: Start,
}

/// Passes the search's progress on to Python, and ends the search when Python says so.
struct Observer<'a> {
    callback: Option<Py<PyAny>>,
    stop: &'a AtomicBool,
    raised: Option<PyErr>,
    begun: Instant,
    budget: Option<Duration>,
}

impl Observer<'_> {
    fn tell(&mut self, event: &serde_json::Value) -> spindoe::Result<()> {
        // Ctrl-C ends it here: what was found so far is on disk.
        if self.stop.load(Ordering::Relaxed) {
            return Err(Error::Internal("interrupted".to_owned()));
        }
        let Some(callback) = &self.callback else {
            return Ok(());
        };
        let told = Python::attach(|py| callback.call1(py, (event.to_string(),)).map(drop));
        told.map_err(|error| {
            self.raised = Some(error);
            Error::Internal("the callback raised".to_owned())
        })
    }

    fn has_time(&self) -> bool {
        self.budget
            .is_none_or(|budget| self.begun.elapsed() < budget)
    }
}

impl DesignObserver for Observer<'_> {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> spindoe::Result<()> {
        self.tell(&json!({
            "stage": stage,
            "rounds": state.round,
            "scouted": state.scouted.len(),
            "climbed": state.climbed.len(),
            "best": state.best(stage),
            "elapsed_s": state.elapsed_s,
        }))
    }

    fn another_round(&mut self, _: &SearchState) -> bool {
        self.has_time()
    }

    fn another_polish(&mut self, _: &SearchState) -> bool {
        self.has_time()
    }
}

impl JobObserver for Observer<'_> {
    fn step(&mut self, what: &str) {
        // An error of the callback here ends nothing: the next progress tells it.
        let _ = self.tell(&json!({ "stage": "finish", "step": what }));
    }
}

#[pymethods]
impl DesignJob {
    /// The job of these flags of `spindoe design`.
    #[new]
    fn new(flags: Vec<OsString>) -> PyResult<Self> {
        let (job, start) = spindoe::cli::design_job(flags).map_err(PyValueError::new_err)?;
        Ok(Self { job, start })
    }

    /// The configuration of the search, as JSON.
    fn settings(&self) -> PyResult<String> {
        to_json(&self.job.config)
    }

    fn dir(&self) -> std::path::PathBuf {
        self.job.dir.clone()
    }

    /// Runs it; the table, and the report as JSON.
    fn run(
        &self,
        py: Python<'_>,
        callback: Option<Py<PyAny>>,
        budget_s: Option<f64>,
    ) -> PyResult<(HashTable, String)> {
        let budget = budget_s.map(Duration::try_from_secs_f64).transpose();
        let budget = budget.map_err(|e| PyValueError::new_err(format!("budget_s: {e}")))?;
        let (outcome, raised) = interruptible(py, |stop| {
            let mut observer = Observer {
                callback,
                stop,
                raised: None,
                begun: Instant::now(),
                budget,
            };
            let outcome = self.job.run(self.start, stop, &mut observer);
            (outcome, observer.raised)
        })?;
        match (outcome, raised) {
            (_, Some(error)) => Err(error),
            (Err(error), None) => Err(to_python(error)),
            (Ok(found), None) => Ok((HashTable(Arc::new(found.table)), to_json(&found.report)?)),
        }
    }
}
