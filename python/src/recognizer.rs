//! Recognizers: one view at a time, or many on all cores.

use std::sync::{Mutex, PoisonError};

use nalgebra::{Matrix3, Matrix3x2};
use numpy::ndarray::{Array1, Array2, ArrayViewD};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use spindoe::geometry::{tangent_frame, to_wxyz};
use spindoe::pattern::{LENGTH_ROUNDING, LENGTH_TOLERANCE};
use spindoe::recognize::observed::{MAX_FRAME_DOTS, from_image_covariance};
use spindoe::recognize::paper::{PaperWorkspace, VoteSum};
use spindoe::recognize::robust::RobustWorkspace;
use spindoe::recognize::{PaperConfig, PaperRecognizer, RecognizerRejection};
use spindoe::view::{Detection, FalseDots, Noise, NoiseShape};
use spindoe::{
    DotUncertainty, Explanations, Hint, Identification, ObservedDot, ProtocolName, Recognizer as _,
    RobustConfig, RobustRecognizer, StopFlag, Vec3, ViewModel,
};

use crate::arrays::{
    Numbers, assignment, block2, block3, matrix3, quaternion, require_shape, rotation,
};
use crate::errors::{Answer, OrRaise, value_error};
use crate::pattern::{HashTable, overlay, to_json};
use crate::work::interruptible;

/// Frames that one task identifies at least.
const FRAMES_AT_ONCE: usize = 16;
/// Dots up to which a frame is identified on this thread, within a few milliseconds, without an ear for Ctrl-C.
const FAST_DOTS: usize = 64;

/// An identification: quaternion, assignment, residual, confidences, rivals.
type Found<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    f64,
    f64,
    f64,
    Vec<(Bound<'py, PyArray1<f64>>, f64)>,
);

/// Columns of a batch, and the reasons of the frames without an answer.
type Columns<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyDict>,
);

/// Why a view has no answer.
#[derive(Clone, Copy)]
enum NoAnswer {
    Rejected(RecognizerRejection),
    /// With the probability of the best pose.
    Ambiguous(f64),
}

impl std::fmt::Display for NoAnswer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Rejected(rejection) => rejection.fmt(f),
            Self::Ambiguous(p) => {
                write!(f, "ambiguous: the best pose has a probability of {p:.2}")
            }
        }
    }
}

/// The robust recognizer's settings under the names of Python's arguments.
#[derive(Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
struct Settings {
    visibility_limit: f64,
    detection_probability: f64,
    expected_false_dots: f64,
    usual_false_dots: Option<u16>,
    foreign_share: f64,
    noise: NoiseShape,
    passes: usize,
    mirror_doubt: f64,
}

impl Settings {
    /// Those of a configuration, for a pattern of so many dots.
    fn of(config: &RobustConfig, dots: usize) -> Self {
        let RobustConfig {
            view,
            passes,
            mirror_doubt,
            ..
        } = config;
        Self {
            visibility_limit: view.visibility_limit,
            detection_probability: view.detection_rate(dots),
            expected_false_dots: view.false_dots.mean(),
            usual_false_dots: view.false_dots.usual(),
            foreign_share: view.foreign_share,
            noise: view.noise.shape(),
            passes: *passes,
            mirror_doubt: *mirror_doubt,
        }
    }

    /// The configuration that has them in place of `before`, which were those of `base`.
    fn in_place_of(self, before: &Self, base: &RobustConfig) -> RobustConfig {
        let mut view = base.view;
        view.visibility_limit = self.visibility_limit;
        if self.detection_probability != before.detection_probability {
            let probability = self.detection_probability;
            view.detection = Detection::Each { probability };
        }
        let is_new_number = self.usual_false_dots != before.usual_false_dots;
        let is_new_mean = self.expected_false_dots != before.expected_false_dots;
        view.false_dots = match self.usual_false_dots {
            Some(usual) if is_new_number => FalseDots::Usual(usual),
            _ if is_new_number || is_new_mean => FalseDots::Poisson(self.expected_false_dots),
            _ => view.false_dots,
        };
        view.foreign_share = self.foreign_share;
        if self.noise != before.noise {
            view.noise = Noise::of_shape(self.noise, view.noise.tangent_sigma_rad());
        }
        RobustConfig {
            view,
            passes: self.passes,
            mirror_doubt: self.mirror_doubt,
            ..*base
        }
    }
}

