//! Frames with several images of balls: their light and truth against closed forms.

use std::f64::consts::PI;

use crate::common::{done, random_pattern, spindoe};
use spindoe::geometry::{CameraFrame, Rotation, Vec3};
use spindoe::pattern::Pattern;
use spindoe::spin::golf::Flight;
use spindoe::spin::robust::SpinConfig;
use spindoe::synth::background::Background;
use spindoe::synth::dataset::{BallTruth, ClipConfig, Sequence, frame_rng, strobed_frame};
use spindoe::synth::folder::Truth;
use spindoe::synth::sensor::Sensor;
use spindoe::synth::several::StrobeConfig;
use spindoe::synth::{Scene, SynthConfig};
use spindoe::vision::estimator::{
    BallEstimate, BallsEstimator, Strobe, StrobeHypothesis, number_balls,
};
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, NamedDetector, Prior,
};

/// An exposure with three flashes, before black, through a perfect camera, whose images share half of their diameter.
fn exposure(seed: u64) -> Scene {
    let strobe = StrobeConfig {
        overlap: [0.5, 0.5],
        ..StrobeConfig::new(vec![0.0, 0.9e-3, 2.1e-3]).with_golf_spin()
    };
    let pattern = random_pattern(20, 3);
    let mut rng = frame_rng(seed, 0);
    let mut scene = Scene::strobed(&pattern, &SynthConfig::golf(), &strobe, &mut rng).unwrap();
    scene.background = Background::plain([0.0; 3]);
    scene.sensor = Sensor {
        // Nothing is to be clipped where two images overlap.
        gain: 0.2,
        ..Sensor::PERFECT
    };
    scene
}

/// The scene of one of its images alone.
fn alone(scene: &Scene, k: usize) -> Scene {
    let mut one = scene.clone();
    one.others.clear();
    if let Some(image) = k.checked_sub(1).map(|k| &scene.others[k]) {
        (one.circle, one.rotation) = (image.circle, image.rotation);
        one.shift_px = image.shift_px;
    }
    one
}

#[test]
fn the_light_of_flashes_adds_up() {
    for seed in 0..3 {
        let scene = exposure(seed);
        let all = scene.render().unwrap();
        let images: Vec<_> = (0..3).map(|k| alone(&scene, k).render().unwrap()).collect();
        let mut shared = 0;
        for (i, value) in all.image.values().iter().enumerate() {
            let lit = images.iter().filter(|r| r.image.values()[i][0] > 0.02);
            shared += usize::from(lit.count() > 1);
            for (k, value) in value.iter().enumerate() {
                let sum: f32 = images.iter().map(|r| r.image.values()[i][k]).sum();
                // Each of four images is rounded to 8 bits.
                assert!((value - sum).abs() < 2.1 / 255.0, "{value} and {sum}");
            }
        }
        // Two discs of radius r whose centers are r apart share 2 pi / 3 - sqrt(3) / 2 of r^2.
        let r = scene.circle.radius;
        let lens = (2.0 * PI / 3.0 - 0.75f64.sqrt()) * r * r;
        assert!(shared as f64 > 0.8 * lens, "{shared} of {lens:.0} px");
    }
}

#[test]
fn a_balls_images_follow_its_flight_and_its_spin() {
    let rpm = |x: f64| x * 60.0 / std::f64::consts::TAU;
    for seed in 0..20 {
        let scene = exposure(seed);
        let spin = scene.spin;
        let [first, second] = [&scene.others[0], &scene.others[1]];
        assert_eq!([first.late_s, second.late_s], [0.9e-3, 2.1e-3]);
        for image in [first, second] {
            let turned = Rotation::from_scaled_axis(spin * image.late_s) * scene.rotation;
            assert!(turned.angle_to(&image.rotation) < 1e-9);
        }
        let moved = |image: &spindoe::synth::several::BallImage| {
            let (a, b) = (image.circle.center, scene.circle.center);
            [(a.u - b.u) / image.late_s, (a.v - b.v) / image.late_s]
        };
        let (a, b) = (moved(first), moved(second));
        assert!((a[0] / b[0] - 1.0).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-6 * a[0].abs());
        let apart = (a[0].hypot(a[1])) * 0.9e-3;
        assert!((apart / (2.0 * 50.0) - 0.5).abs() < 0.05, "{apart} px");
        // Backspin: the top moves against the flight.
        let top = spin.cross(&Vec3::y());
        assert!(top.x * a[0] < 0.0, "topspin of a flight along {a:?}");
        let back = rpm(spin.z.abs());
        assert!((1_500.0..12_000.0).contains(&back) && rpm(spin.y.abs()) <= 3_000.0);
    }
}

