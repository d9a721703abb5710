//! Time-stamped orientations of a rotating ball.

use clap::Args;
use serde_json::json;

use super::Arguments;
use crate::error::Result;
use crate::files;
use crate::geometry::random_direction;
use crate::spin::orientations::Orientations;
use crate::spin::simulate::{Drops, Scenario, stream};

/// Rendered frames of a camera: its noise is known by them to 4 %, the shares of wrong and lost frames to 3 points at most.
#[cfg(feature = "vision")]
const SEEN_FRAMES: u64 = 250;

/// Settings of simulated orientations.
#[derive(Debug, Args)]
pub struct ScenarioArguments {
    /// Noise of an orientation in degrees per axis [default: 2, or what the camera gives].
    #[arg(long, hide = true, allow_negative_numbers = true)]
    orientation_sigma_deg: Option<f64>,
    /// Probability that an orientation is uniformly random [default: 0.07, or what the camera gives].
    #[arg(long, hide = true, allow_negative_numbers = true)]
    outliers: Option<f64>,
    /// Probability that a frame is lost [default: 0, or what the camera gives].
    #[arg(long, hide = true, allow_negative_numbers = true)]
    drops: Option<f64>,
    /// Standard deviation of a frame's (known) time about the even grid, in intervals; at most a third of an interval.
    #[arg(
        long,
        hide = true,
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    jitter: f64,
    /// Rate of decay of the spin, 1/s.
    #[arg(
        long,
        hide = true,
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    decay_per_s: f64,
}

/// What holds where nothing else is given.
struct Usual {
    rps: f64,
    scenario: Scenario,
}

impl Arguments {
    fn usual(&self) -> Result<Usual> {
        #[cfg(feature = "vision")]
        if let Some(camera) = &self.camera {
            return self.of_camera(camera);
        }
        Ok(Usual {
            rps: 50.0,
            scenario: Scenario::default(),
        })
    }

    /// What the camera gives of the pattern.
    #[cfg(feature = "vision")]
    fn of_camera(&self, camera: &crate::cli::camera::CameraSource) -> Result<Usual> {
        use crate::camera::{CameraTrials, FrameRates};
        use crate::cli::output::Counter;
        use rand::RngExt as _;

        let conditions = camera.conditions()?;
        let ball = self.ball()?;
        let trials = CameraTrials::new(conditions, self.seed);
        let counter = Counter::new(SEEN_FRAMES, "frames");
        let outcomes = trials.frames(ball.pattern(), 0..SEEN_FRAMES, &|n| counter.add(n))?;
        counter.finish();
        let rates = FrameRates::of(&outcomes, self.seed);
        if rates.right.successes == 0 {
            let problem = format!("of {SEEN_FRAMES} frames of this pattern it answers none right");
            return Err(crate::error::Error::argument("camera", problem));
        }
        let answered = rates.right.rate + rates.wrong.rate;
        let [low, high] = conditions.rps;
        Ok(Usual {
            rps: low + (high - low) * stream(self.seed, 2).random::<f64>(),
            scenario: Scenario {
                fps: conditions.fps,
                // The error is a rotation's angle: that of three axes.
                sigma_rad: rates.rms_error_deg.to_radians() / 3f64.sqrt(),
                outliers: rates.wrong.rate / answered.max(1e-9),
                drops: Drops::Probability(rates.unanswered.rate),
                ..Scenario::default()
            },
        })
    }

    fn scenario(&self, usual: Scenario) -> Result<Scenario> {
        let own = &self.scenario;
        let scenario = Scenario {
            frames: self.frames.unwrap_or(usual.frames),
            fps: self.fps.unwrap_or(usual.fps),
            jitter: own.jitter,
            sigma_rad: own
                .orientation_sigma_deg
                .map_or(usual.sigma_rad, f64::to_radians),
            outliers: own.outliers.unwrap_or(usual.outliers),
            drops: own.drops.map_or(usual.drops, Drops::Probability),
            decay_per_s: own.decay_per_s,
        };
        scenario.check()?;
        Ok(scenario)
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let path = arguments.file()?;
    files::check_writable(path)?;
    let seed = arguments.seed;
    let usual = arguments.usual()?;
    let scenario = arguments.scenario(usual.scenario)?;
    let rps = arguments.one_rps()?.unwrap_or(usual.rps);
    let axis = arguments.unit_axis()?;
    // An axis that is not given has a stream of its own.
    let axis = axis.unwrap_or_else(|| random_direction(&mut stream(seed, 1)));
    let spin = axis * (rps * std::f64::consts::TAU);
    let sequence = scenario.simulate(spin, &mut stream(seed, 0));
    let mut file = Orientations::from_measurements(&sequence.measurements);
    for row in &mut file.rows {
        // The simulator knows which orientations are correct; a reader must not. Lost frames leave
        // gaps in the names, as with cameras.
        row.confidence = None;
        row.frame = ((row.time_s * scenario.fps).round() as i64).to_string();
    }
    file.write_csv(path)?;
    let outliers = sequence.outlier.iter().filter(|o| **o).count();
    let orientations = sequence.measurements.len();
    if arguments.json {
        return crate::cli::print_json(&json!({
            "output": path.to_string_lossy(),
            "spin_rad_s": [spin.x, spin.y, spin.z],
            "rps": rps,
            "decay_per_s": scenario.decay_per_s,
            "time_s": sequence.truth.time_s,
            "orientations": orientations,
            "outliers": outliers,
            "seed": seed,
        }));
    }
    outln!(
        "{}: {orientations} orientations, {outliers} of them outliers; spin [{:.4}, {:.4}, {:.4}] \
         rad/s at 0 s (seed {seed})",
        path.display(),
        spin.x,
        spin.y,
        spin.z
    );
    Ok(())
}
