//! Coverage against simulated views, and its slope against differences.

use super::central_difference;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::design::objective::Coverage;
use spindoe::design::{Objective, ObjectiveName};
use spindoe::geometry::{Vec3, random_direction, tangent_frame};
use spindoe::view::ProtocolName;

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

/// The value by drawing views, from the formula in the module's head.
fn simulated(dots: &[Vec3], config: &Coverage, views: usize) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let normal = |rng: &mut ChaCha8Rng| -> f64 {
        let [a, b]: [f64; 2] = [rng.random(), rng.random()];
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let mut detected = |dots: &[Vec3], crowding: f64| -> usize {
        let v = random_direction(&mut rng);
        let limit = config.visibility_limit + config.limit_spread * normal(&mut rng);
        let is_detected = |d: &&Vec3| {
            let near = |e: &Vec3| (-(*d - e).norm_squared() / 0.18).exp();
            let crowd = dots.iter().map(near).sum::<f64>() - 1.0;
            let logit = (d.dot(&v) - limit) / config.softness - crowding * crowd;
            rng.random::<f64>() < config.detection_probability / (1.0 + (-logit).exp())
        };
        dots.iter().filter(is_detected).count()
    };
    // What a view of so many dots detects on average, wherever they are.
    let all: usize = (0..views).map(|_| detected(dots, 0.0)).sum();
    let mean = all as f64 / views as f64;
    let too_few = |k: usize| match k {
        0..3 => 1.0,
        _ => ((0.29 - k as f64 / mean) / 0.19).exp().min(1.0),
    };
    let failures = (0..views).map(|_| too_few(detected(dots, config.crowding)));
    failures.sum::<f64>() / views as f64
}

#[test]
fn coverage_is_the_mean_over_simulated_views() {
    for (n, separation, seed) in [(12, 0.4, 1), (24, 0.25, 3), (40, 0.2, 4)] {
        let dots = dots(n, separation, seed);
        let cameras = [
            Coverage::default(),
            Coverage {
                limit_spread: 0.0,
                detection_probability: 0.7,
                crowding: 2.0,
                ..Coverage::default()
            },
        ];
        for config in cameras {
            let found = config.evaluate(&dots).value;
            let expected = simulated(&dots, &config, 200_000);
            let ratio = found / expected;
            assert!((0.96..1.04).contains(&ratio), "{n}: {found} {expected}");
        }
    }
}

#[test]
fn coverage_s_slope_matches_central_differences() {
    let h = 1e-6;
    let protocols = ProtocolName::ALL.map(|name| {
        match Objective::for_view(ObjectiveName::Coverage, &name.view()) {
            Objective::Coverage(config) => config,
            other => panic!("{other:?}"),
        }
    });
    for (n, separation) in [(9, 0.4), (20, 0.25), (26, 0.2)] {
        let dots = dots(n, separation, n as u64);
        for config in protocols.into_iter().chain([Coverage::default()]) {
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
    let blind = Coverage {
        detection_probability: 0.02,
        ..Coverage::default()
    };
    assert!(blind.evaluate(&dots).value > 0.9);
    let clear = Coverage {
        visibility_limit: 0.0,
        softness: 0.05,
        limit_spread: 0.0,
        detection_probability: 1.0,
        crowding: 0.0,
    };
    assert!(clear.evaluate(&dots).value < 0.1);
    // Sixty-four dots, as many as there may be.
    let many = self::dots(64, 0.12, 6);
    let value = Coverage::default().evaluate(&many).value;
    assert!(value > 0.0 && value < 1.0, "{value}");
}

#[test]
fn a_bare_side_costs_more_than_spread_dots() {
    // Twenty dots over the whole ball, and twenty on the half with z > -0.2.
    let spread = dots(20, 0.45, 7);
    let mut crowded = dots(34, 0.25, 7);
    crowded.sort_by(|a, b| b.z.total_cmp(&a.z));
    crowded.truncate(20);
    assert!(crowded.iter().all(|d| d.z > -0.3));
    let value = |dots: &[Vec3]| Coverage::default().evaluate(dots).value;
    let [crowded, spread] = [value(&crowded), value(&spread)];
    assert!(crowded > 1.5 * spread, "{crowded} {spread}");
}

#[test]
fn the_former_name_is_answered_with_the_new_one() {
    let error = "coincidence".parse::<ObjectiveName>().unwrap_err();
    assert!(error.is_usage() && error.to_string().contains("replaced by coverage"));
    let dir = tempfile::tempdir().unwrap();
    let command = [
        "design",
        "--config",
        "objective=coincidence",
        "--output",
        "d",
    ];
    let output = crate::common::spindoe(dir.path(), &command);
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2));
    assert!(words.contains("replaced by coverage"), "{words}");
    assert_eq!(words.trim().lines().count(), 1, "{words}");
}
