//! Precessing spins: tops from an integrator of Euler's equations, and balls that do not precess.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use spindoe::geometry::{Rotation, Vec3, random_direction, random_rotation, tangent_frame};
use spindoe::spin::precession::{PrecessionFit, PrecessionOutcome, fit_precession};
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::simulate::{Drops, Scenario, stream};
use spindoe::spin::{Measurement, SpinRejection};

/// A symmetric top without torque, or with that of the air.
struct Top {
    /// Its axis, pattern frame, and the ratio of the moments about it and across it, less 1.
    axis: Vec3,
    unevenness: f64,
    /// Angular velocity at time 0, pattern frame, rad/s.
    spin: Vec3,
    orientation: Rotation,
    /// The torque is `-decay I w`, 1/s.
    decay: f64,
}

impl Top {
    fn random(unevenness: f64, tilt_rad: f64, rps: f64, rng: &mut impl Rng) -> Self {
        let axis = random_direction(rng);
        let spin = axis * tilt_rad.cos() + tangent_frame(&axis)[0] * tilt_rad.sin();
        Self {
            axis,
            unevenness,
            spin: spin * (rps * TAU),
            orientation: random_rotation(rng),
            decay: 0.0,
        }
    }

    /// The rotation fixed in the ball of the closed form, rad/s.
    fn body_rate(&self) -> Vec3 {
        -self.axis * (self.unevenness * self.axis.dot(&self.spin))
    }

    /// Its angular momentum over the moment across its axis, camera frame: fixed in space.
    fn momentum(&self) -> Vec3 {
        self.orientation * (self.inertia() * self.spin)
    }

    fn inertia(&self) -> Matrix3<f64> {
        Matrix3::identity() + self.axis * self.axis.transpose() * self.unevenness
    }

    /// Orientations at these times by Euler's equations, `I w' = (I w) x w - c I w` in the ball and `Q' = Q
    /// (0, w) / 2`, with the classical Runge-Kutta steps of 20 us.
    fn orientations(&self, times_s: &[f64]) -> Vec<Rotation> {
        let inertia = self.inertia();
        let inverse = inertia.try_inverse().unwrap();
        let rate = |(q, w): &(Quaternion<f64>, Vec3)| {
            (
                q * Quaternion::from_imag(*w) * 0.5,
                inverse * (inertia * w).cross(w) - w * self.decay,
            )
        };
        let after = |(q, w): &(Quaternion<f64>, Vec3), r: &(Quaternion<f64>, Vec3), h: f64| {
            (q + r.0 * h, w + r.1 * h)
        };
        let mut state = (self.orientation.into_inner(), self.spin);
        let mut now = 0.0;
        let mut orientations = Vec::new();
        for &time in times_s {
            let steps = ((time - now) / 2e-5).ceil().max(1.0);
            let h = (time - now) / steps;
            for _ in 0..steps as usize {
                let k1 = rate(&state);
                let k2 = rate(&after(&state, &k1, 0.5 * h));
                let k3 = rate(&after(&state, &k2, 0.5 * h));
                let k4 = rate(&after(&state, &k3, h));
                let q = (k1.0 + (k2.0 + k3.0) * 2.0 + k4.0) / 6.0;
                let w = (k1.1 + (k2.1 + k3.1) * 2.0 + k4.1) / 6.0;
                state = after(&state, &(q, w), h);
            }
            now = time;
            orientations.push(UnitQuaternion::new_normalize(state.0));
        }
        orientations
    }

    /// Measured orientations: noise per axis, and some that are wrong.
    fn measured(
        &self,
        times_s: &[f64],
        sigma_rad: f64,
        outliers: f64,
        rng: &mut impl Rng,
    ) -> Vec<Measurement> {
        let truth = self.orientations(times_s);
        let measure = |(time_s, q): (&f64, &Rotation)| {
            let noise = Vec3::from_fn(|_, _| StandardNormal.sample(rng));
            let stray = random_rotation(rng);
            let orientation = if rng.random::<f64>() < outliers {
                stray
            } else {
                Rotation::from_scaled_axis(noise * sigma_rad) * q
            };
            Measurement::new(*time_s, orientation)
        };
        times_s.iter().zip(&truth).map(measure).collect()
    }
}

