//! A family of patterns on the same rendered frames of one camera, each with the largest dots that its stencil
//! allows. The table of docs/measurements/camera.md comes from here.
//!
//!     cargo run --release -p spindoe-studies -- camera-family --help
//!
//! The camera is the default one of `spindoe advise`, before SURROUNDINGS (dark or any). Differences are
//! against the first pattern, on the same scenes.

use spindoe::camera::{
    CameraConditions, CameraTrials, DotSize, FrameOutcome, Surroundings, paired,
};
use spindoe_studies::frames::Patterns;
use spindoe_studies::score::{RATES, rates, ratio};
use spindoe_studies::table::{Cell, Table, figure, interval, signed};
use spindoe_studies::{Outcome, row};

/// Diameter of a table tennis ball, mm.
const BALL_MM: f64 = 40.0;

/// What surrounds the ball, from its name.
fn surroundings(name: &str) -> Result<Surroundings, String> {
    let mut all = Surroundings::ALL.into_iter();
    all.find(|s| s.as_str() == name)
        .ok_or_else(|| format!("expected dark or any, found \"{name}\""))
}

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
    #[command(flatten)]
    patterns: Patterns,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (frames, seed, surroundings) = (self.frames, self.seed, self.surroundings);
        println!(
            "{frames} frames a pattern, seed {seed}, surroundings: {}",
            surroundings.as_str()
        );
        let headings = ["pattern", "dots", "diameter"].into_iter().chain(RATES);
        let table = Table::new(headings.chain(["more right, points", "error less by"]));
        let usual = CameraConditions {
            surroundings,
            ..CameraConditions::default()
        };
        let mut first: Option<Vec<FrameOutcome>> = None;
        for (name, pattern) in self.patterns.read()? {
            let size = DotSize::LargestHole { ball_mm: BALL_MM };
            let dot_diameter = size.of(&pattern, &usual)?;
            let trials = CameraTrials::new(usual, seed).with_dot_diameter(dot_diameter);
            let outcomes = trials.frames(&pattern, 0..frames, &|_| ())?;
            let against = first.as_ref().map(|first| {
                let more = paired(first, &outcomes);
                let [more, low, high] = [more.difference, more.low, more.high].map(|x| 100.0 * x);
                [
                    signed(more, [low, high], 2),
                    error_less_by(first, &outcomes),
                ]
            });
            let diameter = figure(100.0 * dot_diameter, 1, "%");
            row!(
                table; name, pattern.len(), diameter;
                rates(&outcomes); against.into_iter().flatten()
            );
            first.get_or_insert(outcomes);
        }
        Ok(())
    }
}

/// Share by which the mean error falls on frames that both answer rightly.
fn error_less_by(first: &[FrameOutcome], other: &[FrameOutcome]) -> Cell {
    let error = |o: &FrameOutcome| match o {
        FrameOutcome::Answered { error_rad } if o.is_right() => Some(*error_rad),
        _ => None,
    };
    let both = first.iter().zip(other);
    let both = both.filter_map(|(a, b)| Some([error(b)?, error(a)?]));
    let (ratio, [low, high]) = ratio(&both.collect::<Vec<_>>());
    let [less, low, high] = [ratio, high, low].map(|x| 100.0 * (1.0 - x));
    interval(less, [low, high], 1, "%")
}
