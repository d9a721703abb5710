//! Sets of flights in the published format: read, checked, written back.

use std::path::Path;
use std::process::Command;

use spindoe::geometry::Vec3;
use spindoe::spin::trajectories::{Limits, Oddity, TrajectorySet};

/// Four flights with every oddity that the checks know.
fn write_set(dir: &Path) {
    let write = |name: &str, text: &str| std::fs::write(dir.join(name), text).unwrap();
    write(
        "index.csv",
        "traj_file,x_spin,y_spin,z_spin\n0,10,0,0\n2,0,2000,0\n3,10,0,0\n9,1,2,3\n",
    );
    let flight = |from: f64| -> Vec<String> {
        let row = |i: usize| {
            let t = i as f64 * 0.007;
            format!("{t:.3};0.000;{:.3};0.300\n", from - 5.0 * t)
        };
        (0..12).map(row).collect()
    };
    write("000.csv", &flight(1.0).concat());
    let mut odd = flight(1.0);
    odd[5] = odd[4].clone();
    odd[8] = "0.056;0.000;0.720;-0.200\n".into();
    odd[11] = "0.177;0.000;9.000;0.300\n".into();
    write("002.csv", &odd.concat());
    write("003.csv", &flight(1.0)[..4].concat());
    write("005.csv", &flight(2.0).concat());
}

#[test]
fn lists_whatever_is_odd() {
    let dir = tempfile::tempdir().unwrap();
    write_set(dir.path());
    let set = TrajectorySet::read_dir(dir.path()).unwrap();
    assert_eq!(set.trajectories.len(), 4);
    assert_eq!(set.trajectories[0].spin, Some(Vec3::new(10.0, 0.0, 0.0)));
    assert_eq!(set.trajectories[3].spin, None);
    let found = set.oddities(&Limits::default());
    let has = |test: fn(&Oddity) -> bool| found.iter().filter(|o| test(o)).count();
    assert_eq!(has(|o| matches!(o, Oddity::Hole { first: 1, last: 1 })), 1);
    assert_eq!(has(|o| matches!(o, Oddity::Hole { first: 4, last: 4 })), 1);
    assert_eq!(has(|o| matches!(o, Oddity::NoFile { number: 9 })), 1);
    assert_eq!(has(|o| matches!(o, Oddity::NoSpin { number: 5 })), 1);
    assert_eq!(
        has(|o| matches!(
            o,
            Oddity::SameSpin {
                number: 3,
                other: 0
            }
        )),
        1
    );
    assert_eq!(has(|o| matches!(o, Oddity::Spin { number: 2, .. })), 1);
    assert_eq!(
        has(|o| matches!(
            o,
            Oddity::Short {
                number: 3,
                points: 4,
                ..
            }
        )),
        1
    );
    assert_eq!(
        has(|o| matches!(
            o,
            Oddity::Time {
                number: 2,
                line: 6,
                ..
            }
        )),
        1
    );
    assert_eq!(
        has(|o| matches!(
            o,
            Oddity::Gap {
                number: 2,
                line: 12,
                ..
            }
        )),
        1
    );
    assert_eq!(
        has(|o| matches!(
            o,
            Oddity::Below {
                number: 2,
                line: 9,
                ..
            }
        )),
        1
    );
    assert_eq!(
        has(|o| matches!(
            o,
            Oddity::Position {
                number: 2,
                line: 12,
                ..
            }
        )),
        1
    );
    // To the low point, back from it, and out of the room.
    assert_eq!(has(|o| matches!(o, Oddity::Speed { number: 2, .. })), 3);
    assert_eq!(found.len(), 14, "{found:#?}");
}

#[test]
fn writes_what_it_reads() {
    let dir = tempfile::tempdir().unwrap();
    write_set(dir.path());
    let copy = dir.path().join("copy");
    let set = TrajectorySet::read_dir(dir.path()).unwrap();
    set.write_dir(&copy).unwrap();
    assert_eq!(TrajectorySet::read_dir(&copy).unwrap(), set);
    for name in ["index.csv", "000.csv", "002.csv", "003.csv", "005.csv"] {
        let read = |d: &Path| std::fs::read_to_string(d.join(name)).unwrap();
        assert_eq!(read(dir.path()), read(&copy), "{name}");
    }
}

#[test]
fn the_published_set_reads_and_writes_back_to_the_same_bytes() {
    let Some(published) = crate::common::published_trajectories() else {
        return;
    };
    let set = TrajectorySet::read_dir(&published).unwrap();
    let summary = set.summary();
    assert_eq!(summary.trajectories, 232);
    assert_eq!(summary.points, 15_422);
    assert!((summary.interval_s - 0.007).abs() < 1e-9, "{summary:?}");
    let found = set.oddities(&Limits::default());
    let number = |test: fn(&Oddity) -> bool| found.iter().filter(|o| test(o)).count();
    assert_eq!(number(|o| matches!(o, Oddity::Hole { .. })), 45);
    assert_eq!(number(|o| matches!(o, Oddity::Time { .. })), 4);
    assert_eq!(number(|o| matches!(o, Oddity::Spin { .. })), 7);
    assert_eq!(
        number(|o| matches!(o, Oddity::NoSpin { .. } | Oddity::NoFile { .. })),
        0
    );
    let dir = tempfile::tempdir().unwrap();
    set.write_dir(dir.path()).unwrap();
    let mut compared = 0;
    for entry in std::fs::read_dir(&published).unwrap() {
        let path = entry.unwrap().path();
        let copy = dir.path().join(path.file_name().unwrap());
        assert_eq!(
            std::fs::read(&path).unwrap(),
            std::fs::read(&copy).unwrap(),
            "{path:?}"
        );
        compared += 1;
    }
    assert_eq!(compared, 233);
}

