//! Several cameras that look at one ball, and where they stand to each other.
//!
//! The *rig's frame* is the first camera's. Files and [`Extrinsics`] have optical axes (x right, y down, z forward), as OpenCV, Kalibr and
//! ROS do. A camera's extrinsics lead from the rig's frame to its own,
//!
//! ```text
//! x_camera = R x_rig + t
//! ```
//!
//! which is what `cv2.stereoCalibrate` returns for the second camera (`x2 = R x1 + T`). [`RigCamera::to_rig`] leads back, in the crate's
//! axes (x right, y up, z towards the camera), in which orientations and positions are: with `D = diag(1, -1, -1)` it is
//! `p_rig = D R^T (D p_camera - t)`.
//!
//! Read ([`Rig::read`]): what people save of `stereoCalibrate` (`K1, D1, K2, D2, R, T` or longer names; YAML, XML and JSON of
//! `cv2.FileStorage`, NPZ), Kalibr's camchain (`T_cn_cnm1`), the `R` and `T` (or `rvec` and `tvec`) of each camera from one common frame,
//! and a transform of each camera in one parent frame as ROS' tf has it:
//!
//! ```yaml
//! left:
//!   calibration: left.yaml       # a file of intrinsics beside this one, or the keys themselves
//!   transform:                   # where the camera's optical frame is in the parent frame: p_parent = R(rotation) p_camera + translation
//!     translation: {x: 0.0, y: 0.0, z: 0.0}
//!     rotation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}
//! right:
//!   calibration: right.yaml
//!   transform:
//!     translation: [0.71, 0.02, 0.70]
//!     rotation: [0.0, -0.7071068, 0.0, 0.7071068]   # x, y, z, w
//!   clock_offset_s: 0.0          # what is added to this camera's times gives the first one's
//! ```
//!
//! Lengths are meters; `units: mm` beside the cameras says otherwise. Guarantees: rotations are proper and orthonormal; what is off by
//! more than rounding is refused with the file and the field. Not guaranteed: that the numbers fit the cameras as they stand:
//! a clip shows it ([`RigDoubt`](crate::clip::RigDoubt)).

use std::path::Path;

use nalgebra::{Matrix3, Quaternion};

use super::intrinsics::{CameraCalibration, Intrinsics};
use crate::error::{Error, Result};
use crate::geometry::{CameraFrame, Position, Rotation, Vec3};

/// Cameras farther apart than this, m, are taken for ones whose lengths are millimeters.
pub const MAX_BASELINE_M: f64 = 50.0;
/// Rotations are off orthonormal ones by no more: files have four digits and more.
const TOLERANCE: f64 = 2e-3;

/// From one frame to another, both with optical axes (x right, y down, z forward): `x' = rotation x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extrinsics {
    /// Turns into the other frame.
    pub rotation: Rotation,
    /// The first frame's origin in the other one, m.
    pub translation_m: Vec3,
}

impl Default for Extrinsics {
    fn default() -> Self {
        Self {
            rotation: Rotation::identity(),
            translation_m: Vec3::zeros(),
        }
    }
}

impl Extrinsics {
    /// Those of a rotation matrix and a translation, m.
    ///
    /// # Errors
    /// [`Error::Argument`] naming `R` or `T` where the matrix is no rotation or a number is not finite.
    pub fn new(matrix: &Matrix3<f64>, translation_m: Vec3) -> Result<Self> {
        if !translation_m.iter().all(|x| x.is_finite()) {
            return Err(Error::argument("T", "expected three finite numbers"));
        }
        Ok(Self {
            rotation: rotation_of(matrix).map_err(|problem| Error::argument("R", problem))?,
            translation_m,
        })
    }

    /// Back again.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self {
            rotation,
            translation_m: -(rotation * self.translation_m),
        }
    }

    /// This one, and then another.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self {
            rotation: next.rotation * self.rotation,
            translation_m: next.rotation * self.translation_m + next.translation_m,
        }
    }

    /// Where a point is in the other frame, m.
    pub fn apply(&self, point_m: &Vec3) -> Vec3 {
        self.rotation * point_m + self.translation_m
    }

    /// The same between frames with the crate's axes (x right, y up, z towards the camera).
    #[must_use]
    pub fn in_camera_axes(&self) -> Self {
        let turn = CameraFrame::Optical.turn();
        Self {
            rotation: turn * self.rotation * turn.inverse(),
            translation_m: turn * self.translation_m,
        }
    }
}

