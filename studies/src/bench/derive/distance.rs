//! The error of the camera's distance by all frames of a sequence over that of one: dots drawn off their places, a biased outline and
//! what is expected beforehand mislead all alike.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::image::ImageView;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, Sequence};
use spindoe::vision::estimator::{SequenceConfig, SequenceView, estimate_sequence};
use spindoe::vision::{Estimator, FrameEstimate, NamedDetector};
use spindoe_studies::Outcome;
use spindoe_studies::frames::{DOTS20, estimator, good_conditions};

/// Sequences, the frames of each, and the seed of the first.
const SEQUENCES: u64 = 200;
const FRAMES: usize = 8;
const SEED: u64 = 14_240_001;
/// Share of the sequences that is to lie within so many standard deviations.
const SHARE: f64 = 0.95;
const BOUND: f64 = 1.96;

/// The standard deviation of the angle between neighboring pixels over that of one frame's, which 95 of 100 sequences of
/// balls that cross the picture need.
pub fn shared() -> Outcome<f64> {
    let pattern = Pattern::read_csv(DOTS20.as_ref())?;
    let estimator = estimator(&pattern)?;
    let off: spindoe::Result<Vec<Option<f64>>> = (0..SEQUENCES)
        .into_par_iter()
        .map(|k| deviations(&pattern, &estimator, SEED + k))
        .collect();
    let mut off: Vec<f64> = off?.into_iter().flatten().map(f64::abs).collect();
    off.sort_by(f64::total_cmp);
    let at = (SHARE * off.len() as f64) as usize;
    let bound = off.get(at).copied().unwrap_or(f64::NAN);
    eprintln!("{} sequences, 95 % within {bound:.3}", off.len());
    Ok(bound / BOUND)
}

/// The error of a sequence's angle between neighboring pixels, in standard deviations of a frame's.
fn deviations(
    pattern: &Pattern,
    estimator: &Estimator<NamedDetector>,
    seed: u64,
) -> spindoe::Result<Option<f64>> {
    let config = SynthConfig {
        max_off_axis_rad: 0.35,
        image_px: Some([640, 480]),
        ball_px: Some([60.0; 2]),
        rps: [5.0, 80.0],
        ..good_conditions().config
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (along, angle) = (rng.random_range(100.0..400.0), rng.random_range(0.0..TAU));
    let timing = ClipConfig {
        fps: 400.0,
        drift_px: Some([along * f64::cos(angle), 0.7 * along * f64::sin(angle)]),
        ..ClipConfig::default()
    };
    let sequence = Sequence::random(pattern, &config, &timing, seed, FRAMES)?;
    let rendered = (0..FRAMES).map(|k| sequence.frame(k));
    let rendered = rendered.collect::<spindoe::Result<Vec<_>>>()?;
    let times: Vec<f64> = rendered.iter().filter_map(|f| f.truth.time_s).collect();
    let images: Vec<ImageView<'_>> = rendered.iter().map(|f| (&f.image).into()).collect();
    let (frames, _) = estimate_sequence(estimator, &SequenceConfig::default(), &times, &images);
    let exact = rendered[0].truth.intrinsics.map_or(0.0, |k| 1.0 / k.fx);
    // As `SequenceView` weighs the frames.
    let weight = |frame: &FrameEstimate| {
        let (circle, distance) = frame.circle.zip(frame.pose()?.distance)?;
        Some((circle.radius / distance.sigma).powi(2))
    };
    let weights: Vec<f64> = frames.iter().filter_map(weight).collect();
    let sigma = (weights.len() as f64 / weights.iter().sum::<f64>()).sqrt();
    let view = SequenceView::of_frames(frames.iter());
    Ok(view.map(|v| (v.rad_per_px - exact) / sigma))
}
