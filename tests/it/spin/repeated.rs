//! Rows of equal times: several measurements of one orientation, as several cameras give them.

use spindoe::geometry::{Rotation, Vec3};
use spindoe::spin::Measurement;
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::orientations::Orientations;
use spindoe::spin::quatera::{QuateraConfig, QuateraEstimator};
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::simulate::{Scenario, stream};
use spindoe::spin::windows::{constant_stretches, spin_over_time};

/// A sequence that two cameras have measured, and the spin; frames of the second are `late_s` later.
fn twice(seed: u64, frames: usize, late_s: f64) -> (Vec<Measurement>, Vec3) {
    let scenario = Scenario {
        frames,
        outliers: 0.0,
        ..Scenario::default()
    };
    let sequence = scenario.sequence((40.0, 60.0), seed, 0);
    let mut rng = stream(seed, 1);
    let sigma = scenario.sigma_rad;
    let mut both = Vec::new();
    for first in &sequence.measurements {
        use rand::RngExt;
        let normal = |rng: &mut rand_chacha::ChaCha8Rng| {
            sigma * rng.sample::<f64, _>(rand_distr::StandardNormal)
        };
        let noise = Vec3::from_fn(|_, _| normal(&mut rng));
        let at = sequence.truth.at(first.time_s + late_s);
        let second = Rotation::from_scaled_axis(noise) * at;
        both.push(*first);
        both.push(Measurement {
            time_s: first.time_s + late_s,
            ..Measurement::new(0.0, second)
        });
    }
    (both, sequence.truth.spin)
}

#[test]
fn both_measurements_of_a_time_count() {
    let (mut alone, mut together) = (0.0, 0.0);
    for seed in 0..40 {
        let (both, spin) = twice(900 + seed, 20, 0.0);
        let first: Vec<Measurement> = both.iter().step_by(2).copied().collect();
        let error = |measurements: &[Measurement]| {
            let fit = RobustEstimator::new(SpinConfig::default())
                .fit(measurements)
                .unwrap();
            let inverse = fit.spin_covariance.unwrap().try_inverse().unwrap();
            let off = fit.motion.spin - spin;
            (off.norm_squared(), off.dot(&(inverse * off)))
        };
        let ((one, _), (two, chi2)) = (error(&first), error(&both));
        alone += one;
        together += two;
        assert!(chi2 < 25.0, "{seed}: {chi2}");
    }
    // Half the variance; forty trials of three axes leave a deviation of a sixth.
    let ratio = together / alone;
    assert!((0.3..0.8).contains(&ratio), "{ratio}");
}

#[test]
fn every_estimator_takes_them() {
    let (mut both, spin) = twice(950, 60, 0.0);
    // One of a time is wrong, and says so for itself alone.
    both[21].orientation =
        Rotation::from_scaled_axis(Vec3::new(1.0, 0.5, -0.3)) * both[21].orientation;
    both[21].confidence = 0.6;
    let config = SpinConfig::default();
    let near = |found: &Vec3| (found - spin).norm() < 0.03 * spin.norm();
    let mut robust = RobustEstimator::new(config);
    assert!(near(&robust.fit(&both).unwrap().motion.spin));
    assert_eq!(robust.inlier_probabilities().len(), both.len());
    let mut quatera = QuateraEstimator::new(QuateraConfig::default());
    assert!(near(&quatera.fit(&both).unwrap().motion.spin));
    assert_eq!(quatera.inliers().len(), both.len());
    for model in [MotionModel::Auto, MotionModel::Decaying, MotionModel::Free] {
        let found = SpinEstimate::fit(&both, model, &config).unwrap();
        assert!(near(&found.overall().motion.spin), "{model}");
        let inliers = found.inlier_probabilities(&both);
        assert_eq!(inliers.len(), both.len());
        assert!(
            inliers[21] < 0.1 && inliers[20] > 0.5,
            "{model}: {:?}",
            &inliers[20..22]
        );
    }
    assert_eq!(spin_over_time(&both, 20, &config).unwrap().len(), 5);
    let stretches = constant_stretches(&both, &config).unwrap();
    assert_eq!(stretches[0].orientations, 0..both.len());
}

#[test]
fn a_file_of_them_is_read_and_times_a_microsecond_apart_are_two() {
    let (both, spin) = twice(960, 20, 0.0);
    let text = Orientations::from_measurements(&both).to_csv();
    let file = Orientations::read("o.csv".as_ref(), text.as_bytes()).unwrap();
    let fit = RobustEstimator::new(SpinConfig::default())
        .fit(&file.measurements())
        .unwrap();
    assert!((fit.motion.spin - spin).norm() < 0.05 * spin.norm());
    // By a clock that counts from 1970, whose times are rounded to a quarter of a microsecond.
    for since_s in [0.0, 1.7e9] {
        let (mut apart, spin) = twice(961, 20, 1e-6);
        apart.iter_mut().for_each(|m| m.time_s += since_s);
        let fit = RobustEstimator::new(SpinConfig::default())
            .fit(&apart)
            .unwrap();
        assert!(
            (fit.motion.spin - spin).norm() < 0.05 * spin.norm(),
            "{since_s}"
        );
    }
}
