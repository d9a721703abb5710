//! Time of a spin fit: ten frames by the robust estimator and by the paper's in one run, with their
//! ratio; longer sequences with a decay, a precession, and ten thousand frames.
//!
//! `cargo bench --bench spin`. The fits of ten frames get the same thousand sequences in turn (350 per
//! second, 2 deg, 7 % outliers, 1 to 170 rps, seed 1), so branch prediction cannot memorize them.
#![allow(missing_docs)]

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use spindoe::geometry::{Rotation, Vec3};
use spindoe::spin::Measurement;
use spindoe::spin::decay::fit_decay;
use spindoe::spin::precession::fit_precession;
use spindoe::spin::quatera::{QuateraConfig, QuateraEstimator};
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::simulate::{Scenario, decayed_time};
use spindoe::validate::median;

fn simulated(frames: usize, decay_per_s: f64, seed: u64, count: u64) -> Vec<Vec<Measurement>> {
    let scenario = Scenario {
        frames,
        decay_per_s,
        ..Scenario::default()
    };
    (0..count)
        .map(|i| scenario.sequence((1.0, 170.0), seed, i).measurements)
        .collect()
}

/// Uneven balls: the noise of constant spins on the closed form of a symmetric top that slows down.
fn tops(frames: usize, count: u64) -> Vec<Vec<Measurement>> {
    let top = |m: &Measurement, rest: &Measurement| {
        let tau = decayed_time(m.time_s, 0.1);
        let space = Rotation::from_scaled_axis(Vec3::new(0.0, 700.0, 0.0) * tau);
        let body = Rotation::from_scaled_axis(Vec3::new(13.7, 37.6, 0.0) * tau);
        // A ball that stands still and is turned about by the noise alone.
        Measurement {
            orientation: m.orientation * rest.orientation.inverse() * space * body,
            ..*m
        }
    };
    let scenario = Scenario {
        frames,
        ..Scenario::default()
    };
    (0..count)
        .map(|i| {
            let still = scenario.sequence((0.0, 0.0), 3, i);
            let rest = Measurement::new(0.0, still.truth.orientation);
            still.measurements.iter().map(|m| top(m, &rest)).collect()
        })
        .collect()
}

fn spin(c: &mut Criterion) {
    let short = simulated(10, 0.0, 1, 1000);
    let mut robust = RobustEstimator::new(SpinConfig::default());
    let mut quatera = QuateraEstimator::new(QuateraConfig::default());
    let mut group = c.benchmark_group("spin of ten frames");
    let mut turn = short.iter().cycle();
    let mut next = || turn.next().expect("an endless cycle");
    group.bench_function("robust", |b| b.iter(|| robust.fit(black_box(next()))));
    group.bench_function("quatera", |b| b.iter(|| quatera.fit(black_box(next()))));
    group.finish();
    let robust_us = median_us(&short, |m| robust.fit(m).is_ok());
    let quatera_us = median_us(&short, |m| quatera.fit(m).is_ok());
    println!(
        "median of {} sequences: robust {robust_us:.2} us, quatera {quatera_us:.2} us, ratio {:.2}",
        short.len(),
        robust_us / quatera_us
    );
    let report = |name: &str, us: f64| {
        println!("{name}: {us:.1} us, {:.2} quatera of ten", us / quatera_us);
    };
    let sixty = median_us(&simulated(60, 0.0, 1, 200), |m| robust.fit(m).is_ok());
    report("constant spin of 60 frames", sixty);
    let long = median_us(&simulated(10_000, 0.0, 1, 8), |m| robust.fit(m).is_ok());
    report("constant spin of 10000 frames", long);
    let decay = median_us(&simulated(210, 0.1, 2, 40), |m| {
        fit_decay(m, &SpinConfig::default()).is_ok()
    });
    report("decay of 210 frames", decay);
    let precession = median_us(&tops(60, 40), |m| {
        fit_precession(m, &SpinConfig::default()).is_ok()
    });
    report("precession of 60 frames", precession);
}

/// Median over the sequences of the minimum of five times, microseconds.
fn median_us(sequences: &[Vec<Measurement>], mut fit: impl FnMut(&[Measurement]) -> bool) -> f64 {
    let mut times: Vec<f64> = sequences
        .iter()
        .map(|s| {
            let once = |_| {
                let start = Instant::now();
                black_box(fit(black_box(s)));
                1e6 * start.elapsed().as_secs_f64()
            };
            (0..5).map(once).fold(f64::INFINITY, f64::min)
        })
        .collect();
    median(&mut times)
}

criterion_group!(benches, spin);
criterion_main!(benches);
