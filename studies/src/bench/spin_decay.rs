//! Coverage of the interval of a spin's decay, and the rate of false decays.
//!
//! For each spin and each decay the program simulates sequences of 0.6 s at 350 frames per second
//! (2 deg of noise per axis, 7 % outliers) and counts the answers: a decay, a constant spin with an
//! interval, a constant spin with an undetermined decay, and no answer. Coverage is the share of
//! all intervals that contain the true decay.
//!
//!     cargo run --release -p spindoe-studies -- spin-decay --help

use rayon::prelude::*;
use spindoe::spin::SpinRejection;
use spindoe::spin::decay::{DecayFit, DecayOutcome, fit_decay};
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::simulate::Scenario;
use spindoe::validate::Proportion;

/// Spins, revolutions per second.
const SPINS_RPS: [f64; 11] = [0.0, 0.05, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0, 80.0, 140.0, 170.0];
/// Rates of decay, 1/s: none, that of a table-tennis ball in air, and much more.
const DECAYS_PER_S: [f64; 3] = [0.0, 0.091, 0.5];
/// Frames of a sequence, 0.6 s.
const FRAMES: usize = 210;

type Answer = Result<DecayOutcome, SpinRejection>;

/// The answers to the sequences of one row of the table; no two rows share their noise.
fn answers(scenario: &Scenario, rps: f64, (seed, line): (u64, u64), trials: u64) -> Vec<Answer> {
    let answer = |i| {
        let sequence = scenario.sequence((rps, rps), seed, line * trials + i);
        fit_decay(&sequence.measurements, &SpinConfig::default())
    };
    (0..trials).into_par_iter().map(answer).collect()
}

/// A share with its Wilson 95 % interval, percent.
fn percent(count: usize, of: usize) -> String {
    if of == 0 {
        return "-".into();
    }
    let p = Proportion::new(count as u64, of as u64);
    format!(
        "{:.1} [{:.1}, {:.1}]",
        100.0 * p.rate,
        100.0 * p.low,
        100.0 * p.high
    )
}

fn row(decay: f64, answers: &[Answer]) -> String {
    let total = answers.len();
    let given = || answers.iter().flatten();
    let decaying = given().filter(|a| a.found().is_some());
    let intervals: Vec<_> = given()
        .filter_map(DecayOutcome::determined)
        .map(DecayFit::interval_per_s)
        .collect();
    let inside = intervals
        .iter()
        .filter(|i| i.low <= decay && decay <= i.high);
    let widths = intervals.iter().map(|i| 0.5 * (i.high - i.low));
    let half_width = widths.sum::<f64>() / intervals.len().max(1) as f64;
    let open = given().count() - intervals.len();
    format!(
        "{} | {} | {} | {} | {}",
        percent(inside.count(), intervals.len()),
        half_width_text(half_width, intervals.len()),
        percent(decaying.count(), total),
        percent(open, total),
        percent(total - given().count(), total),
    )
}

fn half_width_text(half_width: f64, intervals: usize) -> String {
    match intervals {
        0 => "-".into(),
        _ => format!("{half_width:.4}"),
    }
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Sequences of a line.
    #[arg(long, default_value_t = 1000)]
    trials: u64,
    /// Seed of the sequences.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Args {
    /// Measures and prints.
    pub fn run(&self) {
        let Args { trials, seed } = *self;
        println!("{trials} sequences a line, seed {seed}; percent with Wilson 95 % intervals\n");
        println!(
            "| decay, 1/s | spin, rps | interval holds the truth | half width, 1/s | decay found | left open | rejected |"
        );
        println!("|---|---|---|---|---|---|---|");
        let mut line = 0;
        for decay_per_s in DECAYS_PER_S {
            let scenario = Scenario {
                frames: FRAMES,
                decay_per_s,
                ..Scenario::default()
            };
            for rps in SPINS_RPS {
                let answers = answers(&scenario, rps, (seed, line), trials);
                line += 1;
                println!("| {decay_per_s} | {rps} | {} |", row(decay_per_s, &answers));
            }
        }
        println!("\nOnly outliers:\n\n| frames | answered |\n|---|---|");
        for frames in [10, 20, 30, 60, 120] {
            let scenario = Scenario {
                frames,
                outliers: 1.0,
                ..Scenario::default()
            };
            let answers = answers(&scenario, 80.0, (seed, line), trials);
            line += 1;
            let answered = answers.iter().flatten().count();
            println!("| {frames} | {} |", percent(answered, answers.len()));
        }
    }
}
