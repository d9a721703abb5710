//! `spindoe advise`: which pattern for a camera, and what to change of it.

use std::path::PathBuf;

use clap::Args;

use super::camera::{CameraArguments, GolfBall, shown};
use super::estimate::SportPreset;
use super::flashes::Flashes;
use super::output::{Counter, quoted};
use super::print_json;
use crate::ball::Ball;
use crate::camera::{
    Advice, AdviceConfig, CameraTrials, ErrorRatio, ExposureAdvice, ExposureTrials, FrameRates,
    RaceConfig, advise, advise_exposures,
};
use crate::error::Result;
use crate::pattern::{NamedPattern, shipped_designs};
use crate::validate::check_samples;

/// Exposures of a pattern, and of the race's first round, where none are stated.
const GOLF_SAMPLES: u64 = 256;
const GOLF_FIRST: u64 = 64;
/// Flashes of a launch monitor where none are stated, s: uneven, so that they show the direction of flight.
const GOLF_FLASHES_S: [f64; 3] = [0.0, 0.9e-3, 2.1e-3];

#[derive(Debug, Args)]
#[command(after_help = "\
The patterns race on rendered frames of the camera, the same scenes for all, read by the whole estimator. One that is
clearly worse than the best leaves early. What is printed is of other frames than those that chose; those that stay are
also tried on sequences. The error column is the root mean square error of an orientation over sqrt(right - 2 wrong): a
spin from many frames errs in proportion to it. The last column is that error over the first pattern's on the same
scenes: an interval that holds 1 decides nothing.
It takes some two minutes of one core, in a dark room (--camera dark) one.

Examples:
  spindoe advise --ball-px 45 --fps 240 --exposure-ms 0.5
  spindoe advise --preset golf --strobe-ms 0,0.9,2.1 --ball-px 100
  spindoe advise mine.csv --camera camera.toml --json")]
pub struct Arguments {
    /// Patterns: for each the name of a shipped one (dots20), its CSV (unit vectors x,y,z), a table (.npz), or the
    /// folder of a design or calibration [default: the shipped designs].
    #[arg(value_name = "PATTERN")]
    inputs: Vec<PathBuf>,
    /// Frames of a pattern that stays to the end, of which half choose and half measure; half as many for a change of the
    /// camera [default: 1024; with --preset golf 256].
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// Sequences of a pattern that stays to the end, for the spin.
    #[arg(hide = true, long, value_name = "N", default_value_t = AdviceConfig::default().sequences)]
    sequences: u64,
    /// Frames of a sequence.
    #[arg(hide = true, long, value_name = "N", default_value_t = AdviceConfig::default().sequence_frames)]
    sequence_frames: usize,
    /// Seed of frames and sequences.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// For a launch monitor: golf balls of 42.67 mm and 100 pixels in infrared light, exposures with several flashes, golf's spins;
    /// the intrinsics are known. It takes some minutes.
    #[arg(long, value_enum, value_name = "golf", hide_possible_values = true, conflicts_with_all = ["camera", "fps", "exposure_ms", "rps", "max_speed_m_s", "surroundings", "noise_levels"])]
    preset: Option<SportPreset>,
    /// Flashes of one exposure, milliseconds, ascending, or PERIODxN, as in 0.7x3 [default: 0,0.9,2.1].
    #[arg(
        long,
        value_name = "MS,MS..",
        allow_hyphen_values = true,
        requires = "preset"
    )]
    strobe_ms: Option<Flashes>,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    camera: CameraArguments,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let is_golf = arguments.preset == Some(SportPreset::Golf);
    let usual = match is_golf {
        true => GOLF_SAMPLES,
        false => RaceConfig::default().frames(),
    };
    let samples = arguments.samples.unwrap_or(usual);
    check_samples(samples)?;
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
    if is_golf {
        return golf(arguments, &patterns, samples);
    }
    let conditions = arguments.camera.conditions()?;
    let config = AdviceConfig {
        race: RaceConfig::of_frames(samples),
        sequences: arguments.sequences,
        sequence_frames: arguments.sequence_frames,
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
    outln!("{}", arguments.camera.assumed()?);
    print_words(&advice, &config, arguments.seed);
    Ok(())
}

/// The patterns for a launch monitor.
fn golf(arguments: &Arguments, patterns: &[NamedPattern], samples: u64) -> Result<()> {
    let times_s = match &arguments.strobe_ms {
        Some(flashes) => flashes.times_s.clone(),
        None => GOLF_FLASHES_S.to_vec(),
    };
    let mut trials = ExposureTrials::golf(times_s, arguments.seed);
    let GolfBall {
        ball_mm,
        dots,
        conditions,
    } = arguments.camera.state_golf(&mut trials.synth)?;
    let sized = patterns
        .iter()
        .map(|named| Ok((named, dots.of_named(named, &conditions)?)));
    let sized = sized.collect::<Result<Vec<_>>>()?;
    let race = RaceConfig::of_frames(samples);
    let race = RaceConfig {
        first_frames: GOLF_FIRST.min(race.max_frames),
        ..race
    };
    let total = race.frames().saturating_mul(patterns.len() as u64);
    let counter = Counter::new(total, "exposures");
    let advice = advise_exposures(&trials, &sized, &race, &|n| counter.add(n))?;
    counter.finish();
    if arguments.json {
        return print_json(&serde_json::json!({
            "strobe_s": trials.strobe.times_s,
            "ball_px": trials.synth.ball_px,
            "patterns": advice,
        }));
    }
    print_golf_words(&advice, &trials, ball_mm, conditions.ball_px);
    Ok(())
}

