//! Comparisons: paired differences, the neighbours' spread, and the command.

#![allow(clippy::unwrap_used)]

mod common;

use std::process::Command;

use spindoe::geometry::Vec3;
use spindoe::pattern::Pattern;
use spindoe::report::compare::{NeighbourSpread, PairedDifference};

#[test]
fn paired_differences_have_their_textbook_interval() {
    // A. Agresti, "Categorical Data Analysis", sec. 11.1.1: approval ratings of 1600 people, 150 of whom
    // changed to disapproval and 86 to approval: difference -0.04, interval -0.06 to -0.02.
    let d = PairedDifference::new(86, 150, 1600);
    assert!((d.difference + 0.04).abs() < 1e-12);
    assert!((d.low + 0.0587).abs() < 2e-4, "{d:?}");
    assert!((d.high + 0.0213).abs() < 2e-4, "{d:?}");
}

#[test]
fn a_cube_s_neighbours_are_all_alike() {
    let s = 1.0 / 3f64.sqrt();
    let dots = (0..8)
        .map(|k| {
            let sign = |bit: usize| if k >> bit & 1 == 0 { s } else { -s };
            Vec3::new(sign(0), sign(1), sign(2))
        })
        .collect();
    let spread = NeighbourSpread::of(&Pattern::new(dots).unwrap());
    // An edge of the cube is seen from its centre under arccos(1/3).
    assert!((spread.mean_rad - (1.0f64 / 3.0).acos()).abs() < 1e-12);
    assert!(spread.relative_std < 1e-7 && (spread.relative_min - 1.0).abs() < 1e-7);
}

#[test]
fn the_command_compares_on_the_same_trials() {
    let dir = tempfile::tempdir().unwrap();
    for (name, seed) in [("a", 1), ("b", 2)] {
        let path = dir.path().join(format!("{name}.csv"));
        common::random_pattern(12, seed).write_csv(&path).unwrap();
    }
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args(arguments)
            .current_dir(dir.path())
            .output()
            .unwrap()
    };
    let output = run(&[
        "compare",
        "a.csv",
        "b.csv",
        "a.csv",
        "--samples",
        "200",
        "--json",
        "-o",
        "out",
    ]);
    assert!(output.status.success());
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let contests = found["contests"].as_array().unwrap();
    assert_eq!(contests.len(), 2 * 4 * 3);
    for three in contests.chunks(3) {
        // The third is the first again: the same successes, and no difference at all.
        assert_eq!(three[0]["identity"], three[2]["identity"]);
        for key in ["identity_difference", "orientation_difference"] {
            for same in [&three[0], &three[2]] {
                assert_eq!(same[key]["difference"], 0.0);
                assert_eq!(same[key]["low"], 0.0);
            }
            let d = &three[1][key];
            assert!(d["low"].as_f64() <= d["difference"].as_f64());
        }
    }
    for file in [
        "comparison.json",
        "compare_paper.png",
        "compare_robust.png",
        "compare_bound.png",
    ] {
        assert!(dir.path().join("out").join(file).exists(), "{file}");
    }
    let output = run(&["compare", "a.csv"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("at least two, found 1"));
}
