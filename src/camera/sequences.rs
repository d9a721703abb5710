//! The spin that a sequence of frames gives, and how far off it is.

use serde::{Deserialize, Serialize};

use crate::clip::sequence::{SequenceConfig, estimate_sequence, estimate_spin};
use crate::error::Result;
use crate::geometry::{Vec3, angle_between};
use crate::image::ImageView;
use crate::stats::{Proportion, median_or_nan, or_nan};
use crate::synth::dataset::SynthSequence;
use crate::vision::Estimator;

/// A spin vector off by less than this part of its magnitude is right (SpinDOE Sec. IV-C).
pub const SPIN_TOLERANCE: f64 = 0.2;

/// The spins of sequences.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpinRates {
    /// Frames of a sequence.
    pub frames: usize,
    /// A spin is given.
    pub reported: Proportion,
    /// The spin vector is off by less than 20 % of its magnitude; of all sequences.
    pub right: Proportion,
    /// Median error of the spin vector of the right ones, revolutions per second; this and the next two are NaN
    /// without any, which JSON has as null.
    #[serde(deserialize_with = "or_nan")]
    pub median_error_rps: f64,
    /// Median error of their magnitude, revolutions per second.
    #[serde(deserialize_with = "or_nan")]
    pub median_magnitude_error_rps: f64,
    /// Median angle between their axis and the true one, degrees.
    #[serde(deserialize_with = "or_nan")]
    pub median_axis_error_deg: f64,
    /// Mean share of the frames with an orientation.
    pub frames_answered: f64,
    /// Seed of the sequences.
    pub seed: u64,
}

/// A sequence's outcome.
pub(super) struct SpinOutcome {
    truth: Vec3,
    spin: Option<Vec3>,
    answered: usize,
}

impl SpinOutcome {
    /// What the estimator says of the first `count` frames of a sequence, at `fps` frames a second.
    pub fn of(
        estimator: &Estimator,
        sequence: &SynthSequence,
        fps: f64,
        count: usize,
    ) -> Result<Self> {
        let mut truth = Vec3::zeros();
        let mut images = Vec::with_capacity(count);
        for i in 0..count {
            let (scene, _) = sequence.scene(i);
            if i == 0 {
                // An observer without intrinsics sees the spin in the view frame.
                truth = scene.to_view()? * scene.spin;
            }
            images.push(scene.render()?.image);
        }
        let images: Vec<ImageView<'_>> = images.iter().map(ImageView::from).collect();
        let times: Vec<f64> = (0..count).map(|i| i as f64 / fps).collect();
        let config = SequenceConfig::default();
        let (estimates, _) = estimate_sequence(estimator, &config, &times, &images);
        Ok(Self {
            truth,
            spin: estimate_spin(&config, &times, &estimates)
                .ok()
                .map(|fit| fit.motion.spin),
            answered: estimates.iter().filter(|f| f.pose().is_some()).count(),
        })
    }
}

impl SpinRates {
    /// The rates of these outcomes of sequences of so many frames.
    pub(super) fn of(outcomes: &[SpinOutcome], frames: usize, seed: u64) -> Self {
        let n = outcomes.len() as u64;
        let mut errors: [Vec<f64>; 3] = Default::default();
        let mut reported = 0;
        for outcome in outcomes {
            let Some(spin) = outcome.spin else { continue };
            reported += 1;
            let (off, magnitude) = ((spin - outcome.truth).norm(), outcome.truth.norm());
            if off >= SPIN_TOLERANCE * magnitude {
                continue;
            }
            errors[0].push(off / std::f64::consts::TAU);
            errors[1].push((spin.norm() - magnitude).abs() / std::f64::consts::TAU);
            errors[2].push(angle_between(&spin, &outcome.truth).to_degrees());
        }
        for errors in &mut errors {
            errors.sort_unstable_by(f64::total_cmp);
        }
        let answered: usize = outcomes.iter().map(|o| o.answered).sum();
        let [error, magnitude, axis] = errors.each_ref().map(|e| median_or_nan(e));
        Self {
            frames,
            reported: Proportion::new(reported, n),
            right: Proportion::new(errors[0].len() as u64, n),
            median_error_rps: error,
            median_magnitude_error_rps: magnitude,
            median_axis_error_deg: axis,
            frames_answered: answered as f64 / (n.max(1) as f64 * frames as f64),
            seed,
        }
    }
}
