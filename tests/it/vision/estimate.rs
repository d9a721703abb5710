//! The estimator: drawn balls with a known truth, unusable images, and the published frames.

use std::path::Path;

use crate::common::ball::Scene;
use image::{DynamicImage, ImageBuffer, Luma, LumaA, Rgba};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::clip::{SequenceConfig, estimate_sequence, estimate_spin};
use spindoe::geometry::{Rotation, Vec3, random_rotation};
use spindoe::image::{GrayImage, ImageView};
use spindoe::pattern::Pattern;
use spindoe::source::FrameSource;
use spindoe::source::files::{natural_order, time_of_stem};
use spindoe::spin::orientations::Orientations;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthSequence};
use spindoe::vision::{
    Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate, FrameRejection,
    Intrinsics, Prior, find_ball,
};

fn estimator(pattern: &Pattern, camera: Camera) -> Estimator {
    let config = EstimatorConfig {
        camera: camera.into(),
        ..EstimatorConfig::default()
    };
    Estimator::new(pattern, config, DetectorName::Cnn.build().expect("weights"))
        .expect("valid settings")
}

#[test]
fn without_a_run_dots_are_found_and_named_by_none() {
    let pattern = crate::common::random_pattern(20, 5);
    let estimator = estimator(&pattern, Camera::Orthographic);
    let mut ws = estimator.workspace();
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let alone = Budget {
        runs: 0,
        ..Budget::default()
    };
    let (mut found, mut whole) = (FrameEstimate::default(), FrameEstimate::default());
    for _ in 0..4 {
        let scene = Scene::new(66, 30.0, pattern.dots(), random_rotation(&mut rng));
        let image = scene.render(&mut rng);
        estimator.estimate(&image, &Prior::default(), &alone, &mut ws, &mut found);
        assert_eq!(found.outcome, Err(FrameRejection::NotProcessed));
        assert!(found.dots.len() >= 5 && found.attempts() == 0, "{found:?}");
        assert!(found.assignment.iter().all(Option::is_none));
        let prior = Prior::default();
        estimator.estimate(&image, &prior, &Budget::default(), &mut ws, &mut whole);
        let [a, b] = [&found, &whole].map(|f| f.outline.unwrap().circle);
        assert!((a.center.u - b.center.u).hypot(a.center.v - b.center.v) < 1.0);
        // They are the dots by which the frame is answered.
        estimator.identify_detections(&mut ws, &mut found);
        let [by_dots, by_all] = [&found, &whole].map(|f| f.pose().unwrap().rotation);
        assert!(by_dots.angle_to(&by_all).to_degrees() < 3.0);
    }
    let empty = GrayImage::from_fn(66, 66, |_, _| 0.2);
    estimator.estimate(&empty, &Prior::default(), &alone, &mut ws, &mut found);
    let is_without = matches!(found.outcome, Err(FrameRejection::NoBall(_)));
    assert!(is_without && found.outline.is_none(), "{found:?}");
}

#[test]
fn in_whole_pictures_the_dots_found_alone_are_the_balls() {
    let pattern = crate::common::dots20();
    let estimator = estimator(&pattern, Camera::Orthographic);
    let mut ws = estimator.workspace();
    // Surroundings in which other things look like balls, too.
    let scene = SynthConfig {
        image_px: Some([640, 480]),
        ball_px: Some([100.0; 2]),
        ..SynthConfig::default()
    };
    let alone = Budget {
        runs: 0,
        ..Budget::default()
    };
    let (mut found, mut whole) = (FrameEstimate::default(), FrameEstimate::default());
    let (mut answered, mut same) = (0, 0);
    for seed in 0..crate::common::few_or_all(24, 100) as u64 {
        let timing = ClipConfig {
            fps: 100.0,
            ..ClipConfig::default()
        };
        let clip = SynthSequence::random(&pattern, &scene, &timing, 640_700 + seed, 1).unwrap();
        let image = clip.frame(0).unwrap().image;
        let prior = Prior::default();
        estimator.estimate(&image, &prior, &Budget::default(), &mut ws, &mut whole);
        if whole.pose().is_none() {
            continue;
        }
        answered += 1;
        estimator.estimate(&image, &prior, &alone, &mut ws, &mut found);
        let near = found.outline.zip(whole.outline).is_some_and(|(a, b)| {
            let [a, b] = [a.circle, b.circle];
            (a.center.u - b.center.u).hypot(a.center.v - b.center.v) < 0.1 * b.radius
        });
        same += usize::from(near && found.dots.len() >= 5);
    }
    println!("{same} of {answered} answered pictures");
    assert!(
        answered >= 12 && 10 * same >= 9 * answered,
        "{same} of {answered}"
    );
}

