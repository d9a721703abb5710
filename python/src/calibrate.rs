//! Calibration: the dots of a ball as they were really drawn.

use std::sync::Arc;

use nalgebra::{Matrix2, Matrix3, Matrix3x2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use spindoe::ball::DesignRecord;
use spindoe::calibrate::{Calibration, CalibrationConfig, SteadyMark, calibrate};
use spindoe::clip::{self, BatchConfig, BatchFrame, SequenceOutcome, TimeSource};
use spindoe::geometry::tangent_frame;
use spindoe::report::calibration::{
    CalibrationEvaluationConfig, CalibrationSource, evaluate_calibration,
};
use spindoe::vision::FrameEstimate;
use spindoe::{Estimator, Pattern, Vec3};

use crate::arrays::{blocks3, rows, square, vector};
use crate::clip::{Clips, warn_of};
use crate::errors::{Answer, OrRaise, value_error};
use crate::frames::{FrameTuple, frame_tuple};
use crate::pattern::{HashTable, to_json};
use crate::work::abandonable;

/// Table; state, place, covariance, views, expected views and number of each nominal dot; marks;
/// frames; frames with a ball, fitted ones, those with other balls; noise, detection rate; whether
/// the rotation was smooth; inverse distance; the report as JSON.
pub type Found<'py> = (
    HashTable,
    Dots<'py>,
    Vec<MarkTuple<'py>>,
    Vec<FrameTuple<'py>>,
    (usize, usize, usize),
    (f64, f64, bool, Option<f64>),
    Option<String>,
);

/// State, place, covariance, views, expected views and number of each nominal dot.
type Dots<'py> = (
    Vec<&'static str>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
);

/// Direction, covariance, frames that saw it and that it faced.
type MarkTuple<'py> = (
    Bound<'py, PyArray1<f64>>,
    Option<Bound<'py, PyArray2<f64>>>,
    usize,
    usize,
);

/// The frames of a clip as the nominal pattern identifies them.
pub struct Clip {
    pub frames: Vec<FrameEstimate>,
    /// Where they are a sequence.
    pub times_s: Option<Vec<f64>>,
}

/// The frames of a clip, as the command reads them.
pub fn read_clip(
    py: Python<'_>,
    estimator: Estimator,
    clips: Clips,
    config: BatchConfig,
    size: Option<[usize; 2]>,
) -> PyResult<Clip> {
    let mut batch = clips.run(py, config, move |listed, config, listener| {
        clip::run_sources(&estimator, &listed[0], config, listener)
    })?;
    let other = batch
        .frames
        .iter()
        .find(|frame| size.is_some() && frame.size.is_some_and(|own| Some(own) != size));
    if let (Some(frame), Some([width, height])) = (other, size) {
        let [columns, rows] = frame.size.unwrap_or_default();
        let problem = format!(
            "expected {width} x {height} pixels, which the camera's intrinsics are of, found {columns} x {rows} in {}: camera.for_image({columns}, {rows}) scales them",
            frame.name
        );
        return Err(value_error("images", problem));
    }
    if matches!(batch.sequence, SequenceOutcome::TimesNotIncreasing) {
        let mut pairs = batch.frames.windows(2);
        let back = pairs.find(|pair| pair[1].time_s <= pair[0].time_s);
        let at = back.map_or(String::new(), |pair| {
            format!(" ({} comes after {})", pair[1].name, pair[0].name)
        });
        let problem =
            format!("the files' times do not increase from frame to frame{at}: fps sets others");
        return Err(value_error("images", problem));
    }
    if let (TimeSource::SameNumber, Some(problem)) = (batch.times, batch.times.problem()) {
        return Err(value_error("images", format!("{problem}: fps sets some")));
    }
    warn_of(py, batch.focal_doubt.as_ref())?;
    let frames = batch.frames.iter_mut();
    let frames = frames.map(BatchFrame::take_estimate).collect();
    Ok(Clip {
        times_s: batch.times_s(),
        frames,
    })
}

