//! Does the confusion objective order patterns of any number of dots as trials do?
//!
//! `cargo run --release -p spindoe-studies --bin confusion_ranks -- [PATTERNS] [TRIALS] [DOTS...]`
//!
//! For each number of dots: patterns as in `objective_study`, half of them at random with different
//! minimum separations, half after a few descent steps on an objective that takes turns. Each is
//! measured by the robust recognizer in the `image` protocol, with a smaller ball and more missed dots
//! the more dots there are: otherwise hardly a pattern fails. A trial counts with one minus the
//! recognizer's probability of its rotation, which has the failure rate as its mean (calibrated), and
//! less scatter than counting. Printed are the rank correlations (Spearman) of the objective with it
//! and with the counted failures, the rank correlation that two halves of the trials have with each
//! other, the median ratio of the objective to the rate, and the time of an evaluation.

use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::design::scp::descend;
use spindoe::design::{Constraints, Objective, ObjectiveName};
use spindoe::pattern::{Pattern, random_pattern};
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::validate::{
    Noise, ORIENTATION_FAILURE_RAD, Protocol, ProtocolName, TrialResult, run_trials,
};
use spindoe::{Error, Result};

/// Seeds: of the patterns, and of the trials. Neither is used by any design.
const PATTERN_SEED: u64 = 2_026_011;
const TRIAL_SEED: u64 = 2_026_012;

/// One pattern's objective and what trials measure.
struct Row {
    objective: f64,
    ms: f64,
    counted: f64,
    expected: f64,
    /// Of the trials of even and of odd number.
    halves: [f64; 2],
}

/// The `image` protocol with views in which so many dots fail now and then.
fn protocol(dots: usize) -> Protocol {
    let (radius_px, miss_probability) = match dots {
        ..=16 => (15.0, 0.2),
        17..=20 => (15.0, 0.3),
        21..=24 => (15.0, 0.4),
        25..=32 => (15.0, 0.5),
        _ => (12.0, 0.6),
    };
    Protocol {
        noise: Noise::Pixel {
            sigma_px: 1.0,
            radius_px,
        },
        miss_probability,
        ..Protocol::standard(ProtocolName::Image)
    }
}

fn pattern(index: usize, dots: usize, protocol: &Protocol) -> Result<Pattern> {
    let mut rng = ChaCha8Rng::seed_from_u64(PATTERN_SEED);
    rng.set_stream((100 * index + dots) as u64);
    let widest = (28.0 * (20.0 / dots as f64).sqrt()).min(30.0);
    let separation = rng.random_range(0.4 * widest..widest).to_radians();
    let start = random_pattern(dots, separation, &mut rng)?;
    if index.is_multiple_of(2) {
        return Ok(start);
    }
    let objective = Objective::for_protocol(ObjectiveName::ALL[index / 2 % 3], protocol);
    let constraints = Constraints {
        min_separation_rad: separation,
        min_visible: 2,
        seam_margin_rad: 0.0,
        ..Constraints::default()
    };
    descend(&start, &objective, &constraints, rng.random_range(2..15))
}

fn row(index: usize, dots: usize, trials: u64) -> Result<Row> {
    let protocol = protocol(dots);
    let pattern = pattern(index, dots, &protocol)?;
    let robust = RobustRecognizer::new(&pattern, protocol.recognizer_config())?;
    let results = run_trials(&pattern, &robust, &protocol, TRIAL_SEED, trials)?;
    let (mut counted, mut judged) = (0.0, 0.0f64);
    let mut halves = [[0.0, 0.0f64]; 2];
    for (k, result) in results.iter().enumerate() {
        if let TrialResult::Judged {
            error_rad,
            pose_confidence,
            ..
        } = result
        {
            judged += 1.0;
            counted += f64::from(u8::from(*error_rad >= ORIENTATION_FAILURE_RAD));
            let [sum, count] = &mut halves[k % 2];
            *sum += 1.0 - pose_confidence;
            *count += 1.0;
        }
    }
    let clock = Instant::now();
    let objective = Objective::for_protocol(ObjectiveName::Confusion, &protocol);
    let value = objective.evaluate_at(pattern.dots())?.value;
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    Ok(Row {
        objective: value,
        ms,
        counted: counted / judged.max(1.0),
        expected: (halves[0][0] + halves[1][0]) / judged.max(1.0),
        halves: halves.map(|[sum, count]| sum / count.max(1.0)),
    })
}

/// Ranks from 0, ties at their mean.
fn ranks(values: &[f64]) -> Vec<f64> {
    let rank = |value: &f64| {
        let below = values.iter().filter(|v| *v < value).count();
        let same = values.iter().filter(|v| *v == value).count();
        below as f64 + 0.5 * (same - 1) as f64
    };
    values.iter().map(rank).collect()
}

fn spearman(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (ranks(a), ranks(b));
    let mean = 0.5 * (a.len() as f64 - 1.0);
    let product = |x: &[f64], y: &[f64]| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum()
    };
    product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt()
}

fn main() -> Result<()> {
    let numbers: Result<Vec<usize>> = std::env::args()
        .skip(1)
        .map(|text| {
            text.parse().map_err(|_| {
                Error::argument("arguments", format!("expected a number, found {text:?}"))
            })
        })
        .collect();
    let numbers = numbers?;
    let patterns = numbers.first().copied().unwrap_or(200);
    let trials = numbers.get(1).copied().unwrap_or(4_000);
    let dots = numbers.get(2..).filter(|d| !d.is_empty());
    println!("{patterns} patterns each (seed {PATTERN_SEED}), {trials} trials (seed {TRIAL_SEED})");
    for &dots in dots.unwrap_or(&[16, 20, 24, 32, 48]) {
        let rows: Result<Vec<Row>> = (0..patterns)
            .into_par_iter()
            .map(|index| row(index, dots, trials as u64))
            .collect();
        let rows = rows?;
        let column = |of: &dyn Fn(&Row) -> f64| -> Vec<f64> { rows.iter().map(of).collect() };
        let objective = column(&|r| r.objective);
        let mut ratios = column(&|r| r.objective / r.expected);
        let [even, odd] = [0, 1].map(|half| column(&|r| r.halves[half]));
        println!(
            "{dots} dots: {:+.3} with expected failures, {:+.3} with counted ones; halves of the trials {:+.3}; \
             failures {:.2} %; objective over rate {:.2}; {:.1} ms",
            spearman(&objective, &column(&|r| r.expected)),
            spearman(&objective, &column(&|r| r.counted)),
            spearman(&even, &odd),
            100.0 * spindoe::stats::median(&mut column(&|r| r.counted)),
            spindoe::stats::median(&mut ratios),
            spindoe::stats::median(&mut column(&|r| r.ms)),
        );
    }
    Ok(())
}
