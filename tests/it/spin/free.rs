//! Balls that are pushed: their spin over time, its mean and its band; and nothing that only looks so.

use std::f64::consts::TAU;

use rand::RngExt;
use rand::seq::SliceRandom;
use rayon::prelude::*;
use spindoe::Vec3;
use spindoe::geometry::random_rotation;
use spindoe::spin::estimate::{FittedMotion, MotionModel, SpinEstimate};
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::simulate::{DrawnScenario, PushedScenario, PushedSequence, stream};
use spindoe::spin::{Fit, Measurement, SpinRejection};
use spindoe::stats::Proportion;

use super::lies::{NOISE_DEG, turning};
use crate::common::done;

/// SciPy's `chi2(3).ppf(0.95)`.
const WITHIN: f64 = 7.815;

fn config(sequence: &PushedSequence) -> SpinConfig {
    SpinConfig {
        sigma_rad: sequence.sigma_rad,
        shared: Some(sequence.shared),
        ..SpinConfig::default()
    }
}

fn auto(measurements: &[Measurement], config: &SpinConfig) -> Result<SpinEstimate, SpinRejection> {
    SpinEstimate::fit(measurements, MotionModel::Auto, config)
}

fn is_within(fit: &Fit, truth: &Vec3) -> bool {
    let off = fit.motion.spin - truth;
    let inverse = fit.spin_covariance.and_then(|c| c.try_inverse());
    off.dot(&(inverse.expect("a covariance") * off)) < WITHIN
}

#[test]
fn what_is_pushed_is_found_and_its_regions_hold() {
    let counted: Vec<[usize; 6]> = (0..60)
        .into_par_iter()
        .map(|k| {
            let sequence = PushedScenario {
                frames: 80,
                exact_dots: k % 2 == 0,
            }
            .sequence(7_600, k);
            let found = auto(&sequence.measurements, &config(&sequence)).expect("a spin");
            let FittedMotion::Free(free) = &found.motion else {
                return [0; 6];
            };
            let mean = is_within(&found.overall(), &sequence.mean_spin(found.span_s()));
            let mut band = [0; 2];
            for knot in &free.knots {
                let truth = sequence.spin(knot.time_s);
                band[0] += usize::from(is_within(&found.at(knot.time_s), &truth));
                band[1] += 1;
            }
            // The parts of a clip agree with the whole, within the deviations of both.
            let mut parts = [0; 2];
            for part in sequence.measurements.chunks(20).filter(|p| p.len() >= 15) {
                let Ok(own) = auto(part, &config(&sequence)) else {
                    continue;
                };
                let (own, at) = (own.overall(), found.at(own.middle_s()));
                let both = own.spin_covariance.unwrap() + at.spin_covariance.unwrap();
                let own = Fit {
                    spin_covariance: Some(both),
                    ..own
                };
                parts[0] += usize::from(is_within(&own, &at.motion.spin));
                parts[1] += 1;
            }
            [1, usize::from(mean), band[0], band[1], parts[0], parts[1]]
        })
        .collect();
    let [free, mean, inside, all, agree, parts] =
        [0, 1, 2, 3, 4, 5].map(|i| counted.iter().map(|c| c[i]).sum::<usize>());
    println!("{free} of 60 free, mean {mean}, band {inside} of {all}, parts {agree} of {parts}");
    assert!(free >= 54, "{free} of 60 are free");
    // Three standard errors below 95 %.
    assert!(mean as f64 >= 0.86 * free as f64, "{mean} of {free}");
    assert!(inside as f64 >= 0.9 * all as f64, "{inside} of {all}");
    assert!(agree as f64 >= 0.9 * parts as f64, "{agree} of {parts}");
}

#[test]
fn steady_balls_are_not_pushed() {
    let frames = [10, 50, 155];
    let models: Vec<Option<MotionModel>> = (0..150)
        .into_par_iter()
        .map(|k| {
            let scenario = DrawnScenario {
                frames: frames[k % 3],
                exact_dots: k % 2 == 0,
                ..DrawnScenario::default()
            };
            let sequence = scenario.sequence(7_601, k as u64);
            let config = SpinConfig {
                sigma_rad: sequence.sigma_rad,
                shared: Some(sequence.shared),
                ..SpinConfig::default()
            };
            Some(auto(&sequence.measurements, &config).ok()?.motion.model())
        })
        .collect();
    let free = models.iter().flatten().filter(|m| **m == MotionModel::Free);
    assert_eq!(free.count(), 0);
}

#[test]
fn constant_flights_that_cross_the_picture_stay_constant() {
    let answers: Vec<(MotionModel, bool)> = (0..150)
        .into_par_iter()
        .filter_map(|k| {
            let scenario = DrawnScenario {
                frames: [8, 22, 60][k as usize % 3],
                ..DrawnScenario::default()
            };
            let sequence = scenario.sequence(7_602, k).crossing(7_603, k);
            let config = SpinConfig {
                sigma_rad: sequence.sigma_rad,
                shared: Some(sequence.shared),
                ..SpinConfig::default()
            };
            let found = auto(&sequence.measurements, &config).ok()?;
            let is_held = is_within(&found.overall(), &sequence.truth.space.spin);
            Some((found.motion.model(), is_held))
        })
        .collect();
    let count = answers.len() as u64;
    let others = answers
        .iter()
        .filter(|a| a.0 != MotionModel::Constant)
        .count() as u64;
    let rate = Proportion::new(others, count);
    let held = Proportion::new(answers.iter().filter(|a| a.1).count() as u64, count);
    println!("others {rate:?}, held {held:?}");
    assert!(count >= 148 && rate.low <= 0.01, "{rate:?}");
    assert!(held.high >= 0.95, "{held:?}");
}