enum Kind {
    Robust(Box<RobustRecognizer>),
    Paper(Box<PaperRecognizer>),
}

#[derive(Default)]
struct Workspace {
    robust: RobustWorkspace,
    paper: PaperWorkspace,
    dots: Vec<ObservedDot>,
}

#[pyclass(frozen, module = "spindoe._native")]
pub struct Recognizer {
    kind: Kind,
    /// Of dots for which nothing is given, along one tangent axis.
    sigma_rad: f64,
    /// Less probable orientations are no answers.
    min_confidence: f64,
    /// One for each call at the same time.
    workspaces: Mutex<Vec<Workspace>>,
}

/// The uncertainty of dots, as given.
struct Uncertainty<'a> {
    default_rad: f64,
    sigmas: Option<ArrayViewD<'a, f64>>,
    covariances: Option<ArrayViewD<'a, f64>>,
}

impl Uncertainty<'_> {
    fn of(&self, k: usize, direction: &Vec3) -> Result<DotUncertainty, String> {
        if let Some(covariances) = &self.covariances {
            let uncertainty = match covariances.shape()[1] {
                2 => from_image_covariance(direction, &block2(covariances, k)),
                _ => {
                    let axes = Matrix3x2::from_columns(&tangent_frame(direction));
                    DotUncertainty::Tangent {
                        covariance: axes.transpose() * block3(covariances, k) * axes,
                    }
                }
            };
            let DotUncertainty::Tangent { covariance: c } = &uncertainty else {
                return Ok(uncertainty);
            };
            let definite = c[(0, 0)] > 0.0 && c.determinant() > 0.0;
            return if definite {
                Ok(uncertainty)
            } else {
                Err(format!(
                    "row {k}: expected a positive definite covariance, rad^2"
                ))
            };
        }
        let sigma_rad = match &self.sigmas {
            None => self.default_rad,
            Some(one) if one.ndim() == 0 => one.sum(),
            Some(many) => many[k],
        };
        if sigma_rad > 0.0 {
            return Ok(DotUncertainty::Isotropic { sigma_rad });
        }
        Err(format!(
            "row {k}: expected a positive angle, found {sigma_rad}"
        ))
    }
}

/// A dot of the row `k`, checked as the command checks its files.
fn dot(k: usize, x: f64, y: f64, z: f64) -> PyResult<Vec3> {
    let mut direction = Vec3::new(x, y, z);
    let length = direction.norm();
    if (length - 1.0).abs() > LENGTH_TOLERANCE {
        let problem = format!("row {k}: expected a unit vector, found one of length {length:.6}");
        return Err(value_error("dots", problem));
    }
    if (length - 1.0).abs() > LENGTH_ROUNDING {
        direction /= length;
    }
    Ok(direction)
}

/// Rejects more dots than a frame may have.
fn check_dots(name: &str, count: usize) -> PyResult<()> {
    match count {
        0..=MAX_FRAME_DOTS => Ok(()),
        _ => {
            let problem =
                format!("expected at most {MAX_FRAME_DOTS} dots in a frame, found {count}");
            Err(value_error(name, problem))
        }
    }
}

/// Reads the dots and their uncertainties.
fn observed(
    dots: &Numbers<'_>,
    sigmas: Option<&Numbers<'_>>,
    covariances: Option<&Numbers<'_>>,
    default_rad: f64,
    of_one_frame: bool,
    into: &mut Vec<ObservedDot>,
) -> PyResult<()> {
    require_shape("dots", dots, &[None, Some(3)])?;
    let count = dots.shape()[0];
    if of_one_frame {
        check_dots("dots", count)?;
    }
    if let Some(sigmas) = sigmas
        && !sigmas.shape().is_empty()
    {
        require_shape("sigma_rad", sigmas, &[Some(count)])?;
    }
    if let Some(covariances) = covariances {
        if sigmas.is_some() {
            return Err(value_error(
                "covariances",
                "expected them or sigma_rad, found both",
            ));
        }
        let side = if covariances.shape().last() == Some(&3) {
            3
        } else {
            2
        };
        require_shape(
            "covariances",
            covariances,
            &[Some(count), Some(side), Some(side)],
        )?;
    }
    let uncertainty = Uncertainty {
        default_rad,
        sigmas: sigmas.map(|s| s.as_array()),
        covariances: covariances.map(|c| c.as_array()),
    };
    let of = if covariances.is_some() {
        "covariances"
    } else {
        "sigma_rad"
    };
    into.clear();
    for (k, row) in dots.as_array().rows().into_iter().enumerate() {
        let direction = dot(k, row[0], row[1], row[2])?;
        let uncertainty = uncertainty
            .of(k, &direction)
            .map_err(|e| value_error(of, e))?;
        into.push(ObservedDot {
            direction,
            uncertainty,
        });
    }
    Ok(())
}

