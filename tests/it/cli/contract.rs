//! The command, as a user runs it: good input gives whole files, bad input one clear line and exit 2.

use std::fs;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::{done, files};
use serde_json::Value;
use spindoe::ball::Ball;
use spindoe::geometry::Vec3;
use spindoe::pattern::Pattern;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

fn workshop() -> tempfile::TempDir {
    crate::common::workshop(12)
}

/// The archive with the last byte but one of an array's data changed.
fn tampered(npz: &[u8], array: &str) -> Vec<u8> {
    let mut archive = ZipArchive::new(Cursor::new(npz)).unwrap();
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).unwrap();
        let name = entry.name().unwrap().into_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        if name == format!("{array}.npy") {
            let last = bytes.len() - 2;
            bytes[last] ^= 0x10;
        }
        zip.start_file(name, SimpleFileOptions::default()).unwrap();
        zip.write_all(&bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// Runs the command on bad input.
fn refused(dir: &Path, arguments: &[&str], needle: &str) {
    crate::common::refused(dir, arguments, 2, needle);
}

#[test]
fn bad_patterns_are_refused_with_file_and_line() {
    let shop = workshop();
    let dir = shop.path();
    let plain = fs::read_to_string(dir.join("pattern.csv")).unwrap();
    let good = format!("x,y,z\n{plain}");
    let with_line = |line: usize, text: &str| {
        let mut lines: Vec<_> = good.lines().collect();
        lines[line - 1] = text;
        lines.join("\n")
    };
    let second_dot = good.lines().nth(2).unwrap().to_owned();
    let cases = [
        (
            String::new(),
            "bad.csv: file: expected 4 to 64 dots, found 0",
        ),
        (
            "1,0,0\n0,1,0\n0,0,1\n".into(),
            "expected 4 to 64 dots, found 3",
        ),
        (
            with_line(4, "0,NaN,1"),
            "bad.csv: line 4 (dot 2): expected three finite numbers",
        ),
        (
            with_line(4, "0,1"),
            "bad.csv: line 4: expected three numbers x,y,z, found \"0,1\"",
        ),
        (
            with_line(5, "0,0.5,0"),
            "bad.csv: line 5 (dot 3): expected a unit vector, found length 0.5",
        ),
        (
            with_line(6, &second_dot),
            "bad.csv: line 6 (dot 4): coincides with dot 1",
        ),
        (
            with_line(3, "a,b,c"),
            "bad.csv: line 3: expected three numbers",
        ),
    ];
    for (text, needle) in cases {
        fs::write(dir.join("bad.csv"), text).unwrap();
        refused(dir, &["validate", "bad.csv"], needle);
        refused(dir, &["table", "bad.csv", "-o", "never.npz"], needle);
    }
    refused(
        dir,
        &["validate", "absent.csv"],
        "absent.csv: cannot be read",
    );
}

#[test]
fn no_output_destroys_an_input() {
    let shop = workshop();
    let dir = shop.path();
    fs::create_dir(dir.join("ball")).unwrap();
    fs::copy(dir.join("pattern.csv"), dir.join("ball/pattern.csv")).unwrap();
    fs::write(dir.join("o.csv"), "frame,time_s,qw,qx,qy,qz\na,0,1,0,0,0\n").unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("o.csv", dir.join("link.csv")).unwrap();
    #[cfg(not(unix))]
    fs::copy(dir.join("o.csv"), dir.join("link.csv")).unwrap();
    fs::hard_link(dir.join("o.csv"), dir.join("hard.csv")).unwrap();
    // As `synth` leaves its frames.
    fs::create_dir_all(dir.join("frames/images")).unwrap();
    fs::write(dir.join("frames/index.csv"), "").unwrap();
    fs::write(dir.join("frames/images/1.png"), "").unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("frames/images/1.png", dir.join("frame.png")).unwrap();
    let before = |name: &str| fs::read(dir.join(name)).unwrap();
    let (pattern, orientations) = (before("pattern.csv"), before("o.csv"));
    for arguments in [
        &["table", "pattern.csv", "-o", "pattern.csv"][..],
        &["table", "ball", "-o", "ball/pattern.csv"],
        &["table", "pattern.csv", "-o", "ball/../pattern.csv"],
        &[
            "mark",
            "pattern.csv",
            "--as",
            "gores",
            "-o",
            "./pattern.csv",
        ],
        &["synth", "pattern.csv", "--as", "dots", "-o", "pattern.csv"],
        &["spin", "o.csv", "--picture", "o.csv"],
        #[cfg(unix)]
        &["spin", "o.csv", "--picture", "link.csv"],
        #[cfg(unix)]
        &["spin", "hard.csv", "--stretches", "o.csv"],
        &["identify", "--table", "pattern.csv", "o.csv", "-o", "o.csv"],
        &[
            "estimate",
            "--table",
            "pattern.csv",
            "ball",
            "-o",
            "pattern.csv",
        ],
        &[
            "estimate",
            "--table",
            "dots12",
            "frames",
            "-o",
            "frames/images/1.png",
        ],
        #[cfg(unix)]
        &["estimate", "--table", "dots12", "frames", "-o", "frame.png"],
        &[
            "synth", "ball", "-o", "ball", "--as", "images", "--frames", "1",
        ],
        &[
            "calibrate",
            "frames",
            "--table",
            "ball/pattern.csv",
            "-o",
            "ball",
            "--overwrite",
        ],
    ] {
        refused(dir, arguments, "which is read");
    }
    for arguments in [
        &[
            "estimate",
            "--table",
            "pattern.csv",
            "ball",
            "-o",
            "x",
            "--report",
            "x",
        ][..],
        &[
            "estimate",
            "--table",
            "pattern.csv",
            "ball",
            "--overlay",
            "r",
            "--report",
            "./r",
        ],
        &[
            "spin",
            "o.csv",
            "--stretches",
            "s.csv",
            "--windows",
            "s.csv",
        ],
    ] {
        refused(dir, arguments, "expected another file than");
    }
    assert_eq!(
        (before("pattern.csv"), before("o.csv")),
        (pattern, orientations)
    );
}

/// A device without an end, in place of each file that is read whole.
#[test]
#[cfg(unix)]
fn of_an_endless_file_no_more_is_read_than_its_format_has() {
    let shop = workshop();
    let dir = shop.path();
    let zero = "/dev/zero";
    fs::write(dir.join("dots.csv"), "frame,x,y,z\na,0,0,1\n").unwrap();
    for (arguments, most) in [
        (vec!["table", zero, "-o", "t.npz"], "16 MiB"),
        (vec!["stencil", zero, "-o", "s"], "16 MiB"),
        (vec!["mark", zero, "--as", "gores", "-o", "m.svg"], "16 MiB"),
        (vec!["validate", zero], "16 MiB"),
        (vec!["identify", "--table", zero, "dots.csv"], "16 MiB"),
        (vec!["advise", "--camera", zero], "1 MiB"),
        (
            vec!["synth", "pattern.csv", "--preset", zero, "--output", "s"],
            "1 MiB",
        ),
        (
            vec!["identify", "--table", "table.npz", zero],
            "65536 bytes",
        ),
        (vec!["spin", zero], "65536 bytes"),
    ] {
        refused(dir, &arguments, &format!("at most {most}"));
    }
    let image = ["estimate", "--table", "table.npz", zero, "-o", "o.csv"];
    refused(dir, &image, "found none of them");
}

#[test]
fn headers_must_say_x_y_z_and_windows_line_ends_keep_the_count() {
    let shop = workshop();
    let dir = shop.path();
    let good = fs::read_to_string(dir.join("pattern.csv")).unwrap();
    // Written as published, without a header: every line is a dot.
    let numbers = good
        .lines()
        .all(|l| l.split(',').all(|x| x.parse::<f64>().is_ok()));
    assert!(numbers, "{good}");
    fs::write(dir.join("swapped.csv"), format!("y,x,z\n{good}")).unwrap();
    refused(
        dir,
        &["validate", "swapped.csv"],
        "swapped.csv: line 1: expected three numbers",
    );
    let windows = format!("x,y,z\n{good}").replace('\n', "\r\n");
    fs::write(dir.join("windows.csv"), &windows).unwrap();
    done(dir, &["table", "windows.csv", "-o", "w.npz"]);
    let mut lines: Vec<_> = windows.split("\r\n").collect();
    lines[4] = "0,0,oops";
    fs::write(dir.join("windows.csv"), lines.join("\r\n")).unwrap();
    refused(
        dir,
        &["validate", "windows.csv"],
        "windows.csv: line 5: expected three numbers",
    );
}

#[test]
fn a_folder_that_holds_a_design_is_not_written_over() {
    let shop = workshop();
    refused(
        shop.path(),
        &["design", "--output", "."],
        "holds a design already (pattern.csv)",
    );
}

#[test]
fn patterns_of_many_dots_are_compared() {
    let shop = workshop();
    let dir = shop.path();
    let pattern = crate::common::random_pattern(64, 5);
    pattern.write_csv(&dir.join("many.csv")).unwrap();
    let words = done(
        dir,
        &["validate", "pattern.csv", "many.csv", "--samples", "20"],
    );
    assert!(words.contains("many (64 dots"), "{words}");
}

#[test]
fn a_reader_that_stops_early_ends_the_command_quietly() {
    let shop = workshop();
    let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(["validate", "pattern.csv", "table.npz", "--samples", "2000"])
        .current_dir(shop.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    assert!(!words.contains("panicked"), "{words}");
}

#[test]
fn a_symmetric_pattern_has_tied_poses() {
    let dir = tempfile::tempdir().unwrap();
    let s = 1.0 / 3f64.sqrt();
    let cube: String = (0..8)
        .map(|k| {
            let c = |bit: usize| if k >> bit & 1 == 0 { s } else { -s };
            format!("{},{},{}\n", c(0), c(1), c(2))
        })
        .collect();
    fs::write(dir.path().join("cube.csv"), cube).unwrap();
    // A face of the cube, seen square on.
    let dots = [[s, s], [s, -s], [-s, s], [-s, -s]].map(|[x, y]| format!("a,{x},{y},{s}\n"));
    fs::write(
        dir.path().join("dots.csv"),
        format!("frame,x,y,z\n{}", dots.concat()),
    )
    .unwrap();
    let any = ["identify", "--table", "cube.csv", "dots.csv", "--json"];
    let json = done(dir.path(), &[&any[..], &["--min-confidence", "0"]].concat());
    let found: Value = serde_json::from_str(&json).unwrap();
    let frame = &found["frames"][0];
    // The cube turns into itself in 24 ways.
    assert!(frame["confidence"].as_f64().unwrap() < 0.06, "{frame}");
    assert!(frame["rivals"].as_array().unwrap().len() >= 23, "{frame}");
    let arguments = [
        "identify",
        "--table",
        "cube.csv",
        "dots.csv",
        "--min-confidence",
        "0.5",
    ];
    let output = crate::common::spindoe(dir.path(), &arguments);
    let csv = String::from_utf8(output.stdout).unwrap();
    assert!(csv.lines().nth(1).unwrap().starts_with("a,,,,,"), "{csv}");
    // Nothing is identified, which has an exit code of its own.
    let words = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(
        words.contains("1 answers are below --min-confidence"),
        "{words}"
    );
}

#[test]
fn bad_tables_are_refused_with_file_and_array() {
    let shop = workshop();
    let dir = shop.path();
    let good = fs::read(dir.join("table.npz")).unwrap();
    fs::write(dir.join("short.npz"), &good[..good.len() / 2]).unwrap();
    refused(dir, &["validate", "short.npz"], "short.npz: ");
    for array in ["features", "dots"] {
        fs::write(dir.join("changed.npz"), tampered(&good, array)).unwrap();
        let needle = format!("changed.npz: {array}");
        refused(dir, &["validate", "changed.npz"], &needle);
    }
    fs::write(dir.join("text.npz"), "x,y,z\n").unwrap();
    refused(dir, &["validate", "text.npz"], "text.npz: ");
}

#[test]
fn bad_arguments_are_refused_by_name() {
    let shop = workshop();
    let dir = shop.path();
    refused(dir, &["stencl"], "similar subcommand exists: 'stencil'");
    refused(
        dir,
        &["validate", "dots20", "--sample", "3"],
        "similar argument exists: '--samples'",
    );
    let validate = |rest: &[&'static str], needle: &str| {
        let arguments = [&["validate", "pattern.csv"], rest].concat();
        refused(dir, &arguments, needle);
    };
    validate(&["--samples", "0"], "samples: expected at least 1 trial");
    validate(
        &["--config", "sigma_deg=-1"],
        "sigma_deg: expected 0 to 180, found -1",
    );
    validate(
        &["--config", "sigma_deg=NaN"],
        "sigma_deg: expected 0 to 180, found NaN",
    );
    validate(
        &["--samples", "many"],
        "invalid value 'many' for '--samples <N>'",
    );
    validate(
        &["--protocol", "easy"],
        "[possible values: paper, sparse, clutter, image]",
    );
    validate(&["--sample", "3"], "unexpected argument '--sample'");
    refused(dir, &["validate"], "<PATTERN>");
    for (rest, needle) in [
        (["--dots", "3"], "dots: expected 4 to 64, found 3"),
        (
            ["--config", "starts=0"],
            "starts: expected 1 to 1000000, found 0",
        ),
        (["--samples", "0"], "samples: expected at least 1"),
        (
            ["--config", "min_separation_deg=70"],
            "expected 0 to 49.0 degrees",
        ),
        (
            ["--config", "min_separation_deg=NaN"],
            "expected 0 to 180, found NaN",
        ),
        (
            ["--config", "min_visible=11"],
            "expected at most 10 of 20 dots",
        ),
        (["--dot-diameter-mm", "-1"], "diameter"),
        (
            ["--dot-diameter-mm", "18"],
            "must be 55.5 degrees apart on a ball of 40 mm",
        ),
        (
            ["--config", "seam_margin_deg=-1"],
            "expected 0 to 60, found -1",
        ),
        (
            ["--keep-out", "0,0,0,10"],
            "expected an axis that is not zero",
        ),
        (
            ["--keep-out", "0,0,1,95"],
            "expected a half angle of 0 to 90",
        ),
        (["--dot-diameter-mm", "16"], "holes of at most 15.3 mm fit"),
        (
            ["--config", "basis_weight=-1"],
            "expected 0 to 1000000000, found -1",
        ),
        (
            ["--config", "bound_goal=0.6"],
            "expected two positive numbers MEAN,WORST",
        ),
        (["--budget", "soon"], "'soon' for '--budget"),
        (["absent.csv", "-q"], "absent.csv: cannot be read"),
        (
            ["--output", "pattern.csv"],
            "pattern.csv: cannot be written",
        ),
        (
            ["--output", "/proc/spindoe"],
            "/proc/spindoe: cannot be written",
        ),
    ] {
        refused(dir, &["design", rest[0], rest[1]], needle);
    }
    refused(
        dir,
        &["table", "pattern.csv", "-o", "no/such/folder/t.npz"],
        "no/such/folder/t.npz: cannot be written",
    );
    refused(
        dir,
        &[
            "table",
            "pattern.csv",
            "-o",
            "t.npz",
            "--config",
            "min_cross=2",
        ],
        "min_cross: expected a number in (0, 1), found 2",
    );
}

#[test]
fn validate_prints_the_agreed_json_and_repeats_itself() {
    let shop = workshop();
    let dir = shop.path();
    for recognizer in ["voting", "robust"] {
        let run = |input: &str| -> Value {
            let named = format!("recognizer={recognizer}");
            let arguments = [
                "validate",
                input,
                "--json",
                "--samples",
                "200",
                "--seed",
                "3",
                "--protocol",
                "clutter",
                "--config",
                &named,
            ];
            serde_json::from_str(&done(dir, &arguments)).unwrap()
        };
        let mut found = run("pattern.csv");
        assert_eq!(found["protocol"], "clutter");
        assert_eq!(found["recognizer"], recognizer);
        assert_eq!(found["samples"], 200);
        assert_eq!(found["seed"], 3);
        assert!((found["sigma_deg"].as_f64().unwrap() - 5.0).abs() < 1e-9);
        for success in ["identity", "orientation"] {
            let rate = found[success]["rate"].as_f64().unwrap();
            let trials = found[success]["trials"].as_u64().unwrap();
            let successes = found[success]["successes"].as_u64().unwrap();
            assert_eq!(trials + found["skipped"].as_u64().unwrap(), 200);
            assert!((rate - successes as f64 / trials as f64).abs() < 1e-12);
            assert!(found[success]["low"].as_f64().unwrap() <= rate);
            assert!(found[success]["high"].as_f64().unwrap() >= rate);
        }
        // The rate that comes first is of all views.
        assert_eq!(found["answered"]["trials"], 200);
        assert_eq!(
            found["answered"]["successes"],
            found["orientation"]["successes"]
        );
        assert!(found["us_per_identification"].as_f64().unwrap() > 0.0);
        assert!(found["median_error_deg"].as_f64().unwrap() > 0.0);
        // The table leads to the same trials and answers as the pattern that it was made from.
        let mut again = run("table.npz");
        for v in [&mut found, &mut again] {
            v.as_object_mut()
                .unwrap()
                .remove("median_us_per_identification");
            v.as_object_mut().unwrap().remove("us_per_identification");
        }
        assert_eq!(found, again);
    }
}

#[test]
fn a_design_leaves_a_whole_folder_and_repeats_itself() {
    let dir = tempfile::tempdir().unwrap();
    let run = |out: &str, threads: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args(["design", "--dots", "10", "--config", "starts=5"])
            .args([
                "--samples",
                "100",
                "--seed",
                "1",
                "--pictures",
                "png,svg",
                "--output",
                out,
            ])
            .env("RAYON_NUM_THREADS", threads)
            .current_dir(dir.path())
            .output()
            .unwrap();
        let words = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{words}");
        assert!(String::from_utf8_lossy(&output.stdout).ends_with(&format!("{out}\n")));
    };
    run("one", "1");
    run("two", "3");
    let (one, two) = (dir.path().join("one"), dir.path().join("two"));
    assert_eq!(files(&one), files(&two));
    for needed in [
        "pattern.csv",
        "table.npz",
        "report.json",
        "report.html",
        "pattern.png",
        "pattern.svg",
        "progress.png",
        "stencil",
    ] {
        assert!(files(&one).iter().any(|f| f == needed), "{needed}");
    }
    let same = |name: &str| {
        let [a, b] = [&one, &two].map(|d| fs::read(d.join(name)).unwrap());
        assert!(a == b, "{name} differs");
    };
    for name in files(&one) {
        // These hold clock times; a folder is compared below.
        let timed = ["timing.json", "search.json", "stencil"];
        if !timed.contains(&name.as_str()) {
            same(&name);
        }
    }
    for name in ["half_a.stl", "half_b.stl", "stencil.3mf"] {
        same(&format!("stencil/{name}"));
    }
    let a: Value = serde_json::from_slice(&fs::read(one.join("report.json")).unwrap()).unwrap();
    // Ours in each protocol, the paper's in its own.
    assert_eq!(a["validation"].as_array().unwrap().len(), 5);
    assert_eq!(a["stopped"], false);
    assert_eq!(a["format_version"], 6);
    // No seed serves two ends.
    let names = ["search", "selection", "progress", "report"];
    let mut seeds = names.map(|k| a["seeds"][k].as_u64().unwrap()).to_vec();
    seeds.sort_unstable();
    seeds.dedup();
    assert_eq!(seeds.len(), names.len());
}

#[cfg(unix)]
#[test]
fn an_interrupt_finishes_with_the_best_so_far() {
    let Some(signal) = crate::common::heard(&[("-INT", 2)]).pop() else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args([
            "design",
            "--dots",
            "8",
            "--config",
            "starts=2",
            "--config",
            "rounds=100000",
        ])
        .args(["--samples", "20", "--output", "d"])
        .current_dir(dir.path())
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut words = std::io::BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    // Not before there is something to keep.
    while !line.contains("best ") {
        line.clear();
        let read = std::io::BufRead::read_line(&mut words, &mut line).unwrap();
        assert!(read > 0, "the search ended by itself");
    }
    let killed = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status()
        .unwrap();
    assert!(killed.success());
    words.read_to_string(&mut line).unwrap();
    assert!(child.wait().unwrap().success(), "{line}");
    let report = fs::read(dir.path().join("d/report.json")).unwrap();
    let report: Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(report["stopped"], true);
    assert!(report["starts"].as_u64().unwrap() < 200_000);
    assert!(dir.path().join("d/stencil/half_a.stl").exists());
}

#[test]
fn the_reported_command_repeats_a_design_from_an_awkward_path() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("o'clock & more");
    fs::create_dir(&folder).unwrap();
    crate::common::random_pattern(8, 3)
        .write_csv(&folder.join("my ball.csv"))
        .unwrap();
    let few = [
        "--config",
        "starts=1",
        "--samples",
        "20",
        "--config",
        "climb_steps=3",
    ];
    let from = ["design", "o'clock & more/my ball.csv", "--output", "a"];
    crate::common::done(dir.path(), &[&from[..], &few[..]].concat());
    let report: Value =
        serde_json::from_slice(&fs::read(dir.path().join("a/report.json")).unwrap()).unwrap();
    let command = report["command"].as_str().unwrap();
    assert!(command.contains("--config climb_steps=3"), "{command}");
    // As a user would paste it.
    let exe = env!("CARGO_BIN_EXE_spindoe");
    let pasted = format!(
        "'{exe}'{} --output b",
        command.strip_prefix("spindoe").unwrap()
    );
    let shell = Command::new("sh")
        .args(["-c", &pasted])
        .current_dir(dir.path())
        .output()
        .unwrap();
    assert!(
        shell.status.success(),
        "{}",
        String::from_utf8_lossy(&shell.stderr)
    );
    let read = |out: &str| fs::read(dir.path().join(out).join("pattern.csv")).unwrap();
    assert_eq!(read("a"), read("b"));
}

