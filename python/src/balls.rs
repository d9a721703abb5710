//! All balls of a frame, and the images of one ball in an exposure with several flashes.

use nalgebra::Matrix3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use spindoe::clip::{
    BallEstimate, BallsEstimator, BallsWorkspace, Strobe, StrobeHypothesis, missing_balls,
    number_balls,
};
use spindoe::geometry::CameraFrame;
use spindoe::image::{ImageView, RawPixel};
use spindoe::spin::SpinRejection;
use spindoe::spin::robust::SpinConfig;
use spindoe::vision::Budget;

use crate::arrays::square;
use crate::errors::{Answer, OrRaise};
use crate::estimator::{Estimator, FRAMES_AT_ONCE, check_times, held_pixels, samples_of};
use crate::frames::{FrameTuple, frame_tuple};
use crate::image::{Buffers, Pixels, raw_pixel};
use crate::work::on_all_cores;

/// A ball's estimate, its table and the probabilities of all tables.
type BallTuple<'py> = (FrameTuple<'py>, usize, Vec<f64>);
/// The same with the ball's number.
type NumberedTuple<'py> = (Option<usize>, BallTuple<'py>);
/// Probability, balls with their flashes, missed flashes, direction of flight, velocity in the picture, and the spin with its
/// covariance and the faster ones, or why there is none.
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
);

#[pyclass(frozen, module = "spindoe._native")]
pub struct Balls {
    inner: BallsEstimator,
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
        let (all, budget) = (&self.inner, Budget::default());
        let pixels = Pixels::new("image", image)?;
        let samples = pixels.samples("image", pixel)?;
        py.detach(|| {
            let mut buffers = Buffers::default();
            let (image, mut ws) = (samples.view(&mut buffers)?, all.workspace()?);
            Ok(match strobe {
                Some(strobe) => all.estimate_strobed(image, None, strobe, &budget, &mut ws),
                None => all.estimate(image, None, &[], &budget, &mut ws),
            })
        })
        .or_raise()
    }

    /// What `work` finds in the images with these numbers, on all cores.
    fn on_images(
        &self,
        py: Python<'_>,
        images: &[Bound<'_, PyAny>],
        numbers: &[usize],
        pixel: RawPixel,
        work: impl Fn(usize, ImageView<'_>, &mut BallsWorkspace<'_>) -> Vec<BallEstimate> + Sync,
    ) -> PyResult<Vec<Vec<BallEstimate>>> {
        let mut found = Vec::with_capacity(numbers.len());
        for some in numbers.chunks(FRAMES_AT_ONCE) {
            py.check_signals()?;
            let held = held_pixels(images, some)?;
            let samples = samples_of(&held, some, pixel)?;
            let done: spindoe::Result<Vec<_>> = on_all_cores(py, || {
                let new = || (Buffers::default(), self.inner.workspace());
                let all = samples
                    .par_iter()
                    .map_init(new, |(buffers, ws), (k, image)| {
                        let ws = ws
                            .as_mut()
                            .map_err(|e| spindoe::Error::Internal(e.to_string()))?;
                        Ok(work(*k, image.view(buffers)?, ws))
                    });
                all.collect()
            })?;
            found.extend(done.or_raise()?);
        }
        Ok(found)
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
        Ok(Self { inner, frame })
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
        let budget = Budget::default();
        let all: Vec<usize> = (0..images.len()).collect();
        let alone = |_: usize, image: ImageView<'_>, ws: &mut BallsWorkspace<'_>| {
            self.inner.estimate(image, None, &[], &budget, ws)
        };
        let mut frames = self.on_images(py, &images, &all, pixel, alone)?;
        let missing = missing_balls(config, &times_s, &frames);
        let is_wanted = |k: &usize| !missing[*k].is_empty();
        let wanted: Vec<usize> = all.into_iter().filter(is_wanted).collect();
        let again = |k: usize, image: ImageView<'_>, ws: &mut BallsWorkspace<'_>| {
            let before = frames[k].clone();
            self.inner
                .look_again(image, before, &missing[k], &budget, ws)
        };
        let found = self.on_images(py, &images, &wanted, pixel, again)?;
        for (k, balls) in wanted.into_iter().zip(found) {
            frames[k] = balls;
        }
        let numbered = number_balls(config, &times_s, &mut frames);
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
        let hypotheses = strobe.read(&balls, self.frame);
        let tuples = balls.iter().map(|ball| ball_tuple(py, ball)).collect();
        let found = hypotheses.iter().map(|h| hypothesis_tuple(py, h)).collect();
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

fn hypothesis_tuple<'py>(py: Python<'py>, found: &StrobeHypothesis) -> HypothesisTuple<'py> {
    let spin = match &found.spin {
        Ok((fit, others)) => {
            let [x, y, z]: [f64; 3] = fit.motion.spin.into();
            let covariance = fit.spin_covariance.unwrap_or(Matrix3::repeat(f64::NAN));
            let others = others.iter().map(|a| a.spin.into()).collect();
            Answer::Found((
                PyArray1::from_slice(py, &[x, y, z]),
                square(py, &covariance),
                others,
            ))
        }
        Err(rejection) => Answer::Rejected(SpinRejection::to_string(rejection)),
    };
    (
        found.probability,
        found.lit.clone(),
        found.missed.clone(),
        found.flight.as_str(),
        found.velocity_px_s,
        spin,
    )
}
