//! A training from beginning to end: resumed, as a command, and with arguments that it must reject.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Output};
use std::sync::atomic::AtomicBool;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use spindoe::vision::net::Weights;
use spindoe::vision::net::weights::Calibration;
use spindoe_train::sample::{random_frame, sample};
use spindoe_train::{Checkpoint, TrainConfig, TrainObserver, TrainStart, train};

/// Keeps the last checkpoint.
struct Keep(Option<Checkpoint>);

impl TrainObserver for Keep {
    fn checkpoint(&mut self, checkpoint: &Checkpoint) -> spindoe::Result<()> {
        self.0 = Some(checkpoint.clone());
        Ok(())
    }
}

fn short() -> TrainConfig {
    TrainConfig {
        steps: 8,
        batch: 4,
        eval_every: 4,
        eval_frames: 6,
        seed: 3,
        ..TrainConfig::default()
    }
}

#[test]
fn a_resumed_training_ends_as_one_without_a_break() {
    let stop = AtomicBool::new(false);
    let mut whole = Keep(None);
    let whole_outcome = train(&short(), TrainStart::Random, &stop, &mut whole).unwrap();
    // The rate depends on the number of steps: the same training, stopped at its first checkpoint.
    struct StopAtFirst<'a>(Keep, &'a AtomicBool);
    impl TrainObserver for StopAtFirst<'_> {
        fn checkpoint(&mut self, checkpoint: &Checkpoint) -> spindoe::Result<()> {
            self.1.store(true, std::sync::atomic::Ordering::Relaxed);
            self.0.checkpoint(checkpoint)
        }
    }
    let mut first = StopAtFirst(Keep(None), &stop);
    train(&short(), TrainStart::Random, &stop, &mut first).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("checkpoint.zip");
    first.0.0.unwrap().write(&path).unwrap();
    let from = Checkpoint::read(&path, &short()).unwrap();
    assert_eq!(from.state.step, 4);
    let mut rest = Keep(None);
    let outcome = train(
        &short(),
        TrainStart::Checkpoint(Box::new(from)),
        &AtomicBool::new(false),
        &mut rest,
    )
    .unwrap();
    // The result: the calibrated weights and their score.
    // As text: a net of eight steps finds no dot, and the median error of none is not a number.
    assert!(format!("{outcome:?}") == format!("{whole_outcome:?}"));
    assert_ne!(outcome.weights.meta.calibration, Calibration::default());
    let [whole, rest] = [whole, rest].map(|k| k.0.unwrap());
    assert_eq!(whole.state, rest.state);
    assert_eq!(whole.best, rest.best);
    assert!(whole.layers().unwrap() == rest.layers().unwrap());
    // The same seed gives the same file.
    let files = [whole, rest].map(|checkpoint| {
        let path = dir.path().join("again.zip");
        checkpoint.write(&path).unwrap();
        std::fs::read(path).unwrap()
    });
    assert!(files[0] == files[1]);
    let other = TrainConfig { seed: 4, ..short() };
    let rejected = Checkpoint::read(&path, &other).unwrap_err().to_string();
    assert!(rejected.contains("same options"), "{rejected}");
}

#[test]
fn dots_beyond_the_edge_of_the_image_are_not_asked_for() {
    let mut outside = 0;
    for seed in 0..400 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let frame = random_frame(&TrainConfig::default().synth, &mut rng).unwrap();
        let asked = sample(&frame, &mut rng).dots;
        let (width, height) = (frame.image.width() as f64, frame.image.height() as f64);
        for (dot, asked) in frame.dots.iter().zip(asked) {
            let inside = (-0.5..width - 0.5).contains(&dot.pixel.u)
                && (-0.5..height - 0.5).contains(&dot.pixel.v);
            assert!(inside || !asked.certain);
            assert_eq!(asked.certain, dot.is_visible());
            outside += usize::from(!inside && !dot.occluded && dot.facing > 0.3);
        }
    }
    assert!(outside > 0, "no such dot: the test shows nothing");
}

fn command(dir: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_spindoe-train"))
        .args(arguments.split(' '))
        .current_dir(dir)
        .output()
        .unwrap()
}

#[test]
fn the_command_trains_and_rejects_bad_arguments() {
    let dir = tempfile::tempdir().unwrap();
    let flags = "--out net --steps 2 --batch 2 --eval-every 2 --eval-frames 2";
    let trained = command(dir.path(), flags);
    let said = String::from_utf8_lossy(&trained.stderr).into_owned();
    assert!(trained.status.success(), "{said}");
    for name in ["dots.npz", "dots.onnx", "training.json", "checkpoint.zip"] {
        assert!(dir.path().join("net").join(name).exists(), "{name}");
    }
    let scored = command(dir.path(), "--score net/dots.npz --eval-frames 2 --json");
    assert!(scored.status.success());
    let scored: serde_json::Value = serde_json::from_slice(&scored.stdout).unwrap();
    let report = std::fs::read(dir.path().join("net/training.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(scored, report["score"]);
    let weights = Weights::read(&dir.path().join("net/dots.npz")).unwrap();
    assert!(
        weights
            .meta
            .command
            .starts_with("spindoe-train --head dots --seed 0 ")
    );
    for (wrong, expected) in [
        (flags, "holds a detector already"),
        ("--out other --steps 0", "steps: "),
        ("--out other --learning-rate -1", "learning_rate: "),
        ("--out missing --resume", "cannot be read"),
        ("--out other --unknown", "--unknown"),
        ("--steps 2", "--out"),
        ("--score net/dots.onnx", "dots.onnx"),
    ] {
        let rejected = command(dir.path(), wrong);
        assert_eq!(rejected.status.code(), Some(2), "{wrong}");
        let said = String::from_utf8_lossy(&rejected.stderr).into_owned();
        assert!(said.contains(expected), "{wrong}: {said}");
        assert_eq!(said.lines().count(), 1, "{wrong}: {said}");
    }
    assert!(!dir.path().join("other").exists());
}
