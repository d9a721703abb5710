//! The joint estimate: dots, covariances, missing dots, marks, poses.

use spindoe::Pattern;
use spindoe::calibrate::{
    CalibratedDot, Calibration, CalibrationConfig, DotState, MIN_EXPECTED_VIEWS, calibrate,
    held_out, identify_frames,
};
use spindoe::geometry::{Vec3, angle_between, kabsch};
use spindoe::vision::FrameEstimate;

use super::clip::{ClipConfig, drawn, identified};

fn calibrated(
    pattern: &Pattern,
    dots: &[Vec3],
    clip: &ClipConfig,
    config: &CalibrationConfig,
) -> Calibration {
    let clip = identified(pattern, dots, clip);
    calibrate(pattern, &clip.frames, Some(&clip.times_s), config)
        .unwrap()
        .unwrap()
}

/// Errors of the measured dots over their predicted standard deviations, squared, and the errors,
/// radians. `drawn` are the dots of the ball with their nominal numbers.
fn errors(found: &Calibration, drawn: &[(usize, Vec3)]) -> (Vec<f64>, Vec<f64>) {
    let measured: Vec<_> = drawn
        .iter()
        .filter(|(j, _)| found.dots[*j].state == DotState::Measured)
        .collect();
    let from: Vec<Vec3> = measured.iter().map(|d| d.1).collect();
    let to: Vec<Vec3> = measured.iter().map(|d| found.dots[d.0].direction).collect();
    let turn = kabsch(&from, &to, None).unwrap();
    let mut squares = Vec::new();
    let mut angles = Vec::new();
    for ((j, _), (a, b)) in measured.iter().zip(from.iter().zip(&to)) {
        let angle = angle_between(&(turn * a), b);
        squares.push(angle * angle / found.dots[*j].covariance.trace());
        angles.push(angle);
    }
    (squares, angles)
}

