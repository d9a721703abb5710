//! Balls with paint of any shape: clips of them, and their surfaces.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use spindoe::clip::{
    self, BallEstimate, BatchFrame, BatchObserver, PaintedClip, PaintedStream, SurfaceObserver,
    TrackerConfig,
};
use spindoe::geometry::CameraFrame;
use spindoe::image::RgbImage;
use spindoe::spin::orientations::Orientations;
use spindoe::surface::{PaintedFrame, SurfaceMap};
use spindoe::vision::frame::OutlineMethod;

use crate::arrays::{blocks3, quaternion, square, vector};
use crate::clip::{Asked, Clips, Listener, warn_of};
use crate::errors::{Answer, OrRaise};
use crate::estimator::{camera_model, outline, sequence_config};
use crate::image::{Buffers, Pixels, raw_pixel};
use crate::spin::{self, Estimated, Found};

/// Rows, agreements, residuals, why frames have no pose, circles, centers of the ball, their covariances, the surface where it was made, the spin where
/// there are times, whether anything is answered, the ball's diameter in pixels.
type PaintedTuple<'py> = (
    spin::Rows<'py>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Vec<Option<String>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Option<Surface>,
    Option<Answer<Found<'py>>>,
    bool,
    f64,
);

/// Keeps what frames show of the ball, and reports them.
struct Painting<'a> {
    paint: SurfaceObserver,
    listener: &'a Listener,
}

impl BatchObserver for Painting<'_> {
    type Kept = PaintedFrame;

    fn keep(&self, image: &RgbImage, balls: &[BallEstimate]) -> spindoe::Result<PaintedFrame> {
        self.paint.keep(image, balls)
    }

    fn progress(&self, _: &[BatchFrame]) {
        self.listener.count();
    }
}

/// What an earlier clip showed of a ball's paint.
#[pyclass(frozen, module = "spindoe._native")]
pub struct Surface(Arc<SurfaceMap>);

#[pymethods]
impl Surface {
    /// Of a file's bytes; `name` is for what is wrong with them.
    #[new]
    fn new(name: PathBuf, bytes: &[u8]) -> PyResult<Self> {
        let map = SurfaceMap::from_npz(Path::new(&name), bytes).or_raise()?;
        Ok(Self(Arc::new(map)))
    }

    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.0.to_npz().or_raise()?))
    }

    /// Share of the ball that is known.
    fn known(&self) -> f64 {
        self.0.known()
    }

    /// By latitude and longitude, NaN where it is not known.
    fn chart<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let map = Arc::clone(&self.0);
        let chart = py.detach(move || map.chart());
        let [columns, rows] = chart.size();
        let value = |(row, column): (usize, usize)| {
            chart.values()[row * columns + column].map_or(f64::NAN, f64::from)
        };
        Array2::from_shape_fn((rows, columns), value).into_pyarray(py)
    }
}

#[pyclass(frozen, module = "spindoe._native")]
pub struct PaintedEstimator {
    inner: Arc<clip::PaintedEstimator>,
    axes: CameraFrame,
}

#[pymethods]
impl PaintedEstimator {
    #[new]
    fn new(camera: (String, Vec<f64>), outline: &str, ball_radius_m: f64) -> PyResult<Self> {
        let camera = camera_model(&camera.0, &camera.1)?;
        let method: OutlineMethod = outline.parse().or_raise()?;
        let inner = clip::PaintedEstimator::new(&camera, method, ball_radius_m).or_raise()?;
        Ok(Self {
            inner: Arc::new(inner),
            axes: CameraFrame::Camera.of_view(camera.is_view()),
        })
    }

    /// What follows a ball with this surface as its frames come.
    fn tracker(
        &self,
        surface: &Surface,
        window: usize,
        memory_s: f64,
        max_rps: f64,
    ) -> PyResult<PaintedTracker> {
        let config = TrackerConfig {
            sequence: sequence_config(max_rps)?,
            window,
            memory_s,
            ..TrackerConfig::default()
        };
        let surface = SurfaceMap::clone(&surface.0);
        let stream = PaintedStream::new(Arc::clone(&self.inner), surface, config).or_raise()?;
        Ok(PaintedTracker {
            state: Mutex::new((stream, Buffers::default())),
            axes: self.axes,
        })
    }

    /// Frames of one clip, on `surface` or on the one that they show.
    #[pyo3(signature = (images, color, times_s, surface, asked, progress))]
    #[allow(clippy::too_many_arguments)]
    fn estimate_sequence<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Bound<'py, PyAny>>,
        color: &str,
        times_s: Option<Vec<f64>>,
        surface: Option<&Surface>,
        asked: Asked,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<PaintedTuple<'py>> {
        let config = asked.config()?;
        let clips = Clips::one(images, color, times_s, progress)?;
        let (inner, axes) = (Arc::clone(&self.inner), self.axes);
        let surface = surface.map(|surface| Arc::clone(&surface.0));
        let (clip, rows, spin) = clips.run(py, config, move |listed, config, listener| {
            let seeing = Painting {
                paint: SurfaceObserver::default(),
                listener,
            };
            let batch = clip::run_sources(&inner.finder, &listed[0], config, &seeing)?;
            let clip = inner.lay_out(batch, std::mem::take, surface.as_deref());
            let rows = clip.orientations(axes);
            let config = clip.batch.times.of_spin(config.sequence.spin);
            let spin = clip
                .batch
                .is_sequence()
                .then(|| Estimated::of_sequence(&rows, config, None));
            Ok((clip, rows, spin))
        })?;
        warn_of(py, clip.batch.focal_doubt.as_ref())?;
        let spin = spin.map(|spin| Estimated::answer(spin, py, axes));
        Ok(tuple(py, clip, &rows, spin.transpose()?))
    }
}

