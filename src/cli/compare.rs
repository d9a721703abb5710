//! `spindoe compare`: patterns side by side.

use std::path::PathBuf;

use clap::Args;

#[cfg(feature = "vision")]
use super::camera::{CAMERA_FRAMES, CameraArguments};
use super::output::{Counter, one_of, quoted};
use super::print_json;
use crate::ball::Ball;
use crate::error::Result;
use crate::files::{self, Replacement};
use crate::recognize::RecognizerName;
use crate::report::compare::{Comparison, Entry, compare};
use crate::report::reject_design;
use crate::stats::PairedDifference;
use crate::view::ProtocolName;

#[derive(Debug, Args)]
#[command(after_help = "\
All patterns are evaluated on the same rotations with the same random numbers; differences are against the
first pattern, with 95 % intervals for pairs.

Example:
  spindoe compare published.csv designs/dots20/pattern.csv -o comparison
  spindoe compare published.csv designs/dots20/pattern.csv --ball-px 45 --surroundings any

With any flag of a camera the patterns are compared on frames of that camera, rendered and read by the
whole estimator: some 10 ms each, in any surroundings some 50.")]
pub struct Arguments {
    /// The patterns, at least two: for each its CSV (unit vectors x,y,z), a table (.npz), or the folder
    /// of a design or calibration.
    #[arg(value_name = "PATTERN", required = true)]
    inputs: Vec<PathBuf>,
    /// Write report.html, comparison.json and the plots to this folder.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Trials per protocol; with a camera, frames a pattern [default: 10000, with a camera 1000].
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// Seed of the trials.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Only this recognizer; by default both.
    #[arg(long, value_parser = one_of(&RecognizerName::ALL, RecognizerName::as_str), value_name = "RECOGNIZER")]
    recognizer: Option<RecognizerName>,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
    #[cfg(feature = "vision")]
    #[command(flatten)]
    camera: CameraArguments,
}

impl Arguments {
    fn samples(&self) -> u64 {
        self.samples.unwrap_or(10_000)
    }

