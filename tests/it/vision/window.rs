//! Parts of frames: regions of interest, frames as bytes, the window in which a ball is followed, and
//! frames whose neighbors know where the ball is.

use std::sync::Arc;

use spindoe::clip::{
    SequenceConfig, Tracker, TrackerConfig, frames_in_doubt, held_images, second_pass,
};
use spindoe::image::{ImageView, RawImage, RawPixel, RgbImage, Roi};
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, FrameTruth, SynthSequence};
use spindoe::vision::frame::OutlineSource;
use spindoe::vision::{
    BallCircle, Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate,
    FrameRejection, Intrinsics, OutlinePrior, Pixel, Prior,
};

const SIZE: [usize; 2] = [800, 600];
const FPS: f64 = 350.0;
/// Radius of the disc that stands still, pixels.
const DISC: f64 = 42.0;

struct Clip {
    pattern: Pattern,
    frames: Vec<(RgbImage, FrameTruth)>,
}

/// A ball of 60 px that flies through large frames.
fn clip(seed: u64, count: usize) -> Clip {
    let pattern = crate::common::random_pattern(20, 5);
    let config = SynthConfig {
        image_px: Some(SIZE),
        ball_px: Some([60.0; 2]),
        camera_distance_radii: [20.0; 2],
        parallel_share: 0.0,
        ..SynthConfig::good()
    };
    let sequence = ClipConfig {
        fps: FPS,
        drift_px: Some([10.0 * count as f64, -4.0 * count as f64]),
        ..ClipConfig::default()
    };
    // The first of which the ball stays in view.
    for seed in seed.. {
        let sequence = SynthSequence::random(&pattern, &config, &sequence, seed, count).unwrap();
        let is_whole = |k| sequence.frame(k).unwrap().truth.rim_visible > 0.99;
        if is_whole(0) && is_whole(count - 1) {
            let frame = |k| {
                let frame = sequence.frame(k).unwrap();
                (frame.image, frame.truth)
            };
            let frames = (0..count).map(frame).collect();
            return Clip { pattern, frames };
        }
    }
    unreachable!("one of the seeds does");
}

fn gray_bytes(image: &RgbImage) -> Vec<u8> {
    let values = image.to_gray();
    let values = values.values().iter();
    values.map(|x| (255.0 * x + 0.5) as u8).collect()
}

fn raw(bytes: &[u8]) -> RawImage<'_> {
    RawImage::new(SIZE[0], SIZE[1], RawPixel::Gray, bytes).unwrap()
}

fn outline(truth: &FrameTruth) -> BallCircle {
    BallCircle::new(truth.center, truth.radius_px)
}

fn apart(a: &BallCircle, b: &BallCircle) -> f64 {
    (a.center.u - b.center.u).hypot(a.center.v - b.center.v)
}

fn estimator(pattern: &Pattern) -> Estimator {
    let detector = DetectorName::Cnn.build().unwrap();
    Estimator::new(pattern, EstimatorConfig::default(), detector).unwrap()
}

fn tracker(pattern: &Pattern) -> Tracker {
    Tracker::new(Arc::new(estimator(pattern)), TrackerConfig::default()).unwrap()
}

/// Draws a white disc.
fn draw_disc(bytes: &mut [u8], center: [f64; 2]) {
    for (i, byte) in bytes.iter_mut().enumerate() {
        let (u, v) = ((i % SIZE[0]) as f64, (i / SIZE[0]) as f64);
        if (u - center[0]).hypot(v - center[1]) < DISC {
            *byte = 250;
        }
    }
}

/// Far from the ball's path, and within the image.
fn beside(clip: &Clip) -> [f64; 2] {
    let middle = clip.frames[clip.frames.len() / 2].1.center;
    let far = |at: f64, size: usize| {
        let size = size as f64;
        if at > 0.5 * size {
            0.15 * size
        } else {
            0.85 * size
        }
    };
    [far(middle.u, SIZE[0]), far(middle.v, SIZE[1])]
}