/// A hint as given from Python: quaternion `w, x, y, z`, covariance, probability that it is wrong.
pub type GivenHint<'py> = ([f64; 4], Numbers<'py>, f64);

/// Checks a hint.
pub fn hint(given: GivenHint<'_>) -> PyResult<Hint> {
    let (wxyz, covariance, wrong) = given;
    let covariance: Matrix3<f64> = matrix3("hint.covariance", &covariance)?;
    let symmetric = 0.5 * (covariance + covariance.transpose());
    if symmetric.cholesky().is_none() {
        return Err(value_error(
            "hint.covariance",
            "expected a positive definite matrix, rad^2",
        ));
    }
    if !(wrong > 0.0 && wrong < 1.0) {
        let problem = format!("expected a probability in (0, 1), found {wrong}");
        return Err(value_error("hint.wrong", problem));
    }
    Ok(Hint {
        rotation: rotation("hint.quaternion_wxyz", wxyz)?,
        covariance,
        wrong,
    })
}

impl Recognizer {
    fn new(
        table: &HashTable,
        kind: Kind,
        sigma_rad: Option<f64>,
        min_confidence: f64,
    ) -> PyResult<Self> {
        if !(0.0..=1.0).contains(&min_confidence) {
            let problem = format!("expected 0 to 1, found {min_confidence}");
            return Err(value_error("min_confidence", problem));
        }
        let sigma_rad = match sigma_rad {
            None => table.0.recognizer().sigma_rad / 3f64.sqrt(),
            Some(sigma) if sigma > 0.0 && sigma.is_finite() => sigma,
            Some(sigma) => {
                let problem = format!("expected a positive angle, found {sigma}");
                return Err(value_error("sigma_rad", problem));
            }
        };
        Ok(Self {
            kind,
            sigma_rad,
            min_confidence,
            workspaces: Mutex::new(Vec::new()),
        })
    }

    /// Identifies the dots in `ws`.
    fn run<'w>(
        &self,
        hint: Option<&Hint>,
        ws: &'w mut Workspace,
    ) -> Result<&'w Explanations, NoAnswer> {
        let found = self.recognize(hint, ws).map_err(NoAnswer::Rejected)?;
        match found.best().confidence {
            p if p < self.min_confidence => Err(NoAnswer::Ambiguous(p)),
            _ => Ok(found),
        }
    }

    fn recognize<'w>(
        &self,
        hint: Option<&Hint>,
        ws: &'w mut Workspace,
    ) -> Result<&'w Explanations, RecognizerRejection> {
        let Workspace {
            robust,
            paper,
            dots,
        } = ws;
        match &self.kind {
            Kind::Robust(recognizer) => recognizer.explain(dots, hint, robust),
            Kind::Paper(recognizer) => recognizer.explain(dots, hint, paper),
        }
    }

    fn workspace(&self) -> Workspace {
        let mut kept = self
            .workspaces
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        kept.pop().unwrap_or_default()
    }

    fn keep(&self, workspace: Workspace) {
        self.workspaces
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(workspace);
    }
}

/// An answer with at most so many other poses that are at least so probable.
fn answer<'py>(
    py: Python<'py>,
    (max_rivals, min_confidence): (usize, f64),
    explanations: &Explanations,
) -> Found<'py> {
    let best = explanations.best();
    let rivals = explanations.rivals().iter().take(max_rivals);
    let rivals = rivals.take_while(|r| r.confidence >= min_confidence);
    (
        quaternion(py, &best.rotation),
        assignment(py, &best.assignment),
        best.residual_rad,
        best.dots_confidence,
        best.confidence,
        rivals
            .map(|r| (quaternion(py, &r.rotation), r.confidence))
            .collect(),
    )
}

