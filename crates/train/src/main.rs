//! `spindoe-train`: trains the nets of `spindoe`.
//!
//! Exit codes: 0 done; 2 unusable arguments or input, with one line that names the problem; 1
//! anything else.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use spindoe::vision::net::graph::Head;
use spindoe::vision::net::{Weights, onnx};
use spindoe::{Error, Result, files};
use spindoe_train::{
    Checkpoint, TrainConfig, TrainObserver, TrainProgress, TrainStart, Trained, test, train,
};

/// The checkpoint within the folder.
const CHECKPOINT: &str = "checkpoint.zip";
/// Minimum time between plain lines, seconds.
const MIN_LINE_INTERVAL_S: f64 = 10.0;

/// Trains the nets for dots, or that for outlines, on synthetic frames.
#[derive(Debug, Parser)]
#[command(
    version,
    max_term_width = 100,
    after_help = "\
Frames are drawn by the synthetic ball spinner while the net learns. The folder then holds the
weights (dots.npz, for `spindoe estimate --weights`; named by --head), the same as .onnx, and training.json; while training goes on, checkpoint.zip.

Ctrl-C ends the training and keeps the best weights so far; --resume goes on from the last checkpoint.

Examples:
  spindoe-train --out my-detector
  spindoe-train --out my-detector --steps 40000 --resume"
)]
struct Arguments {
    /// The folder to write to.
    #[arg(long, value_name = "DIR", required_unless_present = "score")]
    out: Option<PathBuf>,
    /// Train nothing; score these weights on the test set.
    #[arg(long, value_name = "WEIGHTS.npz", conflicts_with_all = ["out", "resume"])]
    score: Option<PathBuf>,
    /// What the net is for: dots, dots-large (those that the net for dots leaves in doubt) or outline.
    #[arg(long, value_name = "NAME", default_value = "dots")]
    head: Head,
    /// Seed of the initial weights and of all frames.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Steps of the optimizer.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().steps)]
    steps: u64,
    /// Patches per step.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().batch)]
    batch: usize,
    /// Highest learning rate.
    #[arg(long, value_name = "RATE", default_value_t = TrainConfig::default().learning_rate, allow_negative_numbers = true)]
    learning_rate: f64,
    /// Steps between evaluations on frames of other seeds; each leaves a checkpoint.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().eval_every)]
    eval_every: u64,
    /// Frames of each of the three sets: one selects the best weights, one calibrates, one gives
    /// the reported score.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().eval_frames)]
    eval_frames: usize,
    /// Evaluations without a better net after which training ends.
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().patience)]
    patience: usize,
    /// Begin with these weights instead of random ones.
    #[arg(long, value_name = "WEIGHTS.npz", conflicts_with_all = ["resume", "score"])]
    from: Option<PathBuf>,
    /// Continue from the checkpoint in --out.
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
            eval_every: self.eval_every,
            eval_frames: self.eval_frames,
            patience: self.patience,
            ..TrainConfig::of(self.head)
        }
    }

    /// The command that reproduces this training, independent of other versions' defaults.
    fn command(&self) -> String {
        let from = self
            .from
            .as_ref()
            .map_or_else(String::new, |path| format!(" --from {}", path.display()));
        format!(
            "spindoe-train --head {} --seed {} --steps {} --batch {} --learning-rate {} --eval-every {} \
             --eval-frames {} --patience {}{from}",
            self.head.as_str(),
            self.seed,
            self.steps,
            self.batch,
            self.learning_rate,
            self.eval_every,
            self.eval_frames,
            self.patience
        )
    }
}

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() => {
            // The first paragraph is the error itself; usage and tips follow.
            let text = error.to_string();
            let first = text.split("\n\n").next().unwrap_or_default();
            let line = first.split_whitespace().collect::<Vec<_>>().join(" ");
            let line = line.strip_prefix("error: ").unwrap_or(&line);
            return fail(&format!("{line} (see --help)"), 2);
        }
        Err(help) => help.exit(),
    };
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => fail(&error.to_string(), if error.is_usage() { 2 } else { 1 }),
    }
}

fn fail(problem: &str, code: u8) -> ExitCode {
    // A failed write is ignored: the exit code carries the result.
    let _ = writeln!(std::io::stderr(), "spindoe-train: {problem}");
    ExitCode::from(code)
}

