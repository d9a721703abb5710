//! Files of others: the published trajectories, and the nets as ONNX.

use std::path::PathBuf;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use spindoe::spin::trajectories::TrajectorySet;
use spindoe::vision::net::graph::Head;
use spindoe::vision::net::{Weights, onnx};

use crate::errors::OrRaise;
use crate::pattern::to_json;
use crate::work::abandonable;

/// A trajectory: its number, times (n,), positions (n, 3), and spin.
type Trajectory<'py> = (
    u32,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Option<[f64; 3]>,
);

/// The trajectories of a folder, and what describes them as JSON.
#[pyfunction]
pub fn read_trajectories(py: Python<'_>, dir: PathBuf) -> PyResult<(Vec<Trajectory<'_>>, String)> {
    let set = abandonable(py, move |_| TrajectorySet::read_dir(&dir))?.or_raise()?;
    let summary = to_json(&set.summary())?;
    let all = set.trajectories.iter().map(|t| {
        let times: Vec<f64> = t.points.iter().map(|p| p.time_s).collect();
        let positions =
            Array2::from_shape_fn((t.points.len(), 3), |(i, k)| t.points[i].position_m[k]);
        (
            t.number,
            times.into_pyarray(py),
            positions.into_pyarray(py),
            t.spin.map(Into::into),
        )
    });
    Ok((all.collect(), summary))
}

/// The bytes of a net as ONNX: that of a file, or the built-in one of this head.
#[pyfunction]
pub fn onnx_bytes(
    head: &str,
    weights: Option<PathBuf>,
) -> PyResult<std::borrow::Cow<'static, [u8]>> {
    let weights = match weights {
        Some(path) => Weights::read(&path),
        None => head.parse::<Head>().and_then(Weights::built_in),
    };
    Ok(onnx::to_onnx(&weights.or_raise()?).into())
}