#[test]
fn the_window_has_what_the_whole_frame_has() {
    let clip = clip(11, 16);
    let (mut tracker, estimator) = (tracker(&clip.pattern), estimator(&clip.pattern));
    let (mut ws, mut alone) = (estimator.workspace(), FrameEstimate::default());
    let mut both = 0;
    for (image, truth) in &clip.frames {
        let bytes = gray_bytes(image);
        let state = tracker
            .update(raw(&bytes), truth.time_s.unwrap(), None)
            .unwrap();
        estimator.estimate(
            raw(&bytes),
            &Prior::default(),
            &Budget::default(),
            &mut ws,
            &mut alone,
        );
        if let (Some(a), Some(b)) = (state.frame.pose(), alone.pose()) {
            both += 1;
            assert!(a.rotation.angle_to(&b.rotation).to_degrees() < 1.5);
            assert!(a.rotation.angle_to(&truth.orientation()).to_degrees() < 20.0);
            let (a, b) = (state.frame.circle.unwrap(), alone.circle.unwrap());
            assert!(
                apart(&a, &b) < 0.3 && (a.radius - b.radius).abs() < 0.3,
                "{a:?} {b:?}"
            );
            assert!(apart(&a, &outline(truth)) < 0.05 * a.radius);
        }
    }
    assert!(both >= 15, "{both}");
}

#[test]
fn a_disc_that_stands_still_is_not_the_ball() {
    let clip = clip(23, 24);
    let place = beside(&clip);
    let (mut tracker, estimator) = (tracker(&clip.pattern), estimator(&clip.pattern));
    let (mut ws, mut alone) = (estimator.workspace(), FrameEstimate::default());
    let (mut followed, mut found) = (0, 0);
    for (image, truth) in &clip.frames {
        let mut bytes = gray_bytes(image);
        draw_disc(&mut bytes, place);
        let state = tracker
            .update(raw(&bytes), truth.time_s.unwrap(), None)
            .unwrap();
        estimator.estimate(
            raw(&bytes),
            &Prior::default(),
            &Budget::default(),
            &mut ws,
            &mut alone,
        );
        for (frame, count) in [(state.frame, &mut followed), (&alone, &mut found)] {
            if let (Some(pose), Some(circle)) = (frame.pose(), frame.circle) {
                assert!(apart(&circle, &outline(truth)) < 0.2 * truth.radius_px);
                assert!(pose.rotation.angle_to(&truth.orientation()).to_degrees() < 20.0);
                *count += 1;
            }
        }
    }
    assert!(followed >= 23, "{followed} of 24 followed");
    assert!(found >= 20, "{found} of 24 found in the frame alone");
}

#[test]
fn of_two_circles_without_dots_the_moving_one_is_shown() {
    let disc = |u: f64| {
        let mut bytes = vec![30; SIZE[0] * SIZE[1]];
        draw_disc(&mut bytes, [150.0, 300.0]);
        draw_disc(&mut bytes, [u, 200.0]);
        bytes
    };
    let mut tracker = tracker(&crate::common::random_pattern(20, 5));
    for k in 0..4 {
        let u = 450.0 + 20.0 * f64::from(k);
        let state = tracker
            .update(raw(&disc(u)), f64::from(k) / FPS, None)
            .unwrap();
        assert!(state.frame.pose().is_none());
        let circle = state.frame.circle.expect("a circle");
        // Motion is seen from the second frame on.
        if k > 0 {
            assert!((circle.center.u - u).abs() < 5.0, "{k}: {circle:?}");
        }
    }
}

