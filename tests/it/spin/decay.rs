//! Decaying spins: recovered with honest intervals, and what theory says of table tennis balls.

use std::f64::consts::TAU;

use rayon::prelude::*;
use spindoe::geometry::Vec3;
use spindoe::spin::SpinRejection;
use spindoe::spin::air::{Air, FlyingBall, boundary_layer_decay, creeping_decay};
use spindoe::spin::decay::{DecayFit, DecayOutcome, fit_decay};
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::simulate::{Drops, Scenario, SimulatedSequence, decayed_time, stream};
use spindoe::spin::windows::spin_over_time;

/// The paper's flight: 0.6 s at 350 frames per second.
fn flight(decay_per_s: f64) -> Scenario {
    Scenario {
        frames: 210,
        decay_per_s,
        ..Scenario::default()
    }
}

fn outcome(sequence: &SimulatedSequence) -> DecayOutcome {
    fit_decay(&sequence.measurements, &SpinConfig::default()).unwrap()
}

fn fit(sequence: &SimulatedSequence) -> DecayFit {
    match outcome(sequence) {
        DecayOutcome::Found { fit, .. } => fit,
        other => panic!("expected a decay, found {other:?}"),
    }
}

#[test]
fn exact_orientations_give_the_exact_decay() {
    let exact = Scenario {
        sigma_rad: 0.0,
        outliers: 0.0,
        ..flight(0.091)
    };
    let spin = Vec3::new(100.0, 250.0, -50.0);
    let found = fit(&exact.simulate(spin, &mut stream(71, 0)));
    assert!((found.motion.decay_per_s - 0.091).abs() < 1e-6, "{found:?}");
    assert!((found.motion.start.spin - spin).norm() < 1e-4, "{found:?}");
    let expected = spin.norm() * (-0.091f64 * 0.3).exp();
    assert!((found.motion.rate_at(0.3) - expected).abs() < 1e-3);
}

#[test]
fn decays_are_recovered_and_their_intervals_cover() {
    for (decay, rps, seed) in [(0.091, (20.0, 150.0), 73), (0.5, (40.0, 100.0), 74)] {
        let count = 100;
        let scores: Vec<(f64, f64)> = (0..count)
            .into_par_iter()
            .map(|i| {
                let sequence = flight(decay).sequence(rps, seed, i);
                let found = fit(&sequence);
                let error = found.motion.start.spin - sequence.truth.spin;
                let covariance = found.start().spin_covariance.unwrap();
                let solved = covariance.cholesky().unwrap().solve(&error);
                (
                    (found.motion.decay_per_s - decay) / found.std_per_s(),
                    solved.dot(&error) / 3.0,
                )
            })
            .collect();
        let inside = scores.iter().filter(|s| s.0.abs() < 1.96).count();
        assert!(inside >= 88, "{decay}: {inside} of {count} intervals cover");
        let variance = scores.iter().map(|s| s.0 * s.0).sum::<f64>() / count as f64;
        assert!((variance - 1.0).abs() < 0.5, "{decay}: variance {variance}");
        let spin = scores.iter().map(|s| s.1).sum::<f64>() / count as f64;
        assert!(
            (spin - 1.0).abs() < 0.3,
            "{decay}: variance of the spin {spin}"
        );
    }
}

#[test]
fn a_third_of_strays_and_of_lost_frames_does_no_harm() {
    let scenario = Scenario {
        outliers: 0.3,
        drops: Drops::Probability(0.3),
        ..flight(0.091)
    };
    for i in 0..20 {
        let sequence = scenario.sequence((30.0, 120.0), 75, i);
        let found = fit(&sequence);
        let z = (found.motion.decay_per_s - 0.091) / found.std_per_s();
        assert!(z.abs() < 5.0, "sequence {i}: {found:?}");
        assert!(found.std_per_s() < 0.01, "sequence {i}: {found:?}");
    }
}

#[test]
fn constant_spins_stay_constant_and_their_intervals_cover() {
    // The share of false decays is that of odds of 20 to 1; where an interval is given, it holds 0.
    for (rps, seed) in [(0.0, 80), (0.05, 81), (1.0, 82), (20.0, 83), (150.0, 84)] {
        let count = 60;
        let answers: Vec<DecayOutcome> = (0..count)
            .into_par_iter()
            .map(|i| {
                let still = Scenario {
                    outliers: 0.0,
                    frames: 350,
                    ..flight(0.0)
                };
                outcome(&still.sequence((rps, rps), seed, i))
            })
            .collect();
        let decays = answers.iter().filter(|a| a.found().is_some()).count();
        assert!(decays <= 3, "{rps} rps: {decays} of {count} decay");
        let determined = || answers.iter().filter_map(DecayOutcome::determined);
        let intervals = || determined().map(DecayFit::interval_per_s);
        let inside = intervals().filter(|i| i.low <= 0.0 && 0.0 <= i.high);
        let (inside, given) = (inside.count(), intervals().count());
        // Of a ball that does not turn nobody knows a decay.
        assert!(rps != 0.0 || given == 0, "{given} intervals of no spin");
        assert!(rps < 1.0 || given == answers.len(), "{rps} rps: {given}");
        // 95 % less three standard errors.
        let least = 0.95 * given as f64 - 3.0 * (0.0475 * given as f64).sqrt();
        assert!(inside as f64 >= least, "{rps} rps: {inside} of {given}");
        for answer in &answers {
            let spin = answer.start().motion.rps();
            assert!((spin - rps).abs() < 0.1, "{rps} rps: {answer:?}");
        }
    }
}

