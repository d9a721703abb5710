//! The frames that orientations and spins in files are in: the camera's or the view frame, each in one of two conventions.

use super::{Rotation, Vec3};
use crate::error::{Error, Result};

/// The frame of an orientation or a spin.
///
/// The *view frame* takes the place of the camera's where the intrinsics are unknown: its z points from the ball to the camera.
/// It is the camera's frame turned by the angle under which the ball is seen off the optical axis, about an axis in the image plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraFrame {
    /// The camera's: x right, y up, z from the scene towards the camera, as in this crate.
    #[default]
    Camera,
    /// The camera's: x right, y down, z forward (REP 103).
    Optical,
    /// The view frame, in the axes of [`CameraFrame::Camera`].
    View,
    /// The view frame, in the axes of [`CameraFrame::Optical`].
    OpticalView,
}

impl CameraFrame {
    /// All frames.
    pub const ALL: [Self; 4] = [Self::Camera, Self::Optical, Self::View, Self::OpticalView];
    /// Those of a camera: the conventions of the axes.
    pub const AXES: [Self; 2] = [Self::Camera, Self::Optical];
    /// What [`CameraFrame::Camera`] was called in files.
    const FORMER: &str = "ours";

    /// As written in files and on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Optical => "optical",
            Self::View => "view",
            Self::OpticalView => "optical_view",
        }
    }

    /// The frame and its axes, in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Camera => "camera frame (x right, y up, z towards the camera)",
            Self::Optical => "camera frame (x right, y down, z forward)",
            Self::View => "view frame (x right, y up, z from the ball towards the camera)",
            Self::OpticalView => "view frame (x right, y down, z from the camera to the ball)",
        }
    }

    /// Whether it is a view frame.
    pub fn is_view(self) -> bool {
        matches!(self, Self::View | Self::OpticalView)
    }

    /// The camera's or the view frame, in the axes of this one.
    pub fn of_view(self, is_view: bool) -> Self {
        match (self.is_optical(), is_view) {
            (false, false) => Self::Camera,
            (true, false) => Self::Optical,
            (false, true) => Self::View,
            (true, true) => Self::OpticalView,
        }
    }

    /// The same frame in the axes of another one, and the rotation that leads there.
    pub fn in_axes(self, axes: Self) -> (Self, Rotation) {
        let to = axes.of_view(self.is_view());
        (to, to.turn() * self.turn())
    }

    fn is_optical(self) -> bool {
        matches!(self, Self::Optical | Self::OpticalView)
    }

    /// The rotation from this frame to the one in the crate's axes, and back: it is its own inverse,
    /// `diag(1, -1, -1)` or the identity.
    pub fn turn(self) -> Rotation {
        match self.is_optical() {
            false => Rotation::identity(),
            true => Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI),
        }
    }
}

impl std::str::FromStr for CameraFrame {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            Self::FORMER => Ok(Self::Camera),
            _ => crate::error::by_name(&Self::ALL, Self::as_str, "camera_frame", name),
        }
    }
}

impl std::fmt::Display for CameraFrame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}
