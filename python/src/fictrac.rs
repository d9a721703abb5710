//! Orientations as FicTrac's rows.

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;
use spindoe::geometry::CameraFrame;
use spindoe::spin::fictrac::{self, COLUMNS, FicTracConfig, NAMES};
use spindoe::spin::orientations::{OrientationRow, Orientations};

use crate::arrays::{Numbers, require_orientations, require_sides, rotation};
use crate::errors::{OrRaise, value_error};
use crate::spin::covariance;

/// Names of the columns, numbers (rows, 25), and the file's text.
type Rows<'py> = (Vec<&'static str>, Bound<'py, PyArray2<f64>>, String);

/// The rows of FicTrac for orientations in `frame`.
#[pyfunction]
#[pyo3(signature = (times_s, quaternions, covariances, frame, c2a_r, max_bad_frames))]
pub fn fictrac_rows<'py>(
    py: Python<'py>,
    times_s: Numbers<'py>,
    quaternions: Numbers<'py>,
    covariances: Option<Numbers<'py>>,
    frame: &str,
    c2a_r: Option<[f64; 3]>,
    max_bad_frames: Option<i64>,
) -> PyResult<Rows<'py>> {
    let count = require_orientations("quaternions_wxyz", &times_s, &quaternions)?;
    if let Some(covariances) = &covariances {
        let shape = [Some(count), Some(3), Some(3)];
        require_sides("covariances_rad2", covariances, &shape)?;
    }
    if let Some(found) = max_bad_frames.filter(|n| *n < -1) {
        let problem = format!("expected a number, or -1 for never, found {found}");
        return Err(value_error("max_bad_frames", problem));
    }
    let frames: CameraFrame = frame.parse().map_err(|_| {
        let names = CameraFrame::ALL.map(CameraFrame::as_str).join(", ");
        value_error("frame", format!("expected one of {names}, found {frame:?}"))
    })?;
    let mut config = FicTracConfig {
        // -1 is never.
        max_bad_frames: max_bad_frames.and_then(|n| n.try_into().ok()),
        ..FicTracConfig::default()
    };
    if let Some(c2a_r) = c2a_r {
        config = config.with_c2a_r(c2a_r).or_raise()?;
    }
    let mut file = Orientations {
        camera_frame: Some(frames),
        ..Orientations::default()
    };
    let covariances = covariances.as_ref().map(|c| c.as_array());
    let (times, rows) = (times_s.as_array(), quaternions.as_array());
    for i in 0..count {
        let mut row = OrientationRow {
            time_s: times[i],
            ..OrientationRow::default()
        };
        let wxyz = [0, 1, 2, 3].map(|k| rows[[i, k]]);
        if !wxyz.iter().all(|x| x.is_nan()) {
            row.orientation = Some(rotation(&format!("quaternions_wxyz: row {i}"), wxyz)?);
            row.covariance = covariances.as_ref().map(|c| covariance(c, i)).transpose()?;
        }
        file.rows.push(row);
    }
    let rows = fictrac::rows(&file, config).or_raise()?;
    let text: String = rows.iter().map(|row| format!("{row}\n")).collect();
    let values: Vec<f64> = rows.iter().flat_map(|row| row.values()).collect();
    let table = Array2::from_shape_vec((rows.len(), COLUMNS), values);
    let table = table.map_err(|e| value_error("rows", e.to_string()))?;
    Ok((NAMES.to_vec(), table.into_pyarray(py), text))
}
