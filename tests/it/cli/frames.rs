//! Every output names the frame that it is in, and what an unknown camera costs is said; what the exposure settles, too.

use std::path::Path;

use serde_json::Value;
use spindoe::geometry::{CameraFrame, Rotation, from_wxyz};
use spindoe::spin::orientations::Orientations;

use crate::common::spindoe;

/// Runs `estimate` on the clip; its words, and what it wrote.
fn estimate(dir: &Path, flags: &[&str]) -> (String, Orientations, Value, String) {
    let run = |more: &[&str]| {
        let usual = ["estimate", "--table", "dots20", "clip/images"];
        let output = spindoe(dir, &[&usual, flags, more].concat());
        let words = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{words}");
        (words, String::from_utf8(output.stdout).unwrap())
    };
    let (words, _) = run(&["-o", "o.csv", "--report", "page.html"]);
    let page = std::fs::read_to_string(dir.join("page.html")).unwrap();
    let file = Orientations::read_csv(&dir.join("o.csv")).unwrap();
    let json = serde_json::from_str(&run(&["--json"]).1).unwrap();
    (words, file, json, page)
}

fn rotation(json: &Value) -> Option<Rotation> {
    let wxyz: [f64; 4] = serde_json::from_value(json["orientation_wxyz"].clone()).ok()?;
    Some(from_wxyz(wxyz, 1e-6).unwrap())
}

