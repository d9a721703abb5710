//! A ball off the optical axis.
//!
//! Off the optical axis a sphere's outline is an ellipse, whose eccentricity `e` says how far: with the half angle
//! `alpha = asin k` under which the ball is seen, and the angle `theta` between the axis and the ray to its center,
//! `sin theta = e cos alpha`. What a camera that looks straight at the ball sees at `(X, Y) = s (x, -y)`, `X` along the long
//! axis and away from the principal point, this one sees at
//!
//! ```text
//! U = b (X / cos theta) (1 / w),   V = b Y / w,   w = (cos theta - X tan alpha sin theta) / B
//! ```
//!
//! up to a shift, with the short half axis `b` and `B = sqrt(1 - e^2)` (the homography of the turn by `theta`).

use nalgebra::{Matrix2, Vector2};

use super::ball_circle::BallCircle;
use super::intrinsics::{Intrinsics, Pixel};

/// The turn between a camera that looks straight at the ball and one that sees it off its axis. Points are in image
/// directions (u, v) from the outline's center, in half axes: of the circle, and of the ellipse's shorter one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tilt {
    /// Along the longer axis, away from the principal point.
    along: Vector2<f64>,
    /// Cosine of the angle between the axis and the ray to the ball's center.
    cos: f64,
    /// Its sine times the tangent of the half angle of the ball.
    slope: f64,
    /// The shorter half axis over the longer one.
    shape: f64,
    /// From the image of the ball's center to the ellipse's, shorter half axes.
    shift: f64,
}

impl Tilt {
    /// `None` for a circle.
    pub fn new(inverse_distance: f64, eccentricity: &Vector2<f64>) -> Option<Self> {
        let along = eccentricity.try_normalize(1e-9)?;
        let e = eccentricity.norm();
        let cos_half = (1.0 - inverse_distance * inverse_distance).sqrt();
        let tan_half = inverse_distance / cos_half;
        let sin = e * cos_half;
        let cos = (1.0 - sin * sin).sqrt();
        let shape = (1.0 - e * e).sqrt();
        Some(Self {
            along,
            cos,
            slope: sin * tan_half,
            shape,
            shift: tan_half * sin / (cos * shape),
        })
    }

    /// Where a point that is seen straight on at `at` is seen.
    pub fn see(&self, at: Vector2<f64>) -> Vector2<f64> {
        let along = at.dot(&self.along);
        let across = at - along * self.along;
        let scale = self.shape / (self.cos - along * self.slope);
        self.along * (along * scale / self.cos - self.shift) + across * scale
    }

    /// The inverse of [`Tilt::see`].
    pub fn straighten(&self, seen: Vector2<f64>) -> Vector2<f64> {
        let from_ball = seen.dot(&self.along);
        let across = seen - from_ball * self.along;
        let from_ball = from_ball + self.shift;
        let along =
            from_ball * self.cos * self.cos / (self.shape + from_ball * self.slope * self.cos);
        self.along * along + across * ((self.cos - along * self.slope) / self.shape)
    }

    /// d(seen)/d(seen straight on).
    pub fn jacobian(&self, at: Vector2<f64>) -> Matrix2<f64> {
        let along = at.dot(&self.along);
        let across = at - along * self.along;
        let depth = self.cos - along * self.slope;
        let scale = self.shape / depth;
        let by_along =
            self.along * (self.shape / (depth * depth)) + across * (scale * self.slope / depth);
        let side = Vector2::new(-self.along.y, self.along.x);
        by_along * self.along.transpose() + side * side.transpose() * scale
    }
}

impl Intrinsics {
    /// Those of a camera with square pixels that sees a ball at `1 / inverse_distance` radii as this ellipse; `None` for a
    /// circle, which any camera may see that looks straight at the ball.
    pub(crate) fn of_ellipse(circle: &BallCircle, inverse_distance: f64) -> Option<Self> {
        let tilt = Tilt::new(inverse_distance, &circle.eccentricity)?;
        let tan_half = inverse_distance / (1.0 - inverse_distance * inverse_distance).sqrt();
        let focal = tilt.shape * circle.radius / tan_half;
        let tan = (1.0 - tilt.cos * tilt.cos).sqrt() / tilt.cos;
        let center = Self::from_ellipse(circle, inverse_distance).center;
        Some(Self::pinhole(
            focal,
            focal,
            center.u - focal * tan * tilt.along.x,
            center.v - focal * tan * tilt.along.y,
        ))
    }

    /// The circle of [`BallView::new`](super::camera::BallView::new) that such a camera has for an ellipse.
    pub(crate) fn from_ellipse(ellipse: &BallCircle, inverse_distance: f64) -> BallCircle {
        let Some(tilt) = Tilt::new(inverse_distance, &ellipse.eccentricity) else {
            return *ellipse;
        };
        let shift = tilt.along * (tilt.shift * ellipse.radius);
        let center = Pixel {
            u: ellipse.center.u - shift.x,
            v: ellipse.center.v - shift.y,
        };
        BallCircle::new(center, ellipse.radius * tilt.shape / tilt.cos)
    }

    /// The ellipse that such a camera sees where a circle has its center where the ball's is seen, and the radius that
    /// [`BallView::new`](super::camera::BallView::new) gives an outline off a pinhole's axis.
    pub(crate) fn to_ellipse(
        circle: &BallCircle,
        eccentricity: Vector2<f64>,
        inverse_distance: f64,
    ) -> BallCircle {
        let Some(tilt) = Tilt::new(inverse_distance, &eccentricity) else {
            return *circle;
        };
        let radius = circle.radius * tilt.cos / tilt.shape;
        let shift = tilt.along * (tilt.shift * radius);
        BallCircle {
            center: Pixel {
                u: circle.center.u + shift.x,
                v: circle.center.v + shift.y,
            },
            radius,
            eccentricity,
        }
    }
}
