//! An observed dot: a direction with its uncertainty.

use nalgebra::{Matrix2, Vector2};

use crate::geometry::{Vec3, tangent_frame};

/// Uncertainty of an observed direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DotUncertainty {
    /// The same in all tangent directions.
    Isotropic {
        /// Standard deviation of the angular error along one tangent axis, radians.
        sigma_rad: f64,
    },
    /// Different along different tangent directions.
    Tangent {
        /// Covariance, rad^2, in the axes of
        /// [`tangent_frame(direction)`](crate::geometry::tangent_frame).
        covariance: Matrix2<f64>,
    },
}

impl DotUncertainty {
    /// The uncertainty with an independent error of `sigma_rad` along either tangent axis besides.
    #[must_use]
    pub fn widened(self, sigma_rad: f64) -> Self {
        match self {
            Self::Isotropic { sigma_rad: own } => Self::Isotropic {
                sigma_rad: own.hypot(sigma_rad),
            },
            Self::Tangent { covariance } => Self::Tangent {
                covariance: covariance + Matrix2::identity() * (sigma_rad * sigma_rad),
            },
        }
    }
}

/// An observed dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObservedDot {
    /// Unit vector from the ball's center to the dot, camera frame.
    pub direction: Vec3,
    /// Uncertainty of the direction.
    pub uncertainty: DotUncertainty,
}

impl ObservedDot {
    /// Squared distance of `direction` in standard deviations: over two axes, so 2 on average. Holds for
    /// directions near the dot's.
    pub fn squared_deviations(&self, direction: &Vec3) -> f64 {
        let [e1, e2] = tangent_frame(&self.direction);
        let off = Vector2::new(e1.dot(direction), e2.dot(direction));
        match self.uncertainty {
            DotUncertainty::Isotropic { sigma_rad } => off.norm_squared() / (sigma_rad * sigma_rad),
            DotUncertainty::Tangent { covariance } => covariance
                .try_inverse()
                .map_or(f64::INFINITY, |inverse| off.dot(&(inverse * off))),
        }
    }
}
