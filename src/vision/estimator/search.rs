//! A frame's way from pixels to an answer: [places](super::propose) are tried, and [outlines](crate::vision::outline::locate) at each, the likeliest
//! first, until the dots are clear or the budget is spent.
//!
//! Guarantees: outlines and dots are given in the pixels of the whole image, whatever part of it was
//! looked at. An outline beside the first needs a clear pose by dots that are likely ones.

use std::time::Instant;

use super::propose::Proposal;
use super::{Estimator, EstimatorWorkspace};
use crate::image::{ImageView, Roi};
use crate::recognize::Hint;
use crate::vision::dots::detector::LIKELY_DOT;
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection, Pose, Standing, is_mirrored};
use crate::vision::frame::outline::Outline;
use crate::vision::frame::prior::{Budget, OutlinePrior, Prior, Spending};
use crate::vision::optics::camera::BallCircle;
use crate::vision::optics::crop::Crop;
use crate::vision::outline::circle::NoBall;
use crate::vision::outline::locate::{OutlineCandidate, OutlineShape};
use crate::vision::outline::place::{FOR_DOTS, Place};
use crate::vision::pose::identify::{CLEAR, Detections, PROMISING};

/// Minimum number of such dots in the pose of an outline that is not whole enough for a ball.
const MIN_LIKELY_DOTS: usize = 5;
/// A rough circle within which fewer dots are expected than this, the sum of their probabilities, is no ball's: of 168 circles whose dots gave
/// an answer the least had 1.86; of 2 118 others 57 % had less (240 images of 640 x 480 in all conditions, seeds 6341 and 6342).
const LEAST_DOTS: f64 = 1.5;
/// Least probability of a pose of a ball below the minimum radius. Of 45 such poses by dots that claim 0.85 to 0.95, 36 were right; of
/// 134 by dots or pixels that claim more, 132 (small balls and, half as often, other things: 6 000 images, seed 71001).
const SURE: f64 = 0.95;
/// An outline that the dots ask for is the best of so many that differ by more than identification bears: 4 % of the radius, where
/// center and size may be off as [`align`](crate::vision::pose::align) has them.
const CHOICES: usize = 300;
/// Poses from here on are all but certain.
const CERTAIN: f64 = 0.99;
/// The residual, radians, at which a pose's named dots count for nothing beside those of another outline's: 5 deg. By the residual alone, which leaving
/// dots out makes small, medians are 2 % larger: in eight sets of 1 800 synthetic pictures from 1 % smaller to 8 % larger, in six of 233
/// path-traced ones from 3 % smaller to 13 % larger.
const WORTHLESS_RAD: f64 = 0.0873;

