//! Sets of flights in the published format: read as they are, or rejected by line.

use std::path::Path;

use spindoe::geometry::Vec3;
use spindoe::spin::trajectories::TrajectorySet;

/// Four flights with what real recordings have: a repeated time, a jump, a low point, a flight without a
/// spin, a spin without a flight.
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
fn reads_a_set_as_it_is() {
    let dir = tempfile::tempdir().unwrap();
    write_set(dir.path());
    let set = TrajectorySet::read_dir(dir.path()).unwrap();
    let numbers: Vec<u32> = set.trajectories.iter().map(|t| t.number).collect();
    assert_eq!(numbers, [0, 2, 3, 5]);
    assert_eq!(set.trajectories[0].spin, Some(Vec3::new(10.0, 0.0, 0.0)));
    assert_eq!(set.trajectories[3].spin, None);
    assert_eq!(set.without_file, [(9, Vec3::new(1.0, 2.0, 3.0))]);
    // A repeated time and a jump are the recording's own.
    let odd = &set.trajectories[1].points;
    assert_eq!(odd[4], odd[5]);
    assert_eq!(odd[11].position_m, Vec3::new(0.0, 9.0, 0.3));
    assert_eq!(set.trajectories[2].points.len(), 4);
}

#[test]
fn the_published_set_is_read() {
    let Some(published) = crate::common::published_trajectories() else {
        return;
    };
    let set = TrajectorySet::read_dir(&published).unwrap();
    let summary = set.summary();
    assert_eq!(summary.trajectories, 232);
    assert_eq!(summary.points, 15_422);
    assert!((summary.interval_s - 0.007).abs() < 1e-9, "{summary:?}");
}

#[test]
fn a_set_is_summed_up_and_a_bad_one_refused() {
    let dir = tempfile::tempdir().unwrap();
    write_set(dir.path());
    let read = || TrajectorySet::read_dir(dir.path());
    let summary = read().unwrap().summary();
    assert_eq!((summary.trajectories, summary.points), (4, 40));

    let refused = |name: &str, text: &str, expected: &[&str]| {
        let path = dir.path().join(name);
        let kept = std::fs::read(&path).unwrap();
        std::fs::write(&path, text).unwrap();
        let error = read().unwrap_err();
        std::fs::write(&path, kept).unwrap();
        let message = error.to_string();
        assert!(error.is_usage(), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
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
    let message = read().unwrap_err().to_string();
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
fn errors_name_lines_as_an_editor_counts() {
    let dir = tempfile::tempdir().unwrap();
    gappy(dir.path(), "000.csv");
    let path = dir.path().join("000.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    // The sixth point stands on line 12.
    std::fs::write(&path, text.replace("0.035;0;", "0.035;up;")).unwrap();
    let error = TrajectorySet::read_dir(dir.path()).unwrap_err().to_string();
    assert!(error.contains("line 12"), "{error}");
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
fn the_largest_number_is_a_number() {
    let dir = tempfile::tempdir().unwrap();
    gappy(dir.path(), &format!("{}.csv", u32::MAX));
    let set = TrajectorySet::read_dir(dir.path()).unwrap();
    assert_eq!(set.trajectories[0].number, u32::MAX);
    gappy(dir.path(), &format!("{}.csv", u64::from(u32::MAX) + 1));
    let error = TrajectorySet::read_dir(dir.path()).unwrap_err().to_string();
    assert!(
        error.contains("expected a number of at most 4294967295"),
        "{error}"
    );
}
