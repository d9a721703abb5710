//! A ball's outline, with its error and where it comes from: what the edges, the [net](crate::vision::outline::net), the frames before and
//! after, or the user say of it.

use nalgebra::Matrix3;

use crate::geometry::Vec3;
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::circle::BallFit;

/// Standard deviations of what the limb's shading and the camera's tone curve do to center and radius of an outline that was found,
/// pixels: 0.13 and 0.26 with balls of 60 pixels (`bench limit`).
const MODEL_ERROR_PX: [f64; 3] = [0.1, 0.1, 0.2];

/// Standard deviation of how much larger or smaller a ball seems by its outline, radii: an edge that is blurred through a tone curve that is not
/// quite known, and the light at the limb. 0.7 % root mean square of 120 balls of 19 to 140 px (`bench position --dotless`).
const SIZE_ERROR: f64 = 0.008;

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

    /// The same with the error of what is left out where it was found by its edges: a given one is taken as it is.
    #[must_use]
    pub(crate) fn with_model_error(mut self) -> Self {
        if !self.is_given() {
            let variances = MODEL_ERROR_PX.map(|sigma| sigma * sigma);
            self.covariance += Matrix3::from_diagonal(&Vec3::from(variances));
        }
        self
    }

    /// The same with the error of the size that an outline which was found has, where that says how far the ball is.
    #[must_use]
    pub(crate) fn with_size_error(mut self) -> Self {
        if !self.is_given() {
            self.covariance[(2, 2)] += (SIZE_ERROR * self.circle.radius).powi(2);
        }
        self
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
