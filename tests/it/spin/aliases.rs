//! Spins that the sampling cannot tell apart: even times report the tie, uneven ones resolve it.

use std::f64::consts::TAU;

use nalgebra::Quaternion;
use rand::RngExt;
use rayon::prelude::*;
use spindoe::geometry::{Rotation, Vec3, random_direction, random_rotation};
use spindoe::spin::alias::{AliasConfig, Alternative, SpinEvidence, alternatives};
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::robust::{RobustEstimator, SpinConfig, standard_deviations};
use spindoe::spin::simulate::{Scenario, SimulatedSequence, stream};
use spindoe::spin::{Fit, Measurement};
use spindoe::validate::Proportion;

const FPS: f64 = 350.0;

/// The estimate among spins up to 350 rps, and its alternatives.
fn estimate(measurements: &[Measurement]) -> (Fit, Vec<Alternative>) {
    let options = SpinConfig {
        max_rps: FPS,
        ..SpinConfig::default()
    };
    let fit = RobustEstimator::new(options).fit(measurements).unwrap();
    let others = alternatives(measurements, &fit, &AliasConfig::default());
    (fit, others)
}

fn fast(jitter: f64, seed: u64, index: u64) -> SimulatedSequence {
    let scenario = Scenario {
        jitter,
        ..Scenario::default()
    };
    scenario.sequence((200.0, 300.0), seed, index)
}

#[test]
fn even_times_report_the_tie_and_take_the_slowest() {
    for i in 0..100 {
        let sequence = fast(0.0, 61, i);
        let truth = sequence.truth.spin;
        let (fit, others) = estimate(&sequence.measurements);
        // One turn a frame less is the reversed axis.
        let alias = truth - truth.normalize() * (FPS * TAU);
        let near = |a: &Vec3, b: &Vec3| (a - b).norm() < 0.2 * b.norm();
        assert!(
            near(&fit.motion.spin, &alias),
            "{} beside {alias}",
            fit.motion.spin
        );
        let [other] = others.as_slice() else {
            panic!("expected the truth alone, found {others:?}");
        };
        assert!(near(&other.spin, &truth), "{} beside {truth}", other.spin);
        assert!(other.log_likelihood_ratio.abs() < 1e-6, "{other:?}");
    }
}

/// A spin's magnitude, as measured otherwise: revolutions per second and their deviation.
struct Magnitude {
    rps: f64,
    std_rps: f64,
}

impl SpinEvidence for Magnitude {
    fn ln_likelihood(&self, spin: &Vec3) -> f64 {
        -0.5 * ((spin.norm() / TAU - self.rps) / self.std_rps).powi(2)
    }
}

#[test]
fn further_evidence_takes_the_alias_that_it_is_for() {
    let config = SpinConfig {
        max_rps: FPS,
        ..SpinConfig::default()
    };
    let fit = |measurements: &[Measurement], evidence: &Magnitude| {
        SpinEstimate::fit_with(measurements, MotionModel::Constant, &config, evidence).unwrap()
    };
    for i in 0..50 {
        let sequence = fast(0.0, 64, i);
        let (measurements, truth) = (&sequence.measurements, sequence.truth.spin);
        let known = Magnitude {
            rps: truth.norm() / TAU,
            std_rps: 20.0,
        };
        // Aliases of equal magnitude are beyond what this knows.
        if (2.0 * known.rps - FPS).abs() < 80.0 {
            continue;
        }
        let estimate = fit(measurements, &known);
        let found = estimate.at(estimate.middle_s()).motion.spin;
        assert!(
            (found - truth).norm() < 0.2 * truth.norm(),
            "{found} beside {truth}"
        );
        let listed = AliasConfig::default();
        let summary = estimate.summary(measurements, estimate.middle_s(), &listed, 10);
        assert!(!summary.alternatives.is_empty());
        let weighed = summary.weighed(&known, &listed);
        let likeliest = weighed.alternatives.first().map(|a| a.log_likelihood_ratio);
        assert!(likeliest.is_none_or(|ratio| ratio < 0.0), "{likeliest:?}");
        // What says nothing changes nothing.
        let open = Magnitude {
            std_rps: f64::INFINITY,
            ..known
        };
        let plain = SpinEstimate::fit(measurements, MotionModel::Constant, &config).unwrap();
        assert_eq!(fit(measurements, &open), plain);
    }
}

#[test]
fn uneven_times_resolve_it() {
    let count = 500;
    let mut right = 0;
    for i in 0..count {
        let sequence = fast(0.1, 62, i);
        let truth = sequence.truth.spin;
        let (fit, others) = estimate(&sequence.measurements);
        let found = (fit.motion.spin - truth).norm() < 0.2 * truth.norm();
        right += u64::from(found && others.is_empty());
    }
    let rate = Proportion::new(right, count);
    assert!(rate.low > 0.98, "{rate}");
}

/// A rotation about a unit axis, by its definition.
fn about(axis: &Vec3, angle: f64) -> Rotation {
    let (sin, cos) = (0.5 * angle).sin_cos();
    Rotation::new_unchecked(Quaternion::from_parts(cos, axis * sin))
}

