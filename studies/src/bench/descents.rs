//! The methods of a descent beside each other: from the same starts, under the constraints of a design, how low each
//! comes, what the patterns are worth and what they cost.
//!
//!     cargo run --release -p spindoe-studies -- descents --help

use cpu_time::ThreadTime;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::Result;
use spindoe::ball::Ball;
use spindoe::design::descent::{Cost, Descent};
use spindoe::design::{DescentMethod, DesignConfig, DesignRequest, ObjectiveName};
use spindoe::pattern::random_pattern;
use spindoe::stats::Proportion;
use spindoe::validate::ValidationConfig;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Seeds: of the starts, and of the trials. Neither is used by any design.
const START_SEED: u64 = 2_026_011;
const TRIAL_SEED: u64 = 2_026_012;

#[derive(clap::Args)]
pub struct Args {
    /// Numbers of dots.
    #[arg(long, num_args = 1.., default_values_t = [12, 16, 20, 28, 40, 64])]
    dots: Vec<usize>,
    /// Objective; by default that of a design of so many dots.
    #[arg(long, value_parser = str::parse::<ObjectiveName>)]
    objective: Option<ObjectiveName>,
    /// Starts.
    #[arg(long, default_value_t = 20)]
    starts: u64,
    /// Evaluations of a descent.
    #[arg(long, default_value_t = 80)]
    steps: u64,
    /// Trials of a pattern.
    #[arg(long, default_value_t = 5_000)]
    trials: u64,
}

/// Sums over the starts of one method.
#[derive(Default)]
struct Sums {
    cost: f64,
    seconds: f64,
    met: u64,
    right: u64,
    trials: u64,
    best: f64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        println!(
            "{} starts (seed {START_SEED}), {} evaluations, {} trials of all views each (seed {TRIAL_SEED})",
            self.starts, self.steps, self.trials
        );
        let table = Table::new([
            "dots",
            "method",
            "cost, mean",
            "constraints met",
            "right, all views",
            "best start, failures %",
            "seconds a descent",
        ]);
        for &dots in &self.dots {
            let request = DesignRequest {
                dots: Some(dots),
                objective: self.objective,
                dot_diameter_mm: (dots > 32).then_some(2.5),
                ..DesignRequest::default()
            };
            let config = request.config()?;
            for method in DescentMethod::ALL {
                let sums = self.of(&config, method)?;
                let n = self.starts as f64;
                row!(
                    table;
                    dots,
                    method.as_str(),
                    format!("{:.4}", sums.cost / n),
                    format!("{} of {}", sums.met, self.starts),
                    Proportion::new(sums.right, sums.trials),
                    format!("{:.2}", 100.0 * (1.0 - sums.best)),
                    format!("{:.2}", sums.seconds / n)
                );
            }
        }
        Ok(())
    }

    fn of(&self, config: &DesignConfig, method: DescentMethod) -> Outcome<Sums> {
        let one: Result<Vec<Sums>> = (0..self.starts)
            .into_par_iter()
            .map(|stream| self.one(config, method, stream))
            .collect();
        Ok(one?.into_iter().fold(Sums::default(), |a, b| Sums {
            cost: a.cost + b.cost,
            seconds: a.seconds + b.seconds,
            met: a.met + b.met,
            right: a.right + b.right,
            trials: a.trials + b.trials,
            best: a.best.max(b.best),
        }))
    }

    /// A descent from one start; its seconds are of its own thread.
    fn one(&self, config: &DesignConfig, method: DescentMethod, stream: u64) -> Result<Sums> {
        let objective = config.objective.clone().sharpened();
        let mut rng = ChaCha8Rng::seed_from_u64(START_SEED);
        rng.set_stream(stream);
        let separation = 0.7 * config.constraints.min_separation_rad;
        let start = random_pattern(config.dots, separation, &mut rng)?;
        let clock = ThreadTime::now();
        let descent = Descent {
            method,
            ..Descent::of_steps(self.steps)
        };
        let found = descent.run(&start, &objective, &config.constraints)?;
        let mut sums = Sums {
            seconds: clock.elapsed().as_secs_f64(),
            cost: Cost::cost(&objective, found.dots())?.value,
            met: u64::from(config.constraints.missed(&found).is_none()),
            ..Sums::default()
        };
        let ball = Ball::new(found);
        for &protocol in &config.protocols {
            let part = ValidationConfig {
                protocol,
                seed: TRIAL_SEED,
                samples: self.trials / config.protocols.len() as u64,
                ..ValidationConfig::default()
            };
            let answered = part.run(&ball, &|_| {})?.validation.answered;
            sums.right += answered.successes;
            sums.trials += answered.trials;
        }
        sums.best = sums.right as f64 / sums.trials as f64;
        Ok(sums)
    }
}
