//! The dot detector: its weights as a file, its numbers against ONNX Runtime, its dots against the truth.

use std::path::Path;
use std::process::Command;

use spindoe::stats::Proportion;
use spindoe::synth::dataset::frame_rng;
use spindoe::synth::{Rendering, Scene, SynthConfig};
use spindoe::vision::dots::net::CnnDetector;
use spindoe::vision::dots::patch::Patch;
use spindoe::vision::net::graph::Head;
use spindoe::vision::net::{Weights, onnx};
use spindoe::vision::{
    Budget, DotDetection, Estimator, EstimatorConfig, FrameEstimate, OutlinePrior, Prior,
};

/// Frames in good light, without logos, of balls at least 50 pixels wide.
fn easy() -> SynthConfig {
    SynthConfig {
        ball_px: None,
        size_px: [60, 80],
        max_arc_rad: 0.03,
        max_shift_px: 0.3,
        max_noise: 0.5,
        bad_exposure: 0.0,
        dot_radius_rad: [0.07, 0.10],
        ..SynthConfig::good().unprinted()
    }
}

fn frames(config: &SynthConfig, count: u64) -> Vec<Rendering> {
    let pattern = crate::common::random_pattern(20, 5);
    (0..count)
        .map(|k| {
            let mut rng = frame_rng(990_017, k);
            let scene = Scene::random(&pattern, config, &mut rng).unwrap();
            scene.render().unwrap()
        })
        .collect()
}

#[test]
fn finds_the_dots_of_easy_frames_within_a_pixel() {
    let detector = CnnDetector::built_in().unwrap();
    let (mut ws, mut found): (_, Vec<DotDetection>) = (detector.workspace(), Vec::new());
    let (mut dots, mut hits, mut wrong) = (0, 0, 0);
    let mut squared = Vec::new();
    for frame in frames(&easy(), 60) {
        let patch = Patch::cut(&frame.image.to_gray(), &frame.circle);
        detector.detect_into(&patch, &mut ws, &mut found);
        let away =
            |d: &DotDetection, p: spindoe::vision::Pixel| (d.pixel.u - p.u).hypot(d.pixel.v - p.v);
        for dot in frame.dots.iter().filter(|d| d.is_visible()) {
            dots += 1;
            let likely = found.iter().filter(|d| d.probability >= 0.5);
            let near = likely.clone().find(|d| away(d, dot.pixel) < 1.0);
            if let Some(d) = near {
                hits += 1;
                let e = nalgebra::Vector2::new(d.pixel.u - dot.pixel.u, d.pixel.v - dot.pixel.v);
                squared.push(e.dot(&(d.covariance.try_inverse().unwrap() * e)));
            }
        }
        wrong += found
            .iter()
            .filter(|d| d.probability >= 0.5)
            .filter(|d| frame.dots.iter().all(|t| away(d, t.pixel) > 2.0))
            .count();
    }
    assert!(hits as f64 > 0.9 * dots as f64, "{hits} of {dots}");
    assert!((wrong as f64) < 0.02 * dots as f64, "{wrong} false");
    // Two Gaussian dimensions have the median 1.39; these frames are easier than those of the calibration.
    squared.sort_by(f64::total_cmp);
    let median = squared[squared.len() / 2];
    assert!((0.3..3.0).contains(&median), "{median}");
}

#[test]
fn a_black_ball_and_plain_noise_show_no_dots() {
    let detector = CnnDetector::built_in().unwrap();
    let (mut ws, mut found) = (detector.workspace(), Vec::new());
    let circle = frames(&easy(), 1)[0].circle;
    for level in [0.0, 0.5, 1.0] {
        let image = spindoe::image::GrayImage::from_fn(70, 70, |_, _| level);
        detector.detect_into(&Patch::cut(&image, &circle), &mut ws, &mut found);
        let likely = found.iter().filter(|d| d.probability >= 0.5).count();
        assert_eq!(likely, 0, "{level}: {found:?}");
    }
}

#[test]
fn onnx_runtime_gives_the_same_cells() {
    let probe = Command::new("python3")
        .args(["-c", "import numpy, onnxruntime"])
        .output();
    if !probe.is_ok_and(|p| p.status.success()) {
        crate::common::skipped("python3 with NumPy and ONNX Runtime is not installed");
        return;
    }
    for head in [Head::Dots, Head::DotsLarge] {
        check_onnx(head);
    }
}

fn check_onnx(head: Head) {
    let weights = Weights::built_in(head).unwrap();
    let detector = CnnDetector::new(&weights).unwrap();
    let mut ws = detector.workspace();
    let (mut patches, mut cells) = (Vec::new(), Vec::new());
    for frame in frames(&SynthConfig::default(), 12) {
        let patch = Patch::cut(&frame.image.to_gray(), &frame.circle);
        patches.extend(patch.values().iter().flat_map(|x| x.to_le_bytes()));
        let out = detector.cells(&patch, &mut ws);
        cells.extend(out.iter().flat_map(|x| x.to_le_bytes()));
    }
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/check_onnx.py");
    let checked = Command::new("python3")
        .arg(script)
        .arg(file("dots.onnx", &onnx::to_onnx(&weights)))
        .arg(file("patches.f32", &patches))
        .arg(file("cells.f32", &cells))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    let complaint = String::from_utf8_lossy(&checked.stderr);
    assert!(checked.status.success(), "{said}{complaint}");
    assert!(said.contains("they agree"), "{said}");
}

