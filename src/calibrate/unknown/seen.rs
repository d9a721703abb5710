//! What a frame shows: the detections that are likely dots and face the camera.

use crate::geometry::Vec3;
use crate::recognize::DotUncertainty;
use crate::vision::FrameEstimate;
use crate::vision::camera::{BallView, Camera};
use crate::vision::estimator::{CameraModel, Outline};

/// Minimum confidence of the detections used.
const LIKELY: f64 = 0.5;
/// Minimum depth (z over the horizon) of a detection that is used.
pub(super) const MIN_DEPTH: f64 = 0.2;
/// Error of a direction beyond the detector's, radians: the camera's distance is not known yet.
const BASE_SIGMA_RAD: f64 = 0.02;

/// A frame's usable detections.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    /// Its place in the clip.
    pub index: usize,
    pub outline: Outline,
    view: BallView,
    pub dots: Vec<SeenDot>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct SeenDot {
    pub detection: usize,
    /// Camera frame.
    pub direction: Vec3,
    pub depth: f64,
    pub sigma_rad: f64,
}

impl Seen {
    pub fn new(index: usize, estimate: &FrameEstimate, camera: &CameraModel) -> Option<Self> {
        let outline = estimate.outline?;
        let camera = match *camera {
            CameraModel::Known(camera) => camera,
            CameraModel::Unknown(prior) => Camera::Near {
                inverse_distance: prior.inverse_distance,
            },
        };
        let view = BallView::new(&camera, outline.circle).ok()?;
        let likely = estimate.dots.iter().enumerate();
        let likely = likely.filter(|(_, dot)| dot.confidence >= LIKELY);
        let dots = likely.filter_map(|(detection, dot)| {
            let seen = view.back_project(dot.pixel, &dot.covariance)?;
            let depth = (seen.direction.z - view.horizon()) / (1.0 - view.horizon());
            let variance = match seen.uncertainty {
                DotUncertainty::Isotropic { sigma_rad } => sigma_rad * sigma_rad,
                DotUncertainty::Tangent { covariance } => 0.5 * covariance.trace(),
            };
            (depth >= MIN_DEPTH).then_some(SeenDot {
                detection,
                direction: view.to_camera() * seen.direction,
                depth,
                sigma_rad: (variance + BASE_SIGMA_RAD * BASE_SIGMA_RAD).sqrt(),
            })
        });
        Some(Self {
            index,
            outline,
            view,
            dots: dots.collect(),
        })
    }

    /// How far a direction of the camera's frame faces the camera.
    pub fn depth(&self, direction: &Vec3) -> f64 {
        let z = (self.view.to_camera().inverse() * direction).z;
        (z - self.view.horizon()) / (1.0 - self.view.horizon())
    }
}
