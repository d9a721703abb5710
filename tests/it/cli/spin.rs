//! `spindoe spin` through the binary: what it prints, and how it refuses what it cannot use.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{done, spindoe};
use spindoe::geometry::{Rotation, Vec3};
use spindoe::spin::Measurement;
use spindoe::spin::orientations::Orientations;
use spindoe::spin::simulate::{Scenario, stream};

const HEADER: &str = "frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence\n";

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(arguments)
        .output()
        .unwrap()
}

fn write(dir: &Path, name: &str, text: &str) -> PathBuf {
    let path = dir.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// Runs `spin` on `text`; it must refuse it with exit code 2 and one line that has all of `expected`.
fn refused(text: &str, expected: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "orientations.csv", text);
    for method in ["robust", "quatera"] {
        let method = format!("--config=method={method}");
        let output = run(&["spin", path.to_str().unwrap(), &method]);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(output.stdout.is_empty(), "something was printed");
        assert_eq!(message.trim_end().lines().count(), 1, "{message}");
        for e in expected.iter().chain(&["orientations.csv"]) {
            assert!(message.contains(e), "expected \"{e}\" in: {message}");
        }
    }
}

/// Ten rows of a simulated ball, as text, one string a row.
fn rows() -> Vec<String> {
    let sequence = Scenario::default().sequence((40.0, 60.0), 3, 0);
    let text = Orientations::from_measurements(&sequence.measurements).to_csv();
    text.lines().skip(1).map(|l| format!("{l}\n")).collect()
}

/// `rows()` with the fields of row `row` changed by `change`.
fn with_row(row: usize, change: impl Fn(&mut Vec<String>)) -> String {
    let mut all = rows();
    let mut fields: Vec<String> = all[row].trim().split(',').map(str::to_owned).collect();
    change(&mut fields);
    all[row] = fields.join(",") + "\n";
    HEADER.to_owned() + &all.concat()
}

#[test]
fn refuses_too_few_frames() {
    let text = HEADER.to_owned() + &rows()[..2].concat();
    refused(&text, &["expected at least", "found 2"]);
    refused(HEADER, &["expected at least", "found 0"]);
    // Frames without an answer do not count.
    let mut empty = rows()[..2].to_vec();
    empty.push("2,0.5,,,,,,,,\n".into());
    let text = HEADER.to_owned() + &empty.concat();
    refused(&text, &["expected at least", "found 2"]);
}

#[test]
fn refuses_times_that_decrease_and_takes_equal_ones_for_one_orientation() {
    let backwards = with_row(4, |f| f[1] = "0.001".into());
    refused(&backwards, &["line 6", "not earlier than", "0.001"]);
    // Each row twice, as two cameras write them: the spin is the same.
    let dir = tempfile::tempdir().unwrap();
    let twice: Vec<String> = rows().iter().map(|row| row.repeat(2)).collect();
    write(
        dir.path(),
        "once.csv",
        &(HEADER.to_owned() + &rows().concat()),
    );
    write(
        dir.path(),
        "twice.csv",
        &(HEADER.to_owned() + &twice.concat()),
    );
    let spin = |name: &str| {
        let text = done(dir.path(), &["spin", name, "--json"]);
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        json["rps"].as_f64().unwrap()
    };
    assert!((spin("once.csv") / spin("twice.csv") - 1.0).abs() < 1e-6);
}

#[test]
fn refuses_what_is_no_unit_quaternion() {
    let zero = with_row(2, |f| f[2..6].fill("0".into()));
    refused(&zero, &["line 4", "unit quaternion", "length 0.000000"]);
    let long = with_row(2, |f| f[2..6].fill("1".into()));
    refused(&long, &["line 4", "unit quaternion", "length 2.000000"]);
    let partial = with_row(2, |f| f[4].clear());
    refused(&partial, &["line 4", "all of qw,qx,qy,qz or none"]);
}

