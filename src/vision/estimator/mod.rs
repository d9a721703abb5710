//! From an image to the ball's orientation, and from a sequence of images to all of them.
//!
//! A frame's way, for first, tracked, hinted and neighboring frames alike ([`Estimator::estimate`]):
//!
//! ```text
//! Prior: region, outline +- sigma, rotation          Budget: runs, deadline, depth of the search
//!        |
//!        |  outline believed   expected near        nothing known
//!        |        |                |                     |
//! outlines,       |        edges near it, net      up to 240 px: all edges, net
//! the likeliest   |        then rough circles      beyond: rough circles, what these outshone, those without
//! first           |        as far as it may be     thin things, smaller balls, all edges (halved where very large)
//!        |        |                |                     |
//!        +--------+--------+-------+---------------------+
//!                          |
//! dots     off the axis of a known camera: the view straight at the ball
//!          Patch -> DotDetector -> BallView: directions and covariances
//!                          |   in doubt: five likely dots, or the next outline
//! names    likely dots, then doubtful ones too; camera distances, the likeliest first
//!          once with the mirrored view; until a pose is clear
//!                          |   in doubt: a promising pose, or the next outline
//!          no clear pose: the detector's second look, names again
//!                          |
//! pose     probability by all evidence (TrustMap); refined on the dots in the image
//!                          |
//!          clear: the answer        else: the next outline, until the budget ends
//! ```
//!
//! [`circle`](super::circle) finds outlines, [`Patch`] cuts the ball out, a [`DotDetector`] finds dots, [`BallView`] lays them
//! on the sphere; their covariance is the detector's and that of the hand that drew them. The refinement fits the orientation
//! to the dots in the image, and takes up those that only now have a name.
//!
//! # What is promised
//! A frame is answered where the pose's probability is at least [`EstimatorConfig::min_confidence`], else
//! it has a [`FrameRejection`]: nothing is guessed. The same image gives the same answer whatever was seen before, but for the
//! hint that one may give. After the first frames of a size, the estimator allocates nothing.
//!
//! Orientations map the pattern's frame to the camera's (x right, y up, z towards the camera).

mod acquire;
mod batch;
mod config;
mod frame;
mod locate;
mod orientations;
mod path;
mod prior;
mod recenter;
mod refine;
mod search;
mod sequence;
mod sequence_view;
mod shrunk;
mod tracker;
mod trust;

pub use batch::{
    Batch, BatchConfig, BatchFrame, BatchObserver, FrameClock, SequenceOutcome, TimeSource,
    estimate_inputs,
};
pub use config::{CameraDistance, CameraModel, EstimatorConfig, OutlineMethod};
pub use frame::{FrameEstimate, FrameRejection, Outline, OutlineSource, Pose, Timings};
use frame::{Hypothesis, Standing};
pub use orientations::{NamedFrame, orientations, turned_covariance};
pub use prior::{Budget, Follows, OutlinePrior, Prior, SearchDepth};
pub use sequence::{
    FrameInDoubt, SequenceConfig, SequenceSummary, estimate_sequence, estimate_spin,
    frames_in_doubt, second_pass,
};
pub use sequence_view::SequenceView;
pub use tracker::{Tracker, TrackerConfig, TrackerState};
pub use trust::{FEATURES, PoseEvidence, TrustMap};

use std::time::Instant;

use nalgebra::{Matrix2, Matrix3};

use super::camera::{BallCircle, BallView, Camera, Intrinsics};
use super::circle::coarse::{CoarseSearch, RoughCircle};
use super::detect::{DotDetection, DotDetector};
use super::net::OutlineNet;
use super::patch::Patch;
use crate::ball::Ball;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3};
use crate::pattern::Pattern;
use crate::recognize::robust::{RobustConfig, RobustRecognizer, RobustWorkspace};
use crate::recognize::{Hint, Recognizer, RecognizerRejection};
use crate::view::{DotUncertainty, FalseDots, ObservedDot, ViewModel};
use locate::{Candidate, Locator};
use prior::Spending;
use recenter::{Recentered, Recentering};
use refine::{Match, Placement, Refiner};
use search::Images;
use search::LIKELY_DOT;

