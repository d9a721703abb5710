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

use nalgebra::Matrix3;

use super::acquire::Hunt;
use super::locate::Candidate;
use super::shrunk::MAX_THOROUGH;
use super::{
    CLEAR, EXPECTED_DOTS, Estimator, EstimatorWorkspace, FrameEstimate, FrameImage, FrameRejection,
    Outline, OutlineSource, Pose, is_mirrored,
};
use crate::recognize::Hint;
use crate::vision::camera::BallCircle;
use crate::vision::detect::DotDetector;
use crate::vision::image::{GrayImage, RgbImage};
use crate::vision::roi::{Grid, Roi};

/// Standard deviations of a given outline: of its center and radius, in radii.
const GIVEN_OUTLINE: f64 = 0.01;
/// Confidence of a detection that is more likely a dot than not.
pub(super) const LIKELY_DOT: f64 = 0.5;
/// Minimum number of such dots in the pose of an outline that is not whole enough for a ball.
const MIN_LIKELY_DOTS: usize = 5;
/// Poses from here on are all but certain.
const CERTAIN: f64 = 0.99;
/// What is cut out around a rough circle, in radii: what the net for outlines sees, and a rough circle's error.
const SURROUNDINGS: f64 = 1.8;
/// Larger balls, radii in pixels, are looked at at a smaller scale: it has all that the detectors see.
const MAX_NEAR: f64 = 250.0;
/// Images with a longer side beyond this, pixels, are searched at a coarse scale first.
pub(super) const LARGE: usize = 480;
/// How much finer a very large image is searched: for balls of 40 pixels in one of 3840 x 2160.
const HALVINGS: u32 = 2;

/// The images that a frame is converted into; their memory is reused.
#[derive(Debug, Default)]
pub(super) struct Images {
    /// A part of the frame, or the frame itself where it came as bytes.
    part_gray: GrayImage,
    part_color: RgbImage,
    /// Gray of a part in colors.
    gray: GrayImage,
}

/// A part of a frame, converted.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a> {
    pub image: FrameImage<'a>,
    pub gray: &'a GrayImage,
    /// Where its pixels lie in the frame.
    pub grid: Grid,
}

/// How often a length is halved until it is no more than another.
pub(super) fn level_of(length: f64, most: f64) -> u32 {
    (length / most).log2().ceil().max(0.0) as u32
}

