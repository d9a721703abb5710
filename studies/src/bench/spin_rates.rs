//! Measures both spin estimators on simulated sequences and prints their rates and errors with
//! intervals.
//!
//!     cargo run --release -p spindoe-studies -- spin-rates --help
//!
//! Rates have Wilson's 95 % interval, other values 1.96 standard errors of their mean.

use std::time::Instant;

use rayon::prelude::*;
use spindoe::geometry::Vec3;
use spindoe::spin::alias::{AliasConfig, Alternative, alternatives};
use spindoe::spin::quatera::{QuateraConfig, QuateraEstimator};
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::simulate::{Drops, Scenario, Sequence};
use spindoe::spin::{Fit, SpinRejection};
use spindoe::validate::{Proportion, median};

#[path = "../../../tests/it/spin/bound.rs"]
mod bound;
use bound::SpinBound;

/// A spin is correct within this fraction of its magnitude.
const CORRECT: f64 = 0.2;
/// Half-width of a 95 % interval in standard errors.
const Z95: f64 = 1.96;

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
struct Outcome {
    robust: Answer,
    quatera: Answer,
    /// Expected squared error at the bound, (rad/s)^2; none where the correct frames do not
    /// determine a spin.
    bound: Option<f64>,
    /// Probability of a correct vector at the bound.
    allowed: f64,
}

/// What is asked for.
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
    /// Measures and prints.
    pub fn run(&self) {
        let Args { sequences, seed } = *self;
        println!("{sequences} sequences a line, seed {seed}; vector or magnitude within 20 %");
        for line in lines() {
            let outcomes = measure(&line, seed, sequences);
            print(&line, &outcomes);
        }
        for jitter in [0.0, 0.05, 0.1, 0.2] {
            measure_aliases(jitter, seed, sequences);
        }
        for frames in [3, 4, 5, 7, 10, 20, 50] {
            measure_strays(frames, seed, sequences);
        }
        time(seed);
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

fn measure(line: &Line, seed: u64, sequences: u64) -> Vec<Outcome> {
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
            Outcome {
                robust: evaluate(robust.fit(&sequence.measurements), &sequence),
                quatera: evaluate(quatera.fit(&sequence.measurements), &sequence),
                bound: bound.map(|b| b.mean_square()),
                allowed: bound.map_or(0.0, |b| b.probability_within(CORRECT * truth.norm())),
            }
        })
        .collect()
}

fn evaluate(fit: Result<Fit, SpinRejection>, sequence: &Sequence) -> Answer {
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

/// Mean and its 95 % half-width.
fn mean(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let variance = values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, Z95 * (variance / n).sqrt())
}

fn print(line: &Line, outcomes: &[Outcome]) {
    println!("{}", line.name);
    for (method, answer) in [
        ("quatera", (|o| o.quatera) as fn(&Outcome) -> Answer),
        ("robust ", |o| o.robust),
    ] {
        let rate = |error: fn(&Answer) -> f64| {
            let correct = outcomes
                .iter()
                .filter(|o| error(&answer(o)) < CORRECT)
                .count();
            Proportion::new(correct as u64, outcomes.len() as u64)
        };
        let mut magnitudes: Vec<f64> = outcomes.iter().map(|o| answer(o).magnitude).collect();
        let rejected = magnitudes.iter().filter(|m| m.is_infinite()).count();
        println!(
            "  {method}  vector {}  magnitude {}  median magnitude error {:.3} %  rejected {rejected}",
            rate(|a| a.vector),
            rate(|a| a.magnitude),
            100.0 * median(&mut magnitudes),
        );
    }
    let (allowed, half) = mean(outcomes.iter().map(|o| o.allowed));
    println!(
        "  bound    vector {:.2} % +- {:.2}",
        100.0 * allowed,
        100.0 * half
    );
    let good = || {
        let correct = outcomes.iter().filter(|o| o.robust.vector < CORRECT);
        correct.filter_map(|o| Some((o.robust, o.bound?)))
    };
    let (square, half) = mean(good().map(|(a, _)| a.square));
    let (bound, _) = mean(good().map(|(_, b)| b));
    let ratio = (square / bound).sqrt();
    let (variance, spread) = mean(good().filter_map(|(a, _)| a.normalized));
    println!(
        "  robust, correct ones: RMS error / bound {ratio:.3} +- {:.3}, variance of normalized errors \
         {variance:.3} +- {spread:.3}",
        0.5 * ratio * half / square,
    );
}

/// Spins of 200 to 300 rps at 350 frames per second, searched up to 350 rps: how often the estimate
/// is correct, and how often the truth is the estimate or listed as its equal.
fn measure_aliases(jitter: f64, seed: u64, sequences: u64) {
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
    let rate = |pick: fn(&(bool, bool)) -> bool| {
        let successes = found.iter().filter(|f| pick(f)).count();
        Proportion::new(successes as u64, sequences)
    };
    println!(
        "200-300 rps, searched to 350, times off the even grid by {jitter} intervals: correct {}, correct or \
         reported as a tie {}",
        rate(|f| f.0),
        rate(|f| f.1)
    );
}

/// How often random orientations yield a spin.
fn measure_strays(frames: usize, seed: u64, sequences: u64) {
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
    let rate = Proportion::new(accepted, sequences);
    println!("{frames} random orientations pass for a spin: {rate}");
}

/// Median times of a fit on one thread, over the standard scenario's whole range.
fn time(seed: u64) {
    let scenario = Scenario::default();
    let sequences: Vec<Sequence> = (0..2000)
        .map(|i| scenario.sequence((1.0, 170.0), seed, i))
        .collect();
    let mut robust = RobustEstimator::new(SpinConfig::default());
    let mut quatera = QuateraEstimator::new(QuateraConfig::default());
    let mut medians = [0.0; 2];
    for (slot, median_us) in medians.iter_mut().enumerate() {
        let mut times: Vec<f64> = sequences
            .iter()
            .map(|s| {
                let start = Instant::now();
                let fit = match slot {
                    0 => robust.fit(&s.measurements),
                    _ => quatera.fit(&s.measurements),
                };
                let spent = start.elapsed();
                std::hint::black_box(fit).ok();
                1e6 * spent.as_secs_f64()
            })
            .collect();
        *median_us = median(&mut times);
    }
    println!(
        "ten frames, one thread: robust median {:.1} us, quatera median {:.1} us",
        medians[0], medians[1]
    );
}
