//! `spindoe train` and `spindoe export`: the dot detector made, and given to other programs.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use super::output::stop_on_interrupt;
use super::print_json;
use crate::error::{Error, Result};
use crate::files;
use crate::vision::net::{Weights, onnx};
use crate::vision::train::{Checkpoint, TrainConfig, TrainObserver, TrainProgress, Trained, train};

/// The checkpoint within the folder.
const CHECKPOINT: &str = "checkpoint.zip";
/// The weights within the folder.
const WEIGHTS: &str = "dots.npz";
/// Plain lines come no more often than this, seconds.
const SILENCE_S: f64 = 10.0;

#[derive(Debug, Args)]
#[command(after_help = "\
Frames are drawn by the synthetic ball spinner while the net learns. The folder then holds dots.npz (the
weights, for `spindoe estimate --weights`), dots.onnx and training.json; while training goes on, checkpoint.zip.

Ctrl-C ends the training and keeps the best weights so far; --resume goes on from the last checkpoint.

Examples:
  spindoe train --out my-detector
  spindoe train --out my-detector --steps 40000 --resume")]
pub struct Arguments {
    /// The folder to write to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seed of the first weights and of all frames.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Steps of the optimizer.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().steps)]
    steps: u64,
    /// Patches a step.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().batch)]
    batch: usize,
    /// Highest learning rate.
    #[arg(long, value_name = "RATE", default_value_t = TrainConfig::default().learning_rate, allow_negative_numbers = true)]
    learning_rate: f64,
    /// Steps between judgements on frames of another seed; each leaves a checkpoint.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().judge_every)]
    judge_every: u64,
    /// Frames of a judgement.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().judge_frames)]
    judge_frames: usize,
    /// Judgements without a better net after which training ends.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().patience)]
    patience: usize,
    /// Go on from the checkpoint in --out.
    #[arg(long)]
    resume: bool,
    /// Print the outcome as one JSON object on standard output.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn config(&self) -> TrainConfig {
        TrainConfig {
            seed: self.seed,
            steps: self.steps,
            batch: self.batch,
            learning_rate: self.learning_rate,
            judge_every: self.judge_every,
            judge_frames: self.judge_frames,
            patience: self.patience,
            ..TrainConfig::default()
        }
    }

    /// The command that repeats this training, whatever the defaults of other versions.
    fn command(&self) -> String {
        format!(
            "spindoe train --seed {} --steps {} --batch {} --learning-rate {} --judge-every {} \
             --judge-frames {} --patience {}",
            self.seed,
            self.steps,
            self.batch,
            self.learning_rate,
            self.judge_every,
            self.judge_frames,
            self.patience
        )
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let config = arguments.config();
    config.check()?;
    let dir = &arguments.out;
    let path = dir.join(CHECKPOINT);
    let from = if arguments.resume {
        Some(Checkpoint::read(&path, &config)?)
    } else {
        refuse_taken(dir)?;
        None
    };
    files::create_writable_dir(dir)?;
    let stop = stop_on_interrupt()?;
    let clock = Instant::now();
    let mut progress = Progress::new(&config, path);
    let mut trained = train(&config, from, &stop, &mut progress)?;
    progress.bar.finish_and_clear();
    trained.weights.meta.command = arguments.command();
    let outcome = write(dir, &config, &trained, clock.elapsed().as_secs_f64())?;
    if arguments.json {
        return print_json(&outcome);
    }
    let score = &trained.score;
    outln!(
        "{} steps; of {} dots on {} frames {:.2} % found, {:.3} false a frame, median error {:.2} % of the radius",
        trained.steps,
        score.dots,
        score.frames,
        100.0 * score.recall(),
        score.false_peaks as f64 / score.frames as f64,
        100.0 * score.median_error / crate::vision::patch::RADIUS,
    );
    outln!("{}", dir.display());
    Ok(())
}

