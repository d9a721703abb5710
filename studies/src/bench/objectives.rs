//! The study that selected the default objective: how well does each objective predict the measured
//! failure rate?
//!
//!     cargo run --release -p spindoe-studies -- objectives --help
//!
//! Patterns of 20 dots in three groups: random ones; random ones after a few descent steps on an
//! objective that takes turns (good patterns are what a search must distinguish); and, among the
//! last, those below the median failure rate. For each group the rank correlation (Spearman) of
//! each value with the measured failures of the `sparse` protocol, and a scatter plot.

use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::Result;
use spindoe::ball::Ball;
use spindoe::design::descent::descend;
use spindoe::design::{Constraints, Objective, ObjectiveName};
use spindoe::pattern::{Pattern, random_pattern};
use spindoe::plot::{LineSeries, ScatterPlot, scatter_plot};
use spindoe::recognize::RecognizerName;
use spindoe::validate::ValidationConfig;
use spindoe::view::{Protocol, ProtocolName};
use spindoe_studies::ranks::correlation;
use spindoe_studies::score::median;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Seeds: of the patterns, and of the trials. Neither is used by any design.
const PATTERN_SEED: u64 = 2_026_001;
const TRIAL_SEED: u64 = 2_026_002;

/// One pattern's values, in the order of [`NAMES`], and its failure rate.
struct Row {
    values: [f64; 4],
    failures: f64,
    descended: bool,
}

const NAMES: [&str; 4] = ["mean-nn", "whitened-nn", "confusion", "minimum separation"];

fn pattern(index: usize, protocol: &Protocol) -> Result<(Pattern, bool)> {
    let mut rng = ChaCha8Rng::seed_from_u64(PATTERN_SEED);
    rng.set_stream(index as u64);
    let separation = rng.random_range(10.0f64..28.0).to_radians();
    let start = random_pattern(20, separation, &mut rng)?;
    if index.is_multiple_of(2) {
        return Ok((start, false));
    }
    let name = ObjectiveName::ALL[index / 2 % 3];
    let objective = Objective::for_view(name, protocol.view());
    let constraints = Constraints {
        min_separation_rad: separation,
        min_visible: 4,
        seam_margin_rad: 0.0,
        ..Constraints::default()
    };
    let steps = rng.random_range(2..20);
    Ok((descend(&start, &objective, &constraints, steps)?, true))
}

fn row(index: usize, trials: u64) -> Result<Row> {
    let protocol = Protocol::standard(ProtocolName::Sparse);
    let (pattern, descended) = pattern(index, &protocol)?;
    let value = |name| -> Result<f64> {
        let found = Objective::for_view(name, protocol.view()).evaluate_at(pattern.dots())?;
        Ok(found.value)
    };
    let values = [
        value(ObjectiveName::MeanNn)?,
        value(ObjectiveName::WhitenedNn)?,
        value(ObjectiveName::Confusion)?,
        pattern.summary().min_separation_rad.to_degrees(),
    ];
    let config = ValidationConfig {
        recognizer: RecognizerName::Robust,
        protocol,
        seed: TRIAL_SEED,
        samples: trials,
    };
    let found = config.run(&Ball::new(pattern), &|_| {})?;
    Ok(Row {
        values,
        failures: 1.0 - found.validation.identity.rate,
        descended,
    })
}

#[derive(clap::Args)]
pub struct Args {
    /// Folder of the plots.
    #[arg(long, default_value = "docs")]
    out: PathBuf,
    /// Patterns.
    #[arg(long, default_value_t = 300)]
    patterns: usize,
    /// Trials of a pattern.
    #[arg(long, default_value_t = 20_000)]
    trials: usize,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (dir, count, trials) = (&self.out, self.patterns, self.trials);
        let rows: Result<Vec<Row>> = (0..count)
            .into_par_iter()
            .map(|index| row(index, trials as u64))
            .collect();
        let rows = rows?;
        println!(
            "{count} patterns (seed {PATTERN_SEED}), {trials} trials each (seed {TRIAL_SEED})"
        );
        let headings = ["patterns", "number"].into_iter().chain(NAMES);
        let table = Table::new(headings);
        let report = |name: &str, is: &dyn Fn(&Row) -> bool| {
            let some: Vec<&Row> = rows.iter().filter(|r| is(r)).collect();
            let failures: Vec<f64> = some.iter().map(|r| r.failures).collect();
            let cells = [0, 1, 2, 3].map(|k: usize| {
                let values: Vec<f64> = some.iter().map(|r| r.values[k]).collect();
                correlation(&values, &failures)
            });
            row!(table; name, some.len(); cells);
        };
        report("all", &|_| true);
        report("random", &|r| !r.descended);
        report("descended", &|r| r.descended);
        let descended: Vec<&Row> = rows.iter().filter(|r| r.descended).collect();
        let middle = median(&descended, |r| r.failures);
        report("descended, better half", &|r| {
            r.descended && r.failures < middle
        });
        for (k, value) in NAMES.iter().enumerate() {
            let series =
                [("random", false), ("after some descent", true)].map(|(name, kind)| LineSeries {
                    name: name.into(),
                    points: rows
                        .iter()
                        .filter(|r| r.descended == kind)
                        .map(|r| (r.values[k], 100.0 * r.failures))
                        .collect(),
                });
            let path = dir.join(format!("objective_{}.png", value.replace(' ', "_")));
            scatter_plot(
                &path,
                &ScatterPlot {
                    title: format!("Does {value} predict failures? {count} patterns of 20 dots"),
                    x_label: (*value).into(),
                    y_label: format!("failures, sparse protocol, of {trials} [%]"),
                    series: series.to_vec(),
                },
            )?;
        }
        Ok(())
    }
}
