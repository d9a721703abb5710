//! Frames whose orientation is fitted: where their detections lie on the ball.

use crate::geometry::{Rotation, Vec3};
use crate::vision::camera::BallView;
use crate::vision::estimator::CameraModel;
use crate::vision::{Camera, FrameEstimate};

/// Detections less likely dots than this say nothing of a mark.
const LIKELY: f64 = 0.5;

/// A frame with its orientation.
#[derive(Debug, Clone)]
pub(super) struct FittedFrame {
    /// Its position in the clip.
    pub index: usize,
    view: BallView,
    /// Pattern to view frame.
    to_view: Rotation,
}

/// All frames that took part in a fit.
pub(super) type FittedFrames = [FittedFrame];

impl FittedFrame {
    /// A frame with a pose; `None` without one.
    pub fn new(index: usize, frame: &FrameEstimate, camera: &CameraModel) -> Option<Self> {
        let pose = frame.pose()?;
        let camera = match (pose.distance, *camera) {
            (Some(distance), _) => Camera::Near {
                inverse_distance: distance.inverse_distance,
            },
            (None, CameraModel::Known(camera)) => camera,
            (None, CameraModel::Unknown(prior)) => Camera::Near {
                inverse_distance: prior.inverse_distance,
            },
        };
        let view = BallView::new(&camera, frame.circle?).ok()?;
        Some(Self {
            index,
            view,
            to_view: view.to_camera().inverse() * pose.rotation,
        })
    }

    /// Gives the frame another orientation, pattern to camera.
    pub fn turn_to(&mut self, rotation: &Rotation) {
        self.to_view = self.view.to_camera().inverse() * rotation;
    }

    /// How far a direction (pattern frame) faces the camera: its z, taken from the horizon up so that
    /// 0 is the limb and 1 the middle.
    pub fn depth(&self, direction: &Vec3) -> f64 {
        let horizon = self.view.horizon();
        ((self.to_view * direction).z - horizon) / (1.0 - horizon)
    }

    /// The likely dots without a name: their place in `frame.dots` and their direction, pattern frame.
    pub fn unnamed<'a>(
        &'a self,
        frame: &'a FrameEstimate,
    ) -> impl Iterator<Item = (usize, Vec3)> + 'a {
        let dots = frame.dots.iter().zip(&frame.assignment).enumerate();
        dots.filter(|(_, (dot, name))| name.is_none() && dot.confidence >= LIKELY)
            .filter_map(|(i, (dot, _))| {
                let direction = self.view.direction(dot.pixel)?;
                Some((i, self.to_view.inverse() * direction))
            })
    }
}
