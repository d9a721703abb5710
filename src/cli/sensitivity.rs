//! `spindoe sensitivity`: how the rates depend on noise and on the paper's alpha.

use std::path::PathBuf;

use clap::Args;

#[cfg(feature = "vision")]
use super::camera::CameraArguments;
use super::output::{Counter, one_of};
use super::print_json;
use crate::ball::Ball;
use crate::error::Result;
use crate::files::{self, Replacement};
use crate::report::reject_design;
use crate::validate::{SensitivityConfig, sensitivity, sensitivity_csv};
use crate::view::{Protocol, ProtocolName};

#[derive(Debug, Args)]
#[command(after_help = "\
Writes sensitivity.csv, sensitivity_sigma.png and sensitivity_alpha.png.
With any flag of a camera it writes instead sensitivity.csv with what that camera would answer, one of its
properties varied at a time: pixels, exposure, noise, blur, dots.

Examples:
  spindoe sensitivity pattern.csv -o sweep --protocol clutter --samples 5000
  spindoe sensitivity pattern.csv -o sweep --camera camera.toml --samples 500")]
pub struct Arguments {
    /// The pattern: its CSV (unit vectors x,y,z), a table (.npz), or the folder of a design or calibration.
    #[arg(value_name = "PATTERN")]
    input: PathBuf,
    /// The folder to write to.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Protocol of the views [default: paper].
    #[arg(long, value_parser = one_of(&ProtocolName::ALL, ProtocolName::as_str))]
    protocol: Option<ProtocolName>,
    /// Trials per point; with a camera, frames [default: 2000, with a camera 200].
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// Seed of the trials.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Noise levels in degrees, for both recognizers.
    #[arg(long, value_name = "S,S,...", value_delimiter = ',', num_args = 0..,
          default_values_t = SensitivityConfig::default().sigmas_deg)]
    sigmas_deg: Vec<f64>,
    /// Values of alpha, for the paper's recognizer at the protocol's own noise.
    #[arg(long, value_name = "A,A,...", value_delimiter = ',', num_args = 0..,
          default_values_t = SensitivityConfig::default().alphas)]
    alphas: Vec<f64>,
    /// Print the points as one JSON array.
    #[arg(long)]
    json: bool,
    #[cfg(feature = "vision")]
    #[command(flatten)]
    camera: CameraArguments,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let ball = Ball::read(&arguments.input)?;
    #[cfg(feature = "vision")]
    if arguments.camera.is_stated() {
        return before_camera(arguments, &ball);
    }
    let config = SensitivityConfig {
        sigmas_deg: arguments.sigmas_deg.clone(),
        alphas: arguments.alphas.clone(),
        samples: arguments.samples.unwrap_or(2_000),
        seed: arguments.seed,
    };
    let dir = &arguments.output;
    reject_design(dir, "choose another folder")?;
    let set = Replacement::begin(dir)?;
    let protocol = Protocol::standard(arguments.protocol.unwrap_or(ProtocolName::Paper));
    let count = 2 * config.sigmas_deg.len() + config.alphas.len();
    let counter = Counter::new(count as u64, "points");
    let points = sensitivity(&ball, &protocol, &config, &mut |p| {
        let v = &p.result.validation;
        counter.line(&format!(
            "{} {:>6}  {:<6}  identity {}  orientation {}",
            p.parameter.as_str(),
            p.value,
            p.result.recognizer,
            v.identity,
            v.orientation
        ));
        counter.add(1);
    })?;
    counter.finish();
    let csv = sensitivity_csv(&points);
    files::write_bytes(&set.path().join("sensitivity.csv"), csv.as_bytes())?;
    #[cfg(feature = "plot")]
    crate::report::plots::sensitivity_plots(set.path(), &points)?;
    set.publish(&[], &[], "sensitivity.csv")?;
    if arguments.json {
        return print_json(&points);
    }
    outln!("{}", dir.display());
    Ok(())
}

/// Frames of a camera for each point where none are stated.
#[cfg(feature = "vision")]
const POINT_FRAMES: u64 = 200;

/// The rates before the stated camera, and before others that differ from it in one property.
#[cfg(feature = "vision")]
fn before_camera(arguments: &Arguments, ball: &Ball) -> Result<()> {
    use crate::camera::{CameraPoint, CameraSweep, sweep_csv};
    use crate::error::Error;

    let usual = SensitivityConfig::default();
    for (is_given, flag) in [
        (arguments.protocol.is_some(), "protocol"),
        (arguments.sigmas_deg != usual.sigmas_deg, "sigmas-deg"),
        (arguments.alphas != usual.alphas, "alphas"),
    ] {
        if is_given {
            return Err(Error::argument(flag, "cannot be used with a camera"));
        }
    }
    let conditions = arguments.camera.conditions()?;
    let sweep = CameraSweep::around(&conditions);
    let dir = &arguments.output;
    let set = Replacement::begin(dir)?;
    let frames = arguments.samples.unwrap_or(POINT_FRAMES);
    let total = frames.saturating_mul(sweep.cameras.len() as u64);
    let counter = Counter::new(total, "frames");
    let each = &mut |p: &CameraPoint| {
        counter.line(&format!(
            "{:<13} {:>8.3}  right {}  wrong {}  {:.3} deg",
            p.parameter.as_str(),
            p.value,
            p.frames.right,
            p.frames.wrong,
            p.frames.mean_error_deg
        ));
    };
    let done = |n| counter.add(n);
    let points = sweep.run(ball.pattern(), arguments.seed, frames, each, &done)?;
    counter.finish();
    let csv = sweep_csv(&points);
    files::write_bytes(&set.path().join("sensitivity.csv"), csv.as_bytes())?;
    set.publish(&[], &[], "sensitivity.csv")?;
    if arguments.json {
        return print_json(&points);
    }
    outln!("{}", dir.display());
    Ok(())
}