#[test]
fn the_reported_command_repeats_a_design_with_keep_out_cones_and_resumes_it() {
    let dir = tempfile::tempdir().unwrap();
    let few = [
        "design",
        "--dots",
        "8",
        "--config",
        "starts=2",
        "--samples",
        "20",
        "--config",
        "min_visible=0",
        "--config",
        "seam_margin_deg=0",
        "--ball-diameter-mm",
        "41.5",
        "--dot-diameter-mm",
        "5.2",
    ];
    // An axis whose bits change when it is normalized twice, and an angle whose bits change on the way to
    // radians and back.
    let cone = ["--keep-out", "0.3,-0.7,1.9,25.7"];
    let axis = Vec3::new(0.3, -0.7, 1.9).normalize();
    assert!(axis.normalize() != axis || 25.7f64.to_radians().to_degrees() != 25.7);
    done(
        dir.path(),
        &[&few[..], &cone[..], &["--output", "a"]].concat(),
    );
    let report: Value =
        serde_json::from_slice(&fs::read(dir.path().join("a/report.json")).unwrap()).unwrap();
    let command = report["command"].as_str().unwrap();
    assert!(
        command.contains("--keep-out 0.3,-0.7,1.9,25.7"),
        "{command}"
    );
    let words: Vec<&str> = command.split(' ').skip(1).collect();
    done(dir.path(), &[&words[..], &["--output", "b"]].concat());
    let read = |out: &str| fs::read(dir.path().join(out).join("pattern.csv")).unwrap();
    assert_eq!(read("a"), read("b"));
    // What it was designed for stands beside the pattern, in the table and in the report.
    let sidecar: Value =
        serde_json::from_slice(&fs::read(dir.path().join("a/pattern.ball.json")).unwrap()).unwrap();
    assert_eq!(sidecar["design"], report["design"]);
    assert_eq!(sidecar["design"]["dot_diameter_mm"], 5.2);
    assert_eq!(sidecar["design"]["ball_diameter_mm"], 41.5);
    assert_eq!(sidecar["keep_out"].as_array().unwrap().len(), 1);
    let table = Ball::read_npz(&dir.path().join("a/table.npz")).unwrap();
    assert_eq!(
        serde_json::to_value(table.design()).unwrap(),
        report["design"]
    );
    let drawing = fs::read(dir.path().join("a/stencil/drawing.pdf")).unwrap();
    assert!(drawing.starts_with(b"%PDF"));
    assert_eq!(
        drawing,
        fs::read(dir.path().join("b/stencil/drawing.pdf")).unwrap()
    );
    // The same command continues what the first one left.
    done(
        dir.path(),
        &[&words[..], &["--output", "a", "--resume"]].concat(),
    );
    assert_eq!(read("a"), read("b"));
}

#[test]
fn the_shipped_tables_load() {
    let designs = Path::new(env!("CARGO_MANIFEST_DIR")).join("designs");
    let mut tables = 0;
    for entry in fs::read_dir(designs).unwrap() {
        let dir = entry.unwrap().path();
        if dir.is_dir() {
            let table = Ball::read_npz(&dir.join("table.npz")).unwrap();
            let pattern = Pattern::read_csv(&dir.join("pattern.csv")).unwrap();
            assert_eq!(table.pattern(), &pattern, "{}", dir.display());
            tables += 1;
        }
    }
    assert!(tables >= 6, "{tables}");
}
