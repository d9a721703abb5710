//! The synthetic ball spinner against closed forms, against slower ways to the same image, and through the files it writes.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{done, random_pattern, spindoe};
use nalgebra::Quaternion;
use spindoe::geometry::{Rotation, Vec3, angle_between};
use spindoe::pattern::Pattern;
use spindoe::synth::dataset::{frame_rng, frames, independent_frame};
use spindoe::synth::folder::{self, Origin, Truth};
use spindoe::synth::scene::{Background, Light};
use spindoe::synth::sensor::Sensor;
use spindoe::synth::surface::Spot;
use spindoe::synth::{Scene, SynthConfig};
use spindoe::vision::image::RgbImage;
use spindoe::vision::{BallCircle, Pixel};

const SENSOR: Sensor = Sensor {
    defocus_px: 0.0,
    gain: 1.0,
    read_noise: 0.0,
    shot_noise: 0.0,
    color_noise: 0.0,
    gamma: 1.0,
    has_color: true,
    jpeg_quality: None,
};

/// A ball of 60 px radius before black, evenly lit, at rest, through a perfect camera, with dots of 12 degrees.
fn plain_scene(pattern: &Pattern) -> Scene {
    let config = SynthConfig {
        stains: false,
        ..SynthConfig::default()
    };
    let mut scene = Scene::random(pattern, &config, &mut frame_rng(5, 0)).unwrap();
    scene.size = [140, 140];
    scene.circle = BallCircle {
        center: Pixel { u: 69.3, v: 70.6 },
        radius: 60.0,
    };
    scene.distance = None;
    scene.spin = Vec3::zeros();
    scene.shift_px = [0.0; 2];
    scene.surface.ball = [0.9; 3];
    scene.surface.ink = [0.0; 3];
    scene.surface.mark = None;
    let spot = |dot: &Vec3| Spot {
        middle: *dot,
        radius: 12f64.to_radians(),
        softness: 0.02,
        darkness: 1.0,
    };
    scene.surface.dots = pattern.dots().iter().map(|d| Some(spot(d))).collect();
    scene.light = Light {
        ambient: 1.0,
        diffuse: 0.0,
        from: Vec3::z(),
        gloss: 0.0,
        sharpness: 1.0,
    };
    scene.background = Background::plain([0.0; 3]);
    scene.sensor = SENSOR;
    scene
}

fn image(scene: &Scene) -> RgbImage {
    scene.render().unwrap().image
}

/// Six dots on the axes: far apart, so that each can be measured alone.
fn six() -> Pattern {
    let axes = [Vec3::x(), Vec3::y(), Vec3::z()];
    Pattern::new(axes.iter().flat_map(|a| [*a, -a]).collect()).unwrap()
}