fn times(frames: usize, fps: f64) -> Vec<f64> {
    (0..frames).map(|k| k as f64 / fps).collect()
}

fn outcome(measurements: &[Measurement]) -> PrecessionOutcome {
    fit_precession(measurements, &SpinConfig::default()).unwrap()
}

fn precessing(measurements: &[Measurement]) -> Option<PrecessionFit> {
    outcome(measurements).found().copied()
}

#[test]
fn a_top_without_noise_is_found_as_it_is() {
    for (seed, unevenness, tilt) in [(0, 0.03, 0.3), (1, -0.04, 0.15), (2, 0.02, 0.8)] {
        let rng = &mut stream(301, seed);
        let top = Top::random(unevenness, tilt, 120.0, rng);
        let times = times(60, 350.0);
        let measured = top.measured(&times, 0.0, 0.0, rng);
        let found = precessing(&measured).expect("a precession");
        let off = (found.motion.body_rate - top.body_rate()).norm();
        assert!(off < 2e-3 * top.body_rate().norm(), "{off}: {found:?}");
        let momentum = top.momentum();
        let aside = found.mean().motion.spin.angle(&momentum);
        assert!(aside < 1e-4, "{aside} rad off the angular momentum");
        for (time, q) in times.iter().zip(top.orientations(&times)) {
            assert!(found.motion.at(*time).angle_to(&q) < 1e-3);
        }
        // Halves of the sequence lie on the circle that the closed form says.
        assert!(
            (found.motion.tilt_rad() - tilt.min(TAU / 2.0 - tilt)).abs() < 0.05 * tilt,
            "{found:?}"
        );
    }
}

#[test]
fn a_top_that_slows_down_is_told_from_one_that_precesses() {
    let rng = &mut stream(307, 0);
    let mut top = Top::random(0.03, 0.2, 130.0, rng);
    top.decay = 0.3;
    let times = times(40, 350.0);
    let measured = top.measured(&times, 0.0, 0.0, rng);
    let found = precessing(&measured).expect("a precession");
    assert!((found.motion.decay_per_s - 0.3).abs() < 1e-2, "{found:?}");
    for (time, q) in times.iter().zip(top.orientations(&times)) {
        assert!(found.motion.at(*time).angle_to(&q) < 2e-3);
    }
    // The same ball, even: its decay is no precession.
    top.unevenness = 0.0;
    let measured = top.measured(&times, 0.02, 0.0, rng);
    assert_eq!(precessing(&measured), None);
}

#[test]
fn tops_are_found_and_their_intervals_cover() {
    let count = 200;
    let scores: Vec<Option<(f64, bool, bool)>> = (0..count)
        .into_par_iter()
        .map(|i| {
            let rng = &mut stream(302, i);
            // The prior's own spread, apart from balls too even to show it.
            let normal: f64 = StandardNormal.sample(rng);
            let unevenness = 0.05 * normal.signum() * normal.abs().max(0.4);
            let tilt = rng.random_range(0.2..1.2);
            let top = Top::random(unevenness, tilt, rng.random_range(60.0..150.0), rng);
            let measured = top.measured(&times(60, 350.0), 0.02, 0.05, rng);
            let found = precessing(&measured)?;
            let off = found.motion.body_rate - top.body_rate();
            let solved = found.body_rate_covariance().cholesky().unwrap().solve(&off);
            let across = {
                let u = (top.orientation.inverse() * top.momentum()).normalize();
                let q = top.body_rate();
                (q - u * u.dot(&q)).norm()
            };
            let drift = found.drift_interval_rad_s();
            let rate = found.rate_interval_rad_s();
            let inside = |low: f64, high: f64, x: f64| low <= x && x <= high;
            Some((
                solved.dot(&off),
                inside(drift.low, drift.high, across),
                rate.is_none_or(|r| inside(r.low, r.high, top.body_rate().norm())),
            ))
        })
        .collect();
    let found: Vec<_> = scores.iter().flatten().collect();
    println!("{} of {count} found", found.len());
    assert!(found.len() as f64 >= 0.95 * count as f64, "{}", found.len());
    let n = found.len() as f64;
    // 95 % less four standard errors.
    let min = n * (0.95 - 4.0 * (0.0475 / n).sqrt());
    let drift = found.iter().filter(|s| s.1).count() as f64;
    let rate = found.iter().filter(|s| s.2).count() as f64;
    let square = found.iter().map(|s| s.0).sum::<f64>() / (3.0 * n);
    println!("drift covered {drift}, rate covered {rate} of {n}; normalized square {square:.3}");
    assert!(drift >= min && rate >= min, "{drift} and {rate} of {n}");
    assert!((square - 1.0).abs() < 0.35, "{square}");
}

