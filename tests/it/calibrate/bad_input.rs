//! Clips that cannot be calibrated are rejected with the reason.

use spindoe::calibrate::{CalibrationConfig, CalibrationRejection, calibrate};
use spindoe::geometry::{Vec3, angle_between, kabsch};
use spindoe::vision::FrameEstimate;

use crate::common::few_or_all;

use super::clip::{ClipConfig, drawn, identified};

#[test]
fn a_clip_without_a_ball_or_with_three_frames_is_rejected() {
    let pattern = crate::common::random_pattern(20, 21);
    let config = CalibrationConfig::default();
    let empty = vec![FrameEstimate::default(); 30];
    let found = calibrate(&pattern, &empty, None, &config).unwrap();
    assert_eq!(
        found.unwrap_err(),
        CalibrationRejection::NoBall { frames: 30 }
    );
    let clip = ClipConfig {
        frames: 3,
        ..ClipConfig::default()
    };
    let clip = identified(&pattern, pattern.dots(), &clip);
    let found = calibrate(&pattern, &clip.frames, None, &config).unwrap();
    let expected = CalibrationRejection::TooFewFrames {
        found: 3,
        needed: 5,
    };
    assert_eq!(found.unwrap_err(), expected);
}

#[test]
fn another_ball_is_rejected() {
    let config = CalibrationConfig::default();
    for seed in 30..30 + few_or_all(2, 10) as u64 {
        let nominal = crate::common::random_pattern(20, seed);
        let other = crate::common::random_pattern(20, seed + 100);
        let clip = ClipConfig {
            frames: few_or_all(60, 120),
            seed,
            ..ClipConfig::default()
        };
        let clip = identified(&nominal, &drawn(&other, 0.02, seed), &clip);
        let found = calibrate(&nominal, &clip.frames, Some(&clip.times_s), &config).unwrap();
        let rejection = found.map(|c| c.measured()).unwrap_err();
        assert!(
            matches!(
                rejection,
                CalibrationRejection::OtherBall { .. } | CalibrationRejection::Contradiction { .. }
            ),
            "seed {seed}: {rejection}"
        );
    }
}

#[test]
fn a_clip_of_two_balls_is_rejected_or_gives_the_dots_of_the_right_one() {
    let config = CalibrationConfig::default();
    for seed in 50..50 + few_or_all(1, 4) as u64 {
        let nominal = crate::common::random_pattern(20, seed);
        let other = crate::common::random_pattern(20, seed + 100);
        let dots = drawn(&nominal, 0.02, seed);
        let clip = ClipConfig {
            seed,
            ..ClipConfig::default()
        };
        let mut mixed = identified(&nominal, &dots, &clip);
        let strange = identified(&nominal, &drawn(&other, 0.02, seed), &clip);
        // One frame of two shows the other ball, then two of three besides.
        for step in [2, 3] {
            for (k, frame) in strange.frames.iter().enumerate() {
                if k % step != 0 {
                    mixed.frames[k] = frame.clone();
                }
            }
            let found = calibrate(&nominal, &mixed.frames, None, &config).unwrap();
            let Ok(found) = found else { continue };
            let to: Vec<Vec3> = found.dots.iter().map(|d| d.direction).collect();
            let turn = kabsch(&dots, &to, None).unwrap();
            for ((drawn, dot), j) in dots.iter().zip(&found.dots).zip(0..) {
                let off = angle_between(&(turn * drawn), &dot.direction);
                let limit = 5.0 * dot.sigma_rad();
                assert!(off < limit, "seed {seed}, dot {j}: {off} > {limit}");
            }
        }
    }
}

#[test]
fn settings_outside_their_domains_are_named() {
    let pattern = crate::common::random_pattern(20, 22);
    let config = CalibrationConfig {
        placement_sigma_rad: f64::NAN,
        ..CalibrationConfig::default()
    };
    let error = calibrate(&pattern, &[], None, &config).unwrap_err();
    assert!(error.to_string().contains("placement_sigma_rad"), "{error}");
    let error = calibrate(&pattern, &[], Some(&[1.0]), &CalibrationConfig::default());
    assert!(error.unwrap_err().to_string().contains("times_s"));
}