#[test]
fn dots_are_caps_of_the_sphere() {
    // A cap whose edge has the cosine c about the unit vector d is bounded by a circle of radius sqrt(1 - c^2) about c d.
    // Seen along z it is an ellipse about c (d_x, d_y) of area pi (1 - c^2) d_z. A soft edge is an even mixture of such
    // caps between the outer and the inner cosine.
    let pattern = six();
    for seed in 0..4 {
        let mut scene = plain_scene(&pattern);
        scene.rotation = spindoe::geometry::random_rotation(&mut frame_rng(8, seed));
        let drawn = image(&scene);
        let dots = std::mem::take(&mut scene.surface.dots);
        let blank = image(&scene);
        let mut measured = 0;
        for spot in dots.iter().flatten() {
            let d = scene.rotation * spot.middle;
            let [outer, inner] = [spot.radius + spot.softness, spot.radius - spot.softness];
            if d.z < outer.sin() {
                continue;
            }
            let (low, high) = (outer.cos(), inner.cos());
            let area_of = |c: f64| c - c.powi(3) / 3.0;
            let moment_of = |c: f64| c * c / 2.0 - c.powi(4) / 4.0;
            let area = (area_of(high) - area_of(low)) / (high - low);
            let pull = (moment_of(high) - moment_of(low)) / (area_of(high) - area_of(low));
            let r = scene.circle.radius;
            let expected = [
                scene.circle.center.u + r * pull * d.x,
                scene.circle.center.v - r * pull * d.y,
            ];
            let (mut ink, mut at) = (0.0, [0.0; 2]);
            for (i, (with, without)) in drawn.values().iter().zip(blank.values()).enumerate() {
                let (u, v) = ((i % 140) as f64, (i / 140) as f64);
                let reach = r * (outer.sin() + 0.1);
                if (u - expected[0]).hypot(v - expected[1]) < reach && without[0] > 0.3 {
                    let share = 1.0 - f64::from(with[0] / without[0]);
                    ink += share;
                    at = [at[0] + share * u, at[1] + share * v];
                }
            }
            let off = (at[0] / ink - expected[0]).hypot(at[1] / ink - expected[1]);
            assert!(off < 0.1, "a dot at {d:?} is off by {off} px");
            let full = std::f64::consts::PI * r * r * area * d.z;
            assert!(
                (ink / full - 1.0).abs() < 0.05,
                "{ink} px^2, expected {full}"
            );
            measured += 1;
        }
        assert!(measured >= 2, "only {measured} dots were measured");
    }
}

#[test]
fn truth_says_where_dots_are() {
    let pattern = six();
    let mut scene = plain_scene(&pattern);
    scene.rotation = Rotation::from_euler_angles(0.5, -0.4, 0.9);
    let found = scene.render().unwrap();
    assert_eq!(found.dots.len(), 3);
    for dot in &found.dots {
        let d = scene.rotation * pattern.dots()[dot.index];
        assert!(d.z > 0.0 && (d - dot.direction).norm() < 1e-12);
        assert!((dot.pixel.u - (69.3 + 60.0 * d.x)).abs() < 1e-9);
        assert!((dot.pixel.v - (70.6 - 60.0 * d.y)).abs() < 1e-9);
        assert!((dot.contrast - 1.0).abs() < 1e-6, "{dot:?}");
    }
}

#[test]
fn the_outline_is_the_circle() {
    for distance in [None, Some(6.0)] {
        let mut scene = plain_scene(&six());
        scene.distance = distance;
        let dark = image(&scene);
        scene.background = Background::plain([1.0; 3]);
        let bright = image(&scene);
        let (mut area, mut at) = (0.0, [0.0; 2]);
        for (i, (b, d)) in bright.values().iter().zip(dark.values()).enumerate() {
            // What the background does not reach is the ball.
            let cover = 1.0 - f64::from(b[1] - d[1]);
            area += cover;
            at[0] += cover * (i % 140) as f64;
            at[1] += cover * (i / 140) as f64;
        }
        let radius = (area / std::f64::consts::PI).sqrt();
        assert!((radius - 60.0).abs() < 0.03, "{distance:?}: {radius} px");
        let off = (at[0] / area - 69.3).hypot(at[1] / area - 70.6);
        assert!(off < 0.03, "{distance:?}: off by {off} px");
    }
}

#[test]
fn perspective_is_that_of_a_pinhole() {
    // A pinhole at the distance D sees the point p of the unit ball under the tangent p_x / (D - p_z), and the outline
    // under 1 / sqrt(D^2 - 1).
    let mut scene = plain_scene(&six());
    scene.distance = Some(4.0);
    scene.rotation = Rotation::from_euler_angles(0.3, 0.5, 0.1);
    let found = scene.render().unwrap();
    assert!(!found.dots.is_empty());
    for dot in &found.dots {
        let p = dot.direction;
        let focal = 60.0 * 15f64.sqrt();
        assert!((dot.pixel.u - (69.3 + focal * p.x / (4.0 - p.z))).abs() < 1e-6);
        assert!((dot.pixel.v - (70.6 - focal * p.y / (4.0 - p.z))).abs() < 1e-6);
        assert!(p.z > 0.25, "hidden behind the horizon");
    }
}

