//! Spin from orientations.

use nalgebra::Matrix3;
use numpy::ndarray::{Array2, ArrayViewD, arr1};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use spindoe::Vec3;
use spindoe::geometry::{CameraFrame, to_wxyz, turned_covariance};
use spindoe::spin::alias::{AliasConfig, Alternative, SpinEvidence};
use spindoe::spin::clock::Clock;
use spindoe::spin::estimate::{FittedMotion, MotionModel, SpinEstimate};
use spindoe::spin::free::FreeFit;
use spindoe::spin::orientations::{OrientationRow, Orientations};
use spindoe::spin::quatera::{QuateraConfig, QuateraEstimator};
use spindoe::spin::robust::{MagnitudePrior, SpinConfig};
use spindoe::spin::shared::ViewTurn;
use spindoe::spin::summary::SpinSummary;
use spindoe::spin::{Fit, Measurement, SpinRejection};

use crate::arrays::{
    Numbers, block3, blocks3, matrix3, quaternion, require_orientations, require_shape,
    require_sides, rotation, square, vector,
};
use crate::errors::{Answer, OrRaise, spin_rejection, value_error};
use crate::work::abandonable;

/// A fit: reference time, spin, orientation then, covariance, noise, log-likelihood, inliers,
/// probabilities, aliases; frame; motion, rate of decay, rate fixed in the ball then, lack of fit, what was wrong with the times, a free motion
/// over time.
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
    &'static str,
    (
        &'static str,
        f64,
        Bound<'py, PyArray1<f64>>,
        Option<f64>,
        Vec<String>,
        Option<CurveTuple<'py>>,
    ),
);

/// A free motion over time: times, spins (n, 3), their covariances (n, 3, 3), orientations (n, 4); root mean square of the spin about its mean.
pub type CurveTuple<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray2<f64>>,
    f64,
);

/// A file of orientations for Python: quaternions (n, 4), covariances (n, 3, 3), NaN where there is none, and the turns of the view
/// frame (n, 12), where it turns, and the frame.
pub type Rows<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Option<Bound<'py, PyArray2<f64>>>,
    &'static str,
);

/// The orientations of a sequence for Python.
pub fn rows<'py>(py: Python<'py>, file: &Orientations) -> Rows<'py> {
    let missing = Matrix3::repeat(f64::NAN);
    let count = file.rows.len();
    let mut quaternions = Array2::from_elem((count, 4), f64::NAN);
    let mut turns = Array2::from_elem((count, ViewTurn::NUMBERS), f64::NAN);
    for (i, row) in file.rows.iter().enumerate() {
        if let Some(orientation) = &row.orientation {
            quaternions.row_mut(i).assign(&arr1(&to_wxyz(orientation)));
        }
        if let Some(turn) = &row.turn {
            turns.row_mut(i).assign(&arr1(&turn.numbers()));
        }
    }
    let covariances: Vec<_> = file
        .rows
        .iter()
        .map(|r| r.covariance.unwrap_or(missing))
        .collect();
    let turned = file.rows.iter().any(|row| row.turn.is_some());
    (
        quaternions.into_pyarray(py),
        blocks3(py, &covariances),
        turned.then(|| turns.into_pyarray(py)),
        file.camera_frame.unwrap_or_default().as_str(),
    )
}

/// The covariance of row `i`.
pub fn covariance(rows: &ArrayViewD<'_, f64>, i: usize) -> PyResult<Matrix3<f64>> {
    let covariance = block3(rows, i);
    let is_one = covariance.iter().all(|x| x.is_finite())
        && (covariance - covariance.transpose()).amax() <= 1e-9 * covariance.amax()
        && covariance.symmetric_eigenvalues().min() >= -1e-6 * covariance.trace().abs();
    if !is_one {
        let problem = format!("row {i}: expected a symmetric matrix without negative eigenvalues");
        return Err(value_error("covariances_rad2", problem));
    }
    Ok(covariance)
}

/// The turn of row `i`.
fn view_turn(rows: &ArrayViewD<'_, f64>, i: usize) -> PyResult<ViewTurn> {
    let numbers: [f64; ViewTurn::NUMBERS] = std::array::from_fn(|k| rows[[i, k]]);
    if !numbers.iter().all(|x| x.is_finite()) {
        let problem = format!("row {i}: expected finite numbers");
        return Err(value_error("view_turns_rad", problem));
    }
    Ok(ViewTurn::of_numbers(&numbers))
}

/// A spin with its aliases, and how probable it is that each measurement follows it.
pub struct Estimated {
    estimate: SpinEstimate,
    summary: SpinSummary,
    probabilities: Vec<f64>,
}

