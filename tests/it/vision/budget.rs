//! Deadlines: what has no time left is not begun, and the frame says so.

use std::sync::Arc;
use std::time::Duration;

use spindoe::clip::{Tracker, TrackerConfig};
use spindoe::image::RgbImage;
use spindoe::pattern::Pattern;
use spindoe::synth::dataset::independent_frame;
use spindoe::synth::{SynthConfig, SynthKind};
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, FrameRejection, Prior,
};

fn estimator(pattern: &Pattern) -> Estimator {
    let detector = DetectorName::Cnn.build().expect("weights");
    Estimator::new(pattern, EstimatorConfig::default(), detector).expect("valid settings")
}

/// Crops and whole frames without the ball, which take the most work, then crops of the ball.
fn images(pattern: &Pattern) -> Vec<RgbImage> {
    let whole = SynthConfig {
        image_px: Some([500, 400]),
        ..SynthConfig::default()
    };
    let other = |config: &SynthConfig| SynthConfig {
        kind: SynthKind::OtherPattern,
        ..config.clone()
    };
    let kinds = [
        (other(&SynthConfig::good()), 6),
        (other(&whole), 3),
        (SynthConfig::good(), 6),
    ];
    let mut images = Vec::new();
    for (config, count) in kinds {
        let frames = (0..count).map(|k| independent_frame(pattern, &config, 81, k));
        images.extend(frames.map(|frame| frame.expect("a frame").image));
    }
    images
}

/// Checks a frame whose deadline had passed before it came.
fn check(frame: &FrameEstimate) {
    assert_eq!(frame.attempts(), 0);
    assert_eq!(frame.outcome, Err(FrameRejection::OutOfTime));
    assert!(frame.outline.is_none() && frame.dots.is_empty());
}

#[test]
fn a_deadline_that_has_passed_begins_nothing_further() {
    let pattern = crate::common::random_pattern(20, 5);
    let estimator = estimator(&pattern);
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    let prior = Prior::default();
    let mut runs = 0;
    for image in &images(&pattern) {
        estimator.estimate(image, &prior, &Budget::default(), &mut ws, &mut out);
        assert_ne!(out.outcome, Err(FrameRejection::OutOfTime));
        runs += out.attempts();
        let budget = Budget::within(Duration::ZERO);
        estimator.estimate(image, &prior, &budget, &mut ws, &mut out);
        check(&out);
        // Time enough changes nothing.
        let budget = Budget::within(Duration::from_secs(3600));
        estimator.estimate(image, &prior, &budget, &mut ws, &mut out);
        assert_ne!(out.outcome, Err(FrameRejection::OutOfTime));
    }
    assert!(runs > 60, "{runs} runs with time");
}

#[test]
fn a_tracker_without_time_says_so_and_begins_nothing_further() {
    let pattern = crate::common::random_pattern(20, 5);
    let config = TrackerConfig {
        max_latency: Some(Duration::ZERO),
        ..TrackerConfig::default()
    };
    let mut tracker = Tracker::new(Arc::new(estimator(&pattern)), config).expect("settings");
    for (k, image) in images(&pattern).iter().enumerate() {
        let state = tracker
            .update(image, 0.01 * k as f64, None)
            .expect("a time");
        check(state.frame);
    }
}
