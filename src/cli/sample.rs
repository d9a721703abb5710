//! `spindoe sample`: a pattern, its table, and a clip of a spinning ball, to try the estimator on.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::output::Counter;
use crate::ball::Ball;
use crate::error::{Result, require};
use crate::files::{self, Replacement};
use crate::geometry::Vec3;
use crate::pattern::Pattern;
use crate::synth::SynthConfig;
use crate::synth::dataset::{ClipConfig, Sequence};
use crate::synth::folder::{self, Masks, Origin};

/// The shipped pattern of 20 dots.
const PATTERN: &str = include_str!("../../designs/dots20/pattern.csv");
/// Frames per second, as in the SpinDOE paper.
const FPS: f64 = 350.0;
/// The spin's axis, camera frame: topspin with some sidespin, seen from the side.
const AXIS: [f64; 3] = [0.28, -0.93, 0.23];
/// Exposure, s: short enough that dots stay round at the default spin.
const EXPOSURE_S: f64 = 2e-4;

#[derive(Debug, Args)]
#[command(after_help = "\
The folder holds pattern.csv, table.npz, clip/images/*.png (the names are times in nanoseconds) and clip/truth.json.

Example:
  spindoe sample
  spindoe estimate --table sample/table.npz sample -o orientations.csv --report estimate.html
  spindoe spin orientations.csv")]
pub struct Arguments {
    /// The folder to write to.
    #[arg(short, long = "out", value_name = "DIR", default_value = "sample")]
    out: PathBuf,
    /// Number of frames.
    #[arg(long, value_name = "N", default_value_t = 24)]
    frames: usize,
    /// Spin, revolutions per second.
    #[arg(long, default_value_t = 40.0, allow_negative_numbers = true)]
    rps: f64,
    /// Seed of camera, light and noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments {
        frames, seed, rps, ..
    } = *arguments;
    require((2..=1000).contains(&frames), "frames", "2 to 1000", frames)?;
    let inside = rps.is_finite() && (0.0..=150.0).contains(&rps);
    require(inside, "rps", "0 to 150", rps)?;
    let dir = &arguments.out;
    let taken = ["pattern.csv", "table.npz", "clip"];
    files::reject_taken(dir, &taken, "a sample", "choose another folder")?;
    let set = Replacement::begin(dir)?;
    let pattern = Pattern::from_csv("pattern.csv".as_ref(), PATTERN.as_bytes())?;
    pattern.write_csv(&set.path().join("pattern.csv"))?;
    Ball::new(pattern.clone()).write_npz(&set.path().join("table.npz"))?;
    // The camera looks at the ball: the estimator, which sees crops, takes it so.
    let config = SynthConfig {
        max_off_axis_rad: 0.0,
        ..SynthConfig::good()
    };
    let spin = Vec3::from(AXIS).normalize() * (rps * std::f64::consts::TAU);
    let motion = ClipConfig {
        fps: FPS,
        spin: Some(spin.into()),
        exposure_s: Some(EXPOSURE_S),
        drift_px: None,
    };
    let sequence = Sequence::random(&pattern, &config, &motion, seed, frames)?;
    let origin = Origin {
        seed,
        pattern_sha256: pattern.sha256(),
        pattern: pattern.dots().iter().map(|d| (*d).into()).collect(),
        config,
        sequence: Some(motion),
    };
    let counter = Counter::new(frames as u64, "frames");
    let clip = set.path().join("clip");
    files::create_dir(&clip)?;
    let draw = |k| sequence.frame(k);
    folder::write(&clip, origin, frames, Masks::Omit, draw, |done| {
        counter.set(done as u64);
    })?;
    counter.finish();
    set.publish(&[], &[], "clip")?;
    if arguments.json {
        return super::print_json(&json!({
            "out": dir.to_string_lossy(),
            "frames": frames,
            "fps": FPS,
            "seed": seed,
            "rps": rps,
            "spin_rad_s": [spin.x, spin.y, spin.z],
        }));
    }
    outln!(
        "{frames} frames at {FPS} per second of a ball that spins at {rps} rps about [{:.4}, {:.4}, {:.4}]",
        AXIS[0] / Vec3::from(AXIS).norm(),
        AXIS[1] / Vec3::from(AXIS).norm(),
        AXIS[2] / Vec3::from(AXIS).norm()
    );
    outln!("{}", dir.display());
    Ok(())
}