    /// The command that repeats the comparison.
    fn command(&self) -> String {
        let mut words = vec!["spindoe compare".to_owned()];
        words.extend(self.inputs.iter().map(|p| quoted(&p.to_string_lossy())));
        words.push(format!("--samples {} --seed {}", self.samples(), self.seed));
        if let Some(recognizer) = self.recognizer {
            words.push(format!("--recognizer {recognizer}"));
        }
        words.join(" ")
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let entries = arguments
        .inputs
        .iter()
        .zip(names(&arguments.inputs))
        .map(|(path, name)| {
            Ok(Entry {
                name,
                ball: Ball::read(path)?,
            })
        })
        .collect::<Result<Vec<_>>>()?;
    #[cfg(feature = "vision")]
    if arguments.camera.is_stated() {
        return before_camera(arguments, &entries);
    }
    let begin = |dir: &std::path::Path| {
        reject_design(dir, "choose another folder")?;
        Replacement::begin(dir)
    };
    let set = arguments.output.as_deref().map(begin).transpose()?;
    let recognizers = match arguments.recognizer {
        Some(one) => vec![one],
        None => RecognizerName::ALL.to_vec(),
    };
    let runs = entries.len() * recognizers.len() * ProtocolName::ALL.len();
    let counter = Counter::new(runs as u64, "measurements");
    let found = compare(
        &entries,
        &recognizers,
        arguments.seed,
        arguments.samples(),
        &mut |what| {
            counter.line(what);
            counter.add(1);
        },
    )?;
    counter.finish();
    if let Some(set) = set {
        let dir = set.path();
        let mut json = serde_json::to_vec_pretty(&found)
            .map_err(|e| crate::Error::Internal(format!("comparison as JSON: {e}")))?;
        json.push(b'\n');
        files::write_bytes(&dir.join("comparison.json"), &json)?;
        #[cfg(feature = "plot")]
        found.write_plots(dir, &entries)?;
        found.write_page(dir, &entries, &arguments.command())?;
        set.publish(&[], &[], "comparison.json")?;
    }
    if arguments.json {
        return print_json(&found);
    }
    print_words(&found);
    Ok(())
}

/// The patterns before the stated camera, on the same scenes.
#[cfg(feature = "vision")]
fn before_camera(arguments: &Arguments, entries: &[Entry]) -> Result<()> {
    use crate::camera::{CameraTrials, FrameRates, paired};
    use crate::error::Error;

    for (is_given, flag) in [
        (arguments.output.is_some(), "output"),
        (arguments.recognizer.is_some(), "recognizer"),
    ] {
        if is_given {
            return Err(Error::argument(flag, "cannot be used with a camera"));
        }
    }
    let conditions = arguments.camera.conditions()?;
    let trials = CameraTrials::new(conditions, arguments.seed);
    let frames = arguments.samples.unwrap_or(CAMERA_FRAMES);
    let counter = Counter::new(frames.saturating_mul(entries.len() as u64), "frames");
    let mut outcomes = Vec::with_capacity(entries.len());
    for entry in entries {
        outcomes.push(trials.frames(entry.ball.pattern(), 0..frames, &|n| counter.add(n))?);
    }
    counter.finish();
    let rows = entries.iter().zip(&outcomes).map(|(entry, own)| {
        let difference = paired(&outcomes[0], own);
        (entry, FrameRates::of(own, arguments.seed), difference)
    });
    if arguments.json {
        let rows: Vec<_> = rows
            .map(|(entry, rates, difference)| {
                serde_json::json!({ "pattern": entry.name, "frames": rates, "difference": difference })
            })
            .collect();
        return print_json(&serde_json::json!({
            "conditions": conditions, "seed": arguments.seed, "patterns": rows
        }));
    }
    outln!(
        "{frames} frames of seed {}, the same scenes for all:",
        arguments.seed
    );
    for (entry, r, difference) in rows {
        outln!("{} ({} dots)", entry.name, entry.ball.pattern().len());
        outln!(
            "  right {}, wrong {}, error: mean {:.3} deg",
            r.right,
            r.wrong,
            r.mean_error_deg
        );
        outln!(
            "  right more often than the first by {:.2} [{:.2}, {:.2}] points",
            100.0 * difference.difference,
            100.0 * difference.low,
            100.0 * difference.high
        );
    }
    Ok(())
}

/// Names for tables and plots: short ones where they differ, else the paths. If a path is given
/// twice, the second name includes its position.
fn names(paths: &[PathBuf]) -> Vec<String> {
    let short: Vec<String> = paths.iter().map(|p| name(p)).collect();
    let count = |of: &str| short.iter().filter(|n| *n == of).count();
    let mut names: Vec<String> = Vec::with_capacity(paths.len());
    for (k, (path, short)) in paths.iter().zip(&short).enumerate() {
        let mut own = short.clone();
        if count(short) > 1 {
            own = path.display().to_string();
        }
        if names.contains(&own) {
            own = format!("{own} ({})", k + 1);
        }
        names.push(own);
    }
    names
}

/// A pattern's name: its file's stem, or its folder's name for a file called pattern or table.
fn name(path: &std::path::Path) -> String {
    let stem = |p: &std::path::Path| {
        p.file_stem()
            .map(|s| s.to_string_lossy().into_owned())
            .unwrap_or_default()
    };
    let own = stem(path);
    match path.parent() {
        Some(dir) if (own == "pattern" || own == "table") && dir.file_name().is_some() => dir
            .file_name()
            .map(|s| s.to_string_lossy().into_owned())
            .unwrap_or(own),
        _ => own,
    }
}

fn print_words(found: &Comparison) {
    outln!("{} trials a protocol, seed {}.", found.samples, found.seed);
    for p in &found.patterns {
        let deg = f64::to_degrees;
        outln!(
            "\n{} ({} dots, {})",
            p.name,
            p.summary.dots,
            &p.sha256[..12]
        );
        outln!(
            "  separation minimum {:.1} deg, mean {:.1} deg; {} dots visible from anywhere",
            deg(p.summary.min_separation_rad),
            deg(p.summary.mean_nearest_separation_rad),
            p.summary.min_visible
        );
        outln!(
            "  three nearest neighbors: mean {:.1} deg, std {:.3} and minimum {:.3} of it (US 2023/0218952)",
            deg(p.neighbors.mean_rad),
            p.neighbors.relative_std,
            p.neighbors.relative_min
        );
        outln!(
            "  orientation bound: mean {}, worst {} of a dot's noise",
            number_or_dash(p.orientation_bound.mean),
            number_or_dash(p.orientation_bound.worst)
        );
        outln!(
            "  mean nearest-neighbor distance of the features: {:.4}",
            p.mean_feature_distance
        );
        for o in &p.objectives {
            outln!("  {}: {:.4}", o.name, o.value);
        }
    }
    let width = found
        .patterns
        .iter()
        .map(|p| p.name.len())
        .max()
        .unwrap_or(0);
    outln!();
    for c in &found.contests {
        let v = &c.validation;
        outln!(
            "{:<7} {:<6} {:<width$} identity {} ({}), orientation {} ({}), error {:.3} deg",
            v.protocol.as_str(),
            c.recognizer.as_str(),
            c.name,
            v.identity,
            signed(&c.identity_difference),
            v.orientation,
            signed(&c.orientation_difference),
            v.mean_error_deg,
        );
    }
}

/// A value, or a dash where some direction has none: fewer than two visible dots do not determine
/// the orientation.
fn number_or_dash(value: f64) -> String {
    if value.is_finite() {
        format!("{value:.3}")
    } else {
        "-".to_owned()
    }
}

/// A difference in percentage points.
fn signed(d: &PairedDifference) -> String {
    format!(
        "{:+.2} [{:+.2}, {:+.2}]",
        100.0 * d.difference,
        100.0 * d.low,
        100.0 * d.high
    )
}