#[test]
fn blur_is_the_mean_over_the_exposure() {
    let mut scene = plain_scene(&random_pattern(20, 3));
    for spot in scene.surface.dots.iter_mut().flatten() {
        spot.radius = 0.08;
    }
    scene.rotation = Rotation::from_euler_angles(0.2, 0.1, 0.4);
    let sharp = image(&scene);
    scene.spin = Vec3::new(120.0, 150.0, -80.0);
    scene.exposure_s = 1e-3;
    scene.shift_px = [2.0, -4.0];
    let blurred = image(&scene);
    let instants = 101;
    let mut mean = vec![0.0; 140 * 140];
    for k in 0..instants {
        let t = (k as f64 + 0.5) / instants as f64 - 0.5;
        let mut still = scene.clone();
        (still.spin, still.shift_px) = (Vec3::zeros(), [0.0; 2]);
        still.rotation = Rotation::from_scaled_axis(scene.spin * (t * 1e-3)) * scene.rotation;
        still.circle.center.u += 2.0 * t;
        still.circle.center.v -= 4.0 * t;
        for (m, c) in mean.iter_mut().zip(image(&still).values()) {
            *m += f64::from(c[0]) / instants as f64;
        }
    }
    let rms = |other: &RgbImage| {
        let pairs = mean.iter().zip(other.values());
        let squares: f64 = pairs.map(|(m, c)| (m - f64::from(c[0])).powi(2)).sum();
        (squares / mean.len() as f64).sqrt()
    };
    assert!(rms(&blurred) < 0.01, "off by {}", rms(&blurred));
    assert!(rms(&sharp) > 0.05, "hardly blurred: {}", rms(&sharp));
}

#[test]
fn hands_err_as_much_as_asked() {
    let pattern = random_pattern(20, 1);
    let config = SynthConfig {
        misplacement_rad: [0.03; 2],
        left_out: 0.1,
        ..SynthConfig::default()
    };
    let (mut squares, mut drawn) = (0.0, 0);
    for k in 0..250 {
        let scene = Scene::random(&pattern, &config, &mut frame_rng(2, k)).unwrap();
        for (spot, dot) in scene.surface.dots.iter().zip(pattern.dots()) {
            if let Some(spot) = spot {
                squares += angle_between(&spot.middle, dot).powi(2);
                drawn += 1;
            }
        }
    }
    // 5000 dots: four standard deviations are 0.085 of 4500, and 6 % of the mean square of two axes.
    assert!((4415..=4585).contains(&drawn), "{drawn} drawn of 5000");
    let sigma = (squares / f64::from(drawn) / 2.0).sqrt();
    assert!((sigma / 0.03 - 1.0).abs() < 0.03, "{sigma} rad per axis");
}

#[test]
fn noise_has_the_stated_variance() {
    let sensor = Sensor {
        gain: 0.5,
        read_noise: 0.02,
        shot_noise: 0.002,
        ..SENSOR
    };
    let light = vec![[0.9f32; 3]; 100 * 100];
    let image = sensor.take(&light, [100, 100], 4).unwrap();
    let values: Vec<f64> = image.values().iter().map(|c| f64::from(c[2])).collect();
    let mean = values.iter().sum::<f64>() / 1e4;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 1e4;
    // Rounding to 255 steps adds 1/12 of a step squared.
    let expected = 0.02f64.powi(2) + 0.002 * 0.45 + 1.0 / 12.0 / 255.0 / 255.0;
    assert!(
        (mean - 0.45).abs() < 4.0 * (expected / 1e4).sqrt(),
        "{mean}"
    );
    assert!(
        (variance / expected - 1.0).abs() < 0.06,
        "{variance}, expected {expected}"
    );
}

/// All files below a folder, by path.
fn contents(dir: &Path, root: &Path, all: &mut BTreeMap<String, Vec<u8>>) {
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            contents(&path, root, all);
        } else {
            let name = path.strip_prefix(root).unwrap().display().to_string();
            all.insert(name, std::fs::read(&path).unwrap());
        }
    }
}

