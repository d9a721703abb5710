//! A pose's dots by the image's own pixels.
//!
//! The net sees a ball in 64 x 64 cells, whatever the image holds of it. Once the dots have names, each is fitted as a
//! [cap](crate::vision::dots::cap) in the image, and the pose is refined on these places. How far the dots are drawn from the
//! pattern's is then estimated with it: well-drawn dots give center, radius and distance better than the outline does.
//!
//! Where the intrinsics are known, the outline alone says where the ball is, too: that stands where the orientation is rejected.

use std::time::Instant;

use super::refine::Drawn;
use crate::geometry::Rotation;
use crate::image::ImageView;
use crate::vision::dots::cap::CapShape;
use crate::vision::dots::detector::DotDetection;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::{FrameEstimate, Pose, PrincipalPointPrior};
use crate::vision::frame::outline::Outline;
use crate::vision::frame::position;
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallCircle, BallView, Camera, Pixel};
use crate::vision::optics::crop::Images;
use crate::vision::optics::grid::Grid;
use crate::vision::optics::oval::Oval;
use crate::vision::outline::place::{FOR_OUTLINE, Place};
use crate::vision::outline::rim::RimShape;

/// Dots that face the camera less than this may lie over the rim; around them so many deviations of their blur are hidden.
const AT_RIM: f64 = 0.5;
const AROUND_DOT: f64 = 1.5;
/// What is read of the image, outline radii.
const REACH: f64 = 1.25;
/// A dot farther from where it was detected than so many standard deviations, the drawn one's included, is another thing.
const MOVED: f64 = 4.0;
/// An outline that the dots moved by more than this, radii, is read again: what is read of it would no longer be the ball's.
const FAR: f64 = 0.03;
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
        let mut rim = None;
        if !ws.spending.is_late() {
            match out.outcome {
                Ok(pose) => rim = self.sharpen_pose(&pose, image, ws, out),
                Err(_) => rim = self.rim_of(image, ws, out),
            }
        }
        self.locate(rim, out);
        out.timings.identify += begun.elapsed();
    }

    /// The same of a frame with a pose; the outline by the image's rim, where it was found and is clear.
    fn sharpen_pose(
        &self,
        pose: &Pose,
        image: ImageView<'_>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<Outline> {
        let outline = out.outline.map(|outline| outline.circle);
        out.axis = outline.and_then(|circle| {
            PrincipalPointPrior::of_picture(image.width(), image.height(), &circle)
        });
        let found = out.circle;
        let rim = match self.sharpen_once(pose, image, ws, out) {
            Ok(rim) => rim,
            Err(rim) => return rim,
        };
        let both = found.zip(out.circle);
        if !both.is_some_and(|(from, to)| is_far(&from, &to)) {
            return rim;
        }
        // The dots have shown that the outline was not the ball's: dots and rim are read about the ball.
        let oval = out.oval;
        self.sharpen_once(pose, image, ws, out).unwrap_or_else(|_| {
            out.oval = oval;
            None
        })
    }

    /// Reads dots and rim in the image, and refines the pose on them; the rim. An error where the pose cannot be refined: then the frame
    /// stays as it was, but for what the rim says.
    fn sharpen_once(
        &self,
        pose: &Pose,
        image: ImageView<'_>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Result<Option<Outline>, Option<Outline>> {
        let mut before = std::mem::take(&mut ws.within);
        before.copy_from(out);
        let seen = self.place_by_pixels(&pose.rotation, image, ws, out);
        let refined = seen.and_then(|rim| self.refine_sharpened(pose, rim, ws, out));
        if refined.is_none() {
            std::mem::swap(&mut before, out);
            out.oval = before.oval;
        }
        ws.within = before;
        let rim = seen.flatten().map(|(outline, _)| outline);
        refined.map(|()| rim).ok_or(rim)
    }

    /// The outline by the image's rim, where it was found and is clear, of a frame without a pose whose camera is known.
    fn rim_of(
        &self,
        image: ImageView<'_>,
        ws: &mut EstimatorWorkspace,
        out: &FrameEstimate,
    ) -> Option<Outline> {
        let outline = out.outline.filter(|o| !o.is_given())?;
        let camera = Camera::Perspective(self.intrinsics()?);
        let view = BallView::new(&camera, outline.circle).ok()?;
        let pixels = pixels_about(image, &view, &mut ws.images)?;
        let shape = match out.fit {
            Some(fit) => {
                let (_, level) = Place::Near(outline.circle).part(&image, FOR_OUTLINE)?;
                CapShape::of_edge(fit.edge_width, Grid::halved(level).side)
            }
            None => CapShape::first(0.0, &view),
        };
        let rim = ws.rim.fit(
            &pixels,
            (RimShape::AsViewed, &shape),
            ws.covers.iter().copied(),
        )?;
        let seen = rim.correct(&outline.circle, &outline);
        Some(seen.with_size_error())
    }

    /// Where the ball is by its outline alone, or as the rim has it, where the intrinsics are known.
    pub(crate) fn locate(&self, rim: Option<Outline>, out: &mut FrameEstimate) {
        let found = out.outline.map(|o| o.with_model_error().with_size_error());
        let seen = rim.or(found);
        out.outline_position = seen
            .zip(self.intrinsics())
            .and_then(|(outline, k)| position::of_outline(&outline, k, self.ball_radius_m));
    }

    /// The outline by the image's rim, where it was found and is clear, and how far it is drawn out where the camera is unknown; `None` where no dot is.
    fn place_by_pixels(
        &self,
        pose: &Rotation,
        image: ImageView<'_>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<Option<(Outline, Option<Oval>)>> {
        let view = self.view(out)?;
        let pixels = pixels_about(image, &view, &mut ws.images)?;
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
        let outlines = match self.config.camera {
            CameraModel::Unknown(_) => RimShape::DrawnOut,
            CameraModel::Known(_) => RimShape::AsViewed,
        };
        let rim = shape.filter(|_| is_found).and_then(|shape| {
            let dots = self.dots_at_rim(pose, &view, &shape);
            let hidden = dots.chain(ws.covers.iter().copied());
            ws.rim.fit(&pixels, (outlines, &shape), hidden)
        });
        let oval = rim.and_then(|rim| rim.oval);
        let oval = oval.filter(|_| self.intrinsics().is_some());
        out.oval = oval.map(|oval| (*view.circle(), oval));
        let corrected = rim.zip(out.outline);
        let corrected = corrected.map(|(rim, outline)| match outlines {
            RimShape::DrawnOut => rim.correct_drawn_out(view.circle(), &outline),
            RimShape::AsViewed => (self.sized(rim.correct(view.circle(), &outline)), None),
        });
        is_any.then_some(corrected)
    }

    /// An outline with the error of its size, where that says how far the ball is.
    fn sized(&self, outline: Outline) -> Outline {
        match self.intrinsics() {
            Some(_) => outline.with_size_error(),
            None => outline,
        }
    }

    /// Where the pattern's dots lie over the rim, with their blur.
    fn dots_at_rim(
        &self,
        pose: &Rotation,
        view: &BallView,
        shape: &CapShape,
    ) -> impl Iterator<Item = BallCircle> {
        let turn = view.to_camera().inverse() * pose;
        let radius = shape.radius * view.circle().radius + AROUND_DOT * shape.blur + 1.0;
        let turned = self.ball.pattern().dots().iter().map(move |dot| turn * dot);
        let at_rim = turned.filter(move |dot| (-shape.radius..AT_RIM).contains(&dot.z));
        at_rim.map(move |dot| BallCircle::new(view.project(&dot), radius))
    }

    fn refine_sharpened(
        &self,
        pose: &Pose,
        rim: Option<(Outline, Option<Oval>)>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<()> {
        let view = self.view(out)?;
        let (outline, oval) = match rim {
            Some(rim) => rim,
            None => (self.sized(out.outline?.with_model_error()), None),
        };
        let camera = self.config.camera.at(pose.distance);
        let rotation = view.to_camera().inverse() * pose.rotation;
        let matched = out.matched() as f64;
        let refined = self.refined(&rotation, camera, (&outline, oval), Drawn::AsSeen, ws, out)?;
        if (out.matched() as f64) < (1.0 - MOST_LOST) * matched {
            return None;
        }
        out.circle = Some(*refined.view.circle());
        out.outcome = Ok(refined.of(pose));
        Some(())
    }
}

