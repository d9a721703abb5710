//! `spindoe spin` through the binary: what it prints, and how it refuses what it cannot use.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use spindoe::geometry::Vec3;
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
        let output = run(&["spin", path.to_str().unwrap(), "--method", method]);
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
fn refuses_times_that_do_not_increase() {
    let same = rows()[3].split(',').nth(1).unwrap().to_owned();
    let equal = with_row(4, |f| f[1].clone_from(&same));
    refused(&equal, &["line 6", "later than", &same]);
    let backwards = with_row(4, |f| f[1] = "0.001".into());
    refused(&backwards, &["line 6", "later than", "0.001"]);
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
    assert_eq!(output.status.code(), Some(2), "{message}");
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
    let flags = ["--max-spin-rps", "--prior-rps", "--sigma-deg"];
    for (flag, value) in flags.iter().flat_map(|f| [(f, "-1"), (f, "0"), (f, "nan")]) {
        let output = run(&["spin", path.to_str().unwrap(), flag, value]);
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
    let output = run(&["spin", path.to_str().unwrap(), "--json"]);
    assert!(output.status.success());
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
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
    // Even times at 350 fps: about the same axis, 350 rps less is the only other spin below 350 rps.
    let alternatives = json["alternatives"].as_array().unwrap();
    assert_eq!(alternatives.len(), 1, "{alternatives:?}");
    let other = alternatives[0]["rps"].as_f64().unwrap();
    assert!((other + rps - 350.0).abs() < 1e-6, "{other} beside {rps}");
    let ratio = alternatives[0]["log_likelihood_ratio"].as_f64().unwrap();
    assert!(ratio.abs() < 1e-6, "{ratio}");
}