#[test]
fn threads_do_not_matter() {
    let pattern = random_pattern(12, 4);
    let config = SynthConfig {
        size_px: [40, 60],
        ..SynthConfig::default()
    };
    let origin = Origin {
        seed: 7,
        pattern_sha256: pattern.sha256(),
        pattern: pattern.dots().iter().map(|d| (*d).into()).collect(),
        config: config.clone(),
        sequence: None,
    };
    let written = [1, 2].map(|threads| {
        let dir = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let draw = |k| independent_frame(&pattern, &config, 7, k);
        pool.build()
            .unwrap()
            .install(|| folder::write(dir.path(), origin.clone(), 20, draw, |_| {}))
            .unwrap();
        let mut all = BTreeMap::new();
        contents(dir.path(), dir.path(), &mut all);
        // The index names the folder, which is another each time.
        let index = String::from_utf8(all.remove("index.csv").unwrap()).unwrap();
        let index = index.replace(&dir.path().display().to_string(), "");
        (all, index)
    });
    assert_eq!(written[0].0.len(), 22);
    assert!(written[0] == written[1], "files differ");
    let again = frames(&pattern, &config, 7, 3).unwrap();
    let other = frames(&pattern, &config, 8, 3).unwrap();
    assert_eq!(
        again[2],
        independent_frame(&pattern, &config, 7, 2).unwrap()
    );
    assert!(again[2].image != other[2].image);
}

/// Twelve dots in a folder of its own.
fn with_pattern() -> (tempfile::TempDir, Pattern) {
    let dir = tempfile::tempdir().unwrap();
    let pattern = random_pattern(12, 6);
    pattern.write_csv(&dir.path().join("pattern.csv")).unwrap();
    (dir, pattern)
}

#[test]
fn the_index_suits_the_authors_reader() {
    let (dir, pattern) = with_pattern();
    let words = done(
        dir.path(),
        &[
            "synth",
            "pattern.csv",
            "--out",
            "set",
            "--frames",
            "30",
            "--seed",
            "3",
            "--max-size",
            "80",
        ],
    );
    assert!(words.contains("30 frames"), "{words}");
    let truth: Truth =
        serde_json::from_slice(&std::fs::read(dir.path().join("set/truth.json")).unwrap()).unwrap();
    assert_eq!((truth.format_version, truth.origin.seed), (1, 3));
    assert_eq!(truth.origin.pattern_sha256, pattern.sha256());
    let text = std::fs::read_to_string(dir.path().join("set/index.csv")).unwrap();
    // DotDataset: columns 1 to 4 the quaternion, from 5 on pairs x, y until the row ends.
    for (line, frame) in text.lines().zip(&truth.frames) {
        let fields: Vec<&str> = line.split(',').collect();
        let numbers: Vec<f64> = fields[1..].iter().map(|f| f.parse().unwrap()).collect();
        assert!(
            numbers.len() >= 6 && numbers.len().is_multiple_of(2),
            "{line}"
        );
        let image = RgbImage::read(&dir.path().join(fields[0])).unwrap();
        let [width, height] = frame.size;
        assert_eq!((image.width(), image.height()), (width, height));
        let q = Quaternion::new(numbers[0], numbers[1], numbers[2], numbers[3]);
        assert!((q.norm() - 1.0).abs() < 1e-12);
        let rotation = Rotation::from_quaternion(q);
        for (xy, dot) in numbers[4..]
            .chunks(2)
            .zip(frame.dots.iter().filter(|d| d.visible))
        {
            assert!((xy[0] - dot.pixel.u).abs() < 1e-3 && (xy[1] - dot.pixel.v).abs() < 1e-3);
            assert!(
                (-0.5..width as f64).contains(&xy[0]) && (-0.5..height as f64).contains(&xy[1])
            );
            // Five deviations of the clumsiest hand.
            let meant = rotation * pattern.dots()[dot.index];
            assert!(angle_between(&meant, &Vec3::from(dot.direction)) < 5.0 * 0.03 * 2f64.sqrt());
            if frame.distance.is_none() {
                let u = frame.center.u + frame.radius_px * meant.x;
                let v = frame.center.v - frame.radius_px * meant.y;
                let off = (u - xy[0]).hypot(v - xy[1]);
                assert!(off < 0.2 * frame.radius_px, "off by {off} px: {line}");
            }
        }
    }
    assert_eq!(text.lines().count(), 30);
    assert!(
        RgbImage::read(&dir.path().join("set/contact_sheet.png"))
            .unwrap()
            .width()
            > 900
    );
}

