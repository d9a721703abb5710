//! Spin from orientations.

use numpy::{PyArray1, PyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use spindoe::spin::alias::{AliasConfig, alternatives};
use spindoe::spin::orientations::{OrientationRow, Orientations};
use spindoe::spin::quatera::{QuateraConfig, QuateraEstimator};
use spindoe::spin::robust::{MagnitudePrior, RobustEstimator, SpinConfig};
use spindoe::spin::{Fit, Measurement};

use crate::arrays::{Numbers, quaternion, require_shape, rotation, square, vector};
use crate::errors::{Answer, spin_rejection, value_error};

/// Aliases are listed up to this multiple of the largest spin searched, as the command lists them.
const LISTED_BEYOND: f64 = 2.0;

/// A fit: reference time, spin, orientation then, covariance, noise, log-likelihood, inliers,
/// probabilities, aliases.
pub type Found<'py> = (
    f64,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Option<Bound<'py, PyArray2<f64>>>,
    Option<f64>,
    Option<f64>,
    usize,
    Bound<'py, PyArray1<f64>>,
    Vec<(Bound<'py, PyArray1<f64>>, f64)>,
);

/// A fit for Python.
pub fn to_tuple<'py>(
    py: Python<'py>,
    fit: &Fit,
    measurements: &[Measurement],
    probabilities: &[f64],
    config: &SpinConfig,
) -> Found<'py> {
    let listed = AliasConfig {
        max_rps: LISTED_BEYOND * config.max_rps,
        sigma_rad: config.sigma_rad,
        ..AliasConfig::default()
    };
    let others = py.detach(|| alternatives(measurements, fit, &listed));
    (
        fit.motion.time_s,
        vector(py, &fit.motion.spin),
        quaternion(py, &fit.motion.orientation),
        fit.spin_covariance.map(|c| square(py, &c)),
        fit.sigma_rad,
        fit.log_likelihood,
        fit.inliers,
        PyArray1::from_slice(py, probabilities),
        others
            .iter()
            .map(|a| (vector(py, &a.spin), a.log_likelihood_ratio))
            .collect(),
    )
}

/// The spin of time-stamped orientations, or the reason why there is none. Rows of NaN are frames
/// without an orientation; the other columns are then not read. The residuals tell of each frame's
/// noise and of the errors that frames share, as in a file of orientations.
#[pyfunction]
#[pyo3(signature = (
    times_s, quaternions, confidences, residuals_rad, matched, method, max_rps, sigma_rad, prior,
    quatera
))]
#[allow(clippy::too_many_arguments)]
pub fn fit_spin<'py>(
    py: Python<'py>,
    times_s: Numbers<'py>,
    quaternions: PyReadonlyArrayDyn<'py, f64>,
    confidences: Option<Numbers<'py>>,
    residuals_rad: Option<PyReadonlyArrayDyn<'py, f64>>,
    matched: Option<PyReadonlyArrayDyn<'py, i64>>,
    method: &str,
    max_rps: f64,
    sigma_rad: f64,
    prior: Option<(f64, f64)>,
    quatera: Option<(usize, usize, f64, usize)>,
) -> PyResult<Answer<Found<'py>>> {
    require_shape("times_s", &times_s, &[None])?;
    let count = times_s.shape()[0];
    if quaternions.shape() != [count, 4] {
        let problem = format!(
            "expected shape ({count}, 4), found {:?}",
            quaternions.shape()
        );
        return Err(value_error("quaternions", problem));
    }
    if let Some(confidences) = &confidences {
        require_shape("confidences", confidences, &[Some(count)])?;
    }
    let (times, rows) = (times_s.as_array(), quaternions.as_array());
    let confidences = confidences.as_ref().map(|c| c.as_array());
    let residuals = residuals_rad.as_ref().map(|r| r.as_array());
    let matched = matched.as_ref().map(|m| m.as_array());
    let lengths = [
        ("residuals_rad", residuals.as_ref().map(|r| r.shape())),
        ("matched", matched.as_ref().map(|m| m.shape())),
    ];
    for (name, shape) in lengths {
        if let Some(shape) = shape.filter(|shape| *shape != [count]) {
            let problem = format!("expected shape ({count},), found {shape:?}");
            return Err(value_error(name, problem));
        }
    }
    let mut file = Orientations::default();
    for i in 0..count {
        let wxyz = [0, 1, 2, 3].map(|k| rows[[i, k]]);
        if wxyz.iter().all(|x| x.is_nan()) {
            continue;
        }
        let residual_rad = residuals.as_ref().map(|r| r[i]);
        if let Some(residual) = residual_rad.filter(|r| !(*r >= 0.0 && r.is_finite())) {
            let problem = format!("row {i}: expected an angle of 0 or more, found {residual}");
            return Err(value_error("residuals_rad", problem));
        }
        let matched = matched.as_ref().map(|m| usize::try_from(m[i]));
        let matched = matched.transpose().map_err(|_| {
            value_error(
                "matched",
                format!("row {i}: expected 0 or more, found less"),
            )
        })?;
        file.rows.push(OrientationRow {
            frame: String::new(),
            time_s: times[i],
            orientation: Some(rotation(&format!("quaternions: row {i}"), wxyz)?),
            dots: None,
            matched,
            residual_rad,
            confidence: confidences.as_ref().map(|c| c[i]),
            covariance: None,
            turn: None,
        });
    }
    let measurements = file.measurements();
    let config = SpinConfig {
        max_rps,
        sigma_rad,
        prior: prior.map(|(rps, std_rps)| MagnitudePrior { rps, std_rps }),
        shared: file.shared_error(),
        ..SpinConfig::default()
    };
    let fitted = match method {
        "robust" => {
            let mut estimator = RobustEstimator::new(config);
            py.detach(|| estimator.fit(&measurements))
                .map(|fit| (fit, estimator.inlier_probabilities().to_vec()))
        }
        "quatera" => {
            let defaults = QuateraConfig::default();
            let (run, iterations, threshold, joining) = quatera.unwrap_or((
                defaults.run,
                defaults.iterations,
                defaults.threshold,
                defaults.joining,
            ));
            let mut estimator = QuateraEstimator::new(QuateraConfig {
                run,
                iterations,
                threshold,
                joining,
                max_rps,
                ..defaults
            });
            py.detach(|| estimator.fit(&measurements)).map(|fit| {
                let inliers = estimator
                    .inliers()
                    .iter()
                    .map(|&is| f64::from(u8::from(is)));
                (fit, inliers.collect())
            })
        }
        other => {
            let problem = format!("expected robust or quatera, found {other:?}");
            return Err(value_error("method", problem));
        }
    };
    match fitted {
        Ok((fit, probabilities)) => {
            let found = to_tuple(py, &fit, &measurements, &probabilities, &config);
            Ok(Answer::Found(found))
        }
        Err(rejection) => Ok(Answer::Rejected(spin_rejection(rejection)?)),
    }
}
