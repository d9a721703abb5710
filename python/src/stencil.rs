//! Stencils: meshes and files.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;
use spindoe::StencilConfig;
use spindoe::stencil::HalfName;

use crate::arrays::rows;
use crate::errors::{OrRaise, value_error};
use crate::pattern::{HashTable, overlay, to_json};
use crate::work::abandonable;

#[pyclass(frozen, module = "spindoe._native")]
pub struct Stencil(spindoe::Stencil);

/// The sizes given, else those of the ball's design, with the settings.
fn config(
    table: &HashTable,
    ball_diameter_mm: Option<f64>,
    hole_diameter_mm: Option<f64>,
    settings: &str,
) -> PyResult<StencilConfig> {
    let [ball_diameter_mm, hole_diameter_mm] = table.0.sizes_mm(ball_diameter_mm, hole_diameter_mm);
    let usual = StencilConfig::for_ball(ball_diameter_mm);
    Ok(StencilConfig {
        ball_diameter_mm,
        hole_diameter_mm,
        ..overlay(&usual, settings)?
    })
}

#[pymethods]
impl Stencil {
    #[staticmethod]
    fn build(
        py: Python<'_>,
        table: &HashTable,
        ball_diameter_mm: Option<f64>,
        hole_diameter_mm: Option<f64>,
        settings: &str,
    ) -> PyResult<Self> {
        let config = config(table, ball_diameter_mm, hole_diameter_mm, settings)?;
        let ball = Arc::clone(&table.0);
        let built = abandonable(py, move |_| {
            spindoe::Stencil::build(ball.pattern(), &config)
        })?;
        Ok(Self(built.or_raise()?))
    }

    /// Diameter of the largest hole that fits, mm.
    #[staticmethod]
    fn largest_hole_mm(
        py: Python<'_>,
        table: &HashTable,
        ball_diameter_mm: Option<f64>,
        settings: &str,
    ) -> PyResult<Option<f64>> {
        let config = config(table, ball_diameter_mm, None, settings)?;
        config.validate().or_raise()?;
        let ball = Arc::clone(&table.0);
        abandonable(py, move |_| {
            spindoe::Stencil::largest_hole_mm(ball.pattern(), &config)
        })
    }

    /// Vertices and triangles of half "a" or "b".
    #[allow(clippy::type_complexity)]
    fn half<'py>(
        &self,
        py: Python<'py>,
        name: &str,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>)> {
        let half = match name {
            "a" => HalfName::A,
            "b" => HalfName::B,
            other => {
                return Err(value_error(
                    "half",
                    format!("expected a or b, found {other:?}"),
                ));
            }
        };
        let mesh = &self.0.half(half).mesh;
        let at = |(i, k): (usize, usize)| mesh.triangles[i][k];
        let triangles = Array2::from_shape_fn((mesh.triangles.len(), 3), at).into_pyarray(py);
        Ok((rows(py, &mesh.vertices), triangles))
    }

    fn save(&self, py: Python<'_>, dir: PathBuf) -> PyResult<()> {
        py.detach(|| self.0.write(&dir)).or_raise()
    }

    /// What `stencil.json` holds.
    fn description(&self) -> PyResult<String> {
        to_json(&self.0.description().or_raise()?)
    }
}
