//! The bound of the orientation error: against simulation with known correspondences, and against what
//! the robust recognizer attains.

use crate::common::orientation_bound::{expected_error, mean_length, orientation_information};
use nalgebra::Matrix3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use spindoe::geometry::{Vec3, kabsch, random_rotation, rotation_angle, tangent_frame};
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::validate::{ORIENTATION_FAILURE_RAD, TrialResult, Trials};
use spindoe::view::{Noise, ProtocolName, Trial};

/// A seed that nothing was tuned on.
const SEED: u64 = 77_003;

#[test]
fn the_bound_is_met_by_least_squares_under_gaussian_noise() {
    let pattern = crate::common::random_pattern(20, 3);
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let sigma = 0.03;
    // RandomAxis' angle sigma is sqrt 3 of the tangent axes'.
    let noise = Noise::RandomAxis {
        sigma_rad: sigma * 3f64.sqrt(),
    };
    for given in [4, 8] {
        let (mut error, mut bound) = (0.0, 0.0);
        for _ in 0..4000 {
            let truth = random_rotation(&mut rng);
            let seen: Vec<Vec3> = pattern.dots()[..given].to_vec();
            let exact: Vec<Vec3> = seen.iter().map(|d| truth * d).collect();
            let measured: Vec<Vec3> = exact
                .iter()
                .map(|q| {
                    let [a, b] = tangent_frame(q);
                    let [x, y]: [f64; 2] = [(); 2].map(|()| StandardNormal.sample(&mut rng));
                    (q + (a * x + b * y) * sigma).normalize()
                })
                .collect();
            let found = kabsch(&seen, &measured, None).unwrap();
            error += rotation_angle(&found, &truth);
            let information = orientation_information(&exact, &noise);
            bound += mean_length(&information.try_inverse().unwrap()).unwrap();
        }
        let ratio = error / bound;
        assert!((ratio - 1.0).abs() < 0.025, "{given} dots: {ratio}");
    }
}

#[test]
fn the_mean_length_of_normal_vectors() {
    // Maxwell's distribution: 2 sqrt(2 / pi).
    let round = mean_length(&Matrix3::from_diagonal_element(0.25)).unwrap();
    assert!((round - (2.0 / std::f64::consts::PI).sqrt()).abs() < 1e-6);
    // One axis alone: sqrt(2 / pi).
    let line = mean_length(&Matrix3::from_diagonal(&Vec3::new(1.0, 1e-14, 1e-14))).unwrap();
    assert!(
        (line - (2.0 / std::f64::consts::PI).sqrt()).abs() < 1e-4,
        "{line}"
    );
    assert_eq!(mean_length(&Matrix3::zeros()), None);
}

#[test]
fn errors_are_near_the_bound() {
    let pattern = crate::common::random_pattern(20, 3);
    // The bound is that of Gaussian noise: where the noise has a pole, knowing that beats it.
    let expected = [
        (ProtocolName::Paper, 0.65..0.9),
        (ProtocolName::Image, 0.95..1.07),
    ];
    for (name, range) in expected {
        let robust = RobustRecognizer::new(&pattern, name.view().into()).unwrap();
        let trials = Trials::first(&pattern, name.view(), SEED, 1500);
        let found = trials.run(&robust, &|_| {}).unwrap();
        let mut generator = trials.generator();
        let mut trial = Trial::default();
        let (mut error, mut bound) = (0.0, 0.0);
        for (index, result) in found.iter().enumerate() {
            generator.generate(index as u64, &mut trial);
            let TrialResult::Judged { error_rad, .. } = *result else {
                continue;
            };
            if error_rad < ORIENTATION_FAILURE_RAD {
                error += error_rad;
                bound += expected_error(&pattern, &trial, &trials.view.noise).unwrap();
            }
        }
        let ratio = error / bound;
        assert!(range.contains(&ratio), "{name}: {ratio}");
    }
}
