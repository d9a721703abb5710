//! Time of synthetic frames, and of a frame of 60 px from pixels to orientation, stage by stage;
//! one thread.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::SeedableRng;
use spindoe::design::random_pattern;
use spindoe::geometry::spiral_directions;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::independent_frame;
use spindoe::vision::{
    BallCircle, BallFinder, Budget, CircleConfig, CnnDetector, DetectorName, Estimator,
    EstimatorConfig, FrameEstimate, Patch, Prior,
};

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

fn estimate(c: &mut Criterion) {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let Ok(pattern) = random_pattern(20, 0.35, &mut rng) else {
        return;
    };
    let Ok(frame) = independent_frame(&pattern, &SynthConfig::good(), 1, 0) else {
        return;
    };
    let gray = frame.image.to_gray();
    let mut group = c.benchmark_group("estimate 60 px");
    let mut finder = BallFinder::new(CircleConfig::default());
    group.bench_function("locate", |b| b.iter(|| finder.find(black_box(&gray))));
    let circle = BallCircle::new(frame.truth.center, frame.truth.radius_px);
    let mut patch = Patch::default();
    group.bench_function("cut", |b| {
        b.iter(|| patch.cut_into(black_box(&gray), &circle))
    });
    if let Ok(net) = CnnDetector::built_in() {
        let mut ws = net.workspace();
        group.bench_function("net, a patch", |b| {
            b.iter(|| net.cells(black_box(&patch), &mut ws)[0]);
        });
    }
    for name in DetectorName::ALL {
        let Ok(detector) = name.build() else { return };
        let (mut ws, mut dots) = (detector.workspace(), Vec::new());
        group.bench_function(format!("detect, {name}"), |b| {
            b.iter(|| detector.detect_into(black_box(&patch), &mut ws, &mut dots));
        });
        let Ok(estimator) = Estimator::new(&pattern, EstimatorConfig::default(), detector) else {
            return;
        };
        let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
        group.bench_function(format!("all, {name}"), |b| {
            b.iter(|| {
                estimator.estimate(
                    black_box(&gray),
                    &Prior::default(),
                    &Budget::default(),
                    &mut ws,
                    &mut out,
                )
            });
        });
        group.bench_function(format!("identify, {name}"), |b| {
            b.iter(|| estimator.identify_detections(&mut ws, black_box(&mut out)));
        });
    }
    group.finish();
}

criterion_group!(benches, synth, estimate);
criterion_main!(benches);
