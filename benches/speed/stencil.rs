//! One stencil: design, solids, checks; and its files.

use std::hint::black_box;

use criterion::Criterion;
use spindoe::geometry::spiral_directions;
use spindoe::pattern::Pattern;
use spindoe::stencil::{Stencil, StencilConfig};

use crate::table::Table;

pub fn run(criterion: &mut Criterion, table: &mut Table) -> crate::Outcome {
    let pattern = Pattern::new(spiral_directions(20).collect())?;
    let config = StencilConfig::default();
    let mut group = criterion.benchmark_group("stencil");
    group.sample_size(10);
    group.bench_function("build", |b| {
        b.iter(|| Stencil::build(black_box(&pattern), &config));
    });
    let dir = tempfile::tempdir()?;
    let stencil = Stencil::build(&pattern, &config)?;
    group.bench_function("write", |b| b.iter(|| stencil.write(dir.path())));
    group.finish();
    table.line("stencil/build");
    table.line("stencil/write");
    Ok(())
}
