//! The conventions of the camera frame that files are written in.

use super::{Rotation, Vec3};
use crate::error::{Error, Result};

/// A convention of the camera frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraFrame {
    /// x right, y up, z from the ball towards the camera: that of this crate.
    #[default]
    Ours,
    /// x right, y down, z forward (REP 103).
    Optical,
}

impl CameraFrame {
    /// Both conventions.
    pub const ALL: [Self; 2] = [Self::Ours, Self::Optical];

    /// As written in files and on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ours => "ours",
            Self::Optical => "optical",
        }
    }

    /// The axes, in words.
    pub fn axes(self) -> &'static str {
        match self {
            Self::Ours => "x right, y up, z towards the camera",
            Self::Optical => "x right, y down, z forward",
        }
    }

    /// The rotation from this frame to the crate's, and back: it is its own inverse,
    /// `diag(1, -1, -1)` or the identity.
    pub fn turn(self) -> Rotation {
        match self {
            Self::Ours => Rotation::identity(),
            Self::Optical => Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI),
        }
    }
}

impl std::str::FromStr for CameraFrame {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "camera_frame", name)
    }
}

impl std::fmt::Display for CameraFrame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}
