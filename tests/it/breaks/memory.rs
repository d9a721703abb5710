//! Too little memory: one line before the work, and nothing is left.

use std::process::Command;

#[test]
fn a_design_without_memory_is_refused_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        "design --dots 8 --config starts=2 --samples 40 --config min_separation_deg=30 --output d";
    for kib in [100_000, 200_000, 250_000, 300_000, 420_000] {
        let limit = format!("ulimit -v {kib}; exec \"$0\" \"$@\"");
        let output = Command::new("sh")
            .args(["-c", &limit, env!("CARGO_BIN_EXE_spindoe")])
            .args(arguments.split(' '))
            .current_dir(folder.path())
            .env("RAYON_NUM_THREADS", "2")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        let out = folder.path().join("d");
        if kib > 400_000 {
            assert_eq!(output.status.code(), Some(0), "{kib}: {said}");
            let left = std::fs::read_dir(out)
                .unwrap()
                .map(|e| e.unwrap().file_name());
            let mut left = left.map(|name| name.to_string_lossy().into_owned());
            assert!(!left.any(|name| name.starts_with(".spindoe-")), "{kib}");
        } else {
            assert_eq!(output.status.code(), Some(1), "{kib}: {said}");
            assert_eq!(said.trim_end().lines().count(), 1, "{kib}: {said}");
            assert!(said.contains("MiB of address space"), "{kib}: {said}");
            assert!(!out.exists(), "{kib}");
        }
    }
}

/// Every command runs under what it asks for, and is refused in one line under less, before it begins: nothing is left.
#[test]
fn every_command_says_what_memory_it_needs() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    crate::common::done(
        dir,
        &[
            "synth", "dots12", "-o", "clip", "--as", "clip", "--frames", "6",
        ],
    );
    crate::common::done(
        dir,
        &[
            "synth", "dots12", "-o", "dots.csv", "--as", "dots", "--frames", "6",
        ],
    );
    let run = |arguments: &str, mib: u64| {
        let limit = format!("ulimit -v {}; exec \"$0\" \"$@\"", mib << 10);
        Command::new("sh")
            .args(["-c", &limit, env!("CARGO_BIN_EXE_spindoe")])
            .args(arguments.split(' '))
            .current_dir(dir)
            .env("RAYON_NUM_THREADS", "2")
            .output()
            .unwrap()
    };
    for arguments in [
        "stencil dots12 -o out",
        "calibrate clip --table dots12 -o out --samples 20",
        "estimate --table dots12 clip -o out",
        "identify --table dots12 dots.csv -o out",
        "validate dots12 --samples 40",
        "synth dots12 -o out --frames 2",
        "advise dots12 --ball-px 60",
        "merge clip -o out",
        "mark dots12 --as gores -o out.pdf",
        "table dots12 -o out",
        "spin clip/orientations.csv",
    ] {
        let before = crate::common::files(dir);
        for mib in [45, 60] {
            let output = run(arguments, mib);
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{arguments}, {mib}: {said}");
            assert_eq!(said.lines().count(), 1, "{arguments}, {mib}: {said}");
            assert!(
                said.contains("MiB of address space") && said.len() < 200,
                "{arguments}: {said}"
            );
            assert_eq!(crate::common::files(dir), before, "{arguments}, {mib}");
        }
        let said = String::from_utf8(run(arguments, 45).stderr).unwrap();
        let needed = said
            .split(" needs ")
            .nth(1)
            .and_then(|rest| rest.split(' ').next());
        let needed: u64 = needed
            .and_then(|mib| mib.parse().ok())
            .unwrap_or_else(|| panic!("{said}"));
        // What takes minutes is only refused.
        if arguments.starts_with("advise") || arguments.starts_with("merge") {
            continue;
        }
        let output = run(arguments, needed);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(
            matches!(output.status.code(), Some(0 | 3)),
            "{arguments}, {needed}: {said}"
        );
        assert!(
            !crate::common::files(dir)
                .iter()
                .any(|name| name.starts_with(".spindoe-"))
        );
        for name in crate::common::files(dir)
            .iter()
            .filter(|name| !before.contains(name))
        {
            let path = dir.join(name);
            drop(std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir_all(&path)));
        }
    }
}
