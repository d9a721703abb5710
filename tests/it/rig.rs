//! Several cameras that see one ball: what is fused, what one misses, and cameras that disagree.

use std::sync::OnceLock;

use spindoe::Vec3;
use spindoe::clip::{
    CameraClip, ClockCheck, Fusion, RigConfig, RigDoubt, RigOutcome, SequenceConfig, combine,
    estimate_passes, held_images,
};
use spindoe::geometry::{CameraFrame, Rotation};
use spindoe::image::{ImageView, RgbImage};
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthFrame};
use spindoe::synth::rig::{RigSequence, to_yaml};
use spindoe::vision::{
    Camera, DetectorName, Estimator, EstimatorConfig, Extrinsics, FrameEstimate, Intrinsics, Prior,
    Rig, RigCamera,
};

use crate::common::{done, dots20, refused, spindoe};

const RADIUS_M: f64 = 0.02;
const FPS: f64 = 350.0;
const FRAMES: usize = 12;
const SIZE: [usize; 2] = [320, 280];

/// Two cameras under this angle whose axes meet a meter away; that the focal lengths differ shows when clips are exchanged.
fn rig(angle_deg: f64) -> Rig {
    let rotation = Rotation::from_scaled_axis(Vec3::y() * angle_deg.to_radians());
    let middle = Vec3::new(0.0, 0.0, 1.0);
    let second = Extrinsics {
        rotation,
        translation_m: middle - rotation * middle,
    };
    let k = |f: f64| Intrinsics::pinhole(f, f, 159.5, 139.5);
    Rig::new(vec![
        RigCamera::new("left", k(1500.0), Some(SIZE), Extrinsics::default()),
        RigCamera::new("right", k(1350.0), Some(SIZE), second),
    ])
    .unwrap()
}

/// The same rig where the second camera is wrongly stated.
fn stated(rig: &Rig, turn: Vec3, shift_m: Vec3) -> Rig {
    let mut cameras = rig.cameras().to_vec();
    let wrong = Extrinsics {
        rotation: Rotation::from_scaled_axis(turn),
        translation_m: shift_m,
    };
    cameras[1].extrinsics = cameras[1].extrinsics.then(&wrong);
    Rig::new(cameras).unwrap()
}

/// A clip of both cameras, each estimated by itself.
struct Clip {
    rig: Rig,
    sequence: RigSequence,
    /// In the first camera's frame.
    truths: Vec<Rotation>,
    images: Vec<Vec<RgbImage>>,
    estimators: Vec<Estimator>,
    alone: Vec<Vec<FrameEstimate>>,
}

fn estimator(rig: &Rig, camera: usize) -> Estimator {
    let config = EstimatorConfig {
        camera: Camera::Perspective(rig.cameras()[camera].calibration.intrinsics).into(),
        ball_radius_m: Some(RADIUS_M),
        ..EstimatorConfig::default()
    };
    Estimator::new(&dots20(), config, DetectorName::Cnn.build().unwrap()).unwrap()
}

fn times() -> Vec<f64> {
    (0..FRAMES).map(|k| k as f64 / FPS).collect()
}

fn alone(estimator: &Estimator, images: &[RgbImage]) -> Vec<FrameEstimate> {
    let views: Vec<ImageView<'_>> = images.iter().map(ImageView::from).collect();
    let config = SequenceConfig::default();
    let held = held_images(estimator, &views);
    let Ok((frames, _)) = estimate_passes(
        estimator,
        &config,
        &Prior::default(),
        FRAMES,
        Some(&times()),
        held,
    );
    frames
}