impl Estimator {
    /// Estimates a frame. Outlines are proposed where the prior expects the ball, the likeliest first; dots are found within
    /// and identified, until a pose is clear or the budget is spent.
    ///
    /// A region of the prior that lies beyond the image is cut; where nothing of it is left, there is no ball.
    pub fn estimate<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        prior: &Prior,
        budget: &Budget,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        self.estimate_standing(image.into(), prior, Standing::Likely, budget, ws, out);
    }

    /// As [`Estimator::estimate`], where the outline of the prior is worth so much before its dots are seen.
    pub(crate) fn estimate_standing(
        &self,
        image: ImageView<'_>,
        prior: &Prior,
        standing: Standing,
        budget: &Budget,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        ws.spending = Spending::of(*budget);
        out.clear();
        let (width, height) = (image.width(), image.height());
        let region = prior.region.unwrap_or(Roi::whole(width, height));
        let region = region.cut(width, height);
        let is_wide = |r: &Roi| r.width.min(r.height) >= self.min_side();
        if prior.outline.is_none() && !region.is_some_and(|r| is_wide(&r)) {
            let (width, height) = region.map_or((0, 0), |r| (r.width, r.height));
            out.outcome = Err(FrameRejection::NoBall(NoBall::TooSmall { width, height }));
            return;
        }
        let mut places = std::mem::take(&mut ws.places);
        let mut there = std::mem::take(&mut ws.there);
        places.plan(&image, region.filter(is_wide), (prior, standing), budget);
        let mut is_answered = false;
        while !is_answered && let Some(proposal) = self.next_place(&image, out, &mut places, ws) {
            let is_outlined = out.outline.is_some();
            let hint = prior.rotation.as_ref();
            self.try_place(image, &proposal, hint, is_outlined, ws, &mut there);
            places.learn(&proposal, &there);
            is_answered = is_answer(&there, proposal.standing) || ws.spending.has_detected;
            // What is expected, or else the likeliest place, says why there is no answer.
            let is_open = out.outline.is_none() || prior.outline.is_none();
            if is_answered || (is_open && is_nearer(&there, out, proposal.standing)) {
                std::mem::swap(&mut there, out);
            }
        }
        if !is_answered {
            // A pose that the dots do not make evident is no answer.
            out.reject_pose();
        }
        (ws.places, ws.there) = (places, there);
        (out.attempts, out.timings) = (ws.spending.runs, ws.spending.timings);
        if out.outcome.is_err() && !is_mirrored(out) && ws.spending.is_late() {
            out.outcome = Err(FrameRejection::OutOfTime);
        } else if out.outcome == Err(FrameRejection::NotProcessed) && out.outline.is_none() {
            out.outcome = Err(FrameRejection::NoBall(NoBall::NoCircle { support: 0.0 }));
        }
        self.sharpen(image, ws, out);
    }

    /// Finds the ball, unless its outline is given, and the dots on it; identifies none.
    pub fn detect<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        outline: Option<&OutlinePrior>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        let image = image.into();
        ws.spending = Spending::default();
        let whole = Roi::whole(image.width(), image.height());
        let place = outline.map_or(Place::Within(whole), |o| match o.believed() {
            Some(known) => Place::Known(known),
            None => Place::Near(o.circle),
        });
        self.viewed(image, &whole, 0, ws, |crop, ws| {
            out.clear();
            if let Some(first) = self.begin_outlines(&crop, &place, ws, out) {
                self.find_dots(&crop, &first, ws, out);
            }
        });
        out.timings = ws.spending.timings;
    }

    /// The smallest side, pixels, of an image that is searched.
    fn min_side(&self) -> usize {
        (self.config.circle.min_radius_px as usize).max(1)
    }

    /// Hands a part of a frame, halved so often, to `work`, converted. The workspace's images are away meanwhile.
    pub(crate) fn viewed(
        &self,
        image: ImageView<'_>,
        part: &Roi,
        level: u32,
        ws: &mut EstimatorWorkspace,
        work: impl FnOnce(Crop<'_>, &mut EstimatorWorkspace),
    ) {
        let mut images = std::mem::take(&mut ws.images);
        images.view(image, part, level, |crop| work(crop, ws));
        ws.images = images;
    }

    /// Tries the outlines at a place, the likeliest first, until the dots are clear; rough circles without dots only where the frame is not
    /// outlined yet.
    fn try_place(
        &self,
        image: ImageView<'_>,
        proposal: &Proposal,
        hint: Option<&Hint>,
        is_outlined: bool,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        out.clear();
        let Proposal { place, standing } = proposal;
        let is_wide = |(part, level): &(Roi, u32)| {
            matches!(place, Place::Known(_))
                || part.width.min(part.height) >> level >= self.min_side()
        };
        let Some((part, level)) = place.part(&image, FOR_DOTS).filter(is_wide) else {
            let (width, height) = (image.width(), image.height());
            out.outcome = Err(FrameRejection::NoBall(NoBall::TooSmall { width, height }));
            return;
        };
        self.viewed(image, &part, level, ws, |crop, ws| {
            if let (Place::Near(rough), Standing::Doubtful) = (place, standing)
                && is_outlined
                && self.shows_nothing(&crop, rough, ws, out)
            {
                return;
            }
            let first = self.begin_outlines(&crop, place, ws, out);
            if let Some(first) = &first {
                out.standing = *standing;
                self.try_outline(&crop, first, hint, ws, out);
            }
            let mut other = std::mem::take(&mut ws.within);
            let net = self.outline_net.as_ref();
            while !(ws.spending.is_over() || is_mirrored(out)) {
                // Motion, shadows and hands draw circles out, too: the dots decide.
                let is_open = *standing != Standing::Doubtful && out.pose().is_none();
                let Some(candidate) = ws.locator.next(crop.gray, net, is_open) else {
                    break;
                };
                other.clear();
                other.standing = Standing::Doubtful;
                let beside = out.pose().map(|pose| self.beside(pose));
                if let Some(detections) = beside {
                    self.find_dots(&crop, &candidate, ws, &mut other);
                    self.identify(detections, ws, &mut other);
                } else {
                    self.try_outline(&crop, &candidate, hint, ws, &mut other);
                }
                let is_pose = is_better(&other, out) && (beside.is_some() || is_evident(&other));
                if is_pose || is_mirrored(&other) || ws.spending.has_detected {
                    std::mem::swap(&mut other, out);
                }
            }
            if first.is_none() && matches!(place, Place::Within(_)) {
                self.try_smaller(&crop, hint, ws, &mut other, out);
            }
            ws.within = other;
        });
    }

    /// What another outline beside a pose is identified by: beside a certain one, its likely dots at that pose's distance.
    fn beside(&self, pose: &Pose) -> Detections {
        match pose.confidence >= CERTAIN {
            true => Detections::LikelyUnder(self.config.camera.at(pose.distance)),
            false => Detections::All,
        }
    }

    /// Whether there are no dots within a rough circle, so that its outline is not worth looking for.
    fn shows_nothing(
        &self,
        crop: &Crop<'_>,
        rough: &BallCircle,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> bool {
        // Contrasts are no probabilities, and what covers a ball hides its dots.
        if !self.detector.looks_again() || !ws.covers.is_empty() {
            return false;
        }
        let begun = Instant::now();
        ws.patch
            .cut_into(crop.gray, &crop.grid.circle_to_part(rough));
        self.detector
            .detect_into(&ws.patch, &mut ws.detector, &mut out.dots);
        let expected: f64 = out.dots.iter().map(|d| d.probability).sum();
        let is_bare = expected < LEAST_DOTS;
        if is_bare {
            let found = out.dots.iter().filter(|d| d.probability >= LIKELY_DOT);
            let (found, needed) = (found.count(), MIN_LIKELY_DOTS);
            out.outcome = Err(FrameRejection::TooFewDots { found, needed });
        }
        out.dots.clear();
        ws.spending.timings.detect += begun.elapsed();
        is_bare
    }

    /// Tries a ball below the minimum radius, where nothing else looked like a ball; without a sure pose, nothing changes.
    fn try_smaller(
        &self,
        crop: &Crop<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        other: &mut FrameEstimate,
        out: &mut FrameEstimate,
    ) {
        let is_open = out.pose().is_none() && !is_mirrored(out);
        // Without a pose no such ball is believed.
        if !is_open || ws.spending.is_detecting() || ws.spending.is_over() {
            return;
        }
        let Some(candidate) = ws.locator.smaller(crop.gray) else {
            return;
        };
        other.clear();
        other.standing = Standing::Likely;
        self.try_outline(crop, &candidate, hint, ws, other);
        if other.pose().is_some_and(|p| p.confidence >= SURE) {
            std::mem::swap(other, out);
        }
    }

    /// Looks for outlines at a place; the likeliest, or why there is none.
    fn begin_outlines(
        &self,
        crop: &Crop<'_>,
        place: &Place,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<OutlineCandidate> {
        let begun = Instant::now();
        let net = self.outline_net.as_ref();
        let found = ws.locator.begin(crop, place, net);
        let first = match found {
            Ok(()) => ws.locator.next(crop.gray, net, false),
            Err(why) => {
                out.outcome = Err(FrameRejection::NoBall(why));
                None
            }
        };
        ws.spending.timings.locate += begun.elapsed();
        first
    }

    /// Estimates a frame on an outline. Where the dots leave doubt, the detector looks again; where that leaves doubt too, or the dots
    /// of a likely outline show another orientation than is expected, they are weighed with what is expected.
    fn try_outline(
        &self,
        crop: &Crop<'_>,
        candidate: &OutlineCandidate,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        self.find_dots(crop, candidate, ws, out);
        let found = out.dots.iter().filter(|d| d.probability >= LIKELY_DOT);
        let (found, needed) = (found.count(), MIN_LIKELY_DOTS);
        let is_doubtful = out.standing == Standing::Doubtful;
        if is_doubtful && found < needed {
            out.outcome = Err(FrameRejection::TooFewDots { found, needed });
            return;
        }
        if !self.detector.looks_again() {
            self.identify(Detections::All, ws, out);
        } else {
            self.identify(Detections::Likely, ws, out);
            let is_hopeless = is_doubtful && out.promise() < PROMISING;
            if !(out.is_settled() || is_hopeless || ws.spending.is_late()) {
                self.look_again(crop, ws, out);
                self.identify(Detections::All, ws, out);
                self.identify_by_places(ws, out);
            }
        }
        if let Some(hint) = hint.filter(|_| !is_doubtful && !ws.spending.is_late()) {
            self.identify_expected(hint, ws, out);
        }
        let is_hopeless = is_doubtful && out.promise() < PROMISING;
        if self.detector.looks_again() && !is_hopeless {
            self.identify_by_pixels(crop, hint, ws, out);
        }
        self.ask_dots(crop, candidate, ws, out);
    }

    /// Where the dots of an outline that was found give no answer, the outline that they ask for comes next.
    fn ask_dots(
        &self,
        crop: &Crop<'_>,
        candidate: &OutlineCandidate,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        let is_found = candidate.shape != OutlineShape::ByDots && !candidate.outline.is_given();
        let is_over = ws.spending.is_detecting() || ws.spending.is_over();
        if out.is_settled() || is_over || !(is_found && self.detector.looks_again()) {
            return;
        }
        let begun = Instant::now();
        if let Some(outline) = self.outline_by_dots(ws, out) {
            let circle = match self.intrinsics() {
                Some(k) => k.shown_of_ball(&outline.circle),
                None => outline.circle,
            };
            let shown = Outline { circle, ..outline };
            ws.locator.add(OutlineCandidate {
                shape: OutlineShape::ByDots,
                ..OutlineCandidate::given(&shown, &crop.grid)
            });
        }
        ws.spending.timings.identify += begun.elapsed();
    }

    /// Finds the dots of the last patch anew, by the detector's second look.
    fn look_again(&self, crop: &Crop<'_>, ws: &mut EstimatorWorkspace, out: &mut FrameEstimate) {
        let begun = Instant::now();
        let (dots, heat) = (&mut out.dots, &mut ws.heat);
        self.detector
            .look_again_into(&ws.patch, &mut ws.detector, dots, heat);
        if let Some(ball) = &ws.recentered {
            ball.camera.dots_to_image(dots);
        }
        out.place_dots(&crop.grid);
        out.assignment.clear();
        out.assignment.resize(out.dots.len(), None);
        ws.spending.timings.detect += begun.elapsed();
    }

    /// Finds the dots within an outline; then all that was found is given in the frame's pixels.
    fn find_dots(
        &self,
        crop: &Crop<'_>,
        candidate: &OutlineCandidate,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        let begun = Instant::now();
        ws.spending.choices = match candidate.shape {
            OutlineShape::ByDots => CHOICES,
            OutlineShape::Free | OutlineShape::Circle => 1,
        };
        (out.outline, out.fit) = (Some(candidate.outline), candidate.fit);
        let contrast = ws.locator.color_contrast();
        ws.recentered = match self.intrinsics() {
            Some(k) => {
                let k = crop.grid.intrinsics_to_part(&k);
                ws.recentering.recenter(&k, crop.gray, contrast, out)
            }
            None if candidate.shape != OutlineShape::Free => None,
            None => {
                let middle = crop.middle();
                let found = ws
                    .recentering
                    .recenter_ellipse(middle, crop.gray, contrast, out);
                if found.is_some() && !candidate.outline.circle.is_ellipse() {
                    ws.locator.add(OutlineCandidate {
                        shape: OutlineShape::Circle,
                        ..*candidate
                    });
                }
                found
            }
        };
        match ws.recentered {
            Some(ball) => ws.patch.cut_into(ws.recentering.image(), &ball.circle),
            None => ws.patch.cut_into(crop.gray, &candidate.outline.circle),
        }
        if !ws.covers.is_empty() {
            let in_crop = ws.covers.iter().map(|c| crop.grid.circle_to_part(c));
            let covers: Vec<BallCircle> = in_crop.collect();
            let seen_at = |pixel| match &ws.recentered {
                Some(ball) => ball.camera.image_of(pixel),
                None => pixel,
            };
            ws.patch.uncover(&covers, ws.covers_add, seen_at);
        }
        self.detector
            .detect_into(&ws.patch, &mut ws.detector, &mut out.dots);
        if let Some(ball) = &ws.recentered {
            ball.camera.dots_to_image(&mut out.dots);
        }
        out.circle = out.outline.map(|o| o.circle);
        out.place(&crop.grid);
        out.assignment.resize(out.dots.len(), None);
        ws.spending.timings.detect += begun.elapsed();
    }
}

/// Whether what was found at a place is the answer: a pose of a likely outline, one that the dots make evident, or a mirrored ball.
fn is_answer(frame: &FrameEstimate, standing: Standing) -> bool {
    let is_likely = standing == Standing::Likely && frame.pose().is_some();
    is_likely || is_evident(frame) || is_mirrored(frame)
}

/// Whether the dots at a place, which are no answer, came nearer to one than those of the places before.
fn is_nearer(there: &FrameEstimate, so_far: &FrameEstimate, standing: Standing) -> bool {
    let (a, b) = (there.promise(), so_far.promise());
    so_far.outline.is_none() || a > b || (standing == Standing::Likely && a >= b)
}

/// Whether the dots alone are evidence of a ball, where the circle is none: by the recognizer's own probability,
/// which leaves it to [`TrustMap`](crate::vision::pose::trust::TrustMap) what an accepted pose is worth; where all places were
/// weighed, there is no other than the map's.
pub(crate) fn is_evident(frame: &FrameEstimate) -> bool {
    let last = frame.hypotheses().next_back().map(|h| &h.evidence);
    let of_dots = |pose: &Pose| match last {
        Some(evidence) if evidence.is_of_detections() => evidence.confidence,
        Some(_) => pose.confidence,
        None => pose.confidence,
    };
    let is_clear = frame.pose().is_some_and(|pose| of_dots(pose) >= CLEAR);
    is_clear && likely_dots(frame) >= MIN_LIKELY_DOTS
}

/// Whether the dots speak for `a`'s outline rather than for `b`'s: by the pose's probability and,
/// where both are all but certain, by how many have a name and how well these fit.
fn is_better(a: &FrameEstimate, b: &FrameEstimate) -> bool {
    let fit = |frame: &FrameEstimate, pose: &Pose| {
        let named = frame.assignment.iter().flatten().count();
        named as f64 * (1.0 - (pose.residual_rad / WORTHLESS_RAD).powi(2))
    };
    match (a.pose(), b.pose()) {
        (Some(of_a), Some(of_b)) if of_a.confidence.min(of_b.confidence) >= CERTAIN => {
            fit(a, of_a) > fit(b, of_b)
        }
        (Some(a), Some(b)) => a.confidence > b.confidence,
        (a, _) => a.is_some(),
    }
}

/// Number of identified dots that are more likely dots than not.
fn likely_dots(frame: &FrameEstimate) -> usize {
    let named = frame.dots.iter().zip(&frame.assignment);
    named
        .filter(|(dot, name)| dot.probability >= LIKELY_DOT && name.is_some())
        .count()
}
