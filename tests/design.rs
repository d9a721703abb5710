//! The search: descents climb and keep their constraints, and the same seed finds the same pattern.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::atomic::AtomicBool;

use spindoe::design::descent::{Constraints, coordinates, descend};
use spindoe::design::objective::MeanNearestNeighbour;
use spindoe::design::{Candidate, DesignConfig, DesignObserver, design};
use spindoe::geometry::{Rotation, random_rotation};
use spindoe::hash::{HashTable, PairRule, RecogniserParams};
use spindoe::pattern::Pattern;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn small(seed: u64) -> DesignConfig {
    DesignConfig {
        dots: 12,
        seed,
        starts: 4,
        steps: 15,
        samples: 200,
        constraints: Constraints {
            least_visible: 2,
            ..Constraints::default()
        },
        ..DesignConfig::default()
    }
}

fn value(pattern: &Pattern) -> f64 {
    MeanNearestNeighbour::default()
        .evaluate(&coordinates(pattern))
        .unwrap()
        .value
}

#[test]
fn a_descent_climbs_and_keeps_its_distance() {
    let constraints = Constraints::default();
    for seed in 0..4 {
        let start = common::random_pattern(20, seed);
        let found = descend(&start, &MeanNearestNeighbour::default(), &constraints, 30).unwrap();
        let (before, after) = (value(&start), value(&found));
        assert!(after > 1.03 * before, "seed {seed}: {before} -> {after}");
        // The penalty gives way a little; `Constraints::check` decides what is still acceptable.
        let least = found.summary().least_separation_rad;
        assert!(
            least > 0.9 * constraints.least_separation_rad,
            "seed {seed}: {least}"
        );
    }
}

#[test]
fn the_objective_does_not_change_when_the_ball_turns() {
    let pattern = common::random_pattern(14, 3);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let r: Rotation = random_rotation(&mut rng);
    let turned = Pattern::new(pattern.dots().iter().map(|d| r * d).collect()).unwrap();
    assert!((value(&pattern) - value(&turned)).abs() < 1e-9);
}

#[test]
fn without_pairs_near_singular_the_objective_is_the_mean_over_the_table() {
    // Where every pair is well inside the rule's bounds all weights are one, and the objective is the
    // plain mean over all features: a tetrahedron's pairs are 109.5 degrees apart.
    let s = 1.0 / 3f64.sqrt();
    let dots = [[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]];
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    // Shaken, since equal features of a regular solid have distance 0.
    let shaken = dots.map(|d| {
        let dot = spindoe::geometry::Vec3::from(d);
        (dot + 0.1 * spindoe::geometry::random_direction(&mut rng)).normalize()
    });
    let pattern = Pattern::new(shaken.to_vec()).unwrap();
    let table =
        HashTable::build(pattern.clone(), PairRule::ALL, RecogniserParams::default()).unwrap();
    let distances = table.nearest_distances();
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    assert!((value(&pattern) - mean).abs() < 1e-12 * mean);
}

#[test]
fn the_same_seed_finds_the_same_pattern() {
    let go = AtomicBool::new(false);
    let run = |seed, threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| design(&small(seed), &go, &mut ()).unwrap())
    };
    let found = run(1, 1);
    assert_eq!(found, run(1, 3));
    assert_ne!(found.best.pattern, run(2, 2).best.pattern);
    // The winner is the best of the feasible ones on the selection's trials.
    let best = found
        .candidates
        .iter()
        .filter(|c| c.feasible)
        .map(|c| c.validation.identity.rate)
        .fold(0.0, f64::max);
    assert_eq!(found.best.validation.identity.rate, best);
    assert_eq!(found.best.validation.seed, small(1).selection_seed());
}

/// Stops the search once it has seen a candidate that satisfies the constraints.
struct Stopper<'a>(&'a AtomicBool);

impl DesignObserver for Stopper<'_> {
    fn candidate(&mut self, _: &Candidate, best: Option<&Candidate>) -> spindoe::Result<()> {
        self.0
            .store(best.is_some(), std::sync::atomic::Ordering::Relaxed);
        Ok(())
    }
}

#[test]
fn a_stopped_search_keeps_its_best() {
    let stop = AtomicBool::new(false);
    let config = DesignConfig {
        starts: 1000,
        ..small(1)
    };
    let found = design(&config, &stop, &mut Stopper(&stop)).unwrap();
    assert!(found.stopped);
    assert!(found.candidates.len() < 1000);
    // Stopped before anything was found: there is nothing to keep, and that is said.
    let stop = AtomicBool::new(true);
    assert!(design(&config, &stop, &mut ()).is_err());
}

#[test]
fn demands_that_cannot_be_met_are_refused_with_the_limit() {
    // Twelve points cannot be farther apart than the icosahedron's vertices, 63.43 degrees.
    let demand = |deg: f64| Constraints {
        least_separation_rad: deg.to_radians(),
        least_visible: 0,
    };
    assert!(demand(63.4).check_demand(12).is_ok());
    let error = demand(63.5).check_demand(12).unwrap_err().to_string();
    assert!(error.contains("63.4 degrees"), "{error}");
}
