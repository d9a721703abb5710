//! One of several images of balls in a frame.

use super::surface::Surface;
use crate::geometry::{Rotation, Vec3};
use crate::vision::optics::camera::BallCircle;

/// Which image of which ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ImageOf {
    /// Number of the ball; 0 is the scene's own.
    pub ball: usize,
    /// Number of the flash that lights it.
    pub flash: usize,
}

/// A further image of a ball in the frame.
#[derive(Debug, Clone, PartialEq)]
pub struct BallImage {
    /// Which it is.
    pub of: ImageOf,
    /// Its time after the scene's own, s.
    pub late_s: f64,
    /// The ball and what is on it.
    pub surface: Surface,
    /// As [`Scene::circle`](super::scene::Scene::circle).
    pub circle: BallCircle,
    /// Orientation, pattern to camera frame.
    pub rotation: Rotation,
    /// Spin, camera frame, rad/s.
    pub spin: Vec3,
    /// As [`Scene::shift_px`](super::scene::Scene::shift_px).
    pub shift_px: [f64; 2],
}

impl BallImage {
    /// Whether it hides the other where both are seen.
    pub(super) fn hides(&self, of: ImageOf, circle: &BallCircle) -> bool {
        self.of.flash == of.flash && self.circle.radius > circle.radius
    }
}