fn clip() -> &'static Clip {
    static CLIP: OnceLock<Clip> = OnceLock::new();
    CLIP.get_or_init(|| {
        let rig = rig(90.0);
        let clip = ClipConfig {
            fps: FPS,
            spin: Some([90.0, 160.0, -60.0]),
            exposure_s: Some(2e-4),
            ..ClipConfig::default()
        };
        // Dots off their places are errors that both cameras share.
        let config = SynthConfig {
            placement_sigma_rad: [0.002; 2],
            ..SynthConfig::good()
        };
        let sequence =
            RigSequence::random(&dots20(), &config, &clip, &rig, RADIUS_M, 65_210, FRAMES).unwrap();
        let frames = (0..2).map(|camera| {
            let frame = |k| sequence.frame(camera, k).unwrap();
            (0..FRAMES).map(frame).collect::<Vec<_>>()
        });
        let frames: Vec<Vec<SynthFrame>> = frames.collect();
        let truths = frames[0].iter().map(|f| f.truth.camera_orientation());
        let truths = truths.collect();
        let images: Vec<Vec<RgbImage>> = frames
            .into_iter()
            .map(|own| own.into_iter().map(|f| f.image).collect())
            .collect();
        let estimators: Vec<Estimator> = (0..2).map(|k| estimator(&rig, k)).collect();
        let alone = (0..2).map(|k| alone(&estimators[k], &images[k])).collect();
        Clip {
            rig,
            sequence,
            truths,
            images,
            estimators,
            alone,
        }
    })
}

/// What the cameras say together, with these frames of each, by these clocks.
fn together(rig: &Rig, frames: [Vec<FrameEstimate>; 2], times_s: [Vec<f64>; 2]) -> RigOutcome {
    let clip = clip();
    let mut clips: Vec<CameraClip<'_>> = frames
        .into_iter()
        .zip(times_s)
        .zip(&clip.estimators)
        .map(|((frames, times_s), estimator)| CameraClip {
            estimator,
            names: Vec::new(),
            times_s: Some(times_s),
            frames,
        })
        .collect();
    let config = RigConfig {
        sequence: SequenceConfig::default(),
        independent: false,
        min_confidence: EstimatorConfig::default().min_confidence,
    };
    let views: Vec<Vec<ImageView<'_>>> = clip
        .images
        .iter()
        .map(|own| own.iter().map(ImageView::from).collect())
        .collect();
    let outcome = combine(rig, &config, &mut clips, |camera, numbers, work| {
        held_images(&clip.estimators[camera], &views[camera])(numbers, work)
    });
    let Ok(outcome) = outcome.unwrap();
    outcome
}

fn both() -> [Vec<FrameEstimate>; 2] {
    let alone = &clip().alone;
    [alone[0].clone(), alone[1].clone()]
}

fn same_times() -> [Vec<f64>; 2] {
    [times(), times()]
}

/// Errors of orientation, radians, and position, m, in the rig's frame.
fn errors(estimate: &FrameEstimate, to_rig: &Extrinsics, k: usize) -> Option<[f64; 2]> {
    let pose = estimate.pose()?;
    let truth = clip().truths[k];
    let center = to_rig.apply(&pose.position?.center_m);
    let turn = (to_rig.rotation * pose.rotation).angle_to(&truth);
    Some([turn, (center - clip().sequence.center_m(k)).norm()])
}

fn rms(errors: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|at| {
        let squares: f64 = errors.iter().map(|e| e[at] * e[at]).sum();
        (squares / errors.len() as f64).sqrt()
    })
}

#[test]
fn two_cameras_are_one_measurement_that_is_better_than_either() {
    let clip = clip();
    let outcome = together(&clip.rig, both(), same_times());
    assert!(outcome.doubts.is_empty(), "{:?}", outcome.doubts);
    assert_eq!(outcome.frames.len(), FRAMES);
    let fused = outcome.frames.iter().enumerate();
    let fused = fused.filter_map(|(k, f)| errors(&f.estimate, &Extrinsics::default(), k));
    let fused: Vec<_> = fused.collect();
    assert!(fused.len() >= FRAMES - 1, "{}", fused.len());
    let mut single = Vec::new();
    for (camera, frames) in clip.rig.cameras().iter().zip(&clip.alone) {
        let own = frames.iter().enumerate();
        single.extend(own.filter_map(|(k, f)| errors(f, &camera.to_rig(), k)));
    }
    let ([turn, place], [one_turn, one_place]) = (rms(&fused), rms(&single));
    assert!(turn < 0.9 * one_turn && turn < 0.006, "{turn} {one_turn}");
    assert!(place < 0.5 * one_place, "{place} {one_place}");
    // What is left over has six degrees of freedom, and the cameras' own errors are known to be some larger than stated.
    let chi2 = outcome.frames.iter().filter_map(|f| match f.fusion {
        Fusion::Fused { chi2, freedom } => Some(chi2 / freedom as f64),
        _ => None,
    });
    let chi2: Vec<f64> = chi2.collect();
    let mean = chi2.iter().sum::<f64>() / chi2.len() as f64;
    assert!(
        chi2.len() >= 10 && (0.3..2.5).contains(&mean),
        "{mean}: {chi2:?}"
    );
    // The rows say how many cameras they are of, and the spin is that of the ball in the first camera's frame.
    let file = outcome.orientations(CameraFrame::Camera);
    assert!(file.to_csv().lines().next().unwrap().ends_with(",cameras"));
    assert!(
        file.rows
            .iter()
            .filter(|row| row.cameras == Some(2))
            .count()
            >= 10
    );
    let spin = outcome.spin(&SequenceConfig::default()).unwrap();
    assert!((spin.motion.spin - clip.sequence.spin()).norm() < 0.02 * clip.sequence.spin().norm());
}

