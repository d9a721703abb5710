//! Pages: what they hold, what they reject, and that a browser shows them.
//!
//! `python/check_page.py` opens them in headless Chromium and uses them as a person would, where both
//! are installed.

use std::path::{Path, PathBuf};
use std::process::Command;

use spindoe::calibrate::{CalibrationConfig, DotState, calibrate};
use spindoe::clip::{
    BallEstimate, Batch, BatchFrame, Judgment, NamedFrame, SequenceOutcome, TimeSource,
    orientations,
};
use spindoe::geometry::{CameraFrame, spiral_directions};
use spindoe::pattern::Pattern;
use spindoe::recognize::RecognizerName;
use spindoe::report::calibration::{
    CalibrationEvaluationConfig, CalibrationSource, evaluate_calibration,
};
use spindoe::report::compare::{Entry, compare};
use spindoe::report::page::{CalibrationPage, Carried, DesignPage, EstimatePage, ShownBall};
use spindoe::spin::orientations::{BallColumns, OrientationRow, Orientations};
use spindoe::surface::PaintedPose;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::independent_frame;
use spindoe::vision::DetectorName;
use spindoe::vision::frame::{Budget, Prior};
use spindoe::{Ball, Estimator, EstimatorConfig, FrameEstimate};

use crate::common::{done, spindoe};

/// The exit code of `check_page.py` where something that it needs is absent.
const SKIPPED: i32 = 77;
/// Size that no page exceeds.
const MAX_BYTES: usize = 6_000_000;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A copy of the shipped design with its stencil.
fn design(dir: &Path) -> PathBuf {
    let copy = dir.join("design");
    std::fs::create_dir_all(copy.join("stencil")).unwrap();
    for (from, to) in [
        ("designs/dots20", copy.clone()),
        ("stencils/dots20", copy.join("stencil")),
    ] {
        for entry in std::fs::read_dir(root().join(from)).unwrap() {
            let entry = entry.unwrap();
            std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    }
    copy
}

fn comparison(path: &Path) {
    let pattern = |file: &str| Pattern::read_csv(&root().join(file)).unwrap();
    let entries = ["designs/dots20/pattern.csv", "designs/dots12/pattern.csv"].map(|file| Entry {
        name: format!("<b>{file}</b>"),
        ball: Ball::new(pattern(file)),
    });
    let found = compare(&entries, &[RecognizerName::Robust], 3, 40, &mut |_| {}).unwrap();
    std::fs::write(path, found.html(&entries, "spindoe compare a b").unwrap()).unwrap();
}

/// The page of one ball, and that of two.
fn estimate(one: &Path, two: &Path) {
    let pattern = Pattern::read_csv(&root().join("designs/dots20/pattern.csv")).unwrap();
    let detector = DetectorName::Blob.build().unwrap();
    let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector).unwrap();
    let mut workspace = estimator.workspace();
    let frames = (0..6usize).map(|k| {
        let mut estimate = FrameEstimate::default();
        let frame = independent_frame(&pattern, &SynthConfig::good(), 5, k).unwrap();
        // The last one shows no ball.
        let mut image = frame.image;
        if k == 5 {
            image = image.part(0, 0, 12, 12).unwrap();
        }
        estimator.estimate(
            &image,
            &Prior::default(),
            &Budget::default(),
            &mut workspace,
            &mut estimate,
        );
        BatchFrame {
            name: format!("frame <{k}>"),
            path: PathBuf::new(),
            time_s: Some(k as f64 / 350.0),
            first_row_s: None,
            balls: vec![BallEstimate::of(estimate, 0)],
            size: None,
            unreadable: None,
            kept: (),
        }
    });
    let batch = Batch {
        frames: frames.collect(),
        sequence: SequenceOutcome::NoTimes,
        focal_doubt: None,
        judgment: Judgment::default(),
        times: TimeSource::None,
        skipped: Vec::new(),
        cut_short: Vec::new(),
        sources: Vec::new(),
    };
    assert!(batch.frames[5].estimate().pose().is_none());
    let named = batch.frames.iter().map(|frame| NamedFrame {
        name: &frame.name,
        time_s: frame.time_s,
        estimate: frame.estimate(),
    });
    let named: Vec<NamedFrame<'_>> = named.collect();
    let rows = orientations(&named, CameraFrame::View, false);
    let ball = ShownBall {
        carries: Carried::Dots(&Ball::new(pattern.clone())),
        number: None,
        frames: named,
        orientations: rows,
        spin: None,
        sequence: &batch.sequence,
    };
    let both = [0, 1].map(|number| ShownBall {
        number: Some(number),
        ..ball.clone()
    });
    for (path, balls) in [(one, &[ball][..]), (two, &both)] {
        let page = EstimatePage::new(balls, |_, _| Ok(None)).unwrap();
        std::fs::write(path, page.html().unwrap()).unwrap();
    }
}

