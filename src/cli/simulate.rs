//! `spindoe simulate`: orientations of a rotating ball, with known ground truth.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::error::{Error, Result};
use crate::files;
use crate::geometry::{Vec3, random_direction};
use crate::spin::orientations::Orientations;
use crate::spin::simulate::{Drops, Scenario, stream};

/// The pattern that a camera sees where none is given.
#[cfg(feature = "vision")]
const SHIPPED: &str = "dots20";

#[derive(Debug, Args)]
pub struct Arguments {
    /// Where to write the orientations, CSV (quaternion scalar first, pattern to camera).
    #[arg(short, long)]
    out: PathBuf,
    /// Spin at the first frame, revolutions per second [default: 50; with --camera at random from its
    /// range].
    #[arg(long, allow_negative_numbers = true)]
    rps: Option<f64>,
    /// Axis in the camera frame, X,Y,Z (x right, y up, z to the camera), of any length; at random
    /// where not given.
    #[arg(long, value_parser = vector, allow_hyphen_values = true, value_name = "X,Y,Z")]
    axis: Option<Vec3>,
    /// Number of frames.
    #[arg(long, default_value_t = 10)]
    frames: usize,
    /// Frames per second [default: 350, or the camera's].
    #[arg(long, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Noise of an orientation in degrees per axis [default: 2, or what the camera gives].
    #[arg(long, allow_negative_numbers = true)]
    sigma_deg: Option<f64>,
    /// Probability that an orientation is uniformly random [default: 0.07, or what the camera gives].
    #[arg(long, allow_negative_numbers = true)]
    outliers: Option<f64>,
    /// Probability that a frame is lost [default: 0, or what the camera gives].
    #[arg(long, allow_negative_numbers = true)]
    drops: Option<f64>,
    /// The camera, as for `spindoe advise`: frame rate, noise, outliers and lost frames are what it
    /// gives of --pattern in rendered frames.
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "CAMERA.toml")]
    camera: Option<PathBuf>,
    /// The ball's pattern (CSV, table or folder), for --camera [default: the shipped one of 20 dots].
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "PATTERN", requires = "camera")]
    pattern: Option<PathBuf>,
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

/// What holds where no flag says otherwise.
#[derive(Debug, Clone, Copy)]
struct Usual {
    rps: f64,
    fps: f64,
    sigma_deg: f64,
    outliers: f64,
    drops: f64,
}

impl Default for Usual {
    fn default() -> Self {
        Self {
            rps: 50.0,
            fps: 350.0,
            sigma_deg: 2.0,
            outliers: 0.07,
            drops: 0.0,
        }
    }
}

impl Arguments {
    fn usual(&self) -> Result<Usual> {
        #[cfg(feature = "vision")]
        if let Some(path) = &self.camera {
            return self.of_camera(path);
        }
        Ok(Usual::default())
    }

    /// What the camera gives of the pattern.
    #[cfg(feature = "vision")]
    fn of_camera(&self, path: &std::path::Path) -> Result<Usual> {
        use super::camera::{CAMERA_FRAMES, read_conditions};
        use super::output::Counter;
        use crate::camera::{CameraTrials, FrameRates};
        use crate::pattern::shipped_designs;
        use rand::RngExt as _;

        let conditions = read_conditions(path)?;
        let pattern = match &self.pattern {
            Some(path) => crate::ball::Ball::read(path)?.into_pattern(),
            None => {
                let shipped = shipped_designs()?;
                let usual = shipped.into_iter().find(|d| d.name == SHIPPED);
                usual
                    .ok_or_else(|| Error::Internal(format!("no design {SHIPPED}")))?
                    .pattern
            }
        };
        let trials = CameraTrials::new(conditions, self.seed);
        let counter = Counter::new(CAMERA_FRAMES, "frames");
        let outcomes = trials.frames(&pattern, 0..CAMERA_FRAMES, &|n| counter.add(n))?;
        counter.finish();
        let rates = FrameRates::of(&outcomes, self.seed);
        let answered = rates.right.rate + rates.wrong.rate;
        let [low, high] = conditions.rps;
        Ok(Usual {
            rps: low + (high - low) * stream(self.seed, 2).random::<f64>(),
            fps: conditions.fps,
            // The error is a rotation's angle: that of three axes.
            sigma_deg: rates.rms_error_deg / 3f64.sqrt(),
            outliers: rates.wrong.rate / answered.max(1e-9),
            drops: rates.unanswered.rate,
        })
    }

    fn scenario(&self, usual: &Usual) -> Result<Scenario> {
        let scenario = Scenario {
            frames: self.frames,
            fps: self.fps.unwrap_or(usual.fps),
            jitter: self.jitter,
            sigma_rad: self.sigma_deg.unwrap_or(usual.sigma_deg).to_radians(),
            outliers: self.outliers.unwrap_or(usual.outliers),
            drops: Drops::Probability(self.drops.unwrap_or(usual.drops)),
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
        super::output::unit(*axis)
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
    files::check_writable(&arguments.out)?;
    let usual = arguments.usual()?;
    let scenario = arguments.scenario(&usual)?;
    let rps = arguments.rps.unwrap_or(usual.rps);
    if !(rps >= 0.0 && rps.is_finite()) {
        let problem = format!("expected 0 or more, found {rps}");
        return Err(Error::argument("--rps", problem));
    }
    let spin = arguments.axis()? * (rps * std::f64::consts::TAU);
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
            "rps": rps,
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
