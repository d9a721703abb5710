//! Images to orientations: single frames, sequences, and a camera's frames as they come.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use nalgebra::{Matrix2, Matrix3, Matrix3x2};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use spindoe::ball::DesignRecord;
use spindoe::calibrate::CalibrationConfig;
use spindoe::clip::{
    self, Batch, BatchConfig, FrameClock, LiveCheck, SequenceConfig, SequenceEvidence,
    SequenceRows, SequenceSmears, TrackerConfig,
};
use spindoe::geometry::{CameraFrame, tangent_frame};
use spindoe::image::ImageView;
use spindoe::report::calibration::CalibrationEvaluationConfig;
use spindoe::source::files::list_sources;
use spindoe::spin::SpinRejection;
use spindoe::spin::alias::SpinEvidence;
use spindoe::spin::orientations::Orientations;
use spindoe::spin::robust::SpinConfig;
use spindoe::vision::estimator::EstimatorWorkspace;
use spindoe::vision::frame::{CameraDistance, CameraModel};
use spindoe::vision::net::Weights;
use spindoe::vision::{
    BallCircle, Budget, Camera, CameraCalibration, CnnDetector, DetectorName, DotDetector,
    EstimatorConfig, FrameEstimate, Intrinsics, Lens, OutlinePrior, Pixel, Prior,
};
use spindoe::{DotUncertainty, StopFlag, Vec3};

use crate::arrays::{Numbers, block2, blocks3, quaternion, require_shape, vectors};
use crate::calibrate;
use crate::clip::{Asked, Clips, VerdictTuple, verdict_tuple, warn_of};
use crate::errors::{Answer, OrRaise, value_error};
use crate::frames::{FrameTuple, frame_tuple};
use crate::image::{Buffers, Copied, Pixels, Samples, raw_pixel};
use crate::pattern::{HashTable, overlay, to_json};
use crate::recognizer::{GivenHint, hint};
use crate::spin::{self, Estimated};
use crate::work::abandonable;

/// Images up to this are estimated within some hundredths of a second: on this thread, without an ear for Ctrl-C.
const FAST_PIXELS: usize = 300_000;

/// A circle `u, v, radius` in pixels as the ball's outline.
pub fn outline(given: Option<[f64; 3]>) -> PyResult<Option<OutlinePrior>> {
    match given {
        None => Ok(None),
        Some([u, v, radius])
            if u.is_finite() && v.is_finite() && radius > 0.0 && radius.is_finite() =>
        {
            let center = Pixel { u, v };
            Ok(Some(OutlinePrior::given(BallCircle::new(center, radius))))
        }
        Some(other) => {
            let problem = format!("expected u, v and a positive radius in pixels, found {other:?}");
            Err(value_error("circle", problem))
        }
    }
}

/// The intrinsics of a lens by kind and numbers: fx, fy, cx, cy, skew, and the distortion as OpenCV has it.
pub fn intrinsics(kind: &str, numbers: &[f64]) -> PyResult<Intrinsics> {
    let [fx, fy, cx, cy, skew, distortion @ ..] = numbers else {
        return Err(value_error("camera", "expected fx, fy, cx, cy and skew"));
    };
    let lens = lens(kind == "fisheye", distortion)?;
    let matrix = Matrix3::new(*fx, *skew, *cx, 0.0, *fy, *cy, 0.0, 0.0, 1.0);
    Intrinsics::from_matrix(&matrix, lens).or_raise()
}

/// Kind and numbers, as [`intrinsics`] takes them.
pub fn packed(k: &Intrinsics) -> (&'static str, Vec<f64>) {
    let mut numbers = vec![k.fx, k.fy, k.cx, k.cy, k.skew];
    let kind = match k.lens {
        Lens::Ideal => "pinhole",
        Lens::Polynomial { k, p, s } => {
            numbers.extend([k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5]]);
            numbers.extend(s);
            "pinhole"
        }
        Lens::Fisheye { k } => {
            numbers.extend(k);
            "fisheye"
        }
    };
    (kind, numbers)
}

