//! A pose by all places where dots may be, where the detections leave it open: by the detector's map ([`super::places`]), or by the
//! pixels of a small ball ([`super::pixels`]), whose dots merge.
//!
//! The rotation that these speak for gives the detections their names; what the detections, and the map or the pixels, show says how likely it
//! is ([`TrustMap`](super::trust::TrustMap)). The refinement makes a pose of it as of any other; on a small ball it takes the dots where the
//! pixels have them, and what is expected of the rotation is weighed with the pixels where these alone leave doubt.

use std::f64::consts::PI;
use std::time::Instant;

use nalgebra::Matrix3;

use super::identify::{CLEAR, DISAGREEMENT, PoseHypothesis, in_view};
use super::pixels;
use super::places::{self, PosedOutline};
use super::rotations::RotationSearch;
use super::trust::{PixelsEvidence, PoseEvidence, PoseSource};
use crate::geometry::{ROTATIONS, Rotation};
use crate::recognize::Hint;
use crate::vision::dots::detector::DotDetection;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::{FrameEstimate, Hypothesis, Pose};
use crate::vision::frame::outline::Outline;
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallView, Camera};
use crate::vision::optics::crop::Crop;

/// A detection is named after an expected dot within so many radii of the ball in the image.
const NAMED: f64 = 0.16;
/// Standard deviation of the outline's center and radius that a match by the map gives, radii.
const MOVED: f64 = 0.02;
/// Balls of at most this radius, pixels, are matched as a whole. On balls of 13 to 18 pixels dots stand apart: there it would answer
/// 1 of 600 frames more in good conditions, and in all conditions 18 of 600 more, 1 of these wrongly (seed 71002).
const MAX_RADIUS: f64 = 13.0;
/// Standard deviations that shading and blur add to the outline's center and radius, pixels.
const OUTLINE_PX: f64 = 0.12;
/// Probability of the dots of an accepted pose: they are not judged one by one.
const PLACED: f64 = 0.9;

impl Estimator {
    /// Looks for the rotation that the detector's second look speaks for. Where it is not likely enough, the frame stays
    /// as it was, but for the evidence.
    pub(crate) fn identify_by_places(&self, ws: &mut EstimatorWorkspace, out: &mut FrameEstimate) {
        self.identify_by(ws, out, |outline, ws, out| {
            self.match_places(outline, ws, out)
        });
    }

    /// Looks for the rotation that the pixels of a small ball speak for, and where these leave it open, for the one that they
    /// and the `hint` do. Where none is likely enough, the frame stays as it was, but for the evidence.
    pub(crate) fn identify_by_pixels(
        &self,
        crop: &Crop<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        if out.outline.is_some_and(|o| o.circle.radius <= MAX_RADIUS) {
            self.identify_by(ws, out, |outline, ws, out| {
                self.match_pixels(crop, outline, hint, ws, out)
            });
        }
    }

    /// Gives a frame that is not settled the pose of a match, if there is one.
    fn identify_by(
        &self,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
        matched: impl FnOnce(&Outline, &mut EstimatorWorkspace, &mut FrameEstimate) -> Option<Pose>,
    ) {
        let Some(outline) = out.outline.filter(|_| !out.is_settled()) else {
            return;
        };
        if ws.spending.is_detecting() || ws.spending.is_late() {
            return;
        }
        let begun = Instant::now();
        match matched(&outline, ws, out) {
            Some(pose) => out.outcome = Ok(pose),
            None => {
                out.circle = Some(outline.circle);
                out.assignment.fill(None);
            }
        }
        ws.spending.timings.identify += begun.elapsed();
    }

