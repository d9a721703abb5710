//! The paper's recognizer on dots without and with noise.

use nalgebra::Unit;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use spindoe::geometry::{Rotation, Vec3, random_direction, random_rotation, rotation_angle};
use spindoe::hash::{HashTable, PairRule, RecognizerConfig};
use spindoe::pattern::Pattern;
use spindoe::recognize::paper::VoteSum;
use spindoe::recognize::{
    DotUncertainty, ObservedDot, PaperConfig, PaperRecognizer, Recognizer, RecognizerRejection,
};

fn table(pattern: Pattern) -> HashTable {
    HashTable::build(pattern, PairRule::default(), RecognizerConfig::default()).expect("builds")
}

fn observed(direction: Vec3) -> ObservedDot {
    ObservedDot {
        direction,
        uncertainty: DotUncertainty::Isotropic { sigma_rad: 0.05 },
    }
}

/// Indices and directions of the dots above `z > limit`, shuffled, each turned by N(0, sigma) about
/// an axis at random.
fn view(
    pattern: &Pattern,
    r: &Rotation,
    limit: f64,
    sigma: f64,
    rng: &mut ChaCha8Rng,
) -> (Vec<u16>, Vec<ObservedDot>) {
    let mut seen: Vec<u16> = (0..pattern.len())
        .filter(|&i| (r * pattern.dots()[i]).z > limit)
        .map(|i| i as u16)
        .collect();
    seen.shuffle(rng);
    let noise = Normal::new(0.0, sigma).expect("a valid deviation");
    let dots = seen
        .iter()
        .map(|&i| {
            let axis = Unit::new_normalize(random_direction(rng));
            let turn = Rotation::from_axis_angle(&axis, noise.sample(rng));
            observed(turn * (r * pattern.dots()[usize::from(i)]))
        })
        .collect();
    (seen, dots)
}

/// Share of views identified without a mistake.
fn rate(table: &HashTable, config: PaperConfig, sigma: f64, given: usize, trials: usize) -> f64 {
    let recognizer = PaperRecognizer::new(table, config).expect("valid parameters");
    let mut ws = recognizer.workspace();
    let mut rng = ChaCha8Rng::seed_from_u64(42);
    let limit = if given == 4 { 1.0 / 3.0 } else { 0.0 };
    let (mut right, mut count) = (0, 0);
    while count < trials {
        let r = random_rotation(&mut rng);
        let (mut truth, mut dots) = view(table.pattern(), &r, limit, sigma, &mut rng);
        if dots.len() < given.min(4) {
            continue;
        }
        truth.truncate(given);
        dots.truncate(given);
        count += 1;
        if let Ok(found) = recognizer.identify(&dots, &mut ws) {
            assert_eq!(found.matched(), dots.len());
            assert!((0.0..=1.0).contains(&found.confidence));
            let same = found
                .assignment
                .iter()
                .zip(&truth)
                .all(|(a, t)| *a == Some(*t));
            right += usize::from(same);
        }
    }
    right as f64 / trials as f64
}

#[test]
fn without_noise_sums_of_densities_identify_every_view() {
    for seed in 0..3 {
        let table = table(crate::common::random_pattern(20, seed));
        let config = PaperConfig {
            vote_sum: VoteSum::Density,
            ..PaperConfig::default()
        };
        let recognizer = PaperRecognizer::new(&table, config).expect("valid parameters");
        let mut ws = recognizer.workspace();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for _ in 0..200 {
            let r = random_rotation(&mut rng);
            let (truth, dots) = view(table.pattern(), &r, 0.0, 0.0, &mut rng);
            let basis_is_in_table = PairRule::default()
                .frame(&dots[0].direction, &dots[1].direction)
                .is_some();
            if dots.len() < 4 || !basis_is_in_table {
                continue;
            }
            let Ok(found) = recognizer.identify(&dots, &mut ws) else {
                panic!("unidentified: {truth:?}");
            };
            let truth: Vec<_> = truth.into_iter().map(Some).collect();
            assert_eq!(found.assignment, truth);
            assert!(rotation_angle(&found.rotation, &r) < 1e-6);
            assert!(found.residual_rad < 1e-6);
        }
    }
}

