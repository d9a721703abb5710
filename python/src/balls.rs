//! All balls of a frame, and the images of one ball in an exposure with several flashes.

use std::sync::Arc;

use nalgebra::Matrix3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use spindoe::clip::{
    self, BallEstimate, BallsEstimator, SequenceOutcome, Strobe, StrobeHypothesis,
};
use spindoe::geometry::CameraFrame;
use spindoe::image::RawPixel;
use spindoe::spin::SpinRejection;
use spindoe::spin::golf::GolfSpin;
use spindoe::spin::robust::SpinConfig;
use spindoe::vision::Budget;

use crate::arrays::square;
use crate::clip::{Asked, Clips, warn_of};
use crate::errors::{Answer, OrRaise};
use crate::estimator::Estimator;
use crate::frames::{FrameTuple, frame_tuple};
use crate::image::{Copied, Pixels, raw_pixel};
use crate::pattern::to_json;
use crate::work::abandonable;

/// A ball's estimate, its table and the probabilities of all tables.
type BallTuple<'py> = (FrameTuple<'py>, usize, Vec<f64>);
/// The same with the ball's number.
type NumberedTuple<'py> = (Option<usize>, BallTuple<'py>);
/// Probability, balls with their flashes, missed flashes, direction of flight, velocity in the picture, and the spin with its
/// covariance, the faster ones, golf's words and the shot for simulators as JSON, or why there is none.
type HypothesisTuple<'py> = (
    f64,
    Vec<(usize, usize)>,
    Vec<usize>,
    &'static str,
    [f64; 2],
    Answer<SpinTuple<'py>>,
);
type SpinTuple<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Vec<[f64; 3]>,
    Option<GolfTuple>,
    Option<String>,
);
/// Total, backspin, sidespin and rifle spin, rpm; tilt, degrees; the deviations of the second and third, rpm; measured or estimated.
type GolfTuple = ([f64; 4], f64, Option<[f64; 2]>, &'static str);

#[pyclass(frozen, module = "spindoe._native")]
pub struct Balls {
    inner: Arc<BallsEstimator>,
    frame: CameraFrame,
}

impl Balls {
    /// The balls of an image, or the images of one ball in an exposure with flashes.
    fn found(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        pixel: RawPixel,
        strobe: Option<&Strobe>,
    ) -> PyResult<Vec<BallEstimate>> {
        let strobe = strobe.cloned();
        let mut copied = Copied::default();
        Pixels::new("image", image)?
            .samples("image", pixel)?
            .copy_to(&mut copied);
        let inner = Arc::clone(&self.inner);
        let found = abandonable(py, move |stop| {
            let budget = Budget {
                stop: Some(stop),
                ..Budget::default()
            };
            let (mut ws, image) = (inner.workspace()?, copied.view()?);
            Ok(match &strobe {
                Some(strobe) => inner.estimate_strobed(image, None, strobe, &budget, &mut ws),
                None => inner.estimate(image, None, &[], &budget, &mut ws),
            })
        })?;
        found.or_raise()
    }
}

#[pymethods]
impl Balls {
    #[new]
    fn new(estimators: Vec<PyRef<'_, Estimator>>, count: Option<usize>) -> PyResult<Self> {
        let frame = estimators
            .first()
            .map_or(CameraFrame::Camera, |one| one.frame());
        let all = estimators.iter().map(|one| one.library().clone());
        let inner = BallsEstimator::new(all.collect(), count).or_raise()?;
        Ok(Self {
            inner: Arc::new(inner),
            frame,
        })
    }

    /// The balls of one frame.
    fn estimate<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        color: &str,
    ) -> PyResult<Vec<BallTuple<'py>>> {
        let balls = self.found(py, image, raw_pixel(color)?, None)?;
        Ok(balls.iter().map(|ball| ball_tuple(py, ball)).collect())
    }

    /// The balls of the frames of a sequence with their numbers.
    fn estimate_sequence<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Bound<'py, PyAny>>,
        color: &str,
        times_s: Vec<f64>,
        asked: Asked,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Vec<Vec<NumberedTuple<'py>>>> {
        let config = asked.config()?;
        let clips = Clips::one(images, color, Some(times_s), progress)?;
        let inner = Arc::clone(&self.inner);
        let batch = clips.run(py, config, move |listed, config, listener| {
            clip::run_sources(&*inner, &listed[0], config, listener)
        })?;
        warn_of(py, batch.focal_doubt.as_ref())?;
        let numbers = match &batch.sequence {
            SequenceOutcome::Numbered(numbered) => Some(&numbered.numbers),
            _ => None,
        };
        let frames = batch.frames.iter().enumerate().map(|(k, frame)| {
            let number = |ball: usize| numbers.and_then(|numbers| *numbers.get(k)?.get(ball)?);
            let balls = frame.balls.iter().enumerate();
            balls
                .map(|(at, ball)| (number(at), ball_tuple(py, ball)))
                .collect()
        });
        Ok(frames.collect())
    }

    /// The images of one ball in an exposure with flashes at these times, s.
    #[allow(clippy::type_complexity)]
    fn estimate_strobe<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        color: &str,
        times_s: Vec<f64>,
        flight: Option<&str>,
        max_rps: f64,
    ) -> PyResult<(Vec<BallTuple<'py>>, Vec<HypothesisTuple<'py>>)> {
        let flight = flight.map(str::parse).transpose().or_raise()?;
        let strobe = Strobe::new(times_s, flight, spin_config(max_rps)?).or_raise()?;
        let balls = self.found(py, image, raw_pixel(color)?, Some(&strobe))?;
        let frame = self.frame;
        let (hypotheses, balls) = abandonable(py, move |_| (strobe.read(&balls, frame), balls))?;
        let tuples = balls.iter().map(|ball| ball_tuple(py, ball)).collect();
        let found = hypotheses
            .iter()
            .map(|h| hypothesis_tuple(py, h, self.frame))
            .collect::<PyResult<_>>()?;
        Ok((tuples, found))
    }
}

