//! Long recordings: all rows count, and where no one spin holds, the stretches are named.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use spindoe::geometry::Vec3;
use spindoe::spin::decay::fit_decay;
use spindoe::spin::precession::fit_precession;
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::simulate::{Scenario, SimulatedSequence, stream};
use spindoe::spin::windows::constant_stretches;
use spindoe::spin::{Measurement, SpinRejection};

const FRAMES: usize = 20_000;

/// A minute at 300 frames per second.
fn recording(decay_per_s: f64, seed: u64) -> SimulatedSequence {
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
        refused.as_ref().is_err_and(SpinRejection::is_no_spin),
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

/// A file of the measurements, as `spindoe estimate` writes it.
fn file(dir: &Path, measurements: &[Measurement]) -> PathBuf {
    let mut text = String::from("frame,time_s,qw,qx,qy,qz\n");
    for (k, m) in measurements.iter().enumerate() {
        let [w, x, y, z] = spindoe::geometry::to_wxyz(&m.orientation);
        text += &format!("{k},{},{w},{x},{y},{z}\n", m.time_s);
    }
    let path = dir.join("orientations.csv");
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn the_command_says_that_a_decaying_spin_holds_and_writes_the_stretches() {
    let dir = tempfile::tempdir().unwrap();
    // From 30 to 1 rps.
    let sequence = recording(0.05, 2);
    file(dir.path(), &sequence.measurements);
    let run = |flags: &[&str]| {
        let arguments = [&["spin", "orientations.csv"], flags].concat();
        let output = crate::common::spindoe(dir.path(), &arguments);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), words)
    };
    let (code, words) = run(&["--motion=constant", "--stretches", "s.csv"]);
    assert_eq!(code, Some(3), "{words}");
    assert!(
        words.contains("no constant spin holds") || words.contains("no spin"),
        "{words}"
    );
    assert!(
        words.contains("a decaying spin holds (--motion decaying)"),
        "{words}"
    );
    assert_eq!(words.trim().lines().count(), 1, "{words}");
    // The stretches follow the decay.
    let text = std::fs::read_to_string(dir.path().join("s.csv")).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    assert_eq!(
        header,
        "from_s,to_s,orientations,inliers,rps,wx,wy,wz,sigma_deg,camera_frame"
    );
    let (mut held, mut last) = (0, f64::NEG_INFINITY);
    for row in rows.lines() {
        let row = row.strip_suffix(",camera").expect("the frame");
        let values: Vec<f64> = row.split(',').map(|v| v.parse().unwrap()).collect();
        let [from, to, orientations, _, rps, x, y, z, _] = values[..] else {
            panic!("{row}");
        };
        assert!(from > last && to > from);
        last = to;
        held += orientations as usize;
        assert!((rps * TAU - x.hypot(y).hypot(z)).abs() < 1e-9 * rps * TAU);
        let fastest = 30.0 * (-0.05 * from).exp();
        let slowest = 30.0 * (-0.05 * to).exp();
        assert!(
            rps < 1.02 * fastest + 0.05 && rps > 0.98 * slowest - 0.05,
            "{row}"
        );
    }
    assert!(held as f64 > 0.9 * FRAMES as f64, "{held}");
    // The model that holds, by evidence and as asked for.
    for flags in [&[][..], &["--motion=decaying"]] {
        let (code, words) = run(flags);
        assert_eq!(code, Some(0), "{words}");
    }
}
