//! `spindoe advise`: which pattern for a camera, and what to change of it.

use std::path::PathBuf;

use clap::Args;

use super::camera::CameraArguments;
use super::output::{Counter, quoted};
use super::print_json;
use crate::ball::Ball;
use crate::error::Result;
use crate::predict::{
    Advice, AdviceConfig, DetectionModel, NamedPattern, PredictConfig, advise, predictions,
    shipped_designs,
};

/// A prediction whose frames lie outside the model's range in more than this share is doubtful.
const MIN_COVERED: f64 = 0.9;

#[derive(Debug, Args)]
#[command(after_help = "\
No image is rendered: outlines, dots and false dots come from a model of the detector that was learned on
rendered frames, the identification is the estimator's own. The error column is the root mean square error
of an orientation over sqrt(right - 2 wrong): a spin from many frames errs in proportion to it.

Examples:
  spindoe advise --ball-px 45 --fps 240 --exposure-ms 0.5
  spindoe advise mine.csv --camera camera.toml --json")]
pub struct Arguments {
    /// Patterns: for each its CSV (unit vectors x,y,z), a table (.npz), or the folder of a design or
    /// calibration [default: the shipped designs].
    #[arg(value_name = "PATTERN")]
    inputs: Vec<PathBuf>,
    /// Frames a prediction.
    #[arg(long, value_name = "N", default_value_t = 600)]
    frames: u64,
    /// Sequences a pattern, for the spin.
    #[arg(long, value_name = "N", default_value_t = 40)]
    sequences: u64,
    /// Frames of a sequence.
    #[arg(long, value_name = "N", default_value_t = 10)]
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
    let patterns = if arguments.inputs.is_empty() {
        shipped_designs()?
    } else {
        let inputs = arguments.inputs.iter();
        inputs
            .map(|path| {
                Ok(NamedPattern {
                    name: path.to_string_lossy().into_owned(),
                    pattern: Ball::read(path)?.into_pattern(),
                })
            })
            .collect::<Result<_>>()?
    };
    let config = AdviceConfig {
        predict: PredictConfig {
            frames: arguments.frames,
            seed: arguments.seed,
            ..PredictConfig::default()
        },
        sequences: arguments.sequences,
        sequence_frames: arguments.sequence_frames,
        dot_size: arguments.camera.dot_size()?,
    };
    let model = DetectionModel::shipped()?;
    let counter = Counter::new(predictions(patterns.len(), &conditions), "predictions");
    let advice = advise(&model, &patterns, &conditions, &config, &|n| counter.add(n))?;
    counter.finish();
    if arguments.json {
        return print_json(&advice);
    }
    print_words(&advice, &config);
    Ok(())
}

fn print_words(advice: &Advice, config: &AdviceConfig) {
    let PredictConfig { frames, seed, .. } = config.predict;
    outln!(
        "{frames} frames and {} sequences of {} frames a pattern, seed {seed}; of frames alone:",
        config.sequences,
        config.sequence_frames
    );
    outln!(
        "{:16} {:>4} {:>8}  {:>24}  {:>22}  {:>9}  {:>10}",
        "pattern",
        "dots",
        "diameter",
        "right",
        "wrong",
        "mean, deg",
        "error, deg"
    );
    for p in &advice.patterns {
        let r = &p.frames.rates;
        outln!(
            "{:16} {:>4} {:>7.1}%  {:>24}  {:>22}  {:>9.2}  {:>10.2}",
            quoted(&p.name),
            p.dots,
            100.0 * p.dot_diameter,
            r.right.to_string(),
            r.wrong.to_string(),
            r.mean_error_deg,
            p.effective_error_deg
        );
    }
    outln!("of sequences:");
    outln!(
        "{:16} {:>24}  {:>12}  {:>9}  {:>9}",
        "pattern",
        "spin within 20 %",
        "error, rps",
        "rate, rps",
        "axis, deg"
    );
    for p in &advice.patterns {
        let s = &p.spin;
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
        outln!("With {}, one change at a time:", quoted(&best.name));
        for change in &advice.changes {
            let r = &change.frames.rates;
            outln!(
                "  error {:.2} deg instead of {:.2} (right {:.1} %, wrong {:.2} %): {}",
                change.effective_error_deg,
                best.effective_error_deg,
                100.0 * r.right.rate,
                100.0 * r.wrong.rate,
                change.change
            );
        }
        if best.frames.covered < MIN_COVERED {
            errln!(
                "spindoe: only {:.0} % of these frames lie within what the model was learned from; render some with `spindoe synth` to be sure",
                100.0 * best.frames.covered
            );
        }
    }
    outln!("Brackets are 95 % intervals (Wilson).");
}
