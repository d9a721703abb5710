//! Synthetic images with their truth.

use std::sync::Arc;

use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3};
use pyo3::prelude::*;
use spindoe::Ball;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{self, ClipConfig, SynthFrame};
use spindoe::synth::rig;

use crate::errors::{OrRaise, value_error};
use crate::pattern::{HashTable, overlay, to_json};
use crate::rig::Rig;
use crate::work::abandonable;

/// An image, eight bits a channel, and its truth as JSON.
type Rendered<'py> = (Bound<'py, PyArray3<u8>>, String);

fn config(ball: &Ball, preset: &str, settings: &str) -> PyResult<SynthConfig> {
    let mut defaults = match preset {
        "good" => SynthConfig::good(),
        "wide" => SynthConfig::default(),
        other => {
            let problem = format!("expected good or wide, found {other:?}");
            return Err(value_error("preset", problem));
        }
    };
    if let Some(design) = ball.design() {
        defaults.dot_radius_rad = [design.dot_radius_rad(); 2];
    }
    overlay(&defaults, settings)
}

fn rendered<'py>(py: Python<'py>, frame: &SynthFrame) -> PyResult<Rendered<'py>> {
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
    let config = config(&table.0, preset, settings)?;
    let ball = Arc::clone(&table.0);
    let draw = move |_| dataset::independent_frame(ball.pattern(), &config, seed, k);
    let drawn = abandonable(py, draw)?;
    rendered(py, &drawn.or_raise()?)
}

/// One ball in a row of frames.
#[pyclass(frozen, module = "spindoe._native")]
pub struct Sequence(Arc<dataset::SynthSequence>);

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
        let config = config(&table.0, preset, settings)?;
        let random =
            dataset::SynthSequence::random(table.0.pattern(), &config, &sequence, seed, frames);
        Ok(Self(Arc::new(random.or_raise()?)))
    }

    fn frame<'py>(&self, py: Python<'py>, k: usize) -> PyResult<Rendered<'py>> {
        let sequence = Arc::clone(&self.0);
        let drawn = abandonable(py, move |_| sequence.frame(k))?;
        rendered(py, &drawn.or_raise()?)
    }
}

/// The ball of a rig in a row of frames of each of its cameras.
#[pyclass(frozen, module = "spindoe._native")]
pub struct RigSequence(Arc<rig::RigSequence>);

#[pymethods]
impl RigSequence {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        rig: &Rig,
        preset: &str,
        settings: &str,
        seed: u64,
        frames: usize,
        fps: f64,
        spin: Option<[f64; 3]>,
        exposure_s: Option<f64>,
    ) -> PyResult<Self> {
        let clip = ClipConfig {
            fps,
            spin,
            exposure_s,
            ..ClipConfig::default()
        };
        let ball = rig.ball();
        let config = config(ball, preset, settings)?;
        let [diameter_mm, _] = ball.sizes_mm(None, None);
        let radius_m = 0.5e-3 * diameter_mm;
        let random = rig::RigSequence::random(
            ball.pattern(),
            &config,
            &clip,
            rig.library(),
            radius_m,
            seed,
            frames,
        );
        Ok(Self(Arc::new(random.or_raise()?)))
    }

    fn frame<'py>(&self, py: Python<'py>, camera: usize, k: usize) -> PyResult<Rendered<'py>> {
        let sequence = Arc::clone(&self.0);
        let drawn = abandonable(py, move |_| sequence.frame(camera, k))?;
        rendered(py, &drawn.or_raise()?)
    }
}