/// Right, wrong and refused of `trials` drawn balls, and the median error of the right, degrees.
fn survey(camera: Camera, kind: impl Fn(&mut Scene)) -> (usize, usize, usize, f64) {
    let pattern = crate::common::random_pattern(20, 5);
    let estimator = estimator(&pattern, camera);
    let mut ws = estimator.workspace();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut out = FrameEstimate::default();
    let (mut right, mut wrong, mut refused) = (Vec::new(), 0, 0);
    for _ in 0..60 {
        let mut scene = Scene::new(66, 30.0, pattern.dots(), random_rotation(&mut rng));
        scene.camera = camera;
        kind(&mut scene);
        let image = scene.render(&mut rng);
        estimator.estimate(
            &image,
            &Prior::default(),
            &Budget::default(),
            &mut ws,
            &mut out,
        );
        let view = spindoe::vision::BallView::new(&camera, scene.circle).expect("a ball");
        let truth = view.to_camera() * scene.rotation;
        match out.pose().map(|p| p.rotation.angle_to(&truth).to_degrees()) {
            Some(error) if error < 20.0 => right.push(error),
            Some(_) => wrong += 1,
            None => refused += 1,
        }
    }
    right.sort_by(f64::total_cmp);
    let median = right.get(right.len() / 2).copied().unwrap_or(f64::NAN);
    println!(
        "right {}, wrong {wrong}, refused {refused}, median {median:.2} deg",
        right.len()
    );
    (right.len(), wrong, refused, median)
}

#[test]
fn drawn_balls_are_told() {
    let perspective = Camera::Perspective(Intrinsics::pinhole(400.0, 400.0, -60.0, 90.0));
    let (right, wrong, _, error) = survey(Camera::Orthographic, |_| {});
    assert!(right >= 57 && wrong <= 1 && error < 1.2);
    let (right, wrong, _, error) = survey(Camera::Orthographic, |s| {
        s.circle.center.u += 9.0;
        s.circle.center.v -= 9.0;
    });
    assert!(
        right >= 45 && wrong <= 1 && error < 1.8,
        "off-center and cut"
    );
    let (right, wrong, _, error) = survey(perspective, |_| {});
    assert!(right >= 50 && wrong <= 2 && error < 2.5, "perspective");
    let (right, wrong, ..) = survey(Camera::Orthographic, |s| {
        (s.ball, s.dot, s.noise) = (1.6, 0.5, 0.01);
    });
    assert!(right >= 40 && wrong <= 2, "over-exposed");
    let (right, wrong, ..) = survey(Camera::Orthographic, |s| {
        (s.ball, s.dot, s.background, s.noise) = (0.15, 0.03, 0.02, 0.008);
    });
    assert!(right >= 40 && wrong <= 2, "under-exposed");
    let (_, wrong, ..) = survey(Camera::Orthographic, |s| s.dots.clear());
    assert!(wrong <= 1, "a plain ball");
}

#[test]
fn frames_of_a_flight_help_each_other() {
    let pattern = crate::common::random_pattern(20, 5);
    let estimator = estimator(&pattern, Camera::Orthographic);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let spin = Vec3::new(120.0, -300.0, 80.0);
    let start = random_rotation(&mut rng);
    let times: Vec<f64> = (0..12).map(|k| 0.0026 * f64::from(k)).collect();
    let truth = |t: f64| Rotation::from_scaled_axis(spin * t) * start;
    let render = |(k, t): (usize, &f64), rng: &mut ChaCha8Rng| {
        let mut scene = Scene::new(66, 30.0, pattern.dots(), truth(*t));
        if k == 5 {
            // Two dots are too few alone.
            let mut seen: Vec<Vec3> = pattern.dots().to_vec();
            seen.sort_by(|a, b| (truth(*t) * b).z.total_cmp(&(truth(*t) * a).z));
            seen.truncate(2);
            scene.dots = seen;
        }
        scene.render(rng)
    };
    let images = times
        .iter()
        .enumerate()
        .map(|frame| render(frame, &mut rng));
    let images: Vec<_> = images.collect();
    let images: Vec<ImageView<'_>> = images.iter().map(ImageView::from).collect();
    let config = SequenceConfig::default();
    let (frames, summary) = estimate_sequence(&estimator, &config, &times, &images);
    assert!(summary.alone == 11 && summary.together == 12, "{summary:?}");
    let pose = frames[5].pose().expect("told by the others");
    assert!(pose.hinted && pose.rotation.angle_to(&truth(times[5])).to_degrees() < 10.0);
    let fit = estimate_spin(&config, &times, &frames).expect("a spin");
    assert!(
        (fit.motion.spin - spin).norm() < 0.03 * spin.norm(),
        "{fit:?}"
    );
}

