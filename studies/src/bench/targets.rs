//! The table of the targets: five patterns of 20 dots on the same trials of a seed with no other
//! use.
//!
//!     cargo run --release -p spindoe-studies -- targets --help
//!
//! Beside the patterns that are given and the own one it makes:
//!
//! - `random.csv`: directions uniform on the sphere, with any separation,
//! - `spread.csv`: twenty charges in equilibrium (the Thomson problem), the best of eight,
//! - `mean-nn.csv`: the best of sixteen descents on the paper's objective, by that objective, under
//!   the default constraints.
//!
//! Rates have Wilson's 95 % interval; the share of failures against the first pattern has that of a
//! ratio of paired proportions on a logarithmic scale, with variance `(b + c) / (f g)` for `f` and
//! `g` failures of which `b` and `c` are one pattern's alone.

use std::path::PathBuf;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::ball::Ball;
use spindoe::design::descent::{Cost, descend};
use spindoe::design::objective::MeanNearestNeighbor;
use spindoe::design::search::feasible::Charges;
use spindoe::design::{Constraints, Objective, OrientationBound};
use spindoe::pattern::{Pattern, random_pattern};
use spindoe::recognize::ORIENTATION_FAILURE_RAD;
use spindoe::recognize::RecognizerName;
use spindoe::validate::{TrialResult, ValidationConfig};
use spindoe::view::{Protocol, ProtocolName};
use spindoe::{Error, Result};
use spindoe_studies::frames::{DOTS20, name_of};
use spindoe_studies::table::{Cell, Table, figure, interval};
use spindoe_studies::{Outcome, row};

/// Seeds: of the patterns, and of the trials. Neither is used by any design.
const PATTERN_SEED: u64 = 2_026_003;
const TRIAL_SEED: u64 = 20_261_123;
const DOTS: usize = 20;

/// The descent of minimum cost from some random starts.
fn best_of<C: Cost>(
    cost: &C,
    constraints: &Constraints,
    starts: u64,
    steps: u64,
) -> Result<Pattern> {
    let found: Result<Vec<(f64, Pattern)>> = (0..starts)
        .into_par_iter()
        .map(|stream| {
            let mut rng = ChaCha8Rng::seed_from_u64(PATTERN_SEED);
            rng.set_stream(stream + 1);
            let start = random_pattern(DOTS, constraints.min_separation_rad, &mut rng)?;
            let pattern = descend(&start, cost, constraints, steps)?;
            Ok((cost.cost(pattern.dots())?.value, pattern))
        })
        .collect();
    found?
        .into_iter()
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, pattern)| pattern)
        .ok_or_else(|| Error::argument("starts", "expected at least 1"))
}

fn made() -> Result<[(&'static str, Pattern); 3]> {
    let free = Constraints {
        min_separation_rad: 0.0,
        min_visible: 0,
        seam_margin_rad: 0.0,
        ..Constraints::default()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(PATTERN_SEED);
    let paper = Objective::MeanNn(MeanNearestNeighbor::default());
    Ok([
        ("random", random_pattern(DOTS, 0.0, &mut rng)?),
        ("spread", best_of(&Charges, &free, 8, 300)?),
        (
            "mean-nn",
            best_of(&paper, &Constraints::default(), 16, 120)?,
        ),
    ])
}

/// A column of the table.
struct Column {
    title: &'static str,
    recognizer: RecognizerName,
    protocol: Protocol,
}

fn columns() -> Vec<Column> {
    let column = |title, recognizer, name| Column {
        title,
        recognizer,
        protocol: Protocol::standard(name),
    };
    let (robust, paper) = (RecognizerName::Robust, RecognizerName::Voting);
    let mut noisy = column("`paper` at 8 deg", robust, ProtocolName::Paper);
    noisy.protocol = noisy.protocol.with_sigma_rad(8f64.to_radians());
    vec![
        column("`sparse`", robust, ProtocolName::Sparse),
        column("`clutter`", robust, ProtocolName::Clutter),
        noisy,
        column(
            "`paper`, the paper's recognizer",
            paper,
            ProtocolName::Paper,
        ),
        column(
            "`sparse`, the paper's recognizer",
            paper,
            ProtocolName::Sparse,
        ),
    ]
}

fn failed(result: &TrialResult) -> bool {
    match result {
        TrialResult::Skipped => true,
        TrialResult::Judged { error_rad, .. } => *error_rad >= ORIENTATION_FAILURE_RAD,
    }
}

/// Failures of the first for each of the second, with the 95 % interval.
fn ratio(first: &[TrialResult], second: &[TrialResult]) -> Cell {
    let count = |which: &dyn Fn(bool, bool) -> bool| {
        let pairs = first.iter().zip(second);
        pairs.filter(|(a, b)| which(failed(a), failed(b))).count() as f64
    };
    let (f, g) = (count(&|a, _| a), count(&|_, b| b));
    let one_only = count(&|a, b| a != b);
    let (middle, half) = (f / g, 1.96 * (one_only / (f * g)).sqrt());
    interval(middle, [-half, half].map(|h| middle * h.exp()), 2, "")
}

#[derive(clap::Args)]
pub struct Args {
    /// Folder that the patterns that are made are written to.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Patterns before those that are made, such as the published one.
    #[arg(value_name = "PATTERN.csv")]
    patterns: Vec<PathBuf>,
    /// Trials of a column.
    #[arg(long, default_value_t = 20_000)]
    trials: u64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let trials = self.trials;
        let given = |path: &PathBuf| Ok((name_of(path), Pattern::read_csv(path)?));
        let mut patterns = self
            .patterns
            .iter()
            .map(given)
            .collect::<Result<Vec<_>>>()?;
        for (name, pattern) in made()? {
            if let Some(dir) = &self.out {
                spindoe::files::create_dir(dir)?;
                pattern.write_csv(&dir.join(format!("{name}.csv")))?;
            }
            patterns.push((name.to_owned(), pattern));
        }
        patterns.push(("dots20".into(), Pattern::read_csv(DOTS20.as_ref())?));
        let columns = columns();
        println!("{trials} trials a column, seed {TRIAL_SEED}");
        let titles = columns.iter().map(|c| c.title);
        let last = [
            "`sparse` failures for one of the first",
            "bound, mean",
            "worst",
        ];
        let table = Table::new(["pattern"].into_iter().chain(titles).chain(last));
        let mut first: Option<Vec<TrialResult>> = None;
        for (name, pattern) in patterns {
            let bound = OrientationBound::default().summary(pattern.dots());
            let ball = Ball::new(pattern);
            let mut cells = Vec::new();
            let mut failures = None;
            for column in &columns {
                let config = ValidationConfig {
                    recognizer: column.recognizer,
                    protocol: column.protocol,
                    seed: TRIAL_SEED,
                    samples: trials,
                };
                let results = config.results(&ball, &|_| {})?;
                let found = config.summary(&ball, &results).validation;
                cells.push(found.answered);
                // Of the first column, which is `sparse`.
                if failures.is_none() {
                    failures = Some(ratio(
                        &results,
                        first.get_or_insert_with(|| results.clone()),
                    ));
                }
            }
            let bounds = [bound.mean, bound.worst].map(|b| figure(b, 3, ""));
            row!(table; name; cells; failures; bounds);
        }
        Ok(())
    }
}