#[test]
fn a_frame_that_one_camera_misses_is_answered_by_the_other_and_tried_again() {
    let clip = clip();
    let mut frames = both();
    // Frames that the left camera lost, with their pictures still there; of the last its estimate is that of no picture.
    let lost = [2usize, 5, 6];
    for k in lost {
        frames[0][k] = FrameEstimate::default();
    }
    let outcome = together(&clip.rig, frames.clone(), same_times());
    assert!(outcome.settled >= 2, "{}", outcome.settled);
    for k in lost {
        let found = &outcome.frames[k];
        let [turn, place] = errors(&found.estimate, &Extrinsics::default(), k).unwrap();
        assert!(turn < 0.02 && place < 0.01, "{turn} {place}");
    }
    // Without the pictures the other camera answers alone, in the first one's frame.
    let mut clips: Vec<CameraClip<'_>> = frames
        .into_iter()
        .zip(&clip.estimators)
        .map(|(frames, estimator)| CameraClip {
            estimator,
            names: Vec::new(),
            times_s: Some(times()),
            frames,
        })
        .collect();
    let config = RigConfig {
        sequence: SequenceConfig::default(),
        independent: true,
        min_confidence: 0.5,
    };
    let none = |_: usize, _: &[usize], _: &spindoe::clip::ImageWork<'_>| {
        Ok::<_, std::convert::Infallible>(Vec::new())
    };
    let Ok(alone) = combine(&clip.rig, &config, &mut clips, none).unwrap();
    for k in lost {
        assert_eq!(
            (alone.frames[k].cameras, alone.frames[k].fusion),
            (1, Fusion::Single)
        );
        let [turn, _] = errors(&alone.frames[k].estimate, &Extrinsics::default(), k).unwrap();
        assert!(turn < 0.02, "{turn}");
    }
}

#[test]
fn a_wrong_pose_is_not_fused_silently() {
    let mut frames = both();
    let wrong = |frame: &mut FrameEstimate, confidence: f64| {
        let mut pose = *frame.pose().unwrap();
        pose.rotation = Rotation::from_scaled_axis(Vec3::new(0.9, -0.4, 0.3)) * pose.rotation;
        pose.confidence = confidence;
        frame.outcome = Ok(pose);
    };
    wrong(&mut frames[0][3], 0.55);
    wrong(&mut frames[1][7], 0.99);
    // As sure as the wrong one.
    let mut pose = *frames[0][7].pose().unwrap();
    pose.confidence = 0.99;
    frames[0][7].outcome = Ok(pose);
    let config_free = together(&clip().rig, frames, same_times());
    let chosen = &config_free.frames[3];
    // The left camera's is tried again with the right one's hint, or left out.
    let [turn, _] = errors(&chosen.estimate, &Extrinsics::default(), 3).unwrap();
    assert!(turn < 0.02, "{turn}");
    let doubtful = &config_free.frames[7];
    assert!(
        matches!(doubtful.fusion, Fusion::Disagreed { .. }),
        "{:?}",
        doubtful.fusion
    );
    let words = doubtful.estimate.outcome.unwrap_err().to_string();
    assert!(words.contains("the cameras disagree: chi2"), "{words}");
    assert!(config_free.disagreed() >= 1);
}

