//! What do the pixels of a frame show at most? Frames in all conditions by their number of *clear* dots, and how many
//! of them the whole estimator answers; beside them an oracle that is given the outline and the clear dots.
//!
//!     cargo run --release -p spindoe-studies -- detection-limit --help
//!
//! A dot is clear where it is to be found (not at the limb, not hidden) and its signal, by a filter that matches it, is at
//! least SIGNAL times the noise (8): contrast times the root of its area in pixels over the noise of a pixel, less what blur takes,
//! `1 / sqrt(1 + 4 b^2)` for a blur of `b` dot radii (a disc of radius `r` has the deviation `r / 2` along each axis).
//! Print, seams and the codec are not in it. The oracle's dots and outline are off by one percent of the ball's radius.

use std::path::PathBuf;

use nalgebra::{Matrix2, Matrix3};
use rand::RngExt;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::camera::FrameOutcome;
use spindoe::synth::Scene;
use spindoe::synth::dataset::frame_rng;
use spindoe::synth::signal::BallSignal;
use spindoe::vision::frame::Outline;
use spindoe::vision::{BallCircle, DotDetection, FrameEstimate, Pixel};
use spindoe_studies::frames::{DOTS20, Workspace, all_conditions, alone, estimator, workspaces};
use spindoe_studies::score::{bins, share};
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Error of what the oracle is given, ball radii.
const ORACLE: f64 = 0.01;
/// The least numbers of clear dots of the table's rows.
const ROWS: [f64; 6] = [0.0, 3.0, 4.0, 5.0, 7.0, 9.0];

/// A frame's clear dots, and the outcome of the estimator and of the oracle.
struct Seen {
    clear: usize,
    outcomes: [FrameOutcome; 2],
}

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
    #[arg(long, default_value = DOTS20)]
    pattern: PathBuf,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, seed, signal, path) = (self.frames, self.seed, self.signal, &self.pattern);
        let pattern = Pattern::read_csv(path)?;
        let estimator = estimator(&pattern)?;
        let ours = std::array::from_ref(&estimator);
        let set = all_conditions();
        let one = |ws: &mut Workspace, k: u64| {
            let mut rng = frame_rng(seed, k);
            let scene = Scene::random(&pattern, &set.config, &mut rng)?;
            let ball = scene.signal()?;
            let found = alone(&estimator, &scene.render()?.image, ws);
            let mut given = oracle(&ball, signal, || rng.sample(StandardNormal));
            estimator.identify_detections(ws, &mut given);
            Ok(Seen {
                clear: given.dots.len(),
                outcomes: [&found, &given].map(|f| FrameOutcome::of(f, &ball.rotation)),
            })
        };
        let seen = (0..count)
            .into_par_iter()
            .map_init(|| workspaces(ours), |ws, k| one(&mut ws[0], k));
        let seen: Vec<Seen> = seen.collect::<spindoe::Result<_>>()?;
        println!(
            "{count} frames in {}, seed {seed}, {}, clear from {signal} times the noise on",
            set.name,
            path.display()
        );
        let table = Table::new([
            "clear dots",
            "frames",
            "estimator: right",
            "wrong",
            "oracle: right",
            "wrong",
        ]);
        let line = |name: &str, some: &[&Seen]| {
            let rate = |k: usize, of: fn(FrameOutcome) -> bool| share(some, |s| of(s.outcomes[k]));
            let both = [0, 1]
                .map(|k| [FrameOutcome::is_right, FrameOutcome::is_wrong].map(|of| rate(k, of)));
            row!(table; name, some.len(); both.concat());
        };
        for bin in bins(&ROWS) {
            let some = seen.iter().filter(|s| bin.holds(s.clear as f64));
            line(&bin.counts(""), &some.collect::<Vec<_>>());
        }
        line("all", &seen.iter().collect::<Vec<_>>());
        Ok(())
    }
}

/// A frame with its clear dots and its outline, each a little off.
fn oracle(ball: &BallSignal, signal: f64, mut normal: impl FnMut() -> f64) -> FrameEstimate {
    let BallCircle { center, radius, .. } = ball.circle;
    let sigma = ORACLE * radius;
    let mut off = || sigma * normal();
    let outline = Outline::given(
        BallCircle::new(
            Pixel {
                u: center.u + off(),
                v: center.v + off(),
            },
            radius + off(),
        ),
        Matrix3::from_diagonal_element(sigma * sigma),
    );
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
        probability: 0.95,
    });
    let dots = dots.collect();
    FrameEstimate::from_detections(outline, dots)
}