/// The page of a painted ball.
fn painted(path: &Path) {
    let track = crate::vision::painted::short_clip();
    let nothing = FrameEstimate::default();
    let names: Vec<String> = (0..track.poses.len()).map(|k| format!("<b>{k}")).collect();
    let named = names.iter().enumerate().map(|(k, name)| NamedFrame {
        name,
        time_s: Some(k as f64 / 200.0),
        estimate: &nothing,
    });
    let row = |(pose, name): (&Result<PaintedPose, _>, &String)| OrientationRow {
        frame: name.clone(),
        orientation: pose.as_ref().ok().map(|pose| pose.rotation),
        ..OrientationRow::default()
    };
    let ball = ShownBall {
        carries: Carried::Paint {
            surface: &track.surface,
            poses: &track.poses,
        },
        number: None,
        frames: named.collect(),
        orientations: Orientations {
            rows: track.poses.iter().zip(&names).map(row).collect(),
            camera_frame: Some(CameraFrame::View),
            columns: BallColumns::default(),
        },
        spin: None,
        sequence: &SequenceOutcome::NoTimes,
    };
    let page = EstimatePage::new(&[ball], |_, _| Ok(None)).unwrap();
    std::fs::write(path, page.html().unwrap()).unwrap();
    let data = &page_data(path)["content"]["balls"][0];
    let frames = data["frames"].as_array().unwrap();
    let posed = frames.iter().filter(|f| f["orientation_wxyz"].is_array());
    assert_eq!((posed.count(), frames.len()), (14, 15));
    assert_eq!(frames[14]["rejection_kind"], "no ball");
}

/// The data of a page.
pub fn page_data(path: &Path) -> serde_json::Value {
    let page = std::fs::read_to_string(path).unwrap();
    let (_, data) = page.split_once("id=\"data\"").unwrap();
    let (_, data) = data.split_once('>').unwrap();
    serde_json::from_str(data.split_once("</script>").unwrap().0).unwrap()
}

/// The folder of a calibration: dot 4 was never drawn, and the clip shows one side of the ball best.
fn calibration(dir: &Path) -> PathBuf {
    use crate::calibrate::clip::{ClipConfig, drawn, identified};

    let pattern = Pattern::read_csv(&root().join("designs/dots20/pattern.csv")).unwrap();
    let mut dots = drawn(&pattern, 0.025, 3);
    dots.remove(4);
    let clip = ClipConfig {
        frames: 60,
        ..ClipConfig::default()
    };
    let clip = identified(&pattern, &dots, &clip);
    let config = CalibrationConfig::default();
    let times_s = Some(&clip.times_s[..]);
    let found = calibrate(&pattern, &clip.frames, times_s, &config).unwrap();
    let found = found.unwrap();
    assert_eq!(found.dots[4].state, DotState::Missing);
    let source = CalibrationSource {
        nominal: &pattern,
        is_design: true,
        frames: &clip.frames,
        times_s,
        dot_radius_rad: None,
    };
    let trials = CalibrationEvaluationConfig {
        samples: 60,
        seed: 1,
        stop: None,
    };
    let mut evaluated = evaluate_calibration(&found, &source, &config, &trials, &|_| {}).unwrap();
    evaluated.report.command = Some("spindoe calibrate --table 'a <b>' clip".to_owned());
    let folder = dir.join("ball");
    evaluated.write(&folder).unwrap();
    folder
}

