//! A family of patterns on the same rendered frames of one camera, each with the largest dots that its stencil
//! allows. The table of docs/measurements/camera.md comes from here.
//!
//!     cargo run --release -p spindoe-studies -- camera-family --help
//!
//! The camera is the default one of `spindoe advise`, before SURROUNDINGS (dark or any). Differences are
//! against the first pattern, on the same scenes.

use std::error::Error;
use std::path::PathBuf;

use spindoe::Pattern;
use spindoe::camera::{
    CameraConditions, CameraTrials, DotSize, FrameOutcome, FrameRates, Surroundings, paired,
};

/// Diameter of a table tennis ball, mm.
const BALL_MM: f64 = 40.0;
/// Normal quantile of 95 % intervals.
const Z: f64 = 1.96;

/// What surrounds the ball, from its name.
fn surroundings(name: &str) -> Result<Surroundings, String> {
    let mut all = Surroundings::ALL.into_iter();
    all.find(|s| s.as_str() == name)
        .ok_or_else(|| format!("expected dark or any, found \"{name}\""))
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Frames of a pattern.
    #[arg(long, default_value_t = 5000)]
    frames: u64,
    /// Seed of the scenes.
    #[arg(long, default_value_t = 15_500_001)]
    seed: u64,
    /// What surrounds the ball: dark or any.
    #[arg(long, default_value = "dark", value_parser = surroundings)]
    surroundings: Surroundings,
    /// Patterns, the first being the one that the others are compared with.
    #[arg(required = true, value_name = "PATTERN.csv")]
    patterns: Vec<PathBuf>,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let Args {
            frames,
            seed,
            surroundings,
            ..
        } = *self;
        println!("{frames} frames a pattern, seed {seed}, {surroundings:?}\n");
        println!(
            "| pattern | dots | diameter | right | wrong | unanswered | mean error | more right, points | error less by |\n\
         |---|---|---|---|---|---|---|---|---|"
        );
        let mut first: Option<Vec<FrameOutcome>> = None;
        for path in &self.patterns {
            let pattern = Pattern::read_csv(path)?;
            let usual = CameraConditions {
                surroundings,
                ..CameraConditions::default()
            };
            let size = DotSize::LargestHole { ball_mm: BALL_MM };
            let dot_diameter = size.of(&pattern, &usual)?;
            let trials = CameraTrials::new(usual, seed).with_dot_diameter(dot_diameter);
            let outcomes = trials.frames(&pattern, 0..frames, &|_| ())?;
            let rates = FrameRates::of(&outcomes, seed);
            let against = first.as_ref().map_or(String::from("| |"), |first| {
                let difference = paired(first, &outcomes);
                let [less, off] = error_less_by(first, &outcomes);
                format!(
                    "| {:+.2} [{:+.2}, {:+.2}] | {:.1} % [{:.1}, {:.1}] |",
                    100.0 * difference.difference,
                    100.0 * difference.low,
                    100.0 * difference.high,
                    100.0 * less,
                    100.0 * (less - off),
                    100.0 * (less + off)
                )
            });
            println!(
                "| {} | {} | {:.1} % | {} | {} | {} | {:.3} deg {against}",
                path.display(),
                pattern.len(),
                100.0 * dot_diameter,
                rates.right,
                rates.wrong,
                rates.unanswered,
                rates.mean_error_deg,
            );
            first.get_or_insert(outcomes);
        }
        Ok(())
    }
}

/// Share by which the mean error falls on frames that both answer rightly, and half of its interval.
fn error_less_by(first: &[FrameOutcome], other: &[FrameOutcome]) -> [f64; 2] {
    let error = |o: &FrameOutcome| match o {
        FrameOutcome::Answered { error_rad } if o.is_right() => Some(*error_rad),
        _ => None,
    };
    let both = first.iter().zip(other);
    let both: Vec<[f64; 2]> = both
        .filter_map(|(a, b)| Some([error(a)?, error(b)?]))
        .collect();
    let n = both.len() as f64;
    let mean = |k: usize| both.iter().map(|e| e[k]).sum::<f64>() / n;
    let (a, ratio) = (mean(0), mean(1) / mean(0));
    // The ratio's error by linear propagation.
    let squares = both.iter().map(|e| (e[1] - ratio * e[0]).powi(2));
    let sigma = (squares.sum::<f64>() / n).sqrt() / (a * n.sqrt());
    [1.0 - ratio, Z * sigma]
}
