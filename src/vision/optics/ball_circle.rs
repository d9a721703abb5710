//! The outline of a ball in an image.

use nalgebra::Vector2;

use super::intrinsics::Pixel;
use crate::geometry::Vec3;
use crate::image::Roi;

/// The ball's outline in an image: a circle, or an ellipse where the ball is seen to be off the optical axis of a
/// camera whose intrinsics are unknown.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BallCircle {
    /// Its center.
    pub center: Pixel,
    /// Its radius, of an ellipse the shorter half axis, pixels.
    pub radius: f64,
    /// Along the longer axis, away from the principal point (u, v); its length is the numerical eccentricity, 0 for a
    /// circle. A pinhole camera's intrinsics say what it is: there it is not looked at.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub eccentricity: Vector2<f64>,
}

fn is_zero(vector: &Vector2<f64>) -> bool {
    *vector == Vector2::zeros()
}

impl BallCircle {
    /// A circle.
    pub const fn new(center: Pixel, radius: f64) -> Self {
        Self {
            center,
            radius,
            eccentricity: Vector2::new(0.0, 0.0),
        }
    }

    /// The same, moved and grown by so much of its radius.
    pub fn shifted(&self, by: &Vec3) -> Self {
        Self {
            center: Pixel {
                u: self.center.u + by.x * self.radius,
                v: self.center.v + by.y * self.radius,
            },
            radius: self.radius + by.z * self.radius,
            ..*self
        }
    }

    /// Whether it is no circle.
    pub fn is_ellipse(&self) -> bool {
        !is_zero(&self.eccentricity)
    }

    /// A point of the outline; all of it by angles from 0 to 2 pi, which begin at the longer axis.
    pub fn rim(&self, angle: f64) -> Pixel {
        let along = self.eccentricity.try_normalize(1e-12);
        let along = along.unwrap_or_else(Vector2::x);
        let longer = self.radius / (1.0 - self.eccentricity.norm_squared()).max(1e-6).sqrt();
        let (s, c) = angle.sin_cos();
        let off = longer * c * along + self.radius * s * Vector2::new(-along.y, along.x);
        Pixel {
            u: self.center.u + off.x,
            v: self.center.v + off.y,
        }
    }

    /// The square of pixels that reaches so many radii from the center, cut at the borders of
    /// an image of this size; `None` where nothing is left.
    pub fn region(&self, reach: f64, width: usize, height: usize) -> Option<Roi> {
        let reach = reach * self.radius;
        let side = |center: f64, pixels: usize| {
            let from = (center - reach).floor().max(0.0);
            let to = (center + reach).ceil().min(pixels as f64 - 1.0);
            (from <= to).then(|| (from as usize, (to - from) as usize + 1))
        };
        let (left, width) = side(self.center.u, width)?;
        let (top, height) = side(self.center.v, height)?;
        Some(Roi {
            left,
            top,
            width,
            height,
        })
    }
}
