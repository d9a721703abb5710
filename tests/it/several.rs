//! Frames with several images of balls: their light and truth against closed forms.

use std::f64::consts::PI;

use crate::common::{done, random_pattern, spindoe};
use spindoe::clip::{
    BallEstimate, BallTracks, BallsEstimator, Strobe, StrobeHypothesis, number_balls,
};
use spindoe::geometry::{CameraFrame, Rotation, Vec3};
use spindoe::pattern::Pattern;
use spindoe::spin::golf::{GolfFlight, SpinType};
use spindoe::spin::robust::SpinConfig;
use spindoe::synth::background::Background;
use spindoe::synth::dataset::{BallTruth, ClipConfig, SynthSequence, frame_rng, strobed_frame};
use spindoe::synth::folder::Truth;
use spindoe::synth::sensor::Sensor;
use spindoe::synth::several::StrobeConfig;
use spindoe::synth::{Scene, SynthConfig};
use spindoe::vision::frame::Pose;
use spindoe::vision::optics::camera::{BallCircle, Pixel};
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

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
        let clip = SynthSequence::of_balls(&patterns, &config, &clip, seed, 11).unwrap();
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
fn estimators(patterns: &[Pattern]) -> Vec<Estimator> {
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
    let (mut images, mut posed, mut right, mut among, mut measured) = (0, 0, 0, 0, 0);
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
        let flight = GolfFlight::of_motion([moved, 0.0]);
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
            let is_ahead = |h: &StrobeHypothesis| h.velocity_px_s[0] * moved > 0.0;
            match given {
                Some(_) => assert!(read.iter().all(|h| is_ahead(h) && h.flight == flight)),
                None => among += usize::from(read.iter().any(is_ahead)),
            }
            let spin = Vec3::from(truth[0].spin_rad_s);
            let is_right = |h: &StrobeHypothesis| {
                h.spin()
                    .is_some_and(|w| (w - spin).norm() < 0.08 * spin.norm() + 10.0)
            };
            right += usize::from(read.first().is_some_and(is_right) && given.is_some());
            for hypothesis in &read {
                let Some(golf) = hypothesis.golf(CameraFrame::View) else {
                    continue;
                };
                // What is called measured is right, and has nothing beside it.
                if golf.spin_type == SpinType::Measured {
                    assert!(is_right(hypothesis), "{hypothesis:?}");
                    assert!(hypothesis.lit.len() == 3 && hypothesis.probability > 0.95);
                    measured += usize::from(given.is_some());
                }
            }
        }
    }
    assert!(
        posed + 2 >= images,
        "{posed} of {images} images have a pose"
    );
    assert!(right >= 10, "{right} of 12 spins are right");
    assert!(
        among >= 11,
        "the right direction is among the hypotheses of {among} of 12 exposures"
    );
    assert!(measured >= 9, "{measured} of 12 spins are measured");
}

