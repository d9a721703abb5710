//! What a user relies on: nothing invented is answered, nothing is lost or mixed, nothing hangs.

use std::fs;
use std::time::{Duration, Instant};

use serde_json::Value;
use spindoe::files::FolderLock;

use crate::common::{done, refused, spindoe};

fn workshop() -> tempfile::TempDir {
    crate::common::workshop(20)
}

#[test]
fn a_file_tells_its_own_conditions() {
    let dir = workshop();
    for (protocol, limit, missed, false_dots) in
        [("sparse", 0.33, 0.4, 0), ("clutter", 0.0, 0.2, 2)]
    {
        let view = ["table.npz", "--protocol", protocol, "--seed", "8"];
        let validate = [&["validate"], &view[..], &["--samples", "150", "--json"]].concat();
        let told: Value = serde_json::from_str(&done(dir.path(), &validate)).unwrap();
        let dots = ["--as=dots", "--frames", "150", "-o", "dots.csv"];
        done(dir.path(), &[&["synth"], &view[..], &dots].concat());
        let identify = ["identify", "--table", "table.npz", "dots.csv", "--json"];
        let found: Value = serde_json::from_str(&done(dir.path(), &identify)).unwrap();
        let conditions = &found["conditions"];
        let number = |name: &str| conditions[name].as_f64().unwrap();
        assert!(
            (number("visibility_limit") - limit).abs() < 0.06,
            "{conditions}"
        );
        assert!(
            (number("detection_probability") - (1.0 - missed)).abs() < 0.12,
            "{conditions}"
        );
        assert_eq!(conditions["usual_false_dots"], false_dots, "{conditions}");
        // As many as with the protocol stated, but for a few.
        let frames = found["frames"].as_array().unwrap();
        let answered = frames
            .iter()
            .filter(|f| f["confidence"].is_number())
            .count();
        let successes = told["orientation"]["successes"].as_u64().unwrap() as usize;
        assert!(answered + 8 >= successes, "{answered} of {successes}");
    }
}

#[test]
fn three_invented_dots_are_no_answer() {
    let dir = workshop();
    let text = "frame,x,y,z\na,0,0,1\na,0.6,0,0.8\na,0,0.8,0.6\n";
    fs::write(dir.path().join("dots.csv"), text).unwrap();
    let identify = [
        "identify",
        "--table",
        "table.npz",
        "dots.csv",
        "-o",
        "o.csv",
    ];
    let output = spindoe(dir.path(), &identify);
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(words.contains("no frame is identified"), "{words}");
    let rows = fs::read_to_string(dir.path().join("o.csv")).unwrap();
    assert!(rows.lines().nth(1).unwrap().starts_with("a,,,,,"), "{rows}");
}

#[test]
fn what_made_it_panic_abort_or_hang_is_refused_at_once() {
    let dir = workshop();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    let many = "18446744073709551615";
    for more in [&[][..], &["--sweep=noise", "--output", "o"], &["table.npz"]] {
        let usual = ["validate", "pattern.csv", "--samples", many];
        let arguments = [&usual[..], more].concat();
        refused(dir.path(), &arguments, 2, "samples: expected at most");
    }
    // An ellipse a hundred-million-million-million times as long as wide.
    let columns = "var_radial_deg2,cov_deg2,var_across_deg2";
    let dot = |d: &str| format!("a,{d},0.717,0,1e-40\n");
    let dots: String = ["0,0,1", "0.6,0,0.8", "0,0.8,0.6", "0,0.6,0.8"]
        .map(dot)
        .concat();
    write("thin.csv", &format!("frame,x,y,z,{columns}\n{dots}"));
    let identify = [
        "identify",
        "--table",
        "table.npz",
        "thin.csv",
        "-o",
        "o.csv",
    ];
    let output = spindoe(dir.path(), &identify);
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    let row = |t: &str| format!("{t},1,0,0,0\n");
    let text: String = ["0", "1e-320", "2e-320", "0.1"].map(row).concat();
    write("close.csv", &format!("time_s,qw,qx,qy,qz\n{text}"));
    refused(dir.path(), &["spin", "close.csv"], 2, "expected at least");
    let text: String = ["0", "0.1", "0.2", "0.3"].map(row).concat();
    write("good.csv", &format!("time_s,qw,qx,qy,qz\n{text}"));
    let noisy = [
        "spin",
        "good.csv",
        "--config=orientation_sigma_deg=4294967296",
    ];
    refused(dir.path(), &noisy, 2, "orientation_sigma_deg: expected");
}

