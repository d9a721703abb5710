//! Input without an end: each format has a size that it cannot exceed, and no more is read.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Instant;

/// Most address space of the command, KiB: all limits of the formats fit, an endless input does not.
const MAX_MEMORY_KIB: u32 = 1 << 21;

/// Runs the command with `/dev/zero` as its standard input, in bounded memory.
fn bounded(dir: &Path, arguments: &[&str]) -> Output {
    let zeros = std::fs::File::open("/dev/zero").unwrap();
    let limit = format!("ulimit -v {MAX_MEMORY_KIB}; exec \"$0\" \"$@\"");
    Command::new("sh")
        .args(["-c", &limit, env!("CARGO_BIN_EXE_spindoe")])
        .args(arguments)
        .current_dir(dir)
        .stdin(Stdio::from(zeros))
        .output()
        .unwrap()
}

#[cfg(all(target_os = "linux", feature = "vision"))]
#[test]
fn endless_inputs_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    super::pattern()
        .write_csv(&dir.path().join("p.csv"))
        .unwrap();
    image::RgbImage::new(40, 40)
        .save(dir.path().join("1.png"))
        .unwrap();
    for arguments in [
        "table /dev/zero -o t.npz",
        "validate /dev/zero",
        "validate p.csv --camera /dev/zero",
        "advise --camera /dev/zero",
        "compare /dev/zero p.csv",
        "sensitivity /dev/zero -o s",
        "identify --table /dev/zero -",
        "identify --table p.csv /dev/zero",
        "identify --table p.csv -",
        "estimate --table /dev/zero 1.png",
        "estimate --table p.csv /dev/zero",
        "estimate --table p.csv 1.png --times /dev/zero",
        "estimate --table p.csv 1.png --circles /dev/zero",
        "estimate --table p.csv 1.png --weights /dev/zero",
        "estimate --table p.csv --follow -",
        "calibrate --table p.csv /dev/zero --out c",
        "stencil /dev/zero --out s",
        "spin /dev/zero",
        "spin -",
        "synth /dev/zero --out s",
        "synth p.csv --config /dev/zero --out s",
        "merge /dev/zero --out m",
        "design --from /dev/zero --out d",
        "design --camera /dev/zero --out d",
    ] {
        let begun = Instant::now();
        let words: Vec<&str> = arguments.split(' ').collect();
        let output = bounded(dir.path(), &words);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{arguments}: {said}");
        assert!(begun.elapsed() < super::PATIENCE, "{arguments}");
    }
    // Nothing half-written, and no folder for it.
    let left = std::fs::read_dir(dir.path()).unwrap().count();
    assert_eq!(left, 2);
}