#[test]
fn names_sort_by_number() {
    let mut names = [
        "103333323",
        "3333333",
        "frame10",
        "frame9",
        "0012",
        "12",
        "a1b2",
        "a1b10",
    ];
    names.sort_by(|a, b| natural_order(a, b));
    let expected = [
        "0012",
        "12",
        "3333333",
        "103333323",
        "a1b2",
        "a1b10",
        "frame9",
        "frame10",
    ];
    assert_eq!(names, expected);
    assert_eq!(time_of_stem("686338211101"), Some(686.338211101));
    assert_eq!(time_of_stem("frame1"), None);
}

/// A folder with a table and a drawn frame, as an 8-bit value image.
fn folder() -> (tempfile::TempDir, GrayImage) {
    let dir = tempfile::tempdir().expect("a folder");
    let pattern = crate::common::random_pattern(20, 5);
    let text: String = pattern
        .dots()
        .iter()
        .map(|d| format!("{},{},{}\n", d.x, d.y, d.z))
        .collect();
    std::fs::write(dir.path().join("pattern.csv"), text).expect("written");
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let scene = Scene::new(66, 30.0, pattern.dots(), random_rotation(&mut rng));
    (dir, scene.render(&mut rng))
}

fn bytes(image: &GrayImage) -> ImageBuffer<Luma<u8>, Vec<u8>> {
    let (w, h) = (image.width() as u32, image.height() as u32);
    let values = image.values().iter().map(|v| (255.0 * v) as u8).collect();
    ImageBuffer::from_raw(w, h, values).expect("as many values")
}

fn save(image: impl Into<DynamicImage>, path: &Path) {
    image.into().save(path).expect("written");
}

#[test]
fn files_of_all_kinds_are_answered_or_refused() {
    let (dir, image) = folder();
    let at = |name: &str| dir.path().join(name);
    std::fs::create_dir(at("in")).expect("a folder");
    let gray = bytes(&image);
    let (w, h) = gray.dimensions();
    save(gray.clone(), &at("in/1000000.png"));
    save(gray.clone(), &at("in/2000000.jpg"));
    let deep = ImageBuffer::from_fn(w, h, |u, v| {
        Luma([u16::from(gray.get_pixel(u, v).0[0]) * 257])
    });
    save(deep, &at("in/3000000.png"));
    let alpha = ImageBuffer::from_fn(w, h, |u, v| LumaA([gray.get_pixel(u, v).0[0], 255u8]));
    save(alpha, &at("in/4000000.png"));
    let color = ImageBuffer::from_fn(w + 9, h + 4, |u, v| {
        let g = gray.get_pixel(u.min(w - 1), v.min(h - 1)).0[0];
        Rgba([g, g, g, 255u8])
    });
    save(color, &at("in/5000000.png"));
    save(
        ImageBuffer::from_pixel(64, 64, Luma([0u8])),
        &at("in/6000000.png"),
    );
    save(
        ImageBuffer::from_pixel(1, 1, Luma([9u8])),
        &at("in/10000000.png"),
    );
    let run = [
        "estimate",
        "--table",
        "pattern.csv",
        "in",
        "-o",
        "out.csv",
        "--json",
    ];
    let json: serde_json::Value =
        serde_json::from_str(&crate::common::done(dir.path(), &run)).expect("JSON");
    let frames = json["frames"].as_array().expect("frames");
    let names: Vec<_> = frames
        .iter()
        .map(|f| f["frame"].as_str().expect("a name"))
        .collect();
    assert_eq!(names.last(), Some(&"10000000"), "sorted by number");
    for frame in &frames[..5] {
        assert!(frame["orientation_wxyz"].is_array(), "{frame}");
    }
    for frame in &frames[5..] {
        let refusal = frame["refusal"].as_str().expect("a reason");
        assert!(refusal.starts_with("no ball"), "{refusal}");
    }
    let ours = Orientations::read_csv(&at("out.csv")).expect("it reads");
    let optical = [
        "estimate",
        "--table",
        "pattern.csv",
        "in",
        "-o",
        "optical.csv",
        "--frame",
        "optical",
    ];
    crate::common::done(dir.path(), &optical);
    let optical = Orientations::read_csv(&at("optical.csv")).expect("it reads");
    let turn = Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
    for (a, b) in ours.rows.iter().zip(&optical.rows) {
        match (a.orientation, b.orientation) {
            (Some(a), Some(b)) => assert!((turn * a).angle_to(&b) < 1e-6),
            (a, b) => assert_eq!(a, b),
        }
    }
}

