//! What does a frame cost that is answered, and one that is not?
//!
//! Crops in all and in good conditions, each alone; CPU time of the one thread, under several limits of the
//! recognizer's runs.
//!
//!     cargo run --release -p spindoe-studies -- cost --help

use cpu_time::ThreadTime;
use spindoe::camera::FrameOutcome;
use spindoe::pattern::Pattern;
use spindoe::synth::dataset::{SynthFrame, frames};
use spindoe::vision::{Budget, FrameEstimate, Prior};
use spindoe_studies::frames::{DOTS20, all_conditions, estimator, good_conditions, outcome};
use spindoe_studies::score::mean;
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// A frame's cost.
struct Spent {
    ms: f64,
    runs: f64,
    outcome: FrameOutcome,
}

#[derive(clap::Args)]
pub struct Args {
    /// Frames of each kind.
    #[arg(long, default_value_t = 800)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 515_151)]
    seed: u64,
    /// Limits of the recognizer's runs; the default of a budget without one.
    #[arg(long)]
    runs: Vec<usize>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, seed) = (self.frames, self.seed);
        let runs = match self.runs.as_slice() {
            [] => vec![Budget::default().runs],
            runs => runs.to_vec(),
        };
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let estimator = estimator(&pattern)?;
        let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
        println!("{count} frames of each kind, seed {seed}; CPU time of one thread");
        let table = Table::new([
            "frames",
            "at most runs",
            "answered",
            "wrong",
            "mean, ms",
            "not answered",
            "runs made",
            "mean, ms",
            "all, ms",
        ]);
        for set in [all_conditions(), good_conditions()] {
            let frames = frames(&pattern, &set.config, seed, count)?;
            for &runs in &runs {
                let budget = Budget {
                    runs,
                    ..Budget::default()
                };
                let mut cost = |frame: &SynthFrame| {
                    let begun = ThreadTime::now();
                    estimator.estimate(&frame.image, &Prior::default(), &budget, &mut ws, &mut out);
                    Spent {
                        ms: 1e3 * begun.elapsed().as_secs_f64(),
                        runs: out.attempts() as f64,
                        outcome: outcome(&out, &frame.truth),
                    }
                };
                let (open, answered): (Vec<Spent>, Vec<Spent>) = frames
                    .iter()
                    .map(&mut cost)
                    .partition(|s| s.outcome == FrameOutcome::Unanswered);
                let wrong = answered.iter().filter(|s| s.outcome.is_wrong()).count();
                let ms = |some: &[Spent]| mean(some, |s| s.ms);
                let all: f64 = answered.iter().chain(&open).map(|s| s.ms).sum();
                row!(
                    table; set.name, runs, answered.len(), wrong, figure(ms(&answered), 2, ""),
                    open.len(), figure(mean(&open, |s| s.runs), 1, ""), figure(ms(&open), 2, ""),
                    figure(all / count as f64, 2, "")
                );
            }
        }
        Ok(())
    }
}