/// Left and right exchanged.
fn flipped(image: &RgbImage) -> RgbImage {
    let (width, height) = (image.width(), image.height());
    let rows = image.values().chunks(width);
    let values = rows.flat_map(|row| row.iter().rev().copied()).collect();
    RgbImage::new(width, height, values).unwrap()
}

/// The one doubt of an outcome that answers nothing.
fn doubt(outcome: &RigOutcome) -> &RigDoubt {
    assert_eq!(
        (outcome.doubts.len(), outcome.answered()),
        (1, 0),
        "{:?}",
        outcome.doubts
    );
    &outcome.doubts[0]
}

#[test]
fn a_camera_that_is_wrongly_stated_is_named_with_its_angle() {
    let turn = Vec3::new(0.04, -0.07, 0.11);
    let wrong = stated(&clip().rig, turn, Vec3::zeros());
    let outcome = together(&wrong, both(), same_times());
    let RigDoubt::Turned {
        angle_rad, cameras, ..
    } = doubt(&outcome)
    else {
        panic!("{:?}", outcome.doubts);
    };
    assert!((angle_rad - turn.norm()).abs() < 0.01, "{angle_rad}");
    assert_eq!(cameras, &["right", "left"]);
    let words = outcome.doubts[0].to_string();
    assert!(
        words.starts_with("right is turned by 7.") || words.starts_with("right is turned by 8."),
        "{words}"
    );
    // A quarter of a meter aside, the cameras see the ball in two places.
    let aside = stated(&clip().rig, Vec3::zeros(), Vec3::new(0.25, 0.0, 0.0));
    let outcome = together(&aside, both(), same_times());
    let RigDoubt::Gap { gap_m, .. } = doubt(&outcome) else {
        panic!("{:?}", outcome.doubts);
    };
    assert!((gap_m - 0.25).abs() < 0.02, "{gap_m}");
}

#[test]
fn exchanged_clips_are_named() {
    let clip = clip();
    // Each camera's pictures, read with the other's intrinsics.
    let exchanged = [0, 1].map(|k| alone(&clip.estimators[k], &clip.images[1 - k]));
    let outcome = together(&clip.rig, exchanged, same_times());
    assert!(
        matches!(doubt(&outcome), RigDoubt::Swapped { .. }),
        "{:?}",
        outcome.doubts
    );
    let words = outcome.doubts[0].to_string();
    assert!(
        words.contains("clips of left and right are exchanged"),
        "{words}"
    );
}

#[test]
fn a_mirrored_camera_is_named_and_left_out() {
    let clip = clip();
    let mut frames = both();
    let flipped: Vec<RgbImage> = clip.images[1].iter().map(flipped).collect();
    frames[1] = alone(&clip.estimators[1], &flipped);
    let outcome = together(&clip.rig, frames, same_times());
    let mirrored = RigDoubt::Mirrored {
        camera: "right".into(),
    };
    assert_eq!(outcome.doubts, [mirrored]);
    assert!(outcome.answered() >= FRAMES - 1);
    assert!(outcome.frames.iter().all(|f| f.cameras < 2));
}

#[test]
fn a_clock_that_is_late_is_estimated_and_its_frames_are_moved() {
    let clip = clip();
    // The right camera's clock is behind by 0.9 ms, a third of a frame: its pictures are later than their times.
    let late_s = 9e-4;
    let late: Vec<f64> = times().iter().map(|t| t - late_s).collect();
    let outcome = together(&clip.rig, both(), [times(), late]);
    let agreement = outcome.agreement[0].expect("both saw the ball");
    let ClockCheck::Off { delay_s, std_s, .. } = agreement.clock else {
        panic!("{agreement:?}");
    };
    assert!(
        (delay_s - late_s).abs() < 5.0 * std_s.max(1e-5),
        "{delay_s} +- {std_s}"
    );
    assert!(outcome.frames.iter().filter(|f| f.cameras == 2).count() >= FRAMES - 1);
    let words = agreement.words("right", "left");
    assert!(
        words[1].starts_with("the clock of right is off: 0."),
        "{words:?}"
    );
}

