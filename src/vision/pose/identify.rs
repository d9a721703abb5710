//! Dots to a pose: which dot is which, under which distance of the camera, and how sure that is.
//!
//! Likely detections come first, doubtful ones after them, each under the camera's distances, the likeliest first, until a
//! pose is clear. Its probability is the recognizer's, weighed by what else the frame shows ([`TrustMap`]). An expected
//! orientation is weighed with the dots where these leave doubt or show another one.

use std::time::Instant;

use nalgebra::Matrix2;

use super::refine::{self, Drawn, RefinedFrame};
use super::trust::{PoseEvidence, TrustMap};
use crate::geometry::{Rotation, Vec3};
use crate::recognize::{Hint, Recognizer, RecognizerRejection};
use crate::view::DotUncertainty;
use crate::vision::dots::detector::{DotDetection, LIKELY_DOT};
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::estimate::{
    FrameEstimate, FrameRejection, Hypothesis, MIRRORED, Pose, Standing, is_mirrored,
};
use crate::vision::frame::outline::Outline;
use crate::vision::frame::prior::{Budget, Spending};
use crate::vision::optics::camera::{BallView, Camera};
use crate::vision::optics::oval::Oval;

/// Poses likelier than this are compared with those of the mirrored view.
const MIRROR_DOUBT: f64 = 0.3;
/// An orientation farther off the expected one than this, radians, is weighed with it: 25 deg.
pub(crate) const DISAGREEMENT: f64 = 0.436;
/// An outline that stands in doubt is looked at again where its best pose is likelier than this.
pub(crate) const PROMISING: f64 = 0.05;
/// Without a pose likelier than this, doubtful detections are tried as well.
pub(crate) const CLEAR: f64 = 0.9;

/// A recognizer's answer in terms of detections.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoseHypothesis {
    /// Pattern to view frame.
    pub(crate) rotation: Rotation,
    /// The camera under which the dots were identified.
    pub(crate) camera: Camera,
    pub(crate) dots_confidence: f64,
    pub(crate) confidence: f64,
    pub(crate) evidence: PoseEvidence,
}

impl PoseHypothesis {
    /// The best of several attempts has more chances to be good by accident: its odds are divided by their number.
    fn discounted(self, attempts: usize) -> Self {
        let less = |p: f64| p / (p + (1.0 - p) * attempts.max(1) as f64);
        Self {
            dots_confidence: less(self.dots_confidence),
            confidence: less(self.confidence),
            ..self
        }
    }

    /// The probability by all that is known of the pose.
    fn weighed(self, map: &TrustMap) -> Self {
        let evidence = PoseEvidence {
            confidence: self.confidence,
            ..self.evidence
        };
        let confidence = map.probability(&evidence);
        let share = confidence / self.confidence.max(f64::MIN_POSITIVE);
        Self {
            dots_confidence: (self.dots_confidence * share).min(confidence),
            confidence,
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

/// The detections that are tried, and under which distances of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Detections {
    /// Those that are likelier dots than not.
    Likely,
    /// Those, then the doubtful ones too.
    All,
    /// The likely ones under this camera alone: for an outline beside one that has a certain pose under it.
    LikelyUnder(Camera),
}

/// When a run looks at the mirrored view, which costs more than the view itself where that shows no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mirrored {
    /// Always: a mirrored ball ends the search for other outlines.
    Sought,
    /// Where the pose is likelier than [`MIRROR_DOUBT`]: its mirror image may explain the dots as well.
    Compared,
}

/// The probability of the best pose so far.
fn promise_of(found: &std::result::Result<PoseHypothesis, FrameRejection>) -> f64 {
    found.as_ref().map_or(0.0, |f| f.confidence)
}

impl EstimatorWorkspace {
    /// Names the detections as the best explanation of the last run does, where there is one.
    fn name(&self, is_explained: bool, assignment: &mut [Option<u16>]) {
        assignment.fill(None);
        if is_explained {
            let names = &self.recognizer.explanations().best().assignment;
            for (&i, name) in self.indices.iter().zip(names) {
                assignment[i] = *name;
            }
        }
    }
}

impl Estimator {
    /// Estimates the orientation from the detected dots of a frame, without its pixels: those that another detector found, or
    /// those of another estimator. The answer depends on the detections and the outline as found alone.
    pub fn identify_detections(&self, ws: &mut EstimatorWorkspace, out: &mut FrameEstimate) {
        ws.spending = Spending::of(Budget {
            spent: out.earlier_attempts,
            ..Budget::default()
        });
        self.identify(Detections::All, ws, out);
        self.locate(None, out);
        (out.attempts, out.timings) = (ws.spending.runs, ws.spending.timings);
    }