/// The estimator: a pattern, a camera, a detector and the settings of everything between.
#[derive(Debug, Clone)]
pub struct Estimator<D> {
    ball: Ball,
    detector: D,
    /// For the likely detections, and for all.
    recognizers: [RobustRecognizer; 2],
    refiner: Refiner,
    /// Where the method uses it.
    outline_net: Option<OutlineNet>,
    /// Variance per tangent axis of the drawn dots' places that every observed dot is given, rad^2.
    placement_variance: f64,
    config: EstimatorConfig,
}

/// Working memory of an [`Estimator`], one a thread.
#[derive(Debug)]
pub struct EstimatorWorkspace<W> {
    images: Images,
    coarse: CoarseSearch,
    /// For smaller balls.
    fine: CoarseSearch,
    /// The circles of the coarse search.
    rough: Vec<RoughCircle>,
    /// Circles of a picture that was searched at a smaller scale.
    shrunk: Vec<BallCircle>,
    /// The first of several circles, none of which is a ball by its dots.
    best: FrameEstimate,
    /// An estimate for another outline.
    other: FrameEstimate,
    /// One farther from where the ball is expected.
    farther: FrameEstimate,
    spending: Spending,
    locator: Locator,
    /// Only where the camera's intrinsics are known.
    recentering: Recentering,
    /// The last outline as a circle, where it became an ellipse.
    round: Option<Candidate>,
    /// How the ball of the last patch was recentered.
    recentered: Option<Recentered>,
    patch: Patch,
    detector: W,
    recognizer: RobustWorkspace,
    /// The dots handed to the recognizer, and their detections.
    observed: Vec<ObservedDot>,
    indices: Vec<usize>,
    matches: Vec<Match>,
}

/// A recognizer's answer in terms of detections.
#[derive(Debug, Clone, Copy)]
struct PoseHypothesis {
    /// Pattern to view frame.
    rotation: Rotation,
    /// The camera under which the dots were identified.
    camera: Camera,
    confidence: f64,
    pose_confidence: f64,
    evidence: PoseEvidence,
}

impl PoseHypothesis {
    /// The best of several attempts has more chances to be good by accident: its odds are divided by their number.
    fn discounted(self, attempts: usize) -> Self {
        let less = |p: f64| p / (p + (1.0 - p) * attempts.max(1) as f64);
        Self {
            confidence: less(self.confidence),
            pose_confidence: less(self.pose_confidence),
            ..self
        }
    }

    /// The probability by all that is known of the pose, after so many attempts.
    fn weighed(self, map: &TrustMap, attempts: usize) -> Self {
        let evidence = PoseEvidence {
            pose_confidence: self.pose_confidence,
            attempts,
            ..self.evidence
        };
        let pose_confidence = map.probability(&evidence);
        let share = pose_confidence / self.pose_confidence.max(f64::MIN_POSITIVE);
        Self {
            confidence: (self.confidence * share).min(pose_confidence),
            pose_confidence,
            evidence,
            ..self
        }
    }
}

/// One run of the recognizer.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// 0: the likely detections; 1: all.
    pass: usize,
    camera: Camera,
    mirrored: Mirrored,
}

/// When a run looks at the mirrored view, which costs as much again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mirrored {
    /// Always: a mirrored ball ends the search for other outlines.
    Sought,
    /// Where the pose is likelier than [`MIRROR_DOUBT`]: its mirror image may explain the dots as well.
    Compared,
}

/// The probability of the best pose so far.
fn promise_of(found: &std::result::Result<PoseHypothesis, FrameRejection>) -> f64 {
    found.as_ref().map_or(0.0, |f| f.pose_confidence)
}

/// Poses likelier than this are compared with those of the mirrored view.
const MIRROR_DOUBT: f64 = 0.3;
/// An orientation farther off the expected one than this, radians, is weighed with it: 25 deg.
pub(super) const DISAGREEMENT: f64 = 0.436;
/// An outline that stands in doubt is looked at again where its best pose is likelier than this.
const PROMISING: f64 = 0.05;
/// Standard deviation per tangent axis of what a measured dot's middle does beyond its covariance, radians:
/// ink and light change from view to view.
const MEASURED_DOT: f64 = 0.004;
/// Without a pose likelier than this, doubtful detections are tried as well.
const CLEAR: f64 = 0.9;
/// Dots of the pattern beyond this z are seen in nearly every frame.
const FACING: f64 = 0.35;
/// The rejection of a mirrored frame.
const MIRRORED: FrameRejection = FrameRejection::Recognizer(RecognizerRejection::Mirrored);
/// More detections than either detector gives for a ball: capacity for as many is reserved beforehand.
const EXPECTED_DOTS: usize = 256;

