//! `spindoe calibrate` on a synthetic clip, and on what is none.

use std::fs;
use std::path::Path;

use serde_json::Value;
use spindoe::Ball;
use spindoe::geometry::angle_between;

use super::clip::drawn;
use crate::common::{done, random_pattern, refused, spindoe};

/// A clip of 40 frames of a ball drawn from `nominal.csv`, whose dots are in `drawn.csv`.
fn clip(dir: &Path) {
    let nominal = random_pattern(20, 5);
    nominal.write_csv(&dir.join("nominal.csv")).unwrap();
    let mut dots = drawn(&nominal, 0.025, 3);
    dots.remove(7);
    let dots = spindoe::Pattern::new(dots).unwrap();
    dots.write_csv(&dir.join("drawn.csv")).unwrap();
    let sequence = "synth drawn.csv --output clip --frames 40 --seed 9 --preset good --fps 60 --rps 3 \
                    --config placement_sigma_deg=0 --config logo_probability=0 --exposure-ms 0.5 --config camera_distance_radii=20";
    done(dir, &sequence.split_whitespace().collect::<Vec<_>>());
}

#[test]
fn a_clip_gives_a_table_of_the_ball_as_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    clip(dir);
    let calibrate = "calibrate --table nominal.csv clip/images --output ball --samples 200 --json";
    let report = done(dir, &calibrate.split_whitespace().collect::<Vec<_>>());
    let report: Value = serde_json::from_str(&report).unwrap();
    let seventh = &report["dots"][7];
    // One axis in 40 frames: the dot is missing, or its side was not seen.
    assert_ne!(seventh["state"], "measured", "{seventh}");
    for file in [
        "pattern.csv",
        "table.npz",
        "report.json",
        "report.html",
        "offsets.csv",
        "offsets.png",
        "dots.png",
    ] {
        assert!(dir.join("ball").join(file).is_file(), "{file}");
    }
    let offsets = fs::read_to_string(dir.join("ball/offsets.csv")).unwrap();
    assert_eq!(offsets.lines().count(), 21);

    // The set of dots: this clip's own views are easier than the hard ones, and what one more dot would do is said of
    // trials of its own.
    let set = &report["dot_set"];
    let rate = |answers: &Value| answers["right"]["rate"].as_f64().unwrap();
    let [clip, hard] = [&set["clip_answers"], &set["hard"]["answers"]].map(rate);
    assert!(clip >= hard && hard > 0.9, "{clip} {hard}");
    assert_eq!(set["hard"]["answers"]["right"]["trials"], 200);
    let found = set["clip"]["detection"]["probability"].as_f64().unwrap();
    assert!((0.7..=1.0).contains(&found), "{found}");
    if let Some(next) = set["hard"]["next_dot"].as_object() {
        assert_eq!(next["gain"]["trials"], 400);
        assert_ne!(next["seed"], set["hard"]["seed"]);
    }
    let page = fs::read_to_string(dir.join("ball/report.html")).unwrap();
    assert!(page.contains("in hard views (noise 5.0 deg"));
    let table = Ball::read_npz(&dir.join("ball/table.npz")).unwrap();
    assert_eq!(table.meta().format_version, 2);
    let drawn = spindoe::Pattern::read_csv(&dir.join("drawn.csv")).unwrap();
    let nominal = spindoe::Pattern::read_csv(&dir.join("nominal.csv")).unwrap();
    let record = table.meta().calibration.clone().unwrap();
    let rms = |measured: bool| {
        let mut squares = Vec::new();
        for (k, number) in record.nominal_numbers.iter().enumerate() {
            let j = usize::from(number.unwrap());
            if record.views[k] < 5 || j == 7 {
                continue;
            }
            let at = if measured {
                table.pattern().dots()[k]
            } else {
                nominal.dots()[j]
            };
            squares.push(angle_between(&drawn.dots()[j - usize::from(j > 7)], &at).powi(2));
        }
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    // Without taking the gauge off: that alone leaves a part.
    assert!(rms(true) < 0.5 * rms(false), "{} {}", rms(true), rms(false));

    // It is not replaced unasked, nor mixed with a design.
    fs::write(dir.join("ball/offsets.csv"), "of before").unwrap();
    let again: Vec<_> = calibrate.split_whitespace().collect();
    let refusal =
        "holds a calibration already (pattern.csv); choose another folder, or --overwrite it";
    refused(dir, &again, 2, refusal);
    fs::create_dir(dir.join("ball/stencil")).unwrap();
    let replace = [&again[..], &["--overwrite"]].concat();
    refused(
        dir,
        &replace,
        2,
        "holds a design already (stencil); choose another folder",
    );
    fs::remove_dir(dir.join("ball/stencil")).unwrap();
    done(dir, &replace);
    assert_eq!(
        fs::read_to_string(dir.join("ball/offsets.csv")).unwrap(),
        offsets
    );

    // All commands take the table.
    done(dir, &["validate", "ball/table.npz", "--samples", "100"]);
    let estimate = [
        "estimate",
        "--table",
        "ball/table.npz",
        "clip/images",
        "--json",
    ];
    let with_table: Value = serde_json::from_str(&done(dir, &estimate)).unwrap();
    let two_passes = [
        "estimate",
        "--table",
        "nominal.csv",
        "clip/images",
        "--calibrate",
        "--json",
    ];
    let on_the_fly: Value = serde_json::from_str(&done(dir, &two_passes)).unwrap();
    let nominal = [
        "estimate",
        "--table",
        "nominal.csv",
        "clip/images",
        "--json",
    ];
    let nominal: Value = serde_json::from_str(&done(dir, &nominal)).unwrap();
    let residual = |answer: &Value| {
        let frames = answer["frames"].as_array().unwrap();
        let all: Vec<f64> = frames
            .iter()
            .filter_map(|f| f["residual_deg"].as_f64())
            .collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    assert!(residual(&with_table) < 0.7 * residual(&nominal));
    assert!(residual(&on_the_fly) < 0.7 * residual(&nominal));

    // A second calibration does not mix with the first.
    let again = spindoe(
        dir,
        &[
            "calibrate",
            "--table",
            "nominal.csv",
            "clip/images",
            "--output",
            "ball",
        ],
    );
    assert_eq!(again.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&again.stderr).contains("--output"));
}

