//! FicTrac's columns by the command: of a rendered clip, live, of a painted ball, and what is refused.

use std::path::Path;

use serde_json::Value;
use spindoe::geometry::{Rotation, Vec3, from_wxyz};

use crate::common::{done, refused, spindoe};

/// A rig's clip: a ball that stands still and turns; the camera's intrinsics as a flag.
fn rig(dir: &Path, frames: &str) -> String {
    let made = format!(
        "synth dots20 -o clip --image-size 640x480 --ball-px 120 --frames {frames} --seed 5 --rps 2 --fps 100"
    );
    done(dir, &made.split(' ').collect::<Vec<_>>());
    let k = &truth(dir)["frames"][0]["intrinsics"];
    let known = ["fx", "fy", "cx", "cy"].map(|name| k[name].as_f64().unwrap().to_string());
    format!("--intrinsics={}", known.join(","))
}

fn truth(dir: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(dir.join("clip/truth.json")).unwrap()).unwrap()
}

fn rows(text: &str) -> Vec<Vec<f64>> {
    let row = |line: &str| line.split(", ").map(|n| n.parse().unwrap()).collect();
    text.lines().map(row).collect()
}

#[test]
fn a_rigs_clip_becomes_fictracs_file() {
    let dir = tempfile::tempdir().unwrap();
    let known = rig(dir.path(), "9");
    let usual = [
        "estimate",
        "--table",
        "dots20",
        "clip/images",
        &known,
        "--as",
        "fictrac",
    ];
    // The camera looks along the animal's front: the usual one.
    let output = spindoe(dir.path(), &[&usual[..], &["-o", "run.dat"]].concat());
    let words = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.success() && words.contains("lab frame"),
        "{words}"
    );
    let text = std::fs::read_to_string(dir.path().join("run.dat")).unwrap();
    let rows = rows(&text);
    assert_eq!(rows.len(), 9);
    let truth = truth(dir.path());
    let rotation = |k: usize| -> Rotation {
        let wxyz: [f64; 4] =
            serde_json::from_value(truth["frames"][k]["camera_quaternion_wxyz"].clone()).unwrap();
        from_wxyz(wxyz, 1e-6).unwrap()
    };
    for (k, row) in rows.iter().enumerate() {
        assert_eq!(row.len(), 25);
        assert_eq!((row[0], row[22]), (k as f64 + 1.0, k as f64 + 1.0));
        let Some(before) = k.checked_sub(1) else {
            continue;
        };
        // Camera axes are x right, y down, z forward: the truth's y and z turned around.
        let turn = (rotation(k) * rotation(before).inverse()).scaled_axis();
        let turn = Vec3::new(turn.x, -turn.y, -turn.z);
        let found = Vec3::from_column_slice(&row[1..4]);
        assert!((found - turn).norm() < 0.02, "row {k}: {found}, {turn}");
        assert!(row[4] > 0.0 && row[4] < 0.03, "row {k}: error {}", row[4]);
        // Behind the animal: forward is its front, right its right, down is down.
        assert!((row[5] - found.z).abs() < 1e-9 && (row[6] - found.x).abs() < 1e-9);
        assert!((row[7] - found.y).abs() < 1e-9);
        assert!((row[23] - 10.0).abs() < 1e-3, "{row:?}");
    }
    // Another pose of the camera: looking at the animal, which turns the front and the right around.
    let facing = done(
        dir.path(),
        &[
            &usual[..],
            &[
                "--config",
                "c2a_r=-1.2091995761561452,1.2091995761561452,1.2091995761561452",
            ],
        ]
        .concat(),
    );
    assert_ne!(facing, text);
    // Live the same rows, to what the later frames add.
    let mut files: Vec<_> = std::fs::read_dir(dir.path().join("clip/images"))
        .unwrap()
        .map(|f| f.unwrap().path())
        .collect();
    files.sort();
    let stream: Vec<u8> = files
        .iter()
        .flat_map(|path| std::fs::read(path).unwrap())
        .collect();
    std::fs::write(dir.path().join("stream"), stream).unwrap();
    let live = [
        "live", "stream", "--table", "dots20", "--fps", "100", &known, "--as", "fictrac",
    ];
    let lines = self::rows(&done(dir.path(), &live));
    assert_eq!(lines.len(), 9);
    for (line, row) in lines.iter().zip(&rows) {
        assert_eq!(line[0], row[0]);
        // The shorter a step, the less its direction is known.
        let weight = |k: usize| if k == 17 { row[18] } else { 1.0 };
        assert!(
            (0..21).all(|k| (line[k] - row[k]).abs() * weight(k) < 0.02),
            "{line:?} {row:?}"
        );
        // A stream's frames are taken now.
        assert!((0.0..86_400_000.0).contains(&line[24]));
    }
}

#[test]
fn a_painted_balls_path_and_what_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let known = rig(dir.path(), "5");
    // Its dots are paint.
    let painted = done(
        dir.path(),
        &[
            "estimate",
            "--painted",
            "clip/images",
            &known,
            "--as",
            "fictrac",
            "--config",
            "max_bad_frames=-1",
        ],
    );
    let rows = rows(&painted);
    assert_eq!(rows.len(), 5);
    assert!(
        rows[1..]
            .iter()
            .all(|row| row[1..4].iter().any(|x| x.abs() > 0.02)),
        "{painted}"
    );
    let base = ["estimate", "--table", "dots20", "clip/images"];
    for (args, words) in [
        (
            &["--as", "fictrac", "--config", "c2a_r=1,2"][..],
            "c2a_r: expected three numbers, found 2",
        ),
        (&["--as", "fictrac", "--config", "c2a_r=1,2,nan"], "c2a"),
        (
            &["--config", "c2a_r=1,2,3"],
            "expected only with --as fictrac",
        ),
        (&["--as", "fictrac", "--frame", "camera"], "--frame"),
        (&["--as", "fictrac", "--json"], "--json"),
        (&["--as", "fictrac", "--config", "max_bad_frames=-2"], "-2"),
    ] {
        refused(dir.path(), &[&base[..], args].concat(), 2, words);
    }
    // Frames without times have no path, and nothing is written.
    std::fs::create_dir(dir.path().join("untimed")).unwrap();
    for (k, file) in std::fs::read_dir(dir.path().join("clip/images"))
        .unwrap()
        .enumerate()
    {
        std::fs::copy(
            file.unwrap().path(),
            dir.path().join(format!("untimed/a{k}.png")),
        )
        .unwrap();
    }
    let untimed = [
        "estimate", "--table", "dots20", "untimed", "--as", "fictrac", "-o", "no.dat",
    ];
    let written: [&[&str]; 3] = [
        &["--report", "page.html"],
        &["--overlay", "drawn"],
        &["--painted", "--write-surface", "ball.npz"],
    ];
    for more in written {
        // A painted ball has no table.
        let of = if more[0] == "--painted" {
            &untimed[3..]
        } else {
            &untimed[1..]
        };
        refused(dir.path(), &[&untimed[..1], of, more].concat(), 2, "--fps");
        for none in ["no.dat", *more.last().unwrap()] {
            assert!(!dir.path().join(none).exists(), "{none}");
        }
    }
}
