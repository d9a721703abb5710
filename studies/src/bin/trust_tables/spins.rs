//! Spins reported of random orientations, which have none.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::geometry::random_rotation;
use spindoe::spin::robust::RobustEstimator;
use spindoe::validate::Proportion;
use spindoe::{Measurement, Result, SpinConfig};

/// Orientations of a file.
const FRAMES: u32 = 10;
/// Frames per second.
const RATES: [f64; 3] = [60.0, 120.0, 350.0];
/// Confidences that the frames claim.
const CONFIDENCES: [f64; 3] = [0.5, 0.9, 0.99];

/// Standard deviation of the spin that one file is given, revolutions per second; `None` where the
/// file is refused.
fn deviation(seed: u64, file: u64, fps: f64, confidence: f64) -> Option<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(file);
    let measurements: Vec<Measurement> = (0..FRAMES)
        .map(|k| Measurement {
            confidence,
            ..Measurement::new(f64::from(k) / fps, random_rotation(&mut rng))
        })
        .collect();
    let fit = RobustEstimator::new(SpinConfig::default())
        .fit(&measurements)
        .ok()?;
    let axis = fit.motion.spin.try_normalize(0.0)?;
    let variance = axis.dot(&(fit.spin_covariance? * axis));
    Some(variance.sqrt() / std::f64::consts::TAU)
}

pub fn print(files: u64, seed: u64) -> Result<()> {
    println!("{files} files of {FRAMES} random orientations a row, seed {seed}\n");
    println!(
        "| frames a second | claimed confidence | a spin is reported | with a deviation below 1 rps |"
    );
    println!("|---|---|---|---|");
    for fps in RATES {
        for confidence in CONFIDENCES {
            let found: Vec<Option<f64>> = (0..files)
                .into_par_iter()
                .map(|file| deviation(seed, file, fps, confidence))
                .collect();
            let reported = found.iter().flatten().count() as u64;
            let small = found.iter().flatten().filter(|s| **s < 1.0).count() as u64;
            println!(
                "| {fps} | {confidence} | {reported}: {} | {small}: {} |",
                Proportion::new(reported, files),
                Proportion::new(small, files)
            );
        }
    }
    Ok(())
}
