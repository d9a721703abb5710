//! Signals at random times: a folder holds all of a set or nothing of it, and no temporary file
//! outlives the next run.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Names in a folder, sorted; of a folder that does not exist, none.
fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).into_iter().flatten();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// Names that users see, and those of temporary files.
fn seen_and_temporary(dir: &Path) -> (Vec<String>, Vec<String>) {
    let (hidden, seen): (Vec<_>, Vec<_>) = names(dir).into_iter().partition(|n| n.starts_with('.'));
    let temporary = hidden.into_iter().filter(|n| n.starts_with(".spindoe-"));
    (seen, temporary.collect())
}

/// A command that writes the folder `out`.
struct Case {
    arguments: Vec<String>,
    /// Overwrites what is there; other commands refuse.
    overwrites: bool,
}

/// Sends signals to the command, each to a run of its own after a random part of the time that a
/// whole run takes.
fn interrupt(dir: &Path, case: &Case, runs: u64) {
    let arguments: Vec<&str> = case.arguments.iter().map(String::as_str).collect();
    let out = dir.join("out");
    let begun = Instant::now();
    crate::common::done(dir, &arguments);
    let took = begun.elapsed();
    let whole = names(&out);
    let mut rng = ChaCha8Rng::seed_from_u64(super::setting("SPINDOE_BREAKS_SEED", 1));
    for run in 0..runs {
        let signal = ["-TERM", "-KILL"][run as usize % 2];
        let wait = took.mul_f64(rng.random_range(0.0..1.1));
        let context = format!("{arguments:?}, {signal} after {wait:?}");
        if !case.overwrites || run % 3 == 0 {
            fs::remove_dir_all(&out).unwrap();
        }
        let before = names(&out);
        let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args(&arguments)
            .current_dir(dir)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(wait);
        // The signal comes too late where the command has ended.
        let id = child.id().to_string();
        Command::new("kill").args([signal, &id]).output().unwrap();
        let status = child.wait().unwrap();
        let (seen, temporary) = seen_and_temporary(&out);
        if signal == "-TERM" {
            // Before the handler is set, a signal ends the process as ever.
            let expected = [Some(0), Some(143), None];
            assert!(expected.contains(&status.code()), "{context}: {status}");
            assert!(temporary.is_empty(), "{context}: {temporary:?}");
            let is_one = seen == whole || seen == before || seen.is_empty();
            assert!(is_one, "{context}: {seen:?}");
        }
        let again = crate::common::spindoe(dir, &arguments);
        let words = String::from_utf8_lossy(&again.stderr).into_owned();
        if again.status.success() {
            assert_eq!(names(&out), whole, "{context}");
        } else {
            assert!(words.contains("already"), "{context}: {words}");
            assert_eq!(names(&out), whole, "{context}: {words}");
        }
    }
}

fn case(arguments: &str, overwrites: bool) -> Case {
    Case {
        arguments: arguments.split(' ').map(str::to_owned).collect(),
        overwrites,
    }
}

/// Runs for each command; `SPINDOE_SIGNALS=200` sends more.
fn runs() -> u64 {
    super::setting("SPINDOE_SIGNALS", 2)
}

#[cfg(unix)]
#[test]
fn a_stencil_is_whole_or_absent() {
    let dir = tempfile::tempdir().unwrap();
    super::pattern()
        .write_csv(&dir.path().join("p.csv"))
        .unwrap();
    let case = case("stencil p.csv --output out --overwrite", true);
    interrupt(dir.path(), &case, runs());
}

#[cfg(unix)]
#[test]
fn comparisons_and_manuals_are_whole_or_absent() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = super::pattern();
    pattern.write_csv(&dir.path().join("p.csv")).unwrap();
    crate::common::random_pattern(9, 3)
        .write_csv(&dir.path().join("q.csv"))
        .unwrap();
    let compare = case("validate p.csv q.csv --samples 20 --output out", true);
    interrupt(dir.path(), &compare, runs());
    fs::remove_dir_all(dir.path().join("out")).unwrap();
    interrupt(dir.path(), &case("man --output out", true), runs());
    fs::remove_dir_all(dir.path().join("out")).unwrap();
}

#[cfg(all(unix, feature = "vision"))]
#[test]
fn calibrations_and_overlays_are_whole_or_absent() {
    let dir = tempfile::tempdir().unwrap();
    super::pattern()
        .write_csv(&dir.path().join("p.csv"))
        .unwrap();
    let synth = "synth p.csv --output clip --frames 24 --seed 9 --preset good --fps 60 --rps 3 --config size_px=80";
    crate::common::done(dir.path(), &synth.split(' ').collect::<Vec<_>>());
    let calibrate = "calibrate --table p.csv clip/images --samples 0 --output out";
    interrupt(dir.path(), &case(calibrate, false), runs());
    fs::remove_dir_all(dir.path().join("out")).unwrap();
    #[cfg(feature = "plot")]
    {
        let overlay = "estimate --table p.csv clip/images --overlay out";
        interrupt(dir.path(), &case(overlay, true), runs());
    }
}

