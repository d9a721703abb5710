//! A robot's latency: after how many frames does a tracker know the spin to 5 %, and does its covariance say so from the second frame on?
//!
//! Rendered clips in good conditions (balls of 60 px on the optical axis, a camera without intrinsics, exposures of 0.2 ms) are followed by
//! [`Tracker::update`] from the first frame on, with spins about any axis. A spin counts as good where the vector is off by less than 5 % of its
//! length; a clip counts from the frame on after which all are. The squared Mahalanobis distance from the truth is compared with chi-squared with three degrees of
//! freedom.
//!
//!     cargo run --release -p spindoe-studies -- first-spin --help

use std::f64::consts::TAU;
use std::sync::Arc;

use rayon::prelude::*;
use spindoe::clip::{Tracker, TrackerConfig};
use spindoe::geometry::random_direction;
use spindoe::pattern::Pattern;
use spindoe::stats::Proportion;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthSequence, frame_rng};
use spindoe::vision::Estimator;
use spindoe_studies::frames::{DOTS20, estimator, good_conditions};
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Frames per second, and spins in revolutions per second.
const FPS: [f64; 3] = [60.0, 120.0, 350.0];
const RPS: [f64; 3] = [10.0, 50.0, 120.0];
/// What is good, as a part of the spin.
const GOOD: f64 = 0.05;
/// Numbers of frames after which is looked.
const AFTER: [usize; 6] = [2, 3, 4, 6, 8, 12];
/// 95 % of chi-squared with three degrees of freedom lie below.
const CHI2_95: f64 = 7.815;
/// Share of the clips that must know the spin.
const MOST: f64 = 0.95;
/// Exposure of a frame, s: at 120 rps a ball turns by 9 degrees.
const EXPOSURE_S: f64 = 2e-4;

#[derive(clap::Args)]
pub struct Args {
    /// Clips of each rate and spin.
    #[arg(long, default_value_t = 100)]
    clips: u64,
    /// Seed of the clips.
    #[arg(long, default_value_t = 65_700_001)]
    seed: u64,
}

/// What a tracker says after a frame: the spin's error as a part of it, and its squared distance in deviations.
type Said = Option<(f64, Option<f64>)>;

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let estimator = Arc::new(estimator(&pattern)?);
        println!("{} clips each, seed {}, {DOTS20}", self.clips, self.seed);
        let mut all = Vec::new();
        for fps in FPS {
            for rps in RPS {
                let clips: Vec<Vec<Said>> = (0..self.clips)
                    .into_par_iter()
                    .map(|k| follow(&pattern, &estimator, fps, rps, self.seed + k))
                    .collect::<spindoe::Result<_>>()?;
                all.push((fps, rps, clips));
            }
        }
        let after = AFTER.map(|n| format!("after {n} frames"));
        let heads = |words: &[&str]| -> Vec<String> {
            let words = words.iter().map(ToString::to_string);
            words.chain(after.clone()).collect()
        };
        let mut names = heads(&["frames a second", "rps", "turns a frame"]);
        names.extend(["frames for 95 %".into(), "ms".into()]);
        let table = Table::new(names);
        for (fps, rps, clips) in &all {
            let good = |n: &usize| is(clips, *n, |(error, _)| error < GOOD);
            let needed = (1..=last()).find(|n| {
                let stays = |said: &&Vec<Said>| {
                    said[n - 1..]
                        .iter()
                        .all(|s| s.is_some_and(|(e, _)| e < GOOD))
                };
                clips.iter().filter(stays).count() as f64 >= MOST * clips.len() as f64
            });
            let ms = needed.map(|n| format!("{:.0}", 1e3 * (n - 1) as f64 / fps));
            row!(table; *fps, *rps, format!("{:.2}", rps / fps); AFTER.iter().map(good); [needed.map(|n| n.to_string()), ms]);
        }
        println!("\nSpins within the region of 95 % that their covariance states:");
        let table = Table::new(heads(&["frames a second", "rps"]));
        for (fps, rps, clips) in all.iter().filter(|(fps, rps, _)| 2.0 * rps < *fps) {
            let within = |n: &usize| {
                let said = clips.iter().filter_map(|said| said[n - 1]?.1);
                let distances: Vec<f64> = said.collect();
                let inside = distances.iter().filter(|d| **d < CHI2_95).count();
                Proportion::new(inside as u64, distances.len() as u64)
            };
            row!(table; *fps, *rps; AFTER.iter().map(within));
        }
        Ok(())
    }
}

fn last() -> usize {
    AFTER[AFTER.len() - 1]
}

/// The share of all clips of which a spin after so many frames is so.
fn is(clips: &[Vec<Said>], after: usize, so: impl Fn((f64, Option<f64>)) -> bool) -> Proportion {
    let found = clips.iter().filter(|said| said[after - 1].is_some_and(&so));
    Proportion::new(found.count() as u64, clips.len() as u64)
}

/// What a tracker says after each frame of a clip.
fn follow(
    pattern: &Pattern,
    estimator: &Arc<Estimator>,
    fps: f64,
    rps: f64,
    seed: u64,
) -> spindoe::Result<Vec<Said>> {
    let config = SynthConfig {
        max_off_axis_rad: 0.0,
        parallel_share: 0.0,
        ..good_conditions().config
    };
    // A stream of its own, beside those of the frames.
    let spin = random_direction(&mut frame_rng(seed, u64::MAX)) * (TAU * rps);
    let timing = ClipConfig {
        fps,
        spin: Some(spin.into()),
        exposure_s: Some(EXPOSURE_S),
        ..ClipConfig::default()
    };
    let sequence = SynthSequence::random(pattern, &config, &timing, seed, last())?;
    let mut tracker = Tracker::new(Arc::clone(estimator), TrackerConfig::default())?;
    let said = (0..last()).map(|k| {
        let frame = sequence.frame(k)?;
        let time_s = frame.truth.time_s.unwrap_or_default();
        let state = tracker.update(&frame.image, time_s, None)?;
        Ok(state.spin.as_ref().ok().map(|fit| {
            let off = fit.motion.spin - spin;
            let inverse = fit.spin_covariance.and_then(|c| c.try_inverse());
            (
                off.norm() / spin.norm(),
                inverse.map(|i| off.dot(&(i * off))),
            )
        }))
    });
    said.collect()
}