/// The rates of a launch monitor, and what to take.
fn print_golf_words(
    advice: &[ExposureAdvice],
    trials: &ExposureTrials,
    ball_mm: f64,
    ball_px: f64,
) {
    let ms: Vec<String> = trials
        .strobe
        .times_s
        .iter()
        .map(|s| format!("{:.3}", 1e3 * s))
        .collect();
    outln!(
        "assumed: golf balls of {ball_mm} mm and {ball_px} pixels in infrared light, golf's spins, known intrinsics"
    );
    outln!(
        "seed {}; exposures with flashes at {} ms, others than those that chose:",
        trials.seed,
        ms.join(", ")
    );
    outln!(
        "{:12} {:>4} {:>6} {:>9}  {:>24}  {:>20}  {:>24}  {:>10}",
        "pattern",
        "dots",
        "wide",
        "exposures",
        "images posed",
        "poses wrong",
        "spin right",
        "error, rpm"
    );
    for p in advice {
        let r = &p.rates;
        outln!(
            "{:12} {:>4} {:>5.1}% {:>9}  {:>24}  {:>20}  {:>24}  {:>10}",
            quoted(&p.name),
            p.dots,
            100.0 * p.dot_diameter,
            r.right.trials,
            r.posed.to_string(),
            r.wrong.to_string(),
            r.right.to_string(),
            shown(r.median_error_rpm, 0)
        );
    }
    outln!("Right is a spin whose whole vector is within 2 % of its magnitude or 60 rpm.");
    outln!("Brackets are 95 % intervals (shares: Wilson).");
    if let Some(best) = advice.first() {
        take(&best.name, best.dot_diameter, ball_mm);
    }
}

/// What is to be done with the best.
fn take(name: &str, dot_diameter: f64, ball_mm: f64) {
    let name = quoted(name);
    outln!(
        "Take {name}. Print it with: spindoe stencil {name} -o stencil --ball-diameter-mm {ball_mm} --dot-diameter-mm {:.1}",
        (10.0 * dot_diameter * ball_mm + 1e-6).floor() / 10.0
    );
}

fn print_words(advice: &Advice, config: &AdviceConfig, seed: u64) {
    outln!("seed {seed}; frames alone, others than those that chose:");
    outln!(
        "{:12} {:>4} {:>6} {:>6}  {:>24}  {:>20}  {:>17}  {:>17}",
        "pattern",
        "dots",
        "wide",
        "frames",
        "right",
        "wrong",
        "error, deg",
        "over the first's"
    );
    for p in &advice.patterns {
        let r = &p.frames;
        outln!(
            "{:12} {:>4} {:>5.1}% {:>6}  {:>24}  {:>20}  {:>17}  {:>17}",
            quoted(&p.name),
            p.dots,
            100.0 * p.dot_diameter,
            r.right.trials,
            r.right.to_string(),
            r.wrong.to_string(),
            effective_error(r),
            p.error_ratio.map_or("-".to_owned(), ratio)
        );
    }
    print_spins(advice, config);
    print_changes(advice);
    outln!("Brackets are 95 % intervals (shares: Wilson).");
    if let Some(best) = advice.patterns.first() {
        take(&best.name, best.dot_diameter, config.ball_mm);
    }
}

fn print_spins(advice: &Advice, config: &AdviceConfig) {
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
            "{:16} {:>24}  {:>12}  {:>9}  {:>9}",
            quoted(&p.name),
            s.right.to_string(),
            shown(s.median_error_rps, 3),
            shown(s.median_magnitude_error_rps, 3),
            shown(s.median_axis_error_deg, 2)
        );
    }
    outln!(
        "Spins beyond {:.0} rps have a slower alias at this frame rate.",
        advice.unique_up_to_rps
    );
}

/// The changes that help beyond what chance does: of the others nothing is known.
fn print_changes(advice: &Advice) {
    let Some(best) = advice.patterns.first() else {
        return;
    };
    let (name, frames) = (quoted(&best.name), best.frames.right.trials);
    let mut helpful = advice.changes.iter().filter(|c| c.helps()).peekable();
    match helpful.peek() {
        Some(_) => outln!(
            "What would help, one change at a time, on the {frames} scenes of {name}; its error times:"
        ),
        None => outln!("Of no single change {frames} frames show that it helps."),
    }
    for change in helpful {
        let r = &change.frames;
        outln!(
            "  {} (right {:.1} %, wrong {:.2} %): {}",
            change.error_ratio.map_or(String::new(), ratio),
            100.0 * r.right.rate,
            100.0 * r.wrong.rate,
            change.change
        );
    }
}

fn ratio(ratio: ErrorRatio) -> String {
    let ErrorRatio { ratio, low, high } = ratio;
    format!("{ratio:.2} [{low:.2}, {high:.2}]")
}

fn effective_error(rates: &FrameRates) -> String {
    let value = shown(rates.effective_error_deg, 2);
    match rates.effective_error_interval_deg {
        Some([low, high]) => format!("{value} [{low:.2}, {high:.2}]"),
        None => format!("{value} [?]"),
    }
}
