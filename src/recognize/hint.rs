//! Prior knowledge of the orientation.

use nalgebra::Matrix3;

use crate::geometry::Rotation;

/// A prior orientation: the last frame's, propagated by the spin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hint {
    /// Expected rotation from the pattern's frame to the camera's.
    pub rotation: Rotation,
    /// Covariance of the rotation vector that leads from it to the true one, camera frame, rad^2.
    pub covariance: Matrix3<f64>,
    /// Probability that the hint is entirely wrong, in (0, 1).
    pub wrong: f64,
}

impl Hint {
    /// A hint with the same standard deviation about every axis, radians; one in twenty is wrong.
    pub fn isotropic(rotation: Rotation, sigma_rad: f64) -> Self {
        Self {
            rotation,
            covariance: Matrix3::from_diagonal_element(sigma_rad * sigma_rad),
            wrong: 0.05,
        }
    }
}
