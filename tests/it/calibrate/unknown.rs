//! A pattern from a clip alone.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::calibrate::{CalibrationConfig, SurfaceObserver, UnknownRejection, build_pattern};
use spindoe::geometry::{Rotation, Vec3, angle_between, spiral_directions};
use spindoe::synth::pen::Spot;
use spindoe::synth::{Scene, SynthConfig};
use spindoe::vision::albedo::Albedo;
use spindoe::vision::estimator::{BatchConfig, BatchObserver};
use spindoe::vision::{DetectorName, FrameEstimate, Prior};
use spindoe::{DotUncertainty, ObservedDot, Pattern, Recognizer, RobustRecognizer, ViewModel};
use spindoe::{Estimator, EstimatorConfig};

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
        let found = build_pattern(&clip.frames, None, None, &CalibrationConfig::default()).unwrap();
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
        let found =
            build_pattern(&clip.frames, None, expected, &CalibrationConfig::default()).unwrap();
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
    let found = build_pattern(
        &detections(truth.dots(), &short).frames,
        None,
        None,
        &config,
    )
    .unwrap();
    assert!(
        matches!(found, Err(UnknownRejection::TooFewFrames { .. })),
        "{found:?}"
    );
    let still = ClipConfig {
        step: 0.002,
        precession: 0.0,
        ..ClipConfig::default()
    };
    let found = build_pattern(
        &detections(truth.dots(), &still).frames,
        None,
        None,
        &config,
    )
    .unwrap();
    assert!(
        matches!(found, Err(UnknownRejection::NotCovered { .. })),
        "{found:?}"
    );
    let clip = detections(truth.dots(), &ClipConfig::default());
    let found = build_pattern(&clip.frames, None, Some(19), &config).unwrap();
    assert!(
        matches!(found, Err(UnknownRejection::WrongNumber { found: 20, .. })),
        "{found:?}"
    );
}

/// The frames of a ball that turns once about one axis and once about another, and what they show of its surface: the ball of
/// `truth`, and print where it is given.
fn filmed(truth: &Pattern, print: &[Spot], axes: &[Vec3]) -> (Vec<FrameEstimate>, Vec<Albedo>) {
    const STEPS: usize = 45;
    let stand_in = Pattern::new(spiral_directions(20).collect()).unwrap();
    let detector = DetectorName::Cnn.build().unwrap();
    let estimator = Estimator::new(&stand_in, EstimatorConfig::default(), detector).unwrap();
    let mut workspace = estimator.workspace();
    let looks = SynthConfig::good().unprinted().as_designed();
    let mut rng = ChaCha8Rng::seed_from_u64(35);
    let mut scene = Scene::random(truth, &looks, &mut rng).unwrap();
    scene.surface.strangers.extend_from_slice(print);
    let settings = SurfaceObserver::settings(BatchConfig::default());
    let observer = SurfaceObserver::default();
    let mut filmed = (Vec::new(), Vec::new());
    for k in 0..STEPS * axes.len() {
        scene.noise_seed = k as u64;
        scene.spin = Vec3::zeros();
        let image = scene.render().unwrap().image;
        let mut found = FrameEstimate::default();
        let prior = Prior::default();
        estimator.estimate(&image, &prior, &settings.budget, &mut workspace, &mut found);
        filmed.1.push(observer.keep(&image, &found).unwrap());
        filmed.0.push(found);
        let turn = axes[k / STEPS] * (std::f64::consts::TAU / STEPS as f64);
        scene.rotation = Rotation::from_scaled_axis(turn) * scene.rotation;
    }
    filmed
}

/// A round mark in the ball's plane.
fn mark(middle: Vec3, radius: f64, elongation: f32) -> Spot {
    Spot::round(middle, radius, 0.01, 0.9).stretched(Vec3::z(), elongation)
}

#[test]
fn a_ball_is_built_from_what_its_frames_show_and_print_is_no_dot() {
    let truth = crate::common::random_pattern(14, 35);
    let axes = [Vec3::x(), Vec3::y()];
    let config = CalibrationConfig::default();
    let (frames, albedos) = filmed(&truth, &[], &axes);
    let found = build_pattern(&frames, Some(&albedos), None, &config).unwrap();
    let built = found
        .unwrap_or_else(|rejection| panic!("{rejection}"))
        .pattern;
    let off = worst(&built, &truth).map(f64::to_degrees);
    assert!(
        off.is_some_and(|w| w < 1.0),
        "{off:?} deg, {} dots",
        built.len()
    );

    // A bar as long as three dots: a pattern without it, or none.
    let apart = |v: &Vec3| truth.dots().iter().all(|d| angle_between(d, v) > 0.5);
    let free = spiral_directions(500).find(apart).unwrap();
    let (frames, albedos) = filmed(&truth, &[mark(free, 0.12, 0.7)], &axes);
    let found = build_pattern(&frames, Some(&albedos), None, &config).unwrap();
    if let Ok(built) = &found {
        assert_eq!(built.pattern.len(), truth.len(), "the bar is a dot");
    }

    // Seen from the sides of one axis only, both ends of which stay in sight.
    let (frames, albedos) = filmed(&truth, &[], &[Vec3::z()]);
    let found = build_pattern(&frames, Some(&albedos), None, &config).unwrap();
    assert!(found.is_err(), "{found:?}");
}