#[test]
fn of_two_balls_the_nearer_hides_the_other() {
    let patterns = [random_pattern(20, 3), random_pattern(24, 4)];
    let clip = ClipConfig {
        fps: 200.0,
        ..ClipConfig::default()
    };
    let config = SynthConfig {
        defocus_px: [0.0; 2],
        ..SynthConfig::good()
    };
    let mut hidden = 0;
    for seed in 0..4 {
        let clip = Sequence::of_balls(&patterns, &config, &clip, seed, 11).unwrap();
        for k in 0..11 {
            let (mut scene, _) = clip.scene(k);
            scene.sensor = Sensor::PERFECT;
            scene.circle.radius = 1.2 * scene.others[0].circle.radius;
            let both = scene.render().unwrap();
            let front = alone(&scene, 0).render().unwrap();
            let other = &both.others[0];
            // What is in front is seen as if it were alone.
            assert_eq!((other.of.ball, both.area_visible), (1, front.area_visible));
            for (i, share) in front.mask.iter().enumerate() {
                if *share == 255 {
                    let pairs = both.image.values()[i].iter().zip(front.image.values()[i]);
                    // A share of 255 may be a little less than all.
                    assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 2.1 / 255.0));
                }
            }
            let (a, b) = (both.circle, other.circle);
            let d = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
            let seen = 1.0 - lens(a.radius, b.radius, d) / (PI * b.radius * b.radius);
            let alone = alone(&scene, 1).render().unwrap();
            // Of the part of it that is within the picture; balls move by a pixel during the exposure.
            if alone.area_visible > 0.99 && front.area_visible > 0.99 {
                assert!((other.area_visible - seen).abs() < 0.05, "{seen} {other:?}");
            }
            hidden += usize::from(seen < 0.7);
        }
    }
    assert!(
        hidden >= 2,
        "only {hidden} frames with a ball before the other"
    );
}

/// The area that two discs share.
fn lens(a: f64, b: f64, apart: f64) -> f64 {
    if apart >= a + b {
        return 0.0;
    }
    if apart <= (a - b).abs() {
        return PI * a.min(b).powi(2);
    }
    let part = |r: f64, other: f64| {
        let x = (apart * apart + r * r - other * other) / (2.0 * apart);
        r * r * (x / r).acos() - x * (r * r - x * x).max(0.0).sqrt()
    };
    part(a, b) + part(b, a)
}

#[test]
fn the_command_writes_the_truth_of_every_image() {
    let dir = tempfile::tempdir().unwrap();
    let truth = |name: &str, args: &[&str]| -> Truth {
        done(
            dir.path(),
            &[&["synth", "dots20"][..], args, &["-o", name]].concat(),
        );
        let text = std::fs::read(dir.path().join(name).join("truth.json")).unwrap();
        serde_json::from_slice(&text).unwrap()
    };
    let strobed = truth("exposures", &["--strobe-ms", "0,0.9,2.1", "--frames", "2"]);
    for frame in &strobed.frames {
        let flashes: Vec<_> = frame.balls.iter().map(|b| (b.ball, b.flash)).collect();
        assert_eq!(flashes, [(0, 0), (0, 1), (0, 2)]);
        assert_eq!(frame.balls[0].quaternion_wxyz, frame.quaternion_wxyz);
        assert!((frame.balls[2].time_s - 2.1e-3).abs() < 1e-12);
    }
    assert!(strobed.origin.config.infrared && strobed.origin.config.dimples);
    let flying = truth(
        "flying",
        &["--also", "dots24", "--also", "dots32", "--frames", "3"],
    );
    for frame in &flying.frames {
        let numbers: Vec<_> = frame.balls.iter().map(|b| b.ball).collect();
        assert_eq!(numbers, [0, 1, 2]);
        assert_eq!(frame.size, [640, 480]);
    }
    let single = truth("one", &["--frames", "2"]);
    assert!(single.frames.iter().all(|f| f.balls.is_empty()));
}

/// Estimators with the built-in nets.
fn estimators(patterns: &[Pattern]) -> Vec<Estimator<NamedDetector>> {
    let one = |pattern: &Pattern| {
        let detector = DetectorName::Cnn.build().unwrap();
        Estimator::new(pattern, EstimatorConfig::default(), detector).unwrap()
    };
    patterns.iter().map(one).collect()
}

fn shipped(name: &str) -> Pattern {
    Pattern::read_csv(format!("designs/{name}/pattern.csv").as_ref()).unwrap()
}

/// The truth of the image that a ball is at.
fn at<'a>(ball: &BallEstimate, truth: &'a [BallTruth]) -> Option<&'a BallTruth> {
    let circle = ball.circle()?;
    truth.iter().find(|t| {
        let (a, b) = (circle.center, t.center);
        (a.u - b.u).hypot(a.v - b.v) < 0.2 * t.radius_px
    })
}

