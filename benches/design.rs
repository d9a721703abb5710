//! Time of each part of a design, 20 dots: the table, each objective's value with gradient, a
//! descent.
//!
//! `cargo bench --bench design`

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::design::constraints::max_separation;
use spindoe::design::scp::descend;
use spindoe::design::{Constraints, Objective, ObjectiveName, OrientationBound};
use spindoe::hash::{HashTable, PairRule, RecognizerConfig};
use spindoe::pattern::random_pattern;
use spindoe::validate::{Protocol, ProtocolName};

fn design(c: &mut Criterion) {
    let constraints = Constraints::default();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let pattern = random_pattern(20, constraints.min_separation_rad, &mut rng)
        .expect("twenty dots fit at random");
    c.bench_function("hash table of 20 dots", |b| {
        b.iter(|| {
            HashTable::build(
                black_box(pattern.clone()),
                PairRule::default(),
                RecognizerConfig::default(),
            )
        });
    });
    let protocol = Protocol::standard(ProtocolName::Sparse);
    for name in ObjectiveName::ALL {
        let objective = Objective::for_protocol(name, &protocol);
        c.bench_function(&format!("{name}: value and gradient"), |b| {
            b.iter(|| objective.evaluate_at(black_box(pattern.dots())));
        });
    }
    confusion(c);
    c.bench_function("orientation bound: value and gradient", |b| {
        b.iter(|| OrientationBound::default().cost(black_box(pattern.dots())));
    });
    let mut slow = c.benchmark_group("descent");
    slow.sample_size(10);
    let paper = Objective::for_protocol(ObjectiveName::MeanNn, &protocol);
    slow.bench_function("one step on mean-nn, all constraints", |b| {
        b.iter(|| descend(black_box(&pattern), &paper, &constraints, 1));
    });
    let default = Objective::default();
    slow.bench_function("one step on confusion, all constraints", |b| {
        b.iter(|| descend(black_box(&pattern), &default, &constraints, 1));
    });
}

/// Milliseconds for value and gradient of the objective that `confusion` replaces, by number of dots:
/// it summed over quadruples, on one core, in the `sparse` protocol's views.
const QUADRUPLES_MS: [(usize, Option<f64>); 4] = [
    (20, Some(44.0)),
    (32, Some(1_700.0)),
    (48, None),
    (64, None),
];

/// Confusion for many dots, and how many times faster it is than what it replaces.
fn confusion(c: &mut Criterion) {
    let mut group = c.benchmark_group("confusion: value and gradient");
    group.sample_size(10);
    for (dots, before_ms) in QUADRUPLES_MS {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let separation = 0.6 * max_separation(dots);
        let pattern = random_pattern(dots, separation, &mut rng).expect("the dots fit at random");
        for name in [ProtocolName::Sparse, ProtocolName::Image] {
            let protocol = Protocol::standard(name);
            let objective = Objective::for_protocol(ObjectiveName::Confusion, &protocol);
            group.bench_function(format!("{dots} dots, {name}"), |b| {
                b.iter(|| objective.evaluate_at(black_box(pattern.dots())));
            });
            let clock = Instant::now();
            for _ in 0..3 {
                let _ = black_box(objective.evaluate_at(black_box(pattern.dots())));
            }
            let ms = clock.elapsed().as_secs_f64() * 1e3 / 3.0;
            let ratio = before_ms.map_or("not computed before".to_owned(), |before| {
                format!(
                    "{:.1} times as fast as the sum over quadruples",
                    before / ms
                )
            });
            println!("{dots} dots, {name}: {ms:.1} ms, {ratio}");
        }
    }
}

criterion_group!(benches, design);
criterion_main!(benches);
