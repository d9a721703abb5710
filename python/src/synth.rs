//! Synthetic images with their truth.

use std::sync::Arc;

use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3};
use pyo3::prelude::*;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{self, ClipConfig, Frame};

use crate::errors::{OrRaise, value_error};
use crate::pattern::{HashTable, overlay, to_json};
use crate::work::abandonable;

/// An image, eight bits a channel, and its truth as JSON.
type Rendered<'py> = (Bound<'py, PyArray3<u8>>, String);

fn config(table: &HashTable, preset: &str, settings: &str) -> PyResult<SynthConfig> {
    let mut defaults = match preset {
        "good" => SynthConfig::good(),
        "wide" => SynthConfig::default(),
        other => {
            let problem = format!("expected good or wide, found {other:?}");
            return Err(value_error("preset", problem));
        }
    };
    if let Some(design) = table.0.design() {
        defaults.dot_radius_rad = [design.dot_radius_rad(); 2];
    }
    overlay(&defaults, settings)
}

fn rendered<'py>(py: Python<'py>, frame: &Frame) -> PyResult<Rendered<'py>> {
    let shape = (frame.image.height(), frame.image.width(), 3);
    let image = Array3::from_shape_vec(shape, frame.image.to_bytes())
        .map_err(|e| value_error("image", e))?;
    Ok((image.into_pyarray(py), to_json(&frame.truth)?))
}

/// Frame number `k` of a seed's independent frames.
#[pyfunction]
pub fn independent_frame<'py>(
    py: Python<'py>,
    table: &HashTable,
    preset: &str,
    settings: &str,
    seed: u64,
    k: usize,
) -> PyResult<Rendered<'py>> {
    let config = config(table, preset, settings)?;
    let ball = Arc::clone(&table.0);
    let draw = move |_| dataset::independent_frame(ball.pattern(), &config, seed, k);
    let drawn = abandonable(py, draw)?;
    rendered(py, &drawn.or_raise()?)
}

/// One ball in a row of frames.
#[pyclass(frozen, module = "spindoe._native")]
pub struct Sequence(Arc<dataset::Sequence>);

#[pymethods]
impl Sequence {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        table: &HashTable,
        preset: &str,
        settings: &str,
        seed: u64,
        frames: usize,
        fps: f64,
        spin: Option<[f64; 3]>,
        exposure_s: Option<f64>,
        drift_px: Option<[f64; 2]>,
    ) -> PyResult<Self> {
        let sequence = ClipConfig {
            fps,
            spin,
            exposure_s,
            drift_px,
            readout_s: 0.0,
        };
        let config = config(table, preset, settings)?;
        let random = dataset::Sequence::random(table.0.pattern(), &config, &sequence, seed, frames);
        Ok(Self(Arc::new(random.or_raise()?)))
    }

    fn frame<'py>(&self, py: Python<'py>, k: usize) -> PyResult<Rendered<'py>> {
        let sequence = Arc::clone(&self.0);
        let drawn = abandonable(py, move |_| sequence.frame(k))?;
        rendered(py, &drawn.or_raise()?)
    }
}
