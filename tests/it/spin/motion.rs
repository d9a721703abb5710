//! The motion by evidence: closed forms, constant spins that stay constant, and covariances that a lack of fit widens.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use spindoe::geometry::{Rotation, Vec3, random_direction};
use spindoe::spin::estimate::{FittedMotion, MotionModel, Rival, SpinEstimate};
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::simulate::{DrawnScenario, Scenario, decayed_time, stream};
use spindoe::spin::{Fit, Measurement, SpinRejection};
use spindoe::stats::Proportion;

const FPS: f64 = 350.0;

/// A ball that turns by `exp([p]x tau) R exp([q]x tau)`, `tau = (1 - exp(-c t)) / c`.
#[derive(Clone, Copy)]
struct Ball {
    space: Vec3,
    body: Vec3,
    decay_per_s: f64,
    start: Rotation,
}

impl Ball {
    fn at(&self, time_s: f64) -> Rotation {
        let tau = decayed_time(time_s, self.decay_per_s);
        Rotation::from_scaled_axis(self.space * tau)
            * self.start
            * Rotation::from_scaled_axis(self.body * tau)
    }

    /// The mean spin at a time.
    fn spin(&self, time_s: f64) -> Vec3 {
        let axis = self.space.normalize();
        let mean = self.space + axis * axis.dot(&(self.start * self.body));
        mean * (-self.decay_per_s * time_s).exp()
    }

    fn exact(&self, frames: usize) -> Vec<Measurement> {
        let times = (0..frames).map(|k| k as f64 / FPS);
        times.map(|t| Measurement::new(t, self.at(t))).collect()
    }
}

const TOP: Ball = Ball {
    space: Vec3::new(100.0, 300.0, -50.0),
    body: Vec3::new(12.0, -6.0, 9.0),
    decay_per_s: 0.1,
    start: Rotation::new_unchecked(nalgebra::Quaternion::new(0.6, 0.0, 0.8, 0.0)),
};

fn fitted(measurements: &[Measurement], model: MotionModel) -> SpinEstimate {
    SpinEstimate::fit(measurements, model, &SpinConfig::default()).unwrap()
}

#[test]
fn exact_orientations_give_their_motion_and_its_spin_in_the_middle() {
    let still = Vec3::zeros();
    for (ball, model) in [
        (
            Ball {
                body: still,
                decay_per_s: 0.0,
                ..TOP
            },
            MotionModel::Constant,
        ),
        (Ball { body: still, ..TOP }, MotionModel::Decaying),
        (TOP, MotionModel::Precessing),
    ] {
        let measurements = ball.exact(105);
        let found = fitted(&measurements, MotionModel::Auto);
        assert_eq!(found.motion.model(), model);
        let middle = found.middle_s();
        assert!((middle - 52.0 / FPS).abs() < 1e-12);
        let fit = found.at(middle);
        assert_eq!(fit.motion.time_s, middle);
        assert!(
            (fit.motion.spin - ball.spin(middle)).norm() < 0.02,
            "{model}: {fit:?}"
        );
        assert!((found.motion.decay_per_s() - ball.decay_per_s).abs() < 2e-3);
        let body = ball.body * (-ball.decay_per_s * middle).exp();
        assert!((found.motion.body_rate(middle) - body).norm() < 0.05);
        for m in &measurements {
            assert!(found.motion.predict(m.time_s).angle_to(&m.orientation) < 1e-3);
        }
        assert!(fit.motion.orientation.angle_to(&ball.at(middle)) < 1e-3);
        assert!(
            found
                .inlier_probabilities(&measurements)
                .iter()
                .all(|p| *p > 0.9)
        );
    }
}

#[test]
fn a_motion_that_is_asked_for_is_the_answer() {
    let constant = Ball {
        body: Vec3::zeros(),
        decay_per_s: 0.0,
        ..TOP
    };
    let measurements = constant.exact(105);
    for model in [
        MotionModel::Constant,
        MotionModel::Decaying,
        MotionModel::Precessing,
    ] {
        let found = fitted(&measurements, model);
        assert_eq!(found.motion.model(), model);
        let is_fitted = [
            matches!(found.decaying, Rival::Fitted(_)),
            matches!(found.precessing, Rival::Fitted(_)),
        ];
        let expected = [MotionModel::Decaying, MotionModel::Precessing].map(|m| m == model);
        assert_eq!(is_fitted, expected);
        assert!(found.decaying.fit().is_none_or(|fit| !fit.is_evident()));
        assert!(found.precessing.fit().is_none_or(|fit| !fit.is_evident()));
    }
    // A ball that hardly turns leaves a decay open.
    let slow = Ball {
        space: Vec3::new(0.0, 0.02, 0.0),
        ..constant
    };
    let found = fitted(&slow.exact(105), MotionModel::Decaying);
    assert_eq!(found.motion.model(), MotionModel::Constant);
    assert_eq!(found.decaying, Rival::Open);
    let few = SpinEstimate::fit(
        &measurements[..2],
        MotionModel::Auto,
        &SpinConfig::default(),
    );
    assert!(
        matches!(few, Err(SpinRejection::TooFewFrames { .. })),
        "{few:?}"
    );
}