#[test]
fn errors_are_one_line_whatever_they_quote() {
    let dir = workshop();
    let text = "frame,x,y,z\n\"a\nb\",1,0,0\nc,1,0,0\n\"a\nb\",0,1,0\n";
    fs::write(dir.path().join("dots.csv"), text).unwrap();
    let identify = [
        "identify",
        "--table",
        "table.npz",
        "dots.csv",
        "-o",
        "o.csv",
    ];
    refused(dir.path(), &identify, 2, "to stand together");
    refused(
        dir.path(),
        &["validate", "no\nsuch.csv"],
        2,
        "cannot be read",
    );
    refused(
        dir.path(),
        &["validate", "pattern.csv", "--protocol", "a\nb"],
        2,
        "protocol",
    );
}

#[test]
fn what_cannot_be_written_is_known_before_the_work() {
    let dir = workshop();
    for arguments in [
        &[
            "identify",
            "--table",
            "table.npz",
            "dots.csv",
            "-o",
            "nosuch/o.csv",
        ][..],
        #[cfg(feature = "vision")]
        &[
            "estimate",
            "--table",
            "table.npz",
            "in.png",
            "-o",
            "nosuch/o.csv",
        ],
    ] {
        // The inputs are readable, so that it is the output that fails.
        fs::write(dir.path().join("dots.csv"), "frame,x,y,z\na,1,0,0\n").unwrap();
        fs::write(dir.path().join("in.png"), "no image").unwrap();
        refused(dir.path(), arguments, 2, "nosuch/o.csv: cannot be written");
    }
}

#[cfg(unix)]
#[test]
fn links_and_pipes_are_written_through() {
    let dir = workshop();
    let at = |name: &str| dir.path().join(name);
    fs::create_dir(at("real")).unwrap();
    fs::write(at("real/table.npz"), "old").unwrap();
    std::os::unix::fs::symlink("real/table.npz", at("link.npz")).unwrap();
    std::os::unix::fs::symlink("real/new.npz", at("dangling.npz")).unwrap();
    for (link, target) in [
        ("link.npz", "real/table.npz"),
        ("dangling.npz", "real/new.npz"),
    ] {
        done(dir.path(), &["table", "pattern.csv", "-o", link]);
        assert!(
            fs::symlink_metadata(at(link)).unwrap().is_symlink(),
            "{link}"
        );
        let written = fs::read(at(target)).unwrap();
        assert_eq!(written, fs::read(at("table.npz")).unwrap(), "{target}");
    }
    std::os::unix::fs::symlink("round.npz", at("round.npz")).unwrap();
    refused(
        dir.path(),
        &["table", "pattern.csv", "-o", "round.npz"],
        2,
        "too many links",
    );
    refused(
        dir.path(),
        &["table", "pattern.csv", "-o", "real"],
        2,
        "real: cannot be written",
    );
    // A named pipe stays one, and its reader gets the bytes.
    let made = std::process::Command::new("mkfifo")
        .arg(at("pipe.npz"))
        .status();
    if !made.is_ok_and(|m| m.success()) {
        crate::common::skipped("mkfifo is not installed");
        return;
    }
    let pipe = at("pipe.npz");
    let reader = std::thread::spawn(move || fs::read(pipe).unwrap());
    done(dir.path(), &["table", "pattern.csv", "-o", "pipe.npz"]);
    assert_eq!(reader.join().unwrap(), fs::read(at("table.npz")).unwrap());
    assert!(!fs::symlink_metadata(at("pipe.npz")).unwrap().is_file());
}

/// A design of a second or two.
const QUICK: [&str; 15] = [
    "design",
    "--dots",
    "8",
    "--config",
    "starts=2",
    "--samples",
    "40",
    "--seed",
    "3",
    "--config",
    "min_separation_deg=30",
    "--config",
    "min_visible=1",
    // Its objective takes no trials.
    "--protocol",
    "sparse",
];

