//! Several patterns side by side, on the same trials.

use std::path::{Path, PathBuf};

use super::{Arguments, SAMPLES};
use crate::ball::Ball;
use crate::cli::output::{Counter, degrees_or_dash, quoted};
use crate::cli::print_json;
use crate::error::Result;
use crate::files;
use crate::recognize::RecognizerName;
use crate::report::compare::{Comparison, Contest, Entry, PatternMeasures, compare};
use crate::stats::PairedDifference;
use crate::view::ProtocolName;

impl Arguments {
    /// The command that repeats the comparison.
    fn command(&self) -> String {
        let mut words = vec!["spindoe validate".to_owned()];
        words.extend(self.inputs.iter().map(|p| quoted(&p.to_string_lossy())));
        let samples = self.samples.unwrap_or(SAMPLES);
        words.push(format!("--samples {samples} --seed {}", self.seed));
        if let Some(recognizer) = self.recognizer {
            words.push(format!("--config recognizer={recognizer}"));
        }
        words.join(" ")
    }
}

/// The patterns with their names.
pub(super) fn entries(paths: &[PathBuf], balls: Vec<Ball>) -> Vec<Entry> {
    let named = names(paths).into_iter().zip(balls);
    named.map(|(name, ball)| Entry { name, ball }).collect()
}

/// All protocols, with both recognizers or the one that was given.
pub(super) fn run(arguments: &Arguments, balls: Vec<Ball>) -> Result<()> {
    arguments.reject(
        "with several patterns, which are measured in all protocols",
        &["protocol", "sigma-deg"],
    )?;
    let entries = entries(&arguments.inputs, balls);
    let set = arguments.begin()?;
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
        arguments.samples.unwrap_or(SAMPLES),
        &mut |what| {
            counter.line(what);
            counter.add(1);
        },
    )?;
    counter.finish();
    if let Some(set) = set {
        let (dir, kept) = (set.path(), found.clone().untimed());
        let mut json = serde_json::to_vec_pretty(&kept)
            .map_err(|e| crate::Error::Internal(format!("comparison as JSON: {e}")))?;
        json.push(b'\n');
        files::write_bytes(&dir.join("comparison.json"), &json)?;
        kept.write_page(dir, &entries, &arguments.command())?;
        set.publish(&[], "comparison.json")?;
    }
    if arguments.json {
        return print_json(&found);
    }
    print_words(&found);
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
fn name(path: &Path) -> String {
    let stem = |p: &Path| {
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
    found.patterns.iter().for_each(print_pattern);
    print_contests(found);
    print_differences(found);
}

fn print_pattern(p: &PatternMeasures) {
    outln!(
        "\n{} ({} dots, {})",
        p.name,
        p.summary.dots,
        &p.sha256[..12]
    );
    outln!(
        "  separation minimum {:.1} deg, mean {:.1} deg; {} dots visible from anywhere",
        p.summary.min_separation_rad.to_degrees(),
        p.summary.mean_nearest_separation_rad.to_degrees(),
        p.summary.min_visible
    );
    outln!(
        "  three nearest neighbors: mean {:.1} deg, std {:.3} and minimum {:.3} of it",
        p.neighbors.mean_rad.to_degrees(),
        p.neighbors.relative_std,
        p.neighbors.relative_min
    );
    outln!(
        "  orientation bound: mean {}, worst {} of a dot's noise",
        number_or_dash(p.orientation_bound.mean),
        number_or_dash(p.orientation_bound.worst)
    );
    let objectives = p
        .objectives
        .iter()
        .map(|o| format!("{} {:.4}", o.name, o.value));
    outln!(
        "  mean nearest-neighbor distance of the features {:.4}; {}",
        p.mean_feature_distance,
        objectives.collect::<Vec<_>>().join(", ")
    );
}

/// The rates of all patterns, a line a protocol and recognizer.
fn print_contests(found: &Comparison) {
    let longest = found.patterns.iter().map(|p| p.name.chars().count()).max();
    let width = longest.unwrap_or(0).clamp(7, 24);
    outln!(
        "\n{:<9}{:<8}{:<width$}  {:>23}  {:>7}  {:>23}  {:>10}",
        "protocol",
        "recog.",
        "pattern",
        "right, all views",
        "too few",
        "all dots, of the rest",
        "mean error"
    );
    for c in &found.contests {
        let v = &c.validation;
        outln!(
            "{:<9}{:<8}{:<width$}  {:>23}  {:>5.1} %  {:>23}  {:>10}",
            v.protocol.as_str(),
            c.recognizer.as_str(),
            shortened(&c.name, width),
            v.answered.to_string(),
            100.0 * v.skipped_share(),
            v.identity.to_string(),
            degrees_or_dash(v.mean_error_deg, 2),
        );
    }
}

/// The differences from the first pattern that are not within their interval.
fn print_differences(found: &Comparison) {
    let Some(first) = found.patterns.first() else {
        return;
    };
    let clear: Vec<&Contest> = found
        .contests
        .iter()
        .filter(|c| {
            [c.answered_difference, c.identity_difference]
                .iter()
                .any(is_clear)
        })
        .collect();
    outln!(
        "\nPoints more than {}, where the 95 % interval of the pairs leaves out 0:",
        first.name
    );
    if clear.is_empty() {
        outln!("  none");
    }
    for c in clear {
        let rates = [
            ("right", &c.answered_difference),
            ("all dots right", &c.identity_difference),
        ];
        let clear = rates.iter().filter(|(_, d)| is_clear(d));
        let words: Vec<String> = clear
            .map(|(rate, d)| format!("{rate} {}", signed(d)))
            .collect();
        outln!(
            "  {:<9}{:<8}{}: {}",
            c.validation.protocol.as_str(),
            c.recognizer.as_str(),
            c.name,
            words.join(", ")
        );
    }
}

fn is_clear(d: &PairedDifference) -> bool {
    d.low > 0.0 || d.high < 0.0
}

/// A name cut to a column's width.
fn shortened(name: &str, width: usize) -> String {
    match name.char_indices().nth(width) {
        None => name.to_owned(),
        Some(_) => name.chars().take(width - 3).chain("...".chars()).collect(),
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
