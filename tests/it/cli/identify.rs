//! `spindoe identify`: the same views, by file, get the same answers; bad files get one line and exit 2.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

use crate::common::{done, few_or_all, spindoe};
use serde_json::Value;
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::recognize::{DotUncertainty, Recognizer, observed};
use spindoe::spin::orientations::Orientations;
use spindoe::view::Trial;
use spindoe::{ProtocolName, Trials};

fn workshop() -> tempfile::TempDir {
    crate::common::workshop(20)
}

#[test]
fn dumped_trials_get_the_answers_that_validation_got() {
    let dir = workshop();
    let pattern = crate::common::random_pattern(20, 5);
    for name in ProtocolName::ALL {
        let protocol = name.as_str();
        let view = [
            "validate",
            "table.npz",
            "--protocol",
            protocol,
            "--samples",
            "150",
        ];
        let seed = ["--seed", "4", "--json"];
        let validation: Value =
            serde_json::from_str(&done(dir.path(), &[&view[..], &seed].concat())).unwrap();
        dumped(dir.path(), protocol, "150", "4");
        let identify = [
            "identify",
            "--table",
            "table.npz",
            "dots.csv",
            "--protocol",
            protocol,
            // Validation counts every answer.
            "--min-confidence",
            "0",
            "--json",
        ];
        let found: Value = serde_json::from_str(&done(dir.path(), &identify)).unwrap();
        let mut frames = found["frames"].as_array().unwrap().iter();
        let robust = RobustRecognizer::new(&pattern, name.view().into()).unwrap();
        let trials = Trials::first(&pattern, name.view(), 4, 150);
        let mut generator = trials.generator();
        let (mut trial, mut ws) = (Trial::default(), robust.workspace());
        let mut right = 0;
        for index in trials.range {
            generator.generate(index, &mut trial);
            if trial.dots.len() < trials.view.min_dots {
                continue;
            }
            let frame = frames.next().unwrap();
            assert_eq!(frame["frame"], format!("trial-{index}"));
            match robust.identify(&trial.dots, &mut ws) {
                Ok(answer) => {
                    let assignment = serde_json::to_value(&answer.assignment).unwrap();
                    assert_eq!(frame["assignment"], assignment);
                    let confidence = frame["dots_confidence"].as_f64().unwrap();
                    assert!((confidence - answer.dots_confidence).abs() < 1e-6);
                    right += u64::from(answer.assignment == trial.truth);
                }
                Err(refusal) => assert_eq!(frame["refusal"], refusal.to_string()),
            }
        }
        assert_eq!(frames.next(), None);
        assert_eq!(validation["identity"]["successes"], right, "{name}");
    }
}

#[test]
fn orientations_go_to_a_file_that_spin_reads() {
    let dir = workshop();
    let pattern = crate::common::random_pattern(20, 5);
    let trials = Trials::first(&pattern, ProtocolName::Paper.view(), 1, 5);
    let mut generator = trials.generator();
    let mut trial = Trial::default();
    let mut frames = Vec::new();
    for index in trials.range {
        generator.generate(index, &mut trial);
        frames.push(observed::ObservedFrame {
            name: format!("{}", 1_000_000_000 + 2_000_000 * index),
            time_s: None,
            is_numbered: false,
            dots: trial.dots.clone(),
        });
    }
    let dots = dir.path().join("dots.csv");
    fs::write(&dots, observed::to_csv(&frames)).unwrap();
    let arguments = [
        "identify",
        "--table",
        "table.npz",
        "dots.csv",
        "-o",
        "orientations.csv",
    ];
    for recognizer in ["voting", "robust"] {
        let setting = format!("recognizer={recognizer}");
        let named = [&arguments[..], &["--config", &setting]].concat();
        assert_eq!(done(dir.path(), &named), "");
        let read = Orientations::read_csv(&dir.path().join("orientations.csv")).unwrap();
        assert_eq!(read.rows.len(), 5);
        for (k, row) in read.rows.iter().enumerate() {
            // The name is a number of nanoseconds.
            assert!((row.time_s - 1.0 - 0.002 * k as f64).abs() < 1e-12);
            assert_eq!(row.dots, Some(frames[k].dots.len()));
        }
        assert!(read.rows.iter().filter(|r| r.orientation.is_some()).count() >= 4);
    }
    // A time in the file goes before the name; a name that is no number has no time.
    frames[0].time_s = Some(0.5);
    frames[1].name = "left".into();
    fs::write(&dots, observed::to_csv(&frames)).unwrap();
    let text = done(
        dir.path(),
        &["identify", "--table", "table.npz", "dots.csv"],
    );
    let lines: Vec<_> = text.lines().collect();
    assert!(lines[0].starts_with("frame,time_s,qw,"));
    assert!(lines[1].starts_with("1000000000,0.5,"), "{}", lines[1]);
    assert!(lines[2].starts_with("left,,"), "{}", lines[2]);
}