#[test]
fn pure_outliers_show_no_spin_and_no_decay() {
    for (frames, count) in [(12, 100), (30, 60), (100, 15)] {
        let stray = Scenario {
            frames,
            outliers: 1.0,
            ..Scenario::default()
        };
        let answered = (0..count)
            .into_par_iter()
            .filter(|i| {
                let sequence = stray.sequence((10.0, 100.0), 85, *i);
                fit_decay(&sequence.measurements, &SpinConfig::default()).is_ok()
            })
            .count();
        assert!(answered <= 1, "{frames} frames: {answered} of {count}");
    }
}

#[test]
fn no_end_of_a_decaying_spin_is_faster_than_permitted() {
    // It grows past the limit, or starts beyond it.
    for (rps, decay) in [(90.0, -0.9), (120.0, 0.5)] {
        let exact = Scenario {
            sigma_rad: 0.01,
            outliers: 0.0,
            ..flight(decay)
        };
        let sequence = exact.simulate(Vec3::x() * (rps * TAU), &mut stream(86, 0));
        let limited = |max_rps| {
            let config = SpinConfig {
                max_rps,
                ..SpinConfig::default()
            };
            fit_decay(&sequence.measurements, &config)
        };
        assert!(matches!(limited(175.0), Ok(DecayOutcome::Found { .. })));
        let refused = limited(110.0);
        assert!(
            refused.as_ref().is_err_and(SpinRejection::is_no_spin),
            "{rps} rps: {refused:?}"
        );
    }
}

#[test]
fn settings_outside_their_domain_are_named() {
    let sequence = flight(0.1).sequence((50.0, 50.0), 87, 0);
    let named = |config: SpinConfig| match fit_decay(&sequence.measurements, &config) {
        Err(SpinRejection::Setting { setting, .. }) => setting,
        other => panic!("{other:?}"),
    };
    let good = SpinConfig::default();
    for max_decay_per_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let config = SpinConfig {
            max_decay_per_s,
            ..good
        };
        assert_eq!(named(config), "max_decay_per_s");
    }
    assert_eq!(named(SpinConfig { window: 2, ..good }), "window");
}

#[test]
fn short_sequences_say_little_and_admit_it() {
    let sequence = Scenario::default().sequence((50.0, 50.0), 76, 0);
    let found = outcome(&sequence);
    // Ten frames fix the rate to about 0.3 % and the decay over 26 ms to no better than 1 /s.
    assert!(found.found().is_none(), "{found:?}");
    if let Some(interval) = found.determined().map(DecayFit::interval_per_s) {
        assert!(interval.high - interval.low > 2.0, "{found:?}");
    }
    let few = fit_decay(&sequence.measurements[..9], &SpinConfig::default());
    assert_eq!(
        few.unwrap_err(),
        SpinRejection::TooFewFrames {
            found: 9,
            needed: 10
        }
    );
}

#[test]
fn windows_follow_the_spin() {
    let sequence = flight(0.3).sequence((80.0, 80.0), 77, 0);
    let runs = spin_over_time(&sequence.measurements, 10, &SpinConfig::default()).unwrap();
    assert!(runs.len() > 38, "{} runs", runs.len());
    for run in &runs {
        let truth = 80.0 * (-0.3 * run.time_s).exp();
        assert!((run.fit.motion.rps() - truth).abs() < 1.5, "{run:?}");
    }
    assert!(runs.last().unwrap().time_s > 0.58);
}

#[test]
fn time_runs_slower_for_a_decaying_spin() {
    // (1 - exp(-c t)) / c, and t for no decay at all.
    assert!((decayed_time(2.0, 0.5) - (1.0 - (-1.0f64).exp()) / 0.5).abs() < 1e-12);
    assert_eq!(decayed_time(2.0, 0.0), 2.0);
    assert!((decayed_time(2.0, 1e-9) - 2.0).abs() < 1e-8);
}

#[test]
fn theory_is_worked_out_right() {
    let (ball, air) = (FlyingBall::default(), Air::default());
    // 12 pi 1.81e-5 0.02 / 0.0027, by hand: the paper's "about 0.005".
    let creeping = creeping_decay(&ball, &air);
    assert!((creeping - 0.005_054).abs() < 1e-6, "{creeping}");
    // At vanishing Reynolds numbers the torque coefficient 16 pi / Re would take over; at 50 rps
    // the boundary layer brakes twelve times as hard.
    let at = |rps: f64| boundary_layer_decay(&ball, &air, rps * TAU);
    assert!((at(50.0) - 0.0625).abs() < 1e-3, "{}", at(50.0));
    assert!((at(100.0) - 0.0871).abs() < 1e-3, "{}", at(100.0));
    // The paper's measurement, 0.091 +- 0.03 /s.
    assert!((0.061..0.121).contains(&at(50.0)) && (0.061..0.121).contains(&at(150.0)));
}
