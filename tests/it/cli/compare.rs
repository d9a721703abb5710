//! Comparisons: paired differences, the neighbors' spread, and the command.

use std::process::Command;

use spindoe::geometry::Vec3;
use spindoe::pattern::Pattern;
use spindoe::report::compare::NeighborSpread;
use spindoe::stats::{PairedDifference, Pairs};

fn of(both: u64, gained: u64, lost: u64, neither: u64) -> PairedDifference {
    PairedDifference::new(Pairs {
        both,
        gained,
        lost,
        neither,
    })
}

#[test]
fn paired_differences_have_their_published_interval() {
    // R. G. Newcombe, Statistics in Medicine 17 (1998), table II, method 10: 36, 12, 2, 0.
    let d = of(36, 12, 2, 0);
    assert!((d.difference - 0.2).abs() < 1e-12);
    assert!((d.low - 0.0569).abs() < 5e-5, "{d:?}");
    assert!((d.high - 0.3404).abs() < 5e-5, "{d:?}");
    // With many trials it is Wald's: A. Agresti, "Categorical Data Analysis", sec. 11.1.1, approval
    // ratings of 1600 people, 150 of whom changed to disapproval and 86 to approval.
    let d = of(794, 86, 150, 570);
    assert!((d.difference + 0.04).abs() < 1e-12);
    assert!((d.low + 0.0587).abs() < 3e-4, "{d:?}");
    assert!((d.high + 0.0213).abs() < 3e-4, "{d:?}");
}

#[test]
fn trials_without_a_difference_still_leave_a_doubt() {
    // No trial tells the two apart: Wald's interval would be a point. Newcombe's is what two Wilson
    // intervals of 20 of 20 leave, z^2 / (n + z^2) for each.
    let d = of(20, 0, 0, 0);
    let reach = 3.841_459 / (20.0 + 3.841_459);
    assert!(
        d.difference == 0.0 && (d.high - reach).abs() < 1e-6,
        "{d:?}"
    );
    assert!((d.low + reach).abs() < 1e-6);
    // Turned about, the interval turns about.
    let (d, e) = (of(30, 9, 4, 7), of(30, 4, 9, 7));
    assert!((d.low + e.high).abs() < 1e-12 && (d.high + e.low).abs() < 1e-12);
}

#[test]
fn a_cube_s_neighbors_are_all_alike() {
    let s = 1.0 / 3f64.sqrt();
    let dots = (0..8)
        .map(|k| {
            let sign = |bit: usize| if k >> bit & 1 == 0 { s } else { -s };
            Vec3::new(sign(0), sign(1), sign(2))
        })
        .collect();
    let spread = NeighborSpread::of(&Pattern::new(dots).unwrap());
    // An edge of the cube is seen from its center under arccos(1/3).
    assert!((spread.mean_rad - (1.0f64 / 3.0).acos()).abs() < 1e-12);
    assert!(spread.relative_std < 1e-7 && (spread.relative_min - 1.0).abs() < 1e-7);
}

#[test]
fn the_command_compares_on_the_same_trials() {
    let dir = tempfile::tempdir().unwrap();
    for (name, seed) in [("a", 1), ("b", 2)] {
        let path = dir.path().join(format!("{name}.csv"));
        crate::common::random_pattern(12, seed)
            .write_csv(&path)
            .unwrap();
    }
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args(arguments)
            .current_dir(dir.path())
            .output()
            .unwrap()
    };
    let output = run(&[
        "validate",
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
        // The third is the first again: the same successes, and no difference, which the first has by
        // definition and the third by its trials.
        assert_eq!(three[0]["identity"], three[2]["identity"]);
        for key in ["identity_difference", "answered_difference"] {
            assert_eq!(three[0][key]["high"], 0.0);
            assert_eq!(three[2][key]["difference"], 0.0);
            assert!(three[2][key]["low"].as_f64() < Some(0.0));
            let d = &three[1][key];
            assert!(d["low"].as_f64() <= d["difference"].as_f64());
        }
    }
    let names: Vec<_> = found["patterns"].as_array().unwrap().iter().collect();
    assert_eq!(names[0]["name"], "a.csv");
    assert_eq!(names[1]["name"], "b");
    assert_eq!(names[2]["name"], "a.csv (3)");
    for file in ["comparison.json", "report.html"] {
        assert!(dir.path().join("out").join(file).exists(), "{file}");
    }
    // From most directions fewer than two of four dots are seen: the bound is a dash, not "inf".
    crate::common::random_pattern(4, 3)
        .write_csv(&dir.path().join("four.csv"))
        .unwrap();
    let output = run(&[
        "validate",
        "four.csv",
        "a.csv",
        "--samples",
        "50",
        "--config",
        "recognizer=robust",
    ]);
    assert!(output.status.success());
    let words = String::from_utf8_lossy(&output.stdout);
    assert!(words.contains("mean -, worst -"), "{words}");
    // The folder is that of several patterns.
    let output = run(&["validate", "a.csv", "-o", "one"]);
    assert_eq!(output.status.code(), Some(2));
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(
        words.contains("--output: cannot be used with one pattern"),
        "{words}"
    );
}
