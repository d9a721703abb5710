//! The view frames of a sequence, brought into one.
//!
//! Without intrinsics an orientation is in the *view frame* ([`BallView`](crate::vision::optics::camera::BallView)), whose z points from the ball to the camera.
//! It turns as the ball crosses the picture, and a spin from such orientations lacks that turn. With the outline's radius `r`
//! in pixels and `k` ball radii over the camera's distance, a step of `1 / f = k / r` radians lies between neighboring pixels. A ball whose
//! center lies `(u, v)` pixels to the right of and below a reference is seen in a view frame that is turned from the reference's by
//!
//! ```text
//! atan(q / f) about (-v, -u, 0) / q,   q = sqrt(u^2 + v^2)
//! ```
//!
//! The reference is the median of the centers, so that the turns are small.
//!
//! What is uncertain in this is the same for all frames, and does not average out; [`turn_rate_covariance`] says what it does to a
//! spin.
//!
//! Not corrected: the camera's own motion, and lenses that distort.
//!
//! [`turn_rate_covariance`]: crate::spin::shared::turn_rate_covariance

use nalgebra::Vector2;

use crate::spin::shared::ViewTurn;
use crate::stats::median;
use crate::vision::frame::config::CameraDistance;
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::optics::camera::{BallCircle, Pixel};

/// Error of the distance by all frames over that by one: dots drawn off their places, a biased outline and what is expected beforehand
/// mislead all alike. A decision, so that spins of balls that cross the picture are covered (`bench spin-coverage`, seeds from 61000).
const SHARED_DISTANCE: f64 = 1.35;
/// A distance that is given is taken for known to this, ball radii over the distance.
const MIN_SIGMA: f64 = 1e-4;

/// How the view frame turns over a sequence without intrinsics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequenceView {
    /// The ball's center in the image, pixels, whose view frame the orientations are turned into.
    pub reference: Pixel,
    /// Angle between neighboring pixels, radians.
    pub rad_per_px: f64,
    /// Its standard deviation.
    pub sigma_rad_per_px: f64,
}

impl SequenceView {
    /// That of frames of one ball, by their outlines and the camera's distances, about the median of their centers; `None` without
    /// any.
    fn of(seen: impl Iterator<Item = (BallCircle, CameraDistance)> + Clone) -> Option<Self> {
        let values = |f: fn(&BallCircle) -> f64| {
            let mut values: Vec<f64> = seen.clone().map(|(circle, _)| f(&circle)).collect();
            median(&mut values)
        };
        let reference = Pixel {
            u: values(|c| c.center.u),
            v: values(|c| c.center.v),
        };
        Self::about(reference, seen)
    }

    /// That of estimated frames; `None` where the camera's intrinsics are known, or no frame has a pose.
    pub fn of_frames<'a>(frames: impl Iterator<Item = &'a FrameEstimate> + Clone) -> Option<Self> {
        Self::of(frames.filter_map(FrameEstimate::seen_from))
    }

    /// The same about another reference.
    pub(crate) fn about(
        reference: Pixel,
        seen: impl Iterator<Item = (BallCircle, CameraDistance)>,
    ) -> Option<Self> {
        let (mut count, mut weights, mut steps) = (0.0, 0.0, 0.0);
        for (circle, distance) in seen {
            let sigma = distance.sigma.max(MIN_SIGMA) / circle.radius;
            let weight = sigma.powi(-2);
            count += 1.0;
            weights += weight;
            steps += weight * distance.inverse_distance / circle.radius;
        }
        (count > 0.0).then(|| Self {
            reference,
            rad_per_px: steps / weights,
            sigma_rad_per_px: SHARED_DISTANCE * (count / weights).sqrt(),
        })
    }

    /// The turn from the view frame of a ball at `center` to that of the reference, a rotation vector.
    pub fn turn(&self, center: Pixel) -> ViewTurn {
        let (u, v) = (center.u - self.reference.u, center.v - self.reference.v);
        let length = u.hypot(v);
        let angle = (length * self.rad_per_px).atan();
        let scale = if length > 0.0 { angle / length } else { 0.0 };
        let across = Vector2::new(-v, -u);
        ViewTurn {
            turn_rad: across * scale,
            deviation_rad: across * self.sigma_rad_per_px,
        }
    }
}
