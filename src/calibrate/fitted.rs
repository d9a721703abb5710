//! Frames whose orientation is fitted: where their detections lie on the ball.

use super::bundle::FrameView;
use crate::geometry::{Rotation, Vec3};
use crate::vision::FrameEstimate;
use crate::vision::dots::detector::LIKELY_DOT;
use crate::vision::frame::config::CameraModel;

/// A frame with its orientation.
#[derive(Debug, Clone)]
pub(super) struct FittedFrame {
    /// Its position in the clip.
    pub index: usize,
    pub view: FrameView,
    /// Pattern to camera frame.
    pub rotation: Rotation,
}

/// All frames that took part in a fit.
pub(super) type FittedFrames = [FittedFrame];

impl FittedFrame {
    /// A frame with a pose; `None` without one.
    pub fn new(index: usize, frame: &FrameEstimate, camera: &CameraModel) -> Option<Self> {
        Some(Self {
            index,
            view: FrameView::of(camera.view_of(frame)?),
            rotation: frame.pose()?.rotation,
        })
    }

    /// Gives the frame another orientation, pattern to camera.
    pub fn turn_to(&mut self, rotation: &Rotation) {
        self.rotation = *rotation;
    }

    /// How far a direction (pattern frame) faces the camera: see [`FrameView::depth`].
    pub fn depth(&self, direction: &Vec3) -> f64 {
        self.view.depth(&(self.rotation * direction))
    }

    /// The likely dots without a name: their place in `frame.dots` and their direction, pattern frame.
    pub fn unnamed<'a>(
        &'a self,
        frame: &'a FrameEstimate,
    ) -> impl Iterator<Item = (usize, Vec3)> + 'a {
        let dots = frame.dots.iter().zip(&frame.assignment).enumerate();
        dots.filter(|(_, (dot, name))| name.is_none() && dot.probability >= LIKELY_DOT)
            .filter_map(|(i, (dot, _))| {
                let direction = self.view.direction(dot.pixel)?;
                Some((i, self.rotation.inverse() * direction))
            })
    }
}
