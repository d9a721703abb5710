//! `spindoe validate`: measures how often a pattern is identified correctly.

use std::path::PathBuf;

use clap::Args;

#[cfg(feature = "vision")]
use super::camera::{CAMERA_FRAMES, CameraArguments, print_frames};
use super::output::{Counter, one_of};
use super::print_json;
use crate::ball::Ball;
use crate::error::{Error, Result};
use crate::files;
use crate::recognize::RecognizerName;
use crate::recognize::observed::{self, observed_frames};
use crate::validate::{NamedValidation, ValidationConfig};
use crate::view::{Protocol, ProtocolName};

#[derive(Debug, Args)]
#[command(after_help = "\
Protocols (a view is a rotation uniform on SO(3)):
  paper    all dots with z > 0, noise of 3 deg: the SpinDOE paper's own test
  sparse   four of the dots with z > 1/3, noise of 3 deg: the hardest to identify
  clutter  noise of 5 deg, 20 % of the dots missed, two false dots
  image    noise of 1 px per axis on a ball of 30 px radius, 10 % missed, one false dot
With any flag of a camera the views are instead frames of that camera, rendered and read by the whole
estimator: some 10 ms each, in any surroundings some 50.

Views with too few dots are counted as skipped, never as failures or successes.

Examples:
  spindoe validate pattern.csv
  spindoe validate table.npz --protocol sparse --recognizer paper --json
  spindoe validate table.npz --ball-px 45 --exposure-ms 0.3")]
pub struct Arguments {
    /// The pattern: its CSV (unit vectors x,y,z), a table (.npz), or the folder of a design or calibration.
    #[arg(value_name = "PATTERN")]
    input: PathBuf,
    /// Protocol of the views [default: paper].
    #[arg(long, value_parser = one_of(&ProtocolName::ALL, ProtocolName::as_str))]
    protocol: Option<ProtocolName>,
    /// Number of trials; with a camera, of frames [default: 10000, with a camera 1000].
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// Noise of a dot in degrees, instead of the protocol's own.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    sigma_deg: Option<f64>,
    /// Seed of the trials.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The recognizer to validate.
    #[arg(long, value_parser = one_of(&RecognizerName::ALL, RecognizerName::as_str), default_value_t = RecognizerName::Robust)]
    recognizer: RecognizerName,
    /// Also write the views' dots to this file, as `spindoe identify` reads them; frames are named
    /// trial-0, trial-1, ..., skipped views are left out.
    #[arg(long, value_name = "DOTS.csv")]
    dump: Option<PathBuf>,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
    #[cfg(feature = "vision")]
    #[command(flatten)]
    camera: CameraArguments,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments
        .dump
        .iter()
        .try_for_each(|path| files::check_writable(path))?;
    let ball = Ball::read(&arguments.input)?;
    #[cfg(feature = "vision")]
    if arguments.camera.is_stated() {
        return before_camera(arguments, &ball);
    }
    let mut protocol = Protocol::standard(arguments.protocol.unwrap_or(ProtocolName::Paper));
    if let Some(sigma) = arguments.sigma_deg {
        protocol = protocol.with_sigma_rad(sigma.to_radians());
    }
    let samples = arguments.samples.unwrap_or(10_000);
    let config = ValidationConfig {
        recognizer: arguments.recognizer,
        protocol,
        seed: arguments.seed,
        samples,
    };
    let counter = Counter::new(samples, "trials");
    let found = config.run(&ball, &|trials| counter.add(trials))?;
    counter.finish();
    if let Some(path) = &arguments.dump {
        let view = config.protocol.view();
        let frames = observed_frames(ball.pattern(), view, config.seed, samples);
        files::write_bytes(path, observed::to_csv(&frames).as_bytes())?;
    }
    if found.validation.identity.trials == 0 {
        let problem = format!(
            "expected views that show enough dots, but all {samples} have fewer than the protocol needs"
        );
        return Err(Error::argument("pattern", problem));
    }
    if arguments.json {
        return print_json(&found);
    }
    print_words(&found);
    Ok(())
}

/// The rates before the stated camera.
#[cfg(feature = "vision")]
fn before_camera(arguments: &Arguments, ball: &Ball) -> Result<()> {
    use crate::camera::{CameraTrials, FrameRates};

    for (is_given, flag) in [
        (arguments.protocol.is_some(), "protocol"),
        (arguments.sigma_deg.is_some(), "sigma-deg"),
        (arguments.dump.is_some(), "dump"),
        (arguments.recognizer != RecognizerName::Robust, "recognizer"),
    ] {
        if is_given {
            return Err(Error::argument(flag, "cannot be used with a camera"));
        }
    }
    let conditions = arguments.camera.conditions()?;
    let trials = CameraTrials::new(conditions, arguments.seed);
    let frames = arguments.samples.unwrap_or(CAMERA_FRAMES);
    let counter = Counter::new(frames, "frames");
    let outcomes = trials.frames(ball.pattern(), 0..frames, &|n| counter.add(n))?;
    counter.finish();
    let found = FrameRates::of(&outcomes, arguments.seed);
    if arguments.json {
        return print_json(&serde_json::json!({ "conditions": conditions, "frames": found }));
    }
    print_frames(&found);
    Ok(())
}

fn print_words(found: &NamedValidation) {
    let v = &found.validation;
    outln!(
        "protocol {}, recognizer {}, noise {:.3} deg, {} trials of seed {}; {} skipped for too few dots",
        v.protocol,
        found.recognizer,
        v.sigma_deg,
        v.samples,
        v.seed,
        v.skipped
    );
    outln!("  identity     {} of {}", v.identity, v.identity.trials);
    outln!(
        "  orientation  {} of {}",
        v.orientation,
        v.orientation.trials
    );
    outln!(
        "  error of the orientation successes: mean {:.3} deg, median {:.3} deg",
        v.mean_error_deg,
        v.median_error_deg
    );
    if let (Some(mean), Some(median)) = (v.us_per_identification, v.median_us_per_identification) {
        outln!("  {mean:.1} us an identification (median {median:.1})");
    }
    outln!("Brackets are 95 % intervals (Wilson).");
}