#[test]
fn refuses_what_is_no_number() {
    let nan = with_row(2, |f| f[3] = "NaN".into());
    refused(&nan, &["line 4", "qx: expected a finite number"]);
    let infinite = with_row(7, |f| f[1] = "inf".into());
    refused(&infinite, &["line 9", "time_s: expected a finite number"]);
    let word = with_row(2, |f| f[5] = "wide".into());
    refused(&word, &["line 4", "qz: expected a finite number", "wide"]);
    let timeless = with_row(2, |f| f[1].clear());
    refused(&timeless, &["line 4", "time_s"]);
    let sure = with_row(2, |f| f[9] = "1.5".into());
    refused(&sure, &["line 4", "confidence: expected 0 to 1"]);
    let short = with_row(2, |f| f.truncate(5));
    refused(&short, &["line 4", "expected 10 fields", "found 5"]);
    refused("", &["line 1", "time_s"]);
    refused("frame,time_s,qw,qx,qy\n", &["line 1", "qz"]);
    refused("time_s,qw,qx,qy,qz,qz\n", &["line 1", "more than once"]);
}

#[test]
fn refuses_orientations_that_agree_on_nothing() {
    let stray = Scenario {
        outliers: 1.0,
        ..Scenario::default()
    };
    let sequence = stray.sequence((40.0, 60.0), 11, 0);
    let text = Orientations::from_measurements(&sequence.measurements).to_csv();
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "stray.csv", &text);
    let output = run(&["spin", path.to_str().unwrap()]);
    let message = String::from_utf8(output.stderr).unwrap();
    // The work is done; there is no answer.
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(message.contains("no spin up to 175 rps"), "{message}");
}

#[test]
fn refuses_times_in_another_unit() {
    // Milliseconds between frames written as if they were seconds.
    let mut text = HEADER.to_owned();
    for row in rows() {
        let fields: Vec<&str> = row.trim().split(',').collect();
        let time: f64 = fields[1].parse().unwrap();
        text += &format!("{},{},{}\n", fields[0], time * 1e3, fields[2..].join(","));
    }
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "ms.csv", &text);
    let output = run(&["spin", path.to_str().unwrap()]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("are the times in seconds?"), "{message}");
}

#[test]
fn refuses_arguments_outside_their_domain() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(
        dir.path(),
        "good.csv",
        &(HEADER.to_owned() + &rows().concat()),
    );
    let names = ["--max-spin-rps", "prior_rps", "orientation_sigma_deg"];
    for (flag, value) in names.iter().flat_map(|f| [(f, "-1"), (f, "0"), (f, "nan")]) {
        let given = match flag.starts_with("--") {
            true => format!("{flag}={value}"),
            false => format!("--config={flag}={value}"),
        };
        let output = run(&["spin", path.to_str().unwrap(), &given]);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(flag), "{message}");
    }
    let output = run(&["spin", dir.path().join("absent.csv").to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        String::from_utf8(output.stderr)
            .unwrap()
            .contains("absent.csv")
    );
}

#[test]
fn json_has_the_contract_s_fields() {
    let truth = Vec3::new(100.0, -200.0, 150.0);
    let clean = Scenario {
        outliers: 0.0,
        ..Scenario::default()
    };
    let sequence = clean.simulate(truth, &mut stream(5, 0));
    let mut file = Orientations::from_measurements(&sequence.measurements);
    file.rows[4].orientation = None;
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "good.csv", &file.to_csv());
    let answer = |flags: &[&str]| -> serde_json::Value {
        let arguments = [&["spin", path.to_str().unwrap(), "--json"], flags].concat();
        let output = run(&arguments);
        assert!(output.status.success());
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let json = answer(&[]);
    let vector = |key: &str| {
        let v = json[key].as_array().unwrap();
        Vec3::from_iterator(v.iter().map(|x| x.as_f64().unwrap()))
    };
    let (spin, std) = (vector("spin_rad_s"), vector("std_rad_s"));
    for i in 0..3 {
        let z = (spin[i] - truth[i]) / std[i];
        assert!(z.abs() < 4.5, "component {i} is off by {z} std");
    }
    let rps = json["rps"].as_f64().unwrap();
    assert!((rps - spin.norm() / std::f64::consts::TAU).abs() < 1e-9);
    assert!((vector("axis") - spin.normalize()).norm() < 1e-9);
    assert_eq!(json["frames"], 10);
    assert_eq!(json["orientations"], 9);
    assert_eq!(json["inliers"], 9);
    // None above the largest spin that is considered.
    assert_eq!(json["alternatives"], serde_json::json!([]));
    // Even times at 350 fps: about the same axis, 350 rps less is the only other spin below 350 rps.
    let json = answer(&["--max-spin-rps", "350"]);
    let alternatives = json["alternatives"].as_array().unwrap();
    assert_eq!(alternatives.len(), 1, "{alternatives:?}");
    let other = alternatives[0]["rps"].as_f64().unwrap();
    assert!((other + rps - 350.0).abs() < 1e-6, "{other} beside {rps}");
    let ratio = alternatives[0]["log_likelihood_ratio"].as_f64().unwrap();
    assert!(ratio.abs() < 1e-6, "{ratio}");
}

