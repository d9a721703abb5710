//! Each part of a design, 20 dots: the table, each objective's value with gradient, a descent. The baseline is the
//! paper's objective.

use std::hint::black_box;

use criterion::Criterion;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::ball::Ball;
use spindoe::design::descent::descend;
use spindoe::design::objective::TooFewDots;
use spindoe::design::{Constraints, Objective, ObjectiveName, OrientationBound};
use spindoe::pattern::random_pattern;
use spindoe::recognize::paper::FeatureTree;
use spindoe::view::ProtocolName;

use crate::table::Table;

pub fn run(criterion: &mut Criterion, table: &mut Table) -> crate::Outcome {
    let constraints = Constraints::default();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let pattern = random_pattern(20, constraints.min_separation_rad, &mut rng)?;
    let ball = Ball::new(pattern.clone());
    let mut group = criterion.benchmark_group("design");
    group.bench_function("table", |b| b.iter(|| FeatureTree::new(black_box(&ball))));
    table.line("design/table");
    let views = [ProtocolName::Sparse.view()];
    for name in ObjectiveName::ALL {
        let objective = Objective::for_views(name, &views, 20)?;
        group.bench_function(format!("gradient of {name}"), |b| {
            b.iter(|| objective.evaluate_at(black_box(pattern.dots())));
        });
    }
    let gradient = |name| format!("design/gradient of {name}");
    table.pair(
        gradient(ObjectiveName::FailureRate),
        gradient(ObjectiveName::MeanNn),
    );
    table.line(gradient(ObjectiveName::WhitenedNn));
    // Those of many dots before a camera.
    for (dots, separation) in [(20, 0.31), (32, 0.25), (64, 0.15)] {
        let pattern = random_pattern(dots, separation, &mut rng)?;
        let camera = TooFewDots::default();
        let name = format!("gradient of views with too few of {dots}");
        group.bench_function(&name, |b| {
            b.iter(|| camera.evaluate(black_box(pattern.dots())));
        });
        table.line(format!("design/{name}"));
    }
    group.bench_function("gradient of the orientation bound", |b| {
        b.iter(|| OrientationBound::default().cost(black_box(pattern.dots())));
    });
    table.line("design/gradient of the orientation bound");
    group.sample_size(10);
    for name in [ObjectiveName::FailureRate, ObjectiveName::MeanNn] {
        let objective = Objective::for_views(name, &views, 20)?;
        group.bench_function(format!("step on {name}"), |b| {
            b.iter(|| descend(black_box(&pattern), &objective, &constraints, 1));
        });
    }
    table.pair("design/step on failure-rate", "design/step on mean-nn");
    group.finish();
    Ok(())
}
