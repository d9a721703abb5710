//! A pose of a small ball by all of its pixels ([`super::pixels`]), where its dots, which merge there, leave it open.
//!
//! What is expected of the orientation is weighed with the pixels where these alone leave doubt. The dots of an accepted
//! pose are placed by the pixels, and the refinement makes a pose of them as of any other.

use std::f64::consts::PI;
use std::time::Instant;

use nalgebra::Matrix3;

use super::identify::{CLEAR, PoseHypothesis, in_view};
use super::pixels::{self, WholeMatch};
use super::trust::{PixelsEvidence, PoseEvidence, PoseSource};
use crate::geometry::{ROTATIONS, Rotation};
use crate::recognize::Hint;
use crate::vision::dots::detector::DotDetection;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::frame::outline::Outline;
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallView, Camera};
use crate::vision::optics::crop::Crop;

/// Balls of at most this radius, pixels, are matched as a whole. On balls of 13 to 18 pixels dots stand apart: there it would answer
/// 1 of 600 frames more in good conditions, and in all conditions 18 of 600 more, 1 of these wrongly (seed 71002).
const MAX_RADIUS: f64 = 13.0;
/// Standard deviations that shading and blur add to the outline's center and radius, pixels.
const OUTLINE_PX: f64 = 0.12;
/// Probability of the dots of an accepted pose: they are not judged one by one.
const PLACED: f64 = 0.9;

impl Estimator {
    /// Looks for the orientation that the pixels of a small ball speak for, and where these leave it open, for the one that they
    /// and the `hint` do. Where none is likely enough, the frame stays as it was, but for the evidence.
    pub(crate) fn identify_whole(
        &self,
        crop: &Crop<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) {
        let is_small = |o: &Outline| o.circle.radius <= MAX_RADIUS;
        let Some(outline) = out.outline.filter(is_small) else {
            return;
        };
        if out.is_settled() || ws.spending.is_late() {
            return;
        }
        let begun = Instant::now();
        if self.match_whole(crop, &outline, hint, ws, out).is_none() && out.pose().is_none() {
            out.circle = Some(outline.circle);
        }
        ws.spending.timings.identify += begun.elapsed();
    }

    fn match_whole(
        &self,
        crop: &Crop<'_>,
        outline: &Outline,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<()> {
        let camera = self.config.camera.at(None);
        let view = BallView::new(&camera, outline.circle).ok()?;
        let pixels = BallPixels {
            gray: crop.gray,
            grid: crop.grid,
            view: &view,
        };
        ws.whole.pixels().read(&pixels)?;
        let sigma = |k: usize| (outline.covariance[(k, k)] + OUTLINE_PX * OUTLINE_PX).sqrt();
        let is_unknown = matches!(self.config.camera, CameraModel::Unknown(_));
        let start = pixels::start(view, [sigma(0).max(sigma(1)), sigma(2)], is_unknown);
        let dots = self.pattern().dots();
        let back = view.to_camera().inverse();
        let hint = hint.map(|h| in_view(h, &view));
        let proposed = out.hypotheses().map(|h| back * h.rotation);
        let proposed = proposed.chain(hint.map(|h| h.rotation));
        let matcher = self.dense_matcher();
        let mut found = ws
            .whole
            .best(dots, matcher, &start, proposed, &mut ws.dense)?;
        let evidence = self.propose_whole(&view, &found, ws, out);
        let alone = out.hypotheses[1];
        let mut confidence = self.config.trust.probability(&evidence);
        // The pixels alone must be clear: of 33 poses that claim 0.85 to 0.9, 30 were right;
        // of 178 that claim more, 172 (small balls and, half as often, other things: 6 000 images, seed 71001).
        let (min, clear) = (
            self.config.min_confidence,
            self.config.min_confidence.max(CLEAR),
        );
        let hint = hint.filter(|_| confidence < clear);
        if let Some(hint) = &hint {
            found = ws.whole.weigh_expected(dots, &start, &expected(hint)?)?;
            let expected = self.propose_whole(&view, &found, ws, out);
            confidence = self.config.trust.probability(&expected);
            // What the pixels alone propose stays.
            out.hypotheses[1] = alone;
        }
        if confidence < if hint.is_some() { min } else { clear } {
            return None;
        }
        let min_depth = self.config.recognizer.view.visibility_limit;
        let placed = &mut ws.placed;
        ws.whole.place(dots, &start, &found.fit, min_depth, placed);
        let camera = match self.config.camera {
            CameraModel::Unknown(_) => Camera::Near {
                inverse_distance: found.fit.inverse_distance,
            },
            CameraModel::Known(camera) => camera,
        };
        let hypothesis = PoseHypothesis {
            rotation: found.fit.rotation,
            camera,
            dots_confidence: confidence,
            confidence,
            evidence,
        };
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
    ) -> Option<()> {
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
        out.outcome = Ok(pose.ok()?);
        Some(())
    }

    /// What speaks for a match by all pixels; it names no detection.
    fn propose_whole(
        &self,
        view: &BallView,
        found: &WholeMatch,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> PoseEvidence {
        let source = PoseSource::Pixels(PixelsEvidence {
            margin: found.margin,
            explained: found.explained,
        });
        let proposed = self.propose_match(view, &found.fit.rotation, source, ws, out);
        out.assignment.fill(None);
        proposed.evidence
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