#[test]
fn of_equals_the_slowest_is_taken_at_any_frame_rate() {
    let rates = [
        10.0, 15.0, 20.0, 24.0, 25.0, 29.97, 30.0, 60.0, 120.0, 240.0,
    ];
    let wrong = rates.into_par_iter().flat_map_iter(|fps| {
        (0..100).filter_map(move |i| {
            let rng = &mut stream(68, i);
            let fastest = f64::min(5.0, 0.49 * fps);
            let rps = (0.1 * (fastest / 0.1).powf(rng.random())) as f64;
            let (axis, start) = (random_direction(rng), random_rotation(rng));
            let frames = 10 + (290.0 * rng.random::<f64>().powi(3)) as usize;
            let measurements: Vec<Measurement> = (0..frames)
                .map(|k| {
                    // In microseconds, as a file has them.
                    let time_s = (1e6 * k as f64 / fps).round() * 1e-6;
                    let off = about(&random_direction(rng), 0.7f64.to_radians());
                    let orientation = off * about(&axis, TAU * rps * time_s) * start;
                    Measurement::new(time_s, orientation)
                })
                .collect();
            let fit = RobustEstimator::new(SpinConfig::default()).fit(&measurements);
            let fit = fit.expect("a spin");
            let error = fit.motion.spin - axis * (TAU * rps);
            let std = standard_deviations(&fit.spin_covariance.expect("a covariance")).norm();
            let is_right = error.norm() < 4.0 * std;
            (!is_right).then(|| format!("{fps} fps, {rps} rps: {}", fit.motion.rps()))
        })
    });
    assert_eq!(wrong.collect::<Vec<_>>(), Vec::<String>::new());
}

#[test]
fn every_alias_within_the_limit_is_listed_in_order() {
    let sequence = Scenario {
        outliers: 0.0,
        ..Scenario::default()
    }
    .simulate(
        Vec3::new(0.0, 3.0, 4.0) * (0.2 * 60.0 * TAU),
        &mut stream(63, 0),
    );
    let fit = RobustEstimator::new(SpinConfig::default())
        .fit(&sequence.measurements)
        .unwrap();
    let rps = fit.motion.rps();
    let listed = |max_rps| {
        let options = AliasConfig {
            max_rps,
            ..AliasConfig::default()
        };
        let others = alternatives(&sequence.measurements, &fit, &options);
        let signed = |a: &Alternative| a.spin.dot(&fit.motion.spin.normalize()) / TAU;
        others.iter().map(signed).collect::<Vec<_>>()
    };
    let expected = [-1.0, 1.0, -2.0, 2.0].map(|k| rps + k * FPS);
    let found = listed(800.0);
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for (a, b) in found.iter().zip(expected) {
        // Whole turns between the frames bend the error's law across the axis a little.
        assert!((a - b).abs() < 0.5, "{found:?}, expected {expected:?}");
    }
    assert_eq!(listed(280.0), Vec::<f64>::new());
}

#[test]
fn missing_frames_bring_aliases_nearer() {
    // Every second frame at 350 per second is 175 per second: the alias of 60 rps is 115 reversed.
    let sequence = Scenario {
        outliers: 0.0,
        ..Scenario::default()
    }
    .simulate(Vec3::x() * (60.0 * TAU), &mut stream(64, 0));
    let halved: Vec<Measurement> = sequence.measurements.iter().copied().step_by(2).collect();
    let (fit, others) = estimate(&halved);
    assert!((fit.motion.rps() - 60.0).abs() < 1.0);
    let rps = others[0].spin.norm() / TAU;
    assert!((rps + fit.motion.rps() - 175.0).abs() < 1e-3, "{rps}");
    // A single frame between two of them decides.
    let mut decided = halved.clone();
    decided.insert(1, sequence.measurements[1]);
    let (_, others) = estimate(&decided);
    assert!(
        others
            .iter()
            .all(|a| (a.spin.norm() / TAU - rps).abs() > 1.0),
        "{others:?}"
    );
}

#[test]
fn a_start_beside_the_maximum_finds_the_same_aliases() {
    // The spin of a whole flight is not quite the maximum of its first frames; across the axis of a
    // slow spin the difference is many degrees, and hundreds of rad/s for its alias.
    for i in 0..50 {
        let sequence = Scenario::default().sequence((3.0, 8.0), 67, i);
        let truth = Fit {
            motion: sequence.truth,
            spin_covariance: None,
            sigma_rad: None,
            log_likelihood: None,
            inliers: 10,
            lack_of_fit: None,
        };
        let others = alternatives(&sequence.measurements, &truth, &AliasConfig::default());
        let [other] = others.as_slice() else {
            panic!("sequence {i}: expected one alias, found {others:?}");
        };
        assert!(other.log_likelihood_ratio.abs() < 1e-3, "{other:?}");
    }
}

#[test]
fn absurd_durations_come_to_an_end() {
    // Ten thousand years between two bursts: aliases beyond counting, none of them worth a list.
    let sequence = Scenario::default().sequence((60.0, 60.0), 65, 0);
    let mut measurements = sequence.measurements;
    for m in &mut measurements[2..] {
        m.time_s += 3e11;
    }
    let fit = Fit {
        motion: sequence.truth,
        spin_covariance: None,
        sigma_rad: None,
        log_likelihood: None,
        inliers: 10,
        lack_of_fit: None,
    };
    assert_eq!(
        alternatives(&measurements, &fit, &AliasConfig::default()),
        []
    );
    // Minutes of a steady spin are judged by their beginning.
    let long = Scenario {
        frames: 20_000,
        ..Scenario::default()
    };
    let sequence = long.sequence((60.0, 60.0), 66, 0);
    let (fit, others) = estimate(&sequence.measurements);
    assert!((fit.motion.rps() - 60.0).abs() < 1e-2, "{fit:?}");
    assert_eq!(others.len(), 1, "{others:?}");
}