/// Covariances of measured dots as an image shows them, rad^2, pattern frame.
fn measured_dots(dots: &[Vec3], covariances: &[Matrix3<f64>]) -> Vec<Matrix3<f64>> {
    let dots = dots.iter().zip(covariances);
    dots.map(|(dot, covariance)| {
        let tangent = Matrix3::identity() - dot * dot.transpose();
        covariance + tangent * MEASURED_DOT.powi(2)
    })
    .collect()
}

impl<D: DotDetector> Estimator<D> {
    /// An estimator for balls with this pattern.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a setting outside its domain.
    pub fn new(pattern: &Pattern, config: EstimatorConfig, detector: D) -> Result<Self> {
        Self::for_ball(&Ball::new(pattern.clone()), config, detector)
    }

    /// An estimator for a ball. Where its dots were measured, their own covariances take the place
    /// of [`EstimatorConfig::placement_sigma_rad`].
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a setting outside its domain.
    pub fn for_ball(ball: &Ball, config: EstimatorConfig, detector: D) -> Result<Self> {
        Self::with_net(ball, config, detector, config.outline.net()?)
    }

    /// As [`Estimator::for_ball`], with the net for outlines at hand: another ball does not read it
    /// anew.
    fn with_net(
        ball: &Ball,
        config: EstimatorConfig,
        detector: D,
        outline_net: Option<OutlineNet>,
    ) -> Result<Self> {
        config.check()?;
        let likely = config.recognizer.view;
        let view = ViewModel {
            false_dots: FalseDots::Poisson(likely.false_dots.mean() + config.doubtful_false_dots),
            ..likely
        };
        let doubtful = RobustConfig {
            view,
            ..config.recognizer
        };
        let (refiner, placement_variance) = match (ball.dot_covariances(), ball.placement()) {
            (Some(covariances), Some(placement)) => {
                let measured = measured_dots(ball.pattern().dots(), covariances);
                (
                    Refiner::new(&config).with_placement(Placement::Measured(measured)),
                    placement.common_rad2 + MEASURED_DOT.powi(2),
                )
            }
            _ => (Refiner::new(&config), config.placement_sigma_rad.powi(2)),
        };
        Ok(Self {
            ball: ball.clone(),
            detector,
            recognizers: [
                RobustRecognizer::for_ball(ball, config.recognizer)?,
                RobustRecognizer::for_ball(ball, doubtful)?,
            ],
            refiner,
            outline_net,
            placement_variance,
            config,
        })
    }

    /// The same estimator for another pattern.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a setting outside its domain.
    pub fn for_pattern(&self, pattern: &Pattern) -> Result<Self>
    where
        D: Clone,
    {
        let (detector, net) = (self.detector.clone(), self.outline_net.clone());
        Self::with_net(&Ball::new(pattern.clone()), self.config, detector, net)
    }

    /// The settings in use.
    pub fn config(&self) -> &EstimatorConfig {
        &self.config
    }

    /// The ball to find.
    pub fn ball(&self) -> &Ball {
        &self.ball
    }

    /// The pattern to identify.
    pub fn pattern(&self) -> &Pattern {
        self.ball.pattern()
    }

    /// A new workspace.
    pub fn workspace(&self) -> EstimatorWorkspace<D::Workspace> {
        EstimatorWorkspace {
            images: Images::default(),
            coarse: CoarseSearch::default(),
            fine: CoarseSearch::default(),
            rough: Vec::new(),
            shrunk: Vec::new(),
            best: FrameEstimate::with_capacity(),
            other: FrameEstimate::with_capacity(),
            farther: FrameEstimate::with_capacity(),
            spending: Spending::default(),
            locator: Locator::new(self.config.circle),
            recentering: Recentering::new(self.config.circle),
            round: None,
            recentered: None,
            patch: Patch::default(),
            detector: self.detector.workspace(),
            recognizer: self.recognizers[0].workspace(),
            observed: Vec::with_capacity(EXPECTED_DOTS),
            indices: Vec::with_capacity(EXPECTED_DOTS),
            matches: Vec::with_capacity(EXPECTED_DOTS),
        }
    }

