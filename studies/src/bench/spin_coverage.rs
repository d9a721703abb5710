//! Does the covariance of a spin say how well it is known? From rendered images to the spin.
//!
//! Short sequences of a ball on the optical axis of a camera at an unknown distance (good conditions, 5
//! to 80 rps, 400 frames per second) are estimated; the squared Mahalanobis distance of each spin
//! from the truth is compared with chi-square with three degrees of freedom.
//!
//!     cargo run --release -p spindoe-studies -- spin-coverage --help

use std::error::Error;
use std::path::PathBuf;

use rayon::prelude::*;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{Sequence, SequenceConfig as SynthSequence};
use spindoe::validate::Proportion;
use spindoe::vision::estimator::{SequenceConfig, estimate_spin, track_sequence};
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, NamedDetector, Prior,
};

/// Quantiles of chi-square with three degrees of freedom (SciPy's `chi2(3).ppf`).
const QUANTILES: [(f64, f64); 5] = [
    (0.5, 2.366),
    (0.68, 3.506),
    (0.9, 6.251),
    (0.95, 7.815),
    (0.99, 11.345),
];

/// What came of a sequence.
struct Outcome {
    distance2: f64,
    error_rad_s: f64,
    deviation_rad_s: f64,
}

fn outcome(
    pattern: &Pattern,
    estimator: &Estimator<NamedDetector>,
    seed: u64,
    frames: usize,
) -> spindoe::Result<Option<Outcome>> {
    let config = SynthConfig {
        max_off_axis_rad: 0.0,
        rps: [5.0, 80.0],
        ..SynthConfig::good()
    };
    let timing = SynthSequence {
        fps: 400.0,
        ..SynthSequence::default()
    };
    let sequence = Sequence::random(pattern, &config, &timing, seed, frames)?;
    let mut ws = estimator.workspace();
    let (mut times, mut estimates) = (Vec::new(), Vec::new());
    for k in 0..frames {
        let frame = sequence.frame(k)?;
        let mut out = FrameEstimate::default();
        estimator.estimate(
            &frame.image,
            &Prior::default(),
            &Budget::default(),
            &mut ws,
            &mut out,
        );
        times.extend(frame.truth.time_s);
        estimates.push(out);
    }
    let config = SequenceConfig::default();
    track_sequence(estimator, &config, &times, &mut estimates, &mut ws);
    let Ok(fit) = estimate_spin(&config, &times, &estimates) else {
        return Ok(None);
    };
    let off = fit.motion.spin - sequence.spin();
    Ok(fit.spin_covariance.and_then(|covariance| {
        Some(Outcome {
            distance2: off.dot(&(covariance.try_inverse()? * off)),
            error_rad_s: off.norm(),
            deviation_rad_s: covariance.trace().sqrt(),
        })
    }))
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Sequences.
    #[arg(long, default_value_t = 200)]
    sequences: u64,
    /// Frames of a sequence.
    #[arg(long, default_value_t = 8)]
    frames: usize,
    /// Seed of the sequences.
    #[arg(long, default_value_t = 7000)]
    seed: u64,
    /// Pattern of the ball.
    #[arg(long, default_value = "designs/dots20/pattern.csv")]
    pattern: PathBuf,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let (count, frames, seed, path) = (self.sequences, self.frames, self.seed, &self.pattern);
        let pattern = Pattern::read_csv(path)?;
        let config = EstimatorConfig::default();
        let estimator = Estimator::new(&pattern, config, DetectorName::Cnn.build()?)?;
        let outcomes: spindoe::Result<Vec<Option<Outcome>>> = (0..count)
            .into_par_iter()
            .map(|k| outcome(&pattern, &estimator, seed + k, frames))
            .collect();
        let outcomes: Vec<Outcome> = outcomes?.into_iter().flatten().collect();
        let n = outcomes.len() as u64;
        println!(
            "{count} sequences of {frames} frames, seeds from {seed}, {}",
            path.display()
        );
        println!("answered: {}", Proportion::new(n, count));
        let median = |value: fn(&Outcome) -> f64| {
            let mut values: Vec<f64> = outcomes.iter().map(value).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
        };
        println!(
            "medians: squared distance {:.2} (2.37 expected), error {:.2} rad/s, deviation {:.2} rad/s\n",
            median(|o| o.distance2),
            median(|o| o.error_rad_s),
            median(|o| o.deviation_rad_s),
        );
        println!("| expected within | found within |\n|---|---|");
        for (share, bound) in QUANTILES {
            let inside = outcomes.iter().filter(|o| o.distance2 < bound).count() as u64;
            println!("| {share} | {} |", Proportion::new(inside, n));
        }
        Ok(())
    }
}