    /// The same within what may be spent on the frame in hand.
    pub(crate) fn identify(
        &self,
        detections: Detections,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        let Some(outline) = out.outline else {
            return;
        };
        if ws.spending.is_detecting() {
            ws.spending.has_detected = true;
            return;
        }
        let begun = Instant::now();
        out.earlier_attempts = ws.spending.runs;
        out.outcome = self.identify_dots(&outline, detections, None, ws, out);
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
        ws.spending.timings.identify += begun.elapsed();
    }

    /// Weighs the dots with an expected orientation, where alone they have none or another one. An orientation that they
    /// keep against it stays theirs.
    pub(crate) fn identify_expected(
        &self,
        hint: &Hint,
        ws: &mut EstimatorWorkspace,
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
        let hypotheses = out.hypotheses;
        out.outcome = self.identify_dots(&outline, Detections::All, Some(hint), ws, out);
        match (&mut out.outcome, alone) {
            (Ok(pose), Ok(alone)) => {
                pose.hinted = pose.rotation.angle_to(&alone.rotation) >= DISAGREEMENT;
            }
            (Ok(_), Err(_)) => {}
            (outcome @ Err(_), alone) => {
                // Why the dots alone give no pose says more.
                if alone.is_err() {
                    *outcome = alone;
                    out.hypotheses = hypotheses;
                }
                out.circle = Some(outline.circle);
                out.assignment.fill(None);
            }
        }
        ws.spending.timings.identify += begun.elapsed();
    }

    /// The pose of the detections, with an expected one weighed if there is one.
    fn identify_dots(
        &self,
        outline: &Outline,
        detections: Detections,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> std::result::Result<Pose, FrameRejection> {
        out.hypotheses = [None; 2];
        let earlier = ws.spending.runs;
        let best = self.likeliest(outline, detections, hint, ws, out)?;
        // What is expected was not chosen among many: only the runs that weigh it count.
        let mut best = best.discounted(match hint {
            Some(_) => ws.spending.runs - earlier,
            None => ws.spending.chances(),
        });
        if hint.is_none() {
            best = best.weighed(&self.config.trust);
            let view = BallView::new(&best.camera, outline.circle);
            out.hypotheses[0] = view.ok().map(|view| Hypothesis {
                rotation: view.to_camera() * best.rotation,
                evidence: best.evidence,
            });
        }
        if best.confidence < self.config.min_confidence {
            let confidence = best.confidence;
            return Err(FrameRejection::Ambiguous { confidence });
        }
        self.refine(&best, outline, hint.is_some(), ws, out)
    }

    /// The likeliest pose under any of the camera's distances, of the likely detections, then of all, until one is clear; its names
    /// are assigned.
    fn likeliest(
        &self,
        outline: &Outline,
        detections: Detections,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> std::result::Result<PoseHypothesis, FrameRejection> {
        let mut best = Err(FrameRejection::NotProcessed);
        let all = self.config.camera.hypotheses();
        let (passes, cameras, mut mirrored) = match detections {
            Detections::Likely => (1, all, Mirrored::Sought),
            Detections::All => (self.recognizers.len(), all, Mirrored::Sought),
            Detections::LikelyUnder(camera) => (1, [Some(camera), None, None], Mirrored::Compared),
        };
        for pass in 0..passes {
            // Doubtful detections alone may show an expected orientation.
            let is_hopeless = hint.is_none() && promise_of(&best) < PROMISING;
            if pass > 0 && out.standing == Standing::Doubtful && is_hopeless {
                break;
            }
            for camera in cameras.into_iter().flatten() {
                if mirrored == Mirrored::Compared && ws.spending.is_late() {
                    return best;
                }
                let Ok(view) = BallView::new(&camera, outline.circle) else {
                    return Err(FrameRejection::Recognizer(RecognizerRejection::Degenerate));
                };
                let hint = hint.map(|h| in_view(h, &view));
                let look = Look {
                    pass,
                    camera,
                    mirrored,
                };
                let found = self.recognize(&look, &view, hint.as_ref(), ws, &out.dots);
                ws.spending.runs += 1;
                mirrored = Mirrored::Compared;
                // What the mirror explains beyond doubt, other dots or another distance may still
                // explain by accident.
                if let Err(MIRRORED) = found {
                    return found;
                }
                let is_better = |found: &PoseHypothesis| found.confidence > promise_of(&best);
                if best.is_err() || found.as_ref().is_ok_and(is_better) {
                    ws.name(found.is_ok(), &mut out.assignment);
                    best = found;
                }
                if promise_of(&best) >= CLEAR {
                    return best;
                }
            }
        }
        best
    }

    /// One run of the recognizer over the detections that are likely enough for this pass.
    fn recognize(
        &self,
        look: &Look,
        view: &BallView,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        dots: &[DotDetection],
    ) -> std::result::Result<PoseHypothesis, FrameRejection> {
        self.observe(self.config.dot_probability[look.pass], view, ws, dots);
        let recognizer = &self.recognizers[look.pass];
        let (dots_seen, seen) = (&ws.observed, &mut ws.recognizer);
        let is_sought = look.mirrored == Mirrored::Sought;
        let mut explained = match is_sought {
            true => recognizer.explain(dots_seen, hint, seen).map(|_| ()),
            false => recognizer
                .explain_directly(dots_seen, hint, seen)
                .map(|_| ()),
        };
        let is_likely = || seen.explanations().best().confidence >= MIRROR_DOUBT;
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
            dots_confidence: found.dots_confidence,
            confidence: found.confidence,
            evidence: self.evidence(&found.rotation, dots, ws, |k| found.assignment[k]),
        })
    }

