//! Every flag that takes a value, as `--help` lists them, with values that nobody means.
//!
//! A few of them run with the other tests; `SPINDOE_BREAKS=100000` runs all.

use std::fs;
use std::path::Path;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::spin::orientations::Orientations;
use spindoe::spin::simulate::Scenario;

use crate::common::spindoe;

const EXTREMES: [&str; 9] = [
    "0",
    "-1",
    "nan",
    "inf",
    "1e308",
    "1e-308",
    "18446744073709551615",
    "",
    "LONG",
];

/// A command, its inputs, and the flags that make its work small. `@` stands for the folder of the inputs.
type Small = (
    &'static str,
    &'static [&'static str],
    &'static [[&'static str; 2]],
);

const COMMANDS: [Small; 20] = [
    // Ends where the folder is taken, after its arguments are checked.
    ("design", &[], &[["--output", "@/taken"]]),
    ("merge", &["@/absent"], &[["--output", "m"]]),
    ("validate", &["@/p.csv"], &[["--samples", "5"]]),
    ("advise", &["@/absent.csv"], &[]),
    ("report", &["@/absent"], &[]),
    ("validate", &["@/p.csv", "@/q.csv"], &[["--samples", "5"]]),
    (
        "validate",
        &["@/p.csv"],
        &[
            ["--samples", "2"],
            ["--sweep", "noise"],
            ["--output", "s"],
            ["--config", "sweep_noise_deg=2"],
            ["--config", "sweep_alpha=0.1"],
        ],
    ),
    ("table", &["@/p.csv"], &[["--output", "t.npz"]]),
    ("identify", &["@/d.csv"], &[["--table", "@/p.csv"]]),
    (
        "estimate",
        &["@/1.png", "@/2.png"],
        &[["--table", "@/p.csv"]],
    ),
    (
        "live",
        &["@/1.png"],
        &[["--table", "@/p.csv"], ["--fps", "100"]],
    ),
    (
        "calibrate",
        &["@/1.png", "@/2.png"],
        &[["--table", "@/p.csv"], ["--samples", "0"]],
    ),
    ("stencil", &["@/p.csv"], &[["--output", "@/taken"]]),
    (
        "mark",
        &["@/p.csv"],
        &[["--as", "gores"], ["--output", "m.svg"]],
    ),
    ("spin", &["@/o.csv"], &[]),
    (
        "synth",
        &[],
        &[
            ["--as", "orientations"],
            ["--output", "o.csv"],
            ["--frames", "20"],
        ],
    ),
    (
        "synth",
        &[],
        &[["--as", "dots"], ["--output", "o.csv"], ["--frames", "20"]],
    ),
    (
        "synth",
        &["@/p.csv"],
        &[
            ["--as", "images"],
            ["--frames", "1"],
            ["--config", "size_px=32"],
        ],
    ),
    ("synth", &[], &[["--frames", "2"]]),
    ("man", &[], &[["--output", "m"]]),
];

/// The flags of a command that take a value.
fn flags(dir: &Path, command: &str) -> Vec<String> {
    let help = spindoe(dir, &[command, "--help"]);
    let help = String::from_utf8(help.stdout).unwrap();
    let flag = |line: &str| {
        let (before, rest) = line.split_once("--")?;
        let is_listed = before.chars().all(|c| c == ' ') || before.trim().ends_with(',');
        let (name, value) = rest.split_once(" <").or_else(|| rest.split_once(" ["))?;
        let is_name = name.chars().all(|c| c.is_ascii_lowercase() || c == '-');
        (is_listed && before.len() < 12 && is_name && !value.is_empty())
            .then(|| format!("--{name}"))
    };
    let settings = spindoe(dir, &[command, "--print-config"]);
    let settings = String::from_utf8(settings.stdout).unwrap();
    let setting = |line: &str| {
        let (key, _) = line.trim_start_matches("# ").split_once(" =")?;
        let is_key = key.chars().all(|c| c.is_ascii_lowercase() || c == '_');
        let is_flag = help.contains(&format!("--{} ", key.replace('_', "-")));
        (is_key && !is_flag).then(|| format!("--config={key}"))
    };
    let flags = help.lines().filter_map(flag).filter(|f| f != "--config");
    flags.chain(settings.lines().filter_map(setting)).collect()
}

/// Whether a text has a number that is none.
fn has_no_number(text: &str) -> bool {
    let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.any(|w| ["NaN", "nan", "inf", "Infinity"].contains(&w))
}

/// The inputs of all commands.
fn inputs(dir: &Path) {
    let at = |name: &str| dir.join(name);
    super::pattern().write_csv(&at("p.csv")).unwrap();
    crate::common::random_pattern(9, 3)
        .write_csv(&at("q.csv"))
        .unwrap();
    let sequence = Scenario::default().sequence((40.0, 60.0), 3, 0);
    let orientations = Orientations::from_measurements(&sequence.measurements);
    orientations.write_csv(&at("o.csv")).unwrap();
    let views = spindoe::ProtocolName::Image.view();
    let frames = spindoe::recognize::observed::observed_frames(&super::pattern(), &views, 3, 4);
    fs::write(at("d.csv"), spindoe::recognize::observed::to_csv(&frames)).unwrap();
    fs::create_dir(at("taken")).unwrap();
    for name in ["report.json", "pattern.csv", "half_a.stl"] {
        fs::write(at("taken").join(name), "").unwrap();
    }
    #[cfg(feature = "vision")]
    for name in ["1.png", "2.png"] {
        image::RgbImage::new(40, 40).save(at(name)).unwrap();
    }
}