#[test]
fn even_balls_do_not_precess() {
    let count = 1000;
    let wrong = (0..count)
        .into_par_iter()
        .filter(|&i| {
            let scenario = Scenario {
                frames: 12 + (i as usize % 4) * 16,
                drops: Drops::Probability(0.1),
                decay_per_s: [0.0, 0.09][i as usize % 2],
                ..Scenario::default()
            };
            let sequence = scenario.sequence((0.5, 150.0), 303, i);
            let found = fit_precession(&sequence.measurements, &SpinConfig::default());
            matches!(found, Ok(PrecessionOutcome::Found { .. }))
        })
        .count();
    println!("{wrong} of {count} even balls called uneven");
    // At even odds odds of 20 to 1 are wrong once in twenty; Laplace's are far rarer.
    assert!(wrong <= 10, "{wrong} of {count}");
}

#[test]
fn what_the_orientations_cannot_bear_is_left_open() {
    let limit = |measurements: &[Measurement]| match outcome(measurements) {
        PrecessionOutcome::Constant { rival, .. } => rival.map(|r| r.max_drift_rad_s()),
        other => panic!("expected none, found {other:?}"),
    };
    // Twelve frames of a slow ball turn it by a few degrees.
    let scenario = Scenario {
        frames: 12,
        outliers: 0.0,
        ..Scenario::default()
    };
    let slow = scenario.sequence((1.0, 1.0), 304, 0);
    assert_eq!(limit(&slow.measurements), None);
    // A fast ball for a third of a second: a limit.
    let long = Scenario {
        frames: 120,
        ..scenario
    };
    let fast = long.sequence((100.0, 100.0), 305, 0);
    let limit = limit(&fast.measurements).expect("a limit");
    assert!(limit > 0.0 && limit < 1.0, "{limit} rad/s");
    // Too few, and no sequence at all.
    let few = fit_precession(&fast.measurements[..5], &SpinConfig::default());
    assert!(
        matches!(few, Err(SpinRejection::TooFewFrames { needed: 6, .. })),
        "{few:?}"
    );
    let config = SpinConfig {
        unevenness: 0.0,
        ..SpinConfig::default()
    };
    let setting = fit_precession(&fast.measurements, &config);
    let named = SpinRejection::Setting {
        setting: "unevenness",
        expected: "more than 0 and at most 0.5",
        value: 0.0,
    };
    assert_eq!(setting, Err(named));
}

#[test]
fn random_orientations_have_no_precession() {
    let stray = Scenario {
        frames: 30,
        outliers: 1.0,
        ..Scenario::default()
    };
    let answered = (0..60)
        .into_par_iter()
        .filter(|i| {
            let sequence = stray.sequence((10.0, 100.0), 306, *i);
            fit_precession(&sequence.measurements, &SpinConfig::default()).is_ok()
        })
        .count();
    assert_eq!(answered, 0);
}