impl Estimated {
    /// Of an estimate, whose spin is that at `at_s`, by default what sums it up; its aliases are searched for in `measurements`, and
    /// weighed by further evidence.
    fn new(
        estimate: SpinEstimate,
        at_s: Option<f64>,
        measurements: &[Measurement],
        config: &SpinConfig,
        evidence: Option<&dyn SpinEvidence>,
    ) -> Self {
        let listed = AliasConfig::of(config);
        let summary = estimate.summary(measurements, at_s, &listed, measurements.len());
        Self {
            summary: match evidence {
                Some(evidence) => summary.weighed(evidence, &listed),
                None => summary,
            },
            probabilities: estimate.inlier_probabilities(measurements),
            estimate,
        }
    }

    /// That of a sequence: from what the command writes to its file of orientations, and from what else its frames say, as the
    /// command does.
    pub fn of_sequence(
        orientations: &Orientations,
        config: SpinConfig,
        evidence: Option<&dyn SpinEvidence>,
    ) -> Result<Self, SpinRejection> {
        let measurements = orientations.measurements();
        let config = orientations.spin_config(config);
        let model = MotionModel::Auto;
        let estimate = match evidence {
            Some(evidence) => SpinEstimate::fit_with(&measurements, model, &config, evidence),
            None => SpinEstimate::fit(&measurements, model, &config),
        };
        Ok(Self::new(estimate?, None, &measurements, &config, evidence))
    }

    /// For Python.
    fn tuple<'py>(&self, py: Python<'py>, frame: CameraFrame) -> Found<'py> {
        to_tuple(
            py,
            &self.summary.fit,
            &self.estimate.motion,
            frame,
            &self.probabilities,
            &self.summary.alternatives,
            &self.estimate.clock,
        )
    }

    /// For Python, or why there is none.
    pub fn answer<'py>(
        found: Result<Self, SpinRejection>,
        py: Python<'py>,
        frame: CameraFrame,
    ) -> PyResult<Answer<Found<'py>>> {
        match found {
            Ok(found) => Ok(Answer::Found(found.tuple(py, frame))),
            Err(rejection) => Ok(Answer::Rejected(spin_rejection(rejection)?)),
        }
    }
}

/// An estimate for Python, whose spin is that at `at_s`, by default what sums it up; its aliases are searched for in `measurements`.
fn estimate_tuple<'py>(
    py: Python<'py>,
    estimate: &SpinEstimate,
    at_s: Option<f64>,
    measurements: &[Measurement],
    frame: CameraFrame,
    config: &SpinConfig,
) -> PyResult<Found<'py>> {
    let [from, to] = estimate.span_s();
    if let Some(at) = at_s.filter(|at| !(from..=to).contains(at)) {
        let problem =
            format!("expected a time within the orientations' {from} to {to} s, found {at}");
        return Err(value_error("at_s", problem));
    }
    let (owned, measured, config) = (estimate.clone(), measurements.to_vec(), *config);
    let found = abandonable(py, move |_| {
        Estimated::new(owned, at_s, &measured, &config, None)
    })?;
    Ok(found.tuple(py, frame))
}

/// A fit for Python, of this motion.
fn to_tuple<'py>(
    py: Python<'py>,
    fit: &Fit,
    motion: &FittedMotion,
    frame: CameraFrame,
    probabilities: &[f64],
    aliases: &[Alternative],
    clock: &Clock,
) -> Found<'py> {
    (
        fit.motion.time_s,
        vector(py, &fit.motion.spin),
        quaternion(py, &fit.motion.orientation),
        fit.spin_covariance.map(|c| square(py, &c)),
        fit.sigma_rad,
        fit.log_likelihood,
        fit.inliers,
        PyArray1::from_slice(py, probabilities),
        aliases
            .iter()
            .map(|a| (vector(py, &a.spin), a.log_likelihood_ratio))
            .collect(),
        frame.as_str(),
        (
            motion.model().as_str(),
            motion.decay_per_s(),
            vector(py, &motion.body_rate(fit.motion.time_s)),
            fit.lack_of_fit,
            clock.words(),
            match motion {
                FittedMotion::Free(free) => Some(curve_tuple(py, free)),
                _ => None,
            },
        ),
    )
}