/// A frame of a stream: orientation and its covariance, agreement, the outline, the ball's center and its covariance, and why there is no orientation.
type StreamTuple<'py> = (
    Option<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, f64)>,
    Option<(f64, f64, f64)>,
    Option<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)>,
    Option<String>,
);

/// A stream of frames, with the memory of its images.
#[pyclass(frozen, module = "spindoe._native")]
pub struct PaintedTracker {
    state: Mutex<(PaintedStream, Buffers)>,
    axes: CameraFrame,
}

#[pymethods]
impl PaintedTracker {
    /// The next frame, and the spin.
    #[pyo3(signature = (image, color, time_s, circle))]
    fn update<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        color: &str,
        time_s: f64,
        circle: Option<[f64; 3]>,
    ) -> PyResult<(StreamTuple<'py>, Answer<Found<'py>>)> {
        let outline = outline(circle)?;
        let pixels = Pixels::new("image", image)?;
        let samples = pixels.samples("image", raw_pixel(color)?)?;
        let (pose, circle, position, fitted) = py
            .detach(|| {
                let mut guard = self.state.lock().unwrap_or_else(PoisonError::into_inner);
                let (stream, buffers) = &mut *guard;
                let image = samples.view(buffers)?;
                let state = stream.update(image, time_s, outline.as_ref())?;
                Ok((
                    state.pose,
                    state.frame.circle,
                    state.frame.position(),
                    state.spin.map(|fit| (fit, *state.clock)),
                ))
            })
            .or_raise()?;
        let posed = pose.as_ref().ok().map(|pose| {
            (
                quaternion(py, &pose.rotation),
                square(py, &pose.covariance),
                pose.agreement,
            )
        });
        let frame = (
            posed,
            circle.map(|c| (c.center.u, c.center.v, c.radius)),
            position.map(|p| (vector(py, &p.center_m), square(py, &p.covariance))),
            pose.err().map(|why| why.to_string()),
        );
        Ok((frame, spin::of_stream(py, fitted, self.axes)))
    }

    /// The frame of orientations, positions and spins.
    fn frame(&self) -> &'static str {
        self.axes.as_str()
    }

    fn reset(&self) {
        let mut guard = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        guard.0.reset();
    }
}

/// A clip for Python.
fn tuple<'py>(
    py: Python<'py>,
    clip: PaintedClip<PaintedFrame>,
    rows: &Orientations,
    spin: Option<Answer<Found<'py>>>,
) -> PaintedTuple<'py> {
    let count = rows.rows.len();
    let agreements = clip.poses.iter();
    let agreements = agreements.map(|pose| pose.as_ref().map_or(f64::NAN, |p| p.agreement));
    let residuals = rows.rows.iter();
    let residuals = residuals.map(|row| row.residual_rad.unwrap_or(f64::NAN));
    let reasons = clip.batch.frames.iter().zip(&clip.poses);
    let reasons = reasons.map(|(frame, pose)| {
        let why = pose.as_ref().err().map(ToString::to_string);
        frame.unreadable.clone().or(why)
    });
    let mut circles = Array2::from_elem((count, 3), f64::NAN);
    let mut centers = circles.clone();
    let mut covariances = Vec::with_capacity(count);
    for (k, (frame, row)) in clip.batch.frames.iter().zip(&rows.rows).enumerate() {
        if let Some(circle) = frame.estimate().circle {
            let numbers = [circle.center.u, circle.center.v, circle.radius];
            (0..3).for_each(|i| circles[[k, i]] = numbers[i]);
        }
        if let Some(position) = &row.position {
            (0..3).for_each(|i| centers[[k, i]] = position.center_m[i]);
        }
        let covariance = row.position.as_ref().map(|p| p.covariance);
        covariances.push(covariance.unwrap_or_else(|| nalgebra::Matrix3::repeat(f64::NAN)));
    }
    let (is_answered, diameter_px, made) = (clip.is_answered(), clip.diameter_px, clip.made);
    (
        spin::rows(py, rows),
        PyArray1::from_vec(py, agreements.collect()),
        PyArray1::from_vec(py, residuals.collect()),
        reasons.collect(),
        circles.into_pyarray(py),
        centers.into_pyarray(py),
        blocks3(py, &covariances),
        made.map(|made| Surface(Arc::new(made))),
        spin,
        is_answered,
        diameter_px,
    )
}
