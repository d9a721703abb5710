//! Times of the design's parts, 20 dots: the table, one value and gradient of the objective, a descent.
//!
//! `cargo bench --bench design`

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::design::descent::{Constraints, coordinates, descend, random_pattern};
use spindoe::design::objective::MeanNearestNeighbour;
use spindoe::hash::{HashTable, PairRule, RecogniserParams};

fn design(c: &mut Criterion) {
    let constraints = Constraints::default();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let pattern = random_pattern(20, constraints.least_separation_rad, &mut rng)
        .expect("twenty dots fit at random");
    let objective = MeanNearestNeighbour::default();
    let at = coordinates(&pattern);
    c.bench_function("hash table of 20 dots", |b| {
        b.iter(|| {
            HashTable::build(
                black_box(pattern.clone()),
                PairRule::default(),
                RecogniserParams::default(),
            )
        });
    });
    c.bench_function("mean-nn: value and gradient", |b| {
        b.iter(|| objective.evaluate(black_box(&at)));
    });
    let mut slow = c.benchmark_group("descent");
    slow.sample_size(10);
    slow.bench_function("10 steps of L-BFGS on mean-nn", |b| {
        b.iter(|| descend(black_box(&pattern), &objective, &constraints, 10));
    });
}

criterion_group!(benches, design);
criterion_main!(benches);
