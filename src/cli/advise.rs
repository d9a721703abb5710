//! `spindoe advise`: which pattern for a camera, and what to change of it.

use std::path::PathBuf;

use clap::Args;

use super::camera::CameraArguments;
use super::output::{Counter, quoted};
use super::print_json;
use crate::ball::Ball;
use crate::camera::{
    Advice, AdviceConfig, CameraTrials, ChangeAdvice, FrameRates, RaceConfig, advise,
};
use crate::error::Result;
use crate::pattern::{NamedPattern, shipped_designs};
use crate::validate::check_samples;

#[derive(Debug, Args)]
#[command(after_help = "\
The patterns race on rendered frames of the camera, the same scenes for all, read by the whole estimator. One that is
clearly worse than the best leaves early; those that stay are also tried on sequences. The error column is the root mean
square error of an orientation over sqrt(right - 2 wrong): a spin from many frames errs in proportion to it.
It takes less than a minute of one core, in any surroundings some two.

Examples:
  spindoe advise --ball-px 45 --fps 240 --exposure-ms 0.5
  spindoe advise mine.csv --camera camera.toml --json")]
pub struct Arguments {
    /// Patterns: for each the name of a shipped one (dots20), its CSV (unit vectors x,y,z), a table (.npz), or the
    /// folder of a design or calibration [default: the shipped designs].
    #[arg(value_name = "PATTERN")]
    inputs: Vec<PathBuf>,
    /// Frames of a pattern that stays to the end; half as many for a change of the camera.
    #[arg(long, value_name = "N", default_value_t = RaceConfig::default().max_frames)]
    samples: u64,
    /// Sequences of a pattern that stays to the end, for the spin.
    #[arg(hide = true, long, value_name = "N", default_value_t = AdviceConfig::default().sequences)]
    sequences: u64,
    /// Frames of a sequence.
    #[arg(hide = true, long, value_name = "N", default_value_t = AdviceConfig::default().sequence_frames)]
    sequence_frames: usize,
    /// Seed of frames and sequences.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    camera: CameraArguments,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let conditions = arguments.camera.conditions()?;
    check_samples(arguments.samples)?;
    let patterns = if arguments.inputs.is_empty() {
        shipped_designs()?
    } else {
        let inputs = arguments.inputs.iter();
        inputs
            .map(|path| {
                let ball = Ball::read(path)?;
                Ok(NamedPattern {
                    name: path.to_string_lossy().into_owned(),
                    design: ball.design().cloned(),
                    pattern: ball.into_pattern(),
                })
            })
            .collect::<Result<_>>()?
    };
    let config = AdviceConfig {
        race: RaceConfig::of_frames(arguments.samples),
        sequences: arguments.sequences,
        sequence_frames: arguments.sequence_frames,
        change_frames: arguments.samples.div_ceil(2),
        dot_size: arguments.camera.dot_size()?,
        ball_mm: arguments.camera.ball_mm()?,
    };
    let trials = CameraTrials::new(conditions, arguments.seed);
    let counter = Counter::new(config.frames(patterns.len(), &conditions), "frames");
    let advice = advise(&trials, &patterns, &config, &|n| counter.add(n))?;
    counter.finish();
    if arguments.json {
        return print_json(&advice);
    }
    print_words(&advice, &config, arguments.seed);
    Ok(())
}

fn print_words(advice: &Advice, config: &AdviceConfig, seed: u64) {
    outln!("seed {seed}; frames alone:");
    outln!(
        "{:12} {:>4} {:>6} {:>6}  {:>24}  {:>20}  {:>17}",
        "pattern",
        "dots",
        "wide",
        "frames",
        "right",
        "wrong",
        "error, deg"
    );
    for p in &advice.patterns {
        let r = &p.frames;
        outln!(
            "{:12} {:>4} {:>5.1}% {:>6}  {:>24}  {:>20}  {:>17}",
            quoted(&p.name),
            p.dots,
            100.0 * p.dot_diameter,
            r.right.trials,
            r.right.to_string(),
            r.wrong.to_string(),
            effective_error(r)
        );
    }
    outln!(
        "{} sequences of {} frames, of patterns that are not clearly worse than the first:",
        config.sequences,
        config.sequence_frames
    );
    outln!(
        "{:16} {:>24}  {:>12}  {:>9}  {:>9}",
        "pattern",
        "spin within 20 %",
        "error, rps",
        "rate, rps",
        "axis, deg"
    );
    for p in &advice.patterns {
        let Some(s) = &p.spin else { continue };
        outln!(
            "{:16} {:>24}  {:>12.3}  {:>9.3}  {:>9.2}",
            quoted(&p.name),
            s.right.to_string(),
            s.median_error_rps,
            s.median_magnitude_error_rps,
            s.median_axis_error_deg
        );
    }
    outln!(
        "Spins beyond {:.0} rps have a slower alias at this frame rate.",
        advice.unique_up_to_rps
    );
    if let Some(best) = advice.patterns.first() {
        let helps = |change: &&ChangeAdvice| {
            change.frames.effective_error_deg < best.frames.effective_error_deg
        };
        let mut helpful = advice.changes.iter().filter(helps).peekable();
        match helpful.peek() {
            Some(_) => outln!(
                "What would help, one change at a time, {} frames each:",
                config.change_frames
            ),
            None => outln!("No single change of the camera or of the dots was found to help."),
        }
        for change in helpful {
            let r = &change.frames;
            outln!(
                "  error {} deg (right {:.1} %, wrong {:.2} %): {}",
                effective_error(r),
                100.0 * r.right.rate,
                100.0 * r.wrong.rate,
                change.change
            );
        }
    }
    outln!("Brackets are 95 % intervals (shares: Wilson).");
    if let Some(best) = advice.patterns.first() {
        let name = quoted(&best.name);
        outln!(
            "Take {name}. Print it with: spindoe stencil {name} -o stencil --ball-diameter-mm {} --dot-diameter-mm {:.1}",
            config.ball_mm,
            (10.0 * best.dot_diameter * config.ball_mm + 1e-6).floor() / 10.0
        );
    }
}

fn effective_error(rates: &FrameRates) -> String {
    let value = rates.effective_error_deg;
    match rates.effective_error_interval_deg {
        Some([low, high]) => format!("{value:.2} [{low:.2}, {high:.2}]"),
        None => format!("{value:.2} [?]"),
    }
}