fn write(
    dir: &Path,
    config: &TrainConfig,
    trained: &Trained,
    seconds: f64,
) -> Result<serde_json::Value> {
    trained.weights.write(&dir.join(WEIGHTS))?;
    files::write_bytes(&dir.join("dots.onnx"), &onnx::to_onnx(&trained.weights))?;
    let outcome = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "command": trained.weights.meta.command,
        "config": config,
        "steps": trained.steps,
        "frames": trained.weights.meta.frames,
        "calibration": trained.weights.meta.calibration,
        "score_at_one_half": trained.score,
        "recall": trained.score.recall(),
        "precision": trained.score.precision(),
        "seconds": seconds,
    });
    let text = serde_json::to_vec_pretty(&outcome)
        .map_err(|e| Error::Internal(format!("cannot be written as JSON: {e}")))?;
    files::write_bytes(&dir.join("training.json"), &text)?;
    Ok(outcome)
}

/// Refuses a folder that holds a detector already: two must not mix in one.
fn refuse_taken(dir: &Path) -> Result<()> {
    for name in [WEIGHTS, CHECKPOINT] {
        if dir.join(name).exists() {
            let problem = format!(
                "{} holds a detector already ({name}); choose another folder, or --resume it",
                dir.display()
            );
            return Err(Error::argument("out", problem));
        }
    }
    Ok(())
}

/// Shows a training: a bar on a terminal, plain lines elsewhere; and keeps it on disk.
struct Progress {
    bar: ProgressBar,
    checkpoint: PathBuf,
    began: Instant,
    said: Instant,
    first: Option<u64>,
    batch: usize,
}

impl Progress {
    fn new(config: &TrainConfig, checkpoint: PathBuf) -> Self {
        let bar = ProgressBar::new(config.steps);
        // The template is a constant; were it wrong, the default style would do.
        if let Ok(style) =
            ProgressStyle::with_template("{bar:25} {elapsed} gone, {eta} left  {msg}")
        {
            bar.set_style(style);
        }
        Self {
            bar,
            checkpoint,
            began: Instant::now(),
            said: Instant::now(),
            first: None,
            batch: config.batch,
        }
    }
}

impl TrainObserver for Progress {
    fn progress(&mut self, progress: &TrainProgress) -> Result<()> {
        let first = *self.first.get_or_insert(progress.step);
        let samples = (progress.step - first) * self.batch as u64;
        let rate = samples as f64 / self.began.elapsed().as_secs_f64();
        let judged = progress.score.map_or(String::new(), |s| {
            format!(
                "; judged: {:.2} % of the dots found, {:.2} % of the finds right",
                100.0 * s.recall(),
                100.0 * s.precision()
            )
        });
        let what = format!(
            "step {}: heat loss {:.3}, position loss {:.3}, {rate:.0} patches/s{judged}",
            progress.step, progress.heat_loss, progress.position_loss,
        );
        self.bar.set_position(progress.step);
        if !self.bar.is_hidden() {
            self.bar.set_message(what);
        } else if self.said.elapsed().as_secs_f64() > SILENCE_S {
            errln!("{what}");
            self.said = Instant::now();
        }
        Ok(())
    }

    fn checkpoint(&mut self, checkpoint: &Checkpoint) -> Result<()> {
        checkpoint.write(&self.checkpoint)
    }
}

#[derive(Debug, Args)]
pub struct ExportArguments {
    /// Where to write the net, ONNX.
    #[arg(short, long, value_name = "FILE.onnx")]
    out: PathBuf,
    /// Weights made by `spindoe train`; by default those built in.
    #[arg(long, value_name = "WEIGHTS.npz")]
    weights: Option<PathBuf>,
}

pub fn export(arguments: &ExportArguments) -> Result<()> {
    let weights = match &arguments.weights {
        Some(path) => Weights::read(path)?,
        None => Weights::built_in()?,
    };
    files::write_bytes(&arguments.out, &onnx::to_onnx(&weights))?;
    outln!("{}", arguments.out.display());
    Ok(())
}
