//! Where a ball is.

use nalgebra::Matrix3;

use super::{Rotation, Vec3, turned_covariance};

/// The center of a ball in a camera's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// The center, m.
    pub center_m: Vec3,
    /// Its covariance, m^2.
    pub covariance: Matrix3<f64>,
    /// Its covariance with the small rotation vector that leads from the ball's orientation to the true one, m rad: a row for each
    /// coordinate of the center. `None` where there is no orientation, or it is not known.
    pub with_rotation: Option<Matrix3<f64>>,
}

impl Position {
    /// The same by the axes of a frame that this rotation leads to.
    #[must_use]
    pub fn turned(&self, turn: &Rotation) -> Self {
        Self {
            center_m: turn * self.center_m,
            covariance: turned_covariance(turn, &self.covariance),
            with_rotation: self.with_rotation.map(|c| turned_covariance(turn, &c)),
        }
    }
}
