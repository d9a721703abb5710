//! A frame's way from pixels to an answer: outlines are tried, the likeliest first, until the dots are
//! clear.
//!
//! The ball may be looked for in a whole image, in a part of it, or near a circle that is known roughly:
//! then its surroundings are cut out and nothing else is looked at. In a large image [rough circles](super::acquire)
//! are tried first; the thorough search follows only where none of
//! them is a ball by its dots, in very large images [at a smaller scale](super::shrunk).
//!
//! Guarantees: outlines and dots are given in the pixels of the whole image, whatever part of it was
//! looked at. An outline beside the first needs a clear pose by dots that are likely ones.

use std::time::Instant;

use super::acquire::Hunt;
use super::frame::Standing;
use super::identify::Detections;
use super::locate::{Candidate, Shape};
use super::prior::{Budget, Follows, OutlinePrior, Prior, SearchDepth, Spending};
use super::shrunk::MAX_THOROUGH;
use super::{
    CLEAR, EXPECTED_DOTS, Estimator, EstimatorWorkspace, FrameEstimate, FrameRejection, Outline,
    OutlineSource, PROMISING, Pose, is_mirrored,
};
use crate::image::{GrayImage, ImageView, RgbImage, Roi};
use crate::recognize::Hint;
use crate::vision::camera::{BallCircle, Pixel};
use crate::vision::circle::{NoBall, WHOLE};
use crate::vision::detect::{DotDetector, LIKELY_DOT};
use crate::vision::grid::Grid;

/// A ball that is not where it is expected is looked for within so many radii, if it may be so far off.
pub(super) const NEARBY: f64 = 4.5;
/// Minimum number of such dots in the pose of an outline that is not whole enough for a ball.
const MIN_LIKELY_DOTS: usize = 5;
/// Poses from here on are all but certain.
const CERTAIN: f64 = 0.99;
/// What is cut out around a rough circle, in radii: what the net for outlines sees, and a rough circle's error.
const SURROUNDINGS: f64 = 1.8;
/// Larger balls, radii in pixels, are looked at at a smaller scale: it has all that the detectors see.
const MAX_NEAR: f64 = 250.0;
/// Images with a longer side beyond this, pixels, are searched at a coarse scale first.
pub(super) const LARGE: usize = 240;
/// How much finer a very large image is searched: for balls of 40 pixels in one of 3840 x 2160.
const HALVINGS: u32 = 2;

/// The images that a frame is converted into; their memory is reused.
#[derive(Debug, Default)]
pub(super) struct Images {
    /// A part of the frame, or the frame itself where it came as bytes.
    part_gray: GrayImage,
    part_color: RgbImage,
    /// Gray of a part in colors.
    pub gray: GrayImage,
}

/// A part of a frame, converted.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a> {
    pub image: ImageView<'a>,
    pub gray: &'a GrayImage,
    /// Where its pixels lie in the frame.
    pub grid: Grid,
    /// Columns and rows of the frame.
    pub size: [usize; 2],
}

impl View<'_> {
    /// The middle of the frame, in pixels of the view.
    fn middle(&self) -> Pixel {
        let [width, height] = self.size.map(|s| 0.5 * (s as f64 - 1.0));
        self.grid.pixel_to_part(Pixel {
            u: width,
            v: height,
        })
    }
}

/// How often a length is halved until it is no more than another.
pub(super) fn level_of(length: f64, most: f64) -> u32 {
    (length / most).log2().ceil().max(0.0) as u32
}

