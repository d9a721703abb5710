//! Synthetic frames, and a frame of 60 px from pixels to orientation, stage by stage; one thread. The baseline is the
//! detector without a net.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion};
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

use crate::table::Table;

pub fn run(criterion: &mut Criterion, table: &mut Table) -> crate::Outcome {
    synth(criterion, table)?;
    estimate(criterion, table)
}

fn synth(criterion: &mut Criterion, table: &mut Table) -> crate::Outcome {
    let pattern = Pattern::new(spiral_directions(20).collect())?;
    let mut group = criterion.benchmark_group("synth");
    for side in [64, 128] {
        let config = SynthConfig {
            size_px: [side; 2],
            ..SynthConfig::default()
        };
        let mut k = 0;
        let name = format!("frame of {side} px");
        group.bench_function(&name, |b| {
            b.iter(|| {
                k += 1;
                independent_frame(black_box(&pattern), &config, 1, k)
            });
        });
        table.line(format!("synth/{name}"));
    }
    group.finish();
    Ok(())
}

fn estimate(criterion: &mut Criterion, table: &mut Table) -> crate::Outcome {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let pattern = random_pattern(20, 0.35, &mut rng)?;
    let frame = independent_frame(&pattern, &SynthConfig::good(), 1, 0)?;
    let gray = frame.image.to_gray();
    let mut group = criterion.benchmark_group("vision");
    let mut finder = BallFinder::new(CircleConfig::default());
    group.bench_function("locate", |b| b.iter(|| finder.find(black_box(&gray))));
    let circle = BallCircle::new(frame.truth.center, frame.truth.radius_px);
    let mut patch = Patch::default();
    group.bench_function("cut", |b| {
        b.iter(|| patch.cut_into(black_box(&gray), &circle))
    });
    let net = CnnDetector::built_in()?;
    let mut ws = net.workspace();
    group.bench_function("net, a patch", |b| {
        b.iter(|| net.cells(black_box(&patch), &mut ws)[0]);
    });
    for stage in ["locate", "cut", "net, a patch"] {
        table.line(format!("vision/{stage}"));
    }
    for name in DetectorName::ALL {
        let detector = name.build()?;
        let (mut ws, mut dots) = (detector.workspace(), Vec::new());
        group.bench_function(BenchmarkId::new("detect", name), |b| {
            b.iter(|| detector.detect_into(black_box(&patch), &mut ws, &mut dots));
        });
        let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
        let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
        group.bench_function(BenchmarkId::new("all", name), |b| {
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
        group.bench_function(BenchmarkId::new("identify", name), |b| {
            b.iter(|| estimator.identify_detections(&mut ws, black_box(&mut out)));
        });
    }
    for stage in ["detect", "all", "identify"] {
        let line = |name| format!("vision/{stage}/{name}");
        table.pair(line(DetectorName::Cnn), line(DetectorName::Blob));
    }
    group.finish();
    Ok(())
}
