//! Input that has a form and no meaning is said or refused.

use std::fs;
use std::path::Path;

use crate::common::{done, spindoe};

/// The command's one line; its exit code is `code`.
fn line(dir: &Path, arguments: &[&str], code: i32) -> String {
    let output = spindoe(dir, arguments);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {words}");
    assert_eq!(
        words.trim_end().lines().count(),
        1,
        "{arguments:?}: {words}"
    );
    assert!(!words.trim_end().contains(char::is_control), "{words:?}");
    assert!(words.len() < 400, "{arguments:?}: {words}");
    words
}

#[test]
fn refusals_are_one_short_line_before_any_work() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    super::pattern().write_csv(&at("p.csv")).unwrap();
    crate::common::random_pattern(9, 3)
        .write_csv(&at("q.csv"))
        .unwrap();
    fs::write(
        at("tab\t.csv"),
        format!("x,y,z\n1,0,{}\n", "9".repeat(10_000)),
    )
    .unwrap();
    let long = "x".repeat(10_000);
    for arguments in [
        &["validate", "p.csv", "q.csv", "--samples", "0"][..],
        &["validate", "p.csv", "q.csv", "--samples", "99999999999"],
        &[
            "validate",
            "p.csv",
            "--sweep=noise",
            "-o",
            "s",
            "--samples",
            "0",
        ],
        &[
            "validate",
            "p.csv",
            "--sweep=noise",
            "-o",
            "s",
            "--config=sweep_noise_deg=1,nan",
            "--samples",
            "20",
        ],
        &[
            "validate",
            "p.csv",
            "-o",
            "s",
            "--config=sweep_alpha=1,-1",
            "--samples",
            "20",
        ],
        &["design", "--output", "d", "--samples", "99999999999"],
        &["design", "--output", "d", "--config=bound_weight=-1e308"],
        &["table", "tab\t.csv", "-o", "t.npz"],
        &["validate", &long],
        &["synth", "--frames", &long],
    ] {
        line(dir.path(), arguments, 2);
    }
    assert!(!at("s").exists() && !at("d").exists());
}

#[cfg(feature = "vision")]
#[test]
fn an_empty_camera_and_a_ball_twice_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    super::pattern().write_csv(&at("p.csv")).unwrap();
    fs::write(at("camera.toml"), "# ball_px = 40\n").unwrap();
    let words = line(
        dir.path(),
        &["validate", "p.csv", "--camera", "camera.toml"],
        2,
    );
    assert!(words.contains("at least one property"), "{words}");
    fs::copy(at("p.csv"), at("q.csv")).unwrap();
    image::RgbImage::new(40, 40).save(at("1.png")).unwrap();
    let twice = ["estimate", "--table", "p.csv", "--table", "q.csv", "1.png"];
    let words = line(dir.path(), &twice, 2);
    assert!(words.contains("the same pattern as p.csv"), "{words}");
    // The same ball, its columns cycled: a rotation.
    let turned = super::pattern();
    let turned = turned.dots().iter().map(|d| d.yzx());
    let turned = spindoe::Pattern::new(turned.collect()).unwrap();
    turned.write_csv(&at("q.csv")).unwrap();
    let words = line(dir.path(), &twice, 2);
    assert!(words.contains("up to a rotation"), "{words}");
    // Its mirror image is another ball.
    let mirrored = super::pattern();
    let mirrored = mirrored.dots().iter().map(|d| d.yxz());
    let mirrored = spindoe::Pattern::new(mirrored.collect()).unwrap();
    mirrored.write_csv(&at("q.csv")).unwrap();
    let output = spindoe(dir.path(), &twice);
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    // A configuration with a field that is none.
    fs::write(at("c.json"), "{\"nothing\": 1}").unwrap();
    let synth = ["synth", "p.csv", "--output", "s", "--preset", "c.json"];
    let words = line(dir.path(), &synth, 2);
    assert!(words.contains("unknown field `nothing`"), "{words}");
    // Outlines of frames that are not there.
    fs::write(at("o.csv"), "frame,u,v,radius\n1,20,20,9\n2,20,20,9\n").unwrap();
    let circles = ["estimate", "--table", "p.csv", "1.png", "--circle", "o.csv"];
    let output = spindoe(dir.path(), &circles);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(
        words.contains("--circle: the row on line 3 names no frame"),
        "{words}"
    );
}

#[cfg(feature = "vision")]
#[test]
fn names_of_other_notations_are_said() {
    let dir = tempfile::tempdir().unwrap();
    let sample = ["synth", "--output", "s", "--frames", "6", "--rps", "20"];
    done(dir.path(), &sample);
    let clip = dir.path().join("s/images");
    let mut frames: Vec<_> = fs::read_dir(&clip)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    frames.sort_by_key(|f| {
        f.file_stem()
            .unwrap()
            .to_string_lossy()
            .parse::<u64>()
            .unwrap()
    });
    let estimate = |folder: &str, names: &[&str]| {
        let to = dir.path().join(folder);
        fs::create_dir(&to).unwrap();
        for (frame, name) in frames.iter().zip(names) {
            fs::copy(frame, to.join(format!("{name}.png"))).unwrap();
        }
        let arguments = [
            "estimate",
            "--table",
            "s/table.npz",
            folder,
            "--config=no_verdict=true",
            "-q",
        ];
        let output = spindoe(dir.path(), &arguments);
        let (out, err) = (output.stdout, output.stderr);
        (
            String::from_utf8(out).unwrap(),
            String::from_utf8(err).unwrap(),
        )
    };
    for (folder, names) in [
        ("scientific", ["1e3", "2e3", "3e3", "9e3", "1e4", "2e4"]),
        ("hexadecimal", ["0x8", "0x9", "0xa", "0xb", "0xc", "0x10"]),
        ("bare", ["08", "09", "0a", "0b", "0c", "10"]),
        ("word", ["f1e3", "f2e3", "f3e3", "f9e3", "f1e4", "f2e4"]),
        ("point", ["f0.1", "f0.2", "f0.3", "f0.9", "f0.10", "f0.11"]),
    ] {
        let (_, words) = estimate(folder, &names);
        assert!(
            words.contains("no plain whole numbers"),
            "{folder}: {words}"
        );
    }
    let (_, words) = estimate("plain", &["a1", "a2", "a3", "a4", "a10", "a11"]);
    assert!(!words.contains("plain"), "{words}");
    let (_, words) = estimate("signs", &["a-1", "a-2", "a-3", "a-4", "a-10", "a-11"]);
    assert!(!words.contains("plain"), "{words}");
    let (_, words) = estimate("same", &["1", "01", "001", "0001", "00001", "000001"]);
    assert!(
        words.contains("one and the same number") && !words.contains("inf"),
        "{words}"
    );
    // No number but one: no rate follows from it, in JSON either.
    let one = ["estimate", "--table", "s/table.npz", "same/1.png", "--json"];
    let output = spindoe(dir.path(), &one);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(json["times"]["fps"].is_null(), "{}", json["times"]);
    assert!(json["times_words"].is_null(), "{}", json["times_words"]);
    let same = "calibrate same --table s/table.npz --samples 0";
    let same: Vec<&str> = same.split(' ').collect();
    let words = String::from_utf8(spindoe(dir.path(), &same).stderr).unwrap();
    assert!(words.contains("one and the same number"), "{words}");
    // At 300 frames a second.
    let microseconds = ["0", "3333", "6667", "10000", "13333", "16667"];
    let (_, words) = estimate("microseconds", &microseconds);
    assert!(words.contains("300.03 if they are microseconds"), "{words}");
}
