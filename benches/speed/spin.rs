//! A spin fit: ten frames by the robust estimator and by the paper's; longer sequences with a decay, a precession, and
//! ten thousand frames.
//!
//! The fits get their sequences in turn (350 per second, 2 deg, 7 % outliers, 1 to 170 rps), so branch prediction cannot
//! memorize them.

use std::hint::black_box;

use criterion::{BenchmarkGroup, Criterion, measurement::WallTime};
use spindoe::geometry::{Rotation, Vec3};
use spindoe::spin::Measurement;
use spindoe::spin::decay::fit_decay;
use spindoe::spin::precession::fit_precession;
use spindoe::spin::quatera::{QuateraConfig, QuateraEstimator};
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::simulate::{Scenario, decayed_time};

use crate::table::Table;

pub fn run(criterion: &mut Criterion, table: &mut Table) {
    let config = SpinConfig::default();
    let mut robust = RobustEstimator::new(config);
    let mut quatera = QuateraEstimator::new(QuateraConfig::default());
    let short = simulated(10, 0.0, 1, 1000);
    let mut group = criterion.benchmark_group("spin");
    bench(&mut group, "robust, 10 frames", &short, |m| {
        robust.fit(m).is_ok()
    });
    bench(&mut group, "quatera, 10 frames", &short, |m| {
        quatera.fit(m).is_ok()
    });
    table.pair("spin/robust, 10 frames", "spin/quatera, 10 frames");
    for (frames, count) in [(60, 200), (10_000, 8)] {
        let name = format!("robust, {frames} frames");
        bench(&mut group, &name, &simulated(frames, 0.0, 1, count), |m| {
            robust.fit(m).is_ok()
        });
        table.line(format!("spin/{name}"));
    }
    let decaying = simulated(210, 0.1, 2, 40);
    bench(&mut group, "decay, 210 frames", &decaying, |m| {
        fit_decay(m, &config).is_ok()
    });
    table.line("spin/decay, 210 frames");
    bench(&mut group, "precession, 60 frames", &tops(60, 40), |m| {
        fit_precession(m, &config).is_ok()
    });
    table.line("spin/precession, 60 frames");
    group.finish();
}

fn bench(
    group: &mut BenchmarkGroup<WallTime>,
    name: &str,
    sequences: &[Vec<Measurement>],
    mut fit: impl FnMut(&[Measurement]) -> bool,
) {
    let mut turn = sequences.iter().cycle();
    group.bench_function(name, |b| {
        b.iter(|| fit(black_box(turn.next().map_or(&[], Vec::as_slice))));
    });
}

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
