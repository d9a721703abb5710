//! The study that selected the default objective: how well does each objective predict the measured
//! failures of all views?
//!
//!     cargo run --release -p spindoe-studies -- objectives --help
//!
//! For each number of dots and protocol, patterns in four groups of one size: two random; after a descent on an
//! objective that takes turns (good patterns are what a search must distinguish); and near-regular ones, after a
//! descent as charges that repel each other, which are where a search goes that only wants dots in every view. The
//! values are rank correlations (Spearman) with the share of all views that fail, those with too few dots among them.

use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::Result;
use spindoe::ball::Ball;
use spindoe::design::constraints::max_separation;
use spindoe::design::descent::descend;
use spindoe::design::objective::{Confusion, TooFewDots, confusion, failure_rate};
use spindoe::design::search::feasible::Charges;
use spindoe::design::{Constraints, Objective, ObjectiveName};
use spindoe::pattern::{Pattern, random_pattern};
use spindoe::plot::{LineSeries, ScatterPlot, scatter_plot};
use spindoe::recognize::RecognizerName;
use spindoe::validate::ValidationConfig;
use spindoe::view::{Detection, Protocol, ProtocolName};
use spindoe_studies::ranks::correlation;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Seeds: of the patterns, and of the trials. Neither is used by any design.
const PATTERN_SEED: u64 = 2_026_001;
const TRIAL_SEED: u64 = 2_026_002;

/// One pattern's values, in the order of [`NAMES`], and its failure rate.
struct Row {
    values: [f64; 6],
    failures: f64,
    kind: usize,
}

const NAMES: [&str; 6] = [
    "mean-nn",
    "whitened-nn",
    "confusion",
    "too few",
    "failure-rate",
    "with the other weight",
];
const KINDS: [&str; 4] = ["random", "random", "after some descent", "near-regular"];

fn pattern(index: usize, dots: usize, protocol: &Protocol) -> Result<Pattern> {
    let mut rng = ChaCha8Rng::seed_from_u64(PATTERN_SEED + dots as u64);
    rng.set_stream(index as u64);
    let separation = rng.random_range(0.2..0.55) * max_separation(dots);
    let start = random_pattern(dots, separation, &mut rng)?;
    let constraints = Constraints {
        min_separation_rad: separation,
        min_visible: 0,
        seam_margin_rad: 0.0,
        ..Constraints::default()
    };
    let steps = rng.random_range(4..60);
    match index % KINDS.len() {
        2 => {
            let suiting: Vec<ObjectiveName> = ObjectiveName::ALL
                .into_iter()
                .filter(|name| name.suits(dots))
                .collect();
            let name = suiting[index / KINDS.len() % suiting.len()];
            let objective = Objective::for_views(name, &[*protocol.view()], dots)?;
            descend(&start, &objective, &constraints, steps)
        }
        3 => descend(&start, &Charges, &constraints, steps),
        _ => Ok(start),
    }
}

fn row(index: usize, dots: usize, protocol: &Protocol, trials: u64) -> Result<Row> {
    let pattern = pattern(index, dots, protocol)?;
    let view = protocol.view();
    let value = |name| -> Result<f64> {
        let objective = Objective::for_views(name, &[*view], dots)?;
        Ok(objective.evaluate_at(pattern.dots())?.value)
    };
    let few = TooFewDots::of_view(view, dots)?
        .sharpened()
        .evaluate(pattern.dots());
    let likeness = match dots <= confusion::MAX_DOTS {
        true => Confusion::default().evaluate(pattern.dots()).value,
        false => f64::NAN,
    };
    let weights = [failure_rate::WEIGHT_GIVEN, failure_rate::WEIGHT_EACH];
    let [own, other] = match view.detection {
        Detection::Given { .. } => weights,
        Detection::Each { .. } => [weights[1], weights[0]],
    };
    let values = [
        value(ObjectiveName::MeanNn)?,
        value(ObjectiveName::WhitenedNn)?,
        likeness,
        few.value,
        few.value + own * likeness,
        few.value + other * likeness,
    ];
    let config = ValidationConfig {
        recognizer: RecognizerName::Robust,
        protocol: *protocol,
        seed: TRIAL_SEED,
        samples: trials,
    };
    let found = config.run(&Ball::new(pattern), &|_| {})?;
    Ok(Row {
        values,
        failures: 1.0 - found.validation.answered.rate,
        kind: index % KINDS.len(),
    })
}

#[derive(clap::Args)]
pub struct Args {
    /// Folder of scatter plots.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Numbers of dots.
    #[arg(long, num_args = 1.., default_values_t = [12, 16, 20])]
    dots: Vec<usize>,
    /// Protocols.
    #[arg(long, num_args = 1.., value_parser = str::parse::<ProtocolName>, default_values = ["sparse", "image", "clutter"])]
    protocols: Vec<ProtocolName>,
    /// Size of the protocol's noise over its usual size: with many dots hardly a view fails without more.
    #[arg(long, default_value_t = 1.0)]
    noise: f64,
    /// Patterns.
    #[arg(long, default_value_t = 32)]
    patterns: usize,
    /// Trials of a pattern.
    #[arg(long, default_value_t = 20_000)]
    trials: u64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        println!(
            "{} patterns (seed {PATTERN_SEED} + dots), {} trials each (seed {TRIAL_SEED})",
            self.patterns, self.trials
        );
        let headings = ["dots", "protocol", "failures %"].into_iter().chain(NAMES);
        let table = Table::new(headings);
        for &dots in &self.dots {
            for &name in &self.protocols {
                let standard = Protocol::standard(name);
                let sigma_rad = self.noise * standard.view().noise.sigma_rad();
                let protocol = standard.with_sigma_rad(sigma_rad);
                let rows: Result<Vec<Row>> = (0..self.patterns)
                    .into_par_iter()
                    .map(|index| row(index, dots, &protocol, self.trials))
                    .collect();
                let rows = rows?;
                let failures: Vec<f64> = rows.iter().map(|r| r.failures).collect();
                let worst = failures.iter().copied().fold(0.0, f64::max);
                let best = failures.iter().copied().fold(1.0, f64::min);
                let range = format!("{:.2} to {:.2}", 100.0 * best, 100.0 * worst);
                let cells = [0, 1, 2, 3, 4, 5].map(|k: usize| {
                    let values: Vec<f64> = rows.iter().map(|r| r.values[k]).collect();
                    correlation(&values, &failures)
                });
                row!(table; dots, name.as_str(), range; cells);
                self.plot(&rows, dots, name)?;
            }
        }
        Ok(())
    }

    fn plot(&self, rows: &[Row], dots: usize, protocol: ProtocolName) -> Result<()> {
        let Some(dir) = &self.out else { return Ok(()) };
        for (k, value) in NAMES
            .iter()
            .enumerate()
            .filter(|(k, _)| [0, 1, 4].contains(k))
        {
            let series = [1, 2, 3].map(|kind| LineSeries {
                name: KINDS[kind].into(),
                points: rows
                    .iter()
                    .filter(|r| r.kind.max(1) == kind)
                    .map(|r| (r.values[k], 100.0 * r.failures))
                    .collect(),
            });
            let path = dir.join(format!("objective_{value}.png"));
            scatter_plot(
                &path,
                &ScatterPlot {
                    title: format!(
                        "Does {value} predict failures? {} patterns of {dots} dots",
                        rows.len()
                    ),
                    x_label: (*value).into(),
                    y_label: format!("failures, {protocol} protocol, all views [%]"),
                    series: series.to_vec(),
                },
            )?;
        }
        Ok(())
    }
}