#[test]
fn all_images_of_an_exposure_are_found_and_their_spin_is_right() {
    let pattern = shipped("dots20");
    let config = SynthConfig::golf();
    let times = vec![0.0, 0.9e-3, 2.1e-3];
    let strobe = StrobeConfig::new(times.clone()).with_golf_spin();
    let all = BallsEstimator::new(estimators(std::slice::from_ref(&pattern)), None).unwrap();
    let single = estimators(std::slice::from_ref(&pattern)).remove(0);
    let mut ws = all.workspace().unwrap();
    let (mut images, mut posed, mut right) = (0, 0, 0);
    for k in 0..12 {
        let frame = strobed_frame(&pattern, &config, &strobe, 77, k).unwrap();
        let truth = &frame.truth.balls;
        let gray = frame.image.to_gray();
        let balls = all.estimate(&gray, None, &[], &Budget::default(), &mut ws);
        images += truth.len();
        let mut first = FrameEstimate::default();
        let (prior, budget) = (Prior::default(), Budget::default());
        single.estimate(&gray, &prior, &budget, &mut single.workspace(), &mut first);
        if first.pose().is_some() {
            assert_eq!(
                balls[0].frame.circle, first.circle,
                "the first ball is another"
            );
            assert_eq!(balls[0].frame.pose(), first.pose());
        }
        for ball in &balls {
            let Some(pose) = ball.frame.pose() else {
                continue;
            };
            let image = at(ball, truth).expect("a pose at an image of the ball");
            assert!(pose.rotation.angle_to(&image.orientation()).to_degrees() < 20.0);
            posed += 1;
        }
        let moved = truth[1].center.u - truth[0].center.u;
        let flight = Flight::of_motion([moved, 0.0]);
        // The right direction is among the hypotheses whether it is given or not.
        for given in [Some(flight), None] {
            let read = Strobe::new(
                times.clone(),
                given,
                SpinConfig {
                    max_rps: 250.0,
                    ..SpinConfig::default()
                },
            )
            .unwrap()
            .read(&balls, CameraFrame::View);
            let sum: f64 = read.iter().map(|h| h.probability).sum();
            assert!(read.is_empty() || (sum > 0.9 && sum < 1.0 + 1e-9), "{sum}");
            assert!(
                given.is_none()
                    || read
                        .iter()
                        .all(|h| h.flight == flight || h.velocity_px_s[0] * moved > 0.0)
            );
            let spin = Vec3::from(truth[0].spin_rad_s);
            let is_right = |h: &StrobeHypothesis| {
                h.spin()
                    .is_some_and(|w| (w - spin).norm() < 0.08 * spin.norm() + 10.0)
            };
            right += usize::from(read.first().is_some_and(is_right) && given.is_some());
        }
    }
    assert!(
        posed + 2 >= images,
        "{posed} of {images} images have a pose"
    );
    assert!(right >= 10, "{right} of 12 spins are right");
}

#[test]
fn two_images_without_a_direction_leave_both() {
    let pattern = shipped("dots20");
    let times = vec![0.0, 1.0e-3];
    let strobe = StrobeConfig {
        overlap: [-0.5, -0.2],
        ..StrobeConfig::new(times.clone()).with_golf_spin()
    };
    let all = BallsEstimator::new(estimators(std::slice::from_ref(&pattern)), Some(2)).unwrap();
    let mut ws = all.workspace().unwrap();
    let frame = strobed_frame(&pattern, &SynthConfig::golf(), &strobe, 5, 0).unwrap();
    let balls = all.estimate(&frame.image, None, &[], &Budget::default(), &mut ws);
    let spin = SpinConfig {
        max_rps: 250.0,
        ..SpinConfig::default()
    };
    let read = |times: &[f64], flight| {
        let strobe = Strobe::new(times.to_vec(), flight, spin).unwrap();
        strobe.read(&balls, CameraFrame::View)
    };
    let both = read(&times, None);
    assert_eq!(both.len(), 2);
    assert!(
        both.iter().all(|h| (h.probability - 0.5).abs() < 0.01),
        "{both:?}"
    );
    let [a, b] = [both[0].spin().unwrap(), both[1].spin().unwrap()];
    assert!(
        (a + b).norm() < 0.01 * a.norm(),
        "{a} and {b} are not opposite"
    );
    // A third flash that lit no image: any of three may be the missed one.
    let flight = Flight::of_motion([
        frame.truth.balls[1].center.u - frame.truth.balls[0].center.u,
        0.0,
    ]);
    let missed = read(&[0.0, 0.9e-3, 2.1e-3], Some(flight));
    assert_eq!(missed.len(), 3);
    let mut which: Vec<usize> = missed.iter().flat_map(|h| h.missed.clone()).collect();
    which.sort_unstable();
    assert_eq!(which, [0, 1, 2]);
    assert!(
        missed
            .iter()
            .all(|h| (h.probability - 1.0 / 3.0).abs() < 0.02)
    );
}