/// The rotation of a matrix; what it is instead.
pub(super) fn rotation_of(matrix: &Matrix3<f64>) -> std::result::Result<Rotation, String> {
    if !matrix.iter().all(|x| x.is_finite()) {
        return Err("expected a rotation, found a number that is not finite".into());
    }
    let off = (matrix.transpose() * matrix - Matrix3::identity()).amax();
    if off > TOLERANCE {
        return Err(format!(
            "expected a rotation, found a matrix whose columns are off unit length or right angles by {off:.3}"
        ));
    }
    if matrix.determinant() < 0.0 {
        return Err("expected a rotation, found a mirror image (its determinant is -1): a left-handed frame?".into());
    }
    Ok(Rotation::from_matrix_eps(
        matrix,
        1e-15,
        100,
        Rotation::identity(),
    ))
}

/// The rotation of a quaternion x, y, z, w, as ROS and SciPy order it; what it is instead.
pub(super) fn rotation_of_xyzw([x, y, z, w]: [f64; 4]) -> std::result::Result<Rotation, String> {
    let q = Quaternion::new(w, x, y, z);
    let length = q.norm();
    match (length - 1.0).abs() <= TOLERANCE {
        true => Ok(Rotation::new_normalize(q)),
        false => Err(format!(
            "expected a unit quaternion x, y, z, w, found one of length {length:.4}"
        )),
    }
}

/// One of several cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// What it is called.
    pub name: String,
    /// Its intrinsics, with the images that they are for.
    pub calibration: CameraCalibration,
    /// From the rig's frame to its own, optical axes.
    pub extrinsics: Extrinsics,
    /// What is to be added to its times to get the first camera's, seconds, as far as it is known.
    pub clock_offset_s: f64,
}

impl RigCamera {
    /// From its frame to the rig's, both with the crate's axes.
    pub fn to_rig(&self) -> Extrinsics {
        self.extrinsics.in_camera_axes().inverse()
    }
}

/// Cameras that look at one ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    cameras: Vec<RigCamera>,
}

impl Rig {
    /// The rig of these cameras; its frame is the first one's, whatever common frame their extrinsics lead from.
    ///
    /// # Errors
    /// [`Error::Argument`] for fewer than two cameras, a name that occurs twice, cameras that stand in one place and look the same way, or
    /// farther apart than [`MAX_BASELINE_M`].
    pub fn new(mut cameras: Vec<RigCamera>) -> Result<Self> {
        let [first, _, ..] = &cameras[..] else {
            let problem = format!("expected at least 2, found {}", cameras.len());
            return Err(Error::argument("cameras", problem));
        };
        let to_common = first.extrinsics.inverse();
        for camera in &mut cameras {
            camera.extrinsics = to_common.then(&camera.extrinsics);
        }
        // Exactly so, whatever the rounding.
        cameras[0].extrinsics = Extrinsics::default();
        for (k, camera) in cameras.iter().enumerate() {
            let (name, others) = (&camera.name, &cameras[..k]);
            if others.iter().any(|other| other.name == *name) {
                return Err(Error::argument("cameras", format!("{name} occurs twice")));
            }
            if !camera.clock_offset_s.is_finite() {
                let problem = format!("{name}: expected a finite number of seconds");
                return Err(Error::argument("clock_offset_s", problem));
            }
            let baseline_m = camera.extrinsics.translation_m.norm();
            if baseline_m > MAX_BASELINE_M {
                let problem = format!(
                    "{name}: expected meters, found a camera {baseline_m:.4} m away from the first: are these millimeters? \
                     `units: mm` in the file says so"
                );
                return Err(Error::argument("T", problem));
            }
            let is_same = |other: &RigCamera| {
                let apart = other.extrinsics.inverse().then(&camera.extrinsics);
                apart.translation_m.norm() < 1e-6 && apart.rotation.angle() < 1e-6
            };
            if let Some(other) = others.iter().find(|other| is_same(other)) {
                let problem = format!(
                    "expected cameras in different places, found {} where {name} is",
                    other.name
                );
                return Err(Error::argument("cameras", problem));
            }
        }
        Ok(Self { cameras })
    }