/// Settings for detections whose errors are all independent.
fn exact() -> CalibrationConfig {
    CalibrationConfig {
        shared_sigma_rad: 0.0,
        ..CalibrationConfig::default()
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn the_drawn_dots_are_measured_and_their_covariances_hold() {
    let pattern = crate::common::random_pattern(20, 11);
    let mut squares = Vec::new();
    for seed in 0..12 {
        let dots = drawn(&pattern, 0.035, 100 + seed);
        let clip = ClipConfig {
            seed,
            ..ClipConfig::default()
        };
        let found = calibrated(&pattern, &dots, &clip, &exact());
        // A dot that never turns away from the limb may be print.
        let at_limb = |d: &&CalibratedDot| d.expected_views < MIN_EXPECTED_VIEWS;
        let doubtful = found.dots.iter().filter(at_limb).count();
        assert!(doubtful <= 1);
        assert_eq!(found.count(DotState::Doubtful), doubtful);
        assert_eq!(found.measured() + doubtful, 20);
        assert!(
            (0.8..1.2).contains(&found.noise_scale),
            "{}",
            found.noise_scale
        );
        let truth: Vec<(usize, Vec3)> = dots.into_iter().enumerate().collect();
        let (normalized, angles) = errors(&found, &truth);
        // 0.3 px on 30 px are 0.57 deg a view and axis, more towards the limb; some 45 views a dot. The
        // camera's axis and the outlines' common error are estimated as well.
        let rms = rms(&angles).to_degrees();
        assert!(rms < 0.35, "{rms} deg");
        squares.extend(normalized);
    }
    // Each square is 1 on average. Dots of a clip share the error of the camera's axis, so that clips, not
    // dots, are the sample: twelve of them.
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!((0.6..1.3).contains(&mean), "{mean}");
}

#[test]
fn parallel_rays_are_at_the_bound_of_the_distance_and_do_no_harm() {
    let pattern = crate::common::random_pattern(20, 17);
    let dots = drawn(&pattern, 0.035, 200);
    let clip = ClipConfig {
        distance: 1e5,
        ..ClipConfig::default()
    };
    let found = calibrated(&pattern, &dots, &clip, &exact());
    assert!(found.inverse_distance.unwrap() < 0.02);
    let truth: Vec<(usize, Vec3)> = dots.into_iter().enumerate().collect();
    let (_, angles) = errors(&found, &truth);
    let rms = rms(&angles).to_degrees();
    assert!(rms < 0.35, "{rms} deg");
}

#[test]
fn what_the_detector_doubts_is_doubtful_and_less_certain() {
    let pattern = crate::common::random_pattern(20, 18);
    let dots = drawn(&pattern, 0.02, 300);
    let mut clip = identified(&pattern, &dots, &ClipConfig::default());
    for frame in &mut clip.frames {
        for (dot, name) in frame.dots.iter_mut().zip(&frame.assignment) {
            match name {
                Some(7) => dot.probability = 0.5,
                Some(5) => dot.covariance *= 4.0,
                _ => {}
            }
        }
    }
    let found = |shared_sigma_rad| {
        let config = CalibrationConfig {
            shared_sigma_rad,
            ..CalibrationConfig::default()
        };
        calibrate(&pattern, &clip.frames, Some(&clip.times_s), &config)
            .unwrap()
            .unwrap()
    };
    let shared_sigma_rad = CalibrationConfig::default().shared_sigma_rad;
    let (with, without) = (found(shared_sigma_rad), found(0.0));
    let is_doubtful = |j: &usize| with.dots[*j].state == DotState::Doubtful;
    let doubtful: Vec<usize> = (0..20).filter(is_doubtful).collect();
    assert_eq!(doubtful, [7]);
    // Its views agree to a fraction of a degree, and may all be of print beside it.
    assert!(with.dots[7].sigma_rad() > 0.02);
    // What the views share, per axis, beside what they scatter.
    let shared = |j: usize| {
        let variance = |c: &Calibration| c.dots[j].sigma_rad().powi(2);
        (variance(&with) - variance(&without)).sqrt() / shared_sigma_rad
    };
    // Four times the variance of the middle dot: four times the standard deviation.
    assert!((0.9..1.3).contains(&shared(4)), "{}", shared(4));
    assert!((3.6..4.8).contains(&shared(5)), "{}", shared(5));
}

#[test]
fn the_pattern_is_the_one_rotated_least_from_the_nominal() {
    let pattern = crate::common::random_pattern(20, 12);
    let dots = drawn(&pattern, 0.035, 5);
    let found = calibrated(
        &pattern,
        &dots,
        &ClipConfig::default(),
        &CalibrationConfig::default(),
    );
    let calibrated: Vec<Vec3> = found.dots.iter().map(|d| d.direction).collect();
    let turn = kabsch(&calibrated, pattern.dots(), None).unwrap();
    assert!(turn.angle() < 1e-6, "{}", turn.angle());
}

#[test]
fn missing_dots_are_named_and_a_mark_is_found() {
    let pattern = crate::common::random_pattern(20, 13);
    let dots = drawn(&pattern, 0.025, 6);
    let mut on_ball: Vec<(usize, Vec3)> = dots.into_iter().enumerate().collect();
    on_ball.retain(|(j, _)| ![3, 11].contains(j));
    // A mark well apart from all dots.
    let apart = |v: &Vec3| pattern.dots().iter().all(|d| angle_between(d, v) > 0.3);
    let mark = spindoe::geometry::spiral_directions(500)
        .find(apart)
        .unwrap();
    let mut seen: Vec<Vec3> = on_ball.iter().map(|d| d.1).collect();
    seen.push(mark);
    for learn_extra in [false, true] {
        let config = CalibrationConfig {
            learn_extra,
            ..CalibrationConfig::default()
        };
        let found = calibrated(&pattern, &seen, &ClipConfig::default(), &config);
        let missing: Vec<usize> = (0..20)
            .filter(|&j| found.dots[j].state == DotState::Missing)
            .collect();
        assert_eq!(missing, [3, 11]);
        assert_eq!(found.marks.len(), 1);
        // The gauge turns the mark with the dots: by no more than their offsets' mean.
        let off = angle_between(&found.marks[0].direction, &mark);
        assert!(off < 0.03, "{off}");
        let numbers = found.nominal_numbers();
        assert_eq!(numbers.len(), 18 + usize::from(learn_extra));
        assert_eq!(numbers[3], Some(4));
        assert_eq!(numbers.contains(&None), learn_extra);
        let ball = found.ball(Some(pattern.sha256())).unwrap();
        assert_eq!(ball.dot_covariances().unwrap().len(), numbers.len());
    }
}

#[test]
fn a_dot_drawn_far_off_is_distinguished_from_a_stain_by_its_looks() {
    let pattern = crate::common::random_pattern(20, 13);
    let mut dots = drawn(&pattern, 0.035, 6);
    // Nine degrees, and away from the nearest dot.
    let nearest = pattern
        .dots()
        .iter()
        .filter(|d| **d != pattern.dots()[7])
        .min_by(|a, b| {
            angle_between(a, &pattern.dots()[7]).total_cmp(&angle_between(b, &pattern.dots()[7]))
        })
        .unwrap();
    let away = (pattern.dots()[7] - nearest).normalize();
    dots[7] = (pattern.dots()[7] + 0.16 * away).normalize();
    let config = CalibrationConfig::default();
    let found = calibrated(&pattern, &dots, &ClipConfig::default(), &config);
    assert_eq!(found.dots[7].state, DotState::Measured);
    assert!(found.far_off().eq([7]));
    let off = angle_between(&found.dots[7].direction, &dots[7]);
    assert!(off < 0.03, "{off}");

    let clip = ClipConfig {
        unlike: vec![7],
        ..ClipConfig::default()
    };
    let found = calibrated(&pattern, &dots, &clip, &config);
    let missing: Vec<usize> = (0..20)
        .filter(|&j| found.dots[j].state == DotState::Missing)
        .collect();
    assert_eq!(missing, [7]);
    assert_eq!(found.far_off().count(), 0);
    assert_eq!(found.count(DotState::Doubtful), 0);
}

#[test]
fn what_a_single_axis_never_shows_stays_uncertain() {
    let pattern = crate::common::random_pattern(20, 14);
    let dots = drawn(&pattern, 0.025, 7);
    let truth: Vec<(usize, Vec3)> = dots.iter().copied().enumerate().collect();
    let config = exact();
    let (mut unseen, mut squares) = (0, Vec::new());
    for seed in 8..14 {
        let clip = ClipConfig {
            precession: 0.0,
            seed,
            ..ClipConfig::default()
        };
        let found = calibrated(&pattern, &dots, &clip, &config);
        for dot in found.dots.iter().filter(|d| d.state == DotState::Unseen) {
            unseen += 1;
            assert_eq!(dot.direction, dot.nominal);
            assert!((dot.sigma_rad() - config.placement_sigma_rad).abs() < 1e-12);
        }
        assert_eq!(found.count(DotState::Missing), 0, "seed {seed}");
        squares.extend(errors(&found, &truth).0);
    }
    // Some of the axes point at the camera, whose far ends are never seen.
    assert!(unseen > 0);
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!(mean < 2.5, "{mean}");
}

#[test]
fn frames_that_take_no_part_fit_better() {
    let pattern = crate::common::random_pattern(20, 15);
    let dots = drawn(&pattern, 0.03, 9);
    let clip = ClipConfig {
        frames: 40,
        step: 0.5,
        ..ClipConfig::default()
    };
    let clip = identified(&pattern, &dots, &clip);
    let config = CalibrationConfig::default();
    let judged = held_out(&pattern, &clip.frames, None, &config).unwrap();
    assert_eq!((judged.folds, judged.frames.len()), (5, 40));
    // Every fifth frame, by what the four others between two of these say of the ball.
    let all = || clip.frames.iter().enumerate();
    let kept: Vec<FrameEstimate> = all()
        .filter(|(k, _)| k % 5 != 2)
        .map(|f| f.1.clone())
        .collect();
    let unseen: Vec<FrameEstimate> = all()
        .filter(|(k, _)| k % 5 == 2)
        .map(|f| f.1.clone())
        .collect();
    let others = calibrate(&pattern, &kept, None, &config).unwrap().unwrap();
    let found = identify_frames(&others.ball(None).unwrap(), &config.estimator, &unseen).unwrap();
    for (frame, found) in judged.frames.iter().skip(2).step_by(5).zip(&found) {
        let after = frame.after.map(|after| after.residual_deg);
        assert_eq!(after, found.pose().map(|p| p.residual_rad.to_degrees()));
    }
    let [before, after] = judged.median_deg;
    assert!(after < 0.6 * before, "{before} {after}");
    let [before, after] = judged.mean_matched;
    assert!(after >= before - 0.2, "{before} {after}");
}

#[test]
fn outlines_that_are_all_too_large_are_corrected() {
    let pattern = crate::common::random_pattern(30, 17);
    let dots = drawn(&pattern, 0.02, 11);
    let clip = ClipConfig {
        sigma_px: 0.05,
        outline_scale: 1.07,
        ..ClipConfig::default()
    };
    let clip = identified(&pattern, &dots, &clip);
    let config = CalibrationConfig::default();
    let found = calibrate(&pattern, &clip.frames, Some(&clip.times_s), &config);
    let found = found.unwrap().unwrap();
    assert_eq!(found.measured(), 30);
    // The same dots do not fit these outlines.
    let ball = found.ball(None).unwrap();
    let as_found = identify_frames(&ball, &config.estimator, &clip.frames).unwrap();
    let sure = |frames: &[FrameEstimate]| {
        let poses = frames.iter().filter_map(|f| f.pose());
        poses.filter(|p| p.confidence >= config.trusted).count()
    };
    let [before, after] = [sure(&as_found), sure(&found.frames)];
    assert!(before < 60 && after > 110, "{before} {after}");
    let drawn: Vec<(usize, Vec3)> = (0..).zip(dots).collect();
    let worst = errors(&found, &drawn).1.into_iter().fold(0.0, f64::max);
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn a_thousand_frames_are_fitted() {
    let pattern = crate::common::random_pattern(20, 16);
    let dots = drawn(&pattern, 0.02, 10);
    let clip = ClipConfig {
        frames: 1000,
        step: 0.05,
        ..ClipConfig::default()
    };
    let clip = identified(&pattern, &dots, &clip);
    let found = calibrate(
        &pattern,
        &clip.frames,
        Some(&clip.times_s),
        &CalibrationConfig::default(),
    );
    assert_eq!(found.unwrap().unwrap().measured(), 20);
}
