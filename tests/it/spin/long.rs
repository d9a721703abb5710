//! Long recordings: all rows count, and where no one spin holds, the stretches are named.

use std::f64::consts::TAU;

use spindoe::geometry::Vec3;
use spindoe::spin::decay::fit_decay;
use spindoe::spin::precession::fit_precession;
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::simulate::{Scenario, Sequence, stream};
use spindoe::spin::windows::constant_stretches;
use spindoe::spin::{Measurement, SpinRejection};

const FRAMES: usize = 20_000;

/// A minute at 300 frames per second.
fn recording(decay_per_s: f64, seed: u64) -> Sequence {
    let scenario = Scenario {
        frames: FRAMES,
        fps: 300.0,
        decay_per_s,
        ..Scenario::default()
    };
    scenario.simulate(
        Vec3::new(0.6, 0.64, 0.48) * (30.0 * TAU),
        &mut stream(401, seed),
    )
}

/// All but the seven in a hundred that are wrong.
fn is_whole(inliers: usize) -> bool {
    inliers as f64 > 0.92 * FRAMES as f64
}

#[test]
fn all_rows_of_a_constant_spin_count() {
    let sequence = recording(0.0, 0);
    let config = SpinConfig::default();
    let constant = RobustEstimator::new(config)
        .fit(&sequence.measurements)
        .unwrap();
    assert!(is_whole(constant.inliers), "{constant:?}");
    let error = constant.motion.spin - sequence.truth.spin;
    let solved = constant
        .spin_covariance
        .unwrap()
        .cholesky()
        .unwrap()
        .solve(&error);
    assert!(error.dot(&solved) < 20.0, "{constant:?}");
    let decay = fit_decay(&sequence.measurements, &config).unwrap();
    assert!(decay.found().is_none() && is_whole(decay.start().inliers));
    let interval = decay.determined().expect("a limit").interval_per_s();
    assert!(interval.high - interval.low < 1e-6, "{interval:?}");
    let precession = fit_precession(&sequence.measurements, &config).unwrap();
    assert!(precession.found().is_none());
}

#[test]
fn all_rows_of_a_decay_count() {
    let sequence = recording(0.01, 1);
    let found = fit_decay(&sequence.measurements, &SpinConfig::default()).unwrap();
    let fit = found.found().expect("a decay");
    assert!(is_whole(fit.inliers), "{fit:?}");
    let z = (fit.motion.decay_per_s - 0.01) / fit.std_per_s();
    assert!(z.abs() < 4.5, "{fit:?}");
}

#[test]
fn where_no_one_spin_holds_the_stretches_do() {
    // The spin jumps twice.
    let rates = [30.0, 45.0, 20.0];
    let mut measurements = Vec::new();
    for (k, rps) in rates.into_iter().enumerate() {
        let scenario = Scenario {
            frames: 5000,
            ..Scenario::default()
        };
        let part = scenario.simulate(Vec3::y() * (rps * TAU), &mut stream(402, k as u64));
        let later = 20.0 * k as f64;
        measurements.extend(part.measurements.into_iter().map(|m| Measurement {
            time_s: m.time_s + later,
            ..m
        }));
    }
    let config = SpinConfig::default();
    let refused = fit_decay(&measurements, &config);
    assert!(
        matches!(refused, Err(SpinRejection::NoConsensus { .. })),
        "{refused:?}"
    );
    let stretches = constant_stretches(&measurements, &config).unwrap();
    let held: usize = stretches.iter().map(|s| s.orientations.len()).sum();
    assert!(held as f64 > 0.95 * measurements.len() as f64, "{held}");
    assert!(stretches.len() < 60, "{}", stretches.len());
    for stretch in stretches.iter().filter(|s| s.orientations.len() > 100) {
        let rps = rates[stretch.orientations.start / 5000];
        let error = stretch.fit.motion.rps() - rps;
        assert!(error.abs() < 0.1, "{stretch:?}");
    }
}
