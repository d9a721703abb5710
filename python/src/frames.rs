//! Frames as Python gets them.

use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use spindoe::geometry::{CameraFrame, Position};
use spindoe::vision::{FrameEstimate, Pose};

use crate::arrays::{assignment, quaternion, square, vector};
use crate::errors::Answer;

/// Quaternion, covariance, confidences, residuals in radians and pixels, inverse distance with its
/// standard deviation, whether a hint was given, frame.
type PoseTuple<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    f64,
    f64,
    f64,
    f64,
    Option<(f64, f64)>,
    bool,
    &'static str,
);

/// The ball's center, its covariance, and that with the orientation's rotation vector where there is one.
type PositionTuple<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Option<Bound<'py, PyArray2<f64>>>,
);

/// Circle, dots `u, v, probability`, their covariances, assignment, pose or reason, seconds of the
/// stages, the ball's center.
pub type FrameTuple<'py> = (
    Option<(f64, f64, f64)>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<i64>>,
    Answer<PoseTuple<'py>>,
    (f64, f64, f64),
    Option<PositionTuple<'py>>,
);

fn position_tuple<'py>(py: Python<'py>, position: &Position) -> PositionTuple<'py> {
    (
        vector(py, &position.center_m),
        square(py, &position.covariance),
        position.with_rotation.as_ref().map(|both| square(py, both)),
    )
}

fn pose_tuple<'py>(py: Python<'py>, pose: &Pose) -> PoseTuple<'py> {
    (
        quaternion(py, &pose.rotation),
        square(py, &pose.covariance),
        pose.dots_confidence,
        pose.confidence,
        pose.residual_rad,
        pose.residual_px,
        pose.distance.map(|d| (d.inverse_distance, d.sigma)),
        pose.hinted,
        CameraFrame::Camera
            .of_view(pose.distance.is_some())
            .as_str(),
    )
}

pub fn frame_tuple<'py>(py: Python<'py>, frame: &FrameEstimate) -> FrameTuple<'py> {
    let dots = &frame.dots;
    let at = |(i, k): (usize, usize)| {
        let dot = &dots[i];
        [dot.pixel.u, dot.pixel.v, dot.probability][k]
    };
    let covariance = |(i, j, k): (usize, usize, usize)| dots[i].covariance[(j, k)];
    (
        frame.circle.map(|c| (c.center.u, c.center.v, c.radius)),
        Array2::from_shape_fn((dots.len(), 3), at).into_pyarray(py),
        Array3::from_shape_fn((dots.len(), 2, 2), covariance).into_pyarray(py),
        assignment(py, &frame.assignment),
        match &frame.outcome {
            Ok(pose) => Answer::Found(pose_tuple(py, pose)),
            Err(rejection) => Answer::Rejected(rejection.to_string()),
        },
        (
            frame.timings.locate.as_secs_f64(),
            frame.timings.detect.as_secs_f64(),
            frame.timings.identify.as_secs_f64(),
        ),
        frame
            .position()
            .map(|position| position_tuple(py, &position)),
    )
}