/// Whether an outline is no longer the same.
fn is_far(from: &BallCircle, to: &BallCircle) -> bool {
    let moved = (from.center.u - to.center.u).hypot(from.center.v - to.center.v);
    moved.max((from.radius - to.radius).abs()) > FAR * to.radius
}

/// The pixels about a ball.
fn pixels_about<'a>(
    image: ImageView<'a>,
    view: &'a BallView,
    images: &'a mut Images,
) -> Option<BallPixels<'a>> {
    let part = view.circle().region(REACH, image.width(), image.height())?;
    let (gray, grid) = match image {
        ImageView::Gray(gray) => (gray, Grid::halved(0)),
        _ => {
            image.shrink_into(&part, 0, &mut images.gray);
            (&images.gray, Grid::of(&part, 0))
        }
    };
    Some(BallPixels { gray, grid, view })
}

/// Whether a place may be that of the detection.
fn is_near(dot: &DotDetection, at: Pixel) -> bool {
    let off = nalgebra::Vector2::new(at.u - dot.pixel.u, at.v - dot.pixel.v);
    let inverse = dot.covariance.try_inverse();
    inverse.is_some_and(|inverse| off.dot(&(inverse * off)) < MOVED * MOVED)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;

    use super::*;

    #[test]
    fn a_dot_by_its_pixels_lies_within_four_deviations_of_its_detection() {
        // 0.5 px along u, 2 px along v.
        let dot = DotDetection {
            pixel: Pixel { u: 30.0, v: 40.0 },
            covariance: Matrix2::new(0.25, 0.0, 0.0, 4.0),
            probability: 0.9,
        };
        let at = |u: f64, v: f64| is_near(&dot, Pixel { u, v });
        assert!(at(31.9, 40.0) && at(30.0, 47.9) && at(28.6, 45.0));
        assert!(!at(32.1, 40.0) && !at(30.0, 31.9) && !at(31.9, 44.0));
    }
}