#[test]
fn a_folder_holds_one_result_at_a_time() {
    let dir = workshop();
    let out = dir.path().join("d");
    {
        let _lock = FolderLock::take(&out).unwrap();
        let arguments = [&QUICK[..], &["--output", "d"]].concat();
        refused(dir.path(), &arguments, 2, "another run works in d");
    }
    done(dir.path(), &[&QUICK[..], &["--output", "d"]].concat());
    let whole = ["pattern.csv", "table.npz", "report.json", "stencil"];
    assert!(whole.iter().all(|name| out.join(name).exists()));
    let strays = fs::read_dir(&out).unwrap().filter(|e| {
        let name = e
            .as_ref()
            .unwrap()
            .file_name()
            .to_string_lossy()
            .into_owned();
        name.starts_with(".spindoe-")
    });
    assert_eq!(strays.count(), 0);
    // What another pattern left behind goes when the results of this search come.
    fs::write(out.join("pattern.csv"), "1,0,0\n").unwrap();
    fs::write(out.join("stencil/of_another.stl"), "").unwrap();
    fs::write(out.join("added.png"), "").unwrap();
    done(
        dir.path(),
        &[
            &QUICK[..],
            &["--output", "d", "--resume", "--config", "rounds=2"],
        ]
        .concat(),
    );
    assert!(whole.iter().all(|name| out.join(name).exists()));
    assert!(!out.join("stencil/of_another.stl").exists());
    assert!(!out.join("added.png").exists());
}

#[test]
fn an_edited_search_is_refused() {
    let dir = workshop();
    done(dir.path(), &[&QUICK[..], &["--output", "d"]].concat());
    let path = dir.path().join("d/search.json");
    let good: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let resume = [
        &QUICK[..],
        &["--output", "d", "--resume", "--config", "rounds=2"],
    ]
    .concat();
    let edit = |change: &dyn Fn(&mut Vec<Value>), needle: &str| {
        let mut edited = good.clone();
        change(edited["state"]["pool"][0]["dots"].as_array_mut().unwrap());
        fs::write(&path, edited.to_string()).unwrap();
        refused(dir.path(), &resume, 2, needle);
    };
    edit(&|dots| drop(dots.pop()), "pool 0: expected 8 dots, found 7");
    let near = serde_json::json!([0.0, 5f64.to_radians().sin(), 5f64.to_radians().cos()]);
    let close = |dots: &mut Vec<Value>| {
        dots[0] = serde_json::json!([0.0, 0.0, 1.0]);
        dots[1] = near.clone();
    };
    edit(
        &close,
        "pool 0: expected dots at least 30.00 deg apart, found",
    );
    edit(
        &|dots| dots[0] = serde_json::json!([2.0, 0.0, 0.0]),
        "pool 0: ",
    );
}

#[cfg(unix)]
#[test]
fn a_request_to_end_finishes_with_the_best_so_far() {
    for signal in crate::common::heard(&[("-TERM", 15), ("-HUP", 1)]) {
        let dir = workshop();
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args([&QUICK[..9], &["--config", "rounds=100000", "--output", "d"]].concat())
            .current_dir(dir.path())
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        let begun = Instant::now();
        let has_pattern = || {
            let state = fs::read(dir.path().join("d/search.json")).ok();
            let state: Value =
                serde_json::from_slice(&state.unwrap_or_default()).unwrap_or_default();
            state["state"]["pool"]
                .as_array()
                .is_some_and(|all| !all.is_empty())
        };
        while !has_pattern() {
            assert!(begun.elapsed() < Duration::from_secs(120), "no pattern yet");
            std::thread::sleep(Duration::from_millis(50));
        }
        let id = child.id().to_string();
        let sent = std::process::Command::new("kill")
            .args([signal, &id])
            .status()
            .unwrap();
        assert!(sent.success());
        assert!(child.wait().unwrap().success(), "{signal}");
        assert!(dir.path().join("d/report.json").exists(), "{signal}");
    }
}
