//! Long recordings, through the command: all rows count, or the parts that hold are named.
//!
//! `SPINDOE_LONG=1000000` takes so many rows.

use std::path::Path;
use std::time::Instant;

use rand_distr::{Distribution, StandardNormal};
use spindoe::geometry::{Rotation, Vec3};
use spindoe::spin::Measurement;
use spindoe::spin::orientations::Orientations;
use spindoe::spin::simulate::{Scenario, stream};

use crate::common::{done, spindoe};

const FPS: f64 = 300.0;

fn rows() -> usize {
    super::setting("SPINDOE_LONG", 100_000) as usize
}

fn write(dir: &Path, name: &str, measurements: &[Measurement]) {
    let file = Orientations::from_measurements(measurements);
    file.write_csv(&dir.join(name)).unwrap();
}

/// A ball whose spin walks at random, as that of a treadmill's.
fn walk() -> Vec<Measurement> {
    let mut rng = stream(403, 0);
    let mut normal = |sigma: f64| {
        Vec3::from_fn(|_, _| {
            sigma * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng)
        })
    };
    let (mut spin, mut orientation) = (Vec3::new(60.0, 100.0, 80.0), Rotation::identity());
    let measured = |k| {
        let noise = Rotation::from_scaled_axis(normal(0.035));
        let measurement = Measurement::new(k as f64 / FPS, noise * orientation);
        orientation = Rotation::from_scaled_axis(spin / FPS) * orientation;
        spin += normal(0.3);
        measurement
    };
    (0..rows()).map(measured).collect()
}

#[test]
fn where_no_spin_holds_over_a_long_file_its_parts_are_data() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    write(dir, "walk.csv", &walk());
    let begun = Instant::now();
    let arguments = [
        "spin",
        "walk.csv",
        "--json",
        "--windows",
        "w.csv",
        "--config",
        "window=30",
    ];
    let output = spindoe(dir, &arguments);
    println!("{} rows: {:?}", rows(), begun.elapsed());
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(json["spin_rad_s"].is_null() && json["reason"].is_string());
    let count = |list: &str, field: &str| -> u64 {
        let all = json[list].as_array().unwrap().iter();
        all.map(|part| part[field].as_u64().unwrap()).sum()
    };
    assert!(count("stretches", "orientations") as f64 > 0.9 * rows() as f64);
    assert!(count("windows", "inliers") as f64 > 1.5 * rows() as f64);
    let text = std::fs::read_to_string(dir.join("w.csv")).unwrap();
    let (header, windows) = text.split_once('\n').unwrap();
    assert_eq!(
        header,
        "time_s,wx,wy,wz,rps,std_x,std_y,std_z,inliers,frames,camera_frame"
    );
    let mut last = f64::NEG_INFINITY;
    for row in windows.lines() {
        let row = row.strip_suffix(",camera").expect("the frame");
        let values: Vec<f64> = row.split(',').map(|v| v.parse().unwrap()).collect();
        let [time_s, x, y, z, rps, .., inliers, frames] = values[..] else {
            panic!("{row}");
        };
        assert!(
            time_s > last && inliers <= frames && frames == 30.0,
            "{row}"
        );
        assert!((rps * std::f64::consts::TAU - x.hypot(y).hypot(z)).abs() < 1e-6 * rps.max(1.0));
        last = time_s;
    }
    assert_eq!(
        windows.lines().count() as u64,
        json["windows"].as_array().unwrap().len() as u64
    );
}

#[test]
fn all_rows_of_a_long_file_count() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    for (name, decay_per_s) in [("constant", 0.0), ("decaying", 0.001)] {
        let scenario = Scenario {
            frames: rows(),
            fps: FPS,
            decay_per_s,
            ..Scenario::default()
        };
        let spin = Vec3::new(0.6, 0.64, 0.48) * (30.0 * std::f64::consts::TAU);
        let sequence = scenario.simulate(spin, &mut stream(404, 0));
        write(dir, "o.csv", &sequence.measurements);
        let begun = Instant::now();
        let json = done(dir, &["spin", "o.csv", "--json"]);
        println!("{name}, {} rows: {:?}", rows(), begun.elapsed());
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(json["motion"], name);
        assert!(
            json["inliers"].as_f64().unwrap() > 0.92 * rows() as f64,
            "{name}: {json}"
        );
    }
}
