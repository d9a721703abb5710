//! The smears of a sequence as evidence for its spin.
//!
//! Orientations at even times leave open how many whole turns lie between two frames; how far the dots move while the shutter is
//! open does not. Each frame weighs a spin by [`Smear::ln_likelihood`] of the turn `spin * exposure`, with the ball's own motion
//! by the outlines of the frames around it. Frames of one clip err alike (one lens, one set of dots, one brightness): together
//! they count as [`INDEPENDENT`] of them at most. The exposure is known to [`EXPOSURE_SIGMA`] of it: the likelihood is that of
//! the factor on it that suits best, with the factor's own.
//!
//! The sign of a spin is open where the ball hardly moves in the image. An exposure that is off by more than that decides for
//! another spin: see [`SequenceSmears::exposure_factor`].

use nalgebra::Vector2;

use super::orientations::NamedFrame;
use crate::geometry::{CameraFrame, Rotation, Vec3};
use crate::spin::alias::SpinEvidence;
use crate::stats::median;
use crate::vision::dots::smear::{DotBlur, Smear, UnmeasuredDots};
use crate::vision::estimator::Estimator;
use crate::vision::frame::estimate::FrameEstimate;

/// As many frames as those of a clip count for, at most: chosen, and the rates of `bench smear-clips` measured with it.
const INDEPENDENT: f64 = 4.0;
/// Standard deviation of the exposure, over it.
const EXPOSURE_SIGMA: f64 = 0.1;
/// Factors of the exposure that are tried, in deviations.
const FACTORS: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
/// Nearer than this, radians, a measured place is that of the dot: half the least distance of dots on any shipped design.
const SAME_DOT: f64 = 0.1;
/// Ln odds of a turn against none from which on a frame says how long its smear is.
const CLEAR: f64 = 5.0;
/// Smaller turns, radians, are clear where they seem larger: their length is not compared.
const MIN_COMPARED: f64 = 0.09;

impl Estimator {
    /// How the dots of a frame with a pose are smeared, whose ball moved by `shift` pixels while the shutter was open; `None` where
    /// no blur is measured ([`EstimatorConfig::measures_blur`](crate::vision::frame::config::EstimatorConfig::measures_blur)), or of fewer than three dots.
    pub fn smear(&self, frame: &FrameEstimate, shift: Vector2<f64>) -> Option<Smear> {
        // Where nothing is measured, nothing may have been tried: a deadline, places that were not refined.
        if frame.blurs.is_empty() {
            return None;
        }
        let (view, pose) = (self.view(frame)?, frame.pose()?);
        let to_view = view.to_camera().inverse() * pose.rotation;
        let is_measured = |middle: &Vec3| {
            let near = |blur: &DotBlur| blur.middle.angle(middle) < SAME_DOT;
            frame.blurs.iter().any(near)
        };
        let named = frame.assignment.iter().flatten();
        let middles = named.map(|&name| to_view * self.pattern().dots()[usize::from(name)]);
        let middles: Vec<Vec3> = middles.filter(|middle| !is_measured(middle)).collect();
        let mut radii: Vec<f64> = frame.blurs.iter().map(|blur| blur.radius).collect();
        let others = UnmeasuredDots {
            middles: &middles,
            radius: median(&mut radii),
        };
        Smear::new(&view, &frame.blurs, others, shift)
    }
}

/// The smears of the frames of a sequence.
pub struct SequenceSmears {
    smears: Vec<Smear>,
    exposure_s: f64,
    to_camera: Rotation,
    weight: f64,
}

impl SequenceSmears {
    /// Of the frames that have times, which increase, whose shutter was open for `exposure_s`; spins are in `frame`. `None` where no
    /// frame has a smear: see [`Estimator::smear`].
    pub fn new(
        estimator: &Estimator,
        frames: &[NamedFrame<'_>],
        exposure_s: f64,
        frame: CameraFrame,
    ) -> Option<Self> {
        let smear = |k: usize| {
            let shift = velocity(frames, k) * exposure_s;
            estimator.smear(frames[k].estimate, shift)
        };
        let smears: Vec<Smear> = (0..frames.len()).filter_map(smear).collect();
        let weight = independent(smears.len());
        (!smears.is_empty()).then(|| Self {
            smears,
            exposure_s,
            to_camera: frame.turn().inverse(),
            weight,
        })
    }

    /// Number of frames used.
    pub fn frames(&self) -> usize {
        self.smears.len()
    }

    /// How long the smears are over what a spin makes of the exposure, the median of the frames whose smear is clear; `None` where none
    /// is, or where the spin smears by less or more than is measured. Far from 1 the exposure or the spin is wrong.
    pub fn exposure_factor(&self, spin: &Vec3) -> Option<f64> {
        let expected = spin.norm() * self.exposure_s;
        let is_measured = |smear: &&Smear| (MIN_COMPARED..smear.max_turn()).contains(&expected);
        let clear = self.smears.iter().filter(is_measured);
        let turns = clear.filter_map(|smear| smear.turn().filter(|turn| turn.evidence >= CLEAR));
        let mut factors: Vec<f64> = turns.map(|turn| turn.angle() / expected).collect();
        (!factors.is_empty()).then(|| median(&mut factors))
    }
}

impl SpinEvidence for SequenceSmears {
    fn ln_likelihood(&self, spin: &Vec3) -> f64 {
        let turn = self.to_camera * spin * self.exposure_s;
        let by_factor = |deviations: f64| {
            let turn = turn * (1.0 + EXPOSURE_SIGMA * deviations);
            let all: f64 = self.smears.iter().map(|s| s.ln_likelihood(&turn)).sum();
            self.weight * all - 0.5 * deviations * deviations
        };
        FACTORS
            .map(by_factor)
            .into_iter()
            .fold(f64::NEG_INFINITY, f64::max)
    }
}

/// What each of so many frames of one clip counts for.
pub(crate) fn independent(frames: usize) -> f64 {
    (INDEPENDENT / frames as f64).min(1.0)
}

/// How fast the ball moves in the image at a frame, pixels a second, by the frames next to it; 0 where those have no outline or no
/// time.
pub(crate) fn velocity(frames: &[NamedFrame<'_>], k: usize) -> Vector2<f64> {
    let seen = |k: usize| {
        let frame = frames.get(k)?;
        Some((frame.time_s?, frame.estimate.circle?.center))
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
