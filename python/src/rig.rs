//! Several cameras that see one ball.

use std::path::PathBuf;
use std::sync::Arc;

use nalgebra::Matrix3;
use numpy::PyArray1;
use pyo3::prelude::*;
use spindoe::clip::{RigClip, run_rig_sources};
use spindoe::geometry::CameraFrame;
use spindoe::spin::orientations::Orientations;
use spindoe::vision::frame::CameraModel;
use spindoe::vision::{Camera, EstimatorConfig, Extrinsics, RigCamera};
use spindoe::{Ball, Vec3};

use crate::clip::{Asked, Clips, warn_of};
use crate::errors::{Answer, OrRaise, value_error};
use crate::estimator::{Estimator, dot_detector, intrinsics, packed};
use crate::frames::{FrameTuple, frame_tuple};
use crate::pattern::{HashTable, overlay};
use crate::spin::{self, Estimated};

/// Name, intrinsics by kind and numbers, columns and rows of the images, rotation by rows and translation from a common frame (optical
/// axes, m), what is added to the camera's times.
type GivenCamera = (
    String,
    (String, Vec<f64>),
    Option<(usize, usize)>,
    [[f64; 3]; 3],
    [f64; 3],
    f64,
);

/// The same of a rig, from its first camera.
type KnownCamera = (
    String,
    (&'static str, Vec<f64>),
    Option<(usize, usize)>,
    [[f64; 3]; 3],
    [f64; 3],
    f64,
);

/// Frames, how many of a camera alone had an orientation, rows, the spin where there are times, times, cameras and chi2 of each frame, what
/// is to be known, what is wrong.
type Found<'py> = (
    Vec<FrameTuple<'py>>,
    usize,
    spin::Rows<'py>,
    Option<Answer<spin::Found<'py>>>,
    Option<Bound<'py, PyArray1<f64>>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Vec<String>,
    Vec<String>,
);

#[pyclass(frozen, module = "spindoe._native")]
pub struct Rig {
    rig: Arc<spindoe::vision::Rig>,
    /// What the ball carries.
    ball: Arc<Ball>,
    /// One a camera.
    estimators: Vec<Estimator>,
}

impl Rig {
    /// The library's own.
    pub fn library(&self) -> &spindoe::vision::Rig {
        &self.rig
    }

    /// What the ball carries.
    pub fn ball(&self) -> &Ball {
        &self.ball
    }
}

#[pymethods]
impl Rig {
    /// Of a file, or of cameras.
    #[new]
    fn new(
        path: Option<PathBuf>,
        cameras: Vec<GivenCamera>,
        table: &HashTable,
        detector: &str,
        weights: Option<PathBuf>,
        settings: &str,
    ) -> PyResult<Self> {
        let rig = match path {
            Some(path) => spindoe::vision::Rig::read(&path).or_raise()?,
            None => {
                let cameras = cameras.into_iter().map(camera).collect::<PyResult<_>>()?;
                spindoe::vision::Rig::new(cameras).or_raise()?
            }
        };
        let detector = dot_detector(detector, weights)?;
        let estimators = rig.cameras().iter().map(|camera| {
            let intrinsics = camera.calibration.intrinsics;
            let defaults = EstimatorConfig {
                camera: CameraModel::Known(Camera::Perspective(intrinsics)),
                ..EstimatorConfig::default()
            };
            let config: EstimatorConfig = overlay(&defaults, settings)?;
            let inner = spindoe::Estimator::for_ball(&table.0, config, detector.clone());
            Ok(Estimator::of(inner.or_raise()?, table.0.design().cloned()))
        });
        let estimators = estimators.collect::<PyResult<_>>()?;
        Ok(Self {
            rig: Arc::new(rig),
            ball: Arc::clone(&table.0),
            estimators,
        })
    }

    /// The cameras, with what is to be known of their file.
    fn cameras(&self) -> (Vec<KnownCamera>, Vec<String>) {
        let all = self.rig.cameras().iter();
        let known = all.clone().map(|camera| {
            let turn = camera.extrinsics.rotation.to_rotation_matrix();
            let rows = [0, 1, 2].map(|i| [0, 1, 2].map(|j| turn[(i, j)]));
            let size = camera.calibration.size;
            (
                camera.name.clone(),
                packed(&camera.calibration.intrinsics),
                size.map(|[width, height]| (width as usize, height as usize)),
                rows,
                camera.extrinsics.translation_m.into(),
                camera.clock_offset_s,
            )
        });
        let notes = all.flat_map(|camera| {
            let of = |note: &String| format!("{}: {note}", camera.name);
            camera.calibration.notes.iter().map(of)
        });
        (known.collect(), notes.collect())
    }