#[test]
fn a_sequence_tells_its_spin() {
    let (dir, _) = with_pattern();
    done(dir.path(), &["table", "pattern.csv", "-o", "table.npz"]);
    let text = done(
        dir.path(),
        &[
            "synth",
            "table.npz",
            "--out",
            "flight",
            "--sequence",
            "--frames",
            "8",
            "--fps",
            "400",
            "--rps",
            "60",
            "--axis",
            "1,-2,0.5",
            "--size",
            "64",
            "--json",
        ],
    );
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!((summary["rps"].as_f64().unwrap() - 60.0).abs() < 1e-9);
    let expected = Vec3::new(1.0, -2.0, 0.5).normalize() * (60.0 * std::f64::consts::TAU);
    let text = done(dir.path(), &["spin", "flight/orientations.csv", "--json"]);
    let spin: serde_json::Value = serde_json::from_str(&text).unwrap();
    let found = Vec3::from_fn(|i, _| spin["spin_rad_s"][i].as_f64().unwrap());
    assert!(
        (found - expected).norm() < 1e-4 * expected.norm(),
        "{found:?}"
    );
    // Stems are nanoseconds: the SpinDOE authors' get_time.
    let mut stems: Vec<u64> = std::fs::read_dir(dir.path().join("flight/images"))
        .unwrap()
        .map(|e| {
            e.unwrap()
                .path()
                .file_stem()
                .unwrap()
                .to_str()
                .unwrap()
                .parse()
                .unwrap()
        })
        .collect();
    stems.sort_unstable();
    assert!(
        stems.windows(2).all(|w| w[1] - w[0] == 2_500_000),
        "{stems:?}"
    );
}

#[test]
fn refuses_what_it_cannot_use() {
    let (dir, _) = with_pattern();
    let at = dir.path();
    std::fs::write(at.join("bad.json"), "{\"spin\": 3}").unwrap();
    std::fs::create_dir_all(at.join("taken/images")).unwrap();
    let cases: [(&[&str], &str); 9] = [
        (&["nothing.csv", "--out", "o"], "nothing.csv"),
        (&["pattern.csv", "--out", "o", "--frames", "0"], "--frames"),
        (&["pattern.csv", "--out", "taken"], "taken"),
        (&["pattern.csv", "--out", "a,b"], "comma"),
        (
            &["pattern.csv", "--out", "o", "--config", "bad.json"],
            "bad.json",
        ),
        (&["pattern.csv", "--out", "o", "--rps", "fast"], "--rps"),
        (&["pattern.csv", "--out", "o", "--rps", "9,3"], "rps"),
        (
            &["pattern.csv", "--out", "o", "--sequence", "--fps", "0"],
            "fps",
        ),
        (
            &[
                "pattern.csv",
                "--out",
                "o",
                "--sequence",
                "--exposure-ms",
                "9",
            ],
            "exposure",
        ),
    ];
    for (arguments, expected) in cases {
        let output = spindoe(at, &[&["synth"], arguments].concat());
        let words = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {words}");
        assert_eq!(words.trim_end().lines().count(), 1, "{words}");
        assert!(
            words.contains(expected),
            "expected \"{expected}\" in: {words}"
        );
    }
    assert!(!at.join("o/index.csv").exists());
}
