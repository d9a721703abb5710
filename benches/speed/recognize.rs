//! The robust recognizer and the paper's, on the same views.
//!
//! Where the published pattern is not available, a random one replaces it, and the output says so.

use std::hint::black_box;
use std::path::{Path, PathBuf};

use criterion::{BenchmarkId, Criterion};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::ball::Ball;
use spindoe::design::random_pattern;
use spindoe::pattern::Pattern;
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::recognize::{PaperRecognizer, Recognizer};
use spindoe::view::{ObservedDot, ProtocolName, Trial, TrialGenerator, ViewModel};

use crate::table::Table;

/// Seed of the views.
const SEED: u64 = 20_260;
/// Views per protocol.
const VIEWS: u64 = 256;

pub fn run(criterion: &mut Criterion, table: &mut Table) -> crate::Outcome {
    let pattern = pattern()?;
    let paper = PaperRecognizer::for_ball(&Ball::new(pattern.clone()))?;
    for name in ProtocolName::ALL {
        let views = views(&pattern, name.view());
        let robust = RobustRecognizer::new(&pattern, name.view().into())?;
        bench(criterion, ("robust", name), &robust, &views);
        bench(criterion, ("paper", name), &paper, &views);
        let line = |of| format!("recognize/{of}/{name}");
        table.pair(line("robust"), line("paper"));
    }
    Ok(())
}

fn pattern() -> spindoe::Result<Pattern> {
    let place = Path::new("shared/data/spindoe2023/ref_pattern.csv");
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let found = root.ancestors().map(|d| d.join(place)).find(|p| p.exists());
    if let Some(path) = found {
        return Pattern::read_csv(&path);
    }
    println!("the published pattern is not available: a random one of 20 dots replaces it");
    random_pattern(20, 0.3, &mut ChaCha8Rng::seed_from_u64(1))
}

fn views(pattern: &Pattern, view: ViewModel) -> Vec<Vec<ObservedDot>> {
    let mut generator = TrialGenerator::new(pattern.dots(), view, SEED);
    let mut trial = Trial::default();
    (0..VIEWS)
        .map(|index| {
            generator.generate(index, &mut trial);
            trial.dots.clone()
        })
        .filter(|dots| dots.len() >= view.min_dots)
        .collect()
}

/// One identification per iteration, the views in turn.
fn bench<R: Recognizer>(
    criterion: &mut Criterion,
    (name, protocol): (&str, ProtocolName),
    recognizer: &R,
    views: &[Vec<ObservedDot>],
) {
    let mut workspace = recognizer.workspace();
    let mut next = views.iter().cycle();
    let mut group = criterion.benchmark_group("recognize");
    group.bench_function(BenchmarkId::new(name, protocol), |b| {
        b.iter(|| {
            let dots = next.next().map_or(&[][..], Vec::as_slice);
            black_box(recognizer.explain(black_box(dots), None, &mut workspace)).is_ok()
        });
    });
    group.finish();
}