    fn match_places(
        &self,
        outline: &Outline,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<Pose> {
        let inverse_distance = match &self.config.camera {
            CameraModel::Unknown(_) => None,
            CameraModel::Known(camera) => {
                Some(BallView::new(camera, outline.circle).ok()?.horizon())
            }
        };
        let (dots, search) = (self.pattern().dots(), self.rotation_search());
        let (memory, aligned) = (&mut ws.search, &mut ws.aligned);
        let (fit, evidence) =
            places::best(dots, &ws.heat, inverse_distance, search, memory, aligned)?;
        let moved = moved(outline, &fit);
        let camera = self.config.camera.at_inverse_distance(fit.inverse_distance);
        let view = BallView::new(&camera, moved.circle).ok()?;
        ws.spending.runs += 1;
        let source = PoseSource::Places(evidence);
        let hypothesis = self.propose(&view, &fit.rotation, camera, source, ws, out);
        if hypothesis.confidence < self.config.min_confidence {
            return None;
        }
        self.refine(&hypothesis, &moved, false, ws, out).ok()
    }

    fn match_pixels(
        &self,
        crop: &Crop<'_>,
        outline: &Outline,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<Pose> {
        let camera = self.config.camera.at(None);
        let view = BallView::new(&camera, outline.circle).ok()?;
        ws.by_pixels.pixels().read(&BallPixels {
            gray: crop.gray,
            grid: crop.grid,
            view: &view,
        })?;
        let sigma = |k: usize| (outline.covariance[(k, k)] + OUTLINE_PX * OUTLINE_PX).sqrt();
        let start = pixels::FitStart {
            dots: self.pattern().dots(),
            view,
            outline_sigma_px: [sigma(0).max(sigma(1)), sigma(2)],
            is_unknown: matches!(self.config.camera, CameraModel::Unknown(_)),
        };
        let search = self.rotation_search();
        let back = view.to_camera().inverse();
        let hint = hint.map(|h| in_view(h, &view));
        let proposed = out.hypotheses().map(|h| back * h.rotation);
        let proposed = proposed.chain(hint.map(|h| h.rotation));
        let mut found = ws
            .by_pixels
            .best(&start, proposed, search, &mut ws.search)?;
        let mut hypothesis = self.propose_by_pixels(&view, &found, ws, out);
        // The pixels alone must be clear: of 33 poses that claim 0.85 to 0.9, 30 were right;
        // of 178 that claim more, 172 (small balls and, half as often, other things: 6 000 images, seed 71001).
        let mut needed = self.config.min_confidence.max(CLEAR);
        let hint = hint.filter(|_| hypothesis.confidence < needed);
        if let Some(hint) = &hint {
            let alone = out.hypotheses[1];
            found = ws.by_pixels.weigh_expected(&start, &expected(hint)?)?;
            hypothesis = PoseHypothesis {
                evidence: hypothesis.evidence,
                ..self.propose_by_pixels(&view, &found, ws, out)
            };
            // What the pixels alone propose stays.
            out.hypotheses[1] = alone;
            needed = self.config.min_confidence;
        }
        if hypothesis.confidence < needed {
            return None;
        }
        let min_depth = self.config.recognizer.view.visibility_limit;
        ws.by_pixels
            .place(&start, &found.0, min_depth, &mut ws.placed);
        self.refine_placed(&hypothesis, outline, hint.is_some(), ws, out)
    }

    /// Makes a pose of the dots that a match has placed; without one the detections stay.
    fn refine_placed(
        &self,
        hypothesis: &PoseHypothesis,
        outline: &Outline,
        hinted: bool,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<Pose> {
        ws.detected.clone_from(&out.dots);
        out.dots.clear();
        out.assignment.clear();
        out.dots.extend(ws.placed.iter().map(|dot| DotDetection {
            pixel: dot.pixel,
            covariance: dot.covariance,
            probability: PLACED,
        }));
        let names = ws.placed.iter().map(|dot| Some(dot.name));
        out.assignment.extend(names);
        let shaded = Matrix3::from_diagonal_element(OUTLINE_PX * OUTLINE_PX);
        let outline = Outline {
            covariance: outline.covariance + shaded,
            ..*outline
        };
        let pose = self.refine(hypothesis, &outline, hinted, ws, out);
        if pose.is_err() {
            out.dots.clone_from(&ws.detected);
            out.assignment.clear();
            out.assignment.resize(out.dots.len(), None);
        }
        pose.ok()
    }

    /// The hypothesis of a match by all pixels; it names no detection.
    fn propose_by_pixels(
        &self,
        view: &BallView,
        (fit, evidence): &(pixels::PixelFit, PixelsEvidence),
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> PoseHypothesis {
        let camera = self.config.camera.at_inverse_distance(fit.inverse_distance);
        let source = PoseSource::Pixels(*evidence);
        let proposed = self.propose(view, &fit.rotation, camera, source, ws, out);
        out.assignment.fill(None);
        proposed
    }

    /// The hypothesis of a match (view frame): what speaks for it is what it was found by, the detections that it explains, which it names, and
    /// these alone where they show the same rotation.
    fn propose(
        &self,
        view: &BallView,
        found: &Rotation,
        camera: Camera,
        source: PoseSource,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> PoseHypothesis {
        self.name_dots(view, found, &out.dots, &mut out.assignment);
        self.observe(self.config.dot_probability[1], view, ws, &out.dots);
        let names = &out.assignment;
        let evidence = self.evidence(found, &out.dots, ws, |k| names[ws.indices[k]]);
        let rotation = view.to_camera() * found;
        let agrees = |h: &&Hypothesis| h.rotation.angle_to(&rotation) < DISAGREEMENT;
        let recognized = out.hypotheses[0].as_ref().filter(agrees);
        let evidence = PoseEvidence {
            confidence: recognized.map_or(0.0, |h| h.evidence.confidence),
            source,
            ..evidence
        };
        out.hypotheses[1] = Some(Hypothesis { rotation, evidence });
        let confidence = self.config.trust.probability(&evidence);
        PoseHypothesis {
            rotation: *found,
            camera,
            dots_confidence: confidence,
            confidence,
            evidence,
        }
    }

    /// The pattern, ready to be searched for.
    pub(crate) fn rotation_search(&self) -> &RotationSearch {
        let new = || RotationSearch::new(self.pattern().dots());
        self.rotation_search.get_or_init(new)
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
fn moved(outline: &Outline, found: &PosedOutline) -> Outline {
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

/// The logarithm of how much likelier a hint makes an orientation (view frame) than it is without.
fn expected(hint: &Hint) -> Option<impl Fn(&Rotation) -> f64 + use<>> {
    let hint = *hint;
    let inverse = hint.covariance.try_inverse()?;
    let volume = (2.0 * PI).powf(1.5) * hint.covariance.determinant().sqrt();
    Some(move |rotation: &Rotation| {
        let off = (rotation * hint.rotation.inverse()).scaled_axis();
        let near = (-0.5 * off.dot(&(inverse * off))).exp() * ROTATIONS / volume;
        ((1.0 - hint.wrong) * near + hint.wrong).ln()
    })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::random_rotation;

    #[test]
    fn a_hint_adds_no_probability() {
        let mut rng = ChaCha8Rng::seed_from_u64(32_400_701);
        let hint = Hint {
            wrong: 0.1,
            ..Hint::isotropic(random_rotation(&mut rng), 0.35)
        };
        let ln = expected(&hint).expect("a covariance");
        let count = 200_000;
        let mean = (0..count)
            .map(|_| ln(&random_rotation(&mut rng)).exp())
            .sum::<f64>()
            / f64::from(count);
        // Over all orientations a density relative to the uniform one has the mean 1; its Gaussian in the tangent space is a
        // little too wide on the sphere of rotations: by 1 - sigma^2 / 4 for small sigma.
        assert!(
            (mean - (1.0 - 0.9 * 0.35 * 0.35 / 4.0)).abs() < 0.03,
            "{mean}"
        );
    }
}
