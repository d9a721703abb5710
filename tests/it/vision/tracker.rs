//! A camera's frames one by one: the answers, the memory, and the work for a frame.

use std::sync::Arc;

use spindoe::clip::{Tracker, TrackerConfig};
use spindoe::geometry::{Vec3, rotation_angle};
use spindoe::image::{Picture, RgbImage};
use spindoe::pattern::Pattern;
use spindoe::spin::robust::RobustEstimator;
use spindoe::spin::shared::SharedError;
use spindoe::spin::{Measurement, SpinRejection};
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthSequence};
use spindoe::vision::{Camera, DetectorName, Estimator, EstimatorConfig};

const SPIN: Vec3 = Vec3::new(40.0, 150.0, -60.0);

struct Clip {
    pattern: Pattern,
    frames: Vec<(RgbImage, f64)>,
}

fn clip(count: usize) -> Clip {
    let pattern = crate::common::random_pattern(20, 5);
    let config = SynthConfig {
        ball_px: Some([90.0; 2]),
        camera_distance_radii: [20.0; 2],
        parallel_share: 0.0,
        ..SynthConfig::good()
    };
    let sequence = ClipConfig {
        fps: 350.0,
        spin: Some(SPIN.into()),
        ..ClipConfig::default()
    };
    let sequence = SynthSequence::random(&pattern, &config, &sequence, 3, count).unwrap();
    let frames = (0..count)
        .map(|k| {
            let frame = sequence.frame(k).unwrap();
            (frame.image, frame.truth.time_s.unwrap())
        })
        .collect();
    Clip { pattern, frames }
}

fn tracker(pattern: &Pattern, config: TrackerConfig) -> Tracker {
    let detector = DetectorName::Cnn.build().unwrap();
    let camera = Camera::Near {
        inverse_distance: 1.0 / 20.0,
    };
    let settings = EstimatorConfig {
        camera: camera.into(),
        ..EstimatorConfig::default()
    };
    let estimator = Estimator::new(pattern, settings, detector).unwrap();
    Tracker::new(Arc::new(estimator), config).unwrap()
}

#[test]
fn it_knows_the_orientation_and_the_spin_now() {
    let clip = clip(24);
    let mut tracker = tracker(&clip.pattern, TrackerConfig::default());
    let (mut posed, mut spins) = (0, 0);
    for (image, time_s) in &clip.frames {
        let state = tracker.update(image, *time_s, None).unwrap();
        if let Ok(fit) = state.spin {
            spins += 1;
            let covariance = fit.spin_covariance.expect("a covariance");
            assert!(covariance.cholesky().is_some());
            // The first fits are of two frames and three.
            let off = (fit.motion.spin - SPIN).norm();
            assert!(
                off < if spins > 4 { 10.0 } else { 25.0 },
                "{off} at {time_s}"
            );
        }
        if let Some(pose) = state.frame.pose() {
            posed += 1;
            if let Ok(fit) = state.spin {
                let expected = fit.motion.at(*time_s);
                assert!(rotation_angle(&pose.rotation, &expected).to_degrees() < 20.0);
            }
        }
    }
    assert!(posed >= 22 && spins >= 20, "{posed} poses, {spins} spins");
    let off = tracker.state().spin.as_ref().unwrap().motion.spin - SPIN;
    assert!(off.norm() < 5.0, "{off}");
    assert_eq!(tracker.inlier_probabilities().len(), 12);
}

#[test]
fn two_frames_that_follow_each_other_have_a_spin_with_its_covariance() {
    // Many pairs: all that follow each other in a clip.
    let clip = clip(25);
    let mut tracker = tracker(&clip.pattern, TrackerConfig::default());
    let (mut pairs, mut sum, mut beyond) = (0, 0.0, 0);
    for two in clip.frames.windows(2) {
        tracker.reset();
        for (image, time_s) in two {
            tracker.update(image, *time_s, None).unwrap();
        }
        let Ok(fit) = tracker.state().spin else {
            continue;
        };
        assert_eq!(fit.inliers, 2);
        let off = fit.motion.spin - SPIN;
        let covariance = fit.spin_covariance.expect("a covariance");
        assert!(covariance.trace().sqrt() < 0.3 * SPIN.norm());
        let distance2 = off.dot(&covariance.cholesky().unwrap().solve(&off));
        pairs += 1;
        sum += distance2 / 3.0;
        // 99 % of chi-squared with three degrees of freedom lie below.
        beyond += usize::from(distance2 > 11.34);
    }
    assert!(pairs >= 18, "{pairs} pairs");
    let mean = sum / f64::from(pairs);
    assert!(
        (0.2..1.6).contains(&mean) && beyond <= 2,
        "{mean} of {pairs}, {beyond} beyond"
    );
}