#[cfg(all(unix, feature = "vision"))]
#[test]
fn frames_are_whole_or_absent() {
    let dir = tempfile::tempdir().unwrap();
    super::pattern()
        .write_csv(&dir.path().join("p.csv"))
        .unwrap();
    let synth = case(
        "synth p.csv --as images --output out --frames 40 --config masks=true",
        false,
    );
    interrupt(dir.path(), &synth, runs());
    fs::remove_dir_all(dir.path().join("out")).unwrap();
    interrupt(
        dir.path(),
        &case("synth --output out --frames 20", false),
        runs(),
    );
}

#[cfg(all(unix, feature = "vision"))]
#[test]
fn estimates_leave_no_temporary_files() {
    let dir = tempfile::tempdir().unwrap();
    crate::common::done(dir.path(), &["synth", "--output", "s", "--frames", "40"]);
    fs::create_dir(dir.path().join("out")).unwrap();
    let estimate = case("estimate --table s/table.npz s/images -o out/o.csv", true);
    let arguments: Vec<&str> = estimate.arguments.iter().map(String::as_str).collect();
    let begun = Instant::now();
    crate::common::done(dir.path(), &arguments);
    let took = begun.elapsed();
    for run in 0..runs() {
        let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args(&arguments)
            .current_dir(dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(took.mul_f64(0.1 + 0.2 * run as f64 % 0.9));
        let signal = ["-TERM", "-KILL"][run as usize % 2];
        let id = child.id().to_string();
        Command::new("kill").args([signal, &id]).output().unwrap();
        child.wait().unwrap();
        if signal == "-KILL" {
            crate::common::done(dir.path(), &arguments);
        }
        assert_eq!(names(&dir.path().join("out")), ["o.csv"], "{signal}");
    }
}

/// A kill between the moves: what was begun is ended by the next run that writes to the folder.
#[test]
fn moves_that_a_kill_interrupts_are_ended() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("old"), "old").unwrap();
    fs::write(at("first"), "new").unwrap();
    fs::write(at("second"), "old").unwrap();
    let aside = at(".spindoe-killed");
    fs::create_dir(&aside).unwrap();
    for (name, text) in [("second", "new"), (".alive", ""), (".whole", "old")] {
        fs::write(aside.join(name), text).unwrap();
    }
    // One that was not whole, and a file.
    fs::create_dir(at(".spindoe-half")).unwrap();
    fs::write(at(".spindoe-half/first"), "half").unwrap();
    fs::write(at(".spindoe-file"), "half").unwrap();
    // One whose maker is alive.
    let alive = fs::File::create(at(".spindoe-alive")).unwrap();
    alive.lock().unwrap();
    let set = spindoe::files::Replacement::begin(dir.path()).unwrap();
    fs::write(set.path().join("third"), "new").unwrap();
    set.publish(&[], "third").unwrap();
    assert_eq!(
        names(dir.path()),
        [".spindoe-alive", "first", "second", "third"]
    );
    assert_eq!(fs::read_to_string(at("second")).unwrap(), "new");
}

/// The longest that a stopped design may go on.
const FINISHING: Duration = Duration::from_secs(60);

/// Kills a search that writes the folder `out` after each part of its time: the next run says so, and one with
/// `--resume` ends with the same files.
#[cfg(unix)]
fn killed_goes_on(dir: &Path, arguments: &str) {
    let arguments: Vec<&str> = arguments.split(' ').collect();
    let begun = Instant::now();
    crate::common::done(dir, &arguments);
    let took = begun.elapsed().min(FINISHING);
    let out = dir.join("out");
    let whole = names(&out);
    let runs = super::setting("SPINDOE_SIGNALS", crate::common::few_or_all(1, 2) as u64);
    for run in 1..=runs {
        fs::remove_dir_all(&out).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
            .args(&arguments)
            .current_dir(dir)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(took.mul_f64(run as f64 / (runs + 1) as f64));
        child.kill().unwrap();
        child.wait().unwrap();
        if out.join("search.json").exists() && !out.join("report.json").exists() {
            let again = crate::common::spindoe(dir, &arguments);
            let words = String::from_utf8_lossy(&again.stderr).into_owned();
            assert_eq!(again.status.code(), Some(2), "{words}");
            assert!(
                words.contains("holds an incomplete design already (search.json)"),
                "{words}"
            );
            assert!(words.contains("--resume it"), "{words}");
        }
        // Without a checkpoint it begins again, but for a run that had ended when it was to be killed: on a busy machine the first one, by
        // which the moment is chosen, may take longer.
        let has_checkpoint = out.join("search.json").exists();
        if has_checkpoint || !out.join("report.json").exists() {
            let more: &[&str] = if has_checkpoint { &["--resume"] } else { &[] };
            crate::common::done(dir, &[&arguments[..], more].concat());
        }
        assert_eq!(names(&out), whole, "killed after {run} parts");
    }
}

#[cfg(unix)]
#[test]
fn a_design_that_is_killed_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let design = "design --dots 8 --config starts=2 --samples 40 --seed 3 --config min_separation_deg=30 --protocol sparse --output out";
    killed_goes_on(dir.path(), design);
}

#[cfg(unix)]
#[test]
fn a_merge_that_is_killed_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let shard = "design --dots 8 --config starts=2 --samples 40 --config min_separation_deg=30 --protocol sparse --output shard --shard 1/1";
    crate::common::done(dir.path(), &shard.split(' ').collect::<Vec<_>>());
    killed_goes_on(dir.path(), "merge shard --output out");
}