#[test]
fn extreme_values_are_refused_or_used() {
    let folder = tempfile::tempdir().unwrap();
    inputs(folder.path());
    let place = folder.path().to_str().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(super::setting("SPINDOE_BREAKS_SEED", 1));
    let all = super::setting("SPINDOE_BREAKS", 0) > 0;
    let known = spindoe(folder.path(), &["--help"]);
    let known = String::from_utf8(known.stdout).unwrap();
    let mut cases: Vec<(Vec<String>, String)> = Vec::new();
    for (command, inputs, usual) in COMMANDS {
        if !known.contains(&format!("  {command} ")) {
            // A feature that is not there.
            continue;
        }
        let found = flags(folder.path(), command);
        assert!(!found.is_empty(), "{command}");
        for flag in found {
            // Another folder is another design.
            if command == "design" && flag == "--output" {
                continue;
            }
            let mut values = EXTREMES.to_vec();
            let most = crate::common::few_or_all(1, 2);
            while !all && values.len() > most {
                values.swap_remove(rng.random_range(0..values.len()));
            }
            for value in values {
                let usual = usual.iter().filter(|[name, _]| *name != flag).flatten();
                let words = std::iter::once(&command).chain(inputs).chain(usual);
                let words = words.map(|w| w.replace('@', place));
                let value = value.replace("LONG", &"9".repeat(10_000));
                cases.push((words.collect(), format!("{flag}={value}")));
            }
        }
    }
    let begun = Instant::now();
    println!("{} runs", cases.len());
    cases.par_iter().for_each(|(words, flag)| {
        let dir = tempfile::tempdir().unwrap();
        let words = words.iter().map(String::as_str).chain([flag.as_str()]);
        let words: Vec<&str> = words.collect();
        let begun = Instant::now();
        let output = spindoe(dir.path(), &words);
        let took = begun.elapsed();
        let said = String::from_utf8_lossy(&output.stderr);
        let shown: String = words.join(" ").chars().take(300).collect();
        let context = format!("{shown}: {said}");
        assert!(took < super::PATIENCE, "{context}: {took:?}");
        let code = output.status.code();
        assert!(matches!(code, Some(0 | 2 | 3)), "{context}: {code:?}");
        assert!(
            said.lines().all(|line| line.chars().count() <= 400),
            "{context}"
        );
        if code == Some(2) {
            assert_eq!(said.trim_end().lines().count(), 1, "{context}");
            assert!(said.starts_with("spindoe: "), "{context}");
        } else if !flag.ends_with("=nan") && !flag.ends_with("=inf") {
            // Those are names of files where they are taken.
            let printed = String::from_utf8_lossy(&output.stdout);
            assert!(!has_no_number(&printed), "{context}: {printed}");
            for entry in fs::read_dir(dir.path()).unwrap() {
                let path = entry.unwrap().path();
                let kind = path
                    .extension()
                    .and_then(|e| e.to_str())
                    .unwrap_or_default();
                if ["csv", "json", "svg", "gcode"].contains(&kind) {
                    let text = fs::read_to_string(&path).unwrap();
                    assert!(!has_no_number(&text), "{context}: {}", path.display());
                }
            }
        }
    });
    println!("{:?}", begun.elapsed());
}