#[test]
fn two_frames_with_another_between_them_have_no_spin() {
    let clip = clip(6);
    let mut tracker = tracker(&clip.pattern, TrackerConfig::default());
    let (image, _) = &clip.frames[0];
    let pixels = vec![[0.5; 3]; image.width() * image.height()];
    let empty = RgbImage::new(image.width(), image.height(), pixels).unwrap();
    // One that shows no ball.
    for k in 0..3 {
        let (image, time_s) = &clip.frames[k];
        let shown = if k == 1 { &empty } else { image };
        tracker.update(shown, *time_s, None).unwrap();
    }
    let none = |tracker: &Tracker| {
        let state = tracker.state();
        assert!(state.frame.pose().is_some());
        matches!(
            state.spin,
            Err(SpinRejection::TooFewFrames { found: 2, .. })
        )
    };
    assert!(none(&tracker));
    // One that never came: the camera's step is known from the frames before.
    tracker.reset();
    for k in [3, 5] {
        let (image, time_s) = &clip.frames[k];
        tracker.update(image, *time_s, None).unwrap();
    }
    assert!(none(&tracker));
}

#[test]
fn the_covariance_counts_the_errors_that_frames_share() {
    let clip = clip(24);
    let config = TrackerConfig::default();
    let mut tracker = tracker(&clip.pattern, config);
    let mut trusted = Vec::new();
    for (image, time_s) in &clip.frames {
        let state = tracker.update(image, *time_s, None).unwrap();
        let pose = state
            .frame
            .pose()
            .filter(|pose| !pose.hinted && pose.confidence >= 0.8);
        trusted.extend(pose.map(|pose| {
            let measurement = Measurement {
                confidence: pose.confidence,
                ..Measurement::new(*time_s, pose.rotation)
            };
            (measurement, pose.residual_rad)
        }));
    }
    // The same window by hand.
    let window = &trusted[trusted.len() - config.window..];
    let (measurements, residuals): (Vec<_>, Vec<_>) = window.iter().copied().unzip();
    let mut estimator = RobustEstimator::new(config.sequence.spin);
    let independent = estimator.fit(&measurements).unwrap();
    estimator.set_shared(SharedError::of_residuals(residuals.into_iter()));
    let shared = estimator.fit(&measurements).unwrap();
    let found = tracker.state().spin.as_ref().expect("a spin");
    // But for the view frame, which hardly turns here.
    assert!((found.motion.spin - shared.motion.spin).norm() < 0.2);
    let [of_tracker, by_hand] = [found, &shared].map(|fit| fit.spin_covariance.unwrap());
    assert!((of_tracker - by_hand).norm() < 0.02 * by_hand.trace());
    assert_eq!(shared.motion, independent.motion);
    let [shared, independent] = [shared, independent].map(|fit| fit.spin_covariance.unwrap());
    let least = (shared - independent).symmetric_eigenvalues().min();
    assert!(least > 0.0, "{least}");
    assert!(shared.trace() > 1.2 * independent.trace());
}

#[test]
fn answers_do_not_depend_on_what_is_forgotten() {
    let clip = clip(30);
    let config = TrackerConfig {
        memory_s: 10.5 / 350.0,
        ..TrackerConfig::default()
    };
    let (mut long, mut late) = (
        tracker(&clip.pattern, config),
        tracker(&clip.pattern, config),
    );
    for (k, (image, time_s)) in clip.frames.iter().enumerate() {
        let first = long.update(image, *time_s, None).unwrap();
        let (pose, spin) = (first.frame.outcome, *first.spin);
        if k < 4 {
            continue;
        }
        let second = late.update(image, *time_s, None).unwrap();
        // Once both have the same window.
        if k >= 4 + 12 {
            // The outline's fit starts from where the frames before expect it.
            let (a, b) = (second.frame.pose(), pose.ok());
            assert_eq!(a.is_some(), b.is_some());
            if let (Some(a), Some(b)) = (a, b) {
                assert!(a.rotation.angle_to(&b.rotation) < 1e-3);
            }
            assert_eq!(second.spin.is_ok(), spin.is_ok());
            if let (Ok(a), Ok(b)) = (second.spin, spin) {
                assert!((a.motion.spin - b.motion.spin).norm() < 0.1);
            }
        }
    }
}

