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