/// Where the outline is looked for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Place<'a> {
    /// It is known, in the frame's pixels.
    Known(&'a Outline),
    /// It is near a circle, in the frame's pixels.
    Near(&'a BallCircle),
    /// It is anywhere in the view.
    Anywhere,
}

impl<D: DotDetector> Estimator<D> {
    /// Estimates a frame. Outlines are proposed where the prior expects the ball, the likeliest first; dots are found within
    /// and identified, until a pose is clear or the budget is spent.
    ///
    /// A region of the prior that lies beyond the image is cut; where nothing of it is left, there is no ball.
    pub fn estimate<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        prior: &Prior,
        budget: &Budget,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let image = image.into();
        ws.spending = Spending::of(*budget);
        if prior.follows == Follows::Nothing {
            ws.coarse.forget();
            ws.fine.forget();
        }
        let hint = prior.rotation.as_ref();
        let outline = prior.outline.as_ref();
        let region = match prior.region {
            Some(region) => region.cut(image.width(), image.height()),
            None => Roi::whole(image.width(), image.height()).cut(image.width(), image.height()),
        };
        match (outline.map(|o| (o, o.believed())), region) {
            (Some((_, Some(known))), _) => self.estimate_known(image, &known, hint, ws, out),
            (Some((expected, None)), region) => {
                self.estimate_expected(image, expected, region.as_ref(), hint, ws, out);
            }
            (None, Some(region)) if region.width.min(region.height) >= self.min_side() => {
                self.estimate_region(image, &region, hint, ws, out);
            }
            (None, region) => {
                out.clear();
                let (width, height) = region.map_or((0, 0), |r| (r.width, r.height));
                out.outcome = Err(FrameRejection::NoBall(NoBall::TooSmall { width, height }));
            }
        }
        out.attempts = ws.spending.runs;
        if out.outcome.is_err() && !is_mirrored(out) && ws.spending.is_late() {
            out.outcome = Err(FrameRejection::OutOfTime);
        }
        self.sharpen(image, ws, out);
    }

    /// Finds the ball, unless its outline is given, and the dots on it.
    pub fn detect<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        outline: Option<&OutlinePrior>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let image = image.into();
        ws.spending = Spending::default();
        let known = outline.and_then(OutlinePrior::believed);
        let place = match (&known, outline) {
            (Some(known), _) => Place::Known(known),
            (None, Some(expected)) => Place::Near(&expected.circle),
            (None, None) => Place::Anywhere,
        };
        let whole = Roi::whole(image.width(), image.height());
        self.viewed(image, &whole, ws, |view, ws| {
            self.detect_in(view, place, Standing::Likely, ws, out);
        });
    }

    /// The smallest side, pixels, of an image that is searched.
    fn min_side(&self) -> usize {
        (self.config.circle.min_radius_px as usize).max(1)
    }

    /// Estimates a frame whose outline is known.
    fn estimate_known(
        &self,
        image: ImageView<'_>,
        outline: &Outline,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let (width, height) = (image.width(), image.height());
        let part = match image {
            ImageView::Raw(_) => outline.circle.region(SURROUNDINGS, width, height),
            _ => None,
        };
        let part = part.unwrap_or(Roi::whole(width, height));
        self.viewed(image, &part, ws, |view, ws| {
            self.detect_in(view, Place::Known(outline), Standing::Likely, ws, out);
            self.identify_looking_again(view, hint, ws, out);
        });
    }

    /// Estimates a frame whose ball is expected near a circle: there, then as far around as it may be.
    fn estimate_expected(
        &self,
        image: ImageView<'_>,
        expected: &OutlinePrior,
        region: Option<&Roi>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        self.search_near(image, &expected.circle, Standing::Likely, hint, ws, out);
        let is_lost = expected.reach() == f64::INFINITY;
        // A ball whose rim is seen there is not elsewhere.
        let is_there = out.fit.is_some_and(|f| f.support >= WHOLE) && !is_lost;
        if out.pose().is_some() || is_there || expected.reach() < SURROUNDINGS {
            return;
        }
        let mut farther = std::mem::take(&mut ws.farther);
        let hunt = Hunt::nearby(&expected.circle, expected.reach().min(NEARBY), &image);
        ws.coarse.forget();
        if hunt.is_some_and(|hunt| self.acquire(image, &hunt, hint, ws, &mut farther)) {
            std::mem::swap(&mut farther, out);
        } else if let Some(region) = region.filter(|_| is_lost) {
            ws.coarse.forget();
            self.estimate_region(image, region, hint, ws, &mut farther);
            if farther.pose().is_some() || out.outline.is_none() {
                std::mem::swap(&mut farther, out);
            }
        }
        ws.farther = farther;
    }

    /// Estimates a frame with the ball somewhere in a part of it.
    fn estimate_region(
        &self,
        image: ImageView<'_>,
        part: &Roi,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let is_large = part.width.max(part.height) > LARGE;
        if is_large && self.acquire(image, &Hunt::everywhere(*part), hint, ws, out) {
            return;
        }
        let is_thorough = ws.spending.budget.search == SearchDepth::Thorough;
        let halvings = match part.width * part.height > MAX_THOROUGH {
            _ if !is_large => 0,
            _ if !is_thorough => 1,
            true => HALVINGS,
            false => 0,
        };
        for halvings in 1..=halvings {
            let hunt = Hunt::finer(*part, halvings);
            if ws.spending.is_late() || self.acquire(image, &hunt, hint, ws, out) {
                return;
            }
        }
        if is_large && (!is_thorough || ws.spending.is_late()) {
            return;
        }
        if part.width * part.height > MAX_THOROUGH {
            return self.estimate_shrunk(image, part, hint, ws, out);
        }
        self.viewed(image, part, ws, |view, ws| {
            self.try_outlines(view, Place::Anywhere, Standing::Likely, hint, ws, out);
        });
    }

    /// Estimates a frame by the surroundings of a circle: it is right to some tenth of the radius.
    pub(super) fn search_near(
        &self,
        image: ImageView<'_>,
        circle: &BallCircle,
        standing: Standing,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let (width, height) = (image.width(), image.height());
        let level = level_of(circle.radius, MAX_NEAR);
        let part = circle.region(SURROUNDINGS, width, height);
        let is_wide = |part: &Roi| part.width.min(part.height) >> level >= self.min_side();
        let Some(part) = part.filter(is_wide) else {
            out.clear();
            out.outcome = Err(FrameRejection::NoBall(NoBall::TooSmall { width, height }));
            return;
        };
        self.viewed_at(image, &part, level, ws, |view, ws| {
            self.try_outlines(view, Place::Near(circle), standing, hint, ws, out);
        });
    }

    /// Hands a part of a frame to `work`, converted. The workspace's images are away meanwhile.
    fn viewed(
        &self,
        image: ImageView<'_>,
        part: &Roi,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        work: impl FnOnce(View<'_>, &mut EstimatorWorkspace<D::Workspace>),
    ) {
        self.viewed_at(image, part, 0, ws, work);
    }

    /// As [`Estimator::viewed`], of an image that is halved so often.
    pub(super) fn viewed_at(
        &self,
        image: ImageView<'_>,
        part: &Roi,
        level: u32,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        work: impl FnOnce(View<'_>, &mut EstimatorWorkspace<D::Workspace>),
    ) {
        let mut images = std::mem::take(&mut ws.images);
        let is_whole = *part == Roi::whole(image.width(), image.height());
        let (gray, color) = (&mut images.part_gray, &mut images.part_color);
        let seen = match image {
            _ if level > 0 => image.shrunk(part, level, gray, color),
            ImageView::Gray(_) | ImageView::Color(_) if is_whole => image,
            _ => image.part(part, gray, color),
        };
        if let ImageView::Color(color) = seen {
            color.to_gray_into(&mut images.gray);
        }
        let view = View {
            image: seen,
            gray: match seen {
                ImageView::Gray(gray) => gray,
                _ => &images.gray,
            },
            grid: Grid::of(part, level),
            size: [image.width(), image.height()],
        };
        work(view, ws);
        ws.images = images;
    }

    /// Tries outlines, the likeliest first.
    fn try_outlines(
        &self,
        view: View<'_>,
        place: Place<'_>,
        standing: Standing,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        self.detect_in(view, place, standing, ws, out);
        self.identify_looking_again(view, hint, ws, out);
        let mut other = std::mem::take(&mut ws.other);
        // Motion, shadows and hands draw circles out, too: the dots decide.
        let round = ws.round.take().filter(|_| !is_mirrored(out));
        if let Some(candidate) = round.filter(|_| !ws.spending.is_over()) {
            self.try_outline(&candidate, view, hint, ws, out, &mut other);
            if is_better(&other, out) {
                std::mem::swap(&mut other, out);
            }
        }
        while !(ws.spending.is_over() || is_mirrored(out)) {
            let Some(candidate) = ws.locator.contested() else {
                break;
            };
            self.try_outline(&candidate, view, hint, ws, out, &mut other);
            let is_pose = is_better(&other, out) && (out.pose().is_some() || is_evident(&other));
            if is_pose || is_mirrored(&other) {
                std::mem::swap(&mut other, out);
            }
        }
        let is_open = |out: &FrameEstimate| out.pose().is_none() && !is_mirrored(out);
        let mut start = 0;
        while standing == Standing::Likely && is_open(out) && !ws.spending.is_over() {
            let net = self.outline_net.as_ref();
            let Some(candidate) = ws.locator.other(view.gray, net, &mut start) else {
                break;
            };
            self.try_outline(&candidate, view, hint, ws, out, &mut other);
            if is_evident(&other) || is_mirrored(&other) {
                std::mem::swap(&mut other, out);
            }
        }
        out.attempts = ws.spending.runs;
        ws.other = other;
    }

    /// Estimates a frame on another outline than that of `first`, into `other`.
    fn try_outline(
        &self,
        candidate: &Candidate,
        view: View<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        first: &FrameEstimate,
        other: &mut FrameEstimate,
    ) {
        other.clear();
        other.outline = Some(candidate.outline);
        (other.circle, other.fit) = (Some(candidate.outline.circle), candidate.fit);
        other.standing = Standing::Doubtful;
        other.timings.locate = first.timings.locate;
        self.find_dots(view, candidate.shape, ws, other);
        if first.pose().is_some() {
            self.identify(Detections::All, ws, other);
        } else {
            self.identify_looking_again(view, hint, ws, other);
        }
    }

    /// Identifies the dots; where they leave doubt, the detector looks again; where that leaves doubt too, or the dots of a likely
    /// outline show another orientation than is expected, they are weighed with what is expected.
    fn identify_looking_again(
        &self,
        view: View<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let found = out.dots.iter().filter(|d| d.confidence >= LIKELY_DOT);
        let (found, needed) = (found.count(), MIN_LIKELY_DOTS);
        let is_doubtful = out.standing == Standing::Doubtful;
        if is_doubtful && out.outline.is_some() && found < needed {
            out.outcome = Err(FrameRejection::TooFewDots { found, needed });
            return;
        }
        if !self.detector.looks_again() {
            self.identify(Detections::All, ws, out);
        } else {
            self.identify(Detections::Likely, ws, out);
            let is_hopeless = is_doubtful && promise(out) < PROMISING;
            if !(out.is_settled() || is_hopeless || ws.spending.is_late()) {
                self.look_again(view, ws, out);
                let before = out.timings.identify;
                self.identify(Detections::All, ws, out);
                out.timings.identify += before;
                self.identify_densely(ws, out);
            }
        }
        if let Some(hint) = hint.filter(|_| !is_doubtful && !ws.spending.is_late()) {
            self.identify_expected(hint, ws, out);
        }
    }

    /// Finds the dots of the last patch anew, by the detector's second look.
    fn look_again(
        &self,
        view: View<'_>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let begun = Instant::now();
        let (dots, heat) = (&mut out.dots, &mut ws.heat);
        self.detector
            .look_again_into(&ws.patch, &mut ws.detector, dots, heat);
        if let Some(ball) = &ws.recentered {
            ball.camera.dots_to_image(dots);
        }
        out.place_dots(&view.grid);
        out.assignment.clear();
        out.assignment.resize(out.dots.len(), None);
        out.timings.detect += begun.elapsed();
    }

    /// Finds the ball in a view, unless its outline is given, and the dots on it.
    fn detect_in(
        &self,
        view: View<'_>,
        place: Place<'_>,
        standing: Standing,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let begun = Instant::now();
        out.clear();
        out.standing = standing;
        let grid = view.grid;
        let net = self.outline_net.as_ref();
        let found = match place {
            Place::Known(outline) => {
                out.outline_source = OutlineSource::Given;
                out.outline = Some(Outline {
                    circle: grid.circle_to_part(&outline.circle),
                    covariance: outline.covariance / (grid.side * grid.side),
                });
                None
            }
            Place::Anywhere => Some(ws.locator.find(view.gray, view.image, net)),
            Place::Near(circle) => {
                let rough = grid.circle_to_part(circle);
                Some(ws.locator.find_near(view.gray, view.image, &rough, net))
            }
        };
        match found {
            Some(Ok(found)) => {
                out.outline = Some(found.outline);
                out.fit = found.fit;
            }
            Some(Err(why)) => out.outcome = Err(FrameRejection::NoBall(why)),
            None => {}
        }
        out.circle = out.outline.map(|o| o.circle);
        out.timings.locate = begun.elapsed();
        self.find_dots(view, Shape::Free, ws, out);
    }

    /// Finds the dots within the outline; then all that was found is given in the frame's pixels.
    fn find_dots(
        &self,
        view: View<'_>,
        shape: Shape,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        out.dots.clear();
        out.dots.reserve(EXPECTED_DOTS);
        out.assignment.clear();
        out.assignment.reserve(EXPECTED_DOTS);
        ws.round = None;
        if let Some(outline) = out.outline {
            let begun = Instant::now();
            let fit = out.fit;
            let contrast = ws.locator.color_contrast();
            ws.recentered = match self.intrinsics() {
                Some(k) => {
                    let k = view.grid.intrinsics_to_part(&k);
                    ws.recentering.recenter(&k, view.gray, contrast, out)
                }
                None if shape == Shape::Circle => None,
                None => {
                    let middle = view.middle();
                    let found = ws
                        .recentering
                        .recenter_ellipse(middle, view.gray, contrast, out);
                    let is_round = !outline.circle.is_ellipse();
                    let circle = Candidate {
                        outline,
                        fit,
                        shape: Shape::Circle,
                    };
                    ws.round = (found.is_some() && is_round).then_some(circle);
                    found
                }
            };
            match ws.recentered {
                Some(ball) => ws.patch.cut_into(ws.recentering.image(), &ball.circle),
                None => ws.patch.cut_into(view.gray, &outline.circle),
            }
            self.detector
                .detect_into(&ws.patch, &mut ws.detector, &mut out.dots);
            if let Some(ball) = &ws.recentered {
                ball.camera.dots_to_image(&mut out.dots);
            }
            out.circle = out.outline.map(|o| o.circle);
            out.timings.detect = begun.elapsed();
        }
        out.place(&view.grid);
        out.assignment.resize(out.dots.len(), None);
    }
}

/// Whether the dots alone are evidence of a ball, where the circle is none: by the recognizer's own probability,
/// which leaves it to [`TrustMap`](super::TrustMap) what an accepted pose is worth; where all places were
/// weighed, there is no other than the map's.
pub(super) fn is_evident(frame: &FrameEstimate) -> bool {
    let last = frame.hypotheses().next_back().map(|h| &h.evidence);
    let of_dots = |pose: &Pose| match last {
        Some(evidence) if evidence.dense.is_none() => evidence.confidence,
        Some(_) => pose.confidence,
        None => pose.confidence,
    };
    let is_clear = frame.pose().is_some_and(|pose| of_dots(pose) >= CLEAR);
    is_clear && likely_dots(frame) >= MIN_LIKELY_DOTS
}

/// Whether the dots speak for `a`'s outline rather than for `b`'s: by the pose's probability and,
/// where both are all but certain, by how well the dots fit.
fn is_better(a: &FrameEstimate, b: &FrameEstimate) -> bool {
    match (a.pose(), b.pose()) {
        (Some(a), Some(b)) if a.confidence.min(b.confidence) >= CERTAIN => {
            a.residual_rad < b.residual_rad
        }
        (Some(a), Some(b)) => a.confidence > b.confidence,
        (a, _) => a.is_some(),
    }
}

/// The probability of a frame's pose, accepted or not.
pub(super) fn promise(frame: &FrameEstimate) -> f64 {
    match &frame.outcome {
        Ok(pose) => pose.confidence,
        Err(FrameRejection::Ambiguous { confidence }) => *confidence,
        Err(_) => 0.0,
    }
}

/// Number of identified dots that are more likely dots than not.
fn likely_dots(frame: &FrameEstimate) -> usize {
    let named = frame.dots.iter().zip(&frame.assignment);
    named
        .filter(|(dot, name)| dot.confidence >= LIKELY_DOT && name.is_some())
        .count()
}
