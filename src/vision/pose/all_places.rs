//! A pose by all places where dots may be ([`super::dense`]), where the detections leave it open.
//!
//! The orientation that the detector's map speaks for gives the detections their names; what these and the map show says how
//! likely it is ([`TrustMap`](super::trust::TrustMap)), and the refinement makes a pose of it as of any other.

use std::time::Instant;

use nalgebra::Matrix3;

use super::dense::{DenseMatch, DenseMatcher};
use super::identify::{DISAGREEMENT, PoseHypothesis};
use super::trust::{PlacesEvidence, PoseEvidence, PoseSource};
use crate::geometry::Rotation;
use crate::vision::dots::detector::DotDetection;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::{FrameEstimate, Hypothesis, Pose};
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::{BallView, Camera};

/// A detection is named after an expected dot within so many radii of the ball in the image.
const NAMED: f64 = 0.16;
/// Standard deviation of the outline's center and radius that the match gives, radii.
const MOVED: f64 = 0.02;

impl Estimator {
    /// Looks for the orientation that the detector's second look speaks for. Where it is not likely enough, the frame stays
    /// as it was, but for the evidence.
    pub(crate) fn identify_densely(&self, ws: &mut EstimatorWorkspace, out: &mut FrameEstimate) {
        if out.is_settled() || ws.spending.is_late() {
            return;
        }
        let begun = Instant::now();
        if let Some(pose) = out.outline.and_then(|o| self.match_densely(&o, ws, out)) {
            out.outcome = Ok(pose);
        } else {
            out.circle = out.outline.map(|o| o.circle);
            out.assignment.fill(None);
        }
        ws.spending.timings.identify += begun.elapsed();
    }

    fn match_densely(
        &self,
        outline: &Outline,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<Pose> {
        let matcher = self.dense_matcher();
        let known = match self.config.camera {
            CameraModel::Unknown(_) => None,
            CameraModel::Known(camera) => Some(camera),
        };
        let inverse_distance = match &known {
            Some(camera) => Some(BallView::new(camera, outline.circle).ok()?.horizon()),
            None => None,
        };
        let found = matcher.best(&ws.heat, inverse_distance, &mut ws.dense)?;
        let camera = known.unwrap_or(Camera::Near {
            inverse_distance: found.inverse_distance,
        });
        let moved = moved(outline, &found);
        let view = BallView::new(&camera, moved.circle).ok()?;
        ws.spending.runs += 1;
        let source = PoseSource::Places(PlacesEvidence {
            score: found.score,
            margin: found.margin,
        });
        let Hypothesis { evidence, .. } =
            self.propose_match(&view, &found.rotation, source, ws, out);
        let confidence = self.config.trust.probability(&evidence);
        if confidence < self.config.min_confidence {
            return None;
        }
        let hypothesis = PoseHypothesis {
            rotation: found.rotation,
            camera,
            dots_confidence: confidence,
            confidence,
            evidence,
        };
        self.refine(&hypothesis, &moved, false, ws, out).ok()
    }

    /// What speaks for a match (view frame): what it was found by, the detections that it explains, which it names, and these alone where
    /// they show the same orientation.
    pub(crate) fn propose_match(
        &self,
        view: &BallView,
        rotation: &Rotation,
        source: PoseSource,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Hypothesis {
        self.name_dots(view, rotation, &out.dots, &mut out.assignment);
        self.observe(self.config.dot_probability[1], view, ws, &out.dots);
        let names = &out.assignment;
        let evidence = self.evidence(rotation, &out.dots, ws, |k| names[ws.indices[k]]);
        let rotation = view.to_camera() * rotation;
        let agrees = |h: &&Hypothesis| h.rotation.angle_to(&rotation) < DISAGREEMENT;
        let recognized = out.hypotheses[0].as_ref().filter(agrees);
        let hypothesis = Hypothesis {
            rotation,
            evidence: PoseEvidence {
                confidence: recognized.map_or(0.0, |h| h.evidence.confidence),
                source,
                ..evidence
            },
        };
        out.hypotheses[1] = Some(hypothesis);
        hypothesis
    }

    /// The pattern, ready to be matched.
    pub(crate) fn dense_matcher(&self) -> &DenseMatcher {
        let new = || DenseMatcher::new(self.pattern().dots());
        self.dense.get_or_init(new)
    }

    /// Gives detections the names of the expected dots next to them, the nearest first.
    fn name_dots(
        &self,
        view: &BallView,
        rotation: &Rotation,
        dots: &[DotDetection],
        names: &mut [Option<u16>],
    ) {
        let limit = self.config.recognizer.view.visibility_limit;
        let depth = limit.max(view.horizon());
        names.fill(None);
        loop {
            let mut nearest = (NAMED * view.circle().radius, None);
            for (name, dot) in (0u16..).zip(self.pattern().dots()) {
                let seen = rotation * dot;
                if seen.z < depth || names.contains(&Some(name)) {
                    continue;
                }
                let at = view.project(&seen);
                for (i, dot) in dots.iter().enumerate() {
                    let off = (dot.pixel.u - at.u).hypot(dot.pixel.v - at.v);
                    if names[i].is_none() && off < nearest.0 {
                        nearest = (off, Some((i, name)));
                    }
                }
            }
            let Some((i, name)) = nearest.1 else {
                return;
            };
            names[i] = Some(name);
        }
    }
}

/// The outline where the match has it.
fn moved(outline: &Outline, found: &DenseMatch) -> Outline {
    let radius = outline.circle.radius;
    let mut circle = outline.circle;
    circle.center.u += radius * found.shift[0];
    circle.center.v += radius * found.shift[1];
    circle.radius *= found.scale;
    Outline {
        circle,
        covariance: outline.covariance + Matrix3::from_diagonal_element((MOVED * radius).powi(2)),
        ..*outline
    }
}
