//! Faces that are laid on the surface.

use nalgebra::Matrix3;

use super::face::Face;
use crate::geometry::{Rotation, rotation_angle};

/// Depth from which a place takes part.
pub(crate) const ALIGNED: f64 = 0.4;

/// Of the rotations that a search finds, so many are laid on the surface.
pub(crate) const LAID: usize = 5;
/// The ball turns by so much, radians, between two views that a surface takes in, and so many views make one at most.
pub(crate) const TURNED: f64 = 0.035;
const VIEWS: usize = 600;

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

/// The placed frames that make a surface: as many as are needed, the ball turned between one and the next.
pub(crate) fn apart<'a>(
    faces: &'a [Option<Face>],
    laid: &[Option<Laid>],
) -> Vec<(&'a Face, Rotation)> {
    let mut apart: Vec<(&Face, Rotation)> = Vec::new();
    for (face, laid) in faces.iter().zip(laid) {
        let (Some(face), Some(laid)) = (face, laid) else {
            continue;
        };
        let rotation = laid.rotation;
        let is_apart = |last: &(&Face, Rotation)| rotation_angle(&last.1, &rotation) > TURNED;
        if apart.last().is_none_or(is_apart) {
            apart.push((face, rotation));
        }
    }
    let stride = apart.len().div_ceil(VIEWS).max(1);
    apart.into_iter().step_by(stride).collect()
}

/// The numbers of the frames that have one.
pub(crate) fn numbers<T>(all: &[Option<T>]) -> Vec<usize> {
    (0..all.len()).filter(|k| all[*k].is_some()).collect()
}

/// Some of them, evenly, so many at most.
pub(crate) fn few(all: &[usize], most: usize) -> Vec<usize> {
    let stride = all.len().div_ceil(most).max(1);
    all.iter().step_by(stride).copied().collect()
}
