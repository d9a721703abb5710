//! The published frames: another's ball and camera.

use std::path::Path;

use spindoe::calibrate::{CalibrationConfig, calibrate, held_out};
use spindoe::clip::{self, BatchConfig, SequenceOutcome};
use spindoe::vision::{DetectorName, Estimator, EstimatorConfig, FrameEstimate};

/// The frames of a folder, estimated, with their times.
fn frames(dir: &Path) -> (Vec<FrameEstimate>, Vec<f64>) {
    let pattern = crate::common::published_pattern().unwrap();
    let detector = DetectorName::Cnn.build().unwrap();
    let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector).unwrap();
    let batch = clip::run(
        &estimator,
        &[dir.to_path_buf()],
        &BatchConfig::default(),
        &(),
    )
    .unwrap();
    assert!(matches!(batch.sequence, SequenceOutcome::Estimated { .. }));
    let times = batch.frames.iter().map(|f| f.time_s.unwrap()).collect();
    (
        batch.frames.iter().map(|f| f.estimate().clone()).collect(),
        times,
    )
}

/// Calibrates a folder's ball: the residuals of held-out frames must fall, and those to one smooth rotation
/// (a precession that slows down, in this clip).
fn residuals_fall(dir: &Path) {
    let pattern = crate::common::published_pattern().unwrap();
    let (frames, times) = frames(dir);
    let config = CalibrationConfig::default();
    let found = calibrate(&pattern, &frames, Some(&times), &config)
        .unwrap()
        .unwrap();
    let [before, after] = found.motion_residuals(&frames, &times).unwrap();
    println!("one smooth rotation: {before:?} {after:?}");
    assert!(after.precessing && after.median_deg < before.median_deg);
    let judged = held_out(&pattern, &frames, Some(&times), &config).unwrap();
    let [before, after] = judged.median_deg;
    println!(
        "held out: {before:.2} {after:.2} deg, {:?} dots",
        judged.mean_matched
    );
    assert!(after < before, "{before} {after}");
}

#[test]
fn the_published_ball_fits_its_own_pattern_better() {
    let Some(dir) = crate::common::published_frames() else {
        return;
    };
    residuals_fall(&dir);
}
