//! A ball's outline, with its error and where it comes from: what the edges, the [net](crate::vision::outline::net), the frames before and
//! after, or the user say of it.

use nalgebra::Matrix3;

use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::circle::BallFit;

/// The ball's outline before the dots correct it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outline {
    /// The circle, or the ellipse of a ball off the axis.
    pub circle: BallCircle,
    /// Covariance of the center's u and v and the radius, px^2.
    pub covariance: Matrix3<f64>,
    /// Where it comes from.
    pub source: OutlineSource,
}

/// Where an outline comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OutlineSource {
    /// It was found in the frame alone.
    #[default]
    Detected,
    /// It was given.
    Given,
    /// It was found where the frames before and after expected it.
    Neighbors,
}

impl Outline {
    /// An outline that is given.
    pub fn given(circle: BallCircle, covariance: Matrix3<f64>) -> Self {
        Self {
            circle,
            covariance,
            source: OutlineSource::Given,
        }
    }

    /// Whether it was given rather than found.
    pub fn is_given(&self) -> bool {
        self.source == OutlineSource::Given
    }
}

impl From<&BallFit> for Outline {
    fn from(fit: &BallFit) -> Self {
        Self {
            circle: fit.circle,
            covariance: fit.covariance,
            source: OutlineSource::Detected,
        }
    }
}
