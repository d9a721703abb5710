//! What several test files share.

use std::path::PathBuf;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::{Vec3, random_direction};
use spindoe::pattern::Pattern;

/// Says that a test is skipped, past the harness, which keeps what passing tests print to itself.
#[allow(dead_code)]
pub fn skipped(why: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

/// The published pattern, or `None` (said loudly) where this checkout has no shared data beside it.
#[allow(dead_code)]
pub fn published_pattern() -> Option<Pattern> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let place = "shared/data/spindoe2023/ref_pattern.csv";
    let found = root
        .ancestors()
        .skip(1)
        .map(|d| d.join(place))
        .find(|p| p.exists());
    if found.is_none() {
        skipped("the published pattern lies in no folder above the repository");
    }
    found.map(|path| Pattern::read_csv(&path).expect("the published pattern reads"))
}

/// The folder of the published flights, or `None` (said loudly) as above.
#[allow(dead_code)]
pub fn published_trajectories() -> Option<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let place = "shared/data/spindoe2023/trajectories";
    let found = root
        .ancestors()
        .skip(1)
        .map(|d| d.join(place))
        .find(|p| p.exists());
    if found.is_none() {
        skipped("the published flights lie in no folder above the repository");
    }
    found
}

/// `n` dots at random, no two nearer than 0.3 rad where `n <= 20`.
#[allow(dead_code)]
pub fn random_pattern(n: usize, seed: u64) -> Pattern {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let least = if n <= 20 { 0.3f64 } else { 0.1 };
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < n {
        let dot = random_direction(&mut rng);
        if dots.iter().all(|d| d.dot(&dot) < least.cos()) {
            dots.push(dot);
        }
    }
    Pattern::new(dots).expect("distinct unit vectors")
}
