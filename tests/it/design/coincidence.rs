//! Coincidence against brute force and random rotations, and its slope against differences.

use super::central_difference;
use nalgebra::Matrix3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::design::objective::Coincidence;
use spindoe::design::{Objective, ObjectiveName};
use spindoe::geometry::{
    Vec3, random_direction, random_rotation, spiral_directions, tangent_frame,
};
use spindoe::validate::{Protocol, ProtocolName};

fn dots(n: usize, separation_rad: f64, seed: u64) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < n {
        let d = random_direction(&mut rng);
        if dots.iter().all(|p| p.dot(&d) < separation_rad.cos()) {
            dots.push(d);
        }
    }
    dots
}

/// A camera that shows exactly four dots: nothing but false poses counts.
fn four_given(sigma_rad: f64) -> Coincidence {
    Coincidence {
        sigma_rad,
        visibility_limit: 0.2,
        softness: 0.05,
        limit_spread: 0.0,
        detection_probability: 1.0,
        crowding: 0.0,
        given: Some(4),
    }
}

/// Elementary symmetric polynomial of degree 4, over all sets of four.
fn all_sets(terms: &[f64]) -> f64 {
    let n = terms.len();
    let mut sum = 0.0;
    for a in 0..n {
        for b in a + 1..n {
            for c in b + 1..n {
                for d in c + 1..n {
                    sum += terms[a] * terms[b] * terms[c] * terms[d];
                }
            }
        }
    }
    sum
}

/// How well the dots coincide under a rotation, from the formula in the module's head.
fn coincide(dots: &[Vec3], rotation: &Matrix3<f64>, sigma: f64) -> Vec<f64> {
    dots.iter()
        .map(|p| {
            let apart = dots.iter().map(|q| {
                let squared = (p - rotation * q).norm_squared();
                // Lowered to reach zero, with its slope, at six sigma.
                let (u, end) = (squared / (8.0 * sigma * sigma), 4.5f64);
                let line = (-end).exp() * (1.0 + end - u);
                let scale = 1.0 / (1.0 - (-end).exp() * (1.0 + end));
                if u < end {
                    1.0 - scale * ((-u).exp() - line)
                } else {
                    1.0
                }
            });
            1.0 - apart.product::<f64>()
        })
        .collect()
}

/// The value by random rotations: the integral itself, without pairs.
fn by_random_rotations(dots: &[Vec3], config: &Coincidence, rotations: usize) -> f64 {
    let views: Vec<Vec3> = spiral_directions(64).collect();
    let seen: Vec<Vec<f64>> = views
        .iter()
        .map(|v| {
            let z = |d: &Vec3| (d.dot(v) - config.visibility_limit) / config.softness;
            dots.iter().map(|d| 1.0 / (1.0 + (-z(d)).exp())).collect()
        })
        .collect();
    let mut sums = vec![0.0; views.len()];
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for _ in 0..rotations {
        let rotation = random_rotation(&mut rng);
        // The true pose is none of the false ones; between the two angles it fades.
        if rotation.angle() < 0.35 {
            continue;
        }
        let g = coincide(
            dots,
            rotation.to_rotation_matrix().matrix(),
            config.sigma_rad,
        );
        if g.iter().filter(|g| **g > 0.0).count() < 4 {
            continue;
        }
        for (sum, seen) in sums.iter_mut().zip(&seen) {
            let terms: Vec<f64> = seen.iter().zip(&g).map(|(s, g)| s * g).collect();
            *sum += all_sets(&terms) / all_sets(seen).max(1.0);
        }
    }
    let volume = 8.0 * std::f64::consts::PI.powi(2);
    let width = 8.0 * std::f64::consts::PI * config.sigma_rad.powi(2);
    let of_a_pose = (width / (8.0 / 3.0)).powf(1.5);
    let scale = volume / rotations as f64 / of_a_pose;
    let failure = |sum: &f64| 1.0 - (-0.5 * scale * sum).exp();
    sums.iter().map(failure).sum::<f64>() / views.len() as f64
}

#[test]
fn coincidence_is_the_integral_over_all_rotations() {
    for seed in [1, 3] {
        let dots = dots(10, 0.4, seed);
        let config = four_given(0.05);
        let found = config.evaluate(&dots).value;
        let expected = by_random_rotations(&dots, &config, 150_000);
        // Each pair's integral is taken at one rotation: right but for some tenths.
        let ratio = found / expected;
        assert!((0.6..1.6).contains(&ratio), "{found} {expected}");
    }
}

#[test]
fn a_symmetric_pattern_is_mistaken_for_itself() {
    // The corners of a cube: 23 turns lay it on itself. Views of fewer than four corners show nothing.
    let s = 1.0 / 3f64.sqrt();
    let sign = |k: usize, bit: usize| if k >> bit & 1 == 0 { s } else { -s };
    let cube: Vec<Vec3> = (0..8)
        .map(|k| Vec3::new(sign(k, 0), sign(k, 1), sign(k, 2)))
        .collect();
    let config = four_given(0.02);
    let symmetric = config.evaluate(&cube).value;
    let random = config.evaluate(&dots(8, 0.5, 3)).value;
    assert!(symmetric > 0.6, "{symmetric}");
    assert!(random < 0.05, "{random}");
}

#[test]
fn coincidence_s_slope_matches_central_differences() {
    let h = 1e-6;
    let protocols = ProtocolName::ALL.map(|name| {
        let protocol = Protocol::standard(name);
        match Objective::for_protocol(ObjectiveName::Coincidence, &protocol) {
            Objective::Coincidence(config) => config,
            other => panic!("{other:?}"),
        }
    });
    // Of 26 dots only some pairs are taken.
    for (n, separation) in [(9, 0.4), (20, 0.25), (26, 0.2)] {
        let dots = dots(n, separation, n as u64);
        for config in protocols.into_iter().chain([Coincidence::default()]) {
            let gradient = config.evaluate(&dots).gradient;
            let largest = gradient.iter().map(Vec3::norm).fold(0.0, f64::max);
            assert!(largest > 1e-6, "{config:?}: no slope anywhere");
            for i in [0, 1, n / 2, n - 1] {
                for axis in tangent_frame(&dots[i]) {
                    let value = |dots: &[Vec3]| config.evaluate(dots).value;
                    let numeric = central_difference(&dots, i, &axis, h, value);
                    let error = (numeric - gradient[i].dot(&axis)).abs();
                    assert!(
                        error < 1e-4 * largest,
                        "{config:?} {n} dots, dot {i}: {numeric} against {}",
                        gradient[i].dot(&axis)
                    );
                }
            }
        }
    }
}

#[test]
fn what_no_camera_sees_fails_and_what_every_camera_sees_does_not() {
    let dots = dots(16, 0.45, 5);
    let blind = Coincidence {
        detection_probability: 0.02,
        ..Coincidence::default()
    };
    assert!(blind.evaluate(&dots).value > 0.9);
    let clear = Coincidence {
        sigma_rad: 0.005,
        visibility_limit: 0.0,
        softness: 0.05,
        limit_spread: 0.0,
        detection_probability: 1.0,
        crowding: 0.0,
        given: None,
    };
    assert!(clear.evaluate(&dots).value < 0.1);
    // Sixty-four dots, as many as there may be.
    let many = self::dots(64, 0.12, 6);
    let value = Coincidence::default().evaluate(&many).value;
    assert!(value > 0.0 && value < 1.0, "{value}");
}