#[test]
fn a_ball_that_jumps_is_found_again() {
    let clip = clip(11, 16);
    let mut tracker = tracker(&clip.pattern);
    // Every fifth frame is black: the ball is elsewhere then.
    let mut answered = 0;
    for (k, (image, truth)) in clip.frames.iter().enumerate() {
        let bytes = match k % 5 {
            4 => vec![0; SIZE[0] * SIZE[1]],
            _ => gray_bytes(image),
        };
        let state = tracker
            .update(raw(&bytes), truth.time_s.unwrap(), None)
            .unwrap();
        assert!(k % 5 != 4 || state.frame.pose().is_none());
        answered += usize::from(state.frame.pose().is_some());
    }
    assert!(answered >= 12, "{answered} of 13");
    // It turns up at the other end of the frame: after a few frames it is followed there.
    let mut answered = 0;
    for k in 0..8 {
        let (image, truth) = &clip.frames[k];
        let mut bytes = gray_bytes(image);
        bytes.reverse();
        let time_s = clip.frames[15].1.time_s.unwrap() + (k + 1) as f64 / FPS;
        let state = tracker.update(raw(&bytes), time_s, None).unwrap();
        let center = Pixel {
            u: SIZE[0] as f64 - 1.0 - truth.center.u,
            v: SIZE[1] as f64 - 1.0 - truth.center.v,
        };
        if let (Some(_), Some(circle)) = (state.frame.pose(), state.frame.circle) {
            answered += 1;
            assert!((circle.center.u - center.u).hypot(circle.center.v - center.v) < 3.0);
        }
    }
    assert!(answered >= 4, "{answered} of 8");
}

#[test]
fn a_warm_tracker_of_whole_frames_does_not_allocate() {
    let clip = clip(11, 16);
    let frames: Vec<Vec<u8>> = clip.frames.iter().map(|f| gray_bytes(&f.0)).collect();
    let mut tracker = tracker(&clip.pattern);
    let mut time_s = 0.0;
    // Forth and back, so that it moves on; lost now and then.
    let mut run = |rounds: usize| {
        for round in 0..rounds {
            for k in 0..16 {
                let k = if round % 2 == 0 { k } else { 15 - k };
                if k == 8 {
                    tracker.reset();
                }
                time_s += 1.0 / FPS;
                tracker.update(raw(&frames[k]), time_s, None).unwrap();
            }
        }
    };
    let cold = allocation_counter::measure(|| run(1));
    assert!(cold.count_total > 0, "the counter does not count");
    // Both ways.
    run(2);
    let warm = allocation_counter::measure(|| run(4));
    assert_eq!(warm.count_total, 0);
}

#[test]
fn a_region_gives_the_frames_pixels_and_is_within_the_frame() {
    let clip = clip(11, 2);
    let (image, truth) = &clip.frames[0];
    let intrinsics = Intrinsics::pinhole(900.0, 900.0, 400.0, 300.0);
    let settings = EstimatorConfig {
        camera: Camera::Perspective(intrinsics).into(),
        ..EstimatorConfig::default()
    };
    let detector = DetectorName::Cnn.build().unwrap();
    let known = Estimator::new(&clip.pattern, settings, detector).unwrap();
    for estimator in [estimator(&clip.pattern), known] {
        let (mut ws, mut part) = (estimator.workspace(), FrameEstimate::default());
        let roi = outline(truth).region(2.5, SIZE[0], SIZE[1]).unwrap();
        let within = Prior {
            region: Some(roi),
            ..Prior::default()
        };
        estimator.estimate(image, &within, &Budget::default(), &mut ws, &mut part);
        let mut whole = FrameEstimate::default();
        estimator.estimate(
            image,
            &Prior::default(),
            &Budget::default(),
            &mut ws,
            &mut whole,
        );
        assert!(part.pose().is_some() && whole.pose().is_some());
        let (a, b) = (part.pose().unwrap(), whole.pose().unwrap());
        assert!(a.rotation.angle_to(&b.rotation).to_degrees() < 2.0);
        assert!(apart(&part.circle.unwrap(), &whole.circle.unwrap()) < 0.5);
        let beyond = Roi {
            left: SIZE[0] - 10,
            width: 11,
            ..roi
        };
        let error = beyond.within(SIZE[0], SIZE[1]).unwrap_err();
        assert!(error.to_string().contains("800 x 600"), "{error}");
        let outside = Prior {
            region: Some(Roi {
                left: SIZE[0],
                ..roi
            }),
            ..Prior::default()
        };
        estimator.estimate(image, &outside, &Budget::default(), &mut ws, &mut part);
        assert!(matches!(part.outcome, Err(FrameRejection::NoBall(_))));
    }
}

