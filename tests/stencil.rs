//! The stencil on random patterns: closed halves, the right topology, clear refusals.

#![allow(clippy::unwrap_used)]

use rand::{RngExt, SeedableRng};
use spindoe::geometry::{Vec3, angle_between, random_direction};
use spindoe::pattern::Pattern;
use spindoe::stencil::{Stencil, StencilConfig};

/// `n` dots at least `separation_deg` apart, by rejection.
fn random_pattern(n: usize, separation_deg: f64, seed: u64) -> Pattern {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < n {
        let d = random_direction(&mut rng);
        if dots
            .iter()
            .all(|e| angle_between(e, &d).to_degrees() > separation_deg)
        {
            dots.push(d);
        }
    }
    Pattern::new(dots).unwrap()
}

#[test]
fn random_patterns_give_solids() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let config = StencilConfig::default();
    for seed in 0..20 {
        let n = rng.random_range(4..=20);
        let pattern = random_pattern(n, 20.0, seed);
        let stencil = Stencil::build(&pattern, &config)
            .unwrap_or_else(|e| panic!("seed {seed}, {n} dots: {e}"));
        for half in stencil.halves() {
            half.check.require_solid("a half").unwrap();
            assert_eq!(half.check.genus() as usize, half.through_holes);
        }
    }
}

#[test]
fn overlapping_holes_are_refused_with_the_figure() {
    let pattern = random_pattern(30, 5.0, 1);
    let config = StencilConfig {
        hole_diameter_mm: 6.0,
        ..StencilConfig::default()
    };
    let message = Stencil::build(&pattern, &config)
        .expect_err("must be refused")
        .to_string();
    assert!(message.contains("mm between them"), "{message}");
}