#[test]
fn what_is_no_image_is_named_in_one_line() {
    let (dir, image) = folder();
    let at = |name: &str| dir.path().join(name);
    save(bytes(&image), &at("good.png"));
    let whole = std::fs::read(at("good.png")).expect("it reads");
    std::fs::write(at("half.png"), &whole[..whole.len() / 2]).expect("written");
    std::fs::write(at("text.png"), "no image").expect("written");
    std::fs::write(at("film.mp4"), "no video").expect("written");
    std::fs::create_dir(at("empty")).expect("a folder");
    for name in ["half.png", "text.png", "absent.png", "film.mp4", "empty"] {
        let output =
            crate::common::spindoe(dir.path(), &["estimate", "--table", "pattern.csv", name]);
        let words = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{name}: {words}");
        assert_eq!(words.trim().lines().count(), 1, "{name}: {words}");
        assert!(words.contains(name), "{name}: {words}");
        assert!(output.stdout.is_empty());
    }
    for wrong in [
        ["--circle", "1,2"],
        ["--intrinsics", "0,1,2,3"],
        ["--fps", "0"],
    ] {
        let mut arguments = vec!["estimate", "--table", "pattern.csv", "good.png"];
        arguments.extend(wrong);
        let output = crate::common::spindoe(dir.path(), &arguments);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn videos_are_read_through_ffmpeg() {
    if !crate::common::has_ffmpeg() {
        return;
    }
    let (dir, image) = folder();
    for k in 1..=3 {
        save(bytes(&image), &dir.path().join(format!("f{k}.png")));
    }
    let made = std::process::Command::new("ffmpeg")
        .args([
            "-framerate",
            "100",
            "-i",
            "f%d.png",
            "-c:v",
            "ffv1",
            "film.mkv",
        ])
        .current_dir(dir.path())
        .output()
        .expect("it runs");
    assert!(made.status.success());
    let run = [
        "estimate",
        "--table",
        "pattern.csv",
        "film.mkv",
        "--overlay",
        "seen",
    ];
    let text = crate::common::done(dir.path(), &run);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 4, "{text}");
    assert!(
        lines[1].starts_with("film_000001,0,0.") && lines[2].contains(",0.01,"),
        "{text}"
    );
    assert!(dir.path().join("seen/contact_sheet.png").is_file());
    // The same as a video, which ffmpeg itself reads.
    let run = [
        "estimate",
        "--table",
        "pattern.csv",
        "film.mkv",
        "--overlay",
        "seen.mp4",
    ];
    assert_eq!(crate::common::done(dir.path(), &run), text);
    let probed = std::process::Command::new("ffmpeg")
        .args(["-v", "info", "-i", "seen.mp4", "-f", "null", "-"])
        .current_dir(dir.path())
        .output()
        .expect("it runs");
    let words = String::from_utf8_lossy(&probed.stderr);
    assert!(probed.status.success(), "{words}");
    assert!(
        words.contains("480x572") && words.contains("frame=    3"),
        "{words}"
    );
}

#[test]
fn an_annotated_video_needs_ffmpeg_and_a_place_before_the_work() {
    let (dir, image) = folder();
    save(bytes(&image), &dir.path().join("f1.png"));
    let run = |target: &str, path: &str| {
        std::process::Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args(["estimate", "--table", "pattern.csv", "f1.png", "--overlay"])
            .arg(target)
            .current_dir(dir.path())
            .env("PATH", path)
            .output()
            .expect("it runs")
    };
    let output = run("seen.mp4", "");
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{words}");
    assert!(
        words.contains("ffmpeg") && words.trim().lines().count() == 1,
        "{words}"
    );
    assert!(output.stdout.is_empty() && !dir.path().join("seen.mp4").exists());
    let path = std::env::var("PATH").unwrap_or_default();
    let output = run("absent/seen.mp4", &path);
    assert_ne!(output.status.code(), Some(0));
    assert!(output.stdout.is_empty());
}

#[test]
fn mirrored_balls_are_refused_as_such() {
    use spindoe::recognize::RecognizerRejection;
    use spindoe::synth::SynthConfig;
    use spindoe::synth::dataset::independent_frame;
    use spindoe::vision::FrameRejection;
    let config = SynthConfig {
        mirrored: true,
        ..SynthConfig::good()
    };
    // Of all patterns the published one is nearest to its mirror image.
    let patterns = [
        Some(crate::common::dots20()),
        crate::common::published_pattern(),
    ];
    for pattern in patterns.into_iter().flatten() {
        let estimator = estimator_of_synth(&pattern);
        let mut ws = estimator.workspace();
        let mut out = FrameEstimate::default();
        let (mut named, mut answered) = (0, 0);
        for k in 0..40 {
            let frame = independent_frame(&pattern, &config, 7, k).expect("a frame");
            estimator.estimate(
                &frame.image,
                &Prior::default(),
                &Budget::default(),
                &mut ws,
                &mut out,
            );
            let mirrored = FrameRejection::Recognizer(RecognizerRejection::Mirrored);
            named += usize::from(out.outcome == Err(mirrored));
            answered += usize::from(out.pose().is_some());
        }
        println!("{named} of 40 named, {answered} answered");
        assert!(named >= 25 && answered <= 2, "{named} {answered}");
    }
}

fn estimator_of_synth(pattern: &Pattern) -> Estimator {
    let detector = DetectorName::Cnn.build().expect("weights");
    Estimator::new(pattern, EstimatorConfig::default(), detector).expect("valid settings")
}

#[test]
fn published_frames_are_explained_by_one_spin() {
    let (Some(pattern), Some(folder)) = (
        crate::common::published_pattern(),
        crate::common::published_frames(),
    ) else {
        return;
    };
    let estimator = estimator(&pattern, Camera::Orthographic);
    let mut ws = estimator.workspace();
    let sources = spindoe::source::files::sources(&[folder]).expect("a folder");
    let (mut times, mut frames) = (Vec::new(), Vec::new());
    for source in &sources {
        let mut source = spindoe::source::files::open(source, 1 << 20).expect("a file");
        for frame in source.frames() {
            let frame = frame.expect("it reads");
            let picture = frame.picture.expect("an image");
            let gray: GrayImage = picture.to_rgb().expect("colors").to_gray();
            let mut out = FrameEstimate::default();
            estimator.estimate(
                &gray,
                &Prior::default(),
                &Budget::default(),
                &mut ws,
                &mut out,
            );
            assert!(
                find_ball(&gray, &estimator.config().circle).is_ok(),
                "{}",
                frame.name
            );
            times.push(frame.time_s.expect("a time"));
            frames.push(out);
        }
    }
    let alone = frames.iter().filter(|f| f.pose().is_some()).count();
    let fit = estimate_spin(&SequenceConfig::default(), &times, &frames).expect("a spin");
    let off = |(t, f): (&f64, &FrameEstimate)| {
        let pose = f.pose()?;
        Some(pose.rotation.angle_to(&fit.motion.at(*t)).to_degrees())
    };
    let off: Vec<f64> = times.iter().zip(&frames).filter_map(off).collect();
    let most = off.iter().copied().fold(0.0, f64::max);
    println!(
        "{alone} alone, {:.2} rps, at most {most:.1} deg off",
        fit.motion.rps()
    );
    // Measured: 8.0 deg, the frames 1.0 deg in the root mean square.
    assert!(alone >= 20 && most < 8.5);
    assert!((fit.motion.rps() - 132.6).abs() < 1.0);
}

/// Frames of a turning ball with this pattern, named in nanoseconds.
fn clip(dir: &Path, pattern: &Pattern, frames: u32, seed: u64) {
    std::fs::create_dir_all(dir).expect("a folder");
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let start = random_rotation(&mut rng);
    for k in 0..frames {
        let time_s = f64::from(k) / 350.0;
        let turn = Rotation::from_scaled_axis(Vec3::new(80.0, -200.0, 60.0) * time_s);
        let scene = Scene::new(66, 30.0, pattern.dots(), turn * start);
        let name = format!("{}.png", 1_000_000_000 + (time_s * 1e9) as u64);
        save(bytes(&scene.render(&mut rng)), &dir.join(name));
    }
}

#[test]
fn a_frame_of_an_odd_size_is_said() {
    let (dir, image) = folder();
    let at = |name: &str| dir.path().join(name);
    std::fs::create_dir(at("in")).expect("a folder");
    for k in 1..4 {
        save(bytes(&image), &at(&format!("in/{k}000000.png")));
    }
    let run = ["estimate", "--table", "pattern.csv", "in"];
    let words = |output: std::process::Output| String::from_utf8_lossy(&output.stderr).into_owned();
    let same = words(crate::common::spindoe(dir.path(), &run));
    assert!(!same.contains("warning"), "{same}");
    save(
        bytes(&GrayImage::from_fn(90, 70, |_, _| 0.5)),
        &at("in/2500000.png"),
    );
    let odd = words(crate::common::spindoe(dir.path(), &run));
    let expected = format!(
        "1 of 4 frames are not of {} x {} pixels as most are, the first of them 2500000 (90 x 70)",
        image.width(),
        image.height()
    );
    assert!(odd.contains(&expected), "{odd}");
}

#[test]
fn crops_of_many_sizes_are_none_of_an_odd_size() {
    let (dir, image) = folder();
    std::fs::create_dir(dir.path().join("in")).expect("a folder");
    let side = image.width();
    for k in 0..6 {
        // Two of the largest size, and others.
        let crop = side - k.max(1);
        let image = GrayImage::from_fn(crop, crop, |u, v| image.sample(u as f64, v as f64));
        let name = format!("in/{}000000.png", k + 1);
        save(bytes(&image), &dir.path().join(name));
    }
    let run = ["estimate", "--table", "pattern.csv", "in"];
    let output = crate::common::spindoe(dir.path(), &run);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(!words.contains("warning"), "{words}");
}

#[test]
fn a_file_that_cannot_be_read_is_one_rejected_frame() {
    let (dir, image) = folder();
    let at = |name: &str| dir.path().join(name);
    std::fs::create_dir(at("in")).expect("a folder");
    save(bytes(&image), &at("in/1000000.png"));
    let whole = std::fs::read(at("in/1000000.png")).expect("it reads");
    std::fs::write(at("in/2000000.png"), &whole[..whole.len() / 2]).expect("written");
    save(bytes(&image), &at("in/3000000.png"));
    std::fs::write(at("in/notes.txt"), "notes").expect("written");
    let run = ["estimate", "--table", "pattern.csv", "in", "--json"];
    let output = crate::common::spindoe(dir.path(), &run);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    assert!(
        words.contains("in/2000000.png: image: cannot be decoded"),
        "{words}"
    );
    assert!(
        words.contains("skipped 1 file, which is no image: notes.txt"),
        "{words}"
    );
    assert!(words.contains("2 of 3 frames identified"), "{words}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let refusal = json["frames"][1]["refusal"].as_str().expect("a reason");
    assert!(refusal.contains("2000000.png"), "{refusal}");
    // One pixel too many for what is allowed.
    let narrow = [
        "estimate",
        "--table",
        "pattern.csv",
        "in/1000000.png",
        "--config",
        "max_pixels=4355",
    ];
    let output = crate::common::spindoe(dir.path(), &narrow);
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{words}");
    assert!(
        words.contains("at most 4355 pixels, found 66 x 66"),
        "{words}"
    );
}

#[test]
fn a_thin_picture_is_one_rejected_frame() {
    let (dir, image) = folder();
    let at = |name: &str| dir.path().join(name);
    std::fs::create_dir(at("in")).expect("a folder");
    save(bytes(&image), &at("in/1000000.png"));
    let thin =
        |width, height| ImageBuffer::from_fn(width, height, |u, v| Luma([(9 * u + v) as u8]));
    for (k, (width, height)) in [(3, 1000), (1000, 3), (1, 1000), (1000, 16)]
        .into_iter()
        .enumerate()
    {
        save(thin(width, height), &at(&format!("in/{}000000.png", 2 + k)));
    }
    save(bytes(&image), &at("in/9000000.png"));
    let run = ["estimate", "--table", "pattern.csv", "in", "--json"];
    // In all of every frame, in what the thin ones lack, and in what only one of them has.
    for (roi, identified) in [("", 2), ("0,0,66,66", 2), ("0,0,2,1000", 0)] {
        let mut arguments = run.to_vec();
        if !roi.is_empty() {
            arguments.extend(["--roi", roi]);
        }
        let output = crate::common::spindoe(dir.path(), &arguments);
        let words = String::from_utf8_lossy(&output.stderr);
        let code = if identified > 0 { 0 } else { 3 };
        assert_eq!(output.status.code(), Some(code), "{roi}: {words}");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!(json["identified"], identified, "{roi}: {words}");
        assert_eq!(json["frames"].as_array().map(Vec::len), Some(6), "{roi}");
    }
}

#[test]
fn an_outline_that_is_known_well_is_believed() {
    use spindoe::synth::SynthConfig;
    use spindoe::synth::dataset::independent_frame;
    use spindoe::vision::{BallCircle, OutlinePrior};
    let pattern = crate::common::random_pattern(20, 5);
    let estimator = estimator_of_synth(&pattern);
    // Dots where the pattern has them: the outline's error counts.
    let config = SynthConfig {
        placement_sigma_rad: [0.0; 2],
        max_off_axis_rad: 0.0,
        ..SynthConfig::good()
    };
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    let mut errors = [Vec::new(), Vec::new()];
    for k in 0..40 {
        let frame = independent_frame(&pattern, &config, 91, k).expect("a frame");
        let truth = frame.truth.orientation();
        let known = OutlinePrior {
            sigma_px: 0.05,
            ..OutlinePrior::given(BallCircle::new(frame.truth.center, frame.truth.radius_px))
        };
        for (outline, errors) in [None, Some(known)].into_iter().zip(&mut errors) {
            let prior = Prior {
                outline,
                ..Prior::default()
            };
            let budget = Budget::default();
            estimator.estimate(&frame.image, &prior, &budget, &mut ws, &mut out);
            let pose = out.pose();
            errors.extend(pose.map(|p| p.rotation.angle_to(&truth).to_degrees()));
        }
    }
    let counts = errors.each_ref().map(Vec::len);
    let [found, given] = errors.each_mut().map(|e| spindoe::stats::median(e));
    println!("{counts:?} of 40, median {found:.3} deg, with the true outline {given:.3} deg");
    assert!(counts.iter().all(|n| *n >= 38), "{counts:?}");
    assert!(given < found, "{given}, without {found}");
}

/// Whether two values are equal up to the rounding of degrees in a file.
fn is_close(a: &serde_json::Value, b: &serde_json::Value) -> bool {
    use serde_json::Value;
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            (a - b).abs() <= 1e-9 * (1.0 + b.abs())
        }
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_close(a, b))
        }
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len()
                && a.iter()
                    .all(|(name, a)| b.get(name).is_some_and(|b| is_close(a, b)))
        }
        (a, b) => a == b,
    }
}