fn spin_config(max_rps: f64) -> PyResult<SpinConfig> {
    let config = SpinConfig {
        max_rps,
        ..SpinConfig::default()
    };
    config.check().map_err(spindoe::Error::from).or_raise()?;
    Ok(config)
}

fn ball_tuple<'py>(py: Python<'py>, ball: &BallEstimate) -> BallTuple<'py> {
    (
        frame_tuple(py, &ball.frame),
        ball.table,
        ball.tables.clone(),
    )
}

fn golf_tuple(golf: &GolfSpin) -> GolfTuple {
    (
        [
            golf.total_rpm,
            golf.backspin_rpm,
            golf.sidespin_rpm,
            golf.rifle_rpm,
        ],
        golf.tilt_deg,
        golf.std_rpm,
        golf.spin_type.as_str(),
    )
}

/// A hypothesis whose orientations are in `frame`.
fn hypothesis_tuple<'py>(
    py: Python<'py>,
    found: &StrobeHypothesis,
    frame: CameraFrame,
) -> PyResult<HypothesisTuple<'py>> {
    let spin = match &found.spin {
        Ok((fit, others)) => {
            let [x, y, z]: [f64; 3] = fit.motion.spin.into();
            let covariance = fit.spin_covariance.unwrap_or(Matrix3::repeat(f64::NAN));
            let others = others.iter().map(|a| a.spin.into()).collect();
            Answer::Found((
                PyArray1::from_slice(py, &[x, y, z]),
                square(py, &covariance),
                others,
                found.golf(frame).as_ref().map(golf_tuple),
                found.shot(1, frame).as_ref().map(to_json).transpose()?,
            ))
        }
        Err(rejection) => Answer::Rejected(SpinRejection::to_string(rejection)),
    };
    Ok((
        found.probability,
        found.lit.clone(),
        found.missed.clone(),
        found.flight.as_str(),
        found.velocity_px_s,
        spin,
    ))
}