#[test]
fn the_times_of_flashes_have_their_domain() {
    let flashes = |times: &[f64]| {
        let read = Strobe::new(times.to_vec(), None, SpinConfig::default()).map(drop);
        let made = StrobeConfig::new(times.to_vec()).check();
        assert_eq!(read.is_ok(), made.is_ok());
        read.map_err(|e| e.to_string())
    };
    let even = |count: i32| (0..count).map(|k| 1e-3 * f64::from(k)).collect::<Vec<_>>();
    assert!(flashes(&even(8)).is_ok() && flashes(&[-0.5, 0.5]).is_ok());
    for times in [
        &even(9)[..],
        &[0.0],
        &[],
        &[0.0, 1.01],
        &[0.0, 0.0],
        &[0.0, f64::NAN],
        &[f64::NEG_INFINITY, 0.0],
    ] {
        let words = flashes(times).unwrap_err();
        assert!(words.contains("2 to 8 times within 1000 ms"), "{words}");
    }
    // A ball that flies on for a thousand of its diameters.
    let far = StrobeConfig::new(vec![0.0, 1e-4, 0.1]);
    let made = Scene::strobed(
        &shipped("dots20"),
        &SynthConfig::golf(),
        &far,
        &mut frame_rng(1, 0),
    );
    let words = made.unwrap_err().to_string();
    assert!(words.contains("8192 columns and rows"), "{words}");
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
    // Nothing checks two images, whether their order is given or not.
    let one = read(&times, Some(both[0].flight));
    assert_eq!(one.len(), 1);
    for hypothesis in both.iter().chain(&one) {
        let golf = hypothesis.golf(CameraFrame::View).unwrap();
        assert_eq!(golf.spin_type, SpinType::Estimated);
    }
    // Many circles that come first hide no image with a pose.
    let aside = |k: usize| {
        let mut frame = FrameEstimate::default();
        let circle = balls[k % 2].circle().unwrap();
        let (row, column) = ((k / 4) as f64 - 3.0, (k % 4) as f64 - 1.7);
        let center = Pixel {
            u: circle.center.u + 2.7 * circle.radius * column,
            v: circle.center.v + 2.3 * circle.radius * row,
        };
        frame.circle = Some(BallCircle::new(center, circle.radius));
        BallEstimate {
            frame,
            ..balls[0].clone()
        }
    };
    let crowd: Vec<BallEstimate> = (0..8).map(aside).chain(balls.clone()).collect();
    let strobe = Strobe::new(times.clone(), None, spin).unwrap();
    let crowded = strobe.read(&crowd, CameraFrame::View);
    assert!(
        crowded[0].lit.iter().all(|(image, _)| *image >= 8),
        "{:?}",
        crowded[0].lit
    );
    assert!([a, b].contains(&crowded[0].spin().unwrap()));
    // A third flash that lit no image: any of three may be the missed one.
    let flight = GolfFlight::of_motion([
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
    let clip = SynthSequence::of_balls(&patterns, &config, &timing, 21, 14).unwrap();
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
        serde_json::from_str(&run(&[&strobed[..], &["--preset=golf", "--json"]].concat())).unwrap();
    let best = &json["frames"][0]["strobe"]["hypotheses"][0];
    assert!(
        best["golf"]["backspin_rpm"].as_f64().unwrap() > 1_000.0,
        "{best}"
    );
    assert_eq!(best["golf"]["spin_type"], "measured", "{best}");
    assert_eq!(json["frames"][0]["balls"].as_array().unwrap().len(), 3);
    // 194 rps: without golf's limit there is no spin, and no faster one is given for it.
    let limited: serde_json::Value =
        serde_json::from_str(&run(&[&strobed[..], &["--json"]].concat())).unwrap();
    let limited = &limited["frames"][0]["strobe"]["hypotheses"][0];
    let refusal = limited["spin_refusal"].as_str();
    assert!(
        refusal.is_some_and(|words| words.contains("no spin up to 175 rps")),
        "{limited}"
    );
    // The words of golf are of the same axes whatever those of the vectors are.
    let optical: serde_json::Value = serde_json::from_str(&run(&[
        &strobed[..],
        &["--preset=golf", "--json", "--frame", "optical"],
    ]
    .concat()))
    .unwrap();
    for k in 0..2 {
        let hypotheses = [&json, &optical].map(|json| {
            let all = json["frames"][k]["strobe"]["hypotheses"].as_array();
            all.unwrap().clone()
        });
        assert_eq!(hypotheses[0].len(), hypotheses[1].len());
        for (ours, theirs) in hypotheses[0].iter().zip(&hypotheses[1]) {
            let word = |h: &serde_json::Value, name: &str| h["golf"][name].as_f64().unwrap();
            for name in ["backspin_rpm", "sidespin_rpm", "rifle_rpm", "tilt_deg"] {
                let (a, b) = (word(ours, name), word(theirs, name));
                assert!((a - b).abs() < 1e-6 * a.abs() + 1e-6, "{name}: {a} and {b}");
            }
            let std = |h: &serde_json::Value, k: usize| h["golf"]["std_rpm"][k].as_f64().unwrap();
            assert!((0..2).all(|k| (std(ours, k) - std(theirs, k)).abs() < 1e-6));
            let y = |h: &serde_json::Value| h["spin"]["spin_rad_s"][1].as_f64().unwrap();
            assert!((y(ours) + y(theirs)).abs() < 1e-6 * y(ours).abs() + 1e-6);
        }
    }
    // The same as simulators read it; without intrinsics nobody knows how fast the ball is.
    let shots = run(&[&strobed[..], &["--preset=golf", "--as", "gspro"]].concat());
    assert_eq!(shots.lines().count(), 2, "{shots}");
    for (k, line) in shots.lines().enumerate() {
        let shot: serde_json::Value = serde_json::from_str(line).unwrap();
        let golf = &json["frames"][k]["strobe"]["hypotheses"][0]["golf"];
        assert_eq!(shot["ShotNumber"], k + 1);
        assert_eq!(shot["BallData"]["BackSpin"], golf["backspin_rpm"]);
        assert_eq!(shot["BallData"]["SpinAxis"], golf["tilt_deg"]);
        assert_eq!(shot["SpinType"], golf["spin_type"]);
        assert!(shot["BallData"].get("Speed").is_none());
        assert_eq!(shot["ShotDataOptions"]["ContainsBallData"], false);
    }
    let said = spindoe(
        dir.path(),
        &[&strobed[..], &["--preset=golf", "--as", "gspro"]].concat(),
    );
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert_eq!(
        said.matches("ContainsBallData is false").count(),
        1,
        "{said}"
    );
    // A limit that no spin is below: nothing is written, and that is no success.
    let slow = ["--preset=golf", "--as", "gspro", "--max-spin-rps", "0.001"];
    let none = spindoe(dir.path(), &[&strobed[..], &slow].concat());
    let words = String::from_utf8_lossy(&none.stderr).into_owned();
    assert_eq!(
        (none.status.code(), none.stdout.len()),
        (Some(3), 0),
        "{words}"
    );
    assert!(words.contains("no shot"), "{words}");
    // One ball as before: no such columns.
    let single = run(&["estimate", "--table", "e/table.npz", "e/images"]);
    assert!(!single.lines().next().unwrap().contains("ball"));
    for (args, expected) in [
        (&["--strobe-ms", "0.9,0"][..], "--strobe-ms"),
        (&["--strobe-ms", "0"], "--strobe-ms"),
        (&["--strobe-ms", "0,1001"], "2 to 8 times within 1000 ms"),
        (&["--balls", "0"], "expected 1 to 16, or auto"),
        (&["--balls", "auto", "--calibrate"], "--calibrate"),
        (&["--preset=golf"], "--strobe-ms"),
        (&["--strobe-ms", "0,,1"], "expected milliseconds"),
        (&["--as", "gspro"], "expected --strobe-ms and --preset golf"),
        (&["--balls", "2", "--as", "fictrac"], "expected one ball"),
        (
            &["--strobe-ms", "1x9"],
            "expected at most 8 flashes, found 9",
        ),
    ] {
        let base = &["estimate", "--table", "e/table.npz", "e/images"];
        let output = spindoe(dir.path(), &[&base[..], args].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {words}");
        assert!(words.contains(expected), "{args:?}: {words}");
    }
}

#[test]
fn a_shot_has_the_balls_velocity_where_the_camera_is_known() {
    let dir = tempfile::tempdir().unwrap();
    let flashes = [0.0, 0.9e-3, 2.1e-3];
    let make = "synth dots20 --strobe-ms 0,0.9,2.1 --frames 1 --seed 4 -o e";
    done(dir.path(), &make.split(' ').collect::<Vec<_>>());
    let truth = std::fs::read_to_string(dir.path().join("e/truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
    let frame = &truth["frames"][0];
    let k = ["fx", "fy", "cx", "cy"].map(|name| frame["intrinsics"][name].as_f64().unwrap());
    // Where the ball was at the flashes: so many radii of 21.335 mm away on the ray of its center.
    let place = |ball: &serde_json::Value| {
        let [u, v] = ["u", "v"].map(|x| ball["ball_center"][x].as_f64().unwrap());
        let ray = Vec3::new((u - k[2]) / k[0], (k[3] - v) / k[1], -1.0);
        ray.normalize() * (ball["distance"].as_f64().unwrap() * 0.021_335)
    };
    let places: Vec<Vec3> = frame["balls"]
        .as_array()
        .unwrap()
        .iter()
        .map(place)
        .collect();
    let velocity = (places[2] - places[0]) / (flashes[2] - flashes[0]);
    let asked = "estimate --table dots20 --strobe-ms 0,0.9,2.1 --preset golf --as gspro e/images";
    let known = format!("--intrinsics={}", k.map(|x| x.to_string()).join(","));
    let mut args: Vec<&str> = asked.split(' ').collect();
    args.push(&known);
    let shot: serde_json::Value = serde_json::from_str(&done(dir.path(), &args)).unwrap();
    assert_eq!(shot["ShotDataOptions"]["ContainsBallData"], true);
    let ball = |name: &str| shot["BallData"][name].as_f64().unwrap();
    // It flies to the left: ahead is -x, the right of who looks along is away from the camera.
    assert!(velocity.x < 0.0);
    let up_deg = velocity.y.atan2(velocity.x.hypot(velocity.z)).to_degrees();
    let right_deg = (-velocity.z).atan2(-velocity.x).to_degrees();
    assert!(
        (ball("Speed") * 0.447_04 / velocity.norm() - 1.0).abs() < 0.02,
        "{shot} {velocity}"
    );
    assert!((ball("VLA") - up_deg).abs() < 0.5, "{shot} {up_deg}");
    assert!((ball("HLA") - right_deg).abs() < 2.0, "{shot} {right_deg}");
}

#[test]
fn a_pipe_of_exposures_gives_what_their_files_give() {
    let dir = tempfile::tempdir().unwrap();
    // Even times leave the direction open: hypotheses that light the images in another order.
    let flashes = ["--strobe-ms", "0,1,2"];
    let make = ["--frames", "3", "--seed", "6", "-o", "e"];
    done(
        dir.path(),
        &[&["synth", "dots20"][..], &flashes, &make].concat(),
    );
    let asked = [&["--table", "e/table.npz", "--preset=golf"][..], &flashes].concat();
    let files = done(
        dir.path(),
        &[&["estimate"], &asked[..], &["--json", "e/images"]].concat(),
    );
    let files: serde_json::Value = serde_json::from_str(&files).unwrap();
    let image = |k: usize| dir.path().join(format!("e/images/frame-{k:06}.png"));
    let stream: Vec<u8> = (0..3)
        .flat_map(|k| std::fs::read(image(k)).unwrap())
        .collect();
    std::fs::write(dir.path().join("stream"), stream).unwrap();
    let live = ["live", "stream", "--fps", "10"];
    let gspro = |command: &[&str]| {
        done(
            dir.path(),
            &[command, &asked[..], &["--as", "gspro"]].concat(),
        )
    };
    let shots = gspro(&["estimate", "e/images"]);
    assert!(!shots.is_empty() && shots == gspro(&live), "{shots}");
    let lines = done(dir.path(), &[&live, &asked[..]].concat());
    let mut several = 0;
    for (k, line) in lines.lines().enumerate() {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        let file = &files["frames"][k];
        assert_eq!(line["balls"], file["balls"]);
        assert_eq!(line["strobe"], file["strobe"]);
        let balls = line["balls"].as_array().unwrap();
        let at = |number: &serde_json::Value| {
            let ball = balls
                .iter()
                .find(|b| b["ball"] == *number && number.is_u64());
            ball.expect("a ball of this number")["circle"]["u"]
                .as_f64()
                .unwrap()
        };
        let hypotheses = line["strobe"]["hypotheses"].as_array().unwrap();
        several += usize::from(hypotheses.len() > 1);
        for hypothesis in hypotheses {
            let images = hypothesis["images"].as_array().unwrap();
            let places: Vec<f64> = images.iter().map(|i| at(&i["ball"])).collect();
            let way = hypothesis["velocity_px_s"][0].as_f64().unwrap();
            assert!(
                places.windows(2).all(|w| (w[1] - w[0]) * way > 0.0),
                "{places:?} at {way} px/s"
            );
        }
    }
    assert_eq!(lines.lines().count(), 3);
    assert!(
        several >= 2,
        "{several} of 3 exposures leave the direction open"
    );
}

#[test]
fn images_of_one_ball_have_one_table() {
    let all = BallsEstimator::new(estimators(&[shipped("dots20"), shipped("dots24")]), None);
    let all = all.unwrap();
    let strobe = Strobe::new(vec![0.0, 1e-3], None, SpinConfig::default()).unwrap();
    let config = SynthConfig::golf();
    let flashes = StrobeConfig::new(vec![0.0, 1e-3]);
    let mut ws = all.workspace().unwrap();
    for k in 0..3 {
        let frame = strobed_frame(&shipped("dots24"), &config, &flashes, 36, k).unwrap();
        let budget = Budget::default();
        let balls = all.estimate_strobed(&frame.image.to_gray(), None, &strobe, &budget, &mut ws);
        assert!(balls.len() >= 2, "{k}");
        for ball in &balls {
            assert_eq!((ball.table, &ball.tables), (1, &balls[0].tables), "{k}");
            assert!((ball.tables.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{k}");
            let confidence = ball.frame.pose().map_or(0.0, |pose| pose.confidence);
            assert!(confidence <= ball.tables[1], "{k}");
        }
    }
}

#[test]
fn the_confidence_of_a_covered_image_counts_its_table_once() {
    let tables = ["dots24", "dots20", "dots32"].map(shipped);
    let all = BallsEstimator::new(estimators(&tables), Some(3)).unwrap();
    let times = vec![0.0, 0.9e-3, 2.1e-3];
    let strobe = Strobe::new(times.clone(), None, SpinConfig::default()).unwrap();
    let flashes = StrobeConfig {
        overlap: [0.2, 0.7],
        ..StrobeConfig::new(times).with_golf_spin()
    };
    let mut ws = all.workspace().unwrap();
    // The third had one of 1.76.
    for k in 0..4 {
        let frame = strobed_frame(&tables[1], &SynthConfig::golf(), &flashes, 9102, k).unwrap();
        let gray = frame.image.to_gray();
        let balls = all.estimate_strobed(&gray, None, &strobe, &Budget::default(), &mut ws);
        for pose in balls.iter().filter_map(|b| b.frame.pose()) {
            assert!((0.0..=1.0).contains(&pose.confidence), "{k}: {pose:?}");
        }
    }
}

#[test]
fn several_balls_are_warned_of_their_inputs_as_one_is() {
    let dir = tempfile::tempdir().unwrap();
    let make = [
        "synth", "dots20", "--as", "images", "--frames", "2", "-o", "e",
    ];
    done(dir.path(), &make);
    let folder = dir.path().join("named");
    std::fs::create_dir(&folder).unwrap();
    for (k, name) in ["0.5.png", "1.5.png"].iter().enumerate() {
        let image = format!("e/images/frame-{k:06}.png");
        std::fs::copy(dir.path().join(image), folder.join(name)).unwrap();
    }
    std::fs::write(folder.join("notes.txt"), "none").unwrap();
    let times = "frame,time_s\n0.5,0.2\n1.5,0.1\n";
    std::fs::write(dir.path().join("times.csv"), times).unwrap();
    let base = ["estimate", "--table", "e/table.npz", "named"];
    let said = |args: &[&str]| {
        let output = spindoe(dir.path(), &[&base[..], args].concat());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    for args in [&[][..], &["--times", "times.csv"]] {
        let (one, several) = (said(args), said(&[args, &["--balls", "auto"]].concat()));
        let warnings = one.lines().filter(|line| {
            [
                "skipped",
                "plain whole numbers",
                "times: ",
                "do not increase",
            ]
            .iter()
            .any(|words| line.contains(words))
        });
        let warnings: Vec<&str> = warnings.collect();
        assert_eq!(warnings.len(), 3 + args.len() / 2, "{one}");
        for line in warnings {
            assert!(
                several.lines().any(|l| l == line),
                "{line:?} is not in {several}"
            );
        }
    }
    // Times are judged within each input: what goes back there is named, what begins anew with the next is no fault of either.
    let within = said(&["--times", "times.csv"]);
    assert!(
        within.contains("the times of named do not increase"),
        "{within}"
    );
    for clip in ["a", "b"] {
        done(
            dir.path(),
            &["synth", "dots20", "--frames", "2", "-o", clip],
        );
    }
    let two = spindoe(dir.path(), &["estimate", "--table", "dots20", "a", "b"]);
    let two = String::from_utf8_lossy(&two.stderr).into_owned();
    let words = "the times do not increase from one of the 2 inputs to the next";
    assert!(two.contains(words), "{two}");
}

#[test]
fn a_pose_by_a_foreign_table_is_taken_back_and_lost_balls_are_forgotten() {
    let ball = |table: usize, tables: [f64; 2]| {
        let mut frame = FrameEstimate::default();
        let center = Pixel { u: 80.0, v: 60.0 };
        frame.circle = Some(BallCircle::new(center, 20.0));
        frame.outcome = Ok(Pose {
            rotation: Rotation::identity(),
            covariance: nalgebra::Matrix3::identity() * 1e-4,
            dots_confidence: 0.99,
            confidence: 0.99,
            residual_rad: 0.01,
            residual_px: 0.3,
            distance: None,
            view: None,
            position: None,
            hinted: false,
        });
        BallEstimate {
            frame,
            table,
            tables: tables.into(),
        }
    };
    let mut tracks = BallTracks::new(SpinConfig::default());
    let mut time_s = 0.0;
    let mut next = |tracks: &mut BallTracks, balls: &mut [BallEstimate]| {
        time_s += 0.01;
        let numbers = tracks.update(time_s, balls);
        tracks.reject_foreign(balls, &numbers);
        numbers
    };
    for _ in 0..5 {
        let mut own = [ball(0, [0.99, 0.01])];
        assert_eq!(next(&mut tracks, &mut own), [Some(0)]);
        assert!(own[0].frame.pose().is_some());
    }
    let mut foreign = [ball(1, [0.4, 0.6])];
    assert_eq!(next(&mut tracks, &mut foreign), [Some(0)]);
    assert!(foreign[0].frame.pose().is_none());
    assert!(
        tracks
            .table(0)
            .is_some_and(|(table, p)| table == 0 && p > 0.999)
    );
    for _ in 0..100 {
        next(&mut tracks, &mut []);
    }
    assert_eq!((tracks.table(0), tracks.count()), (None, 1));
    assert_eq!(next(&mut tracks, &mut [ball(0, [0.99, 0.01])]), [Some(1)]);
}

#[test]
fn exposures_of_several_tables_have_one_ball_each_and_are_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let run = |args: &[&str]| done(dir.path(), args);
    // The same flashes as a period and as times.
    let make = ["--strobe-ms", "0.9x3", "--frames", "3", "--seed", "11"];
    run(&[&["synth", "dots24", "-o", "e"][..], &make].concat());
    let strobed = &[
        "estimate",
        "--strobe-ms",
        "0,0.9,1.8",
        "--preset=golf",
        "e/images",
    ];
    let alone = run(&[&strobed[..], &["--table", "e/table.npz"]].concat());
    let text = run(&[
        &strobed[..],
        &[
            "--table",
            "dots20",
            "--table",
            "e/table.npz",
            "--table",
            "dots32",
        ],
        &["--overlay", "seen"],
    ]
    .concat());
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].ends_with(",ball,table,flash"), "{}", lines[0]);
    // Whatever one image alone may look like, all images of an exposure are of the ball that is there.
    let of_table = lines.iter().filter(|l| l.contains(",e/table.npz,")).count();
    let others = lines
        .iter()
        .filter(|l| l.contains(",dots20,") || l.contains(",dots32,"));
    assert_eq!(others.count(), 0, "{text}");
    let posed = |text: &str| text.lines().skip(1).filter(|l| !l.contains(",,,,")).count();
    assert_eq!(of_table, posed(&alone), "{text}\n{alone}");
    assert!(of_table >= 7, "{text}");
    for name in [
        "contact_sheet.png",
        "00000_frame-000000.png",
        "00002_frame-000002.png",
    ] {
        let picture = image::open(dir.path().join("seen").join(name)).unwrap();
        assert!(picture.width() >= 300, "{name}");
    }
}

#[test]
fn the_spin_of_one_of_several_balls_is_chosen_by_its_number() {
    let dir = tempfile::tempdir().unwrap();
    let run = |args: &[&str]| done(dir.path(), args);
    let row = |time: f64, rps: f64, ball: usize| {
        let half = std::f64::consts::PI * rps * time;
        format!(
            "f,{time},{},0,0,{},9,9,0.5,0.99,camera,{ball}\n",
            half.cos(),
            half.sin()
        )
    };
    let mut text =
        "frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence,camera_frame,ball\n"
            .to_owned();
    for k in 0..12 {
        let time = 0.002 * f64::from(k);
        text += &row(time, 20.0, 0);
        text += &row(time, 35.0, 1);
    }
    std::fs::write(dir.path().join("o.csv"), &text).unwrap();
    for (ball, rps) in [("0", 20.0), ("1", 35.0)] {
        let json: serde_json::Value =
            serde_json::from_str(&run(&["spin", "o.csv", "--ball", ball, "--json"])).unwrap();
        let found = json["rps"].as_f64().unwrap();
        assert!((found - rps).abs() < 0.01, "{ball}: {found}");
    }
    for (args, expected) in [
        (
            &[][..],
            "line 3: ball: expected one ball, found 1 after 0: the file holds balls 0 and 1 (--ball chooses one)",
        ),
        (&["--ball", "2"], "expected rows of ball 2, found none"),
        // A ball need not have a row for every frame, so that its rows are at no even intervals.
        (&["--ball", "1", "--fps", "500"], "--ball"),
    ] {
        let output = spindoe(dir.path(), &[&["spin", "o.csv"][..], args].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert!(words.contains(expected), "{words}");
    }
}

#[test]
fn the_spin_of_flashes_is_read_from_their_file() {
    let dir = tempfile::tempdir().unwrap();
    let turned = |time: f64, rps: f64| {
        let half = std::f64::consts::PI * rps * time;
        format!("{},0,0,{}", half.cos(), half.sin())
    };
    let header =
        "frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence,camera_frame,ball,flash\n";
    // Two exposures of four flashes each, and in each a ball that no flash of the likeliest hypothesis lit.
    let exposures = |starts_s: [f64; 2]| {
        let mut text = header.to_owned();
        for (name, start_s, rps) in [("a", starts_s[0], 40.0), ("b", starts_s[1], 60.0)] {
            for (flash, at_s) in [0.0, 0.0007, 0.0021, 0.0028].into_iter().enumerate() {
                let q = turned(at_s, rps);
                let time_s = start_s + at_s;
                text += &format!("{name},{time_s},{q},9,9,0.5,0.99,view,{flash},{flash}\n");
            }
            text += &format!("{name},,{},9,9,0.5,0.99,view,,\n", turned(0.3, rps));
        }
        text
    };
    let write = |text: &str| std::fs::write(dir.path().join("o.csv"), text).unwrap();
    let rps = |args: &[&str]| {
        let args = [&["spin", "o.csv", "--json", "--motion", "constant"], args].concat();
        let json: serde_json::Value = serde_json::from_str(&done(dir.path(), &args)).unwrap();
        json["rps"].as_f64().unwrap()
    };
    write(&exposures([0.0, 0.0]));
    for (name, expected) in [("a", 40.0), ("b", 60.0)] {
        let found = rps(&["--exposure", name]);
        assert!((found - expected).abs() < 0.1, "{name}: {found}");
    }
    for (args, expected) in [
        (
            &[][..],
            "line 7: expected a time later than the 0.0028 s before it, found 0 s: the file holds exposures a and b \
             (--exposure chooses one)",
        ),
        (
            &["--exposure", "c"],
            "frame: expected rows of c, found none",
        ),
    ] {
        let output = spindoe(dir.path(), &[&["spin", "o.csv"][..], args].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert!(words.contains(expected), "{words}");
    }
    // One exposure needs no choice.
    let one: Vec<String> = exposures([0.0, 0.0])
        .lines()
        .take(6)
        .map(String::from)
        .collect();
    write(&(one.join("\n") + "\n"));
    assert!((rps(&[]) - 40.0).abs() < 0.1);
}

#[test]
fn a_frame_without_a_ball_does_not_make_a_file_one_of_several_balls() {
    let dir = tempfile::tempdir().unwrap();
    let row = |k: i32| {
        let time = 0.002 * f64::from(k);
        let (s, c) = (std::f64::consts::PI * 20.0 * time).sin_cos();
        match k % 5 {
            0 => format!("f,{time},,,,,\n"),
            _ => format!("f,{time},{c},0,0,{s},3\n"),
        }
    };
    let rows: String = (0..16).map(row).collect();
    let text = format!("frame,time_s,qw,qx,qy,qz,ball\n{rows}");
    std::fs::write(dir.path().join("o.csv"), text).unwrap();
    let json = done(dir.path(), &["spin", "o.csv", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(
        (json["rps"].as_f64().unwrap() - 20.0).abs() < 0.01,
        "{json}"
    );
    assert_eq!(json["inliers"], 12, "{json}");
}

#[test]
fn a_picture_that_lacks_the_region_is_one_of_many() {
    let dir = tempfile::tempdir().unwrap();
    let run = |args: &[&str]| done(dir.path(), args);
    run(&["synth", "dots20", "-o", "s", "--frames", "4", "--seed", "2"]);
    let images = dir.path().join("s/images");
    let small = image::GrayImage::new(8, 8);
    small.save(images.join("small.png")).unwrap();
    let args = ["estimate", "--balls", "1", "--table", "dots20", "s/images"];
    let region = |roi: &str| spindoe(dir.path(), &[&args[..], &["--roi", roi]].concat());
    let output = region("0,0,40,40");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() != Some(2), "{words}");
    let said = words.lines().filter(|l| l.contains("small.png"));
    assert_eq!(said.count(), 1, "{words}");
    // None has it.
    let output = region("5000,0,40,40");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{words}");
    assert!(words.starts_with("spindoe: --roi: expected"), "{words}");
}

#[test]
fn a_launch_monitor_is_advised() {
    let dir = tempfile::tempdir().unwrap();
    let words = done(
        dir.path(),
        &[
            "advise",
            "dots20",
            "dots32",
            "--preset=golf",
            "--samples",
            "4",
        ],
    );
    assert!(
        words.contains("flashes at 0.000, 0.900, 2.100 ms"),
        "{words}"
    );
    assert!(words.contains("--ball-diameter-mm 42.67"), "{words}");
    let json: serde_json::Value = serde_json::from_str(&done(
        dir.path(),
        &[
            "advise",
            "dots32",
            "--preset=golf",
            "--samples",
            "3",
            "--strobe-ms",
            "1x2",
            "--json",
        ],
    ))
    .unwrap();
    let rates = &json["patterns"][0]["rates"];
    // Of three exposures two measure, since the other is of those that choose.
    assert_eq!(rates["right"]["trials"], 2, "{json}");
    assert_eq!(rates["posed"]["trials"], 4, "{json}");
    assert!(rates["posed"]["successes"].as_u64() >= Some(3), "{json}");
    for flag in [&["--fps", "100"][..], &["--camera", "dark"]] {
        let output = spindoe(dir.path(), &[&["advise", "--preset=golf"], flag].concat());
        assert_eq!(output.status.code(), Some(2));
    }
    let output = spindoe(dir.path(), &["advise", "--strobe-ms", "0,1"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_page_has_a_part_for_each_ball() {
    let dir = tempfile::tempdir().unwrap();
    let clip = "synth dots20 --also dots24 --frames 8 --seed 21 -o two";
    done(dir.path(), &clip.split(' ').collect::<Vec<_>>());
    let estimate = "estimate --table two/table.npz --table two/table2.npz --balls 2 two/images --json --report page.html";
    let json = done(dir.path(), &estimate.split(' ').collect::<Vec<_>>());
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let page = std::fs::read_to_string(dir.path().join("page.html")).unwrap();
    let data = page.split_once("id=\"data\">").unwrap().1;
    let data = data.split_once("</script>").unwrap().0;
    let data: serde_json::Value = serde_json::from_str(data).unwrap();
    let parts = data["content"]["balls"].as_array().unwrap();
    assert_eq!(parts.len(), 2);
    for (number, part) in parts.iter().enumerate() {
        assert_eq!(part["number"], number);
        let posed = |frames: &serde_json::Value, key: &str| {
            let frames = frames.as_array().unwrap().iter();
            frames.filter(|frame| !frame[key].is_null()).count()
        };
        assert_eq!(
            json["balls"][number]["identified"],
            posed(&part["frames"], "orientation_wxyz")
        );
        assert!(posed(&part["frames"], "picture") > 0);
    }
}