/// The numbers that were taken and made no sense, by name.
#[test]
fn numbers_without_meaning_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    inputs(dir);
    for (arguments, needle) in [
        (
            "synth --as orientations -o s.csv --rps 1e308",
            "--rps: expected 0 to 10000, found 1e308",
        ),
        (
            "synth --as orientations -o s.csv --config orientation_sigma_deg=1e308",
            "orientation_sigma_deg: expected 0 to 180",
        ),
        (
            "synth --as orientations -o s.csv --fps 1e-308",
            "--fps: expected 0.001 to 10000000",
        ),
        (
            "synth --as orientations -o s.csv --config jitter=1e308",
            "jitter: expected 0 to 1",
        ),
        (
            "synth --as orientations -o s.csv --config decay_per_s=1e308",
            "decay_per_s: expected 0 to 1000",
        ),
        ("spin o.csv --config prior_rps=1e308", "prior_rps"),
        (
            "spin o.csv --motion decaying --config ball_diameter_mm=1e308",
            "ball_diameter_mm",
        ),
        (
            "spin o.csv --config method=quatera --max-spin-rps 1e308",
            "--max-spin-rps",
        ),
        (
            "spin o.csv --config orientation_sigma_deg=1e-308",
            "orientation_sigma_deg: expected 0 or at least 1e-9",
        ),
        (
            "design --output d --config starts=18446744073709551615",
            "starts: expected 1 to 1000000",
        ),
        (
            "design --output d --config rounds=18446744073709551615",
            "rounds",
        ),
        (
            "design --output d --config bound_goal=1e308,1",
            "bound_goal",
        ),
        ("design --output d --config pixel_noise=nan", "pixel_noise"),
        (
            "identify --table p.csv d.csv --dot-sigma-deg 1e308",
            "--dot-sigma-deg",
        ),
        (
            "validate p.csv -o s --config sweep_alpha=1,1e308",
            "sweep_alpha",
        ),
        (
            "mark p.csv --as gores -o m.svg --config pen_delay_s=1",
            "pen_delay_s: goes with --as plotter only",
        ),
        (
            "mark p.csv --as plotter -o m.svg --config lobes=12",
            "lobes: goes with --as gores only",
        ),
        (
            "synth --as orientations -o absent/s.csv",
            "absent/s.csv: cannot be written",
        ),
        (
            "synth p.csv --as dots --frames 1000000 -o absent/d.csv",
            "absent/d.csv: cannot be written",
        ),
        (
            "spin o.csv --stretches absent/s.csv",
            "absent/s.csv: cannot be written",
        ),
        (
            "spin o.csv --windows absent/w.csv",
            "absent/w.csv: cannot be written",
        ),
        (
            "validate p.csv q.csv --samples 5 -o taken",
            "holds a design already",
        ),
        (
            "validate p.csv --sweep noise --samples 5 -o taken",
            "holds a design already",
        ),
    ] {
        let words: Vec<&str> = arguments.split(' ').collect();
        let output = spindoe(dir, &words);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains(needle), "{arguments}: {said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{arguments}: {said}");
    }
    #[cfg(feature = "vision")]
    for (arguments, needle) in [
        ("estimate --table p.csv 1.png --fps 1e308", "--fps"),
        (
            "estimate --table p.csv 1.png --max-latency-ms 9",
            "--max-latency-ms is now `spindoe live --max-latency-ms`",
        ),
        (
            "estimate --table p.csv --follow -",
            "--follow is now `spindoe live`",
        ),
        (
            "estimate --table p.csv 1.png --raw 9x9,gray",
            "--raw is now `spindoe live --raw`",
        ),
        (
            "live --table p.csv 1.png --fps 9 --max-latency-ms nan",
            "--max-latency-ms: expected",
        ),
        (
            "estimate --table p.csv 1.png --golf",
            "--golf is now --preset golf",
        ),
        ("stencil p.csv --paper a4", "--paper is now --sheet"),
        (
            "validate p.csv --sweep alpha",
            "--sweep alpha is now --config sweep_alpha=",
        ),
        (
            "estimate --table p.csv 1.png --weights w.npz",
            "weights: is no flag; expected --config weights=VALUE",
        ),
        (
            "calibrate --table p.csv 1.png --config search_sigma_deg=1e-308",
            "search_sigma_deg",
        ),
        ("advise --samples 18446744073709551615", "--samples"),
        (
            "synth --as orientations --camera camera.toml -o s.csv --fps nan",
            "--fps",
        ),
    ] {
        let words: Vec<&str> = arguments.split(' ').collect();
        let output = spindoe(dir, &words);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains(needle), "{arguments}: {said}");
    }
}

/// Images that are far wider than high, and the reverse.
#[cfg(feature = "vision")]
#[test]
fn images_of_extreme_shape_have_an_answer() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    super::pattern().write_csv(&dir.join("p.csv")).unwrap();
    for (width, height) in [
        (100_000, 1),
        (1, 100_000),
        (65_000, 3),
        (3, 1000),
        (1, 1),
        (2, 2),
    ] {
        let image = image::GrayImage::from_fn(width, height, |u, v| image::Luma([(u ^ v) as u8]));
        image.save(dir.join("1.png")).unwrap();
        for flags in [
            "",
            "--roi 0,0,2,1",
            "--config detector=blob",
            "--circle 1,1,9",
            "live",
        ] {
            let words = match flags {
                "live" => "live --table p.csv -".to_owned(),
                flags => format!("estimate --table p.csv 1.png {flags}"),
            };
            let output = std::process::Command::new(env!("CARGO_BIN_EXE_spindoe"))
                .args(words.split_whitespace())
                .current_dir(dir)
                .stdin(fs::File::open(dir.join("1.png")).unwrap())
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            let code = output.status.code();
            let context = format!("{width} x {height} {flags}: {code:?} {said}");
            assert!(matches!(code, Some(0 | 2 | 3)), "{context}");
        }
    }
    for raw in ["60000x1,gray", "1x60000,rgb"] {
        let words = format!("live --table p.csv - --raw {raw} --fps 300");
        fs::write(dir.join("zeros"), vec![0; 360_000]).unwrap();
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args(words.split(' '))
            .current_dir(dir)
            .stdin(fs::File::open(dir.join("zeros")).unwrap())
            .output()
            .unwrap();
        assert!(
            matches!(output.status.code(), Some(0 | 3)),
            "{raw}: {output:?}"
        );
    }
}