/// Kind, numbers, columns and rows, and what is to be known of the file.
type ReadIntrinsics = (&'static str, Vec<f64>, Option<(usize, usize)>, Vec<String>);

/// The intrinsics of a file, by kind and numbers, with the size of their images.
#[pyfunction]
pub fn read_intrinsics(path: std::path::PathBuf) -> PyResult<ReadIntrinsics> {
    let read = CameraCalibration::read(&path).or_raise()?;
    let (kind, numbers) = packed(&read.intrinsics);
    let size = read.size.map(|[w, h]| (w as usize, h as usize));
    Ok((kind, numbers, size, read.notes))
}

/// What speaks against intrinsics being those of images of so many columns and rows, if anything does.
#[pyfunction]
pub fn size_doubt(camera: (String, Vec<f64>), size: [usize; 2]) -> PyResult<Option<String>> {
    Ok(match camera_model(&camera.0, &camera.1)? {
        CameraModel::Known(Camera::Perspective(k)) => k.size_doubt(size),
        _ => None,
    })
}

/// Those of a matrix, by rows, and OpenCV's distortion.
#[pyfunction]
pub fn intrinsics_of(
    matrix: [[f64; 3]; 3],
    distortion: Vec<f64>,
    fisheye: bool,
) -> PyResult<(&'static str, Vec<f64>)> {
    let matrix = Matrix3::from_fn(|row, column| matrix[row][column]);
    let lens = lens(fisheye, &distortion)?;
    Ok(packed(&Intrinsics::from_matrix(&matrix, lens).or_raise()?))
}

fn lens(fisheye: bool, distortion: &[f64]) -> PyResult<Lens> {
    match fisheye {
        true => Lens::fisheye(distortion),
        false => Lens::polynomial(distortion),
    }
    .or_raise()
}

/// Pixels `u, v` of points in the camera frame.
#[pyfunction]
pub fn project_points<'py>(
    py: Python<'py>,
    camera: (String, Vec<f64>),
    points: Numbers<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let CameraModel::Known(Camera::Perspective(k)) = camera_model(&camera.0, &camera.1)? else {
        return Err(value_error(
            "camera",
            "expected one whose intrinsics are known",
        ));
    };
    let points = vectors("points", &points)?;
    let pixels: Vec<Pixel> = points.iter().map(|p| k.project(p)).collect();
    let at = |(i, axis): (usize, usize)| [pixels[i].u, pixels[i].v][axis];
    Ok(Array2::from_shape_fn((pixels.len(), 2), at).into_pyarray(py))
}

/// What is known of the camera, by kind and numbers.
pub fn camera_model(kind: &str, numbers: &[f64]) -> PyResult<CameraModel> {
    if numbers.iter().any(|x| !x.is_finite()) {
        return Err(value_error("camera", "expected finite numbers"));
    }
    match (kind, numbers) {
        ("unknown", &[inverse_distance, sigma]) => Ok(CameraModel::Unknown(CameraDistance {
            inverse_distance,
            sigma,
        })),
        ("parallel", []) => Ok(CameraModel::Known(Camera::Orthographic)),
        ("distance", &[distance]) => CameraModel::at_distance(distance).or_raise(),
        ("pinhole" | "fisheye", _) => {
            let intrinsics = intrinsics(kind, numbers)?;
            Ok(CameraModel::Known(Camera::Perspective(intrinsics)))
        }
        _ => Err(value_error("camera", format!("no such kind: {kind:?}"))),
    }
}

/// Frames, how many had an orientation before they informed each other, rows, the spin where there are times, the times at which the ball is
/// seen, the verdict.
type SequenceTuple<'py> = (
    Vec<FrameTuple<'py>>,
    usize,
    spin::Rows<'py>,
    Option<Answer<spin::Found<'py>>>,
    Option<Vec<f64>>,
    Option<VerdictTuple>,
);

/// The working memory of one call.
struct Slot {
    workspace: EstimatorWorkspace,
    buffers: Buffers,
    frame: FrameEstimate,
}

#[pyclass(frozen, module = "spindoe._native")]
pub struct Estimator {
    inner: Arc<spindoe::Estimator>,
    /// What the ball was designed for: a calibration of it knows that too.
    design: Option<DesignRecord>,
    slots: Mutex<Vec<Slot>>,
}

impl Estimator {
    /// That of a library's own.
    pub fn of(inner: spindoe::Estimator, design: Option<DesignRecord>) -> Self {
        Self {
            inner: Arc::new(inner),
            design,
            slots: Mutex::new(Vec::new()),
        }
    }