/// Frames in all conditions: the large net settles some that the small one leaves in doubt, and no frame that the
/// small one settles.
#[test]
fn a_second_look_answers_frames_in_doubt() {
    let pattern = crate::common::random_pattern(20, 5);
    let small = Weights::built_in(Head::Dots).unwrap();
    let estimator =
        |detector| Estimator::new(&pattern, EstimatorConfig::default(), detector).unwrap();
    let alone = estimator(CnnDetector::new(&small).unwrap());
    let both = estimator(CnnDetector::built_in().unwrap());
    let (mut first, mut second) = (alone.workspace(), both.workspace());
    let (mut a, mut b) = (FrameEstimate::default(), FrameEstimate::default());
    // Where four of five frames have an answer; a circle is no outline of a ball far off the axis.
    let config = SynthConfig {
        ground_share: 0.0,
        cords_share: 0.0,
        occluder_shadow_share: 0.0,
        size_px: [40, 200],
        max_arc_rad: 0.3,
        max_shift_px: 6.0,
        max_off_axis_rad: 0.35,
        camera_distance_radii: [6.0, 60.0],
        ..SynthConfig::default()
    };
    let frames = frames(&config, 300);
    for is_given in [false, true] {
        let (mut right, mut wrong, mut lost) = ([0, 0], [0, 0], 0);
        for frame in &frames {
            let circle = is_given.then_some(&frame.circle);
            alone.estimate(
                &frame.image,
                &Prior {
                    outline: circle.copied().map(OutlinePrior::given),
                    ..Prior::default()
                },
                &Budget::default(),
                &mut first,
                &mut a,
            );
            both.estimate(
                &frame.image,
                &Prior {
                    outline: circle.copied().map(OutlinePrior::given),
                    ..Prior::default()
                },
                &Budget::default(),
                &mut second,
                &mut b,
            );
            for (k, found) in [&a, &b].into_iter().enumerate() {
                let Some(pose) = found.pose() else { continue };
                let is_right = pose.rotation.angle_to(&frame.rotation).to_degrees() < 20.0;
                right[k] += usize::from(is_right);
                wrong[k] += usize::from(!is_right);
            }
            lost += u64::from(a.pose().is_some() && b.pose().is_none());
        }
        // What the small net's doubtful dots settle, the large net's do, but for one frame in a hundred (19 and 22 of 2 000):
        // these frames do not show that it is more.
        let lost = Proportion::new(lost, frames.len() as u64);
        assert!(lost.low <= 0.01, "{is_given}: {lost:?}, {right:?}");
        // 3 to 4 points of all frames in the measurements.
        assert!(right[1] >= right[0] + 3, "{is_given}: {right:?}");
        assert!(wrong[1] <= wrong[0] + 1, "{is_given}: {wrong:?}");
    }
}

#[test]
fn weights_read_back_and_damage_is_named() {
    let weights = Weights::built_in(Head::Dots).unwrap();
    let bytes = weights.to_npz().unwrap();
    let path = Path::new("w.npz");
    assert_eq!(Weights::from_npz(path, &bytes).unwrap(), weights);
    assert!(bytes.len() < 2 << 20);
    let large = Weights::built_in(Head::DotsLarge).unwrap();
    assert_eq!(
        Weights::from_npz(path, &large.to_npz().unwrap()).unwrap(),
        large
    );
    assert!(large.meta.is_rounded && large.clone().rounded() == large);
    let rounded = weights.clone().rounded();
    assert_eq!(
        Weights::from_npz(path, &rounded.to_npz().unwrap()).unwrap(),
        rounded
    );
    for (a, b) in weights.layers.iter().zip(&rounded.layers) {
        let most = a.weight.iter().fold(0f32, |m, w| m.max(w.abs()));
        let off = a.weight.iter().zip(&b.weight).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0f32, f32::max) <= most / 63.0);
    }
    // The small net's arrays under the large one's name.
    let mut mixed = weights.clone();
    mixed.meta.head = Head::DotsLarge;
    let told = Weights::from_npz(path, &mixed.to_npz().unwrap_or_default());
    assert!(told.unwrap_err().to_string().starts_with("w.npz: "));
    let mut short = weights.clone();
    short.layers[3].bias.pop();
    let told = Weights::from_npz(path, &short.to_npz().unwrap_or_default());
    assert!(told.unwrap_err().to_string().starts_with("w.npz: "));
    let mut infinite = weights.clone();
    infinite.layers[5].weight[7] = f32::NAN;
    let told = Weights::from_npz(path, &infinite.to_npz().unwrap());
    let words = told.unwrap_err().to_string();
    assert!(
        words.contains("convolution_05_weight") && words.contains("finite"),
        "{words}"
    );
    let told = Weights::from_npz(path, &bytes[..bytes.len() / 2]);
    assert!(told.unwrap_err().to_string().contains("w.npz: archive"));
    assert_eq!(weights.layers.len(), Head::Dots.convolutions().len());
}

#[test]
fn weights_that_were_written_export_as_the_built_in_ones() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("mine.npz");
    let weights = Weights::built_in(Head::Dots).unwrap();
    weights.write(&path).unwrap();
    let dots = onnx::to_onnx(&weights);
    assert_eq!(onnx::to_onnx(&Weights::read(&path).unwrap()), dots);
    let large = onnx::to_onnx(&Weights::built_in(Head::DotsLarge).unwrap());
    assert!(
        large.len() > 8 * dots.len(),
        "{} {}",
        large.len(),
        dots.len()
    );
    let exported = dir.path().join("dots.onnx");
    std::fs::write(&exported, dots).unwrap();
    let refused = Weights::read(&exported).unwrap_err();
    assert!(refused.is_usage() && refused.to_string().contains("dots.onnx"));
}
