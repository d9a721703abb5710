//! A pose's dots by the image's own pixels.
//!
//! The net sees a ball in 64 x 64 cells, whatever the image holds of it. Once the dots have names, each is fitted as a
//! [cap](crate::vision::dots::cap) in the image, and the pose is refined on these places. How far the dots are drawn from the
//! pattern's is then estimated with it: well-drawn dots give center, radius and distance better than the outline does.

use std::time::Instant;

use super::refine::Drawn;
use crate::image::ImageView;
use crate::vision::dots::detector::DotDetection;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::{Axis, FrameEstimate, Pose};
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::Pixel;
use crate::vision::optics::grid::Grid;
use crate::vision::outline::rim::RimFit;

/// What is read of the image, outline radii.
const REACH: f64 = 1.25;
/// A dot farther from where it was detected than so many standard deviations, the drawn one's included, is another thing.
const MOVED: f64 = 4.0;
/// Standard deviations of what the limb's shading and the camera's tone curve do to center and radius of an outline that was found,
/// pixels: 0.13 and 0.26 with balls of 60 pixels (`bench limit`).
pub(crate) const OUTLINE_PX: [f64; 3] = [0.1, 0.1, 0.2];
/// Standard deviation of the radius of an outline that may be an ellipse, radii: off the axis by 5 degrees, the half axes differ
/// by 0.4 %.
const OVAL: f64 = 0.002;
/// Where more than this part of the names is lost on the sharpened dots, these are other things.
const MOST_LOST: f64 = 0.25;

impl Estimator {
    /// Places the named dots of a frame by the image's pixels, and refines the pose on them. Dots that the pixels do not show
    /// stay as they were detected.
    pub(crate) fn sharpen(
        &self,
        image: ImageView<'_>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        let begun = Instant::now();
        if let Ok(pose) = out.outcome
            && !ws.spending.is_late()
        {
            ws.detected.clone_from(&out.dots);
            ws.named.clone_from(&out.assignment);
            let outline = out.outline.map(|outline| outline.circle);
            out.axis =
                outline.and_then(|circle| Axis::of_picture(image.width(), image.height(), &circle));
            let seen = self.place_by_pixels(image, ws, out);
            let refined = seen.and_then(|rim| self.refine_sharpened(&pose, rim, ws, out));
            if refined.is_none() {
                out.dots.clone_from(&ws.detected);
                out.assignment.clone_from(&ws.named);
                out.blurs.clear();
            }
        }
        out.timings.identify += begun.elapsed();
    }

    /// The rim by the image's pixels, where it was found and is clear; `None` where no dot is.
    fn place_by_pixels(
        &self,
        image: ImageView<'_>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<Option<RimFit>> {
        let view = self.view(out)?;
        let part = view.circle().region(REACH, image.width(), image.height())?;
        let (gray, grid) = match image {
            ImageView::Gray(gray) => (gray, Grid::halved(0)),
            _ => {
                image.shrink_into(&part, 0, &mut ws.images.gray);
                (&ws.images.gray, Grid::of(&part, 0))
            }
        };
        let pixels = BallPixels {
            gray,
            grid,
            view: &view,
        };
        // What the dots that face the camera say of blur and tone curve, those near the rim need most.
        let off_middle = |i: &usize| {
            let (at, center) = (out.dots[*i].pixel, view.circle().center);
            (at.u - center.u).hypot(at.v - center.v)
        };
        ws.indices.clear();
        let named = out.assignment.iter().enumerate();
        ws.indices
            .extend(named.filter_map(|(i, name)| name.map(|_| i)));
        ws.indices
            .sort_unstable_by(|a, b| off_middle(a).total_cmp(&off_middle(b)));
        let (mut shape, mut is_any) = (None, false);
        out.blurs.clear();
        for &i in &ws.indices {
            let dot = &mut out.dots[i];
            let Some(cap) = ws.caps.fit(&pixels, dot.pixel, shape) else {
                continue;
            };
            shape = Some(cap.shape);
            if is_near(dot, cap.pixel) {
                (dot.pixel, dot.covariance) = (cap.pixel, cap.covariance);
                is_any = true;
                if self.config.measures_blur {
                    out.blurs.extend(ws.caps.blur(&view));
                }
            }
        }
        let is_found = out.outline.is_some_and(|o| !o.is_given());
        let rim = || ws.rim.fit(&pixels, &shape?);
        let rim = is_found.then(rim).flatten();
        let is_known = self.intrinsics().is_some();
        let oval = rim.and_then(|rim| rim.oval).filter(|_| is_known);
        out.oval = oval.map(|oval| (*view.circle(), oval));
        is_any.then_some(rim)
    }

    fn refine_sharpened(
        &self,
        pose: &Pose,
        rim: Option<RimFit>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<()> {
        let (mut outline, view) = (out.outline?, self.view(out)?);
        if let Some(rim) = rim {
            let found = view.circle();
            outline.circle.center.u = found.center.u + rim.change.x;
            outline.circle.center.v = found.center.v + rim.change.y;
            outline.circle.radius = found.radius + rim.change.z;
            outline.covariance = rim.covariance;
            if matches!(self.config.camera, CameraModel::Unknown(_)) {
                outline.covariance[(2, 2)] += (OVAL * found.radius).powi(2);
            }
        } else if !outline.is_given() {
            for (k, sigma) in OUTLINE_PX.into_iter().enumerate() {
                outline.covariance[(k, k)] += sigma * sigma;
            }
        }
        let camera = self.config.camera.at(pose.distance);
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