#[pymethods]
impl Recognizer {
    /// The robust recognizer, with the rates of a protocol or the defaults, and settings in place of
    /// theirs.
    #[staticmethod]
    fn robust(
        table: &HashTable,
        expect: Option<&str>,
        settings: &str,
        sigma_rad: Option<f64>,
        min_confidence: f64,
    ) -> PyResult<Self> {
        let view = match expect {
            Some(name) => name.parse::<ProtocolName>().or_raise()?.view(),
            None => {
                let limit = table.0.recognizer().visibility_limit;
                ViewModel {
                    visibility_limit: limit,
                    false_dot_limit: limit,
                    ..ViewModel::default()
                }
            }
        };
        let base = RobustConfig::from(view);
        let defaults = Settings::of(&base, table.0.pattern().len());
        let config = overlay(&defaults, settings)?.in_place_of(&defaults, &base);
        let recognizer = RobustRecognizer::for_ball(&table.0, config).or_raise()?;
        let kind = Kind::Robust(Box::new(recognizer));
        Self::new(table, kind, sigma_rad, min_confidence)
    }

    /// The paper's recognizer; what is not given comes from the table.
    #[staticmethod]
    #[pyo3(signature = (
        table, k, kappa, beta, alpha, verify_fraction, vote_sum, sigma_rad, min_confidence
    ))]
    #[allow(clippy::too_many_arguments)]
    fn paper(
        table: &HashTable,
        k: Option<usize>,
        kappa: Option<f64>,
        beta: Option<f64>,
        alpha: Option<f64>,
        verify_fraction: Option<f64>,
        vote_sum: Option<&str>,
        sigma_rad: Option<f64>,
        min_confidence: f64,
    ) -> PyResult<Self> {
        let of_table = *table.0.recognizer();
        let config = PaperConfig {
            k: k.unwrap_or(of_table.k),
            kappa: kappa.unwrap_or(of_table.kappa),
            beta: beta.unwrap_or(of_table.beta),
            alpha: alpha.unwrap_or(of_table.alpha),
            verify_fraction: verify_fraction.unwrap_or(of_table.verify_fraction),
            vote_sum: match vote_sum {
                None => of_table.vote_sum,
                Some("log-density") => VoteSum::LogDensity,
                Some("density") => VoteSum::Density,
                Some(other) => {
                    let problem = format!("expected log-density or density, found {other:?}");
                    return Err(value_error("vote_sum", problem));
                }
            },
            ..of_table
        };
        let recognizer = PaperRecognizer::for_ball(&table.0);
        let recognizer = recognizer.and_then(|paper| paper.with_config(config));
        let kind = Kind::Paper(Box::new(recognizer.or_raise()?));
        Self::new(table, kind, sigma_rad, min_confidence)
    }

    /// The settings in use, as JSON; empty for the paper's.
    fn settings(&self) -> PyResult<String> {
        match &self.kind {
            Kind::Robust(recognizer) => {
                let dots = recognizer.dots().len();
                to_json(&Settings::of(recognizer.config(), dots))
            }
            Kind::Paper(_) => Ok("{}".to_owned()),
        }
    }

    fn sigma_rad(&self) -> f64 {
        self.sigma_rad
    }

    /// One view: the answer, or the reason why there is none.
    #[pyo3(signature = (dots, sigma_rad, covariances, hint, max_rivals, min_rival_confidence))]
    #[allow(clippy::too_many_arguments)]
    fn identify<'py>(
        &self,
        py: Python<'py>,
        dots: Numbers<'py>,
        sigma_rad: Option<Numbers<'py>>,
        covariances: Option<Numbers<'py>>,
        hint: Option<GivenHint<'py>>,
        max_rivals: usize,
        min_rival_confidence: f64,
    ) -> PyResult<Answer<Found<'py>>> {
        let hint = hint.map(self::hint).transpose()?;
        if hint.is_some() && matches!(self.kind, Kind::Paper(_)) {
            return Err(value_error("hint", "the paper's recognizer takes none"));
        }
        let mut ws = self.workspace();
        let (sigmas, covariances) = (sigma_rad.as_ref(), covariances.as_ref());
        let default_rad = self.sigma_rad;
        observed(&dots, sigmas, covariances, default_rad, true, &mut ws.dots)?;
        let rivals = (max_rivals, min_rival_confidence);
        let is_fast = ws.dots.len() <= FAST_DOTS;
        let found = match is_fast {
            true => py.detach(|| self.run(hint.as_ref(), &mut ws)),
            // A second at most.
            false => interruptible(py, |_| self.run(hint.as_ref(), &mut ws))?,
        };
        let answer = match found {
            Ok(explanations) => Answer::Found(self::answer(py, rivals, explanations)),
            Err(rejection) => Answer::Rejected(rejection.to_string()),
        };
        self.keep(ws);
        Ok(answer)
    }

    /// Many views, one after another in `dots`; frame `i` has the rows from `offsets[i]` to
    /// `offsets[i + 1]`.
    fn identify_batch<'py>(
        &self,
        py: Python<'py>,
        dots: Numbers<'py>,
        offsets: PyReadonlyArray1<'py, i64>,
        sigma_rad: Option<Numbers<'py>>,
        covariances: Option<Numbers<'py>>,
    ) -> PyResult<Columns<'py>> {
        let mut all = Vec::new();
        let (sigmas, covariances) = (sigma_rad.as_ref(), covariances.as_ref());
        observed(&dots, sigmas, covariances, self.sigma_rad, false, &mut all)?;
        let ends = ends(&offsets, all.len())?;
        let frames = ends.len().saturating_sub(1);
        let mut quaternions = Array2::from_elem((frames, 4), f64::NAN);
        let mut assigned = Array1::from_elem(all.len(), -1);
        let [mut residual, mut dots_confidence, mut confidence] =
            [(); 3].map(|()| Array1::from_elem(frames, f64::NAN));
        let reasons = PyDict::new(py);
        for (i, pair) in ends.windows(2).enumerate() {
            check_dots(&format!("frames[{i}]"), pair[1] - pair[0])?;
        }
        let found = interruptible(py, |stop| self.run_all(&all, &ends, stop))?;
        for (i, outcome) in found.into_iter().enumerate() {
            match outcome {
                Ok(found) => {
                    for (k, x) in to_wxyz(&found.rotation).into_iter().enumerate() {
                        quaternions[[i, k]] = x;
                    }
                    for (k, dot) in found.assignment.iter().enumerate() {
                        assigned[ends[i] + k] = dot.map_or(-1, i64::from);
                    }
                    residual[i] = found.residual_rad;
                    dots_confidence[i] = found.dots_confidence;
                    confidence[i] = found.confidence;
                }
                Err(rejection) => reasons.set_item(i, rejection.to_string())?,
            }
        }
        Ok((
            quaternions.into_pyarray(py),
            assigned.into_pyarray(py),
            residual.into_pyarray(py),
            dots_confidence.into_pyarray(py),
            confidence.into_pyarray(py),
            reasons,
        ))
    }
}