#[test]
fn what_cannot_be_calibrated_exits_with_a_word() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let nominal = random_pattern(20, 5);
    nominal.write_csv(&dir.join("nominal.csv")).unwrap();
    for (flags, word) in [
        ("--table nominal.csv --dots 20", "--dots"),
        ("--dots 3", "4 to 64"),
        ("--learn-extra", "--table"),
        ("--marks 0-9", "marks.csv"),
    ] {
        let command = ["calibrate", "clip", "-o", "no"].into_iter();
        let command: Vec<&str> = command.chain(flags.split(' ')).collect();
        crate::common::refused(dir, &command, 2, word);
        assert!(!dir.join("no").exists(), "{flags}");
    }
    for (kind, word) in [
        ("noise", "ball"),
        ("dotless", "ball"),
        ("other-pattern", "ball"),
    ] {
        let out = format!("clip-{kind}");
        let synth = format!(
            "synth nominal.csv --as images --output {out} --frames 12 --seed 2 --preset good --config kind={kind}"
        );
        done(dir, &synth.split_whitespace().collect::<Vec<_>>());
        let images = format!("{out}/images");
        let found = spindoe(
            dir,
            &[
                "calibrate",
                "--table",
                "nominal.csv",
                &images,
                "--output",
                "no",
            ],
        );
        let words = String::from_utf8_lossy(&found.stderr).into_owned();
        assert_eq!(found.status.code(), Some(3), "{kind}: {words}");
        assert!(words.contains(word), "{kind}: {words}");
        assert!(!dir.join("no").exists(), "{kind}");
    }
    done(
        dir,
        &"synth nominal.csv --as images --output three --frames 3 --seed 3 --preset good"
            .split(' ')
            .collect::<Vec<_>>(),
    );
    // Of several clips all are named, and how many frames of each are of use.
    let several = "calibrate --table nominal.csv clip-other-pattern/images three/images -o no";
    let found = spindoe(dir, &several.split(' ').collect::<Vec<_>>());
    let words = String::from_utf8_lossy(&found.stderr).into_owned();
    assert_eq!(found.status.code(), Some(3), "{words}");
    for said in [
        "spindoe: clip-other-pattern/images, three/images: ",
        "; frames identified: clip-other-pattern/images ",
        " of 12, three/images ",
    ] {
        assert!(words.contains(said), "{words}");
    }
    let three = [
        "calibrate",
        "--table",
        "nominal.csv",
        "three/images",
        "--output",
        "no",
    ];
    let found = spindoe(dir, &three);
    let words = String::from_utf8_lossy(&found.stderr).into_owned();
    assert_eq!(found.status.code(), Some(3), "{words}");
    assert!(words.contains("too few frames"), "{words}");
    assert!(!dir.join("no").exists());
    for bad in [
        &["calibrate", "--table", "nominal.csv", "absent"][..],
        &["calibrate", "nominal.csv"][..],
        &[
            "calibrate",
            "--table",
            "nominal.csv",
            "nominal.csv",
            "--config",
            "search_sigma_deg=-1",
        ],
    ] {
        let found = spindoe(dir, bad);
        assert_eq!(found.status.code(), Some(2), "{bad:?}");
        assert_eq!(
            String::from_utf8_lossy(&found.stderr).lines().count(),
            1,
            "{bad:?}"
        );
    }
}