/// Images of any shape, with anything known of them, are answered or refused, in colors, gray and bytes.
#[test]
fn no_shape_of_an_image_is_too_thin() {
    let sizes = [
        [100_000, 1],
        [1, 100_000],
        [65_000, 3],
        [3, 65_000],
        [3, 1000],
        [1000, 9],
        [490, 5],
        [2, 481],
        [1, 1],
        [7, 7],
        [2_100_000, 2],
    ];
    let estimator = estimator(&crate::common::random_pattern(20, 5));
    let mut ws = estimator.workspace();
    let mut out = FrameEstimate::default();
    for [width, height] in sizes {
        let noise = |k: usize| (k as u32).wrapping_mul(2_654_435_761).to_be_bytes()[0];
        let bytes: Vec<u8> = (0..3 * width * height).map(noise).collect();
        let raw = RawImage::new(width, height, RawPixel::Rgb, &bytes).unwrap();
        let gray = RawImage::new(width, height, RawPixel::Gray, &bytes[..width * height]).unwrap();
        let center = Pixel {
            u: 0.5 * width as f64,
            v: 0.5 * height as f64,
        };
        for radius in [None, Some(0.5), Some(30.0), Some(1e4)] {
            for part in [0.01, 1.5, f64::INFINITY] {
                let outline = radius.map(|radius| OutlinePrior {
                    sigma_px: part * radius,
                    ..OutlinePrior::given(BallCircle::new(center, radius))
                });
                let prior = Prior {
                    outline,
                    ..Prior::default()
                };
                for image in [raw, gray] {
                    estimator.estimate(image, &prior, &Budget::default(), &mut ws, &mut out);
                    assert!(out.pose().is_none(), "{width} x {height}: {prior:?}");
                }
            }
        }
    }
}

/// A ball of 60 px that leaves a picture of 400 x 300 to the left, 45 pixels a frame, from many places.
#[test]
fn a_ball_may_leave_the_picture() {
    let clip = clip(21, 1);
    let (frame, truth) = &clip.frames[0];
    let bytes = gray_bytes(frame);
    let column = |v: usize, u: f64| {
        let u = u.clamp(0.0, SIZE[0] as f64 - 1.0) as usize;
        bytes[v * SIZE[0] + u]
    };
    let [width, height] = [400, 300];
    let top = (truth.center.v as usize).saturating_sub(height / 2);
    let top = top.min(SIZE[1] - height);
    for start in (0..45).step_by(crate::common::few_or_all(5, 1)) {
        let mut tracker = tracker(&clip.pattern);
        let mut seen = 0;
        for k in 0..8 {
            let left = truth.center.u - 160.0 + f64::from(start + 45 * k);
            let rows = (top..top + height)
                .flat_map(|v| (0..width).map(move |u| (v, u)))
                .map(|(v, u)| column(v, left + u as f64));
            let part: Vec<u8> = rows.collect();
            let image = RawImage::new(width, height, RawPixel::Gray, &part).unwrap();
            let state = tracker.update(image, f64::from(k) / FPS, None).unwrap();
            seen += usize::from(state.frame.pose().is_some());
        }
        assert!(seen > 0, "start {start}");
    }
}

/// Frames too large to be searched thoroughly: the ball is 60 pixels of 3840.
#[test]
fn a_small_ball_in_a_very_large_frame_is_found() {
    const LARGE: [usize; 2] = [3840, 2160];
    let clip = clip(11, 1);
    let (image, truth) = &clip.frames[0];
    let (left, top) = (2501, 702);
    let mut bytes = vec![20; 3 * LARGE[0] * LARGE[1]];
    for (v, row) in image.values().chunks_exact(SIZE[0]).enumerate() {
        let row = row.iter().flatten().map(|x| (255.0 * x + 0.5) as u8);
        let at = 3 * ((top + v) * LARGE[0] + left);
        bytes[at..at + 3 * SIZE[0]].copy_from_slice(&row.collect::<Vec<u8>>());
    }
    let large = RawImage::new(LARGE[0], LARGE[1], RawPixel::Rgb, &bytes).unwrap();
    let estimator = estimator(&clip.pattern);
    let (mut ws, mut found) = (estimator.workspace(), FrameEstimate::default());
    estimator.estimate(
        large,
        &Prior::default(),
        &Budget::default(),
        &mut ws,
        &mut found,
    );
    let pose = found.pose().expect("the ball is seen");
    assert!(pose.rotation.angle_to(&truth.orientation()).to_degrees() < 20.0);
    let circle = found.circle.unwrap();
    let off = Pixel {
        u: truth.center.u + left as f64 - circle.center.u,
        v: truth.center.v + top as f64 - circle.center.v,
    };
    assert!(off.u.hypot(off.v) < 1.5, "{off:?}");
}