    /// The camera's intrinsics, where they are known.
    fn intrinsics(&self) -> Option<Intrinsics> {
        match self.config.camera {
            CameraModel::Known(Camera::Perspective(intrinsics)) => Some(intrinsics),
            _ => None,
        }
    }

    /// Estimates the orientation from the detected dots of a frame, without its pixels: those that another detector found, or
    /// those of another estimator. The answer depends on the detections and the outline as found alone.
    pub fn identify_detections(
        &self,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        ws.spending = Spending::of(Budget {
            spent: out.earlier_attempts,
            ..Budget::default()
        });
        self.identify(ws, out);
    }

    /// The same within what may be spent on the frame in hand.
    fn identify(&self, ws: &mut EstimatorWorkspace<D::Workspace>, out: &mut FrameEstimate) {
        let Some(outline) = out.outline else {
            return;
        };
        let begun = Instant::now();
        out.earlier_attempts = ws.spending.runs;
        out.outcome = self.identify_dots(&outline, None, ws, out);
        if out.outcome.is_err() {
            out.circle = Some(outline.circle);
            out.assignment.fill(None);
        }
        if let (Err(rejection), Some(fit)) = (&mut out.outcome, &out.fit) {
            let edge_width = fit.edge_width / outline.circle.radius;
            if edge_width > self.config.max_blur {
                *rejection = FrameRejection::TooBlurred { edge_width };
            }
        }
        out.timings.identify = begun.elapsed();
    }

    /// Weighs the dots with an expected orientation, where alone they have none or another one. An orientation that they
    /// keep against it stays theirs.
    fn identify_expected(
        &self,
        hint: &Hint,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let alone = out.outcome;
        let agrees = |pose: &Pose| pose.rotation.angle_to(&hint.rotation) < DISAGREEMENT;
        let Some(outline) = out.outline.filter(|_| !is_mirrored(out)) else {
            return;
        };
        if out.pose().is_some_and(agrees) {
            return;
        }
        let begun = Instant::now();
        let hypothesis = out.hypothesis;
        out.outcome = self.identify_dots(&outline, Some(hint), ws, out);
        match (&mut out.outcome, alone) {
            (Ok(pose), Ok(alone)) => {
                pose.hinted = pose.rotation.angle_to(&alone.rotation) >= DISAGREEMENT;
            }
            (Ok(_), Err(_)) => {}
            (outcome @ Err(_), alone) => {
                // Why the dots alone give no pose says more.
                if alone.is_err() {
                    *outcome = alone;
                    out.hypothesis = hypothesis;
                }
                out.circle = Some(outline.circle);
                out.assignment.fill(None);
            }
        }
        out.timings.identify += begun.elapsed();
    }

    /// Identifies under each hypothesis of the camera's distance, at first the likely detections, then all, until a pose is clear.
    fn identify_dots(
        &self,
        outline: &Outline,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> std::result::Result<Pose, FrameRejection> {
        let mut best: std::result::Result<PoseHypothesis, FrameRejection> =
            Err(FrameRejection::NotProcessed);
        let mut attempts = ws.spending.runs;
        let begun = attempts;
        out.hypothesis = None;
        'search: for pass in 0..self.recognizers.len() {
            // An expected orientation may be told by doubtful detections alone.
            let is_hopeless = hint.is_none() && promise_of(&best) < PROMISING;
            if pass > 0 && out.standing == Standing::Doubtful && is_hopeless {
                break;
            }
            for camera in self.config.camera.hypotheses() {
                if attempts > begun && ws.spending.is_late() {
                    break 'search;
                }
                let Ok(view) = BallView::new(&camera, outline.circle) else {
                    return Err(FrameRejection::Recognizer(RecognizerRejection::Degenerate));
                };
                let hint = hint.map(|h| in_view(h, &view));
                attempts += 1;
                let mirrored = match attempts == begun + 1 {
                    true => Mirrored::Sought,
                    false => Mirrored::Compared,
                };
                let look = Look {
                    pass,
                    camera,
                    mirrored,
                };
                let found = self.recognize(&look, &view, hint.as_ref(), ws, &out.dots);
                // What the mirror explains beyond doubt, other dots or another distance may still
                // explain by accident.
                if let Err(MIRRORED) = found {
                    out.attempts = attempts;
                    ws.spending.runs = attempts;
                    return Err(MIRRORED);
                }
                let better = match (&best, &found) {
                    (Err(_), _) => true,
                    (Ok(best), Ok(found)) => found.pose_confidence > best.pose_confidence,
                    (Ok(_), Err(_)) => false,
                };
                if better {
                    out.assignment.fill(None);
                    for (&i, name) in ws
                        .indices
                        .iter()
                        .zip(&ws.recognizer.explanations().best().assignment)
                    {
                        out.assignment[i] = found.is_ok().then_some(*name).flatten();
                    }
                    best = found;
                }
                if best.is_ok_and(|b| b.pose_confidence >= CLEAR) {
                    break 'search;
                }
            }
        }
        out.attempts = attempts;
        ws.spending.runs = attempts;
        // What is expected was not chosen among many: only the runs that weigh it count.
        let mut best = best?.discounted(match hint {
            Some(_) => attempts - begun,
            None => attempts,
        });
        if hint.is_none() {
            best = best.weighed(&self.config.trust, attempts);
            let view = BallView::new(&best.camera, outline.circle);
            out.hypothesis = view.ok().map(|view| Hypothesis {
                rotation: view.to_camera() * best.rotation,
                evidence: best.evidence,
            });
        }
        if best.pose_confidence < self.config.min_confidence {
            let pose_confidence = best.pose_confidence;
            return Err(FrameRejection::Ambiguous { pose_confidence });
        }
        self.refine(&best, outline, hint.is_some(), ws, out)
    }

