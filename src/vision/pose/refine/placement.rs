//! How far dots lie from where the pattern has them.

use nalgebra::{Matrix2, Matrix3, Vector2};

use super::offset;
use crate::geometry::{Rotation, Vec3};
use crate::vision::optics::camera::{BallView, Pixel};

/// Residuals beyond the fitted parameters from which on a placement is estimated.
pub(super) const LEAST_FREE: f64 = 3.0;
/// The least variance of the placement over the stated one: none that is seen.
pub(super) const LEAST_PLACEMENT: f64 = 1e-6;

/// How far the drawn dots may lie from the pattern's.
#[derive(Debug, Clone)]
pub(crate) enum DrawnPlacement {
    /// All alike: variance per tangent axis, rad^2.
    Alike(f64),
    /// Measured: each dot's covariance, rad^2, pattern frame.
    Measured(Vec<Matrix3<f64>>),
}

impl DrawnPlacement {
    /// Covariance in the view frame of dot `name`, expected at `expected` under `rotation`.
    pub(super) fn covariance(
        &self,
        name: usize,
        rotation: &Rotation,
        expected: &Vec3,
    ) -> Matrix3<f64> {
        match self {
            Self::Alike(variance) => {
                (Matrix3::identity() - expected * expected.transpose()) * *variance
            }
            Self::Measured(covariances) => {
                let turn = rotation.to_rotation_matrix();
                turn.matrix() * covariances[name] * turn.matrix().transpose()
            }
        }
    }
}

/// What the residuals say of the placement's variance `t`, by the restricted likelihood's fixed point
/// `t -> t sum e^T S^-1 P S^-1 e / sum tr(S^-1 P)` (D. Harville, JASA 72, 1977), `P` its part of the dots' covariances `S`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PlacementSpread {
    pub(super) seen: f64,
    pub(super) expected: f64,
    pub(super) residuals: f64,
    /// Sum of the logarithms of the determinants of `S`.
    pub(super) ln_determinants: f64,
}

impl PlacementSpread {
    /// A dot: `S^-1 P`, `S^-1 e`, `P` and its weight.
    pub(super) fn add(
        &mut self,
        share: &Matrix2<f64>,
        pull: &Vector2<f64>,
        placement: &Matrix2<f64>,
        weight: f64,
    ) {
        self.seen += weight * pull.dot(&(placement * pull));
        self.expected += share.trace();
        self.residuals += 2.0;
    }

    /// The variance over the stated one, from the one in use and the number of fitted parameters: its mean where its
    /// logarithm may be anything, at most the stated one.
    pub(super) fn scaled(&self, now: f64, fitted: f64) -> f64 {
        let free = self.residuals - fitted;
        if free <= LEAST_FREE {
            return 1.0;
        }
        let expected = self.expected * free / self.residuals;
        let mean = free / (free - 2.0);
        (now * mean * self.seen / expected).clamp(LEAST_PLACEMENT, 1.0)
    }
}

/// How far a dot is seen from where it is expected.
pub(super) struct DotMisfit {
    pub(super) residual: Vector2<f64>,
    /// Inverse of its covariance.
    pub(super) inverse: Matrix2<f64>,
    /// The placement's part of the covariance.
    pub(super) hand: Matrix2<f64>,
}

/// The misfit of a dot whose place has the covariance `placement` (view frame).
pub(super) fn misfit(
    view: &BallView,
    expected: &Vec3,
    pixel: Pixel,
    covariance: &Matrix2<f64>,
    placement: &Matrix3<f64>,
) -> Option<DotMisfit> {
    let by_direction = view.jacobian(expected);
    let hand = by_direction * placement * by_direction.transpose();
    Some(DotMisfit {
        residual: offset(pixel, view.project(expected)),
        inverse: (covariance + hand).try_inverse()?,
        hand,
    })
}
