//! Frames with several images of balls: their light and truth against closed forms.

use std::f64::consts::PI;

use crate::common::{done, random_pattern};
use spindoe::geometry::{Rotation, Vec3};
use spindoe::synth::background::Background;
use spindoe::synth::dataset::{ClipConfig, Sequence, frame_rng};
use spindoe::synth::folder::Truth;
use spindoe::synth::sensor::Sensor;
use spindoe::synth::several::StrobeConfig;
use spindoe::synth::{Scene, SynthConfig};

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
            assert_eq!((other.of.ball, both.area_visible > 0.999), (1, true));
            for (i, share) in front.mask.iter().enumerate() {
                if *share == 255 {
                    assert_eq!(both.image.values()[i], front.image.values()[i]);
                }
            }
            let (a, b) = (both.circle, other.circle);
            let d = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
            let seen = 1.0 - lens(a.radius, b.radius, d) / (PI * b.radius * b.radius);
            // Balls move by up to a pixel during the exposure.
            assert!((other.area_visible - seen).abs() < 0.03, "{seen} {other:?}");
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
