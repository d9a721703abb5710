//! Views with too few dots against simulated ones and trials, and the slope of their rate against differences.

use super::central_difference;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::design::ObjectiveName;
use spindoe::design::objective::{CountFailures, TooFewDots};
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
fn simulated(dots: &[Vec3], config: &TooFewDots, views: usize) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let normal = |rng: &mut ChaCha8Rng| -> f64 {
        let [a, b]: [f64; 2] = [rng.random(), rng.random()];
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let crowds: Vec<f64> = dots
        .iter()
        .map(|d| {
            let near = |e: &Vec3| (-(d - e).norm_squared() / 0.18).exp();
            dots.iter().map(near).sum::<f64>() - 1.0
        })
        .collect();
    let mut detected = |dots: &[Vec3], crowding: f64| -> usize {
        let v = random_direction(&mut rng);
        let limit = config.visibility_limit + config.limit_spread * normal(&mut rng);
        let is_detected = |(d, crowd): &(&Vec3, &f64)| {
            let logit = (d.dot(&v) - limit) / config.softness - crowding * **crowd;
            rng.random::<f64>() < config.detection_probability / (1.0 + (-logit).exp())
        };
        dots.iter().zip(&crowds).filter(is_detected).count()
    };
    let CountFailures {
        min_dots,
        logit,
        slope,
    } = config.failures;
    let too_few = |k: usize| match k < min_dots {
        true => 1.0,
        false => 1.0 / (1.0 + (slope * (k - min_dots) as f64 - logit).exp()),
    };
    let failures = (0..views).map(|_| too_few(detected(dots, config.crowding)));
    failures.sum::<f64>() / views as f64
}

/// A small ball: dots are found where they face the camera, and fewer of those that are crowded.
fn camera() -> TooFewDots {
    TooFewDots {
        visibility_limit: 0.31,
        softness: 0.14,
        limit_spread: 0.15,
        detection_probability: 0.98,
        crowding: 0.5,
        failures: CountFailures {
            min_dots: 3,
            logit: 0.5,
            slope: 0.8,
        },
    }
}

#[test]
fn the_rate_is_the_mean_over_simulated_views() {
    for (n, separation, seed) in [(12, 0.4, 1), (24, 0.25, 3), (40, 0.2, 4)] {
        let dots = dots(n, separation, seed);
        let cameras = [
            camera(),
            TooFewDots {
                limit_spread: 0.0,
                detection_probability: 0.7,
                crowding: 2.0,
                ..camera()
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
fn sharpened_it_is_the_share_of_views_that_show_too_few() {
    // A view of `sparse` fails where fewer than four dots lie within the cap, counted over directions.
    for (n, separation, seed) in [(8, 0.5, 11), (12, 0.4, 1), (16, 0.35, 2)] {
        let dots = dots(n, separation, seed);
        let shown = |v: &Vec3| dots.iter().filter(|d| d.dot(v) > 1.0 / 3.0).count();
        let views = 40_000;
        let too_few = spindoe::geometry::spiral_directions(views).filter(|v| shown(v) < 4);
        let expected = too_few.count() as f64 / views as f64;
        let found = TooFewDots::default().sharpened().evaluate(&dots).value;
        assert!((found - expected).abs() < 0.01, "{n}: {found} {expected}");
    }
}

#[test]
fn failures_by_the_number_of_dots_are_what_trials_have() {
    use spindoe::recognize::robust::RobustRecognizer;
    use spindoe::validate::{ORIENTATION_FAILURE_RAD, TrialResult, Trials};
    use spindoe::view::Trial;
    // Another pattern, other trials.
    let pattern = crate::common::random_pattern(12, 77);
    for name in [ProtocolName::Image, ProtocolName::Clutter] {
        let trials = Trials::first(&pattern, name.view(), 505, 4_000);
        let recognizer = RobustRecognizer::new(&pattern, trials.view.into()).unwrap();
        let results = trials.run(&recognizer, &|_| {}).unwrap();
        let (mut generator, mut trial) = (trials.generator(), Trial::default());
        let mut counts = [[0u32; 2]; 13];
        for (index, result) in (0..).zip(&results) {
            if let TrialResult::Judged { error_rad, .. } = result {
                generator.generate(index, &mut trial);
                let fails = *error_rad >= ORIENTATION_FAILURE_RAD;
                counts[trial.real_dots()][usize::from(fails)] += 1;
            }
        }
        let CountFailures { logit, slope, .. } = CountFailures::of_view(&name.view(), 12).unwrap();
        for (k, count) in counts.iter().enumerate().skip(3).take(3) {
            let [right, wrong] = count.map(f64::from);
            let found = wrong / (right + wrong);
            let expected = 1.0 / (1.0 + (slope * (k - 3) as f64 - logit).exp());
            assert!(
                (found - expected).abs() < 0.12,
                "{name} {k}: {found} {expected}"
            );
        }
    }
}

#[test]
fn its_slope_matches_central_differences() {
    let h = 1e-6;
    // Of `paper`, which shows all dots of the half that is seen, next to no view has too few.
    let names = [
        ProtocolName::Sparse,
        ProtocolName::Image,
        ProtocolName::Clutter,
    ];
    let protocols = names.map(|name| TooFewDots::of_view(&name.view(), 12).unwrap());
    for (n, separation) in [(9, 0.4), (20, 0.25), (26, 0.2)] {
        let dots = dots(n, separation, n as u64);
        for config in protocols.into_iter().chain([camera()]) {
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
    let blind = TooFewDots {
        detection_probability: 0.02,
        ..camera()
    };
    assert!(blind.evaluate(&dots).value > 0.9);
    let clear = TooFewDots {
        visibility_limit: 0.0,
        softness: 0.05,
        limit_spread: 0.0,
        detection_probability: 1.0,
        crowding: 0.0,
        ..camera()
    };
    assert!(clear.evaluate(&dots).value < 0.1);
    // Sixty-four dots, as many as there may be.
    let many = self::dots(64, 0.12, 6);
    let value = camera().evaluate(&many).value;
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
    let value = |dots: &[Vec3]| camera().evaluate(dots).value;
    let [crowded, spread] = [value(&crowded), value(&spread)];
    assert!(crowded > 1.4 * spread, "{crowded} {spread}");
}

#[test]
fn the_former_names_are_answered_with_the_new_one() {
    for name in ["coincidence", "coverage", "confusion"] {
        let error = name.parse::<ObjectiveName>().unwrap_err();
        assert!(error.is_usage() && error.to_string().contains("replaced by failure-rate"));
        let dir = tempfile::tempdir().unwrap();
        let setting = format!("objective={name}");
        let command = ["design", "--config", &setting, "--output", "d"];
        let output = crate::common::spindoe(dir.path(), &command);
        let words = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2));
        assert!(words.contains("replaced by failure-rate"), "{words}");
        assert_eq!(words.trim().lines().count(), 1, "{words}");
    }
}