    /// The detections that are at least so likely, on the sphere.
    pub(crate) fn observe(
        &self,
        min_probability: f64,
        view: &BallView,
        ws: &mut EstimatorWorkspace,
        dots: &[DotDetection],
    ) {
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
            if dot.probability < min_probability {
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
    }

    /// What a pose shows beside its odds, with the names of the dots in hand.
    pub(crate) fn evidence(
        &self,
        rotation: &Rotation,
        dots: &[DotDetection],
        ws: &EstimatorWorkspace,
        name: impl Fn(usize) -> Option<u16>,
    ) -> PoseEvidence {
        let pattern = self.ball.pattern().dots();
        let missing_dot = |dot: &Vec3| PoseEvidence::missing_dot((rotation * dot).z);
        let mut missing: f64 = pattern.iter().map(missing_dot).sum();
        let (mut named, mut unnamed, mut doubt, mut squares) = (0, 0.0, 0.0, 0.0);
        let observed = ws.indices.iter().zip(&ws.observed);
        for (k, (&i, seen)) in observed.enumerate() {
            let probability = dots[i].probability;
            match name(k) {
                Some(name) => {
                    named += 1;
                    doubt -= probability.max(f64::MIN_POSITIVE).ln();
                    let dot = &pattern[usize::from(name)];
                    squares += seen.squared_deviations(&(rotation * dot));
                    missing -= missing_dot(dot);
                }
                None if probability >= LIKELY_DOT => {
                    unnamed += PoseEvidence::unnamed_dot(probability, seen.direction.z);
                }
                None => {}
            }
        }
        PoseEvidence {
            named,
            unnamed,
            missing: missing.max(0.0),
            doubt: self
                .detector
                .usual_doubt()
                .unwrap_or(doubt / named.max(1) as f64),
            misfit: (0.5 * squares / named.max(1) as f64).sqrt(),
            ..PoseEvidence::default()
        }
    }

    /// Refines an accepted pose on the detections.
    pub(crate) fn refine(
        &self,
        hypothesis: &PoseHypothesis,
        outline: &Outline,
        hinted: bool,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> std::result::Result<Pose, FrameRejection> {
        let PoseHypothesis {
            rotation, camera, ..
        } = hypothesis;
        let refined = self
            .refined(rotation, *camera, (outline, None), Drawn::AsStated, ws, out)
            .ok_or(FrameRejection::Recognizer(RecognizerRejection::Degenerate))?;
        out.circle = Some(*refined.view.circle());
        Ok(refined.pose(hypothesis.dots_confidence, hypothesis.confidence, hinted))
    }

    /// The orientation (from one in the view frame on) that fits the named dots of a frame best.
    pub(crate) fn refined(
        &self,
        rotation: &Rotation,
        start: Camera,
        (outline, oval): (&Outline, Option<Oval>),
        drawn: Drawn,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<RefinedFrame> {
        let prior = refine::PosePrior {
            outline: *outline,
            oval,
            camera: self.config.camera,
            start,
            drawn,
            axis: out.axis,
        };
        let names = self.ball.pattern().dots();
        self.refiner
            .refine(names, &prior, rotation, out, &mut ws.matches)
    }
}

/// A hint in the camera's frame, in the view frame.
pub(crate) fn in_view(hint: &Hint, view: &BallView) -> Hint {
    let back = view.to_camera().inverse();
    let matrix = back.to_rotation_matrix();
    let matrix = matrix.matrix();
    Hint {
        rotation: back * hint.rotation,
        covariance: matrix * hint.covariance * matrix.transpose(),
        wrong: hint.wrong,
    }
}
