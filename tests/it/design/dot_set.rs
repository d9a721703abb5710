//! Whether a set of dots is good, on balls of which the answer is known.

use spindoe::design::Constraints;
use spindoe::design::dot_set::{DotSet, DotSetConfig};
use spindoe::geometry::{Vec3, random_direction};
use spindoe::pattern::{Pattern, shipped_designs};
use spindoe::view::{Detection, ProtocolName, Trial, TrialGenerator, ViewModel};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::common::spread_pattern;

fn judged(pattern: &Pattern, samples: u64, seed: u64) -> DotSet {
    let config = DotSetConfig {
        view: ProtocolName::Clutter.view(),
        samples,
        seed,
        constraints: Constraints::default(),
        avoided: Vec::new(),
    };
    DotSet::of(pattern, &config).unwrap()
}

/// So many dots above `z`, apart from each other.
fn above(z: f64, count: usize, seed: u64) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < count {
        let dot = random_direction(&mut rng);
        if dot.z > z && dots.iter().all(|d| d.dot(&dot) < 0.35f64.cos()) {
            dots.push(dot);
        }
    }
    dots
}

#[test]
fn a_bare_side_is_the_weak_one_and_gets_the_next_dot() {
    for seed in 0..2 {
        let pattern = Pattern::new(above(-0.1, 12, seed)).unwrap();
        let found = judged(&pattern, 400, 3 + seed);
        let side = found.weak_side.expect("half of the ball is bare");
        assert!(side.direction[2] < -0.5, "{side:?}");
        let next = found.next_dot.expect("there is room");
        assert!(next.helps(), "{next:?}");
        assert!(next.direction[2] < 0.0, "{next:?}");
    }
}

#[test]
fn a_symmetric_pattern_shows_which_dots_look_alike() {
    // Seven dots, and the same after half a turn about z: what each looks like is known.
    let half: Vec<Vec3> = spread_pattern(40, 0.1, 4)
        .dots()
        .iter()
        .copied()
        .filter(|d| d.x > 0.2)
        .take(7)
        .collect();
    let turned = half.iter().map(|d| Vec3::new(-d.x, -d.y, d.z));
    let pattern = Pattern::new(half.iter().copied().chain(turned).collect()).unwrap();
    let found = judged(&pattern, 400, 9);
    assert!(found.answers.right.rate < 0.7, "{:?}", found.answers);
    let first = found.lookalikes.first().expect("all of them");
    assert!(first.dots.len() >= 5, "{first:?}");
    for (dot, like) in first.dots.iter().zip(&first.like) {
        assert_eq!((dot + 7) % 14, *like, "{first:?}");
    }
}

#[test]
fn a_good_pattern_has_no_weakness() {
    let shipped = shipped_designs().unwrap();
    let dots40 = &shipped.iter().find(|d| d.name == "dots40").unwrap().pattern;
    let found = judged(dots40, 300, 2);
    assert!(found.answers.right.low > 0.97, "{:?}", found.answers);
    assert_eq!(found.lookalikes, []);
    assert_eq!(found.weak_side, None);
    assert!(found.next_dot.is_none_or(|next| !next.helps()));
}

#[test]
fn one_more_dot_changes_nothing_else_of_a_trial() {
    let pattern = spread_pattern(10, 0.3, 8);
    let view = ViewModel {
        detection: Detection::Each { probability: 0.7 },
        ..ProtocolName::Image.view()
    };
    let more = Vec3::new(0.6, 0.0, 0.8);
    let mut generator = TrialGenerator::new(pattern.dots(), view, 5);
    let (mut trial, mut with) = (Trial::default(), Trial::default());
    let mut shown = 0u64;
    let count = 20_000;
    for index in 0..count {
        generator.generate(index, &mut trial);
        generator.generate(index, &mut with);
        generator.show_one_more(&more, index, &mut with);
        assert_eq!(with.dots[..trial.dots.len()], trial.dots[..]);
        if let [dot] = with.dots[trial.dots.len()..] {
            shown += 1;
            assert_eq!(*with.truth.last().unwrap(), Some(10));
            let off = dot.direction.dot(&(trial.rotation * more)).acos();
            // Six sigma at the limit of visibility, where the image shortens most.
            assert!(off < 6.0 * view.noise.sigma_rad() / 0.15, "{off}");
        }
    }
    // Visible with (1 - 0.15) / 2, detected with 0.7.
    let (found, expected) = (shown as f64 / count as f64, 0.425 * 0.7);
    let sigma = (expected * (1.0 - expected) / count as f64).sqrt();
    assert!((found - expected).abs() < 4.0 * sigma, "{found} {expected}");
}
