//! The robust recognizer and the paper's, on the same views, in one run.
//!
//! Prints the ratio of the medians before criterion's own values. Where the published pattern is
//! not available, a random one replaces it, and the output says so.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use criterion::Criterion;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::ball::Ball;
use spindoe::design::random_pattern;
use spindoe::pattern::Pattern;
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::recognize::{PaperRecognizer, Recognizer};
use spindoe::stats::median;
use spindoe::view::{ObservedDot, ProtocolName, Trial, TrialGenerator, ViewModel};

/// Seed of the views.
const SEED: u64 = 20_260;
/// Views per protocol.
const VIEWS: u64 = 256;

type Any<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn pattern() -> Any<Pattern> {
    let place = Path::new("shared/data/spindoe2023/ref_pattern.csv");
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let found = root.ancestors().map(|d| d.join(place)).find(|p| p.exists());
    if let Some(path) = found {
        return Ok(Pattern::read_csv(&path)?);
    }
    println!("the published pattern is not available: a random one of 20 dots replaces it");
    Ok(random_pattern(20, 0.3, &mut ChaCha8Rng::seed_from_u64(1))?)
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

/// Median time of one identification over the views, microseconds.
fn median_us<R: Recognizer>(recognizer: &R, views: &[Vec<ObservedDot>]) -> f64 {
    let mut workspace = recognizer.workspace();
    let mut times: Vec<f64> = views
        .iter()
        .cycle()
        .take(4 * views.len())
        .map(|dots| {
            let start = Instant::now();
            let _ = black_box(recognizer.explain(dots, None, &mut workspace));
            start.elapsed().as_nanos() as f64 / 1000.0
        })
        .collect();
    median(&mut times)
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
    criterion.bench_function(&format!("{name}/{protocol}"), |b| {
        b.iter(|| {
            let dots = next.next().map_or(&[][..], Vec::as_slice);
            black_box(recognizer.explain(black_box(dots), None, &mut workspace)).is_ok()
        });
    });
}

fn main() -> Any<()> {
    let mut criterion = Criterion::default().configure_from_args().sample_size(30);
    let pattern = pattern()?;
    let paper = PaperRecognizer::for_ball(&Ball::new(pattern.clone()))?;
    for name in ProtocolName::ALL {
        let views = views(&pattern, name.view());
        let robust = RobustRecognizer::new(&pattern, name.view().into())?;
        let (ours, theirs) = (median_us(&robust, &views), median_us(&paper, &views));
        println!(
            "{name}: median {ours:.1} us robust, {theirs:.1} us paper's, ratio {:.1}",
            theirs / ours
        );
        bench(&mut criterion, ("robust", name), &robust, &views);
        bench(&mut criterion, ("paper", name), &paper, &views);
    }
    criterion.final_summary();
    Ok(())
}