#[test]
fn the_command_reports_plots_and_refuses() {
    let dir = tempfile::tempdir().unwrap();
    write_set(dir.path());
    let run = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .arg("trajectories")
            .arg(dir.path())
            .args(arguments)
            .output()
            .unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), output.stdout, text)
    };
    let plots = dir.path().join("plots");
    let (code, json, _) = run(&["--json", "--plots", plots.to_str().unwrap()]);
    assert_eq!(code, Some(0));
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json["summary"]["trajectories"], 4);
    assert_eq!(json["oddities"].as_array().unwrap().len(), 14);
    for name in ["flights.png", "spins.png"] {
        let bytes = std::fs::read(plots.join(name)).unwrap();
        assert!(bytes.starts_with(b"\x89PNG"), "{name}");
    }
    let (code, words, _) = run(&[]);
    assert_eq!(code, Some(0));
    assert!(String::from_utf8(words).unwrap().contains("14 oddities"));

    let refused = |name: &str, text: &str, expected: &[&str]| {
        let path = dir.path().join(name);
        let kept = std::fs::read(&path).unwrap();
        std::fs::write(&path, text).unwrap();
        let (code, _, message) = run(&[]);
        std::fs::write(&path, kept).unwrap();
        assert_eq!(code, Some(2), "{message}");
        assert_eq!(message.trim_end().lines().count(), 1, "{message}");
        for e in expected.iter().chain(&[name]) {
            assert!(message.contains(e), "expected \"{e}\" in: {message}");
        }
    };
    refused(
        "000.csv",
        "0;1;2;3\n0.007;1;two;3\n",
        &["line 2", "t;x;y;z", "two"],
    );
    refused("000.csv", "0;1;2\n", &["line 1", "t;x;y;z"]);
    refused("000.csv", "0;1;2;NaN\n", &["line 1", "NaN"]);
    refused("index.csv", "file,x,y,z\n", &["line 1", "traj_file"]);
    refused(
        "index.csv",
        "traj_file,x_spin,y_spin,z_spin\n0,1,2\n",
        &["line 2"],
    );
    refused(
        "index.csv",
        "traj_file,x_spin,y_spin,z_spin\n0,1,2,3\n0,1,2,3\n",
        &["line 3", "twice"],
    );
    std::fs::remove_file(dir.path().join("index.csv")).unwrap();
    let (code, _, message) = run(&[]);
    assert_eq!(code, Some(2));
    assert!(
        message.contains("index.csv") && message.contains("cannot be read"),
        "{message}"
    );
}

/// A folder of one trajectory, with blank lines in its file.
fn gappy(dir: &Path, name: &str) {
    let write = |name: &str, text: &str| std::fs::write(dir.join(name), text).unwrap();
    write("index.csv", "traj_file,x_spin,y_spin,z_spin\n");
    let rows = (0..12).map(|i| format!("\r\n{:.3};0;0;0.3\r\n", 0.007 * f64::from(i)));
    write(name, &rows.collect::<String>());
}

#[test]
fn oddities_name_lines_as_an_editor_counts() {
    let dir = tempfile::tempdir().unwrap();
    gappy(dir.path(), "000.csv");
    let path = dir.path().join("000.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    // The sixth point stands on line 12.
    std::fs::write(&path, text.replace("0.035;0;", "0.028;0;")).unwrap();
    let set = TrajectorySet::read_dir(dir.path()).unwrap();
    let found = set.oddities(&Limits::default());
    let stands_still = |o: &&Oddity| matches!(o, Oddity::Time { line: 12, .. });
    assert_eq!(found.iter().filter(stands_still).count(), 1, "{found:?}");
}

#[test]
fn two_files_of_one_number_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    gappy(dir.path(), "1.csv");
    gappy(dir.path(), "001.csv");
    let error = TrajectorySet::read_dir(dir.path()).unwrap_err().to_string();
    assert!(
        error.contains("1.csv: name: is trajectory 1, and so is 001.csv"),
        "{error}"
    );
}

#[test]
fn the_largest_number_does_not_overflow() {
    let dir = tempfile::tempdir().unwrap();
    gappy(dir.path(), &format!("{}.csv", u32::MAX));
    let set = TrajectorySet::read_dir(dir.path()).unwrap();
    let last = u32::MAX - 1;
    let hole = Oddity::Hole { first: 0, last };
    assert_eq!(set.oddities(&Limits::default())[0], hole);
    gappy(dir.path(), &format!("{}.csv", u64::from(u32::MAX) + 1));
    let error = TrajectorySet::read_dir(dir.path()).unwrap_err().to_string();
    assert!(
        error.contains("expected a number of at most 4294967295"),
        "{error}"
    );
}