    /// The library's own.
    pub fn library(&self) -> &spindoe::Estimator {
        &self.inner
    }

    /// The frame of what is estimated.
    pub fn frame(&self) -> CameraFrame {
        CameraFrame::Camera.of_view(self.inner.config().camera.is_view())
    }

    /// Rejects an exposure that is not positive, or that comes without `measures_blur`.
    fn check_exposure(&self, exposure_s: Option<f64>) -> PyResult<()> {
        let Some(exposure_s) = exposure_s else {
            return Ok(());
        };
        if !(exposure_s > 0.0 && exposure_s.is_finite()) {
            let problem = format!("expected a positive number of seconds, found {exposure_s}");
            return Err(value_error("exposure_s", problem));
        }
        if !self.inner.config().measures_blur {
            let problem = "expected an Estimator(..., measures_blur=True)";
            return Err(value_error("exposure_s", problem));
        }
        Ok(())
    }

    fn slot(&self) -> Slot {
        let mut kept = self.slots.lock().unwrap_or_else(PoisonError::into_inner);
        kept.pop().unwrap_or_else(|| Slot {
            workspace: self.inner.workspace(),
            buffers: Buffers::default(),
            frame: FrameEstimate::default(),
        })
    }

    fn keep(&self, slot: Slot) {
        self.slots
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(slot);
    }

    /// Whether an image of so many pixels is estimated too fast for a person who interrupts.
    fn is_fast(samples: &Samples<'_>) -> bool {
        samples.pixels() <= FAST_PIXELS
    }
}

/// The detector of a name, the net with other weights where they are given.
pub fn dot_detector(name: &str, weights: Option<PathBuf>) -> PyResult<DotDetector> {
    let named: DetectorName = name.parse().or_raise()?;
    match (weights, named) {
        (None, named) => named.build().or_raise(),
        (Some(path), DetectorName::Cnn) => {
            let weights = Weights::read(&path).or_raise()?;
            Ok(DotDetector::Cnn(CnnDetector::new(&weights).or_raise()?))
        }
        (Some(_), DetectorName::Blob) => {
            let problem = "expected the detector cnn: blobs have no weights";
            Err(value_error("weights", problem))
        }
    }
}

#[pymethods]
impl Estimator {
    #[new]
    fn new(
        table: &HashTable,
        camera: (String, Vec<f64>),
        detector: &str,
        weights: Option<PathBuf>,
        settings: &str,
    ) -> PyResult<Self> {
        let defaults = EstimatorConfig {
            camera: camera_model(&camera.0, &camera.1)?,
            ..EstimatorConfig::default()
        };
        let config: EstimatorConfig = overlay(&defaults, settings)?;
        let detector = dot_detector(detector, weights)?;
        let inner = spindoe::Estimator::for_ball(&table.0, config, detector).or_raise()?;
        Ok(Self::of(inner, table.0.design().cloned()))
    }

    /// The settings in use, as JSON.
    fn settings(&self) -> PyResult<String> {
        to_json(self.inner.config())
    }