#[test]
fn a_simulated_flight_comes_back_with_its_decay_and_a_plot() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (csv, png) = (at("flight.csv"), at("spin.png"));
    let flags = "--rps 80 --axis 1,-2,0.5 --frames 210 --config decay_per_s=0.091 --config drops=0.1 --seed 4 --json";
    let mut arguments = vec!["synth", "--as=orientations", "-o", &csv];
    arguments.extend(flags.split(' '));
    let output = run(&arguments);
    assert!(output.status.success());
    let truth: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(truth["outliers"].as_u64().unwrap() > 0);
    // The truth is that at the beginning.
    let rows = Orientations::read_csv(csv.as_ref()).unwrap().rows;
    let [first_s, last_s] = [&rows[0], &rows[rows.len() - 1]].map(|row| row.time_s);
    let at = format!("--at={first_s}");
    let output = run(&["spin", &csv, &at, "--picture", &png, "--json"]);
    assert!(output.status.success(), "{output:?}");
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["orientations"], truth["orientations"]);
    assert_eq!(
        (&found["motion"], &found["time_s"]),
        (&"decaying".into(), &first_s.into())
    );
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    for i in 0..3 {
        let error = number(&found["spin_rad_s"][i]) - number(&truth["spin_rad_s"][i]);
        assert!(
            error.abs() < 4.5 * number(&found["std_rad_s"][i]),
            "{found}"
        );
    }
    let decay = &found["decay"];
    let (low, high) = (number(&decay["low_per_s"]), number(&decay["high_per_s"]));
    // The interval has the truth in one of twenty cases not: twice its width is asked for here.
    let (middle, half) = (0.5 * (low + high), high - low);
    assert!((middle - 0.091).abs() < half && half < 0.006, "{decay}");
    assert!((number(&decay["creeping_flow_per_s"]) - 0.005_05).abs() < 1e-5);
    assert!(std::fs::read(&png).unwrap().starts_with(b"\x89PNG"));

    // The same seed, the same bytes; words instead of JSON.
    let first = std::fs::read(&csv).unwrap();
    arguments.pop();
    assert!(run(&arguments).status.success());
    assert_eq!(std::fs::read(&csv).unwrap(), first);
    let output = run(&["spin", &csv]);
    let words = String::from_utf8(output.stdout).unwrap();
    let middle = format!(
        "the spin is that at {:.4} s, the middle",
        0.5 * (first_s + last_s)
    );
    for expected in [
        "decay     c = ",
        "12 pi mu r / m",
        "motion    decaying (odds",
        &middle,
    ] {
        assert!(words.contains(expected), "{expected}: {words}");
    }
    let output = run(&["spin", &csv, "--at=-1"]);
    assert_eq!(output.status.code(), Some(2));

    // Taken as constant it is no good fit, which is said, and widens the covariance.
    let output = run(&["spin", &csv, "--motion=constant"]);
    let words = String::from_utf8(output.stdout).unwrap();
    assert!(words.contains("lack of fit: parts"), "{words}");
    // Deviations differ by the root of what variances do.
    let json = run(&["spin", &csv, "--motion=constant", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    let ratio = json["lack_of_fit"].as_f64().unwrap();
    let times = format!("differ {:.1} times as much", ratio.sqrt());
    assert!(words.contains(&times), "{times}: {words}");
    let message = String::from_utf8(output.stderr).unwrap();
    let is_said = words.contains("as if the times were off");
    assert!(
        is_said || message.contains("off a constant spin"),
        "{words} {message}"
    );
    let output = run(&["spin", &csv, "--config=method=quatera", "--motion=decaying"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn files_keep_every_bit() {
    let sequence = Scenario::default().sequence((40.0, 60.0), 9, 0);
    let mut file = Orientations::from_measurements(&sequence.measurements);
    file.rows[3].orientation = None;
    file.rows[4].frame = "left, \"upper\"".into();
    file.rows[5].dots = Some(9);
    file.rows[5].matched = Some(8);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("o.csv");
    file.write_csv(&path).unwrap();
    let read = Orientations::read_csv(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.starts_with(HEADER));
    for (a, b) in file.rows.iter().zip(&read.rows) {
        let up_to_sign = match (a.orientation, b.orientation) {
            (Some(a), Some(b)) => a.coords == b.coords || a.coords == -b.coords,
            (a, b) => a == b,
        };
        assert!(up_to_sign, "{a:?} became {b:?}");
        assert!(b.orientation.is_none_or(|q| q.w >= 0.0), "{b:?}");
        let rest = |r: &spindoe::spin::orientations::OrientationRow| {
            (r.frame.clone(), r.time_s, r.dots, r.matched, r.confidence)
        };
        assert_eq!(rest(a), rest(b));
    }
    assert_eq!(read.measurements().len(), 9);
}

#[test]
fn residuals_and_dot_counts_weigh_the_frames() {
    let text = "time_s,qw,qx,qy,qz,matched,residual_deg\n\
                0.0,1,0,0,0,8,2\n0.1,1,0,0,0,8,2\n0.2,1,0,0,0,8,6\n0.3,1,0,0,0,2,2\n0.4,1,0,0,0,,\n";
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "o.csv", text);
    let scales: Vec<f64> = Orientations::read_csv(&path)
        .unwrap()
        .measurements()
        .iter()
        .map(|m| m.sigma_scale)
        .collect();
    assert_eq!(scales[0], scales[1]);
    assert!(scales[2] > scales[0], "a larger residual: {scales:?}");
    assert!(scales[3] > scales[0], "fewer dots: {scales:?}");
    assert_eq!(scales[4], 1.0, "nothing known");
}

#[test]
fn orientations_without_times_take_a_rate() {
    let dir = tempfile::tempdir().unwrap();
    let mut text = "qw,qx,qy,qz\n".to_owned();
    for k in 0..10 {
        // 3 rps about z at 60 fps.
        let half = 0.5 * std::f64::consts::TAU * 3.0 * f64::from(k) / 60.0;
        text += &format!("{},0,0,{}\n", half.cos(), half.sin());
    }
    let path = write(dir.path(), "untimed.csv", &text);
    let path = path.to_str().unwrap();
    let refused = run(&["spin", path]);
    assert_eq!(refused.status.code(), Some(2));
    let output = run(&["spin", path, "--fps", "60", "--json"]);
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    assert!((number(&found["rps"]) - 3.0).abs() < 1e-3, "{found}");
    assert!(
        (number(&found["unique_up_to_rps"]) - 30.0).abs() < 1e-2,
        "{found}"
    );
    for rate in ["0", "-1", "nan"] {
        assert_eq!(run(&["spin", path, "--fps", rate]).status.code(), Some(2));
    }
    // Numbered in nanoseconds by mistake: the rate is asked for, or taken.
    let mut text = HEADER.to_owned();
    for (k, row) in rows().iter().enumerate() {
        let fields: Vec<&str> = row.splitn(3, ',').collect();
        text += &format!("{},{}e-9,{}", fields[0], k, fields[2]);
    }
    let path = write(dir.path(), "numbered.csv", &text);
    let refused = run(&["spin", path.to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(2));
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(words.contains("are the times in seconds?"), "{words}");
    let found = run(&["spin", path.to_str().unwrap(), "--fps", "350"]);
    assert!(found.status.success(), "{found:?}");
}

#[test]
fn the_convention_of_the_camera_frame_goes_along() {
    use spindoe::geometry::CameraFrame;
    let sequence = Scenario::default().sequence((40.0, 60.0), 3, 0);
    let ours = Orientations::from_measurements(&sequence.measurements);
    let mut optical = ours.clone();
    optical.camera_frame = Some(CameraFrame::Optical);
    for row in &mut optical.rows {
        row.orientation = row.orientation.map(|q| CameraFrame::Optical.turn() * q);
    }
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    ours.write_csv(at("ours.csv").as_ref()).unwrap();
    optical.write_csv(at("optical.csv").as_ref()).unwrap();
    let spin = |name: &str, flags: &[&str]| {
        let output = run(&[&["spin", &at(name), "--json"], flags].concat());
        assert!(output.status.success(), "{output:?}");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let vector: Vec<f64> = serde_json::from_value(json["spin_rad_s"].clone()).unwrap();
        (vector, json["camera_frame"].as_str().unwrap().to_owned())
    };
    let (a, frame) = spin("ours.csv", &[]);
    assert_eq!(frame, "camera");
    // As the file has it, and turned back.
    let (b, frame) = spin("optical.csv", &[]);
    assert_eq!(frame, "optical");
    let (c, _) = spin("optical.csv", &["--frame", "camera"]);
    for i in 0..3 {
        let sign = if i == 0 { 1.0 } else { -1.0 };
        assert!(
            (a[i] - sign * b[i]).abs() < 1e-3 * a[0].abs().max(1.0),
            "{a:?} {b:?}"
        );
        assert!(
            (a[i] - c[i]).abs() < 1e-3 * a[0].abs().max(1.0),
            "{a:?} {c:?}"
        );
    }
    let mut text = std::fs::read_to_string(at("optical.csv")).unwrap();
    text = text.replacen(",optical,", ",ours,", 1);
    let path = write(dir.path(), "mixed.csv", &text);
    let output = run(&["spin", path.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    let words = String::from_utf8(output.stderr).unwrap();
    assert!(
        words.contains("camera_frame: expected the same in all rows"),
        "{words}"
    );
}

#[test]
fn a_precession_is_reported_with_its_interval_and_its_absence_too() {
    let dir = tempfile::tempdir().unwrap();
    let spin = |measurements: &[Measurement]| {
        let text = Orientations::from_measurements(measurements).to_csv();
        let path = write(dir.path(), "orientations.csv", &text);
        let output = run(&["spin", path.to_str().unwrap(), "--json"]);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        json
    };
    // The closed form of a symmetric top: 40 rad/s about an axis of the ball, 20 deg off the spin.
    let (p, q) = (Vec3::new(0.0, 700.0, 0.0), Vec3::new(13.7, 37.6, 0.0));
    let at = |t: f64| Rotation::from_scaled_axis(p * t) * Rotation::from_scaled_axis(q * t);
    let times = (0..60).map(|k| f64::from(k) / 350.0);
    let top: Vec<Measurement> = times.map(|t| Measurement::new(t, at(t))).collect();
    let json = spin(&top);
    let found = &json["precession"];
    assert_eq!(json["motion"], "precessing");
    assert_eq!(found["outcome"], "precessing");
    let rate = found["rate_deg_s"].as_f64().unwrap();
    assert!((rate - q.norm().to_degrees()).abs() < 5.0, "{found}");
    let [low, high] = [0, 1].map(|i| found["rate_interval_deg_s"][i].as_f64().unwrap());
    assert!(low < rate && rate < high, "{found}");
    // A constant spin has none, and the answer says how much it would have seen.
    let even = Scenario {
        frames: 60,
        ..Scenario::default()
    };
    let even = even.simulate(p, &mut stream(308, 0)).measurements;
    let json = spin(&even);
    let found = &json["precession"];
    assert_eq!(json["motion"], "constant");
    assert_eq!(found["outcome"], "none");
    assert!(found["max_drift_deg_s"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_view_frame_that_turns_widens_the_covariance_of_the_spin() {
    use nalgebra::Matrix3;
    use spindoe::geometry::{CameraFrame, Vec3};
    use spindoe::spin::shared::ViewTurn;
    let sequence = Scenario::default().sequence((40.0, 60.0), 3, 0);
    let plain = Orientations::from_measurements(&sequence.measurements);
    let mut view = plain.clone();
    view.camera_frame = Some(CameraFrame::View);
    let middle_s = view.rows.iter().map(|row| row.time_s).sum::<f64>() / view.rows.len() as f64;
    for row in &mut view.rows {
        // 2 rad/s about y, known to a tenth.
        let turn = ViewTurn {
            turn_rad: Vec3::new(0.0, 2.0 * row.time_s, 0.0),
            shared_rad: [
                Vec3::new(0.0, 0.2 * (row.time_s - middle_s), 0.0),
                Vec3::new(0.0, 0.0, 0.1 * (row.time_s - middle_s)),
                Vec3::zeros(),
            ],
        };
        let own = Matrix3::new(4e-4, 1e-4, 0.0, 1e-4, 3e-4, 0.0, 0.0, 0.0, 1e-4);
        let shared = turn.shared_rad.iter().map(|s| s * s.transpose());
        row.covariance = Some(own + shared.sum::<Matrix3<f64>>());
        row.turn = Some(turn);
    }
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    plain.write_csv(at("plain.csv").as_ref()).unwrap();
    view.write_csv(at("view.csv").as_ref()).unwrap();
    assert_eq!(
        Orientations::read_csv(at("view.csv").as_ref()).unwrap(),
        view
    );
    let spin = |name: &str| -> serde_json::Value {
        // The same noise to begin with, which the covariances would say otherwise.
        let output = run(&[
            "spin",
            &at(name),
            "--json",
            "--config=orientation_sigma_deg=2",
        ]);
        assert!(output.status.success(), "{output:?}");
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (a, b) = (spin("plain.csv"), spin("view.csv"));
    assert_eq!(b["camera_frame"], "view");
    for k in 0..3 {
        let at = |v: &serde_json::Value| v["spin_rad_s"][k].as_f64().unwrap();
        assert!((at(&a) - at(&b)).abs() < 1e-9 * at(&a).abs().max(1.0));
    }
    let added = |i: usize, j: usize| {
        let at = |v: &serde_json::Value| v["covariance_rad2_s2"][i][j].as_f64().unwrap();
        at(&b) - at(&a)
    };
    assert!((added(1, 1) - 0.04).abs() < 1e-6 && added(0, 0).abs() < 1e-9);
    assert!((added(2, 2) - 0.01).abs() < 1e-6);
    // Half a covariance is an error that names the line.
    let text = std::fs::read_to_string(at("view.csv")).unwrap();
    let path = write(
        dir.path(),
        "half.csv",
        &text.replacen("0.0004,0.0001,", "0.0004,,", 1),
    );
    let output = run(&["spin", path.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    let words = String::from_utf8(output.stderr).unwrap();
    assert!(
        words.contains("cov_xx to cov_zz") && words.contains("line 2"),
        "{words}"
    );
}

#[test]
fn a_slow_ball_before_a_slow_camera_is_slow() {
    // 0.6 rps about an axis askew, 20 frames per second, by the definition of a rotation; 0.4 deg off now one way, now the other.
    let mut text = "time_s,qw,qx,qy,qz\n".to_owned();
    for k in 0..32 {
        let half = 0.5 * std::f64::consts::TAU * 0.6 * f64::from(k) / 20.0;
        let half = half + 0.5 * [0.4f64, -0.4, -0.4, 0.4][k as usize % 4].to_radians();
        let (sin, cos) = half.sin_cos();
        let time_s = f64::from(k) / 20.0;
        text += &format!("{time_s:.6},{cos},{},0,{}\n", 0.6 * sin, 0.8 * sin);
    }
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "slow.csv", &text);
    let path = path.to_str().unwrap();
    let words = String::from_utf8(run(&["spin", path]).stdout).unwrap();
    assert!(words.starts_with("0.600 +-"), "{words}");
    let line = "unique    up to 10.00 rps at these times; a faster ball would show aliases every 20.00 rps";
    assert!(words.contains(line), "{words}");
    assert!(!words.contains("also possible"), "{words}");
    let json = run(&["spin", path, "--json", "--max-spin-rps", "50"]).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    let rps = |a: &serde_json::Value| a["rps"].as_f64().unwrap();
    let mut listed: Vec<f64> = json["alternatives"]
        .as_array()
        .unwrap()
        .iter()
        .map(rps)
        .collect();
    listed.sort_by(f64::total_cmp);
    assert_eq!(listed.len(), 4, "{listed:?}");
    for (found, expected) in listed.iter().zip([19.4, 20.6, 39.4, 40.6]) {
        assert!((found - expected).abs() < 0.01, "{listed:?}");
    }
}

/// Another file of ours is called by what it is.
#[test]
fn a_file_that_holds_no_orientations_is_called_what_it_is() {
    let dir = tempfile::tempdir().unwrap();
    done(dir.path(), &["synth", "dots12", "-o", "s", "--frames", "2"]);
    done(
        dir.path(),
        &[
            "synth", "dots12", "-o", "dots.csv", "--as", "dots", "--frames", "2",
        ],
    );
    for (file, what) in [
        (
            "s/truth.json",
            "the truth of a synthetic clip: its orientations.csv stands beside it",
        ),
        ("s/table.npz", "a NumPy archive, such as a table"),
        ("s/pattern.csv", "a pattern's dots"),
        (
            "dots.csv",
            "observed dots: `identify` makes orientations of them",
        ),
        ("s/contact_sheet.png", "an image"),
    ] {
        let output = spindoe(dir.path(), &["spin", file]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(
            said.contains(what) && said.len() < 200 && said.lines().count() == 1,
            "{said}"
        );
    }
}