/// A free motion over time.
fn curve_tuple<'py>(py: Python<'py>, free: &FreeFit) -> CurveTuple<'py> {
    let knots = &free.knots;
    let mut spins = Array2::zeros((knots.len(), 3));
    let mut quaternions = Array2::zeros((knots.len(), 4));
    for (i, knot) in knots.iter().enumerate() {
        spins.row_mut(i).assign(&arr1(knot.spin.as_slice()));
        quaternions
            .row_mut(i)
            .assign(&arr1(&to_wxyz(&knot.orientation)));
    }
    let times: Vec<f64> = knots.iter().map(|k| k.time_s).collect();
    let covariances: Vec<_> = knots.iter().map(|k| k.spin_covariance).collect();
    (
        PyArray1::from_vec(py, times),
        spins.into_pyarray(py),
        blocks3(py, &covariances),
        quaternions.into_pyarray(py),
        free.spread_rad_s(),
    )
}

/// A frame by name.
fn camera_frame(name: &str) -> PyResult<CameraFrame> {
    name.parse().or_raise()
}

/// An orientation, vectors and their covariances in other axes of their frame: that frame's name, and all of them.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub fn in_axes<'py>(
    py: Python<'py>,
    frame: &str,
    axes: &str,
    wxyz: [f64; 4],
    vectors: Vec<[f64; 3]>,
    covariance: Option<Numbers<'py>>,
) -> PyResult<(
    &'static str,
    Bound<'py, PyArray1<f64>>,
    Vec<Bound<'py, PyArray1<f64>>>,
    Option<Bound<'py, PyArray2<f64>>>,
)> {
    let Some(axes) = CameraFrame::AXES
        .into_iter()
        .find(|one| one.as_str() == axes)
    else {
        let problem = format!("expected camera or optical, found {axes:?}");
        return Err(value_error("frame", problem));
    };
    let (frame, turn) = camera_frame(frame)?.in_axes(axes);
    let covariance = covariance.map(|c| matrix3("covariance", &c)).transpose()?;
    Ok((
        frame.as_str(),
        quaternion(py, &(turn * rotation("quaternion_wxyz", wxyz)?)),
        vectors
            .iter()
            .map(|v| vector(py, &(turn * Vec3::from(*v))))
            .collect(),
        covariance.map(|c| square(py, &turned_covariance(&turn, &c))),
    ))
}

/// The spin of a stream, by its window: without aliases, whose search is no work for every frame.
pub fn of_stream<'py>(
    py: Python<'py>,
    fitted: Result<(Fit, Clock), SpinRejection>,
    frame: CameraFrame,
) -> Answer<Found<'py>> {
    match fitted {
        Ok((fit, clock)) => {
            let constant = FittedMotion::Constant(fit);
            Answer::Found(to_tuple(py, &fit, &constant, frame, &[], &[], &clock))
        }
        Err(rejection) => Answer::Rejected(rejection.to_string()),
    }
}

/// Time-stamped orientations, by Python's keywords. Rows of NaN are frames without an orientation; the other columns are then not read.
/// The residuals show each frame's noise and the errors that frames share, covariances and turns of the view frame more exactly, as in
/// a file of orientations.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct GivenRows<'py> {
    times_s: Numbers<'py>,
    quaternions: Numbers<'py>,
    #[pyo3(default)]
    confidences: Option<Numbers<'py>>,
    #[pyo3(default)]
    residuals_rad: Option<Numbers<'py>>,
    #[pyo3(default)]
    matched: Option<PyReadonlyArrayDyn<'py, i64>>,
    #[pyo3(default)]
    covariances_rad2: Option<Numbers<'py>>,
    #[pyo3(default)]
    view_turns_rad: Option<Numbers<'py>>,
}

