//! What do the pixels of a frame show at most? Frames in all conditions by their number of *clear* dots, and how many
//! of them the whole estimator answers; beside them an oracle that is given the outline and the clear dots.
//!
//!     cargo run --release -p spindoe-studies -- detection-limit --help
//!
//! A dot is clear where it is to be found (not at the limb, not hidden) and its signal, by a filter that matches it, is at
//! least SIGNAL times the noise (8): contrast times the root of its area in pixels over the noise of a pixel, less what blur takes,
//! `1 / sqrt(1 + 4 b^2)` for a blur of `b` dot radii (a disc of radius `r` has the deviation `r / 2` along each axis).
//! Print, seams and the codec are not in it. The oracle's dots and outline are off by one percent of the ball's radius.

use std::error::Error;
use std::path::PathBuf;

use nalgebra::{Matrix2, Matrix3};
use rand::RngExt;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::camera::FrameOutcome;
use spindoe::stats::Proportion;
use spindoe::synth::dataset::frame_rng;
use spindoe::synth::signal::BallSignal;
use spindoe::synth::{Scene, SynthConfig};
use spindoe::vision::estimator::Outline;
use spindoe::vision::{
    BallCircle, Budget, DetectorName, DotDetection, Estimator, EstimatorConfig, FrameEstimate,
    Pixel, Prior,
};

/// Error of what the oracle is given, ball radii.
const ORACLE: f64 = 0.01;
/// The least numbers of clear dots of the table's rows.
const ROWS: [usize; 6] = [0, 3, 4, 5, 7, 9];

/// A frame's clear dots, and the outcome of the estimator and of the oracle.
struct Row {
    clear: usize,
    outcomes: [FrameOutcome; 2],
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Frames.
    #[arg(long, default_value_t = 1500)]
    frames: u64,
    /// Seed of the frames.
    #[arg(long, default_value_t = 13_900_001)]
    seed: u64,
    /// Signal of a clear dot, in standard deviations of the noise.
    #[arg(long, default_value_t = 8.0)]
    signal: f64,
    /// Pattern of the ball.
    #[arg(long, default_value = "designs/dots20/pattern.csv")]
    pattern: PathBuf,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let (count, seed, signal, path) = (self.frames, self.seed, self.signal, &self.pattern);
        let pattern = Pattern::read_csv(path)?;
        let detector = DetectorName::Cnn.build()?;
        let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
        let rows: Vec<spindoe::Result<Row>> = (0..count)
            .into_par_iter()
            .map_init(
                || estimator.workspace(),
                |ws, k| {
                    let mut rng = frame_rng(seed, k);
                    let scene = Scene::random(&pattern, &SynthConfig::default(), &mut rng)?;
                    let ball = scene.signal()?;
                    let mut found = FrameEstimate::default();
                    estimator.estimate(
                        &scene.render()?.image,
                        &Prior::default(),
                        &Budget::default(),
                        ws,
                        &mut found,
                    );
                    let mut given = oracle(&ball, signal, || rng.sample(StandardNormal));
                    estimator.identify_detections(ws, &mut given);
                    Ok(Row {
                        clear: given.dots.len(),
                        outcomes: [&found, &given].map(|f| FrameOutcome::of(f, &ball.rotation)),
                    })
                },
            )
            .collect();
        let rows = rows.into_iter().collect::<spindoe::Result<Vec<_>>>()?;
        println!(
            "{count} frames in all conditions, seed {seed}, {}, clear from {signal} times the noise on\n",
            path.display()
        );
        println!("| clear dots | frames | estimator: right | wrong | oracle: right | wrong |");
        println!("|---|---|---|---|---|---|");
        for (i, from) in ROWS.into_iter().enumerate() {
            let to = ROWS.get(i + 1).copied().unwrap_or(usize::MAX);
            let name = if to == usize::MAX {
                format!("{from} or more")
            } else {
                format!("{from} to {}", to - 1)
            };
            line(&name, rows.iter().filter(|r| (from..to).contains(&r.clear)));
        }
        line("all", rows.iter());
        Ok(())
    }
}

/// A frame with its clear dots and its outline, each a little off.
fn oracle(ball: &BallSignal, signal: f64, mut normal: impl FnMut() -> f64) -> FrameEstimate {
    let BallCircle { center, radius, .. } = ball.circle;
    let sigma = ORACLE * radius;
    let mut off = || sigma * normal();
    let outline = Outline {
        circle: BallCircle::new(
            Pixel {
                u: center.u + off(),
                v: center.v + off(),
            },
            radius + off(),
        ),
        covariance: Matrix3::from_diagonal_element(sigma * sigma),
    };
    let clear = ball
        .dots
        .iter()
        .filter(|dot| dot.truth.is_visible() && ball.strength(dot) >= signal);
    let dots = clear.map(|dot| DotDetection {
        pixel: Pixel {
            u: dot.truth.pixel.u + off(),
            v: dot.truth.pixel.v + off(),
        },
        covariance: Matrix2::from_diagonal_element(sigma * sigma),
        confidence: 0.95,
    });
    let dots = dots.collect();
    FrameEstimate::from_detections(outline, dots)
}

fn line<'a>(name: &str, rows: impl Iterator<Item = &'a Row>) {
    let rows: Vec<&Row> = rows.collect();
    let rate = |which: usize, of: fn(FrameOutcome) -> bool| {
        let hits = rows.iter().filter(|r| of(r.outcomes[which])).count();
        Proportion::new(hits as u64, rows.len() as u64)
    };
    println!(
        "| {name} | {} | {} | {} | {} | {} |",
        rows.len(),
        rate(0, FrameOutcome::is_right),
        rate(0, FrameOutcome::is_wrong),
        rate(1, FrameOutcome::is_right),
        rate(1, FrameOutcome::is_wrong)
    );
}
