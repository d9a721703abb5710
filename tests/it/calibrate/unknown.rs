//! A pattern from a clip alone.

use spindoe::calibrate::{CalibrationConfig, UnknownRejection, build_pattern};
use spindoe::geometry::{Vec3, angle_between};
use spindoe::{DotUncertainty, ObservedDot, Pattern, Recognizer, RobustRecognizer, ViewModel};

use super::clip::{ClipConfig, detections};

/// The largest angle of a built dot from its true one, radians; `None` where they are not the same dots.
fn worst(built: &Pattern, truth: &Pattern) -> Option<f64> {
    if built.len() != truth.len() {
        return None;
    }
    let view = ViewModel {
        visibility_limit: -0.99,
        ..ViewModel::default()
    };
    let recognizer = RobustRecognizer::new(truth, view.into()).unwrap();
    let observed: Vec<ObservedDot> = built
        .dots()
        .iter()
        .map(|d| ObservedDot {
            direction: *d,
            uncertainty: DotUncertainty::Isotropic { sigma_rad: 0.01 },
        })
        .collect();
    let found = recognizer.identify(&observed, &mut recognizer.workspace());
    let found = found.ok()?;
    let mut worst: f64 = 0.0;
    for (dot, name) in built.dots().iter().zip(&found.assignment) {
        let expected: Vec3 = found.rotation * truth.dots()[usize::from((*name)?)];
        worst = worst.max(angle_between(dot, &expected));
    }
    Some(worst)
}

#[test]
fn patterns_are_built_from_clips_alone() {
    for seed in 0..4 {
        let truth = crate::common::random_pattern(16 + 2 * seed as usize, 50 + seed);
        let clip = ClipConfig {
            frames: 160,
            seed,
            ..ClipConfig::default()
        };
        let clip = detections(truth.dots(), &clip);
        let found = build_pattern(&clip.frames, None, &CalibrationConfig::default()).unwrap();
        let built = found.unwrap_or_else(|rejection| panic!("seed {seed}: {rejection}"));
        assert!(built.blind < 0.03, "seed {seed}: {} blind", built.blind);
        let built = built.pattern;
        let worst = worst(&built, &truth).map(f64::to_degrees);
        assert!(
            worst.is_some_and(|w| w < 1.0),
            "seed {seed}: {worst:?} deg, {} dots",
            built.len()
        );
    }
}

#[test]
fn marks_that_look_unlike_the_dots_are_left_out() {
    let truth = crate::common::random_pattern(16, 70);
    let apart = |v: &Vec3| truth.dots().iter().all(|d| angle_between(d, v) > 0.3);
    let mark = spindoe::geometry::spiral_directions(500).find(apart);
    let mut seen = truth.dots().to_vec();
    seen.push(mark.unwrap());
    for (unlike, expected, dots) in [
        (vec![16], None, Some(16)),
        (vec![16], Some(16), Some(16)),
        (vec![], None, Some(17)),
        (vec![], Some(18), None),
    ] {
        let clip = ClipConfig {
            frames: 160,
            unlike,
            ..ClipConfig::default()
        };
        let clip = detections(&seen, &clip);
        let found = build_pattern(&clip.frames, expected, &CalibrationConfig::default()).unwrap();
        assert_eq!(
            found.as_ref().ok().map(|b| b.pattern.len()),
            dots,
            "{found:?}"
        );
    }
}

#[test]
fn what_is_missing_for_a_pattern_is_said() {
    let truth = crate::common::random_pattern(20, 60);
    let config = CalibrationConfig::default();
    let short = ClipConfig {
        frames: 6,
        ..ClipConfig::default()
    };
    let found = build_pattern(&detections(truth.dots(), &short).frames, None, &config).unwrap();
    assert!(
        matches!(found, Err(UnknownRejection::TooFewFrames { .. })),
        "{found:?}"
    );
    let still = ClipConfig {
        step: 0.002,
        precession: 0.0,
        ..ClipConfig::default()
    };
    let found = build_pattern(&detections(truth.dots(), &still).frames, None, &config).unwrap();
    assert!(
        matches!(found, Err(UnknownRejection::NotCovered { .. })),
        "{found:?}"
    );
    let clip = detections(truth.dots(), &ClipConfig::default());
    let found = build_pattern(&clip.frames, Some(19), &config).unwrap();
    assert!(
        matches!(found, Err(UnknownRejection::WrongNumber { found: 20, .. })),
        "{found:?}"
    );
}
