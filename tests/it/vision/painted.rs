//! Balls painted with marks of any shape: orientations against what was rendered.

use std::f64::consts::TAU;

use nalgebra::Matrix3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::Rotation;
use spindoe::geometry::{
    Vec3, random_direction, random_rotation, rotation_angle, spiral_directions,
};
use spindoe::image::GrayImage;
use spindoe::pattern::Pattern;
use spindoe::surface::{
    PaintedFollower, PaintedFrame, PaintedPose, PaintedRejection, PaintedTrack, PaintedTracker,
    SurfaceMap,
};
use spindoe::synth::blotches::Blotches;
use spindoe::synth::{Scene, SynthConfig, SynthKind};
use spindoe::vision::frame::{CameraModel, OutlineMethod};
use spindoe::vision::optics::camera::{BallCircle, Camera, Pixel};
use spindoe::vision::outline::find::OutlineFinder;
use spindoe::vision::{CircleConfig, FrameEstimate, Outline, Prior};

/// The camera's distance, ball radii.
const DISTANCE: f64 = 20.0;

/// A painted ball before a camera.
fn ball(seed: u64) -> Scene {
    ball_of(seed, 80.0)
}

/// One of so many pixels.
fn ball_of(seed: u64, diameter_px: f64) -> Scene {
    let config = SynthConfig {
        kind: SynthKind::Dotless,
        ball_px: Some([diameter_px; 2]),
        blotches: Some(Blotches::default()),
        max_off_axis_rad: 0.0,
        ..SynthConfig::good()
    };
    let stand_in = Pattern::new(spiral_directions(12).collect()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let scene = Scene::random(&stand_in, &config, &mut rng).unwrap();
    Scene {
        spin: Vec3::zeros(),
        shift_px: [0.0; 2],
        ..scene.with_camera_at(DISTANCE)
    }
}

/// What is kept of its image under a rotation, whose outline is given.
fn frame(ball: &Scene, rotation: &Rotation, noise_seed: u64) -> PaintedFrame {
    frame_within(ball, rotation, noise_seed, 1.0)
}

/// The same within an outline of so many times its radius.
fn frame_within(ball: &Scene, rotation: &Rotation, noise_seed: u64, radius: f64) -> PaintedFrame {
    let mut scene = ball.clone();
    (scene.rotation, scene.noise_seed) = (*rotation, noise_seed);
    let seen = scene.render().unwrap();
    let mut circle = seen.circle;
    circle.radius *= radius;
    let outline = Outline::given(circle, Matrix3::zeros());
    PaintedFrame::take(&seen.image.to_gray(), &outline)
}

/// Its image under a rotation.
fn picture(ball: &Scene, rotation: &Rotation, noise_seed: u64) -> GrayImage {
    let mut scene = ball.clone();
    (scene.rotation, scene.noise_seed) = (*rotation, noise_seed);
    scene.render().unwrap().image.to_gray()
}

/// The mean slope of an image across the borders of a surface under a pose, over those that are seen well.
fn steepness(image: &GrayImage, pose: &PaintedPose, borders: &[[Vec3; 2]]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for [from, to] in borders {
        let middle = (from + to).normalize();
        let is_well = (pose.rotation * middle).z > 0.6;
        if let Some(at) = pose.project(&middle).filter(|_| is_well) {
            let value = |du, dv| {
                let (u, v) = (at.u.round() as isize + du, at.v.round() as isize + dv);
                f64::from(image.at(u, v))
            };
            sum += (value(1, 0) - value(-1, 0)).hypot(value(0, 1) - value(0, -1));
            count += 1.0;
        }
    }
    assert!(count > 100.0, "{count} pieces");
    sum / count
}

/// Turned twice around, about two axes, 8 degrees a frame.
fn turned() -> Vec<Rotation> {
    let mut rotation = Rotation::identity();
    let turns = (0..90).map(|k| {
        let axis = if k < 45 { Vec3::x() } else { Vec3::y() };
        let now = rotation;
        rotation = Rotation::from_scaled_axis(axis * 8f64.to_radians()) * rotation;
        now
    });
    turns.collect()
}

/// A clip of a painted ball that turns, whose last frame shows none.
pub fn short_clip() -> PaintedTrack {
    let ball = ball(1);
    let turned = turned().into_iter().take(14);
    let mut frames: Vec<PaintedFrame> = turned.map(|r| frame(&ball, &r, 7)).collect();
    frames.push(PaintedFrame::default());
    tracker().track(&frames)
}

fn camera() -> CameraModel {
    CameraModel::Known(Camera::Near {
        inverse_distance: 1.0 / DISTANCE,
    })
}

fn tracker() -> PaintedTracker {
    PaintedTracker::new(&camera())
}

#[test]
fn a_clip_is_followed_around_and_its_surface_places_frames_of_another() {
    let ball = ball(1);
    let truth = turned();
    let frames: Vec<PaintedFrame> = (0..truth.len())
        .map(|k| frame(&ball, &truth[k], k as u64))
        .collect();
    let tracker = tracker();
    let track = tracker.track(&frames);
    let mut errors: Vec<f64> = Vec::new();
    for (pose, truth) in track.poses.iter().zip(&truth) {
        let pose = pose.expect("every frame has a pose");
        let length = pose.rotation.quaternion().norm();
        assert!((length - 1.0).abs() < 1e-12, "a rotation: {length}");
        errors.push(rotation_angle(&pose.rotation, truth).to_degrees());
    }
    let last = errors[errors.len() - 1];
    errors.sort_by(f64::total_cmp);
    let (median, worst) = (errors[45], errors[89]);
    // 1.5 and 4.2 deg when this was written; turns chained from frame to frame are off by more than 15.
    assert!(median < 2.5 && worst < 8.0, "{median:.2}, {worst:.2} deg");
    assert!(last < 5.0, "no drift: {last:.2} deg");

    // The borders of the surface lie where the pictures are steep, and not where the ball is turned a little.
    let borders = track.surface.borders();
    for k in [3, 40, 80] {
        let pose = track.poses[k].unwrap();
        let aside = Rotation::from_scaled_axis(Vec3::z() * 10f64.to_radians());
        let turned = PaintedPose {
            rotation: aside * pose.rotation,
            ..pose
        };
        let image = picture(&ball, &truth[k], k as u64);
        let [on, off] = [&pose, &turned].map(|pose| steepness(&image, pose, &borders));
        // 1.35 times as steep and more when this was written; by chance it is 1.
        assert!(on > 1.2 * off, "frame {k}: {on:.4} {off:.4}");
    }

    let bytes = track.surface.to_npz().unwrap();
    let surface = SurfaceMap::from_npz("ball.npz".as_ref(), &bytes).unwrap();
    assert_eq!(surface, track.surface);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let again: Vec<Rotation> = (0..12)
        .map(|_| {
            let nudge = Rotation::from_scaled_axis(Vec3::z() * rng.random_range(-0.5..0.5));
            nudge * truth[rng.random_range(0..truth.len())]
        })
        .collect();
    let frames: Vec<PaintedFrame> = again.iter().map(|r| frame(&ball, r, 1_000)).collect();
    let placed = tracker.place(&frames, &surface);
    let off: Vec<Option<f64>> = (placed.iter().zip(&again))
        .map(|(pose, truth)| Some(rotation_angle(&pose.ok()?.rotation, truth).to_degrees()))
        .collect();
    assert!(off.iter().flatten().count() >= 10, "{off:?}");
    assert!(off.iter().flatten().all(|e| *e < 8.0), "{off:?}");
}

#[test]
fn outlines_that_are_all_too_small_are_corrected_by_a_ball_that_comes_around() {
    let ball = ball(1);
    let truth = turned();
    let frames: Vec<PaintedFrame> = (0..truth.len())
        .map(|k| frame_within(&ball, &truth[k], k as u64, 0.95))
        .collect();
    let track = tracker().track(&frames);
    let both = track.poses.iter().zip(&truth);
    let mut errors: Vec<f64> = both
        .filter_map(|(pose, truth)| {
            let pose = pose.as_ref().ok()?;
            Some(rotation_angle(&pose.rotation, truth).to_degrees())
        })
        .collect();
    assert!(errors.len() >= 85, "{} of 90", errors.len());
    errors.sort_by(f64::total_cmp);
    // Turns that are 5 % too long are off by 18 deg once around.
    let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    assert!(median < 2.5 && worst < 8.0, "{median:.2}, {worst:.2} deg");
}

#[test]
fn frames_of_another_ball_and_frames_without_one_have_no_pose() {
    let own = ball(1);
    let frames: Vec<PaintedFrame> = turned().iter().map(|r| frame(&own, r, 7)).collect();
    let tracker = tracker();
    let surface = tracker.track(&frames).surface;
    let other = ball(4);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut frames: Vec<PaintedFrame> = (0..12)
        .map(|_| frame(&other, &random_rotation(&mut rng), 8))
        .collect();
    frames.push(PaintedFrame::default());
    let placed = tracker.place(&frames, &surface);
    let lost = placed
        .iter()
        .filter(|p| matches!(p, Err(PaintedRejection::Lost)));
    assert!(lost.count() >= 11, "{placed:?}");
    assert!(matches!(placed[12], Err(PaintedRejection::NoBall)));
}

#[test]
fn a_stream_is_placed_on_the_surface_of_an_earlier_clip_and_another_ball_is_not() {
    let own = ball(1);
    let frames: Vec<PaintedFrame> = turned().iter().map(|r| frame(&own, r, 7)).collect();
    let tracker = tracker();
    let surface = tracker.track(&frames).surface;
    let mut follower = PaintedFollower::new(&camera(), surface.clone());
    // Another turn than the clip's: 12 degrees a frame about a third axis.
    let axis = Vec3::new(0.6, 0.5, -0.3).normalize() * 12f64.to_radians();
    let truth = (0..40).map(|k| Rotation::from_scaled_axis(axis * f64::from(k)));
    let truth: Vec<Rotation> = truth.collect();
    let frames = truth.iter().zip(100..);
    let frames: Vec<PaintedFrame> = frames.map(|(r, seed)| frame(&own, r, seed)).collect();
    let together = tracker.place(&frames, &surface);
    let mut errors = Vec::new();
    for ((shown, together), truth) in frames.iter().zip(&together).zip(&truth) {
        let alone = follower.place(shown).expect("a pose");
        let together = together.as_ref().expect("a pose");
        let off = rotation_angle(&alone.rotation, &together.rotation).to_degrees();
        assert!(off < 3.0, "{off:.2} deg");
        errors.push(rotation_angle(&alone.rotation, truth).to_degrees());
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[20] < 2.5 && errors[39] < 8.0, "{errors:?}");

    let mut follower = PaintedFollower::new(&camera(), surface);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let other = ball(4);
    let lost = (0..12).filter(|_| {
        let shown = frame(&other, &random_rotation(&mut rng), 8);
        follower.place(&shown).is_err()
    });
    assert!(lost.count() >= 11);
    let nothing = follower.place(&PaintedFrame::default());
    assert!(matches!(nothing, Err(PaintedRejection::NoBall)));
}

/// Each frame shows another ball: what agrees, agrees by chance.
#[test]
fn frames_of_unrelated_balls_have_no_pose_beyond_the_first() {
    let sets = [(0, 30.0), (3, 60.0), (1, 36.0), (2, 36.0)];
    for (set, diameter_px) in sets.into_iter().take(crate::common::few_or_all(2, 4)) {
        let mut rng = ChaCha8Rng::seed_from_u64(590 + set);
        let frames: Vec<PaintedFrame> = (0..24)
            .map(|k| {
                let ball = ball_of(1_000 + 100 * set + k, diameter_px);
                frame(&ball, &random_rotation(&mut rng), k)
            })
            .collect();
        let track = tracker().track(&frames);
        assert_eq!(track.poses.iter().flatten().count(), 1, "set {set}");
    }
}

/// Faint clouds under one light, by another renderer than the crate's: parallel rays, another ball in each frame. What the frames have in
/// common is the light.
#[test]
fn light_that_all_frames_share_is_no_paint() {
    let (side, radius) = (66usize, 29.5);
    let middle = 0.5 * (side - 1) as f64;
    let light = Vec3::new(-0.4, 0.5, 0.77);
    for set in 0..crate::common::few_or_all(1, 8) as u64 {
        let mut rng = ChaCha8Rng::seed_from_u64(5_960 + set);
        let mut clouds = || {
            let waves: Vec<(Vec3, f64)> = (0..12)
                .map(|_| {
                    let length = rng.random_range(2.5..7.0);
                    (
                        random_direction(&mut rng) * length,
                        rng.random_range(0.0..TAU),
                    )
                })
                .collect();
            let value = |at: Vec3| {
                let sum: f64 = waves
                    .iter()
                    .map(|(w, phase)| (w.dot(&at) + phase).cos())
                    .sum();
                let paint = 0.5 + 0.04 * sum;
                paint * (0.3 + 0.6 * at.dot(&light).max(0.0))
            };
            let values = (0..side * side).map(|at| {
                let x = ((at % side) as f64 - middle) / radius;
                let y = (middle - (at / side) as f64) / radius;
                let rim = x * x + y * y;
                let lit = if rim < 1.0 {
                    value(Vec3::new(x, y, (1.0 - rim).sqrt()))
                } else {
                    0.0
                };
                (lit + rng.random_range(-0.006..0.006)).clamp(0.0, 1.0) as f32
            });
            GrayImage::new(side, side, values.collect()).unwrap()
        };
        let circle = BallCircle::new(
            Pixel {
                u: middle,
                v: middle,
            },
            radius,
        );
        let outline = Outline::given(circle, Matrix3::zeros());
        let frames: Vec<PaintedFrame> = (0..24)
            .map(|_| PaintedFrame::take(&clouds(), &outline))
            .collect();
        let track = tracker().track(&frames);
        assert_eq!(track.poses.iter().flatten().count(), 1, "set {set}");
    }
}

#[test]
fn a_file_that_is_no_surface_is_refused_by_its_array() {
    let pattern = crate::common::dots20();
    let table = spindoe::Ball::new(pattern).to_npz().unwrap();
    let refused = SurfaceMap::from_npz("table.npz".as_ref(), &table).unwrap_err();
    assert!(refused.to_string().contains("table.npz"), "{refused}");
    assert!(SurfaceMap::from_npz("cut.npz".as_ref(), &table[..100]).is_err());
}

#[cfg(feature = "cli")]
#[test]
fn the_command_follows_a_clip_and_places_another_on_its_surface() {
    use spindoe::spin::orientations::Orientations;
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    let config = SynthConfig {
        kind: SynthKind::Dotless,
        ball_px: Some([80.0; 2]),
        blotches: Some(Blotches::default()),
        max_off_axis_rad: 0.0,
        parallel_share: 0.0,
        camera_distance_radii: [20.0; 2],
        ..SynthConfig::good()
    };
    let text = serde_json::to_string(&config).unwrap();
    std::fs::write(at.join("painted.json"), text).unwrap();
    let done = |words: &str| {
        let words: Vec<&str> = words.split_whitespace().collect();
        crate::common::done(at, &words)
    };
    done(
        "synth --preset painted.json -o clip --frames 30 --fps 200 --rps 5 --exposure-ms 0.2 --seed 3",
    );
    let clip = "clip/images --camera-distance-radii 20";
    let painted = format!("estimate --painted {clip}");
    done(&format!("{painted} -o found.csv --write-surface ball.npz"));
    // A surface says by itself that the ball is painted.
    done(&format!("estimate --table ball.npz {clip} -o again.csv"));
    let read = |name: &str| Orientations::read_csv(&at.join(name)).unwrap();
    let truth = read("clip/orientations.csv");
    for name in ["found.csv", "again.csv"] {
        let found = read(name);
        let (first, base) = (&found.rows[0], truth.rows[0].orientation.unwrap().inverse());
        assert!(first.orientation.is_some(), "{name}");
        let mut placed = 0;
        for (found, truth) in found.rows.iter().zip(&truth.rows) {
            assert!((found.time_s - truth.time_s).abs() < 1e-9);
            if let Some(rotation) = found.orientation {
                let truth = truth.orientation.unwrap() * base;
                let off = rotation_angle(&rotation, &truth).to_degrees();
                assert!(off < 5.0, "{name}, {}: {off:.2} deg", found.frame);
                placed += 1;
            }
        }
        assert!(placed >= 27, "{name}: {placed} of 30");
    }
    let spin = done("spin found.csv --json");
    let spin: serde_json::Value = serde_json::from_str(&spin).unwrap();
    let rps = spin["rps"].as_f64().unwrap();
    assert!((rps - 5.0).abs() < 0.25, "{rps} rps");
    let json = done(&format!(
        "{painted} --json -o by_json.csv --overlay drawn --report page.html"
    ));
    assert_eq!(read("by_json.csv"), read("found.csv"));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    // The same spin by the same motion as of the file.
    let said = json["spin"]["rps"].as_f64().unwrap();
    assert!((said - rps).abs() < 1e-9, "{said} rps");
    assert_eq!(json["spin"]["motion"], spin["motion"]);
    let decaying = done(&format!("{painted} --motion decaying --json"));
    let decaying: serde_json::Value = serde_json::from_str(&decaying).unwrap();
    assert!(
        decaying["spin"]["decay"].is_object(),
        "{}",
        decaying["spin"]
    );
    let frames = json["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 30);
    for (frame, row) in frames.iter().zip(read("found.csv").rows) {
        let found = frame["orientation_wxyz"].is_array();
        assert_eq!(found, row.orientation.is_some(), "{}", row.frame);
        assert_ne!(found, frame["refusal"].is_string(), "{}", row.frame);
    }
    #[cfg(feature = "plot")]
    is_drawn(at, frames);
    is_followed_live(at, &truth);
    for flag in ["--min-confidence=0.5", "--no-sequence"] {
        let name = flag.split('=').next().unwrap();
        for ball in ["--painted", "--table=ball.npz"] {
            let args = ["estimate", ball, "clip/images", flag];
            crate::common::refused(at, &args, 2, name);
        }
    }
    let known = ["estimate", "clip/images", "--table", "ball.npz"];
    for (more, flag) in [
        (&["--write-surface", "b.npz"][..], "--write-surface"),
        (&["--painted"], "--painted"),
        (&["--table", "dots20"], "surface of a painted ball"),
    ] {
        crate::common::refused(at, &[&known[..], more].concat(), 2, flag);
    }
    let dots = ["estimate", "--table", "dots20", "clip/images"];
    let written = [&dots[..], &["--write-surface", "b.npz"]].concat();
    crate::common::refused(at, &written, 2, "--painted");
    // Without the camera's distance, which is fitted: three quarters of a turn say hardly more than that it is near 5 rps.
    done("estimate --painted clip/images -o free.csv");
    let spin = done("spin free.csv --json");
    let spin: serde_json::Value = serde_json::from_str(&spin).unwrap();
    let rps = spin["rps"].as_f64().unwrap();
    assert!((rps - 5.0).abs() < 0.25, "{rps} rps");
}

/// Every frame is drawn, and the page has every frame with its picture, as JSON has it.
#[cfg(all(feature = "cli", feature = "plot"))]
fn is_drawn(at: &std::path::Path, frames: &[serde_json::Value]) {
    let drawn = std::fs::read_dir(at.join("drawn")).unwrap();
    assert_eq!(drawn.count(), frames.len() + 1, "and the contact sheet");
    assert!(at.join("drawn/contact_sheet.png").exists());
    let ball = &crate::report::page_data(&at.join("page.html"))["content"]["balls"][0];
    assert!(ball["paint"]["known"].as_f64().unwrap() > 0.5);
    let shown = ball["frames"].as_array().unwrap();
    assert_eq!(shown.len(), frames.len());
    for (shown, frame) in shown.iter().zip(frames) {
        assert_eq!(shown["name"], frame["frame"]);
        assert_eq!(shown["rejection"], frame["refusal"]);
        assert!(shown["picture"].is_string() && shown["confidence"].is_null());
        let off =
            shown["agreement"].as_f64().unwrap_or(0.0) - frame["agreement"].as_f64().unwrap_or(0.0);
        assert!(off.abs() < 1e-3, "{shown}");
    }
}

#[cfg(feature = "cli")]
/// The clip's frames as they come, on its surface: lines of JSON, and FicTrac's.
#[cfg(feature = "cli")]
fn is_followed_live(at: &std::path::Path, truth: &spindoe::spin::orientations::Orientations) {
    let images = std::fs::read_dir(at.join("clip/images")).unwrap();
    let mut files: Vec<_> = images.map(|file| file.unwrap().path()).collect();
    files.sort();
    let stream = files.iter().flat_map(|path| std::fs::read(path).unwrap());
    std::fs::write(at.join("stream"), stream.collect::<Vec<u8>>()).unwrap();
    let distance = ["--config", "camera_distance_radii=20"];
    let live = ["live", "stream", "--table", "ball.npz", "--fps", "200"];
    let live = [&live[..], &distance].concat();
    let lines = crate::common::done(at, &live);
    let lines: Vec<serde_json::Value> = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(lines.len(), 30);
    let base = truth.rows[0].orientation.unwrap().inverse();
    let mut placed = 0;
    for (line, truth) in lines.iter().zip(&truth.rows) {
        let wxyz = &line["orientation_wxyz"];
        assert_ne!(wxyz.is_array(), line["refusal"].is_string(), "{line}");
        if wxyz.is_array() {
            let wxyz: [f64; 4] = serde_json::from_value(wxyz.clone()).unwrap();
            let found = spindoe::geometry::from_wxyz(wxyz, 1e-6).unwrap();
            let off = rotation_angle(&found, &(truth.orientation.unwrap() * base)).to_degrees();
            assert!(off < 8.0, "{off:.2} deg: {line}");
            placed += 1;
        }
    }
    assert!(placed >= 25, "{placed} of 30");
    let rps = lines[29]["spin"]["rps"].as_f64().unwrap();
    assert!((rps - 5.0).abs() < 0.5, "{rps} rps");
    let rows = crate::common::done(at, &[&live[..], &["--as", "fictrac"]].concat());
    assert_eq!(rows.lines().count(), placed);
    for more in [&["--max-latency-ms", "5"][..], &["--balls", "auto"]] {
        crate::common::refused(at, &[&live[..], more].concat(), 2, more[0]);
    }
}

#[test]
fn a_clip_without_a_ball_leaves_no_surface() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    std::fs::create_dir(at.join("black")).unwrap();
    for k in 0..2 {
        let black = image::GrayImage::new(64, 64);
        black.save(at.join(format!("black/{k}.png"))).unwrap();
    }
    let args = "estimate --painted black --write-surface ball.npz -o found.csv --overlay drawn --report page.html";
    let args: Vec<&str> = args.split(' ').collect();
    let output = crate::common::spindoe(at, &args);
    assert_eq!(output.status.code(), Some(3));
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(words.contains("no frame shows the paint"), "{words}");
    assert!(at.join("found.csv").exists() && !at.join("ball.npz").exists());
    // What was not found is shown, too.
    assert!(at.join("drawn/contact_sheet.png").exists() && at.join("page.html").exists());
}

/// A ball with dark caps before bare gray, by another renderer than the crate's: parallel rays, light from the upper left, four
/// samples a pixel. Middle gray lies between the ball's lit and its dark side.
fn drawn(
    caps: &[(Vec3, f64, f64)],
    rotation: &Rotation,
    center: [f64; 2],
    noise: u64,
) -> GrayImage {
    let (width, height, radius) = (640usize, 480usize, 50.0);
    let turned: Vec<(Vec3, f64, f64)> = caps
        .iter()
        .map(|(d, c, g)| (rotation * d, *c, *g))
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(noise);
    let shade = |x: f64, y: f64| {
        let rim = x * x + y * y;
        (rim < 1.0).then(|| {
            let at = Vec3::new(x, y, (1.0 - rim).sqrt());
            let covering = turned.iter().rfind(|(d, cos, _)| d.dot(&at) > *cos);
            let paint = covering.map_or(0.85, |c| c.2);
            paint * (0.35 + 0.65 * at.dot(&Vec3::new(-0.4, 0.5, 0.77)).max(0.0))
        })
    };
    let mut values = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let mut sum = 0.0;
            for (du, dv) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                let x = (column as f64 + du - center[0]) / radius;
                let y = (center[1] - row as f64 - dv) / radius;
                sum += shade(x, y).unwrap_or(0.5);
            }
            let value = 0.25 * sum + rng.random_range(-0.012..0.012);
            values.push(value.clamp(0.0, 1.0) as f32);
        }
    }
    GrayImage::new(width, height, values).unwrap()
}