#[test]
fn uncertainties_survive_the_file() {
    let pattern = crate::common::random_pattern(20, 5);
    let view = ProtocolName::Image.view();
    let frames = observed::observed_frames(&pattern, &view, 3, 20);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("dots.csv");
    fs::write(&path, observed::to_csv(&frames)).unwrap();
    let read = observed::read_csv(&path, 1.0).unwrap();
    assert_eq!(read.len(), frames.len());
    for (a, b) in frames.iter().zip(&read) {
        assert_eq!(a.name, b.name);
        for (a, b) in a.dots.iter().zip(&b.dots) {
            assert_eq!(a.direction, b.direction);
            let (
                DotUncertainty::Tangent { covariance: a },
                DotUncertainty::Tangent { covariance: b },
            ) = (a.uncertainty, b.uncertainty)
            else {
                panic!("{a:?} {b:?}");
            };
            assert!((a - b).norm() < 1e-12 * a.norm());
        }
    }
    // Along the radius an image says least: by 1/z in the standard deviation.
    let text = "frame,x,y,z,var_radial_deg2,cov_deg2,var_across_deg2\nf,0.6,0,0.8,9,0,4\n";
    fs::write(&path, text).unwrap();
    let read = observed::read_csv(&path, 1.0).unwrap();
    let dot = read[0].dots[0];
    let DotUncertainty::Tangent { covariance } = dot.uncertainty else {
        panic!("{dot:?}");
    };
    let outward = spindoe::geometry::Vec3::new(0.8, 0.0, -0.6);
    let [a, b] = spindoe::geometry::tangent_frame(&dot.direction).map(|e| e.dot(&outward));
    let v = nalgebra::Vector2::new(a, b);
    let variance = v.dot(&(covariance * v));
    assert!((variance.sqrt().to_degrees() - 3.0).abs() < 1e-9);
}

#[test]
fn bad_files_are_refused_in_one_line() {
    let dir = workshop();
    let dots = dir.path().join("dots.csv");
    let bad: [(&[u8], &str); 16] = [
        (b"", "line 1"),
        (b"frame,x,y\n", "line 1: expected a header with z"),
        (b"frame,x,y,z,x\n", "line 1: column x occurs more than once"),
        (
            b"frame,x,y,z,cov_deg2\n",
            "line 1: expected all of var_radial_deg2",
        ),
        (b"frame,x,y,z\n", "file: expected at least one dot"),
        (b"frame,x,y,z\na,1,0\n", "line 2: expected 4 fields"),
        (
            b"frame,x,y,z\na,1,0,0\na,one,0,0\n",
            "line 3: x: expected a finite number",
        ),
        (
            b"frame,x,y,z\na,1,,0\n",
            "line 2: y: expected a number, found nothing",
        ),
        (
            b"frame,x,y,z\na,NaN,0,0\n",
            "line 2: x: expected a finite number",
        ),
        (
            b"frame,x,y,z\na,1,0.1,0\n",
            "line 2: x,y,z: expected a unit vector",
        ),
        (
            b"frame,x,y,z\na,0,0,0\n",
            "line 2: x,y,z: expected a unit vector",
        ),
        (
            b"frame,x,y,z\na,1,0,0\nb,1,0,0\na,0,1,0\n",
            "line 4: frame: expected the rows of \"a\"",
        ),
        (
            b"frame,x,y,z,sigma_deg\na,1,0,0,-1\n",
            "line 2: sigma_deg: expected a positive",
        ),
        (
            b"frame,x,y,z,var_radial_deg2,cov_deg2,var_across_deg2\na,1,0,0,1,2,1\n",
            "positive definite",
        ),
        (
            b"frame,x,y,z,time_s\na,1,0,0,1\na,0,1,0,2\n",
            "line 3: time_s: expected one time",
        ),
        (b"frame,x,y,z\na,1,0,\xff\n", "line 2"),
    ];
    for (text, expected) in bad {
        fs::write(&dots, text).unwrap();
        let arguments = [
            "identify",
            "--table",
            "table.npz",
            "dots.csv",
            "-o",
            "out.csv",
        ];
        let output = spindoe(dir.path(), &arguments);
        let words = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert_eq!(words.lines().count(), 1, "{words}");
        assert!(
            words.contains("dots.csv") && words.contains(expected),
            "{expected}: {words}"
        );
        assert!(!dir.path().join("out.csv").exists());
    }
    fs::write(&dots, "frame,x,y,z\na,1,0,0\n").unwrap();
    for (flag, value) in [
        ("--dot-sigma-deg", "0"),
        ("--config", "false_dots=-1"),
        ("--config", "miss_probability=1"),
        ("--config", "miss_probability=NaN"),
    ] {
        let arguments = ["identify", "--table", "table.npz", "dots.csv", flag, value];
        let output = spindoe(dir.path(), &arguments);
        let words = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{flag} {value}: {words}");
        let key = value.split('=').next().unwrap_or_default();
        let named = if flag == "--config" { key } else { flag };
        assert!(words.contains(named), "{flag} {value}: {words}");
    }
}

