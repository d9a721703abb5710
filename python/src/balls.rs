//! All balls of a frame, and the images of one ball in an exposure with several flashes.

use std::sync::Arc;

use nalgebra::Matrix3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use spindoe::clip::{
    BallEstimate, BallsEstimator, BallsWorkspace, Strobe, StrobeHypothesis, missing_balls,
    number_balls,
};
use spindoe::geometry::CameraFrame;
use spindoe::image::{ImageView, RawPixel};
use spindoe::spin::SpinRejection;
use spindoe::spin::golf::GolfSpin;
use spindoe::spin::robust::SpinConfig;
use spindoe::vision::Budget;

use crate::arrays::square;
use crate::errors::{Answer, OrRaise};
use crate::estimator::{Estimator, check_times, warn_of_clip};
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
    fn found(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        pixel: RawPixel,
        strobe: Option<&Strobe>,
    ) -> PyResult<Vec<BallEstimate>> {
        let strobe = strobe.cloned();
        self.on_image(
            py,
            image,
            pixel,
            move |all, image, budget, ws| match &strobe {
                Some(strobe) => all.estimate_strobed(image, None, strobe, budget, ws),
                None => all.estimate(image, None, &[], budget, ws),
            },
        )
    }

    /// What `work` finds in an image.
    fn on_image(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        pixel: RawPixel,
        work: impl FnOnce(
            &BallsEstimator,
            ImageView<'_>,
            &Budget,
            &mut BallsWorkspace<'_>,
        ) -> Vec<BallEstimate>
        + Send
        + 'static,
    ) -> PyResult<Vec<BallEstimate>> {
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
            let mut ws = inner.workspace()?;
            Ok(work(&inner, copied.view()?, &budget, &mut ws))
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

    /// The balls of the frames of a sequence with their numbers; the table of each number with its probability.
    #[allow(clippy::type_complexity)]
    fn estimate_sequence<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Bound<'py, PyAny>>,
        color: &str,
        times_s: Vec<f64>,
        max_rps: f64,
    ) -> PyResult<(Vec<Vec<NumberedTuple<'py>>>, Vec<(usize, f64)>)> {
        check_times(&times_s, images.len())?;
        let pixel = raw_pixel(color)?;
        let config = spin_config(max_rps)?;
        let frames = images.iter().map(|image| {
            py.check_signals()?;
            self.found(py, image, pixel, None)
        });
        let frames = frames.collect::<PyResult<Vec<_>>>()?;
        // Spins are fitted on all cores.
        let times = times_s.clone();
        let (missing, mut frames) = abandonable(py, move |_| {
            let missing = missing_balls(config, &times, &frames);
            (missing, frames)
        })?;
        for ((image, balls), expected) in images.iter().zip(&mut frames).zip(missing) {
            if !expected.is_empty() {
                py.check_signals()?;
                let before = std::mem::take(balls);
                *balls = self.on_image(py, image, pixel, move |all, view, budget, ws| {
                    all.look_again(view, before, &expected, budget, ws)
                })?;
            }
        }
        let (numbered, frames) = abandonable(py, move |_| {
            let numbered = number_balls(config, &times_s, &mut frames);
            (numbered, frames)
        })?;
        if let Some(estimator) = self.inner.estimators().first() {
            let each = frames.iter().map(|balls| balls.iter().map(|b| &b.frame));
            warn_of_clip(py, estimator, &images, pixel, each)?;
        }
        let tuples = frames
            .iter()
            .zip(&numbered.numbers)
            .map(|(balls, numbers)| {
                let pairs = balls.iter().zip(numbers);
                let tuples = pairs.map(|(ball, number)| (*number, ball_tuple(py, ball)));
                tuples.collect()
            });
        Ok((tuples.collect(), numbered.tables))
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