    /// Reads a rig's file; see [the module](self) for what is read.
    ///
    /// # Errors
    /// [`Error::Read`] where the system refuses; [`Error::Input`] naming the field that is not as expected.
    pub fn read(path: &Path) -> Result<Self> {
        Self::new(CameraCalibration::read_rig(path)?).map_err(|error| match error {
            Error::Argument { parameter, problem } => {
                Error::input(path, parameter.to_string(), problem)
            }
            other => other,
        })
    }

    /// The cameras, the one whose frame is the rig's first.
    pub fn cameras(&self) -> &[RigCamera] {
        &self.cameras
    }

    /// Their names.
    pub fn names(&self) -> Vec<&str> {
        self.cameras.iter().map(|c| c.name.as_str()).collect()
    }

    /// Where a point of the rig's frame (the crate's axes, m) is in a camera's frame (the crate's axes).
    ///
    /// # Panics
    /// Where there is no camera of this number.
    pub fn in_camera(&self, camera: usize, point_m: &Vec3) -> Vec3 {
        let extrinsics = self.cameras[camera].extrinsics.in_camera_axes();
        extrinsics.apply(point_m)
    }
}

impl Extrinsics {
    /// A position with what is known of its error, in the other frame.
    pub(crate) fn place(&self, position: &Position) -> Position {
        let turned = position.turned(&self.rotation);
        Position {
            center_m: turned.center_m + self.translation_m,
            ..turned
        }
    }
}

/// A camera of intrinsics that no file has.
impl RigCamera {
    /// One with these intrinsics; `extrinsics` lead to it from a frame that all cameras have in common.
    pub fn new(
        name: &str,
        intrinsics: Intrinsics,
        size: Option<[usize; 2]>,
        extrinsics: Extrinsics,
    ) -> Self {
        Self {
            name: name.to_owned(),
            calibration: CameraCalibration::new(intrinsics, size),
            extrinsics,
            clock_offset_s: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(name: &str, extrinsics: Extrinsics) -> RigCamera {
        let k = Intrinsics::pinhole(600.0, 600.0, 320.0, 240.0);
        RigCamera::new(name, k, Some([640, 480]), extrinsics)
    }

    fn at(turn: Vec3, translation_m: Vec3) -> Extrinsics {
        Extrinsics {
            rotation: Rotation::from_scaled_axis(turn),
            translation_m,
        }
    }

    #[test]
    fn the_rigs_frame_is_the_first_cameras() {
        let left = at(Vec3::new(0.1, -0.2, 0.3), Vec3::new(0.4, 0.5, 0.6));
        let right = at(Vec3::new(-0.3, 1.2, 0.1), Vec3::new(-0.7, 0.2, 0.9));
        let rig = Rig::new(vec![camera("left", left), camera("right", right)]).expect("a rig");
        let world = Vec3::new(0.3, -0.1, 2.0);
        let (in_left, in_right) = (left.apply(&world), right.apply(&world));
        let second = &rig.cameras()[1];
        assert!((second.extrinsics.apply(&in_left) - in_right).norm() < 1e-12);
        // The same by the crate's axes, and back.
        let turn = CameraFrame::Optical.turn();
        let own = turn * in_right;
        assert!((rig.in_camera(1, &(turn * in_left)) - own).norm() < 1e-12);
        assert!((second.to_rig().apply(&own) - turn * in_left).norm() < 1e-12);
    }

    #[test]
    fn what_is_no_rig_is_refused() {
        let refused = |cameras: Vec<RigCamera>, words: &str| {
            let error = Rig::new(cameras).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        };
        let one = || camera("a", Extrinsics::default());
        let apart = |x: f64| at(Vec3::zeros(), Vec3::new(x, 0.0, 0.0));
        refused(vec![one()], "at least 2");
        refused(vec![one(), camera("a", apart(1.0))], "twice");
        refused(vec![one(), camera("b", apart(-120.0))], "millimeters");
        refused(vec![one(), camera("b", apart(0.0))], "different places");
        let mut mirror = Matrix3::identity();
        mirror[(2, 2)] = -1.0;
        let error = Extrinsics::new(&mirror, Vec3::zeros()).expect_err("a mirror image");
        assert!(error.to_string().contains("determinant"), "{error}");
        let error = Extrinsics::new(&(Matrix3::identity() * 1.1), Vec3::zeros());
        assert!(error.expect_err("too long").to_string().contains("0.210"));
    }
}