/// The files of observed dots and orientations, and a table, of `samples` views.
fn dumped(dir: &std::path::Path, protocol: &str, samples: &str, seed: &str) {
    let view = ["synth", "table.npz", "--as=dots", "--protocol", protocol];
    done(
        dir,
        &[
            &view[..],
            &["--frames", samples, "--seed", seed, "-o", "dots.csv"],
        ]
        .concat(),
    );
}

#[test]
fn an_answer_leaves_before_the_input_ends() {
    let dir = workshop();
    dumped(dir.path(), "paper", "3", "0");
    let text = fs::read_to_string(dir.path().join("dots.csv")).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(["identify", "--table", "table.npz", "-"])
        .current_dir(dir.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut answers = BufReader::new(child.stdout.take().unwrap()).lines();
    // Up to the first row of the second frame, which completes the first one.
    let second = text.find("\ntrial-1,").unwrap() + 1;
    let row = second + text[second..].find('\n').unwrap() + 1;
    input.write_all(&text.as_bytes()[..row]).unwrap();
    input.flush().unwrap();
    assert!(answers.next().unwrap().unwrap().starts_with("frame,time_s"));
    assert!(answers.next().unwrap().unwrap().starts_with("trial-0,"));
    // Only now the rest.
    input.write_all(&text.as_bytes()[row..]).unwrap();
    drop(input);
    let rest: Vec<String> = answers.map(Result::unwrap).collect();
    assert_eq!(rest.len(), 2);
    assert!(rest[1].starts_with("trial-2,"));
    assert!(child.wait().unwrap().success());
}

#[test]
fn answers_are_the_same_on_any_number_of_threads_and_from_any_input() {
    let dir = workshop();
    let views = few_or_all(400, 2500);
    dumped(dir.path(), "clutter", &views.to_string(), "0");
    // What a file's frames tell is learned in advance, a pipe's as they come: both give the same where
    // nothing is to be learned.
    for format in [&["--json"][..], &[], &["--protocol", "clutter"]] {
        let run = |threads: &str, input: &str| {
            let stdin = fs::File::open(dir.path().join("dots.csv")).unwrap();
            let output = Command::new(env!("CARGO_BIN_EXE_spindoe"))
                .args(["identify", "--table", "table.npz", input])
                .args(format)
                .env("RAYON_NUM_THREADS", threads)
                .stdin(stdin)
                .current_dir(dir.path())
                .output()
                .unwrap();
            assert!(output.status.success(), "{output:?}");
            output.stdout
        };
        let one = run("1", "dots.csv");
        assert!(one.len() > 40 * views);
        assert!(one == run("2", "dots.csv"), "two threads");
        let piped = run("1", "-");
        assert!(piped == run("7", "-"), "seven threads, standard input");
        assert_eq!(one == piped, format.contains(&"--protocol"));
    }
}

#[test]
fn an_error_far_down_leaves_no_file_and_the_rows_before_it() {
    let dir = workshop();
    dumped(dir.path(), "paper", "200", "0");
    let path = dir.path().join("dots.csv");
    let mut text = fs::read_to_string(&path).unwrap();
    let line = text.lines().count() + 1;
    text += "trial-7,1,0,0,,,,,\n";
    fs::write(&path, text).unwrap();
    let to = |flags: &[&str]| {
        let arguments = [&["identify", "--table", "table.npz", "dots.csv"], flags].concat();
        let output = spindoe(dir.path(), &arguments);
        let words = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert_eq!(words.lines().count(), 1, "{words}");
        let expected = format!("line {line}: frame: expected the rows of \"trial-7\"");
        assert!(words.contains(&expected), "{words}");
        String::from_utf8(output.stdout).unwrap()
    };
    assert_eq!(to(&["-o", "out.csv"]), "");
    assert!(!dir.path().join("out.csv").exists());
    assert_eq!(to(&["--json"]), "", "half an object is none");
    let rows = to(&[]);
    assert!(rows.lines().nth(1).unwrap().starts_with("trial-0,"));
    assert!(rows.lines().last().unwrap().starts_with("trial-19"));
}

#[test]
fn a_file_in_which_nothing_is_identified_exits_with_3() {
    let dir = workshop();
    fs::write(
        dir.path().join("few.csv"),
        "frame,x,y,z\na,1,0,0\nb,0,1,0\n",
    )
    .unwrap();
    let arguments = ["identify", "--table", "table.npz", "few.csv", "-o", "o.csv"];
    let output = spindoe(dir.path(), &arguments);
    let words = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(
        words.contains("few.csv: no frame is identified; frame a: "),
        "{words}"
    );
    let rows = fs::read_to_string(dir.path().join("o.csv")).unwrap();
    assert_eq!(rows.lines().count(), 3, "{rows}");
}

/// Whole numbers are nanoseconds where they step by 10 000 or more in the median; else they number the frames, from a pipe too.
#[test]
fn names_that_number_the_frames_are_no_times() {
    let dir = workshop();
    dumped(dir.path(), "paper", "12", "3");
    let text = fs::read_to_string(dir.path().join("dots.csv")).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap();
    let rows: Vec<(&str, &str)> = lines.map(|line| line.split_once(',').unwrap()).collect();
    let named = |step: u64, first: u64| {
        let (mut names, mut last) = (Vec::new(), "");
        for (name, _) in &rows {
            if *name != last {
                names.push(*name);
            }
            last = name;
        }
        let number = |name: &str| names.iter().position(|n| *n == name).unwrap() as u64;
        let row = |(name, rest): &(&str, &str)| format!("{},{rest}\n", first + step * number(name));
        format!("{header}\n{}", rows.iter().map(row).collect::<String>())
    };
    for (step, first, timed) in [
        (1, 0, false),
        (9_999, 70, false),
        (10_001, 0, true),
        (2_600_000, 5, true),
    ] {
        fs::write(dir.path().join("named.csv"), named(step, first)).unwrap();
        let arguments = [
            "identify",
            "--table",
            "table.npz",
            "named.csv",
            "--config=no_learning=true",
            "--min-confidence",
            "0",
        ];
        let output = spindoe(dir.path(), &arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let csv = String::from_utf8(output.stdout).unwrap();
        for (k, row) in csv.lines().skip(1).enumerate() {
            let time = row.split(',').nth(1).unwrap();
            match timed {
                true => {
                    let expected = 1e-9 * (first + step * k as u64) as f64;
                    assert!(
                        (time.parse::<f64>().unwrap() - expected).abs() < 1e-12,
                        "{row}"
                    );
                }
                false => assert_eq!(time, "", "{step}: {row}"),
            }
        }
        assert_eq!(
            said.contains("the names are frame numbers"),
            !timed,
            "{said}"
        );
        fs::write(dir.path().join("o.csv"), &csv).unwrap();
        let said = String::from_utf8(spindoe(dir.path(), &["spin", "o.csv"]).stderr).unwrap();
        assert!(timed || said.contains("--fps"), "{said}");
    }
}