#[test]
fn a_calibration_has_a_page_of_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let folder = calibration(dir.path());
    let page = std::fs::read(folder.join("report.html")).unwrap();
    std::fs::remove_file(folder.join("report.html")).unwrap();
    let path = folder.to_str().unwrap();
    done(dir.path(), &["report", path]);
    assert_eq!(std::fs::read(folder.join("report.html")).unwrap(), page);
    // It has no camera to set.
    let refused = spindoe(dir.path(), &["report", path, "--fps", "100"]);
    let words = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        words.contains("--fps") && words.contains("calibration"),
        "{words}"
    );
    let json = folder.join("report.json");
    let report = std::fs::read_to_string(&json).unwrap();
    for (from, to, named) in [
        (
            "\"format_version\": 4",
            "\"format_version\": 99",
            "expected version 4, found 99",
        ),
        ("\"views\"", "\"looks\"", "views"),
        (
            "\"pattern_sha256\": \"",
            "\"pattern_sha256\": \"0",
            "table.npz",
        ),
    ] {
        assert!(report.contains(from));
        std::fs::write(&json, report.replacen(from, to, 1)).unwrap();
        let error = CalibrationPage::read(&folder).map(drop).unwrap_err();
        assert!(
            error.is_usage() && error.to_string().contains(named),
            "{error}"
        );
    }
}

#[test]
fn pages_are_used_in_a_browser() {
    let dir = tempfile::tempdir().unwrap();
    let design = design(dir.path());
    DesignPage::read(&design).unwrap().write(&design).unwrap();
    let pages = [
        design.join("report.html"),
        dir.path().join("compare.html"),
        dir.path().join("estimate.html"),
        dir.path().join("balls.html"),
        dir.path().join("painted.html"),
        calibration(dir.path()).join("report.html"),
    ];
    comparison(&pages[1]);
    estimate(&pages[2], &pages[3]);
    painted(&pages[4]);
    for page in &pages {
        let text = std::fs::read_to_string(page).unwrap();
        assert!(text.len() < MAX_BYTES && text.starts_with("<!doctype html>"));
        assert!(!text.contains("{{") && !text.contains("<b>"));
    }
    let checked = Command::new("python3")
        .arg(root().join("python/check_page.py"))
        .args(&pages)
        .output();
    let Ok(checked) = checked else {
        return crate::common::skipped("python3 is not installed: no page was opened in a browser");
    };
    let words = String::from_utf8_lossy(&checked.stdout).into_owned();
    if checked.status.code() == Some(SKIPPED) {
        return crate::common::skipped_browser(&words);
    }
    let errors = String::from_utf8_lossy(&checked.stderr);
    assert!(checked.status.success(), "{words}\n{errors}");
}

#[test]
fn files_of_another_pattern_are_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let design = design(dir.path());
    let report = std::fs::read_to_string(design.join("report.json")).unwrap();
    let changed = |from: &str, to: &str| {
        assert!(report.contains(from));
        std::fs::write(design.join("report.json"), report.replacen(from, to, 1)).unwrap();
        let error = DesignPage::read(&design).map(drop).unwrap_err();
        assert!(error.is_usage(), "{error}");
        error.to_string()
    };
    let sha = Pattern::read_csv(&design.join("pattern.csv"))
        .unwrap()
        .sha256();
    let error = changed(&sha, &"0".repeat(64));
    assert!(
        error.contains("stencil.json") && error.contains("000000000000"),
        "{error}"
    );
    let error = changed("\"format_version\": 6", "\"format_version\": 99");
    assert!(error.contains("expected version 6, found 99"), "{error}");
    let error = changed("\"finalists\"", "\"finalist\"");
    assert!(
        error.contains("report.json") && error.contains("finalists"),
        "{error}"
    );
}

