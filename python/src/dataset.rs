//! Clips to a data set of flights.

use std::path::PathBuf;

use pyo3::prelude::*;
use spindoe::clip::{BatchConfig, FrameClock};
use spindoe::dataset::{self, BounceConfig, DatasetConfig, Destination, Record};
use spindoe::geometry::CameraFrame;

use crate::clip::Asked;
use crate::errors::{OrRaise, value_error};
use crate::estimator::Estimator;
use crate::pattern::to_json;
use crate::work::abandonable;

/// Writes the flights of clips to a folder; what `dataset.json` then says. `names` are those of the estimators' tables, `bounces` the points to
/// either side, ln of the odds and change of the velocity of a [`BounceConfig`].
#[pyfunction]
#[pyo3(signature = (clips, estimators, names, output, fps, frame, asked, bounces, overwrite))]
#[allow(clippy::too_many_arguments)]
pub fn write_dataset(
    py: Python<'_>,
    clips: Vec<PathBuf>,
    estimators: Vec<PyRef<'_, Estimator>>,
    names: Vec<String>,
    output: PathBuf,
    fps: Option<f64>,
    frame: &str,
    asked: Asked,
    bounces: (usize, f64, f64),
    overwrite: bool,
) -> PyResult<String> {
    let axes = frame.parse::<CameraFrame>();
    let Some(axes) = axes.ok().filter(|axes| !axes.is_view()) else {
        let problem = format!("expected camera or optical, found {frame:?}");
        return Err(value_error("frame", problem));
    };
    if let Some(fps) = fps.filter(|fps| !(*fps > 0.0 && fps.is_finite())) {
        let problem = format!("expected a positive number, found {fps}");
        return Err(value_error("fps", problem));
    }
    let estimators: Vec<spindoe::Estimator> =
        estimators.iter().map(|e| e.library().clone()).collect();
    let bounces = BounceConfig {
        half_window: bounces.0,
        min_log_odds: bounces.1,
        min_jump_m_s: bounces.2,
    };
    bounces.check().or_raise()?;
    let mut config = DatasetConfig {
        batch: BatchConfig {
            clock: fps.map_or(FrameClock::Inputs, FrameClock::FramesPerSecond),
            ..asked.config()?
        },
        bounces,
        axes,
    };
    let record = abandonable(py, move |stop| {
        (config.batch.budget.stop, config.batch.sequence.stop) = (Some(stop), Some(stop));
        let to = Destination::begin(&output, &clips, overwrite)?;
        let read = |path: &PathBuf| dataset::read_clip(&estimators, path, &config, &());
        let clips = clips
            .iter()
            .map(read)
            .collect::<spindoe::Result<Vec<_>>>()?;
        let record = Record::new(&names, &estimators, &config, &clips);
        dataset::write(to, &clips, &record)?;
        Ok::<_, spindoe::Error>(record)
    })?;
    to_json(&record.or_raise()?)
}
