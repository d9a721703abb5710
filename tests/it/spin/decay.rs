//! Decaying spins: recovered with honest intervals, and what theory says of table tennis balls.

use std::f64::consts::TAU;

use rayon::prelude::*;
use spindoe::geometry::Vec3;
use spindoe::spin::SpinRejection;
use spindoe::spin::air::{Air, Ball, boundary_layer_decay, creeping_decay};
use spindoe::spin::decay::{DecayConfig, DecayFit, fit_decay};
use spindoe::spin::robust::RobustSpinConfig;
use spindoe::spin::simulate::{Drops, Scenario, Sequence, decayed_time, stream};
use spindoe::spin::windows::spin_over_time;

/// The paper's flight: 0.6 s at 350 frames per second.
fn flight(decay_per_s: f64) -> Scenario {
    Scenario {
        frames: 210,
        decay_per_s,
        ..Scenario::default()
    }
}

fn fit(sequence: &Sequence) -> DecayFit {
    fit_decay(&sequence.measurements, &DecayConfig::default()).unwrap()
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
    assert!((found.decay_per_s - 0.091).abs() < 1e-6, "{found:?}");
    assert!((found.start.motion.spin - spin).norm() < 1e-4, "{found:?}");
    let expected = spin.norm() * (-0.091f64 * 0.3).exp();
    assert!((found.rate_at(0.3) - expected).abs() < 1e-3);
}

#[test]
fn decays_are_recovered_and_their_intervals_cover() {
    for (decay, rps, seed) in [
        (0.0, (20.0, 150.0), 72),
        (0.091, (20.0, 150.0), 73),
        (0.5, (40.0, 100.0), 74),
    ] {
        let count = 100;
        let scores: Vec<(f64, f64)> = (0..count)
            .into_par_iter()
            .map(|i| {
                let sequence = flight(decay).sequence(rps, seed, i);
                let found = fit(&sequence);
                let error = found.start.motion.spin - sequence.truth.spin;
                let covariance = found.start.spin_covariance.unwrap();
                let solved = covariance.cholesky().unwrap().solve(&error);
                (
                    (found.decay_per_s - decay) / found.std_per_s,
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
        let z = (found.decay_per_s - 0.091) / found.std_per_s;
        assert!(z.abs() < 5.0, "sequence {i}: {found:?}");
        assert!(found.std_per_s < 0.01, "sequence {i}: {found:?}");
    }
}

#[test]
fn short_sequences_say_little_and_admit_it() {
    let sequence = Scenario::default().sequence((50.0, 50.0), 76, 0);
    let found = fit(&sequence);
    // Ten frames fix the rate to about 0.3 % and the decay over 26 ms to no better than 1 /s.
    assert!(found.std_per_s > 0.5, "{found:?}");
    let few = fit_decay(&sequence.measurements[..9], &DecayConfig::default());
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
    let runs = spin_over_time(&sequence.measurements, 10, &RobustSpinConfig::default()).unwrap();
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
    let (ball, air) = (Ball::default(), Air::default());
    // 12 pi 1.81e-5 0.02 / 0.0027, by hand: the paper's "about 0.005".
    let creeping = creeping_decay(&ball, &air);
    assert!((creeping - 0.005_054).abs() < 1e-6, "{creeping}");
    // At vanishing Reynolds numbers the torque coefficient 16 pi / Re would take over; at 50 rps the
    // boundary layer brakes twelve times as hard.
    let at = |rps: f64| boundary_layer_decay(&ball, &air, rps * TAU);
    assert!((at(50.0) - 0.0625).abs() < 1e-3, "{}", at(50.0));
    assert!((at(100.0) - 0.0871).abs() < 1e-3, "{}", at(100.0));
    // The paper's measurement, 0.091 +- 0.03 /s.
    assert!((0.061..0.121).contains(&at(50.0)) && (0.061..0.121).contains(&at(150.0)));
}