#[test]
fn a_warm_tracker_does_not_allocate() {
    let clip = clip(60);
    let mut tracker = tracker(&clip.pattern, TrackerConfig::default());
    let mut run = |from: usize, to: usize| {
        for (image, time_s) in &clip.frames[from..to] {
            tracker.update(image, *time_s, None).unwrap();
        }
    };
    let cold = allocation_counter::measure(|| run(0, 20));
    assert!(cold.count_total > 0, "the counter does not count");
    let warm = allocation_counter::measure(|| run(20, 60));
    assert_eq!(warm.count_total, 0);
}

/// A stream as one sees it in a mirror is said to be one, until it is none any more.
#[test]
fn the_last_frames_say_whether_the_images_are_mirrored() {
    let clip = clip(60);
    let mut tracker = tracker(&clip.pattern, TrackerConfig::default());
    let direct = clip
        .frames
        .iter()
        .map(|(image, _)| Picture::Color(image.clone()));
    let direct: Vec<Picture> = direct.collect();
    let mirrored = direct.iter().map(|p| p.clone().mirrored().unwrap());
    let mirrored: Vec<Picture> = mirrored.collect();
    let (mut time_s, mut answers) = (0.0, [Vec::new(), Vec::new(), Vec::new()]);
    for (part, answers) in answers.iter_mut().enumerate() {
        // A mirror, then two times none.
        let images = if part == 0 { &mirrored } else { &direct };
        for image in images.iter().chain(images).chain(images) {
            time_s += 1.0 / 350.0;
            let state = tracker.update(image.view().unwrap(), time_s, None).unwrap();
            let word = state.judgment.as_str();
            answers.push((word, state.frame.pose().is_some()));
        }
    }
    let [mirror, change, after] = answers;
    assert!(
        mirror[20..]
            .iter()
            .all(|answer| *answer == ("mirrored", false))
    );
    // Half of the window is a fifth of a second of this camera.
    let is_fitting = |answer: &(&str, bool)| *answer == ("fits", true);
    assert!(
        change[80..].iter().filter(|a| is_fitting(a)).count() > 90,
        "{change:?}"
    );
    assert!(
        after.iter().filter(|a| is_fitting(a)).count() > 170,
        "{after:?}"
    );
    tracker.reset();
    assert_eq!(tracker.state().judgment.as_str(), "open");
}

#[test]
fn a_time_that_is_not_later_is_refused_and_changes_nothing() {
    let clip = clip(4);
    let mut tracker = tracker(&clip.pattern, TrackerConfig::default());
    let (image, _) = &clip.frames[0];
    tracker.update(image, 1.0, None).unwrap();
    for time_s in [1.0, 0.5, f64::NAN, f64::INFINITY] {
        let error = tracker.update(image, time_s, None).unwrap_err();
        assert!(error.to_string().starts_with("time_s"), "{error}");
    }
    tracker.update(image, 1.1, None).unwrap();
    // Poses older than the memory are gone, and so are all after a reset.
    let state = tracker.update(image, 9.0, None).unwrap();
    assert!(matches!(
        state.spin,
        Err(SpinRejection::TooFewFrames { found: 1, .. })
    ));
    tracker.reset();
    tracker.update(image, 0.0, None).unwrap();
}

#[test]
fn settings_are_checked() {
    let pattern = crate::common::random_pattern(20, 5);
    let detector = DetectorName::Blob.build().unwrap();
    let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector).unwrap();
    let estimator = Arc::new(estimator);
    let good = TrackerConfig::default();
    let bad = [
        TrackerConfig { window: 2, ..good },
        TrackerConfig {
            memory_s: 0.0,
            ..good
        },
        TrackerConfig {
            memory_s: f64::NAN,
            ..good
        },
    ];
    for config in bad {
        assert!(Tracker::new(Arc::clone(&estimator), config).is_err());
    }
}