#[test]
fn every_output_names_its_frame() {
    let dir = tempfile::tempdir().unwrap();
    let clip = "synth dots20 -o clip --image-size 640x480 --ball-px 60 --frames 8 --seed 3 --rps 20 --config drift_px=200,-60";
    let made = spindoe(dir.path(), &clip.split(' ').collect::<Vec<_>>());
    assert!(made.status.success());
    let truth = std::fs::read_to_string(dir.path().join("clip/truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let k = &truth["frames"][0]["intrinsics"];
    let number = |name: &str| k[name].as_f64().unwrap();
    let known = ["fx", "fy", "cx", "cy"].map(|name| number(name).to_string());
    let known = format!("--intrinsics={}", known.join(","));
    for (flags, frame) in [
        (vec![], CameraFrame::View),
        (vec!["--frame=optical"], CameraFrame::OpticalView),
        (vec![known.as_str()], CameraFrame::Camera),
        (
            vec![known.as_str(), "--frame=optical"],
            CameraFrame::Optical,
        ),
    ] {
        let (words, file, json, page) = estimate(dir.path(), &flags);
        assert_eq!(file.camera_frame, Some(frame), "{flags:?}");
        assert!(words.contains(frame.words()), "{flags:?}: {words}");
        assert_eq!(json["frame"], frame.as_str());
        assert_eq!(json["spin"]["camera_frame"], frame.as_str());
        // The page has the crate's axes.
        let shown = CameraFrame::Camera.of_view(frame.is_view());
        assert!(page.contains(&format!("\"camera_frame\":\"{shown}\"")));
        // The same orientations in JSON and in the file, with their covariances.
        let frames = json["frames"].as_array().unwrap();
        assert_eq!(frames.len(), file.rows.len());
        let mut posed = 0;
        for (one, row) in frames.iter().zip(&file.rows) {
            let Some(orientation) = rotation(one) else {
                assert!(row.orientation.is_none() && row.covariance.is_none());
                continue;
            };
            posed += 1;
            assert_eq!(one["camera_frame"], frame.as_str());
            assert!(row.orientation.unwrap().angle_to(&orientation) < 1e-9);
            let covariance = row.covariance.expect("a covariance");
            for (i, j) in [(0, 0), (0, 1), (1, 2), (2, 2)] {
                let value = one["covariance_rad2"][i][j].as_f64().unwrap();
                assert!((value - covariance[(i, j)]).abs() <= 1e-12);
            }
            assert_eq!(row.turn.is_some(), frame.is_view());
            assert_eq!(one["view_turn_rad"].is_array(), frame.is_view());
        }
        assert!(posed >= 6, "{posed} of 8");
        let said = words
            .lines()
            .find(|line| line.starts_with("no camera is given"));
        assert_eq!(said.is_some(), frame.is_view(), "{words}");
        if let Some(line) = said {
            // The ball farthest off the center, a pinhole's angle.
            let px = line
                .split("up to ")
                .nth(1)
                .unwrap()
                .split(' ')
                .next()
                .unwrap();
            let deg = line
                .split("camera's by ")
                .nth(1)
                .unwrap()
                .split(' ')
                .next()
                .unwrap();
            let (px, deg): (f64, f64) = (px.parse().unwrap(), deg.parse().unwrap());
            let expected = (px / 320.0 * 7.5f64.to_radians().tan()).atan().to_degrees();
            assert!(px > 70.0 && (deg - expected).abs() < 0.06, "{line}");
        }
    }
}

#[test]
fn an_exposure_settles_the_alias() {
    let dir = tempfile::tempdir().unwrap();
    let clip = "synth dots20 -o clip --preset good --frames 10 --seed 5 --fps 120 --rps 90 --exposure-ms 0.5";
    crate::common::done(dir.path(), &clip.split(' ').collect::<Vec<_>>());
    let estimate = |flags: &str| {
        let command = format!("estimate --table dots20 clip --fps 120 --json {flags}");
        spindoe(dir.path(), &command.trim().split(' ').collect::<Vec<_>>())
    };
    let spin = |flags: &str| {
        let output = estimate(flags);
        let json: Value = serde_json::from_slice(&output.stdout).unwrap();
        (
            json["spin"].clone(),
            String::from_utf8(output.stderr).unwrap(),
        )
    };
    let (open, words) = spin("");
    assert!((open["rps"].as_f64().unwrap() - 30.0).abs() < 0.5, "{open}");
    assert!(!words.contains("smears"), "{words}");
    let (settled, words) = spin("--exposure-ms 0.5");
    assert!(
        (settled["rps"].as_f64().unwrap() - 90.0).abs() < 0.5,
        "{settled}"
    );
    assert!(
        settled["smears"]["frames"].as_u64().unwrap() >= 8,
        "{settled}"
    );
    assert!(words.contains("smears    of "), "{words}");
    for flags in [
        "--exposure-ms 0",
        "--exposure-ms -1",
        "--exposure-ms nan",
        "--exposure-ms 1 --no-sequence",
    ] {
        assert_eq!(estimate(flags).status.code(), Some(2), "{flags}");
    }
}

#[test]
fn a_readout_gives_times_poses_and_the_alias() {
    let dir = tempfile::tempdir().unwrap();
    let clip = "synth dots20 -o clip --preset good --frames 10 --seed 5 --fps 60 --rps 40 --exposure-ms 0.1 --config readout_ms=15 \
                --image-size 120x480 --ball-px 60";
    crate::common::done(dir.path(), &clip.split_whitespace().collect::<Vec<_>>());
    let estimate = |flags: &str| {
        let command = format!("estimate --table dots20 clip --fps 60 --json {flags}");
        spindoe(dir.path(), &command.trim().split(' ').collect::<Vec<_>>())
    };
    let of = |flags: &str| -> Value { serde_json::from_slice(&estimate(flags).stdout).unwrap() };
    let rps = |json: &Value| json["spin"]["rps"].as_f64().unwrap();
    let (ignored, corrected) = (of(""), of("--readout-ms 15"));
    assert!((rps(&ignored) - 20.0).abs() < 0.5, "{}", ignored["spin"]);
    assert!(
        (rps(&corrected) - 40.0).abs() < 0.1,
        "{}",
        corrected["spin"]
    );
    assert_eq!(corrected["spin"]["readout_ms"], 15.0);
    // A frame's time is that of the row of the ball's center, as the truth has it; its name that of the first row.
    let truth = std::fs::read_to_string(dir.path().join("clip/orientations.csv")).unwrap();
    let frames = corrected["frames"].as_array().unwrap();
    for (row, frame) in truth.lines().skip(1).zip(frames) {
        let expected: f64 = row.split(',').nth(1).unwrap().parse().unwrap();
        let time_s = frame["time_s"].as_f64().unwrap();
        // A pixel of the center is 31 us.
        assert!((expected - 1000.0 - time_s).abs() < 3e-5, "{row}");
    }
    for (flags, words) in [
        ("--readout-ms 0", "--readout-ms: expected a positive number"),
        ("--readout-ms nan", "--readout-ms: expected"),
        ("--readout-ms 20", "--readout-ms: expected at most 0.016667"),
        ("--readout-ms 1 --no-sequence", "--no-sequence"),
        ("--readout-ms 1 --calibrate", "--calibrate"),
    ] {
        let refused = estimate(flags);
        let said = String::from_utf8(refused.stderr).unwrap();
        assert_eq!(refused.status.code(), Some(2), "{flags}");
        assert!(said.contains(words), "{flags}: {said}");
    }
}