#[test]
fn numbered_frames_ask_for_a_rate() {
    let (dir, _) = folder();
    let pattern = crate::common::random_pattern(20, 5);
    let times = dir.path().join("times");
    clip(&times, &pattern, 6, 4);
    let numbered = dir.path().join("numbered");
    std::fs::create_dir(&numbered).expect("a folder");
    let mut names: Vec<_> = (std::fs::read_dir(&times).expect("a folder"))
        .map(|e| e.expect("an entry").path())
        .collect();
    names.sort();
    for (k, path) in names.iter().enumerate() {
        std::fs::copy(path, numbered.join(format!("{k:04}.png"))).expect("copied");
    }
    let run = |folder: &str, flags: &[&str]| {
        let arguments = [
            "estimate",
            "--table",
            "pattern.csv",
            folder,
            "--json",
            "-o",
            "o.csv",
        ];
        let output = crate::common::spindoe(dir.path(), &[&arguments[..], flags].concat());
        let words = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(output.status.success(), "{words}");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        (words, json)
    };
    let (words, json) = run("numbered", &[]);
    assert!(
        words.contains("frame numbers, not times") && words.contains("give --fps"),
        "{words}"
    );
    assert!(
        json["spin"].is_null() && json["spin_refusal"].is_null(),
        "{json}"
    );
    assert_eq!(json["times"]["source"], "frame_numbers");
    let (words, json) = run("numbered", &["--fps", "350"]);
    assert!(
        words.contains("times: 350 fps as given by --fps"),
        "{words}"
    );
    // The same frames, the same spin, however their times came; and `spin` says the same of the file.
    let (_, named) = run("times", &[]);
    let rps = |json: &serde_json::Value| json["spin"]["rps"].as_f64().expect("a spin");
    assert!((rps(&json) - rps(&named)).abs() < 1e-3, "{json} {named}");
    let again = crate::common::done(dir.path(), &["spin", "o.csv", "--json"]);
    let again: serde_json::Value = serde_json::from_str(&again).expect("JSON");
    for field in [
        "spin_rad_s",
        "std_rad_s",
        "alternatives",
        "unique_up_to_rps",
        "residual_deg",
    ] {
        let (a, b) = (&again[field], &named["spin"][field]);
        assert!(is_close(a, b), "{field}: {a} {b}");
    }
    let limit = again["unique_up_to_rps"].as_f64().expect("a limit");
    assert!((limit - 175.0).abs() < 0.1, "{limit}");
}