    /// One run of the recognizer over the detections that are likely enough for this pass.
    fn recognize(
        &self,
        look: &Look,
        view: &BallView,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        dots: &[DotDetection],
    ) -> std::result::Result<PoseHypothesis, FrameRejection> {
        let min_depth = self
            .config
            .recognizer
            .view
            .visibility_limit
            .max(view.horizon());
        let hand = Matrix2::from_diagonal_element(self.placement_variance);
        ws.observed.clear();
        ws.indices.clear();
        for (i, dot) in dots.iter().enumerate() {
            if dot.confidence < self.config.dot_confidence[look.pass] {
                continue;
            }
            let Some(mut seen) = view.back_project(dot.pixel, &dot.covariance) else {
                continue;
            };
            if seen.direction.z < min_depth {
                continue;
            }
            if let DotUncertainty::Tangent { covariance } = &mut seen.uncertainty {
                *covariance += hand;
            }
            ws.observed.push(seen);
            ws.indices.push(i);
        }
        let recognizer = &self.recognizers[look.pass];
        let (dots_seen, seen) = (&ws.observed, &mut ws.recognizer);
        let is_sought = look.mirrored == Mirrored::Sought;
        let mut explained = match is_sought {
            true => recognizer.explain(dots_seen, hint, seen).map(|_| ()),
            false => recognizer
                .explain_directly(dots_seen, hint, seen)
                .map(|_| ()),
        };
        let is_likely = || seen.explanations().best().pose_confidence >= MIRROR_DOUBT;
        if !is_sought && explained.is_ok() && is_likely() {
            explained = recognizer.explain(dots_seen, hint, seen).map(|_| ());
        }
        explained.map_err(|rejection| match rejection {
            RecognizerRejection::TooFewDots { found, needed } => {
                FrameRejection::TooFewDots { found, needed }
            }
            rejection => FrameRejection::Recognizer(rejection),
        })?;
        let found = ws.recognizer.explanations().best();
        Ok(PoseHypothesis {
            rotation: found.rotation,
            camera: look.camera,
            confidence: found.confidence,
            pose_confidence: found.pose_confidence,
            evidence: self.evidence(dots, ws),
        })
    }

    /// What the recognizer's last answer shows beside its odds.
    fn evidence(
        &self,
        dots: &[DotDetection],
        ws: &EstimatorWorkspace<D::Workspace>,
    ) -> PoseEvidence {
        let found = ws.recognizer.explanations().best();
        let (mut named, mut unnamed, mut doubt, mut squares) = (0, 0, 0.0, 0.0);
        let observed = ws.indices.iter().zip(&ws.observed);
        for ((&i, seen), name) in observed.zip(&found.assignment) {
            match name {
                Some(name) => {
                    named += 1;
                    doubt -= dots[i].confidence.max(f64::MIN_POSITIVE).ln();
                    let expected = found.rotation * self.ball.pattern().dots()[usize::from(*name)];
                    squares += seen.squared_deviations(&expected);
                }
                None => unnamed += usize::from(dots[i].confidence >= LIKELY_DOT),
            }
        }
        let facing = self.ball.pattern().dots().iter();
        let facing = facing.filter(|d| (found.rotation * *d).z > FACING).count();
        PoseEvidence {
            named,
            unnamed,
            missing: facing.saturating_sub(named),
            doubt: self
                .detector
                .usual_doubt()
                .unwrap_or(doubt / named.max(1) as f64),
            misfit: (0.5 * squares / named.max(1) as f64).sqrt(),
            ..PoseEvidence::default()
        }
    }

