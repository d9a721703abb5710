//! Measures both spin estimators on simulated sequences and prints their rates and errors with
//! intervals.
//!
//!     cargo run --release -p spindoe-studies -- spin-rates --help
//!
//! Rates have Wilson's 95 % interval, other values 1.96 standard errors of their mean.

use rayon::prelude::*;
use spindoe::geometry::Vec3;
use spindoe::spin::alias::{AliasConfig, Alternative, alternatives};
use spindoe::spin::quatera::{QuateraConfig, QuateraEstimator};
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::simulate::{Drops, Scenario, SimulatedSequence};
use spindoe::spin::{Fit, SpinRejection};
use spindoe::stats::Proportion;
use spindoe_studies::score::share;
use spindoe_studies::table::{Cell, Table, figure, interval};
use spindoe_studies::{Outcome, row};

#[path = "../../../tests/it/spin/bound.rs"]
mod bound;
use bound::SpinBound;

/// A spin is correct within this fraction of its magnitude.
const CORRECT: f64 = 0.2;

/// One line of the table.
struct Line {
    name: &'static str,
    scenario: Scenario,
    /// Magnitudes, uniform, revolutions per second.
    rps: (f64, f64),
}

/// One method's answer to one sequence.
#[derive(Clone, Copy)]
struct Answer {
    /// Length of the error vector over the true magnitude; infinite for a rejection.
    vector: f64,
    /// Error of the magnitude over the true magnitude; infinite for a rejection.
    magnitude: f64,
    /// Squared length of the error vector, (rad/s)^2.
    square: f64,
    /// Squared Mahalanobis length of the error over 3, where the method states a covariance.
    normalized: Option<f64>,
}

/// One sequence's answers and its bound.
struct Judged {
    robust: Answer,
    quatera: Answer,
    /// Expected squared error at the bound, (rad/s)^2; none where the correct frames do not
    /// determine a spin.
    bound: Option<f64>,
    /// Probability of a correct vector at the bound.
    allowed: f64,
}

#[derive(clap::Args)]
pub struct Args {
    /// Sequences of a line.
    #[arg(long, default_value_t = 10_000)]
    sequences: u64,
    /// Seed of the sequences.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (sequences, seed) = (self.sequences, self.seed);
        println!("{sequences} sequences a line, seed {seed}; right within 20 %");
        let rates = Table::new([
            "sequences",
            "method",
            "vector right",
            "the bound allows",
            "magnitude right",
            "median error of the magnitude",
            "rejected",
        ]);
        let measured = lines()
            .into_iter()
            .map(|line| (measure(&line, seed, sequences), line));
        let measured: Vec<(Vec<Judged>, Line)> = measured.collect();
        for (judged, line) in &measured {
            print_rates(&rates, line.name, judged);
        }
        println!("\nErrors of the right answers of `robust`:");
        let errors = Table::new([
            "sequences",
            "RMS error over the bound",
            "variance of the normalized errors",
        ]);
        for (judged, line) in &measured {
            print_errors(&errors, line.name, judged);
        }
        println!("\nSpins of 200 to 300 rps at 350 frames per second, searched up to 350 rps:");
        let table = Table::new([
            "times off the even grid, intervals",
            "right",
            "right, or listed as an equal",
        ]);
        for jitter in [0.0, 0.05, 0.1, 0.2] {
            row!(table; jitter; aliases(jitter, seed, sequences));
        }
        println!("\nOnly random orientations:");
        let table = Table::new(["frames", "a spin is reported"]);
        for frames in [3, 4, 5, 7, 10, 20, 50] {
            row!(table; frames, strays(frames, seed, sequences));
        }
        Ok(())
    }
}

fn lines() -> Vec<Line> {
    let standard = Scenario::default();
    let bands = [
        ("1-10 rps", (1.0, 10.0)),
        ("10-50 rps", (10.0, 50.0)),
        ("50-100 rps", (50.0, 100.0)),
        ("100-140 rps", (100.0, 140.0)),
        ("140-170 rps", (140.0, 170.0)),
    ];
    let mut lines: Vec<Line> = bands
        .map(|(name, rps)| Line {
            name,
            scenario: standard,
            rps,
        })
        .into();
    lines.push(Line {
        name: "30 % outliers, 12 frames, 10-170 rps",
        scenario: Scenario {
            frames: 12,
            outliers: 0.3,
            ..standard
        },
        rps: (10.0, 170.0),
    });
    for (name, frames, drops) in [
        ("5 of 10 frames missing, 10-80 rps", 10, Drops::Keep(5)),
        ("10 of 20 frames missing, 10-80 rps", 20, Drops::Keep(10)),
        // Fewer than three frames remain of ten in 5.5 %, of twenty in 0.02 %.
        (
            "each of 10 frames missing with p = 1/2, 10-80 rps",
            10,
            Drops::Probability(0.5),
        ),
        (
            "each of 20 frames missing with p = 1/2, 10-80 rps",
            20,
            Drops::Probability(0.5),
        ),
    ] {
        lines.push(Line {
            name,
            scenario: Scenario {
                frames,
                drops,
                ..standard
            },
            rps: (10.0, 80.0),
        });
    }
    lines
}