#[test]
fn wrong_tables_and_mirrored_clips_are_named() {
    let (dir, _) = folder();
    let pattern = crate::common::random_pattern(20, 5);
    clip(&dir.path().join("in"), &pattern, 10, 6);
    let other = crate::common::random_pattern(20, 6);
    other
        .write_csv(&dir.path().join("other.csv"))
        .expect("written");
    let run = |flags: &[&str]| {
        let arguments = ["estimate", "in", "--json"];
        let output = crate::common::spindoe(dir.path(), &[&arguments[..], flags].concat());
        let words = String::from_utf8(output.stderr).expect("UTF-8");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        (output.status.code(), words, json)
    };
    let (code, words, json) = run(&["--table", "other.csv"]);
    assert_eq!((code, &json["identified"]), (Some(3), &0.into()), "{words}");
    assert!(
        words.contains("this table does not fit these images ("),
        "{words}"
    );
    let (code, words, json) = run(&["--table", "other.csv", "--table", "pattern.csv"]);
    assert_eq!(code, Some(0), "{words}");
    assert!(words.contains("pattern.csv fits, odds "), "{words}");
    assert_eq!(json["verdict"]["table"], "pattern.csv");
    // The order of the tables decides nothing, and one that does not fit changes nothing.
    let (_, _, after) = run(&["--table", "pattern.csv", "--table", "other.csv"]);
    let (_, _, alone) = run(&["--table", "pattern.csv"]);
    let poses = |json: &serde_json::Value| {
        let frames = json["frames"].as_array().expect("frames").iter();
        let poses = frames.map(|f| {
            (
                f["name"].clone(),
                f["orientation"].clone(),
                f["circle"].clone(),
            )
        });
        poses.collect::<Vec<_>>()
    };
    assert_eq!(poses(&json), poses(&alone));
    assert_eq!(poses(&after), poses(&alone));
    assert_eq!(json["spin"], alone["spin"]);
    let (code, words, json) = run(&["--table", "pattern.csv", "--mirrored"]);
    assert_eq!((code, &json["identified"]), (Some(3), &0.into()), "{words}");
    assert!(words.contains("the images are mirrored"), "{words}");
    // The ball of a mirrored pattern, seen in a mirror, is the ball itself.
    let mirrored = spindoe::clip::verdict::mirrored_pattern(&pattern).expect("a pattern");
    mirrored
        .write_csv(&dir.path().join("mirrored.csv"))
        .expect("written");
    let (code, words, json) = run(&["--table", "mirrored.csv", "--mirrored"]);
    assert_eq!(code, Some(0), "{words}");
    assert!(json["identified"].as_u64() >= Some(8), "{words}");
}