fn run(arguments: &Arguments) -> Result<()> {
    let config = arguments.config();
    config.check()?;
    if let Some(path) = &arguments.score {
        let score = test(&config, &Weights::read(path)?)?;
        let words = if arguments.json {
            json!(score).to_string()
        } else {
            score.to_string()
        };
        return print(&words);
    }
    let Some(dir) = &arguments.out else {
        return Err(Error::argument("--out", "expected a folder"));
    };
    let path = dir.join(CHECKPOINT);
    if !arguments.resume {
        reject_taken(dir)?;
    }
    let start = match &arguments.from {
        _ if arguments.resume => {
            TrainStart::Checkpoint(Box::new(Checkpoint::read(&path, &config)?))
        }
        Some(weights) => TrainStart::Weights(Box::new(Weights::read(weights)?)),
        None => TrainStart::Random,
    };
    files::create_writable_dir(dir)?;
    let stop = stop_on_interrupt()?;
    let clock = Instant::now();
    let mut progress = Progress::new(&config, path);
    let mut trained = train(&config, start, &stop, &mut progress)?;
    progress.bar.finish_and_clear();
    trained.weights.meta.command = arguments.command();
    let outcome = write(dir, &config, &trained, clock.elapsed().as_secs_f64())?;
    if arguments.json {
        return print(&outcome.to_string());
    }
    print(&format!(
        "{} steps; {}\n{}",
        trained.steps,
        trained.score,
        dir.display()
    ))
}

fn print(words: &str) -> Result<()> {
    writeln!(std::io::stdout(), "{words}").map_err(|e| Error::write("standard output", e))
}

fn write(
    dir: &Path,
    config: &TrainConfig,
    trained: &Trained,
    seconds: f64,
) -> Result<serde_json::Value> {
    let name = config.head.as_str();
    trained.weights.write(&dir.join(format!("{name}.npz")))?;
    let onnx = onnx::to_onnx(&trained.weights);
    files::write_bytes(&dir.join(format!("{name}.onnx")), &onnx)?;
    let outcome = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "command": trained.weights.meta.command,
        "config": config,
        "steps": trained.steps,
        "frames": trained.weights.meta.frames,
        "calibration": trained.weights.meta.calibration,
        "score": trained.score,
        "seconds": seconds,
    });
    let text = serde_json::to_vec_pretty(&outcome)
        .map_err(|e| Error::Internal(format!("cannot be written as JSON: {e}")))?;
    files::write_bytes(&dir.join("training.json"), &text)?;
    Ok(outcome)
}

/// Rejects a folder that holds a detector already: two must not mix in one.
fn reject_taken(dir: &Path) -> Result<()> {
    let nets = Head::ALL.map(|head| format!("{}.npz", head.as_str()));
    for name in nets.iter().map(String::as_str).chain([CHECKPOINT]) {
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

/// Shows the progress of a training (a bar on a terminal, plain lines elsewhere) and saves it on
/// disk.
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
        // The template is a constant; with a wrong one the default style is used.
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
        let evaluated = progress
            .score
            .map_or(String::new(), |s| format!("; evaluated: {s}"));
        let what = format!(
            "step {}: heat loss {:.3}, position loss {:.3}, {rate:.0} patches/s{evaluated}",
            progress.step, progress.heat_loss, progress.position_loss,
        );
        self.bar.set_position(progress.step);
        if !self.bar.is_hidden() {
            self.bar.set_message(what);
        } else if self.said.elapsed().as_secs_f64() > MIN_LINE_INTERVAL_S {
            // A failed write loses nothing that is not in the files.
            let _ = writeln!(std::io::stderr(), "{what}");
            self.said = Instant::now();
        }
        Ok(())
    }

    fn checkpoint(&mut self, checkpoint: &Checkpoint) -> Result<()> {
        checkpoint.write(&self.checkpoint)
    }
}

/// A flag that is set by Ctrl-C; the second Ctrl-C ends the process.
fn stop_on_interrupt() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .map_err(|e| Error::Internal(format!("Ctrl-C cannot be caught: {e}")))?;
    Ok(stop)
}
