//! A pose's dots by the image's own pixels.
//!
//! The net sees a ball in 64 x 64 cells, whatever the image holds of it. Once the dots have names, each is fitted as a
//! [cap](crate::vision::cap) in the image, and the pose is refined on these places. How far the dots are drawn from the
//! pattern's is then estimated with it: well-drawn dots tell center, radius and distance better than the outline does.

use std::time::Instant;

use super::frame::Pose;
use super::refine::Drawn;
use super::{Camera, CameraModel, Estimator, EstimatorWorkspace, FrameEstimate};
use crate::image::ImageView;
use crate::vision::camera::Pixel;
use crate::vision::detect::{DotDetection, DotDetector};

/// What is read of the image, outline radii.
const REACH: f64 = 1.1;
/// A dot farther from where it was detected than so many standard deviations, the drawn one's included, is another thing.
const MOVED: f64 = 4.0;
/// Standard deviation of what the limb's shading and the camera's tone curve do to the radius of an outline that was found, pixels:
/// 0.26 with balls of any size (`bench limit`).
const RADIUS_PX: f64 = 0.2;
/// Where more than this part of the names is lost on the sharpened dots, these are other things.
const MOST_LOST: f64 = 0.25;

impl<D: DotDetector> Estimator<D> {
    /// Places the named dots of a frame by the image's pixels, and refines the pose on them. Dots that the pixels do not show
    /// stay as they were detected.
    pub(super) fn sharpen(
        &self,
        image: ImageView<'_>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let begun = Instant::now();
        if let Ok(pose) = out.outcome {
            ws.detected.clone_from(&out.dots);
            ws.named.clone_from(&out.assignment);
            let is_better = self.place_by_pixels(image, ws, out)
                && self.refine_sharpened(&pose, ws, out).is_some();
            if !is_better {
                out.dots.clone_from(&ws.detected);
                out.assignment.clone_from(&ws.named);
            }
        }
        out.timings.identify += begun.elapsed();
    }

    /// Whether any dot is.
    fn place_by_pixels(
        &self,
        image: ImageView<'_>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> bool {
        let Some(view) = self.view(out) else {
            return false;
        };
        let part = view.circle().region(REACH, image.width(), image.height());
        let Some(part) = part else {
            return false;
        };
        image.shrink_into(&part, 0, &mut ws.images.gray);
        let origin = Pixel {
            u: part.left as f64,
            v: part.top as f64,
        };
        let (mut shape, mut is_any) = (None, false);
        let named = out.dots.iter_mut().zip(&out.assignment);
        for (dot, _) in named.filter(|(_, name)| name.is_some()) {
            let gray = &ws.images.gray;
            let Some(cap) = ws.caps.fit(gray, origin, &view, dot.pixel, shape) else {
                continue;
            };
            shape = Some(cap.shape);
            if is_near(dot, cap.pixel) {
                (dot.pixel, dot.covariance) = (cap.pixel, cap.covariance);
                is_any = true;
            }
        }
        is_any
    }

    fn refine_sharpened(
        &self,
        pose: &Pose,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> Option<()> {
        let (mut outline, view) = (out.outline?, self.view(out)?);
        if !outline.is_given() {
            outline.covariance[(2, 2)] += RADIUS_PX * RADIUS_PX;
        }
        let camera = match self.config.camera {
            CameraModel::Known(camera) => camera,
            CameraModel::Unknown(_) => Camera::Near {
                inverse_distance: view.horizon(),
            },
        };
        let rotation = view.to_camera().inverse() * pose.rotation;
        let matched = out.matched() as f64;
        let refined = self.refined(&rotation, camera, &outline, Drawn::AsSeen, ws, out)?;
        if (out.matched() as f64) < (1.0 - MOST_LOST) * matched {
            return None;
        }
        out.circle = Some(*refined.view.circle());
        out.outcome = Ok(refined.of(pose));
        Some(())
    }
}

/// Whether a place may be that of the detection.
fn is_near(dot: &DotDetection, at: Pixel) -> bool {
    let off = nalgebra::Vector2::new(at.u - dot.pixel.u, at.v - dot.pixel.v);
    let inverse = dot.covariance.try_inverse();
    inverse.is_some_and(|inverse| off.dot(&(inverse * off)) < MOVED * MOVED)
}