/// A slow clip, of which frames are lost, out of order or turned back.
fn lied(kind: usize, index: u64) -> Vec<Measurement> {
    let mut rng = stream(7_604, 10 * index + kind as u64);
    let (frames, fps) = (150, 30.0);
    let mut places: Vec<usize> = (0..frames).collect();
    let third = frames / 3;
    match kind {
        // One frame lost, and the others numbered on.
        0 => places
            .iter_mut()
            .skip(rng.random_range(10..140))
            .for_each(|p| *p += 1),
        // Two blocks swapped.
        1 => places.rotate_left(third),
        // The last half the other way round.
        2 => places[frames / 2..].reverse(),
        3 => places.shuffle(&mut rng),
        // Every third lost.
        _ => places.iter_mut().for_each(|p| *p += *p / 2),
    }
    let times: Vec<f64> = places.iter().map(|p| *p as f64 / fps).collect();
    let rps = 0.3 * 30f64.powf(rng.random());
    let mut clip = turning(&mut rng, rps, NOISE_DEG, &times).measurements;
    for (k, m) in clip.iter_mut().enumerate() {
        m.time_s = k as f64 / fps;
    }
    clip
}

#[test]
fn what_is_wrong_with_the_frames_is_no_push() {
    let free: Vec<(usize, u64)> = (0..5)
        .flat_map(|kind| (0..8).map(move |k| (kind, k)))
        .collect::<Vec<_>>()
        .into_par_iter()
        .filter(|&(kind, k)| {
            let found = auto(&lied(kind, k), &SpinConfig::default());
            found.is_ok_and(|found| found.motion.model() == MotionModel::Free)
        })
        .collect();
    assert!(free.is_empty(), "{free:?}");
}

#[test]
fn a_ball_at_rest_has_no_spin_and_no_axis() {
    let mut rng = stream(7_605, 0);
    let still = random_rotation(&mut rng);
    for noise_deg in [0.0, 1e-6, 0.4] {
        let clip = turning(&mut rng, 1e-12, noise_deg, &[0.0; 60]).measurements;
        let clip: Vec<Measurement> = clip
            .iter()
            .enumerate()
            .map(|(k, m)| Measurement {
                time_s: k as f64 / 30.0,
                orientation: match noise_deg == 0.0 {
                    true => still,
                    false => m.orientation,
                },
                ..*m
            })
            .collect();
        let fit = auto(&clip, &SpinConfig::default())
            .expect("a spin")
            .overall();
        let std = fit.spin_covariance.unwrap().diagonal().map(f64::sqrt) / TAU;
        assert!(fit.motion.rps() < 0.004 && std.max() < 0.004, "{fit:?}");
        assert!(fit.is_at_rest() && fit.motion.spin.iter().all(|x| x.is_finite()));
    }
}

#[test]
fn the_command_says_that_it_is_pushed() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = PushedScenario {
        frames: 120,
        exact_dots: true,
    };
    let sequence = scenario.sequence(7_606, 1);
    let mut text = String::from("frame,time_s,qw,qx,qy,qz\n");
    for (k, m) in sequence.measurements.iter().enumerate() {
        let q = m.orientation;
        text += &format!("{k},{},{},{},{},{}\n", m.time_s, q.w, q.i, q.j, q.k);
    }
    std::fs::write(dir.path().join("o.csv"), text).unwrap();
    let words = done(
        dir.path(),
        &["spin", "o.csv", "--windows", "w.csv", "--picture", "w.png"],
    );
    assert!(
        words.contains("motion    free (odds") && words.contains("the mean over the time"),
        "{words}"
    );
    assert!(words.contains("pushed: the spin is"), "{words}");
    let curve = std::fs::read_to_string(dir.path().join("w.csv")).unwrap();
    assert_eq!(curve.lines().count(), 1 + sequence.measurements.len());
    let json = done(
        dir.path(),
        &["spin", "o.csv", "--json", "--frame", "optical"],
    );
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(
        (&json["motion"], &json["is_mean"]),
        (&"free".into(), &true.into())
    );
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let mean = sequence.mean_spin([
        sequence.measurements[0].time_s,
        sequence.measurements.last().unwrap().time_s,
    ]);
    let optical = Vec3::new(mean.x, -mean.y, -mean.z);
    let spin = Vec3::from_fn(|i, _| number(&json["spin_rad_s"][i]));
    assert!(
        (spin - optical).norm() < 0.1 * mean.norm(),
        "{spin} {optical}"
    );
    let over_time = json["free"]["over_time"].as_array().unwrap();
    let first = &over_time[over_time.len() / 2];
    let truth = sequence.spin(number(&first["time_s"]));
    let truth = Vec3::new(truth.x, -truth.y, -truth.z);
    let own = Vec3::from_fn(|i, _| number(&first["spin_rad_s"][i]));
    assert!((own - truth).norm() < 0.3 * truth.norm(), "{own} {truth}");
    // A time of its own, and a motion that is asked for.
    let json = done(
        dir.path(),
        &["spin", "o.csv", "--json", "--at", "0.5", "--motion", "free"],
    );
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(
        (&json["motion"], &json["is_mean"]),
        (&"free".into(), &false.into())
    );
    assert!((number(&json["time_s"]) - 0.5).abs() < 1e-12);
}