#[test]
fn a_folder_with_a_report_alone_has_a_page() {
    let dir = tempfile::tempdir().unwrap();
    let design = design(dir.path());
    let only = dir.path().join("only");
    std::fs::create_dir(&only).unwrap();
    std::fs::copy(design.join("report.json"), only.join("report.json")).unwrap();
    let page = DesignPage::read(&only).unwrap().html().unwrap();
    assert!(page.contains("\"stencil\":null") && page.contains("\"features\":null"));
}

#[test]
fn pictures_are_drawn_from_the_folder() {
    let dir = tempfile::tempdir().unwrap();
    let design = design(dir.path());
    let before = std::fs::read(design.join("report.json")).unwrap();
    let path = design.to_str().unwrap();
    let names = ["pattern", "rates", "progress", "sensitivity_sigma"];
    let files = names.map(|name| ["png", "svg"].map(|e| design.join(format!("{name}.{e}"))));
    for file in files.iter().flatten().filter(|f| f.exists()) {
        std::fs::remove_file(file).unwrap();
    }
    done(dir.path(), &["report", path, "--pictures", "png,svg"]);
    for [png, svg] in &files {
        let (png, svg) = (std::fs::read(png).unwrap(), std::fs::read(svg).unwrap());
        assert!(png.starts_with(b"\x89PNG") && svg.starts_with(b"<svg"));
    }
    // An SVG of all features is what nobody opens.
    assert!(design.join("features.png").exists() && !design.join("features.svg").exists());
    assert_eq!(std::fs::read(design.join("report.json")).unwrap(), before);
    std::fs::remove_file(design.join("table.npz")).unwrap();
    let refused = spindoe(dir.path(), &["report", path, "--pictures", "png"]);
    assert_eq!(refused.status.code(), Some(2));
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(words.contains("table.npz"), "{words}");
}

#[test]
fn zones_live_beside_the_pattern_and_in_its_table() {
    use spindoe::KeepOut;
    use spindoe::geometry::Vec3;
    use spindoe::pattern::sidecar_path;

    let dir = tempfile::tempdir().unwrap();
    let csv = dir.path().join("ball.csv");
    let dots: Vec<Vec3> = spiral_directions(12).filter(|d| d.z < 0.7).collect();
    let plain = Pattern::new(dots).unwrap();
    let zone = |half_angle_rad: f64| KeepOut {
        axis: Vec3::z(),
        half_angle_rad,
    };
    let error = plain.clone().with_keep_out(vec![zone(1.4)]).unwrap_err();
    assert!(error.to_string().contains("lies in zone 0"), "{error}");
    let marked = plain.clone().with_keep_out(vec![zone(0.6)]).unwrap();
    assert_eq!(marked.sha256(), plain.sha256());
    marked.write_csv(&csv).unwrap();
    assert_eq!(Pattern::read_csv(&csv).unwrap(), marked);
    let ball = Ball::new(marked.clone());
    let npz = dir.path().join("table.npz");
    ball.write_npz(&npz).unwrap();
    let read = Ball::from_npz(&npz, &std::fs::read(&npz).unwrap()).unwrap();
    assert_eq!(read.pattern(), &marked);
    // Zones of another pattern are rejected, and never left beside a new one.
    let other = Pattern::new(spiral_directions(9).collect()).unwrap();
    std::fs::write(&csv, other.to_csv()).unwrap();
    let error = Pattern::read_csv(&csv).unwrap_err();
    assert!(error.to_string().contains("ball.json"), "{error}");
    other.write_csv(&csv).unwrap();
    assert!(!sidecar_path(&csv).exists());
}
