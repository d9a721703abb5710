//! The stencil on random patterns: closed halves, the right topology, clear refusals.

use rand::{RngExt, SeedableRng};
use spindoe::geometry::{Vec3, angle_between, random_direction};
use spindoe::pattern::Pattern;
use spindoe::stencil::{HoleSide, Stencil, StencilConfig};

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
    Pattern::new(dots).expect("valid by construction")
}

#[test]
fn random_patterns_give_solids() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let config = StencilConfig::default();
    for seed in 0..40 {
        let n = rng.random_range(4..=24);
        let pattern = random_pattern(n, 17.5, seed);
        let stencil = Stencil::build(&pattern, &config)
            .unwrap_or_else(|e| panic!("seed {seed}, {n} dots: {e}"));
        let on_seam = stencil.sides().iter().filter(|s| **s == HoleSide::Seam);
        let through: i64 = stencil.halves().iter().map(|h| h.check.genus()).sum();
        assert_eq!(through as usize + on_seam.count(), n, "seed {seed}");
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
