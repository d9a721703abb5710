//! Spins reported of random orientations, which have none, and what asking for more agreement would cost.

use std::f64::consts::TAU;

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use spindoe::geometry::{random_direction, random_rotation};
use spindoe::spin::robust::RobustEstimator;
use spindoe::stats::Proportion;
use spindoe::{Measurement, Rotation, SpinConfig, Vec3};
use spindoe_studies::score::share;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Orientations of a file.
const FRAMES: u32 = 10;
/// Frames per second.
const RATES: [f64; 3] = [60.0, 120.0, 350.0];
/// Confidences that the frames claim.
const CONFIDENCES: [f64; 3] = [0.5, 0.9, 0.99];

/// Thresholds of [`SpinConfig::false_alarms`] that are compared.
const THRESHOLDS: [f64; 5] = [2.0, 0.2, 0.02, 0.002, 0.0002];
/// Correct frames of a real sequence.
const CORRECT: [u32; 4] = [0, 4, 5, 6];
/// Noise of a correct orientation per axis, radians.
const SIGMA_RAD: f64 = 0.035;
/// A spin nearer to the truth than this is the truth, revolutions per second.
const NEAR_RPS: f64 = 1.0;

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

#[derive(clap::Args)]
pub struct Args {
    /// Files.
    #[arg(long, default_value_t = 10_000)]
    files: u64,
    /// Seed of the files.
    #[arg(long, default_value_t = crate::TRUST_SEED)]
    seed: u64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (files, seed) = (self.files, self.seed);
        println!("{files} files of {FRAMES} random orientations a row, seed {seed}");
        let table = Table::new([
            "frames a second",
            "claimed confidence",
            "a spin is reported",
            "with a deviation below 1 rps",
        ]);
        for fps in RATES {
            for confidence in CONFIDENCES {
                let found: Vec<Option<f64>> = (0..files)
                    .into_par_iter()
                    .map(|file| deviation(seed, file, fps, confidence))
                    .collect();
                let reported = share(&found, Option::is_some);
                row!(table; fps, confidence, reported, share(&found, |d| d.is_some_and(|d| d < 1.0)));
            }
        }
        thresholds(files, seed);
        Ok(())
    }
}

/// Orientations of a ball of which `correct` frames follow one motion and the others are random; and the
/// spin.
fn sequence(seed: u64, file: u64, correct: u32, fps: f64) -> (Vec<Measurement>, Vec3) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(file);
    let rps: f64 = rng.random_range(5.0..50.0);
    let spin = random_direction(&mut rng) * (rps * TAU);
    let start = random_rotation(&mut rng);
    let mut order: Vec<u32> = (0..FRAMES).collect();
    order.shuffle(&mut rng);
    let one = |k: u32| {
        let time_s = f64::from(k) / fps;
        let noise = Vec3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal)) * SIGMA_RAD;
        let follows =
            Rotation::from_scaled_axis(noise) * Rotation::from_scaled_axis(spin * time_s) * start;
        let any = random_rotation(&mut rng);
        let is_correct = order.iter().position(|o| *o == k) < Some(correct as usize);
        Measurement {
            confidence: 0.5,
            ..Measurement::new(time_s, if is_correct { follows } else { any })
        }
    };
    ((0..FRAMES).map(one).collect(), spin)
}

/// What each threshold refuses and accepts.
fn thresholds(files: u64, seed: u64) {
    let fps = 120.0;
    println!(
        "\n{files} files of {FRAMES} orientations a row at {fps} frames a second, claimed 0.5"
    );
    let table = Table::new([
        "false alarms allowed",
        "correct orientations",
        "a spin is reported",
        "and correct",
    ]);
    for false_alarms in THRESHOLDS {
        let config = SpinConfig {
            false_alarms,
            ..SpinConfig::default()
        };
        for correct in CORRECT {
            let one = |file| {
                let (measurements, spin) = sequence(seed, file, correct, fps);
                let fit = RobustEstimator::new(config).fit(&measurements).ok()?;
                Some((fit.motion.spin - spin).norm() < NEAR_RPS * TAU)
            };
            let found: Vec<bool> = (0..files).into_par_iter().filter_map(one).collect();
            let right = share(&found, |f| *f).successes;
            let of_files = |n: u64| Proportion::new(n, files);
            row!(
                table; false_alarms, format!("{correct} of {FRAMES}"),
                of_files(found.len() as u64), of_files(right)
            );
        }
    }
}
