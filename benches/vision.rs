//! Frames of the synthetic ball spinner: one thread, scenes drawn and rendered.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use spindoe::geometry::spiral_directions;
use spindoe::pattern::Pattern;
use spindoe::vision::synth::SynthConfig;
use spindoe::vision::synth::dataset::independent_frame;

fn synth(c: &mut Criterion) {
    let Ok(pattern) = Pattern::new(spiral_directions(20).collect()) else {
        return;
    };
    let mut group = c.benchmark_group("synth");
    for side in [64, 128] {
        let config = SynthConfig {
            size_px: [side; 2],
            ..SynthConfig::default()
        };
        let mut k = 0;
        group.bench_function(format!("{side} px"), |b| {
            b.iter(|| {
                k += 1;
                independent_frame(black_box(&pattern), &config, 1, k)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, synth);
criterion_main!(benches);
