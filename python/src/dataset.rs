//! Clips to a data set of flights.

use std::path::PathBuf;

use pyo3::prelude::*;
use spindoe::clip::{BatchConfig, FrameClock};
use spindoe::dataset::{self, DatasetConfig, FILES, Record};
use spindoe::files::Replacement;
use spindoe::geometry::CameraFrame;

use crate::errors::{OrRaise, value_error};
use crate::estimator::Estimator;
use crate::pattern::to_json;
use crate::work::abandonable;

/// Writes the flights of clips to a folder; what `dataset.json` then says. `names` are those of the estimators' tables.
#[pyfunction]
#[pyo3(signature = (clips, estimators, names, output, fps, frame, max_rps, overwrite))]
#[allow(clippy::too_many_arguments)]
pub fn write_dataset(
    py: Python<'_>,
    clips: Vec<PathBuf>,
    estimators: Vec<PyRef<'_, Estimator>>,
    names: Vec<String>,
    output: PathBuf,
    fps: Option<f64>,
    frame: &str,
    max_rps: f64,
    overwrite: bool,
) -> PyResult<String> {
    let axes: CameraFrame = frame.parse().or_raise()?;
    if axes.is_view() {
        let problem = format!("expected camera or optical, found {frame:?}");
        return Err(value_error("frame", problem));
    }
    let taken = FILES.iter().find(|name| output.join(name).exists());
    if let Some(name) = taken.filter(|_| !overwrite) {
        let problem = format!("{} holds a data set already ({name})", output.display());
        return Err(value_error("output", problem));
    }
    let estimators: Vec<spindoe::Estimator> =
        estimators.iter().map(|e| e.library().clone()).collect();
    let mut config = DatasetConfig {
        batch: BatchConfig {
            clock: fps.map_or(FrameClock::Inputs, FrameClock::FramesPerSecond),
            verdict: true,
            ..BatchConfig::default()
        },
        axes,
        ..DatasetConfig::default()
    };
    config.batch.sequence.spin.max_rps = max_rps;
    let record = abandonable(py, move |stop| {
        (config.batch.budget.stop, config.batch.sequence.stop) = (Some(stop), Some(stop));
        let set = Replacement::begin(&output)?;
        let read = |path: &PathBuf| dataset::read_clip(&estimators, path, &config, &());
        let clips = clips
            .iter()
            .map(read)
            .collect::<spindoe::Result<Vec<_>>>()?;
        let record = Record::new(&names, &estimators, &config, &clips);
        dataset::write(set, &output, &clips, &record)?;
        Ok::<_, spindoe::Error>(record)
    })?;
    to_json(&record.or_raise()?)
}