#[test]
fn the_command_reads_what_synth_writes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path();
    std::fs::write(path.join("rig.yaml"), to_yaml(&rig(90.0)).unwrap()).unwrap();
    let make = "synth dots20 --rig rig.yaml --preset good --frames 6 --seed 3 --rps 30 --exposure-ms 0.2 -o c";
    done(path, &make.split(' ').collect::<Vec<_>>());
    let read =
        "estimate --table dots20 --rig c/rig.yaml c/left/images c/right/images -o o.csv --json";
    let json = done(path, &read.split(' ').collect::<Vec<_>>());
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["rig"]["cameras"][1]["name"], "right");
    assert!(json["identified"].as_u64().unwrap() >= 5, "{json}");
    let fused = json["frames"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|f| f["cameras"] == 2);
    for frame in fused {
        assert_eq!(frame["chi2_freedom"], 6);
        assert!(frame["chi2"].as_f64().unwrap() < 30.0, "{frame}");
    }
    // The truth of the first camera is that of the rig.
    let truth = std::fs::read_to_string(path.join("c/left/truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
    let spin = |json: &serde_json::Value| {
        let at = |k: usize| json[k].as_f64().unwrap();
        Vec3::new(at(0), at(1), at(2))
    };
    let (found, expected) = (
        spin(&json["spin"]["spin_rad_s"]),
        spin(&truth["frames"][0]["spin_rad_s"]),
    );
    assert!(
        (found - expected).norm() < 0.05 * expected.norm(),
        "{found} {expected}"
    );
    // The file's spin is the same.
    let again = done(path, &["spin", "o.csv", "--json"]);
    let again: serde_json::Value = serde_json::from_str(&again).unwrap();
    assert!((spin(&again["spin_rad_s"]) - found).norm() < 1e-6 * found.norm());
    // Exchanged clips are answered by nothing, with the reason.
    let swapped = "estimate --table dots20 --rig c/rig.yaml c/right/images c/left/images";
    let swapped: Vec<&str> = swapped.split(' ').collect();
    let output = spindoe(path, &swapped);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(words.contains("are exchanged"), "{words}");
    refused(
        path,
        &[
            "estimate",
            "--table",
            "dots20",
            "--rig",
            "c/rig.yaml",
            "c/left/images",
        ],
        2,
        "one folder or video for each",
    );
    refused(
        path,
        &[
            "estimate",
            "--table",
            "dots20",
            "--rig",
            "none.yaml",
            "a",
            "b",
        ],
        2,
        "none.yaml",
    );
}

#[test]
fn files_of_rigs_are_read_and_what_is_none_is_refused_in_a_line() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rig.yaml");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Rig::read(&path)
    };
    let flat = "K1: [900, 0, 320, 0, 900, 240, 0, 0, 1]\nK2: [800, 0, 320, 0, 800, 240, 0, 0, 1]\n";
    // OpenCV: x2 = R x1 + T. A quarter turn about y: what is ahead of the second camera is on the first one's right.
    let turn = "R: [0, 0, -1, 0, 1, 0, 1, 0, 0]\n";
    let rig = read(&format!("{flat}{turn}T: [1, 0, 0.5]\n")).unwrap();
    let second = rig.cameras()[1].extrinsics;
    let point = Vec3::new(0.2, 0.1, 1.0);
    assert!((second.apply(&point) - Vec3::new(0.0, 0.1, 0.7)).norm() < 1e-12);
    assert_eq!(rig.names(), ["left", "right"]);
    // As the renderer writes it.
    let again = read(&to_yaml(&self::rig(70.0)).unwrap()).unwrap();
    let (read_again, written) = (
        again.cameras()[1].extrinsics,
        self::rig(70.0).cameras()[1].extrinsics,
    );
    assert!(read_again.rotation.angle_to(&written.rotation) < 1e-12);
    assert!((read_again.translation_m - written.translation_m).norm() < 1e-12);
    for (text, words) in [
        (flat.to_owned(), "right: expected where this camera stands"),
        (
            format!("{flat}{turn}T: [1000, 0, 500]\n"),
            "T: right: expected meters",
        ),
        (
            format!("{flat}R: [0, 0, 1, 0, 1, 0, 1, 0, 0]\nT: [1, 0, 0]\n"),
            "R: expected a rotation, found a mirror image",
        ),
    ] {
        let error = read(&text).unwrap_err().to_string();
        assert!(
            error.contains(words) && error.lines().count() == 1,
            "{error}"
        );
    }
}