#[test]
fn bytes_are_the_values_of_an_image_file() {
    let clip = clip(11, 1);
    let image = &clip.frames[0].0;
    let bytes = image.to_bytes();
    let decoded = RgbImage::new(
        SIZE[0],
        SIZE[1],
        bytes
            .chunks_exact(3)
            .map(|c| [c[0], c[1], c[2]].map(|b| f32::from(b) / 255.0))
            .collect(),
    );
    let decoded = decoded.unwrap();
    let raw = RawImage::new(SIZE[0], SIZE[1], RawPixel::Rgb, &bytes).unwrap();
    assert_eq!(raw.to_rgb(), decoded);
    assert_eq!(raw.to_gray(), decoded.to_gray());
    let estimator = estimator(&clip.pattern);
    let mut ws = estimator.workspace();
    let [mut a, mut b] = [FrameEstimate::default(), FrameEstimate::default()];
    estimator.estimate(raw, &Prior::default(), &Budget::default(), &mut ws, &mut a);
    estimator.estimate(
        &decoded,
        &Prior::default(),
        &Budget::default(),
        &mut ws,
        &mut b,
    );
    let (a, b) = (a.pose().expect("a pose"), b.pose().expect("a pose"));
    assert!(a.rotation.angle_to(&b.rotation).to_degrees() < 0.1);
    for (width, height, bytes) in [
        (3, 2, &bytes[..5]),
        (0, 0, &[]),
        (usize::MAX, 2, &bytes[..]),
    ] {
        let error = RawImage::new(width, height, RawPixel::Gray, bytes).unwrap_err();
        assert!(error.to_string().starts_with("image"), "{error}");
    }
}

#[test]
fn neighbors_know_where_the_ball_is() {
    let clip = clip(11, 16);
    let estimator = estimator(&clip.pattern);
    let mut ws = estimator.workspace();
    let config = SequenceConfig::default();
    let times_s: Vec<f64> = clip.frames.iter().map(|f| f.1.time_s.unwrap()).collect();
    let mut frames: Vec<FrameEstimate> = clip
        .frames
        .iter()
        .map(|(image, _)| {
            let mut out = FrameEstimate::default();
            estimator.estimate(
                image,
                &Prior::default(),
                &Budget::default(),
                &mut ws,
                &mut out,
            );
            out
        })
        .collect();
    // One finds nothing, one something else.
    frames[6] = FrameEstimate::default();
    let elsewhere = BallCircle::new(Pixel { u: 60.0, v: 60.0 }, 25.0);
    let image = &clip.frames[9].0;
    let given = OutlinePrior::given(elsewhere);
    estimator.detect(image, Some(&given), &mut ws, &mut frames[9]);
    frames[9].outline.as_mut().unwrap().source = OutlineSource::Detected;
    let doubts = frames_in_doubt(&config, &times_s, &frames);
    let numbers: Vec<usize> = doubts.iter().map(|d| d.frame).collect();
    assert!(numbers.contains(&6) && numbers.contains(&9), "{numbers:?}");
    for doubt in &doubts {
        let truth = &clip.frames[doubt.frame].1;
        let expected = doubt.prior.outline.expect("an outline").circle;
        assert!(apart(&expected, &outline(truth)) < 0.05 * truth.radius_px);
    }
    let images: Vec<ImageView<'_>> = clip.frames.iter().map(|f| (&f.0).into()).collect();
    let held = held_images(&estimator, &images);
    let Ok(summary) = second_pass(&estimator, &config, &times_s, &mut frames, held);
    assert!(summary.together > summary.alone, "{summary:?}");
    for k in [6, 9] {
        let pose = frames[k].pose().expect("a pose");
        let outline = frames[k].outline.expect("an outline");
        assert_eq!(outline.source, OutlineSource::Neighbors);
        let truth = clip.frames[k].1.orientation();
        assert!(pose.rotation.angle_to(&truth).to_degrees() < 20.0);
    }
    // A wrong expectation changes nothing where there is no ball.
    let mut wrong = doubts[0];
    wrong.prior.outline = Some(OutlinePrior {
        sigma_px: 4.0,
        ..OutlinePrior::given(elsewhere)
    });
    let again = estimator.estimate_again(image, &wrong, &frames[3], None, &mut ws);
    assert!(again.is_none(), "{again:?}");
    // Nor is a given outline looked for elsewhere.
    frames[6].outcome = FrameEstimate::default().outcome;
    frames[6].outline.as_mut().unwrap().source = OutlineSource::Given;
    let doubts = frames_in_doubt(&config, &times_s, &frames);
    let given = doubts.iter().find(|d| d.frame == 6).expect("in doubt");
    let kept = given.prior.outline.expect("an outline").circle;
    assert_eq!(kept, frames[6].outline.expect("an outline").circle);
}

