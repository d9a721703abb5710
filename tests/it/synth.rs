//! The synthetic ball spinner against closed forms, against slower ways to the same image, and through the files it writes.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{done, random_pattern, spindoe};
use nalgebra::Quaternion;
use spindoe::geometry::{Rotation, Vec3, angle_between};
use spindoe::image::RgbImage;
use spindoe::pattern::Pattern;
use spindoe::synth::background::Background;
use spindoe::synth::compression::Compression;
use spindoe::synth::dataset::{ClipConfig, SynthSequence, frame_rng, frames, independent_frame};
use spindoe::synth::folder::{self, Masks, Origin, Truth};
use spindoe::synth::light::{Lamp, Light, Shadow};
use spindoe::synth::pen::Spot;
use spindoe::synth::sensor::Sensor;
use spindoe::synth::{Rendering, Scene, SynthConfig, SynthKind};
use spindoe::vision::{BallCircle, Camera, Intrinsics, Pixel};

/// A ball of 60 px radius before black, evenly lit, at rest, through a perfect camera, with dots of 12 degrees.
fn plain_scene(pattern: &Pattern) -> Scene {
    let config = SynthConfig {
        occlusion_share: 0.0,
        ..SynthConfig::default().unprinted()
    };
    let mut scene = Scene::random(pattern, &config, &mut frame_rng(5, 0)).unwrap();
    scene.size = [140, 140];
    scene.circle = BallCircle::new(Pixel { u: 69.3, v: 70.6 }, 60.0);
    scene.camera = Camera::Orthographic;
    scene.spin = Vec3::zeros();
    scene.shift_px = [0.0; 2];
    scene.surface.ball = [0.9; 3];
    scene.surface.ink = [0.0; 3];
    let spot = |dot: &Vec3| Spot::round(*dot, 12f64.to_radians(), 0.02, 1.0);
    scene.surface.dots = pattern.dots().iter().map(|d| Some(spot(d))).collect();
    scene.light = Light::even([1.0; 3]);
    scene.background = Background::plain([0.0; 3]);
    scene.sensor = Sensor::PERFECT;
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
        if let Some(distance) = distance {
            scene = scene.with_camera_at(distance);
        }
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
    let mut scene = plain_scene(&six()).with_camera_at(4.0);
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
fn placement_errors_have_the_stated_deviation() {
    let pattern = random_pattern(20, 1);
    let config = SynthConfig {
        placement_sigma_rad: [0.03; 2],
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
        ..Sensor::PERFECT
    };
    let light = vec![[0.9f32; 3]; 100 * 100];
    let image = sensor.take(light, [100, 100], 4).unwrap();
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
        strobe: None,
    };
    let written = [1, 2].map(|threads| {
        let dir = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let draw = |k| independent_frame(&pattern, &config, 7, k);
        pool.build()
            .unwrap()
            .install(|| folder::write(dir.path(), origin.clone(), 20, Masks::Write, draw, |_| {}))
            .unwrap();
        let mut all = BTreeMap::new();
        contents(dir.path(), dir.path(), &mut all);
        all
    });
    // Images, masks, the index, the truth, the contact sheet.
    assert_eq!(written[0].len(), 43);
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
            "--as=images",
            "--output",
            "set",
            "--frames",
            "30",
            "--seed",
            "3",
            "--config",
            "size_px=32,80",
        ],
    );
    assert!(words.contains("30 frames"), "{words}");
    let truth: Truth =
        serde_json::from_slice(&std::fs::read(dir.path().join("set/truth.json")).unwrap()).unwrap();
    assert_eq!((truth.format_version, truth.origin.seed), (2, 3));
    assert_eq!(truth.origin.pattern_sha256, pattern.sha256());
    let text = std::fs::read_to_string(dir.path().join("set/index.csv")).unwrap();
    // DotDataset: columns 1 to 4 the quaternion, from 5 on pairs x, y until the row ends.
    let indexed = truth
        .frames
        .iter()
        .filter(|f| f.dots.iter().any(|d| d.visible));
    for (line, frame) in text.lines().zip(indexed) {
        let fields: Vec<&str> = line.split(',').collect();
        let numbers: Vec<f64> = fields[1..].iter().map(|f| f.parse().unwrap()).collect();
        assert!(
            numbers.len() >= 6 && numbers.len().is_multiple_of(2),
            "{line}"
        );
        let image = RgbImage::read(&dir.path().join("set").join(fields[0])).unwrap();
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
    let with_dots = truth
        .frames
        .iter()
        .filter(|f| f.dots.iter().any(|d| d.visible));
    assert_eq!(text.lines().count(), with_dots.count());
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
            "--output",
            "flight",
            "--as=clip",
            "--frames",
            "8",
            "--fps",
            "400",
            "--rps",
            "60",
            "--axis",
            "1,-2,0.5",
            "--preset=all",
            "--config",
            "size_px=64",
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
    let cases: [(&[&str], &str); 14] = [
        (&["nothing.csv", "--output", "o"], "nothing.csv"),
        (&["pattern.csv", "--output", "o", "--frames", "0"], "frames"),
        (&["pattern.csv", "--output", "taken"], "taken"),
        (
            &["pattern.csv", "--output", "o", "--config=kind=cube"],
            "--kind",
        ),
        (
            &["pattern.csv", "--output", "o", "--preset", "best"],
            "best: cannot be read",
        ),
        (
            &["pattern.csv", "--output", "o", "--image-size", "1280"],
            "--image-size",
        ),
        (
            &["pattern.csv", "--output", "o", "--image-size", "8x8"],
            "16 to 8192",
        ),
        (
            &["pattern.csv", "--output", "o", "--ball-px", "3"],
            "8 to 4096",
        ),
        (
            &[
                "pattern.csv",
                "--output",
                "o",
                "--config",
                "camera_distance_radii=1,9",
            ],
            "1.5 to 1000000",
        ),
        (
            &["pattern.csv", "--output", "o", "--preset", "bad.json"],
            "bad.json",
        ),
        (&["pattern.csv", "--output", "o", "--rps", "fast"], "--rps"),
        (&["pattern.csv", "--output", "o", "--rps", "9,3"], "rps"),
        (
            &["pattern.csv", "--output", "o", "--as=clip", "--fps", "0"],
            "fps",
        ),
        (
            &[
                "pattern.csv",
                "--output",
                "o",
                "--as=clip",
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

/// The light and the unit ball by a ray of its own: the pinhole at the origin, the ball's center at `center`, camera frame (x
/// right, y up, z towards the camera). None where the ray misses.
fn cast(k: &Intrinsics, center: &Vec3, u: f64, v: f64) -> Option<Vec3> {
    let ray = Vec3::new((u - k.cx) / k.fx, -(v - k.cy) / k.fy, -1.0);
    // |s ray - center|^2 = 1
    let (a, b, c) = (
        ray.dot(&ray),
        -2.0 * ray.dot(center),
        center.dot(center) - 1.0,
    );
    let root = b * b - 4.0 * a * c;
    (root >= 0.0).then(|| ray * ((-b - root.sqrt()) / (2.0 * a)) - center)
}

/// Where the ball's center lies, from what the truth says: its pixel and its distance.
fn center_of(frame: &Rendering) -> (Intrinsics, Vec3) {
    let Camera::Perspective(k) = frame.camera else {
        panic!("a pinhole was asked for");
    };
    let Pixel { u, v } = frame.center;
    let ray = Vec3::new((u - k.cx) / k.fx, -(v - k.cy) / k.fy, -1.0);
    (k, ray.normalize() * frame.distance.unwrap())
}

#[test]
fn truth_agrees_with_rays_cast_by_hand() {
    let pattern = random_pattern(20, 9);
    let config = SynthConfig {
        parallel_share: 0.0,
        cut_share: 0.0,
        occlusion_share: 0.0,
        cords_share: 0.0,
        camera_distance_radii: [3.0, 30.0],
        max_off_axis_rad: 0.6,
        ..SynthConfig::default()
    };
    let mut near_the_edge = 0;
    for k in 0..60 {
        let mut scene = Scene::random(&pattern, &config, &mut frame_rng(21, k)).unwrap();
        (scene.spin, scene.shift_px) = (Vec3::zeros(), [0.0; 2]);
        let frame = scene.render().unwrap();
        let (camera, center) = center_of(&frame);
        let hit = |p: Pixel| cast(&camera, &center, p.u, p.v);
        // The outline: within, every ray meets the ball; beyond, none does.
        let grown = |t: f64, factor: f64| {
            let Pixel { u, v } = frame.outline.point(t);
            let Pixel { u: a, v: b } = frame.outline.center;
            Pixel {
                u: a + factor * (u - a),
                v: b + factor * (v - b),
            }
        };
        for i in 0..48 {
            let t = f64::from(i) * std::f64::consts::TAU / 48.0;
            assert!(hit(grown(t, 1.0 - 1e-6)).is_some(), "frame {k}: {t} rad");
            assert!(hit(grown(t, 1.0 + 1e-6)).is_none(), "frame {k}: {t} rad");
        }
        // The mask: whole pixels of the ball and of what is behind.
        let [width, _] = scene.size;
        for (i, shown) in frame.mask.iter().enumerate() {
            let (u, v) = ((i % width) as f64, (i / width) as f64);
            let corners = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];
            let met = corners.map(|(a, b)| cast(&camera, &center, u + a, v + b).is_some());
            if met == [true; 4] {
                assert_eq!(*shown, 255, "frame {k}: ({u}, {v})");
            }
        }
        // The dots: the ray through each pixel meets the ball at its middle; all others are on the far side.
        let mut listed = vec![false; pattern.len()];
        for dot in &frame.dots {
            listed[dot.index] = true;
            let spot = scene.surface.dots[dot.index].unwrap();
            let n = scene.rotation * spot.middle;
            let met = hit(dot.pixel).expect("a dot on the ball");
            assert!((met - n).norm() < 1e-5, "frame {k}: {met:?}, {n:?}");
            let cosine = n.dot(&(-center - n).normalize());
            assert!((dot.facing - cosine).abs() < 1e-9);
            near_the_edge += usize::from(cosine < 0.12);
            assert!(cosine >= 0.12 || !dot.is_visible(), "edge-on: {dot:?}");
            // The view frame's z leads from the ball's center to the camera.
            assert!((dot.direction.z - n.dot(&-center.normalize())).abs() < 1e-9);
        }
        for (index, spot) in scene.surface.dots.iter().enumerate() {
            if let (Some(spot), false) = (spot, listed[index]) {
                let n = scene.rotation * spot.middle;
                assert!(
                    n.dot(&(-center - n)) <= 0.0,
                    "frame {k}: dot {index} is in sight"
                );
            }
        }
        let turned = frame.rotation.inverse() * Vec3::z();
        let towards = frame.camera_rotation.inverse() * -center.normalize();
        assert!((turned - towards).norm() < 1e-9);
    }
    assert!(
        near_the_edge > 10,
        "only {near_the_edge} dots near the horizon"
    );
}

#[test]
fn nothing_moves_in_an_exposure_of_no_time() {
    let pattern = random_pattern(20, 2);
    let config = SynthConfig::default();
    let sequence = |exposure_s, drift| ClipConfig {
        fps: 100.0,
        spin: Some([200.0, 100.0, 50.0]),
        exposure_s: Some(exposure_s),
        drift_px: Some(drift),
        ..ClipConfig::default()
    };
    let frame = |exposure_s, drift| {
        SynthSequence::random(&pattern, &config, &sequence(exposure_s, drift), 4, 10)
            .unwrap()
            .frame(5)
            .unwrap()
    };
    let (still, fast) = (frame(0.0, [0.0; 2]), frame(0.0, [40.0, 30.0]));
    assert_eq!(still.truth.blur_px, 0.0);
    // At half of the sequence the ball is where it stood: not a pixel differs.
    assert_eq!(still.image, fast.image);
    // 50 px in ten frames of 10 ms are 5 px in an exposure of 10 ms, besides the arc.
    let open = frame(0.01, [40.0, 30.0]);
    let arc_px = open.truth.blur_px - 5.0;
    let turned_only = frame(0.01, [0.0; 2]).truth.blur_px;
    assert!(turned_only > 0.0 && (arc_px - turned_only).abs() < 1e-9);
}

#[test]
fn a_rolling_shutter_exposes_each_row_at_its_own_time() {
    let pattern = random_pattern(20, 2);
    let mut rolling = plain_scene(&pattern);
    rolling.circle.center.v = 70.0;
    rolling.exposure_s = 0.0;
    let still = rolling.clone();
    // From the first row to the last the ball turns by 80 degrees.
    rolling.row_s = 1e-5;
    rolling.spin = Vec3::new(500.0, -300.0, 800.0);
    let rolled = image(&rolling);
    for row in [12, 40, 69, 70, 71, 95, 128] {
        let late_s = 1e-5 * (row as f64 - 70.0);
        let mut then = still.clone();
        then.rotation = Rotation::from_scaled_axis(rolling.spin * late_s) * then.rotation;
        let width = rolled.width();
        let of_row = |image: &RgbImage| image.values()[row * width..][..width].to_vec();
        assert_eq!(of_row(&rolled), of_row(&image(&then)), "row {row}");
        assert_eq!(of_row(&rolled) == of_row(&image(&still)), row == 70);
    }
    // A ball at rest that moves by a pixel a row: each row is shifted by one more.
    rolling.spin = Vec3::zeros();
    rolling.velocity_px_s = [1e5, 0.0];
    let (rolled, stood) = (image(&rolling), image(&still));
    for (row, shift) in [(30usize, -40isize), (70, 0), (75, 5)] {
        for u in 45..95usize {
            let from = (u as isize - shift) as usize;
            let at = |image: &RgbImage, u: usize| image.values()[row * 140 + u];
            assert_eq!(at(&rolled, u), at(&stood, from), "row {row}, column {u}");
        }
    }
}

#[test]
fn the_truth_of_a_rolling_shutter_is_that_of_each_row() {
    let pattern = random_pattern(20, 2);
    let (fps, readout_s, rows) = (100.0, 0.008, 400.0);
    let clip = ClipConfig {
        fps,
        spin: Some([100.0, -200.0, 150.0]),
        exposure_s: Some(0.0),
        drift_px: Some([20.0, 60.0]),
        readout_s,
    };
    let config = SynthConfig {
        image_px: Some([300, 400]),
        parallel_share: 1.0,
        ..SynthConfig::good().as_designed()
    };
    let sequence = SynthSequence::random(&pattern, &config, &clip, 4, 10).unwrap();
    let global = ClipConfig {
        readout_s: 0.0,
        ..clip
    };
    let global = SynthSequence::random(&pattern, &config, &global, 4, 10).unwrap();
    let row_s = readout_s / (rows - 1.0);
    let (spin, start) = (
        Vec3::new(100.0, -200.0, 150.0),
        global.frame(0).unwrap().truth,
    );
    let mut dots = 0;
    for k in 0..10 {
        let truth = sequence.frame(k).unwrap().truth;
        let seen_s = 1e-9 * sequence.scene(k).1 as f64 + row_s * truth.ball_center.v;
        assert!((truth.time_s.unwrap() - seen_s).abs() < 1e-9);
        // Center and orientation are those of the global shutter at that time.
        let elapsed = seen_s - start.time_s.unwrap();
        let v = start.ball_center.v + 6.0 * fps * elapsed;
        assert!((truth.ball_center.v - v).abs() < 1e-6, "frame {k}");
        let expected = Rotation::from_scaled_axis(spin * elapsed) * start.camera_orientation();
        assert!(expected.angle_to(&truth.camera_orientation()) < 1e-6);
        for dot in &truth.dots {
            let late_s = row_s * (dot.pixel.v - truth.ball_center.v);
            let turn = Rotation::from_scaled_axis(spin * late_s) * truth.camera_orientation();
            let q = turn * pattern.dots()[dot.index];
            let u = truth.ball_center.u + 2.0 * fps * late_s + truth.radius_px * q.x;
            let v = truth.ball_center.v + 6.0 * fps * late_s - truth.radius_px * q.y;
            assert!((dot.pixel.u - u).hypot(dot.pixel.v - v) < 1e-6);
            dots += 1;
        }
    }
    assert!(dots > 60, "{dots}");
}

#[test]
fn the_scene_is_the_same_for_every_pattern() {
    let config = SynthConfig::default();
    for k in 0..20 {
        let scene =
            |dots| Scene::random(&random_pattern(dots, 3), &config, &mut frame_rng(11, k)).unwrap();
        let (few, mut many) = (scene(8), scene(32));
        // Other placement errors, too, change the dots only.
        assert_eq!(many.surface.dots.len(), 32);
        many.surface.dots.clone_from(&few.surface.dots);
        assert!(few == many, "frame {k}");
    }
    let other = Scene::random(&random_pattern(8, 3), &config, &mut frame_rng(11, 20)).unwrap();
    let again = Scene::random(&random_pattern(8, 3), &config, &mut frame_rng(11, 21)).unwrap();
    assert!(other.rotation != again.rotation && other.noise_seed != again.noise_seed);
}

#[test]
fn negatives_have_no_dots_to_find() {
    let pattern = random_pattern(20, 3);
    for kind in SynthKind::ALL {
        let config = SynthConfig {
            kind,
            size_px: [50, 60],
            ..SynthConfig::default()
        };
        let frames = frames(&pattern, &config, 3, 8).unwrap();
        let dots: usize = frames.iter().map(|f| f.truth.dots.len()).sum();
        assert_eq!(dots > 0, kind.has_pattern(), "{kind:?}: {dots} dots");
        assert!(frames.iter().all(|f| f.truth.kind == kind));
        let shown = frames.iter().any(|f| f.mask.iter().any(|m| *m > 0));
        assert_eq!(shown, kind.has_ball(), "{kind:?}");
    }
}

#[test]
fn what_hides_the_ball_is_counted() {
    let pattern = random_pattern(20, 3);
    let open = SynthConfig {
        occlusion_share: 0.0,
        cords_share: 0.0,
        cut_share: 0.0,
        ..SynthConfig::default()
    };
    let hidden = SynthConfig {
        occlusion_share: 1.0,
        cut_share: 1.0,
        ..SynthConfig::default()
    };
    let (mut occluded, mut outside) = (0, 0);
    for k in 0..60 {
        let render = |config| {
            let scene = Scene::random(&pattern, config, &mut frame_rng(12, k)).unwrap();
            (scene.render().unwrap(), scene.size)
        };
        let (frame, [width, height]) = render(&hidden);
        assert!(
            (0.0..1.0).contains(&frame.rim_visible),
            "{}",
            frame.rim_visible
        );
        assert!(frame.area_visible <= 1.0);
        for dot in &frame.dots {
            let Pixel { u, v } = dot.pixel;
            let inside =
                u >= -0.5 && v >= -0.5 && u <= width as f64 - 0.5 && v <= height as f64 - 0.5;
            assert_eq!(dot.inside, inside);
            assert!(!dot.is_visible() || (inside && !dot.occluded));
            outside += usize::from(!dot.inside);
            occluded += usize::from(dot.occluded);
            if inside && frame.blur_px < 1.0 {
                // The mask is the share of the pixel that shows the ball.
                let at = v.round().clamp(0.0, height as f64 - 1.0) as usize * width
                    + u.round().clamp(0.0, width as f64 - 1.0) as usize;
                assert!(!dot.occluded || frame.mask[at] < 255, "frame {k}: {dot:?}");
            }
        }
        let (free, _) = render(&open);
        if free.outline.half_axes_px[0] + 4.0 < 0.42 * render(&open).1[0] as f64 {
            assert_eq!(free.rim_visible, 1.0, "frame {k}");
        }
    }
    assert!(
        occluded > 10 && outside > 10,
        "{occluded} hidden, {outside} outside"
    );
}

#[test]
fn mirrored_images_are_flipped() {
    let pattern = random_pattern(20, 3);
    let mut scene =
        Scene::random(&pattern, &SynthConfig::default(), &mut frame_rng(13, 1)).unwrap();
    scene.sensor = Sensor::PERFECT;
    let [width, _] = scene.size;
    let plain = scene.render().unwrap();
    scene.mirrored = true;
    let mirrored = scene.render().unwrap();
    for (i, value) in plain.image.values().iter().enumerate() {
        let at = (i / width) * width + (width - 1 - i % width);
        assert_eq!(mirrored.image.values()[at], *value);
        assert_eq!(mirrored.mask[at], plain.mask[i]);
    }
    for (a, b) in plain.dots.iter().zip(&mirrored.dots) {
        assert!((a.pixel.u + b.pixel.u - (width as f64 - 1.0)).abs() < 1e-9);
        assert_eq!(a.direction, b.direction);
    }
}

#[test]
fn video_blocks_lose_no_more_than_half_a_step_in_energy() {
    // An orthonormal transform keeps the sum of squares, and a coefficient is off by 2/3 of a step at most.
    let image = RgbImage::new(
        37,
        29,
        (0..37 * 29)
            .map(|i| [((i * 7919) % 256) as f32 / 255.0; 3])
            .collect(),
    )
    .unwrap();
    for (qp, step) in [(4.0, 1.0), (22.0, 8.0), (34.0, 32.0)] {
        let coded = Compression::Video { qp }.apply(image.clone()).unwrap();
        let pairs = image.values().iter().zip(coded.values());
        let squares: f32 = pairs.map(|(a, b)| (255.0 * (a[1] - b[1])).powi(2)).sum();
        let rms = (squares / (37.0 * 29.0)).sqrt();
        // Rounding to eight bits adds a little.
        assert!(rms < 0.67 * step + 0.5, "QP {qp}: {rms} of 255");
        assert!(rms > 0.15 * step, "QP {qp}: {rms} of 255");
    }
}

#[test]
fn presets_stay_within_their_bounds() {
    SynthConfig::default().check().unwrap();
    SynthConfig::good().check().unwrap();
    let pattern = random_pattern(20, 3);
    for frame in frames(&pattern, &SynthConfig::good(), 2, 40).unwrap() {
        let truth = &frame.truth;
        let [a, b] = truth.outline.half_axes_px;
        assert!((a * b).sqrt() > 29.5 && (a * b).sqrt() < 30.6, "{a}, {b}");
        assert!(
            truth
                .distance
                .is_none_or(|d| (6.0 - 1e-6..=60.0 + 1e-6).contains(&d))
        );
        assert!(truth.rim_visible == 1.0 && truth.occluder.is_none());
    }
}

#[test]
fn the_axis_of_a_whole_picture_is_near_its_middle() {
    let pattern = random_pattern(20, 2);
    let config = SynthConfig {
        image_px: Some([640, 480]),
        ball_px: Some([40.0, 120.0]),
        parallel_share: 0.0,
        ..SynthConfig::default()
    };
    let count = 200;
    let mut squares = 0.0;
    for k in 0..count {
        let scene = Scene::random(&pattern, &config, &mut frame_rng(31, k)).unwrap();
        let Camera::Perspective(k) = scene.camera else {
            panic!("no pinhole");
        };
        let (u, v) = (k.cx - 319.5, k.cy - 239.5);
        squares += u * u + v * v;
        // The ball is within the field of a wide lens.
        let center = scene.circle.center;
        let off = (center.u - k.cx).hypot(center.v - k.cy) / k.fx;
        assert!(off < 0.6f64.tan() + 1e-9, "{off}");
    }
    // Two coordinates of 16 pixels each.
    let sigma = (squares / (2 * count) as f64).sqrt();
    assert!((14.0..18.0).contains(&sigma), "{sigma}");
}

/// A pixel is full before it is read: of noise of the deviation `s` about white, cut at white, the mean is `1 - s / sqrt(2 pi)` however bright
/// the light was.
#[test]
fn a_full_pixel_is_read_with_its_noise() {
    let sensor = Sensor {
        read_noise: 0.2,
        has_color: false,
        ..Sensor::PERFECT
    };
    let size = [200, 200];
    for light in [1.0, 3.0] {
        let image = sensor
            .take(vec![[light; 3]; size[0] * size[1]], size, 61)
            .unwrap();
        let sum: f64 = image.values().iter().map(|c| f64::from(c[0])).sum();
        let mean = sum / (size[0] * size[1]) as f64;
        let expected = 1.0 - 0.2 / std::f64::consts::TAU.sqrt();
        assert!(
            (mean - expected).abs() < 4e-3,
            "{light}: {mean}, expected {expected}"
        );
    }
}

/// A shadow lies on the side that it is stated for, and takes a lamp's light there and nowhere else.
#[test]
fn a_shadow_lies_where_it_is_stated() {
    let mut scene = plain_scene(&six());
    scene.surface.dots = vec![None; 6];
    scene.light = Light {
        ambient: [0.0; 3],
        lamps: vec![Lamp {
            from: Vec3::z(),
            color: [1.0; 3],
            gloss: 0.0,
            sharpness: 8.0,
        }],
        shadow: Some(Shadow {
            towards: Vec3::x(),
            edge: 0.0,
            softness: 0.01,
            depth: 1.0,
        }),
        limb: 0.0,
    };
    let image = image(&scene);
    let value = |u: usize| f64::from(image.values()[70 * scene.size[0] + u][0]);
    // Half a radius off the middle the lamp shines on an albedo of 0.9 under 30 degrees.
    let lit = 0.9 * 30f64.to_radians().cos();
    assert!((value(39) - lit).abs() < 0.02, "{} of {lit}", value(39));
    assert!(value(99) < 0.01, "{}", value(99));
}