#[test]
fn balls_that_cross_keep_their_numbers_and_tables() {
    let patterns = [shipped("dots20"), shipped("dots24")];
    let config = SynthConfig {
        max_off_axis_rad: 0.0,
        camera_distance_radii: [30.0, 30.0],
        rps: [20.0, 40.0],
        ..SynthConfig::good()
    };
    let timing = ClipConfig {
        fps: 350.0,
        ..ClipConfig::default()
    };
    let clip = Sequence::of_balls(&patterns, &config, &timing, 21, 14).unwrap();
    let all = BallsEstimator::new(estimators(&patterns), None).unwrap();
    let mut ws = all.workspace().unwrap();
    let mut truths = Vec::new();
    let mut frames: Vec<Vec<BallEstimate>> = (0..14)
        .map(|k| {
            let frame = clip.frame(k).unwrap();
            truths.push(frame.truth.balls);
            let mut balls = all.estimate(&frame.image, None, &[], &Budget::default(), &mut ws);
            // The order within a frame means nothing.
            if k % 2 == 1 {
                balls.reverse();
            }
            balls
        })
        .collect();
    let times: Vec<f64> = (0..14).map(|k| f64::from(k) / 350.0).collect();
    let numbered = number_balls(SpinConfig::default(), &times, &mut frames);
    let mut seen = [[0; 2]; 16];
    for ((truth, balls), numbers) in truths.iter().zip(&frames).zip(&numbered.numbers) {
        for (ball, number) in balls.iter().zip(numbers) {
            if let (Some(image), Some(number), Some(_)) =
                (at(ball, truth), number, ball.frame.pose())
            {
                seen[*number][image.ball] += 1;
                assert_eq!(ball.table, image.ball);
                assert_eq!(numbered.tables[*number].0, image.ball);
            }
        }
    }
    let counts: Vec<_> = seen.iter().filter(|s| s[0] + s[1] > 0).collect();
    assert_eq!(counts.len(), 2, "numbers are given to {seen:?}");
    assert!(counts.iter().all(|s| s[0] == 0 || s[1] == 0), "{seen:?}");
    assert!(counts.iter().all(|s| s[0] + s[1] >= 9), "{seen:?}");
}

#[test]
fn the_command_has_a_row_for_each_ball_and_rejects_what_does_not_go_together() {
    let dir = tempfile::tempdir().unwrap();
    let run = |args: &[&str]| done(dir.path(), args);
    run(&[
        "synth",
        "dots20",
        "--strobe-ms",
        "0,0.9,2.1",
        "--frames",
        "2",
        "--seed",
        "4",
        "-o",
        "e",
    ]);
    let strobed = &[
        "estimate",
        "--table",
        "e/table.npz",
        "--strobe-ms",
        "0,0.9,2.1",
        "e/images",
    ];
    let text = run(strobed);
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].ends_with(",ball,flash"), "{}", lines[0]);
    assert_eq!(lines.len(), 7, "{text}");
    let ends: Vec<String> = lines[1..4]
        .iter()
        .map(|l| l[l.len() - 4..].into())
        .collect();
    assert_eq!(ends, [",0,0", ",1,1", ",2,2"]);
    let json: serde_json::Value =
        serde_json::from_str(&run(&[&strobed[..], &["--golf", "--json"]].concat())).unwrap();
    let best = &json["frames"][0]["strobe"]["hypotheses"][0];
    assert!(
        best["golf"]["backspin_rpm"].as_f64().unwrap() > 1_000.0,
        "{best}"
    );
    assert_eq!(json["frames"][0]["balls"].as_array().unwrap().len(), 3);
    // One ball as before: no such columns.
    let single = run(&["estimate", "--table", "e/table.npz", "e/images"]);
    assert!(!single.lines().next().unwrap().contains("ball"));
    for (args, expected) in [
        (&["--strobe-ms", "0.9,0"][..], "--strobe-ms"),
        (&["--strobe-ms", "0"], "--strobe-ms"),
        (&["--balls", "0"], "expected 1 to 16, or auto"),
        (&["--balls", "auto", "--calibrate"], "--calibrate"),
        (&["--golf"], "--strobe-ms"),
        (&["--strobe-ms", "0,1", "--table", "dots24"], "--table"),
    ] {
        let base = &["estimate", "--table", "e/table.npz", "e/images"];
        let output = spindoe(dir.path(), &[&base[..], args].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {words}");
        assert!(words.contains(expected), "{args:?}: {words}");
    }
}
