//! What several test files share.

#[allow(dead_code)]
pub mod ball;
pub mod orientation_bound;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::Proportion;
use spindoe::geometry::{Vec3, random_direction};
use spindoe::pattern::Pattern;

/// Says that a test is skipped because a program that it needs is not there. With `SPINDOE_REQUIRE_ALL` set, it fails instead.
#[allow(dead_code)]
pub fn skipped(why: &str) {
    let is_required = std::env::var_os("SPINDOE_REQUIRE_ALL").is_some();
    assert!(!is_required, "SPINDOE_REQUIRE_ALL is set: {why}");
    say_skipped(why);
}

/// The same of a browser, which `SPINDOE_REQUIRE_ALL=no-browser` does not ask for.
#[allow(dead_code)]
pub fn skipped_browser(why: &str) {
    if std::env::var_os("SPINDOE_REQUIRE_ALL").is_some_and(|all| all == "no-browser") {
        return say_skipped(why);
    }
    skipped(why);
}

/// How many of a thing a test takes: at each change the few that decide, and all of them beside the slow tests
/// (`cargo test -- --include-ignored`).
#[allow(dead_code)]
pub fn few_or_all(few: usize, all: usize) -> usize {
    let is_slow = std::env::args().any(|a| a == "--include-ignored");
    if is_slow { all } else { few }
}

/// Whether ffmpeg is there; says that a test is skipped where it is not.
#[allow(dead_code)]
pub fn has_ffmpeg() -> bool {
    let is_there = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !is_there {
        skipped("ffmpeg is not installed");
    }
    is_there
}

/// Says so past the harness, which keeps what passing tests print to itself.
fn say_skipped(why: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

/// Runs the command in `dir`.
#[allow(dead_code)]
pub fn spindoe(dir: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(arguments)
        .current_dir(dir)
        .output()
        .expect("the command starts")
}

/// Runs the command, which must succeed, and returns what it printed.
#[allow(dead_code)]
pub fn done(dir: &Path, arguments: &[&str]) -> String {
    let output = spindoe(dir, arguments);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {words}");
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// A place in the published data, or `None` (said loudly) where no folder above this checkout has it.
#[allow(dead_code)]
fn published(place: &str) -> Option<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let found = root
        .ancestors()
        .skip(1)
        .map(|d| d.join("shared/data/spindoe2023").join(place))
        .find(|p| p.exists());
    if found.is_none() {
        // Data of others, which no clone has.
        say_skipped(&format!(
            "the published {place} lies in no folder above the repository"
        ));
    }
    found
}

/// The published pattern, or `None` as above.
#[allow(dead_code)]
pub fn published_pattern() -> Option<Pattern> {
    published("ref_pattern.csv").map(|path| Pattern::read_csv(&path).expect("it reads"))
}

/// The folder of the published images, or `None` as above.
#[allow(dead_code)]
pub fn published_frames() -> Option<PathBuf> {
    published("frames")
}

/// The folder of the published flights, or `None` as above.
#[allow(dead_code)]
pub fn published_trajectories() -> Option<PathBuf> {
    published("trajectories")
}

/// The shipped design of 20 dots, which every checkout has.
#[allow(dead_code)]
pub fn dots20() -> Pattern {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("designs/dots20/pattern.csv");
    Pattern::read_csv(&path).expect("it reads")
}

/// By how much two rates of the same thing differ at most: twice their Wilson 95 % half-widths in
/// quadrature, about four standard errors of the difference.
fn chance(measured: &Proportion, found: &Proportion) -> f64 {
    let half = |p: &Proportion| 0.5 * (p.high - p.low);
    2.0 * half(measured).hypot(half(found))
}

/// Asserts that a rate is not below the one that was measured, `successes` of `trials`.
#[allow(dead_code)]
pub fn assert_not_below(what: &str, found: &Proportion, (successes, trials): (u64, u64)) {
    let measured = Proportion::new(successes, trials);
    let least = measured.rate - chance(&measured, found);
    assert!(found.rate >= least, "{what}: {found}, measured {measured}");
}

/// Asserts that a rate is the one that was measured, `successes` of `trials`.
#[allow(dead_code)]
pub fn assert_as_measured(what: &str, found: &Proportion, (successes, trials): (u64, u64)) {
    let measured = Proportion::new(successes, trials);
    let off = (found.rate - measured.rate).abs();
    let is_same = off <= chance(&measured, found);
    assert!(is_same, "{what}: {found}, measured {measured}");
}

/// `n` dots at random, no two nearer than 0.3 rad where `n <= 20`.
#[allow(dead_code)]
pub fn random_pattern(n: usize, seed: u64) -> Pattern {
    spread_pattern(n, if n <= 20 { 0.3 } else { 0.1 }, seed)
}

/// The same with this angle between any two, radians.
#[allow(dead_code)]
pub fn spread_pattern(n: usize, separation_rad: f64, seed: u64) -> Pattern {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < n {
        let dot = random_direction(&mut rng);
        if dots.iter().all(|d| d.dot(&dot) < separation_rad.cos()) {
            dots.push(dot);
        }
    }
    Pattern::new(dots).expect("distinct unit vectors")
}

/// A folder with a pattern of `n` dots, pattern.csv, and its table, table.npz.
#[allow(dead_code)]
pub fn workshop(n: usize) -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    let pattern = random_pattern(n, 5);
    let csv = dir.path().join("pattern.csv");
    pattern.write_csv(&csv).expect("a file");
    done(dir.path(), &["table", "pattern.csv", "-o", "table.npz"]);
    dir
}

/// The names of a folder's files, in order.
#[allow(dead_code)]
pub fn files(dir: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(dir).expect("a folder");
    let name = |e: std::io::Result<std::fs::DirEntry>| e.expect("a file").file_name();
    let names = entries.map(|e| name(e).into_string().expect("UTF-8"));
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// Runs the command on what it must refuse: this exit code, one line with `needle`, in no time; with 2, nothing on standard
/// output and no file more or less than before.
#[allow(dead_code)]
pub fn refused(dir: &Path, arguments: &[&str], code: i32, needle: &str) {
    let before = files(dir);
    let begun = std::time::Instant::now();
    let output = spindoe(dir, arguments);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {words}");
    assert_eq!(words.lines().count(), 1, "{arguments:?}: {words}");
    assert!(words.contains(needle), "{arguments:?}: {words}");
    if code == 2 {
        assert!(output.stdout.is_empty(), "{arguments:?}");
        assert_eq!(files(dir), before, "{arguments:?}");
    }
    assert!(begun.elapsed().as_secs() < 20, "{arguments:?}");
}

/// Those of these signals that a child hears: one that this process was started to ignore (`nohup`, a shell's `&`) it ignores too.
#[cfg(unix)]
pub fn heard<'a>(signals: &[(&'a str, u32)]) -> Vec<&'a str> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    let is_heard = |(name, number): &&(&str, u32)| {
        let is_ignored = mask.unwrap_or(0) >> (number - 1) & 1 == 1;
        if is_ignored {
            eprintln!("SKIPPED: this process ignores the signal {name}");
        }
        !is_ignored
    };
    signals
        .iter()
        .filter(is_heard)
        .map(|(name, _)| *name)
        .collect()
}
