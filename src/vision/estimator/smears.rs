//! The smears of a sequence as evidence for its spin.
//!
//! Orientations at even times leave open how many whole turns lie between two frames; how far the dots move while the shutter is
//! open does not. Each frame weighs a spin by [`Smear::ln_likelihood`] of the turn `spin * exposure`, with the ball's own motion
//! by the outlines of the frames around it. Frames of one clip err alike (one lens, one set of dots, one brightness): together
//! they count as [`INDEPENDENT`] of them at most.
//!
//! The sign of a spin is open where the ball hardly moves in the image.

use nalgebra::Vector2;

use super::{Estimator, FrameEstimate};
use crate::geometry::{Rotation, Vec3};
use crate::spin::alias::SpinEvidence;
use crate::vision::detect::DotDetector;
use crate::vision::smear::Smear;

/// As many frames as those of a clip count for, at most.
const INDEPENDENT: f64 = 4.0;

/// The smears of the frames of a sequence.
pub struct SequenceSmears {
    smears: Vec<Smear>,
    exposure_s: f64,
    to_camera: Rotation,
    weight: f64,
}

impl SequenceSmears {
    /// Of frames with their times in seconds, increasing, whose shutter was open for `exposure_s`; spins are in the frame that
    /// `turn` leads to from the camera's. `None` where no frame has enough dots whose blur was measured: see
    /// [`EstimatorConfig::measures_blur`](super::EstimatorConfig::measures_blur).
    pub fn new<D: DotDetector>(
        estimator: &Estimator<D>,
        frames: &[(f64, &FrameEstimate)],
        exposure_s: f64,
        turn: &Rotation,
    ) -> Option<Self> {
        let smear = |k: usize| {
            let shift = velocity(frames, k) * exposure_s;
            estimator.smear(frames[k].1, shift)
        };
        let smears: Vec<Smear> = (0..frames.len()).filter_map(smear).collect();
        let weight = (INDEPENDENT / smears.len() as f64).min(1.0);
        (!smears.is_empty()).then_some(Self {
            smears,
            exposure_s,
            to_camera: turn.inverse(),
            weight,
        })
    }

    /// Number of frames that have a say.
    pub fn frames(&self) -> usize {
        self.smears.len()
    }
}

impl SpinEvidence for SequenceSmears {
    fn ln_likelihood(&self, spin: &Vec3) -> f64 {
        let turn = self.to_camera * spin * self.exposure_s;
        let all: f64 = self.smears.iter().map(|s| s.ln_likelihood(&turn)).sum();
        self.weight * all
    }
}

/// How fast the ball moves in the image at a frame, pixels a second, by the frames next to it; 0 where those have no outline.
fn velocity(frames: &[(f64, &FrameEstimate)], k: usize) -> Vector2<f64> {
    let seen = |k: usize| {
        let (time_s, frame) = frames.get(k)?;
        frame.circle.map(|circle| (*time_s, circle.center))
    };
    let before = k.checked_sub(1).and_then(seen).or_else(|| seen(k));
    let after = seen(k + 1).or_else(|| seen(k));
    match (before, after) {
        (Some((from_s, from)), Some((to_s, to))) if to_s > from_s => {
            Vector2::new(to.u - from.u, to.v - from.v) / (to_s - from_s)
        }
        _ => Vector2::zeros(),
    }
}