/// A covariance in the tangent axes of a direction, in the pattern's frame.
fn in_space(direction: &Vec3, covariance: &Matrix2<f64>) -> Matrix3<f64> {
    let axes = Matrix3x2::from_columns(&tangent_frame(direction));
    let turned = axes * covariance * axes.transpose();
    0.5 * (turned + turned.transpose())
}

/// Calibrates the ball of a clip on its `nominal` pattern, and evaluates that where it is asked for.
pub fn run<'py>(
    py: Python<'py>,
    nominal: &Pattern,
    design: Option<DesignRecord>,
    clip: Clip,
    config: &CalibrationConfig,
    evaluation: Option<CalibrationEvaluationConfig>,
) -> PyResult<Answer<Found<'py>>> {
    let dot_radius_rad = design.as_ref().map(DesignRecord::dot_radius_rad);
    let job = Arc::new((nominal.clone(), clip, config.clone()));
    let of_clip = Arc::clone(&job);
    let found = abandonable(py, move |_| {
        let (nominal, clip, config) = &*of_clip;
        calibrate(nominal, &clip.frames, clip.times_s.as_deref(), config)
    })?;
    let calibration = match found.or_raise()? {
        Ok(calibration) => Arc::new(calibration),
        Err(rejection) => return Ok(Answer::Rejected(rejection.to_string())),
    };
    let report = evaluation
        .map(|evaluation| {
            let calibration = Arc::clone(&calibration);
            let evaluated = abandonable(py, move |stop| {
                let (nominal, clip, config) = &*job;
                let source = CalibrationSource {
                    nominal,
                    is_design: true,
                    frames: &clip.frames,
                    times_s: clip.times_s.as_deref(),
                    dot_radius_rad,
                };
                let evaluation = CalibrationEvaluationConfig {
                    stop: Some(stop),
                    ..evaluation
                };
                evaluate_calibration(&calibration, &source, config, &evaluation, &|_| {})
            })?;
            to_json(&evaluated.or_raise()?.report)
        })
        .transpose()?;
    let own = calibration.ball(Some(nominal.sha256()));
    let own = own.and_then(|ball| ball.with_design(design)).or_raise()?;
    let frames = calibration.frames.iter();
    Ok(Answer::Found((
        HashTable::new(own),
        dots(py, &calibration),
        marks(py, &calibration),
        frames.map(|f| frame_tuple(py, f)).collect(),
        (
            calibration.with_ball,
            calibration.fitted,
            calibration.with_rivals,
        ),
        (
            calibration.noise_scale,
            calibration.detection_rate,
            calibration.smooth,
            calibration.inverse_distance,
        ),
        report,
    )))
}

fn dots<'py>(py: Python<'py>, calibration: &Calibration) -> Dots<'py> {
    let numbers = calibration.nominal_numbers();
    let number = |j: usize| {
        let at = numbers.iter().position(|n| *n == Some(j as u16));
        at.map_or(-1, |k| k as i64)
    };
    let dots = &calibration.dots;
    let states = dots.iter().map(|dot| dot.state.as_str());
    let places: Vec<Vec3> = dots.iter().map(|dot| dot.direction).collect();
    let covariances: Vec<Matrix3<f64>> = dots
        .iter()
        .map(|dot| in_space(&dot.direction, &dot.covariance))
        .collect();
    let views: Vec<i64> = dots.iter().map(|dot| dot.views as i64).collect();
    let expected: Vec<f64> = dots.iter().map(|dot| dot.expected_views).collect();
    let numbered: Vec<i64> = (0..dots.len()).map(number).collect();
    (
        states.collect(),
        rows(py, &places),
        blocks3(py, &covariances),
        views.into_pyarray(py),
        expected.into_pyarray(py),
        numbered.into_pyarray(py),
    )
}

fn marks<'py>(py: Python<'py>, calibration: &Calibration) -> Vec<MarkTuple<'py>> {
    let tuple = |mark: &SteadyMark| {
        let covariance = mark.covariance.as_ref();
        let covariance = covariance.map(|c| square(py, &in_space(&mark.direction, c)));
        (
            vector(py, &mark.direction),
            covariance,
            mark.found,
            mark.views,
        )
    };
    calibration.marks.iter().map(tuple).collect()
}