#[test]
fn a_painted_ball_is_found_and_followed_in_a_large_picture() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let caps: Vec<(Vec3, f64, f64)> = (0..26)
        .map(|_| {
            let direction = random_rotation(&mut rng) * Vec3::z();
            let reach: f64 = rng.random_range(0.12..0.45);
            (
                direction,
                reach.cos(),
                [0.15, 0.25, 0.5][rng.random_range(0..3)],
            )
        })
        .collect();
    let camera = CameraModel::Known(Camera::Near {
        inverse_distance: 0.0,
    });
    let finder =
        OutlineFinder::new(CircleConfig::default(), OutlineMethod::default(), &camera).unwrap();
    let mut workspace = finder.workspace();
    let axis = Vec3::new(0.48, 0.6, 0.64);
    let truth: Vec<Rotation> = (0..20)
        .map(|k| Rotation::from_scaled_axis(axis * (8.0 * f64::from(k)).to_radians()))
        .collect();
    let mut offs = Vec::new();
    let frames: Vec<PaintedFrame> = (0u64..)
        .zip(&truth)
        .map(|(k, rotation)| {
            let center = [250.0 + 1.5 * k as f64, 210.0 + 0.4 * k as f64];
            let image = drawn(&caps, rotation, center, k);
            let mut found = FrameEstimate::default();
            finder.find(&image, &Prior::default(), &mut workspace, &mut found);
            let outline = found
                .outline
                .unwrap_or_else(|| panic!("frame {k}: {:?}", found.outcome));
            let circle = outline.circle;
            let off = (circle.center.u - center[0]).hypot(circle.center.v - center[1]);
            offs.push(off);
            PaintedFrame::take(&image, &outline)
        })
        .collect();
    // Paint as bright as what is behind it hides the outline where it is at the rim, in a fifth of the frames.
    offs.sort_by(f64::total_cmp);
    assert!(offs[15] < 1.0 && offs[19] < 4.0, "{offs:?}");
    let track = PaintedTracker::new(&camera).track(&frames);
    let posed = track.poses.iter().zip(&truth).filter_map(|(pose, truth)| {
        let pose = pose.as_ref().ok()?;
        Some(rotation_angle(&pose.rotation, truth).to_degrees())
    });
    let errors: Vec<f64> = posed.collect();
    assert!(errors.len() >= 18, "{} of 20", errors.len());
    assert!(errors.iter().all(|e| *e < 5.0), "{errors:.1?}");
}
