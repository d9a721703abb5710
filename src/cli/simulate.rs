//! `spindoe simulate`: orientations of a rotating ball, with known ground truth.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::error::{Error, Result};
use crate::geometry::{Vec3, random_direction};
use crate::spin::orientations::Orientations;
use crate::spin::simulate::{Drops, Scenario, stream};

#[derive(Debug, Args)]
pub struct Arguments {
    /// Where to write the orientations, CSV (quaternion scalar first, pattern to camera).
    #[arg(short, long)]
    out: PathBuf,
    /// Spin at the first frame, revolutions per second.
    #[arg(long, default_value_t = 50.0, allow_negative_numbers = true)]
    rps: f64,
    /// Axis in the camera frame, X,Y,Z (x right, y up, z to the camera), of any length; at random
    /// where not given.
    #[arg(long, value_parser = vector, allow_hyphen_values = true, value_name = "X,Y,Z")]
    axis: Option<Vec3>,
    /// Number of frames.
    #[arg(long, default_value_t = 10)]
    frames: usize,
    /// Frames per second.
    #[arg(long, default_value_t = 350.0, allow_negative_numbers = true)]
    fps: f64,
    /// Noise of an orientation in degrees per axis.
    #[arg(long, default_value_t = 2.0, allow_negative_numbers = true)]
    sigma_deg: f64,
    /// Probability that an orientation is uniformly random.
    #[arg(long, default_value_t = 0.07, allow_negative_numbers = true)]
    outliers: f64,
    /// Probability that a frame is lost.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    drops: f64,
    /// Standard deviation of a frame's (known) time about the even grid, in intervals; at most a
    /// third of an interval.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    jitter: f64,
    /// Rate of decay of the spin, 1/s.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    decay: f64,
    /// Seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print the truth as one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn scenario(&self) -> Result<Scenario> {
        let scenario = Scenario {
            frames: self.frames,
            fps: self.fps,
            jitter: self.jitter,
            sigma_rad: self.sigma_deg.to_radians(),
            outliers: self.outliers,
            drops: Drops::Probability(self.drops),
            decay_per_s: self.decay,
        };
        scenario.check()?;
        Ok(scenario)
    }

    /// The given axis, or one drawn from its own stream.
    fn axis(&self) -> Result<Vec3> {
        let Some(axis) = &self.axis else {
            return Ok(random_direction(&mut stream(self.seed, 1)));
        };
        axis.try_normalize(0.0)
            .ok_or_else(|| Error::argument("--axis", "expected a vector that is not 0"))
    }
}

/// Three finite numbers separated by commas.
pub(super) fn vector(text: &str) -> std::result::Result<Vec3, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|n| n.trim().parse().ok().filter(|x: &f64| x.is_finite()))
        .collect();
    match (numbers.as_slice(), text.split(',').count()) {
        ([x, y, z], 3) => Ok(Vec3::new(*x, *y, *z)),
        _ => Err("expected three finite numbers X,Y,Z".into()),
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let scenario = arguments.scenario()?;
    if !(arguments.rps >= 0.0 && arguments.rps.is_finite()) {
        let problem = format!("expected 0 or more, found {}", arguments.rps);
        return Err(Error::argument("--rps", problem));
    }
    let spin = arguments.axis()? * (arguments.rps * std::f64::consts::TAU);
    let sequence = scenario.simulate(spin, &mut stream(arguments.seed, 0));
    let mut file = Orientations::from_measurements(&sequence.measurements);
    for row in &mut file.rows {
        // The simulator knows which orientations are correct; a reader must not. Lost frames leave
        // gaps in the names, as with cameras.
        row.confidence = None;
        row.frame = ((row.time_s * scenario.fps).round() as i64).to_string();
    }
    file.write_csv(&arguments.out)?;
    let outliers = sequence.outlier.iter().filter(|o| **o).count();
    let orientations = sequence.measurements.len();
    if arguments.json {
        return super::print_json(&json!({
            "spin_rad_s": [spin.x, spin.y, spin.z],
            "rps": arguments.rps,
            "decay_per_s": arguments.decay,
            "time_s": sequence.truth.time_s,
            "orientations": orientations,
            "outliers": outliers,
            "seed": arguments.seed,
        }));
    }
    outln!(
        "{}: {orientations} orientations, {outliers} of them outliers; spin [{:.4}, {:.4}, {:.4}] \
         rad/s at 0 s (seed {})",
        arguments.out.display(),
        spin.x,
        spin.y,
        spin.z,
        arguments.seed
    );
    Ok(())
}
