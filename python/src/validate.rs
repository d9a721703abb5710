//! Validation by Monte Carlo, and the views that it uses.

use std::sync::Arc;

use nalgebra::{Matrix2, Matrix3x2};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use spindoe::geometry::tangent_frame;
use spindoe::recognize::NamedRecognizer;
use spindoe::validate::TrialResult;
use spindoe::view::{Trial, TrialGenerator};
use spindoe::{DotUncertainty, Protocol, ProtocolName, Trials, ValidationConfig, Vec3};

use crate::arrays::{assignment, blocks3, quaternion, rows};
use crate::errors::{OrRaise, value_error};
use crate::pattern::{HashTable, to_json};
use crate::work::abandonable;

/// Trials between two calls of `progress`: some tenths of a second.
const TRIALS_AT_ONCE: u64 = 4096;

/// A view: directions, their covariances, the true dots, the true orientation, the number of true
/// ones.
type View<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    usize,
);

fn protocol(name: &str, sigma_rad: Option<f64>) -> PyResult<Protocol> {
    let standard = Protocol::standard(name.parse::<ProtocolName>().or_raise()?);
    let protocol = sigma_rad.map_or(standard, |sigma| standard.with_sigma_rad(sigma));
    protocol.view().check().or_raise()?;
    Ok(protocol)
}

/// Validates a table; the result as JSON, as `spindoe validate --json` prints it.
#[pyfunction]
#[pyo3(signature = (table, protocol, recognizer, samples, seed, sigma_rad, progress))]
#[allow(clippy::too_many_arguments)]
pub fn validate(
    py: Python<'_>,
    table: &HashTable,
    protocol: &str,
    recognizer: &str,
    samples: u64,
    seed: u64,
    sigma_rad: Option<f64>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<String> {
    let config = ValidationConfig {
        recognizer: recognizer.parse().or_raise()?,
        protocol: self::protocol(protocol, sigma_rad)?,
        seed,
        samples,
    };
    if samples == 0 {
        return Err(value_error("samples", "expected at least 1 trial, found 0"));
    }
    let view = config.protocol.view();
    let recognizer = NamedRecognizer::new(config.recognizer, &table.0, view).or_raise()?;
    let recognizer = Arc::new(recognizer);
    let mut results: Vec<TrialResult> = Vec::new();
    for first in (0..samples).step_by(TRIALS_AT_ONCE as usize) {
        let last = (first + TRIALS_AT_ONCE).min(samples);
        let (ball, recognizer) = (Arc::clone(&table.0), Arc::clone(&recognizer));
        let found = abandonable(py, move |stop| {
            let part = Trials {
                range: first..last,
                stop: Some(stop.flag()),
                ..config.trials(ball.pattern())
            };
            part.run(&*recognizer, &|_| {})
        })?;
        results.extend(found.or_raise()?);
        if let Some(progress) = &progress {
            progress.call1((last, samples))?;
        }
    }
    let found = config.summary(&table.0, &results);
    if found.validation.identity.trials == 0 {
        let problem = format!(
            "expected views that show enough dots, but all {samples} have fewer than the protocol needs"
        );
        return Err(value_error("pattern", problem));
    }
    to_json(&found)
}

/// Views of a protocol, from number `first` on.
#[pyfunction]
#[pyo3(signature = (table, protocol, seed, first, count, sigma_rad))]
pub fn trial_views<'py>(
    py: Python<'py>,
    table: &HashTable,
    protocol: &str,
    seed: u64,
    first: u64,
    count: u64,
    sigma_rad: Option<f64>,
) -> PyResult<Vec<View<'py>>> {
    let protocol = self::protocol(protocol, sigma_rad)?;
    let dots = table.0.pattern().dots();
    let mut generator = TrialGenerator::new(dots, *protocol.view(), seed);
    let mut trial = Trial::default();
    let mut views = Vec::new();
    for index in first..first + count {
        generator.generate(index, &mut trial);
        let directions: Vec<Vec3> = trial.dots.iter().map(|d| d.direction).collect();
        let covariances: Vec<_> = trial
            .dots
            .iter()
            .map(|dot| {
                let axes = Matrix3x2::from_columns(&tangent_frame(&dot.direction));
                let tangent = match dot.uncertainty {
                    DotUncertainty::Tangent { covariance } => covariance,
                    DotUncertainty::Isotropic { sigma_rad } => {
                        Matrix2::from_diagonal_element(sigma_rad * sigma_rad)
                    }
                };
                axes * tangent * axes.transpose()
            })
            .collect();
        views.push((
            rows(py, &directions),
            blocks3(py, &covariances),
            assignment(py, &trial.truth),
            quaternion(py, &trial.rotation),
            trial.real_dots(),
        ));
    }
    Ok(views)
}
