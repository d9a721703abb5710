//! Spins reported of random orientations, which have none, and what asking for more agreement would cost.

use std::f64::consts::TAU;

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use spindoe::geometry::{random_direction, random_rotation};
use spindoe::spin::robust::RobustEstimator;
use spindoe::validate::Proportion;
use spindoe::{Measurement, Result, Rotation, SpinConfig, Vec3};

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
    thresholds(files, seed)
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
fn thresholds(files: u64, seed: u64) -> Result<()> {
    let fps = 120.0;
    println!(
        "\n{files} files of {FRAMES} orientations a field at {fps} frames a second, claimed 0.5\n"
    );
    let correct = CORRECT.map(|c| format!("{c} of {FRAMES} correct: reported, and correct"));
    println!(
        "| false alarms allowed | {} |\n|---|---|---|---|---|",
        correct.join(" | ")
    );
    for false_alarms in THRESHOLDS {
        let config = SpinConfig {
            false_alarms,
            ..SpinConfig::default()
        };
        let fields = CORRECT.map(|correct| {
            let found: Vec<bool> = (0..files)
                .into_par_iter()
                .filter_map(|file| {
                    let (measurements, spin) = sequence(seed, file, correct, fps);
                    let fit = RobustEstimator::new(config).fit(&measurements).ok()?;
                    Some((fit.motion.spin - spin).norm() < NEAR_RPS * TAU)
                })
                .collect();
            let right = found.iter().filter(|f| **f).count() as u64;
            let reported = Proportion::new(found.len() as u64, files);
            format!("{reported}, {}", Proportion::new(right, files))
        });
        println!("| {false_alarms} | {} |", fields.join(" | "));
    }
    Ok(())
}