impl Recognizer {
    fn run_all(
        &self,
        dots: &[ObservedDot],
        ends: &[usize],
        stop: StopFlag,
    ) -> Vec<Result<Identification, NoAnswer>> {
        let frames: Vec<&[ObservedDot]> = ends.windows(2).map(|w| &dots[w[0]..w[1]]).collect();
        frames
            .par_iter()
            .with_min_len(FRAMES_AT_ONCE)
            .map_init(
                || self.workspace(),
                |ws, frame| {
                    if stop.is_set() {
                        return Err(NoAnswer::Rejected(RecognizerRejection::NoHypothesis));
                    }
                    ws.dots.clear();
                    ws.dots.extend_from_slice(frame);
                    Ok(self.run(None, ws)?.best().clone())
                },
            )
            .collect()
    }
}

/// Checks the frames' offsets.
fn ends(offsets: &PyReadonlyArray1<'_, i64>, dots: usize) -> PyResult<Vec<usize>> {
    let ends: Option<Vec<usize>> = offsets
        .as_array()
        .iter()
        .map(|&end| usize::try_from(end).ok())
        .collect();
    ends.filter(|ends| {
        ends.first() == Some(&0)
            && ends.last() == Some(&dots)
            && ends.windows(2).all(|w| w[0] <= w[1])
    })
    .ok_or_else(|| {
        let problem = format!("expected numbers that rise from 0 to the number of dots, {dots}");
        value_error("offsets", problem)
    })
}
