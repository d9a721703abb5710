//! The smooth failure rate and the test by which polishing takes a pattern.

use std::sync::atomic::AtomicBool;

use spindoe::design::polish::sign_test;
use spindoe::design::rate::SmoothRate;
use spindoe::geometry::{Vec3, angle_between, tangent_frame};
use spindoe::hash::{HashTable, PairRule, RecognizerConfig};
use spindoe::pattern::Pattern;
use spindoe::recognize::RecognizerName;
use spindoe::validate::{
    CommonRandomTrials, Protocol, ProtocolName, Trial, TrialGenerator, validate_named,
};

static NEVER: AtomicBool = AtomicBool::new(false);

fn rate(seed: u64, trials: u64) -> SmoothRate<'static> {
    SmoothRate {
        protocol: Protocol::standard(ProtocolName::Sparse),
        seed,
        trials,
        stop: &NEVER,
    }
}

#[test]
fn the_sign_test_is_the_binomial_s_tail() {
    // 8 or more heads of 10: 56 of 1024.
    assert!((sign_test(8, 2) - 56.0 / 1024.0).abs() < 1e-12);
    assert!((sign_test(0, 5) - 1.0).abs() < 1e-12);
    assert_eq!(sign_test(0, 0), 1.0);
    // Of many, the normal tail with its correction for continuity: the variance is 2000 / 4.
    let tail = 0.5 * libm::erfc((1060.0 - 0.5 - 1000.0) / 500f64.sqrt() / 2f64.sqrt());
    assert!((sign_test(1060, 940) / tail - 1.0).abs() < 0.02);
}

#[test]
fn the_smooth_rate_is_the_rate_of_failures() {
    // A good pattern; more noise than usual, for more failures to count.
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/designs/dots20/pattern.csv");
    let pattern = Pattern::read_csv(std::path::Path::new(path)).unwrap();
    let protocol = Protocol::standard(ProtocolName::Sparse).with_sigma_rad(4.5f64.to_radians());
    let rate = SmoothRate {
        protocol,
        ..rate(1, 20_000)
    };
    let smooth = rate.value(pattern.dots()).unwrap().exp();
    let table =
        HashTable::build(pattern, PairRule::default(), RecognizerConfig::default()).unwrap();
    let robust = RecognizerName::Robust;
    let counted = validate_named(&table, robust, &protocol, 2, 20_000).unwrap();
    let v = counted.validation;
    // The smooth rate takes skipped views for certain ones.
    let smooth = smooth * v.samples as f64 / v.identity.trials as f64;
    let failures = 1.0 - v.identity.rate;
    assert!(failures > 0.02, "nothing to see: {failures}");
    // Only the best few explanations of a view are summed: the more noise, the more it is short of.
    let share = smooth / failures;
    assert!((0.75..1.05).contains(&share), "{smooth} {failures}");
}

#[test]
fn the_smooth_rate_s_slope_is_that_of_its_values() {
    let pattern = crate::common::random_pattern(10, 3);
    let rate = rate(7, 4_000);
    let at = rate.evaluate(pattern.dots()).unwrap();
    // Along the slope itself, far enough for the full search's own choices not to matter.
    let h = 0.01
        / at.gradient
            .iter()
            .map(Vec3::norm_squared)
            .sum::<f64>()
            .sqrt();
    let moved = |by: f64| -> Vec<Vec3> {
        pattern
            .dots()
            .iter()
            .zip(&at.gradient)
            .map(|(d, g)| (d + g * by).normalize())
            .collect()
    };
    let rise = rate.value(&moved(h)).unwrap() - rate.value(&moved(-h)).unwrap();
    let predicted = 2.0 * h * at.gradient.iter().map(Vec3::norm_squared).sum::<f64>();
    assert!(predicted > 0.02, "no slope: {predicted}");
    assert!((rise / predicted - 1.0).abs() < 0.25, "{rise} {predicted}");
}

#[test]
fn steady_views_have_the_protocol_s_law_and_follow_the_pattern() {
    let pattern = crate::common::random_pattern(16, 1);
    for name in ProtocolName::ALL {
        let protocol = Protocol::standard(name);
        let mut steady = CommonRandomTrials::new(protocol, 5);
        let mut usual = TrialGenerator::new(&pattern, protocol, 6);
        // Means over many views: dots, false ones, displacement.
        let mut means = [[0.0; 3]; 2];
        let mut trial = Trial::default();
        let n = 40_000;
        for index in 0..n {
            for (kind, mean) in means.iter_mut().enumerate() {
                if kind == 0 {
                    steady.generate(&pattern, index, &mut trial);
                } else {
                    usual.generate(index, &mut trial);
                }
                let real: Vec<f64> = trial
                    .dots
                    .iter()
                    .zip(&trial.truth)
                    .filter_map(|(dot, t)| {
                        let true_dot = pattern.dots()[usize::from((*t)?)];
                        Some(angle_between(&(trial.rotation * true_dot), &dot.direction))
                    })
                    .collect();
                mean[0] += real.len() as f64;
                mean[1] += (trial.dots.len() - real.len()) as f64;
                mean[2] += real.iter().sum::<f64>();
            }
        }
        let [steady_means, usual_means] = means;
        for (a, b) in steady_means.iter().zip(&usual_means) {
            assert!((a - b).abs() < 0.03 * b.abs() + 1e-9, "{name}: {a} {b}");
        }
        // A dot that moves a little moves a little in its views, and no other does.
        let mut dots = pattern.dots().to_vec();
        dots[3] = (dots[3] + 1e-4 * tangent_frame(&dots[3])[0]).normalize();
        let shifted = Pattern::new(dots).unwrap();
        let (mut other, mut alike) = (Trial::default(), 0);
        for index in 0..200 {
            steady.generate(&pattern, index, &mut trial);
            steady.generate(&shifted, index, &mut other);
            if trial.truth != other.truth {
                continue;
            }
            alike += 1;
            for ((a, b), truth) in trial.dots.iter().zip(&other.dots).zip(&trial.truth) {
                let moved = angle_between(&a.direction, &b.direction);
                let most = if *truth == Some(3) { 1e-2 } else { 0.0 };
                assert!(moved <= most, "{name}: {moved}");
            }
        }
        assert!(alike > 190, "{name}: {alike}");
    }
}