fn measure(line: &Line, seed: u64, sequences: u64) -> Vec<Judged> {
    let estimators = || {
        (
            RobustEstimator::new(SpinConfig::default()),
            QuateraEstimator::new(QuateraConfig::default()),
        )
    };
    (0..sequences)
        .into_par_iter()
        .map_init(estimators, |(robust, quatera), i| {
            let sequence = line.scenario.sequence(line.rps, seed, i);
            let truth = sequence.truth.spin;
            let sigma = line.scenario.sigma_rad;
            let correct = |k: usize| !sequence.outlier[k];
            let bound = SpinBound::of(&truth, &sequence.measurements, sigma, correct);
            Judged {
                robust: evaluate(robust.fit(&sequence.measurements), &sequence),
                quatera: evaluate(quatera.fit(&sequence.measurements), &sequence),
                bound: bound.map(|b| b.mean_square()),
                allowed: bound.map_or(0.0, |b| b.probability_within(CORRECT * truth.norm())),
            }
        })
        .collect()
}

fn evaluate(fit: Result<Fit, SpinRejection>, sequence: &SimulatedSequence) -> Answer {
    let truth = sequence.truth.spin;
    let Ok(fit) = fit else {
        return Answer {
            vector: f64::INFINITY,
            magnitude: f64::INFINITY,
            square: f64::INFINITY,
            normalized: None,
        };
    };
    let error = fit.motion.spin - truth;
    let solved = fit
        .spin_covariance
        .and_then(|c| Some(c.cholesky()?.solve(&error).dot(&error) / 3.0));
    Answer {
        vector: error.norm() / truth.norm(),
        magnitude: (fit.motion.spin.norm() / truth.norm() - 1.0).abs(),
        square: error.norm_squared(),
        normalized: solved,
    }
}

/// Mean and half the width of its 95 % interval.
fn mean(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let variance = values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, 1.96 * (variance / n).sqrt())
}

/// A value with the interval of this half width.
fn within((value, half): (f64, f64), decimals: usize, unit: &str) -> Cell {
    interval(value, [value - half, value + half], decimals, unit)
}

/// What a method answered.
type Answered = fn(&Judged) -> Answer;
const METHODS: [(&str, Answered); 2] = [("`quatera`", |o| o.quatera), ("`robust`", |o| o.robust)];

fn print_rates(table: &Table, name: &str, judged: &[Judged]) {
    let (allowed, half) = mean(judged.iter().map(|o| 100.0 * o.allowed));
    for (method, answer) in METHODS {
        let rate = |error: fn(Answer) -> f64| share(judged, |o| error(answer(o)) < CORRECT);
        // A rejection counts as the largest error.
        let mut magnitudes: Vec<f64> = judged.iter().map(|o| answer(o).magnitude).collect();
        row!(
            table; name, method, rate(|a| a.vector), within((allowed, half), 2, "%"),
            rate(|a| a.magnitude),
            figure(100.0 * spindoe::stats::median(&mut magnitudes), 3, "%"),
            share(judged, |o| answer(o).magnitude.is_infinite())
        );
    }
}

fn print_errors(table: &Table, name: &str, judged: &[Judged]) {
    let right = judged.iter().filter(|o| o.robust.vector < CORRECT);
    let right = right.filter_map(|o| Some((o.robust, o.bound?)));
    let (square, half) = mean(right.clone().map(|(a, _)| a.square));
    let (bound, _) = mean(right.clone().map(|(_, b)| b));
    let ratio = (square / bound).sqrt();
    let normalized = mean(right.filter_map(|(a, _)| a.normalized));
    let ratio = (ratio, 0.5 * ratio * half / square);
    row!(table; name, within(ratio, 3, ""), within(normalized, 3, ""));
}

/// Spins of 200 to 300 rps at 350 frames per second, searched up to 350 rps: how often the estimate
/// is correct, and how often the truth is the estimate or listed as its equal.
fn aliases(jitter: f64, seed: u64, sequences: u64) -> [Proportion; 2] {
    let scenario = Scenario {
        jitter,
        ..Scenario::default()
    };
    let options = SpinConfig {
        max_rps: 350.0,
        ..SpinConfig::default()
    };
    let found: Vec<(bool, bool)> = (0..sequences)
        .into_par_iter()
        .map_init(
            || RobustEstimator::new(options),
            |robust, i| {
                let sequence = scenario.sequence((200.0, 300.0), seed, i);
                let truth = sequence.truth.spin;
                let near = |spin: &Vec3| (spin - truth).norm() < CORRECT * truth.norm();
                let Ok(fit) = robust.fit(&sequence.measurements) else {
                    return (false, false);
                };
                let others = alternatives(&sequence.measurements, &fit, &AliasConfig::default());
                let equal = |a: &Alternative| a.log_likelihood_ratio.abs() < 1.0 && near(&a.spin);
                let correct = near(&fit.motion.spin);
                (correct, correct || others.iter().any(equal))
            },
        )
        .collect();
    [share(&found, |f| f.0), share(&found, |f| f.1)]
}

/// How often random orientations yield a spin.
fn strays(frames: usize, seed: u64, sequences: u64) -> Proportion {
    let scenario = Scenario {
        frames,
        outliers: 1.0,
        ..Scenario::default()
    };
    let accepted = (0..sequences)
        .into_par_iter()
        .map_init(
            || RobustEstimator::new(SpinConfig::default()),
            |robust, i| {
                let sequence = scenario.sequence((10.0, 100.0), seed, i);
                u64::from(robust.fit(&sequence.measurements).is_ok())
            },
        )
        .sum();
    Proportion::new(accepted, sequences)
}