#[test]
fn the_command_looks_where_it_is_asked_to() {
    let clip = clip(11, 2);
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    clip.pattern.write_csv(&at("pattern.csv")).unwrap();
    std::fs::create_dir(at("in")).unwrap();
    for (k, (image, _)) in clip.frames.iter().enumerate() {
        image.write_png(&at(&format!("in/f{k}.png"))).unwrap();
    }
    let base = [
        "estimate",
        "--table",
        "pattern.csv",
        "in",
        "--config=no_verdict=true",
        "--json",
    ];
    let json = |more: &[&str]| -> serde_json::Value {
        let text = crate::common::done(dir.path(), &[&base[..], more].concat());
        serde_json::from_str(&text).unwrap()
    };
    let truth = outline(&clip.frames[0].1);
    let roi = truth.region(2.5, SIZE[0], SIZE[1]).unwrap();
    let roi = format!("{},{},{},{}", roi.left, roi.top, roi.width, roi.height);
    let found = json(&["--roi", &roi, "--config", "outline=edges"]);
    for (frame, (_, truth)) in found["frames"].as_array().unwrap().iter().zip(&clip.frames) {
        assert!(frame["orientation_wxyz"].is_array(), "{frame}");
        assert!((frame["circle"]["u"].as_f64().unwrap() - truth.center.u).abs() < 2.0);
        assert_eq!(frame["outline_source"], "detected");
    }
    let row = format!("f0,{},{},{}", truth.center.u, truth.center.v, truth.radius);
    std::fs::write(at("circles.csv"), format!("frame,u,v,radius\n{row}\n")).unwrap();
    let found = json(&["--circle", "circles.csv"]);
    assert_eq!(found["frames"][0]["outline_source"], "given");
    assert_eq!(found["frames"][1]["outline_source"], "detected");
    assert!(found["frames"][0]["orientation_wxyz"].is_array());
    std::fs::write(at("bad.csv"), "frame,u,v,radius\nf0,10,10,-3\n").unwrap();
    for (wrong, needle) in [
        (["--roi", "0,0,9000,10"], "--roi: expected a region within"),
        (["--roi", "1,2"], "--roi: expected X,Y,WIDTH,HEIGHT"),
        (
            ["--circle", "bad.csv"],
            "line 2: radius: expected a positive",
        ),
        (["--config", "outline=guess"], "--outline"),
    ] {
        let output = crate::common::spindoe(dir.path(), &[&base[..], &wrong].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {words}");
        assert!(words.contains(needle), "{wrong:?}: {words}");
        assert!(output.stdout.is_empty());
    }
}