    /// One frame.
    #[pyo3(signature = (image, color, circle, hint))]
    fn estimate<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        color: &str,
        circle: Option<[f64; 3]>,
        hint: Option<GivenHint<'py>>,
    ) -> PyResult<FrameTuple<'py>> {
        let outline = outline(circle)?;
        let hint = hint.map(self::hint).transpose()?;
        let pixels = Pixels::new("image", image)?;
        let samples = pixels.samples("image", raw_pixel(color)?)?;
        let mut slot = self.slot();
        let prior = Prior {
            outline,
            rotation: hint,
            ..Prior::default()
        };
        let inner = Arc::clone(&self.inner);
        let run = move |image: ImageView<'_>, stop: Option<StopFlag>, slot: &mut Slot| {
            let budget = Budget {
                stop,
                ..Budget::default()
            };
            inner.estimate(image, &prior, &budget, &mut slot.workspace, &mut slot.frame);
        };
        if Self::is_fast(&samples) {
            py.detach(|| {
                let mut buffers = std::mem::take(&mut slot.buffers);
                run(samples.view(&mut buffers)?, None, &mut slot);
                slot.buffers = buffers;
                Ok(())
            })
            .or_raise()?;
        } else {
            let mut copied = Copied::default();
            samples.copy_to(&mut copied);
            let work = move |stop| {
                run(copied.view()?, Some(stop), &mut slot);
                Ok(slot)
            };
            slot = abandonable(py, work)?.or_raise()?;
        }
        let found = frame_tuple(py, &slot.frame);
        self.keep(slot);
        Ok(found)
    }

    /// Frames of one sequence: all of them, how many had a pose before they informed each other, their rows, the spin where there are
    /// times, the times at which the ball is seen, and the verdict. Of `others`, too, the one whose table fits is used.
    #[pyo3(signature = (images, color, times_s, others, asked, exposure_s, progress))]
    #[allow(clippy::too_many_arguments)]
    fn estimate_sequence<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Bound<'py, PyAny>>,
        color: &str,
        times_s: Option<Vec<f64>>,
        others: Vec<PyRef<'py, Self>>,
        asked: Asked,
        exposure_s: Option<f64>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<SequenceTuple<'py>> {
        let config = asked.config()?;
        self.check_exposure(exposure_s)?;
        let is_timed = times_s.is_some();
        let clips = Clips::one(images, color, times_s, progress)?;
        let tables = std::iter::once(self.library()).chain(others.iter().map(|one| one.library()));
        let tables: Vec<spindoe::Estimator> = tables.cloned().collect();
        let frame = self.frame();
        let found = clips.run(py, config, move |listed, config, listener| {
            let batch = clip::run_sources(&tables[..], &listed[0], config, listener)?;
            let estimator = &tables[batch.judgment.table];
            let (file, spin) = spin_of(estimator, &batch, config, frame, exposure_s);
            Ok((batch, file, spin))
        })?;
        let (batch, file, spin) = found;
        warn_of(py, batch.focal_doubt.as_ref())?;
        let spin = spin.map(|spin| Estimated::answer(spin, py, frame));
        let seen_s: Option<Vec<f64>> = batch.frames.iter().map(|f| f.time_s).collect();
        let frames = batch.frames.iter().map(|f| frame_tuple(py, f.estimate()));
        Ok((
            frames.collect(),
            batch.independent(),
            spin::rows(py, &file),
            spin.transpose()?,
            seen_s.filter(|_| is_timed),
            verdict_tuple(&batch.judgment),
        ))
    }

    /// The ball as it was drawn, from the arrays or the files of a clip, by the table's pattern as
    /// designed: the frames' times are `times_s`, or follow from `fps`, or from the files.
    #[pyo3(signature = (
        images, paths, color, times_s, fps, circle, placement_sigma_rad, learn_extra, smooth,
        evaluation, size, progress
    ))]
    #[allow(clippy::too_many_arguments)]
    fn calibrate<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Bound<'py, PyAny>>,
        paths: Vec<PathBuf>,
        color: &str,
        times_s: Option<Vec<f64>>,
        fps: Option<f64>,
        circle: Option<[f64; 3]>,
        placement_sigma_rad: Option<f64>,
        learn_extra: bool,
        smooth: bool,
        evaluation: Option<(u64, u64)>,
        size: Option<[usize; 2]>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Answer<calibrate::Found<'py>>> {
        let defaults = CalibrationConfig::default();
        let config = CalibrationConfig {
            estimator: *self.inner.config(),
            placement_sigma_rad: placement_sigma_rad.unwrap_or(defaults.placement_sigma_rad),
            learn_extra,
            smooth,
            ..defaults
        };
        config.check().or_raise()?;
        if let Some(rate) = fps.filter(|x| !(*x > 0.0 && x.is_finite())) {
            let problem = format!("expected a positive number, found {rate}");
            return Err(value_error("fps", problem));
        }
        let outline = outline(circle)?;
        let pattern = self.inner.pattern();
        // As designed, whatever is known of the dots.
        let nominal = self.inner.for_pattern(pattern).or_raise()?;
        let config_of_clip = BatchConfig {
            outline,
            clock: fps.map_or(FrameClock::Inputs, FrameClock::FramesPerSecond),
            ..BatchConfig::default()
        };
        let clips = if paths.is_empty() {
            Clips::one(images, color, times_s, progress)?
        } else {
            Clips::files(py.detach(|| list_sources(&paths)).or_raise()?)
        };
        let clip = calibrate::read_clip(py, nominal, clips, config_of_clip, size)?;
        let evaluation = evaluation.map(|(samples, seed)| CalibrationEvaluationConfig {
            samples,
            seed,
            ..CalibrationEvaluationConfig::default()
        });
        calibrate::run(py, pattern, self.design.clone(), clip, &config, evaluation)
    }

    /// A tracker that shares this estimator.
    fn tracker(
        &self,
        window: usize,
        memory_s: f64,
        max_rps: f64,
        max_latency_s: Option<f64>,
    ) -> PyResult<Tracker> {
        let of = |latency: f64| {
            let duration = Duration::try_from_secs_f64(latency)
                .ok()
                .filter(|d| !d.is_zero());
            let problem = || format!("expected a positive number of seconds, found {latency}");
            duration.ok_or_else(|| value_error("max_latency_s", problem()))
        };
        let max_latency = max_latency_s.map(of).transpose()?;
        let config = TrackerConfig {
            sequence: sequence_config(max_rps)?,
            window,
            memory_s,
            max_latency,
        };
        let inner = spindoe::clip::Tracker::new(Arc::clone(&self.inner), config);
        let check = LiveCheck::new(self.inner.camera());
        Ok(Tracker {
            state: Mutex::new((inner.or_raise()?, Buffers::default(), check)),
            frame: self.frame(),
        })
    }
}

