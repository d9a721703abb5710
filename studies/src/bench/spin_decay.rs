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
use spindoe_studies::score::{mean, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

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
    pub fn run(&self) -> Outcome {
        let (trials, seed) = (self.trials, self.seed);
        println!("{trials} sequences a line, seed {seed}");
        let table = Table::new([
            "decay, 1/s",
            "spin, rps",
            "interval holds the truth",
            "half width, 1/s",
            "decay found",
            "left open",
            "rejected",
        ]);
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
                let given = answers.iter().flatten();
                let intervals: Vec<_> = given
                    .filter_map(DecayOutcome::determined)
                    .map(DecayFit::interval_per_s)
                    .collect();
                let is =
                    |of: fn(&DecayOutcome) -> bool| share(&answers, |a| a.as_ref().is_ok_and(of));
                row!(
                    table; decay_per_s, rps,
                    share(&intervals, |i| (i.low..=i.high).contains(&decay_per_s)),
                    figure(mean(&intervals, |i| 0.5 * (i.high - i.low)), 4, ""),
                    is(|a| a.found().is_some()), is(|a| a.determined().is_none()),
                    share(&answers, Result::is_err)
                );
            }
        }
        println!("\nOnly outliers:");
        let table = Table::new(["frames", "answered"]);
        for frames in [10, 20, 30, 60, 120] {
            let scenario = Scenario {
                frames,
                outliers: 1.0,
                ..Scenario::default()
            };
            let answers = answers(&scenario, 80.0, (seed, line), trials);
            line += 1;
            row!(table; frames, share(&answers, Result::is_ok));
        }
        Ok(())
    }
}