impl GivenRows<'_> {
    /// The number of rows.
    fn check(&self) -> PyResult<usize> {
        let count = require_orientations("quaternions", &self.times_s, &self.quaternions)?;
        let rows = Some(count);
        if let Some(confidences) = &self.confidences {
            require_shape("confidences", confidences, &[rows])?;
        }
        // Their numbers are those of rows with an orientation.
        if let Some(covariances) = &self.covariances_rad2 {
            require_sides("covariances_rad2", covariances, &[rows, Some(3), Some(3)])?;
        }
        if let Some(turns) = &self.view_turns_rad {
            require_sides("view_turns_rad", turns, &[rows, Some(ViewTurn::NUMBERS)])?;
        }
        let residuals = self.residuals_rad.as_ref().map(|r| r.shape());
        let matched = self.matched.as_ref().map(|m| m.shape());
        for (name, shape) in [("residuals_rad", residuals), ("matched", matched)] {
            if let Some(shape) = shape.filter(|shape| *shape != [count]) {
                let problem = format!("expected shape ({count},), found {shape:?}");
                return Err(value_error(name, problem));
            }
        }
        Ok(count)
    }

    /// As a file of orientations has them.
    fn read(&self) -> PyResult<Orientations> {
        let count = self.check()?;
        let (times, quaternions) = (self.times_s.as_array(), self.quaternions.as_array());
        let confidences = self.confidences.as_ref().map(|c| c.as_array());
        let residuals = self.residuals_rad.as_ref().map(|r| r.as_array());
        let matched = self.matched.as_ref().map(|m| m.as_array());
        let covariances = self.covariances_rad2.as_ref().map(|c| c.as_array());
        let turns = self.view_turns_rad.as_ref().map(|t| t.as_array());
        let mut file = Orientations::default();
        for i in 0..count {
            let wxyz = [0, 1, 2, 3].map(|k| quaternions[[i, k]]);
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
                let problem = format!("row {i}: expected 0 or more, found less");
                value_error("matched", problem)
            })?;
            file.rows.push(OrientationRow {
                time_s: times[i],
                orientation: Some(rotation(&format!("quaternions: row {i}"), wxyz)?),
                matched,
                residual_rad,
                confidence: confidences.as_ref().map(|c| c[i]),
                covariance: covariances.as_ref().map(|c| covariance(c, i)).transpose()?,
                turn: turns.as_ref().map(|t| view_turn(t, i)).transpose()?,
                ..OrientationRow::default()
            });
        }
        Ok(file)
    }
}

/// What is asked of a spin, by Python's keywords.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct AskedSpin {
    frame: String,
    method: String,
    model: String,
    at_s: Option<f64>,
    max_rps: f64,
    sigma_rad: f64,
    #[pyo3(default)]
    prior_rps: Option<(f64, f64)>,
    /// Frames of a run, iterations, threshold and joining of the paper's method.
    #[pyo3(default)]
    quatera: Option<(usize, usize, f64, usize)>,
}

impl AskedSpin {
    fn config(&self, file: &Orientations) -> SpinConfig {
        file.spin_config(SpinConfig {
            max_rps: self.max_rps,
            sigma_rad: self.sigma_rad,
            prior: self
                .prior_rps
                .map(|(rps, std_rps)| MagnitudePrior { rps, std_rps }),
            ..SpinConfig::default()
        })
    }

    fn quatera(&self) -> QuateraConfig {
        let defaults = QuateraConfig {
            max_rps: self.max_rps,
            ..QuateraConfig::default()
        };
        match self.quatera {
            None => defaults,
            Some((run, iterations, threshold, joining)) => QuateraConfig {
                run,
                iterations,
                threshold,
                joining,
                ..defaults
            },
        }
    }
}

/// The spin of time-stamped orientations, or the reason why there is none.
#[pyfunction]
pub fn fit_spin<'py>(
    py: Python<'py>,
    rows: GivenRows<'py>,
    asked: AskedSpin,
) -> PyResult<Answer<Found<'py>>> {
    let file = rows.read()?;
    let measurements = file.measurements();
    let config = asked.config(&file);
    let frame = camera_frame(&asked.frame)?;
    let model: MotionModel = asked.model.parse().or_raise()?;
    let measured = measurements.clone();
    // Of the paper's method those that its plane of the quaternions holds.
    let (fitted, members) = match asked.method.as_str() {
        "robust" => {
            let fit = move |_| SpinEstimate::fit(&measured, model, &config);
            (abandonable(py, fit)?, None)
        }
        "quatera" => {
            if !matches!(model, MotionModel::Auto | MotionModel::Constant) {
                let problem = format!("expected constant with the method quatera, found {model}");
                return Err(value_error("model", problem));
            }
            let mut estimator = QuateraEstimator::new(asked.quatera());
            abandonable(py, move |_| {
                let found = estimator.fit(&measured);
                let members = estimator.inliers().iter();
                let members: Vec<f64> = members.map(|&is| f64::from(u8::from(is))).collect();
                let found = found.map(|fit| SpinEstimate::of_constant(fit, &measured));
                (found, Some(members))
            })?
        }
        other => {
            let problem = format!("expected robust or quatera, found {other:?}");
            return Err(value_error("method", problem));
        }
    };
    let estimate = match fitted {
        Ok(estimate) => estimate,
        Err(rejection) => return Ok(Answer::Rejected(spin_rejection(rejection)?)),
    };
    let mut found = estimate_tuple(py, &estimate, asked.at_s, &measurements, frame, &config)?;
    if let Some(members) = members {
        found.7 = PyArray1::from_vec(py, members);
    }
    Ok(Answer::Found(found))
}