    fn refine(
        &self,
        hypothesis: &PoseHypothesis,
        outline: &Outline,
        hinted: bool,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> std::result::Result<Pose, FrameRejection> {
        let prior = refine::Prior {
            outline: (outline.circle, outline.covariance),
            camera: self.config.camera,
            start: hypothesis.camera,
        };
        let names = self.ball.pattern().dots();
        let refined = self
            .refiner
            .refine(names, &prior, &hypothesis.rotation, out, &mut ws.matches)
            .ok_or(FrameRejection::Recognizer(RecognizerRejection::Degenerate))?;
        out.circle = Some(*refined.view.circle());
        let turn = refined.view.to_camera();
        let matrix = turn.to_rotation_matrix();
        let matrix = matrix.matrix();
        Ok(Pose {
            rotation: turn * refined.rotation,
            covariance: matrix * refined.covariance * matrix.transpose(),
            confidence: hypothesis.confidence,
            pose_confidence: hypothesis.pose_confidence,
            residual_rad: refined.residual_rad,
            residual_px: refined.residual_px,
            distance: refined.distance,
            hinted,
        })
    }

    /// The view of a frame's ball: under the distance of its pose where that was estimated.
    fn view(&self, frame: &FrameEstimate) -> Option<BallView> {
        let camera = match (frame.pose().and_then(|p| p.distance), self.config.camera) {
            (Some(distance), _) => Camera::Near {
                inverse_distance: distance.inverse_distance,
            },
            (None, CameraModel::Known(camera)) => camera,
            (None, CameraModel::Unknown(prior)) => Camera::Near {
                inverse_distance: prior.inverse_distance,
            },
        };
        BallView::new(&camera, frame.circle?).ok()
    }

    /// The direction (camera frame) of each named dot, with its name.
    pub fn named_directions<'a>(
        &'a self,
        frame: &'a FrameEstimate,
    ) -> impl Iterator<Item = (u16, Vec3)> + 'a {
        let view = self.view(frame);
        let named = frame.dots.iter().zip(&frame.assignment);
        named.filter_map(move |(dot, name)| {
            let view = view?;
            let direction = view.direction(dot.pixel)?;
            Some(((*name)?, view.to_camera() * direction))
        })
    }

    /// Where the pattern's dots in sight are expected in a frame with a pose: number, pixel and z.
    pub fn expected_dots(&self, frame: &FrameEstimate) -> Vec<(u16, super::Pixel, f64)> {
        let (Some(pose), Some(view)) = (frame.pose(), self.view(frame)) else {
            return Vec::new();
        };
        let to_view = view.to_camera().inverse() * pose.rotation;
        let dots = self.ball.pattern().dots().iter().enumerate();
        dots.map(|(j, dot)| (j as u16, to_view * dot))
            .filter(|(_, q)| q.z > view.horizon())
            .map(|(j, q)| (j, view.project(&q), q.z))
            .collect()
    }

    /// What is known of the camera.
    pub fn camera(&self) -> &CameraModel {
        &self.config.camera
    }
}

/// Whether the dots are those of the mirrored pattern: no other outline makes up for that.
fn is_mirrored(frame: &FrameEstimate) -> bool {
    matches!(frame.outcome, Err(MIRRORED))
}

/// A hint in the camera's frame, in the view frame.
fn in_view(hint: &Hint, view: &BallView) -> Hint {
    let back = view.to_camera().inverse();
    let matrix = back.to_rotation_matrix();
    let matrix = matrix.matrix();
    Hint {
        rotation: back * hint.rotation,
        covariance: matrix * hint.covariance * matrix.transpose(),
        wrong: hint.wrong,
    }
}
