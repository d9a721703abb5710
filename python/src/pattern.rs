//! Patterns, and balls with their hash tables.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use numpy::ndarray::{Array1, Array2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use spindoe::ball::{Feature, PaperConfig};
use spindoe::{Ball, PairRule};

use crate::arrays::{Numbers, blocks3, rows, triples, vectors};
use crate::errors::{OrRaise, value_error};
use crate::work::abandonable;

/// A value as JSON.
pub fn to_json(value: &impl Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|e| value_error("JSON", e))
}

/// Defaults with the fields of a JSON object in their place.
///
/// # Errors
/// `ValueError` naming the field that does not exist or does not fit.
pub fn overlay<T: Serialize + DeserializeOwned>(defaults: &T, json: &str) -> PyResult<T> {
    let internal = |e: serde_json::Error| value_error("settings", e);
    let mut value = serde_json::to_value(defaults).map_err(internal)?;
    let given: Map<String, Value> = serde_json::from_str(json).map_err(internal)?;
    for (name, new) in given {
        let old = value.get(&name).cloned().unwrap_or_default();
        laid_over(&mut value, &name, &name, new)?;
        if let Err(error) = serde_json::from_value::<T>(value.clone()) {
            return Err(value_error(&name, format!("{error} (default: {old})")));
        }
    }
    serde_json::from_value(value).map_err(internal)
}

/// Sets a field; of a group of settings only those that are given.
fn laid_over(group: &mut Value, path: &str, name: &str, new: Value) -> PyResult<()> {
    let known: Vec<String> = match &*group {
        Value::Object(fields) => fields.keys().cloned().collect(),
        _ => Vec::new(),
    };
    let Some(field) = group.get_mut(name) else {
        let problem = format!("no such setting, expected one of {}", known.join(", "));
        return Err(value_error(path, problem));
    };
    match (&*field, new) {
        // A choice among several has one name, and not that of another.
        (Value::Object(old), Value::Object(some))
            if old.len() > 1 || some.keys().all(|key| old.contains_key(key)) =>
        {
            some.into_iter()
                .try_for_each(|(key, new)| laid_over(field, &format!("{path}.{key}"), &key, new))
        }
        (_, new) => {
            *field = new;
            Ok(())
        }
    }
}

#[pyclass(frozen, module = "spindoe._native")]
pub struct Pattern(pub spindoe::Pattern);

#[pymethods]
impl Pattern {
    #[new]
    fn new(dots: Numbers<'_>) -> PyResult<Self> {
        let dots = vectors("pattern", &dots)?;
        Ok(Self(spindoe::Pattern::new(dots).or_raise()?))
    }

    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        Ok(Self(spindoe::Pattern::read_csv(&path).or_raise()?))
    }

    fn save(&self, path: PathBuf) -> PyResult<()> {
        self.0.write_csv(&path).or_raise()
    }

    fn dots<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        rows(py, self.0.dots())
    }

    fn sha256(&self) -> String {
        self.0.sha256()
    }

    /// The cones without dots: axis, and half angle in radians.
    fn keep_out(&self) -> Vec<([f64; 3], f64)> {
        let zones = self.0.keep_out().iter();
        zones
            .map(|zone| (zone.axis.into(), zone.half_angle_rad))
            .collect()
    }

    /// The same dots with these cones without any.
    fn with_keep_out(&self, zones: Vec<([f64; 3], f64)>) -> PyResult<Self> {
        let zone = |(axis, half_angle_rad): ([f64; 3], f64)| spindoe::KeepOut {
            axis: axis.into(),
            half_angle_rad,
        };
        let zones = zones.into_iter().map(zone).collect();
        Ok(Self(self.0.clone().with_keep_out(zones).or_raise()?))
    }

    fn summary(&self) -> PyResult<String> {
        to_json(&self.0.summary())
    }
}

/// The designs that the crate ships, by their names.
#[pyfunction]
pub fn shipped_designs() -> PyResult<Vec<(String, Pattern)>> {
    let shipped = spindoe::pattern::shipped_designs().or_raise()?;
    let named = shipped
        .into_iter()
        .map(|one| (one.name, Pattern(one.pattern)));
    Ok(named.collect())
}

#[pyclass(frozen, module = "spindoe._native")]
pub struct HashTable(pub Arc<Ball>);

impl HashTable {
    pub fn new(ball: Ball) -> Self {
        Self(Arc::new(ball))
    }

    /// The hash features, made from the dots.
    fn rows(&self) -> impl Iterator<Item = Feature> {
        self.0.pair_rule().features(self.0.pattern().dots())
    }
}

#[pymethods]
impl HashTable {
    #[staticmethod]
    fn build(
        pattern: &Pattern,
        min_cross: f64,
        max_angle_rad: f64,
        recognizer: &str,
    ) -> PyResult<Self> {
        let rule = PairRule {
            min_cross,
            max_angle_rad,
        };
        let config = overlay(&PaperConfig::default(), recognizer)?;
        let ball = Ball::new(pattern.0.clone()).with_recognizer(config);
        let ball = ball.and_then(|ball| ball.with_pair_rule(rule));
        Ok(Self::new(ball.or_raise()?))
    }

    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let ball = abandonable(py, move |_| Ball::read(&path))?;
        Ok(Self::new(ball.or_raise()?))
    }

    #[staticmethod]
    fn from_bytes(bytes: &[u8]) -> PyResult<Self> {
        let ball = Ball::from_npz(Path::new("hash table"), bytes);
        Ok(Self::new(ball.or_raise()?))
    }

    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let ball = Arc::clone(&self.0);
        let bytes = abandonable(py, move |_| ball.to_npz())?.or_raise()?;
        Ok(PyBytes::new(py, &bytes))
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.0.write_npz(&path)).or_raise()
    }

    fn pattern(&self) -> Pattern {
        Pattern(self.0.pattern().clone())
    }

    fn features<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let values: Vec<[f64; 3]> = self.rows().map(|f| f.value).collect();
        triples(py, &values)
    }

    fn bases<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u16>> {
        let bases: Vec<[u16; 2]> = self
            .rows()
            .map(|f| [f.basis.first, f.basis.second])
            .collect();
        Array2::from_shape_fn((bases.len(), 2), |(i, j)| bases[i][j]).into_pyarray(py)
    }

    fn feature_dots<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u16>> {
        Array1::from_iter(self.rows().map(|f| f.dot)).into_pyarray(py)
    }

    fn dot_covariances<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray3<f64>>> {
        self.0.dot_covariances().map(|c| blocks3(py, c))
    }

    fn meta(&self) -> PyResult<String> {
        to_json(&self.0.meta())
    }
}
