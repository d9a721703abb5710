//! Faces that are laid on the surface.

use nalgebra::Matrix3;

use crate::geometry::Rotation;

/// Depth from which a place takes part.
pub(crate) const ALIGNED: f64 = 0.4;

/// A face on the surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Laid {
    /// Surface to view frame.
    pub rotation: Rotation,
    /// Correlation of what is seen with the surface.
    pub agreement: f64,
    /// Covariance of the rotation by the noise of the pixels, view frame, rad^2.
    pub covariance: Matrix3<f64>,
}

impl Laid {
    /// The first face, whose view frame is that of the surface.
    pub(crate) fn first() -> Self {
        Self::at(Rotation::identity())
    }

    /// A face that something else has placed.
    pub(crate) fn at(rotation: Rotation) -> Self {
        Self {
            rotation,
            agreement: 1.0,
            covariance: Matrix3::zeros(),
        }
    }
}
