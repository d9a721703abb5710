//! A search in shards: merged, they give what one process gives that runs them all.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;
use spindoe::design::Shard;

use crate::common::{done, few_or_all, spindoe};

/// Few and short rounds.
const SMALL: [&str; 16] = [
    "--dots",
    "12",
    "--config",
    "starts=4",
    "--config",
    "rounds=2",
    "--config",
    "scout_steps=1",
    "--config",
    "climb_steps=1",
    "--samples",
    "60",
    "--seed",
    "9",
    // Its objective takes no trials.
    "--protocol",
    "sparse",
];

fn design(dir: &Path, flags: &[&str]) -> String {
    done(dir, &[&["design"], &SMALL[..], flags].concat())
}

fn report(dir: &Path) -> Value {
    let text = fs::read_to_string(dir.join("report.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

#[test]
fn merged_shards_are_one_run_of_them_all() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let count = few_or_all(3, 8);
    let shards = format!("shards={count}");
    design(dir, &["--config", &shards, "--output", "whole"]);
    // On machines, in any order; one of them is stopped in the middle and taken up again.
    let numbers = [5, 2, 8, 1, 7, 3, 6, 4].into_iter();
    for k in numbers.filter(|k| *k <= count) {
        let (shard, out) = (format!("{k}/{count}"), format!("part-{k}"));
        let flags = ["--shard", &shard, "--output", &out];
        if k == 3 {
            kill_in_the_middle(dir, &flags, &dir.join(&out).join("search.json"));
            design(dir, &[&flags[..], &["--resume"]].concat());
        } else {
            design(dir, &flags);
        }
    }
    let parts: Vec<String> = (1..=count).map(|k| format!("part-{k}")).collect();
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    done(
        dir,
        &[&["merge"], &parts[..], &["--output", "merged"]].concat(),
    );
    let (whole, merged) = (dir.join("whole"), dir.join("merged"));
    for file in [
        "pattern.csv",
        "table.npz",
        "sensitivity.csv",
        "stencil/half_a.stl",
        "stencil/stencil.3mf",
    ] {
        let bytes = |at: &Path| fs::read(at.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert!(bytes(&whole) == bytes(&merged), "{file}");
    }
    let report = report(&whole);
    assert_eq!(report, self::report(&merged));
    assert_eq!(report["starts"], count * 2 * 4);
    let command = report["command"].as_str().unwrap();
    assert!(command.contains(&format!("--config {shards}")), "{command}");
    // The finalists met on the same trials, which none of the shards had drawn.
    let finalists = report["finalists"].as_array().unwrap();
    assert!(finalists.len() > count, "{}", finalists.len());
}

#[test]
fn a_merge_that_was_killed_is_continued() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let flags = |out| ["--config", "shards=2", "--output", out];
    design(dir, &flags("whole"));
    // In the last trial, where the shards have ended.
    let command = [&["design"], &SMALL[..], &flags("killed")].concat();
    kill_once_there(dir, &command, &dir.join("killed/search.json"));
    assert!(!dir.join("killed/report.json").exists(), "it was done");
    let out = spindoe(dir, &command);
    assert_eq!(out.status.code(), Some(2), "without --resume");
    done(dir, &[&command[..], &["--resume"]].concat());
    // The merge alone, first where none has begun.
    let parts = ["killed/shards/1", "killed/shards/2"];
    let merge = |out| [&["merge"], &parts[..], &["--output", out]].concat();
    kill_once_there(dir, &merge("merged"), &dir.join("merged/search.json"));
    done(dir, &[&merge("merged")[..], &["--resume"]].concat());
    done(dir, &[&merge("fresh")[..], &["--resume"]].concat());
    for out in ["killed", "merged", "fresh"] {
        for file in ["pattern.csv", "table.npz", "stencil/half_a.stl"] {
            let [a, b] =
                ["whole", out].map(|folder| fs::read(dir.join(folder).join(file)).unwrap());
            assert!(a == b, "{out}/{file}");
        }
        assert_eq!(report(&dir.join("whole")), report(&dir.join(out)), "{out}");
    }
    // A folder with the search of one piece, or of other shards, is no merge of these.
    let other = ["--config", "shards=3", "--output", "other"];
    let other = [&["design"], &SMALL[..], &other].concat();
    kill_once_there(dir, &other, &dir.join("other/search.json"));
    let out = spindoe(dir, &[&merge("other")[..], &["--resume"]].concat());
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(said.contains("other/search.json"), "{said}");
}

#[test]
fn a_merge_ranks_for_the_camera_of_its_shards() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // An objective for which no frames are rendered.
    let camera = "--camera dark --config camera_frames=16 --config objective=mean-nn";
    let camera: Vec<&str> = camera.split(' ').collect();
    let flags = |more: &[&'static str]| [&camera[..], more].concat();
    design(dir, &flags(&["--config", "shards=2", "--output", "whole"]));
    design(dir, &flags(&["--shard", "1/2", "--output", "a"]));
    design(dir, &flags(&["--shard", "2/2", "--output", "b"]));
    design(dir, &["--shard", "2/2", "--output", "no-camera"]);
    done(dir, &["merge", "b", "a", "--output", "merged"]);
    let merged = report(&dir.join("merged"));
    assert_eq!(report(&dir.join("whole")), merged);
    let ranked = merged["camera"]["finalists"].as_array().unwrap();
    assert_eq!(
        ranked.len(),
        merged["finalists"].as_array().unwrap().len(),
        "{ranked:?}"
    );
    // What is reported is not what ranked: half of the frames are others.
    let frames = |rank: &Value| rank["right"]["trials"].as_u64();
    assert!(
        ranked.iter().all(|rank| frames(rank) == Some(8)),
        "{ranked:?}"
    );
    let output = spindoe(dir, &["merge", "a", "no-camera", "--output", "m"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("other arguments"), "{said}");
}

/// Runs a shard, and kills it once its first checkpoint is there.
fn kill_in_the_middle(dir: &Path, flags: &[&str], checkpoint: &Path) {
    kill_once_there(dir, &[&["design"], &SMALL[..], flags].concat(), checkpoint);
    let file: Value = serde_json::from_slice(&fs::read(checkpoint).unwrap()).unwrap();
    assert!(file["state"]["round"].as_u64().unwrap() < 2, "it was done");
}

/// Runs the command, and kills it once the file is there.
fn kill_once_there(dir: &Path, command: &[&str], file: &Path) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(command)
        .current_dir(dir)
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    while !file.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn shards_that_do_not_belong_together_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for (shard, out) in [("1/2", "a"), ("2/2", "b"), ("2/3", "c")] {
        design(dir, &["--shard", shard, "--output", out]);
    }
    done(
        dir,
        &[
            "design",
            "--dots",
            "12",
            "--config",
            "starts=2",
            "--config",
            "scout_steps=1",
            "--config",
            "climb_steps=1",
            "--samples",
            "60",
            "--shard",
            "2/2",
            "--output",
            "other",
        ],
    );
    fs::create_dir(dir.join("unfinished")).unwrap();
    let text = fs::read_to_string(dir.join("b/search.json")).unwrap();
    let unfinished = text.replace("\"round\":2", "\"round\":1");
    assert_ne!(text, unfinished);
    fs::write(dir.join("unfinished/search.json"), unfinished).unwrap();
    for (shards, words) in [
        (&["a"][..], "shard 2/2 is missing"),
        (&["a", "a"], "also in"),
        (&["a", "c"], "expected one of 2 shards"),
        (&["a", "other"], "other arguments"),
        (&["a", "unfinished"], "1 of 2 rounds"),
        (&["a", "none"], "cannot be read"),
    ] {
        let output = spindoe(dir, &[&["merge"], shards, &["--output", "m"]].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{shards:?}: {said}");
        assert!(said.contains(words), "{shards:?}: {said}");
        assert!(!dir.join("m").exists());
    }
    // Neither continues the other's checkpoint, nor a whole search a shard's.
    for flags in [
        &["--shard", "2/2", "--output", "a", "--resume"][..],
        &["--output", "a", "--resume"],
        &["--shard", "1/2", "--output", "a"],
        &["--shard", "3/2", "--output", "x"],
        &["--shard", "1/2"],
        &["--config", "shards=0", "--output", "x"],
    ] {
        let output = spindoe(dir, &[&["design"], &SMALL[..], flags].concat());
        assert_eq!(output.status.code(), Some(2), "{flags:?}");
    }
}

#[test]
fn shards_have_seeds_of_their_own() {
    let config = spindoe::DesignConfig::default();
    let seeds: Vec<u64> = Shard::all(4)
        .unwrap()
        .iter()
        .map(|shard| shard.config(&config).seed)
        .collect();
    assert_eq!(seeds, [0, 1, 2, 3].map(|k| config.seed + k));
    assert_eq!("3/8".parse::<Shard>().unwrap().to_string(), "3/8");
    for text in ["0/8", "9/8", "3", "3/0", "a/b", "1/10001"] {
        assert!(text.parse::<Shard>().is_err(), "{text}");
    }
}