/// A clip's rows in `frame`, and where it is a sequence its spin, by all that its frames say.
fn spin_of(
    estimator: &spindoe::Estimator,
    batch: &Batch<()>,
    config: &BatchConfig,
    frame: CameraFrame,
    exposure_s: Option<f64>,
) -> (Orientations, Option<Result<Estimated, SpinRejection>>) {
    let file = batch.orientations(frame);
    if !batch.is_sequence() {
        return (file, None);
    }
    let named = batch.named();
    let smears =
        exposure_s.and_then(|open_s| SequenceSmears::new(estimator, &named, open_s, frame));
    let rows = SequenceRows::new(estimator, config.row_s(&batch.frames), &named, frame);
    let evidence = SequenceEvidence {
        smears: smears.as_ref(),
        rows: rows.as_ref(),
    };
    let together = evidence.together();
    let evidence = together.as_ref().map(|all| all as &dyn SpinEvidence);
    let config = batch.times.of_spin(config.sequence.spin);
    let spin = Estimated::of_sequence(&file, config, evidence);
    (file, Some(spin))
}

pub fn sequence_config(max_rps: f64) -> PyResult<SequenceConfig> {
    let spin = SpinConfig {
        max_rps,
        ..SpinConfig::default()
    };
    spin.check().map_err(spindoe::Error::from).or_raise()?;
    Ok(SequenceConfig {
        spin,
        ..SequenceConfig::default()
    })
}

pub fn check_times(times: &[f64], images: usize) -> PyResult<()> {
    if times.len() != images {
        let problem = format!(
            "expected one for each of {images} images, found {}",
            times.len()
        );
        return Err(value_error("times_s", problem));
    }
    match times
        .windows(2)
        .position(|w| w[0].partial_cmp(&w[1]) != Some(std::cmp::Ordering::Less))
    {
        None => Ok(()),
        Some(at) => {
            let problem = format!(
                "entry {}: expected a time later than the one before",
                at + 1
            );
            Err(value_error("times_s", problem))
        }
    }
}

/// The tracker with the memory of its images, and what asks their outlines.
type TrackerState = (spindoe::clip::Tracker, Buffers, LiveCheck);

#[pyclass(frozen, module = "spindoe._native")]
pub struct Tracker {
    state: Mutex<TrackerState>,
    frame: CameraFrame,
}

#[pymethods]
impl Tracker {
    /// The next frame, and the spin.
    #[pyo3(signature = (image, color, time_s, circle))]
    fn update<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        color: &str,
        time_s: f64,
        circle: Option<[f64; 3]>,
    ) -> PyResult<(FrameTuple<'py>, Answer<spin::Found<'py>>)> {
        let outline = outline(circle)?;
        let pixels = Pixels::new("image", image)?;
        let samples = pixels.samples("image", raw_pixel(color)?)?;
        let (frame, fitted, doubt) = py
            .detach(|| {
                let mut guard = self.state.lock().unwrap_or_else(PoisonError::into_inner);
                let (tracker, buffers, check) = &mut *guard;
                let image = samples.view(buffers)?;
                let state = tracker.update(image, time_s, outline.as_ref())?;
                Ok((
                    state.frame.clone(),
                    state.spin.map(|fit| (fit, *state.clock)),
                    check.push(image.height(), [state.frame]),
                ))
            })
            .or_raise()?;
        warn_of(py, doubt.as_ref())?;
        Ok((
            frame_tuple(py, &frame),
            spin::of_stream(py, fitted, self.frame),
        ))
    }

    /// The verdict on the last frames.
    fn verdict(&self) -> Option<VerdictTuple> {
        let guard = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        verdict_tuple(guard.0.state().judgment)
    }

    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        let mut guard = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        guard.0.reset();
        let doubt = guard.2.end();
        drop(guard);
        warn_of(py, doubt.as_ref())
    }
}