#[test]
fn rates_on_the_published_pattern_are_those_of_the_published_code() {
    let Some(pattern) = crate::common::published_pattern() else {
        return;
    };
    let table = table(pattern);
    let sigma = 3f64.to_radians();
    // The authors' code: 95.6 % and 94.7 % of 2000; the bounds are four standard errors off.
    let all = rate(&table, PaperConfig::default(), sigma, usize::MAX, 2000);
    assert!((all - 0.956).abs() < 0.019, "all visible dots: {all}");
    let four = rate(&table, PaperConfig::default(), sigma, 4, 2000);
    assert!((four - 0.947).abs() < 0.020, "four dots: {four}");
    // Sums of densities keep the right basis among the verified.
    let config = PaperConfig {
        vote_sum: VoteSum::Density,
        ..PaperConfig::default()
    };
    let densities = rate(&table, config, sigma, usize::MAX, 500);
    assert!(densities > 0.99, "sums of densities: {densities}");
}

#[test]
fn a_workspace_does_not_remember() {
    let table = table(crate::common::random_pattern(20, 1));
    let recognizer = PaperRecognizer::from_table(&table).expect("valid parameters");
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut used = recognizer.workspace();
    for _ in 0..50 {
        let r = random_rotation(&mut rng);
        let (_, dots) = view(table.pattern(), &r, 0.0, 0.05, &mut rng);
        let fresh = recognizer.identify(&dots, &mut recognizer.workspace());
        assert_eq!(recognizer.identify(&dots, &mut used), fresh);
    }
}

#[test]
fn an_oval_density_works_too() {
    let table = table(crate::common::random_pattern(20, 1));
    let config = PaperConfig {
        beta: 100.0,
        vote_sum: VoteSum::Density,
        ..PaperConfig::default()
    };
    assert!(rate(&table, config, 0.01, usize::MAX, 100) > 0.97);
}

#[test]
fn what_cannot_be_identified_is_refused() {
    let table = table(crate::common::random_pattern(20, 1));
    let recognizer = PaperRecognizer::from_table(&table).expect("valid parameters");
    let mut ws = recognizer.workspace();
    let mut refusal = |dots: &[Vec3]| {
        let dots: Vec<_> = dots.iter().copied().map(observed).collect();
        recognizer.identify(&dots, &mut ws).err()
    };
    let (x, y, z) = (Vec3::x(), Vec3::y(), Vec3::z());
    for found in 0..3 {
        let few = Some(RecognizerRejection::TooFewDots { found, needed: 3 });
        assert_eq!(refusal(&[x, y, z][..found]), few);
    }
    assert_eq!(refusal(&[x, x, y]), Some(RecognizerRejection::Degenerate));
    assert_eq!(refusal(&[x, -x, y]), Some(RecognizerRejection::Degenerate));
    assert_eq!(
        refusal(&[x, y, Vec3::zeros()]),
        Some(RecognizerRejection::Degenerate)
    );
    assert_eq!(
        refusal(&[x, y, z * f64::NAN]),
        Some(RecognizerRejection::Degenerate)
    );
    assert_eq!(
        refusal(&[x, y, z * f64::INFINITY]),
        Some(RecognizerRejection::Degenerate)
    );
    // A third dot on top of the first still gives some answer, and no panic.
    let _ = refusal(&[x, y, x]);
}

#[test]
fn parameters_outside_their_domain_are_refused() {
    let table = table(crate::common::random_pattern(8, 1));
    let good = PaperConfig::default();
    let bad = [
        PaperConfig { k: 0, ..good },
        PaperConfig { alpha: 0.0, ..good },
        PaperConfig {
            alpha: f64::NAN,
            ..good
        },
        PaperConfig {
            kappa: -1.0,
            ..good
        },
        PaperConfig {
            beta: 250.0,
            ..good
        },
        PaperConfig {
            verify_fraction: 0.0,
            ..good
        },
        PaperConfig {
            verify_fraction: 1.5,
            ..good
        },
    ];
    for config in bad {
        assert!(PaperRecognizer::new(&table, config).is_err(), "{config:?}");
    }
}
