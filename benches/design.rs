//! Time of each part of a design, 20 dots: the table, each objective's value with gradient, a
//! descent.
//!
//! `cargo bench --bench design`

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::ball::Ball;
use spindoe::design::descent::descend;
use spindoe::design::objective::TooFewDots;
use spindoe::design::{Constraints, Objective, ObjectiveName, OrientationBound};
use spindoe::pattern::random_pattern;
use spindoe::recognize::paper::FeatureTree;
use spindoe::view::ProtocolName;

fn design(c: &mut Criterion) {
    let constraints = Constraints::default();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let pattern = random_pattern(20, constraints.min_separation_rad, &mut rng)
        .expect("twenty dots fit at random");
    let ball = Ball::new(pattern.clone());
    c.bench_function("hash table of 20 dots", |b| {
        b.iter(|| FeatureTree::new(black_box(&ball)));
    });
    let views = [ProtocolName::Sparse.view()];
    for name in ObjectiveName::ALL {
        let objective = Objective::for_views(name, &views, 20).expect("the views are protocols");
        c.bench_function(&format!("{name}: value and gradient"), |b| {
            b.iter(|| objective.evaluate_at(black_box(pattern.dots())));
        });
    }
    // Those of many dots before a camera: to be seen beside `confusion` at 20.
    for (dots, separation) in [(20, 0.31), (32, 0.25), (64, 0.15)] {
        let pattern = random_pattern(dots, separation, &mut rng).expect("the dots fit at random");
        let camera = TooFewDots::default();
        c.bench_function(
            &format!("views with too few of {dots} dots: value and gradient"),
            |b| b.iter(|| camera.evaluate(black_box(pattern.dots()))),
        );
    }
    c.bench_function("orientation bound: value and gradient", |b| {
        b.iter(|| OrientationBound::default().cost(black_box(pattern.dots())));
    });
    let mut slow = c.benchmark_group("descent");
    slow.sample_size(10);
    let paper =
        Objective::for_views(ObjectiveName::MeanNn, &views, 20).expect("the views are protocols");
    slow.bench_function("one step on mean-nn, all constraints", |b| {
        b.iter(|| descend(black_box(&pattern), &paper, &constraints, 1));
    });
    let default = Objective::default();
    slow.bench_function("one step on failure-rate, all constraints", |b| {
        b.iter(|| descend(black_box(&pattern), &default, &constraints, 1));
    });
}

criterion_group!(benches, design);
criterion_main!(benches);
