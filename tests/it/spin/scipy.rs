//! The spin of a simulated file against SciPy's rotations and least squares.

use std::path::Path;
use std::process::Command;

#[test]
fn scipy_finds_the_same_spin_in_the_same_file() {
    let probe = Command::new("python3")
        .args(["-c", "import scipy.optimize, scipy.spatial.transform"])
        .output();
    if !probe.is_ok_and(|p| p.status.success()) {
        crate::common::skipped("python3 with SciPy is not installed");
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/check_spin.py");
    let dir = tempfile::tempdir().unwrap();
    let (csv, json) = (dir.path().join("o.csv"), dir.path().join("spin.json"));
    let spins = [("1", "18"), ("3", "160"), ("2", "90")];
    for (seed, rps) in spins.into_iter().take(crate::common::few_or_all(2, 3)) {
        let spindoe = || Command::new(env!("CARGO_BIN_EXE_spindoe"));
        let flags = ["--config", "outliers=0", "--seed", seed, "--rps", rps];
        let made = spindoe()
            .args(["synth", "--as=orientations", "-o"])
            .arg(&csv)
            .args(flags)
            .output();
        assert!(made.unwrap().status.success());
        let found = spindoe()
            .arg("spin")
            .arg(&csv)
            .arg("--json")
            .output()
            .unwrap();
        std::fs::write(&json, found.stdout).unwrap();
        let checked = Command::new("python3")
            .arg(&script)
            .arg(&csv)
            .arg(&json)
            .output()
            .unwrap();
        let (said, complaint) = (
            String::from_utf8_lossy(&checked.stdout),
            String::from_utf8_lossy(&checked.stderr),
        );
        assert!(checked.status.success(), "{said}{complaint}");
        assert!(said.contains("agree"), "{said}");
    }
}