/// A camera and a ball whose outline is known.
#[pyclass(frozen, module = "spindoe._native")]
pub struct BallView(spindoe::vision::BallView);

#[pymethods]
impl BallView {
    #[new]
    fn new(camera: (String, Vec<f64>), circle: [f64; 3]) -> PyResult<Self> {
        let camera = match camera_model(&camera.0, &camera.1)? {
            CameraModel::Known(known) => known,
            CameraModel::Unknown(at) if camera.0 == "distance" => Camera::Near {
                inverse_distance: at.inverse_distance,
            },
            CameraModel::Unknown(_) => {
                let problem = "expected one whose distance or intrinsics are known";
                return Err(value_error("camera", problem));
            }
        };
        let Some(outline) = outline(Some(circle))? else {
            return Err(value_error("circle", "expected one"));
        };
        Ok(Self(
            spindoe::vision::BallView::new(&camera, outline.circle).or_raise()?,
        ))
    }

    /// Pixels `u, v` of directions in the camera frame.
    fn project<'py>(
        &self,
        py: Python<'py>,
        directions: Numbers<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let to_view = self.0.to_camera().inverse();
        let directions = vectors("directions", &directions)?;
        let pixels: Vec<Pixel> = directions
            .iter()
            .map(|d| self.0.project(&(to_view * d)))
            .collect();
        let at = |(i, k): (usize, usize)| [pixels[i].u, pixels[i].v][k];
        Ok(Array2::from_shape_fn((pixels.len(), 2), at).into_pyarray(py))
    }

    /// Directions in the camera frame with their covariances, of pixels with theirs; NaN outside the
    /// ball.
    #[allow(clippy::type_complexity)]
    fn back_project<'py>(
        &self,
        py: Python<'py>,
        pixels: Numbers<'py>,
        covariances_px2: Numbers<'py>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>)> {
        require_shape("pixels", &pixels, &[None, Some(2)])?;
        let count = pixels.shape()[0];
        require_shape(
            "covariances_px2",
            &covariances_px2,
            &[Some(count), Some(2), Some(2)],
        )?;
        let (points, given) = (pixels.as_array(), covariances_px2.as_array());
        let turn = self.0.to_camera();
        let matrix = *turn.to_rotation_matrix().matrix();
        let mut directions = Vec::with_capacity(count);
        let mut covariances = Vec::with_capacity(count);
        for k in 0..count {
            let pixel = Pixel {
                u: points[[k, 0]],
                v: points[[k, 1]],
            };
            let c: Matrix2<f64> = block2(&given, k);
            let Some(dot) = self.0.back_project(pixel, &c) else {
                directions.push(Vec3::repeat(f64::NAN));
                covariances.push(Matrix3::repeat(f64::NAN));
                continue;
            };
            let axes = matrix * Matrix3x2::from_columns(&tangent_frame(&dot.direction));
            let tangent = match dot.uncertainty {
                DotUncertainty::Tangent { covariance } => covariance,
                DotUncertainty::Isotropic { sigma_rad } => {
                    Matrix2::from_diagonal_element(sigma_rad * sigma_rad)
                }
            };
            directions.push(turn * dot.direction);
            covariances.push(axes * tangent * axes.transpose());
        }
        Ok((
            crate::arrays::rows(py, &directions),
            blocks3(py, &covariances),
        ))
    }

    /// Minimum z of a visible point, view frame.
    fn horizon(&self) -> f64 {
        self.0.horizon()
    }

    /// View frame to camera frame.
    fn to_camera<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        quaternion(py, &self.0.to_camera())
    }
}