/// Where the outline comes from.
#[derive(Debug, Clone, Copy)]
pub(super) enum Search<'a> {
    /// It is given, in the frame's pixels.
    Given(&'a BallCircle),
    /// It is anywhere in the view, and so many runs of the recognizer were made before.
    Everywhere(usize),
    /// It is near a circle, in the frame's pixels, and so many runs of the recognizer were made before.
    Near(&'a BallCircle, usize),
    /// As `Near`, but the circle is one of several that may be anything: one without dots is not worth much.
    Scan(&'a BallCircle, usize),
}

impl<D: DotDetector> Estimator<D> {
    /// Estimates a frame: [`Estimator::detect`], then [`Estimator::estimate_pose`]. Where that gives no answer, other outlines are tried: one on
    /// which the dots tell a clear pose is the ball's.
    pub fn estimate_frame<'a>(
        &self,
        image: impl Into<FrameImage<'a>>,
        circle: Option<&BallCircle>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let image = image.into();
        let whole = Roi::whole(image.width(), image.height());
        match circle {
            Some(circle) => self.estimate_given(image, circle, hint, ws, out),
            None => self.estimate_part(image, &whole, hint, ws, out),
        }
    }

    /// As [`Estimator::estimate_frame`], with the ball looked for in a part of the image only.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) where the region is not within the image.
    pub fn estimate_roi<'a>(
        &self,
        image: impl Into<FrameImage<'a>>,
        roi: &Roi,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> crate::error::Result<()> {
        let image = image.into();
        let roi = roi.within(image.width(), image.height())?;
        self.estimate_part(image, &roi, hint, ws, out);
        Ok(())
    }

    /// Finds the ball, unless its outline is given, and the dots on it.
    pub fn detect<'a>(
        &self,
        image: impl Into<FrameImage<'a>>,
        circle: Option<&BallCircle>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let image = image.into();
        let whole = Roi::whole(image.width(), image.height());
        let search = circle.map_or(Search::Everywhere(0), Search::Given);
        self.viewed(image, &whole, ws, |view, ws| {
            self.detect_in(view, search, ws, out);
        });
    }

    /// Estimates a frame with the outline given.
    fn estimate_given(
        &self,
        image: FrameImage<'_>,
        circle: &BallCircle,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let (width, height) = (image.width(), image.height());
        let part = match image {
            FrameImage::Raw(_) => Roi::around(circle, SURROUNDINGS, width, height),
            _ => None,
        };
        let part = part.unwrap_or(Roi::whole(width, height));
        self.viewed(image, &part, ws, |view, ws| {
            self.detect_in(view, Search::Given(circle), ws, out);
            self.estimate_looking_again(view, hint, ws, out);
        });
    }

    /// Estimates a frame with the ball somewhere in a part of it.
    pub(super) fn estimate_part(
        &self,
        image: FrameImage<'_>,
        part: &Roi,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let mut attempts = 0;
        if part.width.max(part.height) > LARGE {
            ws.coarse.forget();
            if self.acquire(image, &Hunt::everywhere(*part), hint, ws, out) {
                return;
            }
            attempts = out.attempts;
        }
        if part.width * part.height > MAX_THOROUGH {
            for halvings in 1..=HALVINGS {
                ws.fine.forget();
                if self.acquire(image, &Hunt::finer(*part, halvings), hint, ws, out) {
                    return;
                }
            }
            attempts = out.attempts;
            return self.estimate_shrunk(image, part, attempts, hint, ws, out);
        }
        self.viewed(image, part, ws, |view, ws| {
            self.try_outlines(view, Search::Everywhere(attempts), hint, ws, out);
        });
    }

    /// Estimates a frame whose ball is near a circle: to some tenth of the radius. So many runs of the recognizer on this
    /// frame were made before.
    pub(super) fn estimate_near(
        &self,
        image: FrameImage<'_>,
        circle: &BallCircle,
        attempts: usize,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        self.search_near(image, circle, Search::Near(circle, attempts), hint, ws, out);
    }

    /// Estimates a frame by the surroundings of a circle.
    pub(super) fn search_near(
        &self,
        image: FrameImage<'_>,
        circle: &BallCircle,
        search: Search<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let (width, height) = (image.width(), image.height());
        let Some(part) = Roi::around(circle, SURROUNDINGS, width, height) else {
            out.clear();
            return;
        };
        let level = level_of(circle.radius, MAX_NEAR);
        self.viewed_at(image, &part, level, ws, |view, ws| {
            self.try_outlines(view, search, hint, ws, out);
        });
    }

    /// Hands a part of a frame to `work`, converted. The workspace's images are away meanwhile.
    fn viewed(
        &self,
        image: FrameImage<'_>,
        part: &Roi,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        work: impl FnOnce(View<'_>, &mut EstimatorWorkspace<D::Workspace>),
    ) {
        self.viewed_at(image, part, 0, ws, work);
    }

    /// As [`Estimator::viewed`], of an image that is halved so often.
    pub(super) fn viewed_at(
        &self,
        image: FrameImage<'_>,
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
            FrameImage::Gray(_) | FrameImage::Color(_) if is_whole => image,
            _ => image.part(part, gray, color),
        };
        if let FrameImage::Color(color) = seen {
            color.to_gray_into(&mut images.gray);
        }
        let view = View {
            image: seen,
            gray: match seen {
                FrameImage::Gray(gray) => gray,
                _ => &images.gray,
            },
            grid: part.grid(level),
        };
        work(view, ws);
        ws.images = images;
    }

    /// Tries outlines, the likeliest first.
    fn try_outlines(
        &self,
        view: View<'_>,
        search: Search<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        self.detect_in(view, search, ws, out);
        let is_scan = matches!(search, Search::Scan(..));
        let found = out.dots.iter().filter(|d| d.confidence >= LIKELY_DOT);
        match found.count() {
            found if is_scan && out.outline.is_some() && found < MIN_LIKELY_DOTS => {
                let needed = MIN_LIKELY_DOTS;
                out.outcome = Err(FrameRejection::TooFewDots { found, needed });
            }
            _ => self.estimate_looking_again(view, hint, ws, out),
        }
        let mut other = std::mem::take(&mut ws.other);
        other.attempts = 0;
        let contested = ws.locator.contested().filter(|_| !is_mirrored(out));
        if let Some(candidate) = contested {
            self.try_outline(&candidate, view, hint, ws, out, &mut other);
            let is_pose = is_better(&other, out) && (out.pose().is_some() || is_evident(&other));
            if is_pose || is_mirrored(&other) {
                std::mem::swap(&mut other, out);
            }
        }
        let mut start = 0;
        while out.pose().is_none() && !is_scan && !is_mirrored(out) {
            let net = self.outline_net.as_ref();
            let Some(candidate) = ws.locator.other(view.gray, net, &mut start) else {
                break;
            };
            self.try_outline(&candidate, view, hint, ws, out, &mut other);
            if is_evident(&other) || is_mirrored(&other) {
                std::mem::swap(&mut other, out);
            }
        }
        out.attempts = out.attempts.max(other.attempts);
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
        other.outline = Some(candidate.outline);
        (other.circle, other.fit) = (Some(candidate.outline.circle), candidate.fit);
        other.earlier_attempts = first.attempts.max(other.attempts);
        other.outcome = Err(FrameRejection::NotProcessed);
        other.known_distance = first.known_distance;
        other.timings.locate = first.timings.locate;
        self.find_dots(view, ws, other);
        if first.pose().is_some() {
            self.estimate_pose(hint, ws, other);
        } else {
            self.estimate_looking_again(view, hint, ws, other);
        }
    }

    /// As [`Estimator::estimate_pose`]; where the dots leave doubt, the detector looks again.
    fn estimate_looking_again(
        &self,
        view: View<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        self.estimate_pose(hint, ws, out);
        if out.is_settled() || !self.look_again(view, ws, out) {
            return;
        }
        let before = out.timings.identify;
        self.estimate_pose(hint, ws, out);
        out.timings.identify += before;
    }

    /// Finds the dots of the last patch anew, by the detector's second look; false where it has none.
    fn look_again(
        &self,
        view: View<'_>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> bool {
        let begun = Instant::now();
        let (detector, dots) = (&mut ws.detector, &mut out.dots);
        if !self.detector.look_again_into(&ws.patch, detector, dots) {
            return false;
        }
        if let Some(ball) = &ws.recentered {
            ball.camera.dots_to_image(dots);
        }
        out.place_dots(&view.grid);
        out.assignment.clear();
        out.assignment.resize(out.dots.len(), None);
        out.earlier_attempts = out.attempts;
        out.timings.detect += begun.elapsed();
        true
    }

    /// Finds the ball in a view, unless its outline is given, and the dots on it.
    fn detect_in(
        &self,
        view: View<'_>,
        search: Search<'_>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let begun = Instant::now();
        let attempts = match search {
            Search::Near(_, attempts)
            | Search::Scan(_, attempts)
            | Search::Everywhere(attempts) => attempts,
            Search::Given(_) => 0,
        };
        out.clear();
        out.earlier_attempts = attempts;
        out.unfitted_support = match search {
            // As good as one that the edges show whole.
            Search::Given(_) => 1.0,
            _ => 0.0,
        };
        let grid = view.grid;
        let net = self.outline_net.as_ref();
        let found = match search {
            Search::Given(circle) => {
                let circle = grid.circle_to_part(circle);
                let sigma = GIVEN_OUTLINE * circle.radius;
                out.outline_source = OutlineSource::Given;
                out.outline = Some(Outline {
                    circle,
                    covariance: Matrix3::from_diagonal_element(sigma.powi(2)),
                });
                None
            }
            Search::Everywhere(_) => Some(ws.locator.find(view.gray, view.image, net)),
            Search::Near(circle, _) | Search::Scan(circle, _) => {
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
        self.find_dots(view, ws, out);
    }

    /// Finds the dots within the outline; then all that was found is given in the frame's pixels.
    fn find_dots(
        &self,
        view: View<'_>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        out.dots.clear();
        out.dots.reserve(EXPECTED_DOTS);
        out.assignment.clear();
        out.assignment.reserve(EXPECTED_DOTS);
        if let Some(outline) = out.outline {
            let begun = Instant::now();
            ws.recentered = match (self.intrinsics(), &mut ws.recentering) {
                (Some(k), Some(r)) => {
                    let k = view.grid.intrinsics_to_part(&k);
                    r.recenter(&k, view.gray, ws.locator.color_contrast(), out)
                }
                _ => None,
            };
            match (ws.recentered, &ws.recentering) {
                (Some(ball), Some(r)) => ws.patch.cut_into(r.image(), &ball.circle),
                _ => ws.patch.cut_into(view.gray, &outline.circle),
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
/// which leaves it to [`TrustMap`](super::TrustMap) what an accepted pose is worth.
pub(super) fn is_evident(frame: &FrameEstimate) -> bool {
    let of_dots = |pose: &Pose| match frame.evidence() {
        Some(evidence) => evidence.pose_confidence,
        None => pose.pose_confidence,
    };
    let is_clear = frame.pose().is_some_and(|pose| of_dots(pose) >= CLEAR);
    is_clear && likely_dots(frame) >= MIN_LIKELY_DOTS
}

/// Whether the dots speak for `a`'s outline rather than for `b`'s: by the pose's probability and,
/// where both are all but certain, by how well the dots fit.
fn is_better(a: &FrameEstimate, b: &FrameEstimate) -> bool {
    match (a.pose(), b.pose()) {
        (Some(a), Some(b)) if a.pose_confidence.min(b.pose_confidence) >= CERTAIN => {
            a.residual_rad < b.residual_rad
        }
        (Some(a), Some(b)) => a.pose_confidence > b.pose_confidence,
        (a, _) => a.is_some(),
    }
}

/// Number of identified dots that are more likely dots than not.
fn likely_dots(frame: &FrameEstimate) -> usize {
    let named = frame.dots.iter().zip(&frame.assignment);
    named
        .filter(|(dot, name)| dot.confidence >= LIKELY_DOT && name.is_some())
        .count()
}
