//! What a frame shows: the detections that face the camera.

use crate::calibrate::bundle::FrameView;
use crate::geometry::{Rotation, Vec3};
use crate::recognize::DotUncertainty;
use crate::vision::dots::detector::LIKELY_DOT;
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::BallView;
use crate::vision::{DotDetection, FrameEstimate};

/// Minimum depth (z over the horizon) of a detection that is used.
pub(super) const MIN_DEPTH: f64 = 0.08;
/// Error of a direction beyond the detector's, radians: the camera's distance is not known yet.
const BASE_SIGMA_RAD: f64 = 0.02;

/// A frame's usable detections; a [`FittedFrame`](crate::calibrate::fitted::FittedFrame) has an orientation besides.
#[derive(Debug, Clone)]
pub(super) struct UsableFrame {
    /// Its place in the clip.
    pub index: usize,
    pub outline: Outline,
    view: FrameView,
    pub dots: Vec<SeenDot>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct SeenDot {
    pub detection: usize,
    /// Camera frame.
    pub direction: Vec3,
    pub depth: f64,
    pub sigma_rad: f64,
    /// Whether it is more likely a dot than not: others are named where the map has a dot, and nothing is built on them.
    pub is_likely: bool,
}

impl UsableFrame {
    pub fn new(index: usize, estimate: &FrameEstimate, camera: &CameraModel) -> Option<Self> {
        let outline = estimate.outline?;
        let view = BallView::new(&camera.at(None), outline.circle).ok()?;
        let view = FrameView::of(view);
        let dots = estimate.dots.iter().enumerate();
        let dots = dots.filter_map(|(k, dot)| see(&view, k, dot));
        Some(Self {
            index,
            outline,
            dots: dots.filter(|dot| dot.depth >= MIN_DEPTH).collect(),
            view,
        })
    }

    /// Its detections that are likely dots, with their places in `dots`.
    pub fn likely(&self) -> impl Iterator<Item = (usize, &SeenDot)> {
        self.dots.iter().enumerate().filter(|(_, d)| d.is_likely)
    }

    /// The same detections, seen as `view` says now.
    pub fn look(&mut self, view: FrameView, estimate: &FrameEstimate) {
        self.view = view;
        for dot in &mut self.dots {
            let again = see(&view, dot.detection, &estimate.dots[dot.detection]);
            // What is no more on the ball stays where it was.
            *dot = again.unwrap_or(*dot);
        }
    }

    /// How the ball is seen.
    pub fn view(&self) -> BallView {
        self.view.view
    }

    /// The camera's frame to the view's.
    pub fn to_view(&self) -> Rotation {
        self.view.to_view
    }

    /// How far a direction of the camera's frame faces the camera: see [`FrameView::depth`].
    pub fn depth(&self, direction: &Vec3) -> f64 {
        self.view.depth(direction)
    }
}

fn see(frame: &FrameView, detection: usize, dot: &DotDetection) -> Option<SeenDot> {
    let seen = frame.view.back_project(dot.pixel, &dot.covariance)?;
    let variance = match seen.uncertainty {
        DotUncertainty::Isotropic { sigma_rad } => sigma_rad * sigma_rad,
        DotUncertainty::Tangent { covariance } => 0.5 * covariance.trace(),
    };
    let direction = frame.to_view.inverse() * seen.direction;
    Some(SeenDot {
        detection,
        direction,
        depth: frame.depth(&direction),
        is_likely: dot.probability >= LIKELY_DOT,
        sigma_rad: (variance + BASE_SIGMA_RAD * BASE_SIGMA_RAD).sqrt(),
    })
}