    /// The clips of all cameras as one.
    #[pyo3(signature = (images, color, times_s, asked, progress))]
    fn estimate_sequence<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Vec<Bound<'py, PyAny>>>,
        color: &str,
        times_s: Option<Vec<Vec<f64>>>,
        asked: Asked,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Found<'py>> {
        let config = asked.config()?;
        let count = self.estimators.len();
        let lists = [
            ("images", Some(images.len())),
            ("times_s", times_s.as_ref().map(Vec::len)),
        ];
        for (name, found) in lists {
            if let Some(found) = found.filter(|found| *found != count) {
                let problem = format!("expected one for each of {count} cameras, found {found}");
                return Err(value_error(name, problem));
            }
        }
        let clips = Clips::held(&images, color, times_s.as_deref(), progress)?;
        let tables = self
            .estimators
            .iter()
            .map(|one| vec![one.library().clone()]);
        let tables: Vec<Vec<spindoe::Estimator>> = tables.collect();
        let rig = Arc::clone(&self.rig);
        let (clip, rows, spin) = clips.run(py, config, move |listed, config, listener| {
            let clip = run_rig_sources(&rig, &tables, listed, config, listener)?;
            let rows = clip.outcome.orientations(CameraFrame::Camera);
            let together = &clip.together;
            let config = together.times.of_spin(config.sequence.spin);
            let spin = together
                .is_sequence()
                .then(|| Estimated::of_sequence(&rows, config, None));
            Ok((clip, rows, spin))
        })?;
        for camera in &clip.cameras {
            warn_of(py, camera.focal_doubt.as_ref())?;
        }
        let spin = spin.map(|spin| Estimated::answer(spin, py, CameraFrame::Camera));
        self.answer(py, &clip, &rows, spin.transpose()?)
    }
}

impl Rig {
    fn answer<'py>(
        &self,
        py: Python<'py>,
        clip: &RigClip<()>,
        rows: &Orientations,
        spin: Option<Answer<spin::Found<'py>>>,
    ) -> PyResult<Found<'py>> {
        let outcome = &clip.outcome;
        let times: Option<Vec<f64>> = outcome.frames.iter().map(|f| f.time_s).collect();
        let times = times.filter(|times| !times.is_empty());
        let frames = outcome.frames.iter();
        let tuples = frames
            .clone()
            .map(|f| frame_tuple(py, &f.estimate))
            .collect();
        let cameras: Vec<i64> = frames.clone().map(|f| f.cameras as i64).collect();
        let misfit = frames.map(|f| f.fusion.misfit());
        let chi2 = misfit.map(|m| m.map_or(f64::NAN, |m| m.chi2 / m.freedom.max(1) as f64));
        let chi2: Vec<f64> = chi2.collect();
        let names = self.rig.names();
        let agreement = outcome.agreement.iter().zip(&names[1..]);
        let notes =
            agreement.filter_map(|(found, name)| Some(found.as_ref()?.words(name, names[0])));
        Ok((
            tuples,
            clip.together.independent(),
            spin::rows(py, rows),
            spin,
            times.map(|times| PyArray1::from_vec(py, times)),
            PyArray1::from_vec(py, cameras),
            PyArray1::from_vec(py, chi2),
            notes.flatten().collect(),
            outcome.doubts.iter().map(ToString::to_string).collect(),
        ))
    }
}

/// A camera of a rig.
fn camera(
    (name, (kind, numbers), size, rows, translation, offset): GivenCamera,
) -> PyResult<RigCamera> {
    if !matches!(kind.as_str(), "pinhole" | "fisheye") {
        let problem = format!("{name}: expected one whose intrinsics are known");
        return Err(value_error("camera", problem));
    }
    let matrix = Matrix3::from_fn(|row, column| rows[row][column]);
    let extrinsics = Extrinsics::new(&matrix, Vec3::from(translation)).or_raise()?;
    let size = size.map(|(width, height)| [width, height]);
    let camera = RigCamera::new(&name, intrinsics(&kind, &numbers)?, size, extrinsics);
    Ok(RigCamera {
        clock_offset_s: offset,
        ..camera
    })
}
