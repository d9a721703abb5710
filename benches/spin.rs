//! Time of a spin from ten frames: the robust estimator and the paper's, in one run, and their
//! ratio.
//!
//! `cargo bench --bench spin`. Both get the same thousand sequences in turn (ten frames at 350 per
//! second, 2 deg, 7 % outliers, 1 to 170 rps, seed 1), so branch prediction cannot memorize them.
#![allow(missing_docs)]

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use spindoe::spin::quatera::{QuateraConfig, QuateraEstimator};
use spindoe::spin::robust::{RobustEstimator, RobustSpinConfig};
use spindoe::spin::simulate::{Scenario, Sequence};
use spindoe::spin::{Fit, SpinRejection};
use spindoe::validate::median;

fn spin(c: &mut Criterion) {
    let scenario = Scenario::default();
    let sequences: Vec<Sequence> = (0..1000)
        .map(|i| scenario.sequence((1.0, 170.0), 1, i))
        .collect();
    let mut robust = RobustEstimator::new(RobustSpinConfig::default());
    let mut quatera = QuateraEstimator::new(QuateraConfig::default());
    let mut group = c.benchmark_group("spin of ten frames");
    let mut turn = sequences.iter().cycle();
    let mut next = || &turn.next().expect("an endless cycle").measurements;
    group.bench_function("robust", |b| b.iter(|| robust.fit(black_box(next()))));
    group.bench_function("quatera", |b| b.iter(|| quatera.fit(black_box(next()))));
    group.finish();
    let robust_us = median_us(&sequences, |s| robust.fit(&s.measurements));
    let quatera_us = median_us(&sequences, |s| quatera.fit(&s.measurements));
    println!(
        "median of {} sequences: robust {robust_us:.2} us, quatera {quatera_us:.2} us, ratio {:.2}",
        sequences.len(),
        robust_us / quatera_us
    );
}

/// Median over the sequences of the minimum of five times, microseconds.
fn median_us(
    sequences: &[Sequence],
    mut fit: impl FnMut(&Sequence) -> Result<Fit, SpinRejection>,
) -> f64 {
    let mut times: Vec<f64> = sequences
        .iter()
        .map(|s| {
            let once = |_| {
                let start = Instant::now();
                black_box(fit(black_box(s))).ok();
                1e6 * start.elapsed().as_secs_f64()
            };
            (0..5).map(once).fold(f64::INFINITY, f64::min)
        })
        .collect();
    median(&mut times)
}

criterion_group!(benches, spin);
criterion_main!(benches);
