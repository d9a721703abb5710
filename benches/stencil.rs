//! Time of one stencil: design, solids, checks; and of its files.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use spindoe::geometry::spiral_directions;
use spindoe::pattern::Pattern;
use spindoe::stencil::{Stencil, StencilConfig};

fn one_stencil(c: &mut Criterion) {
    let Ok(pattern) = Pattern::new(spiral_directions(20).collect()) else {
        return;
    };
    let config = StencilConfig::default();
    let mut group = c.benchmark_group("stencil");
    group.sample_size(10);
    group.bench_function("build, 20 dots", |b| {
        b.iter(|| Stencil::build(black_box(&pattern), &config));
    });
    let dir = std::env::temp_dir().join("spindoe-bench-stencil");
    if let Ok(stencil) = Stencil::build(&pattern, &config) {
        group.bench_function("write", |b| b.iter(|| stencil.write(&dir)));
    }
    group.finish();
}

criterion_group!(benches, one_stencil);
criterion_main!(benches);