#[test]
fn constant_spins_stay_constant() {
    let sequences: Vec<(usize, u64)> = [8, 12, 22, 40, 100]
        .into_iter()
        .flat_map(|frames| (0..80).map(move |k| (frames, k)))
        .collect();
    let models: Vec<Option<MotionModel>> = sequences
        .par_iter()
        .map(|&(frames, k)| {
            let scenario = DrawnScenario {
                frames,
                ..DrawnScenario::default()
            };
            let sequence = scenario.sequence(7_340, k);
            // What is shared may be known, or show in the residuals.
            let config = match k % 2 {
                0 => SpinConfig {
                    sigma_rad: sequence.sigma_rad,
                    shared: Some(sequence.shared),
                    ..SpinConfig::default()
                },
                _ => SpinConfig::default(),
            };
            let found = SpinEstimate::fit(&sequence.measurements, MotionModel::Auto, &config);
            found.ok().map(|found| found.motion.model())
        })
        .collect();
    let answered = models.iter().flatten().count() as u64;
    let alarms = models
        .iter()
        .flatten()
        .filter(|m| **m != MotionModel::Constant);
    let rate = Proportion::new(alarms.count() as u64, answered);
    println!("false alarms {rate:?}");
    // One in a hundred; the interval reaches that far down.
    assert!(answered >= 380 && rate.low <= 0.01, "{rate:?}");
}

#[test]
fn spins_that_change_are_found_and_covered() {
    let flights = crate::common::few_or_all(60, 100);
    let counted: Vec<[bool; 2]> = (0..flights as u64)
        .into_par_iter()
        .map(|i| {
            let flight = Scenario {
                frames: 210,
                decay_per_s: 0.2,
                ..Scenario::default()
            };
            let sequence = flight.sequence((20.0, 120.0), 7_341, i);
            let found = fitted(&sequence.measurements, MotionModel::Auto);
            let middle = found.middle_s();
            let truth = sequence.truth.spin * (-0.2 * middle).exp();
            let is_decaying = found.motion.model() == MotionModel::Decaying;
            [is_decaying, distance(&found.at(middle), &truth) < 7.815]
        })
        .collect();
    let count = |k: usize| counted.iter().filter(|c| c[k]).count();
    // SciPy's chi2(3).ppf(0.95); three standard errors below it.
    let held = 0.95 * flights as f64 - 3.0 * (0.95 * 0.05 * flights as f64).sqrt();
    assert!(
        count(0) + 1 >= flights && count(1) as f64 >= held,
        "{} {}",
        count(0),
        count(1)
    );
}

/// The squared Mahalanobis distance of a spin from the truth.
fn distance(fit: &Fit, truth: &Vec3) -> f64 {
    let off = fit.motion.spin - truth;
    let covariance = fit.spin_covariance.expect("a covariance");
    off.dot(&(covariance.try_inverse().expect("positive definite") * off))
}

#[test]
fn a_lack_of_fit_widens_the_covariance() {
    let mut rng = stream(7_342, 0);
    // The rate swings once over the sequence, by 1 %: no motion here does that.
    let axis = random_direction(&mut rng);
    let (rate, duration) = (50.0 * TAU, 160.0 / FPS);
    let swinging: Vec<Measurement> = (0..160)
        .map(|k| {
            let time_s = k as f64 / FPS;
            let swing = 0.01 * duration / TAU * (1.0 - (TAU * time_s / duration).cos());
            let noise = Vec3::from_fn(|_, _| rng.sample(StandardNormal)) * 0.01;
            let turned = Rotation::from_scaled_axis(axis * (rate * (time_s + swing)));
            Measurement::new(time_s, Rotation::from_scaled_axis(noise) * turned)
        })
        .collect();
    let found = fitted(&swinging, MotionModel::Constant);
    let fit = found.at(found.middle_s());
    let ratio = fit.lack_of_fit.expect("a lack of fit");
    assert!(ratio > 9.0, "{ratio}");
    // The spins of the halves differ from it by a few of its deviations.
    for half in swinging.chunks(80) {
        let part = fitted(half, MotionModel::Constant);
        let off = (part.at(part.middle_s()).motion.spin - fit.motion.spin).norm();
        let deviation = axis.dot(&(fit.spin_covariance.unwrap() * axis)).sqrt();
        assert!(off < 8.0 * deviation, "{off} {deviation}");
    }
    // What fits has none, and its covariance stays as it was.
    let lacking: Vec<bool> = (0..400)
        .into_par_iter()
        .map(|i| {
            let scenario = Scenario {
                frames: 60,
                ..Scenario::default()
            };
            let sequence = scenario.sequence((5.0, 150.0), 7_343, i);
            let found = fitted(&sequence.measurements, MotionModel::Constant);
            matches!(found.motion, FittedMotion::Constant(fit) if fit.lack_of_fit.is_some())
        })
        .collect();
    let lacking = lacking.iter().filter(|is| **is).count() as u64;
    let rate = Proportion::new(lacking, 400);
    assert!(rate.low <= 0.01, "{rate:?}");
}
