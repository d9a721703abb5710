//! `spindoe validate`: measures how often patterns are identified correctly: one pattern, several side by side, or one over a
//! sweep; on trials of a protocol, or on rendered frames of a camera.

#[cfg(feature = "vision")]
mod camera;
mod compare;
mod sweep;

use std::path::PathBuf;

use clap::{Args, ValueEnum};

#[cfg(feature = "vision")]
use super::camera::CameraArguments;
use super::output::{Counter, degrees_or_dash, one_of};
use super::print_json;
use crate::ball::Ball;
use crate::error::{Error, Result};
use crate::files::Replacement;
use crate::recognize::RecognizerName;
use crate::report::reject_design;
use crate::validate::{NamedValidation, SensitivityConfig, ValidationConfig};
use crate::view::{Protocol, ProtocolName};

/// Trials where their number is not given.
const SAMPLES: u64 = 10_000;

#[derive(Debug, Args)]
#[command(after_help = "\
Protocols (a view is a rotation uniform on SO(3)):
  paper    all dots with z > 0, noise of 3 deg: the SpinDOE paper's own test
  sparse   four of the dots with z > 1/3, noise of 3 deg: the hardest to identify
  clutter  noise of 5 deg, 20 % of the dots missed, two false dots
  image    noise of 1 px per axis on a ball of 30 px radius, 10 % missed, one false dot
With --camera the views are instead frames of that camera, rendered and read by the whole
estimator: some 10 ms each, with any background some 50.

Several patterns are measured on the same rotations with the same random numbers, in all protocols; differences are
against the first pattern, with 95 % intervals for pairs. Views with too few dots are counted as skipped.

Examples:
  spindoe validate pattern.csv
  spindoe validate table.npz --protocol sparse --json
  spindoe validate dots20 dots32 -o comparison
  spindoe validate dots20 --sweep noise --protocol clutter -o sweep
  spindoe validate dots20 dots32 --camera any --ball-px 45 --exposure-ms 0.3")]
pub struct Arguments {
    /// The patterns: for each a shipped one by its name (dots20), its CSV, a table, or the folder of a design or
    /// calibration.
    #[arg(value_name = "PATTERN", required = true)]
    inputs: Vec<PathBuf>,
    /// Protocol of the views of one pattern [default: paper].
    #[arg(long, value_parser = one_of(&ProtocolName::ALL, ProtocolName::as_str))]
    protocol: Option<ProtocolName>,
    /// Number of trials, or of a camera's frames [default: 10000; of frames 1000; at a point of a sweep a fifth].
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// Noise of a dot in degrees, instead of the protocol's own.
    #[arg(hide = true, long, value_name = "S", allow_negative_numbers = true)]
    sigma_deg: Option<f64>,
    /// Seed of the trials.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The recognizer [default: robust; of several patterns both].
    #[arg(hide = true, long, value_parser = one_of(&RecognizerName::ALL, RecognizerName::as_str))]
    recognizer: Option<RecognizerName>,
    /// Repeat it over a range of the dots' noise, or of each property of the camera.
    #[arg(long, value_enum, value_name = "WHAT", value_delimiter = ',')]
    sweep: Vec<Sweep>,
    /// Noise levels of --sweep noise, degrees.
    #[arg(long, hide = true, value_delimiter = ',', num_args = 1.., default_values_t = SensitivityConfig::default().sigmas_deg)]
    sweep_noise_deg: Vec<f64>,
    /// Repeat it for these values of the paper's alpha, for its recognizer at the protocol's own noise, such as
    /// 0.003,0.01,0.03,0.1,0.3,1.
    #[arg(long, hide = true, value_delimiter = ',', num_args = 1..)]
    sweep_alpha: Vec<f64>,
    /// Write to this folder: of several patterns report.html and comparison.json; of a sweep sensitivity.csv and
    /// its curves.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
    #[cfg(feature = "vision")]
    #[command(flatten)]
    camera: CameraArguments,
}

/// What a sweep varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Sweep {
    /// The dots' noise, for both recognizers.
    Noise,
    /// Pixels, exposure, noise, blur and dots of the camera, one at a time.
    #[cfg(feature = "vision")]
    Camera,
}

impl Arguments {
    fn protocol(&self) -> Protocol {
        let protocol = Protocol::standard(self.protocol.unwrap_or(ProtocolName::Paper));
        match self.sigma_deg {
            Some(sigma) => protocol.with_sigma_rad(sigma.to_radians()),
            None => protocol,
        }
    }

    /// Begins the folder that is written to, where there is one; one that holds a design is refused.
    fn begin(&self) -> Result<Option<Replacement>> {
        let begin = |dir: &PathBuf| {
            reject_design(dir, "choose another folder")?;
            Replacement::begin(dir)
        };
        self.output.as_ref().map(begin).transpose()
    }

    /// Rejects flags that were given and have no meaning beside `what`.
    fn reject(&self, what: &str, flags: &[&str]) -> Result<()> {
        let given = [
            ("protocol", self.protocol.is_some()),
            ("sigma-deg", self.sigma_deg.is_some()),
            ("recognizer", self.recognizer.is_some()),
            ("sweep-alpha", !self.sweep_alpha.is_empty()),
            ("output", self.output.is_some()),
        ];
        let taken = given
            .iter()
            .find(|(flag, is_given)| *is_given && flags.contains(flag));
        taken.map_or(Ok(()), |(flag, _)| {
            Err(Error::argument(*flag, format!("cannot be used {what}")))
        })
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let balls = arguments.inputs.iter().map(|path| Ball::read(path));
    let balls = balls.collect::<Result<Vec<_>>>()?;
    #[cfg(feature = "vision")]
    {
        arguments.camera.reject_without_camera()?;
        if arguments.camera.is_given() {
            return camera::run(arguments, balls);
        }
        if arguments.sweep.contains(&Sweep::Camera) {
            return Err(Error::argument("sweep", "camera: expected --camera"));
        }
    }
    let is_one = arguments.sweep.is_empty() && arguments.sweep_alpha.is_empty();
    match (balls.as_slice(), is_one) {
        ([ball], true) => one(arguments, ball),
        ([ball], false) => sweep::run(arguments, ball),
        (_, true) => compare::run(arguments, balls),
        (_, false) => Err(Error::argument("sweep", "expected one pattern")),
    }
}

/// One pattern, on the trials of a protocol.
fn one(arguments: &Arguments, ball: &Ball) -> Result<()> {
    arguments.reject("with one pattern and no sweep", &["output"])?;
    let samples = arguments.samples.unwrap_or(SAMPLES);
    let config = ValidationConfig {
        recognizer: arguments.recognizer.unwrap_or(RecognizerName::Robust),
        protocol: arguments.protocol(),
        seed: arguments.seed,
        samples,
    };
    let counter = Counter::new(samples, "trials");
    let found = config.run(ball, &|trials| counter.add(trials))?;
    counter.finish();
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
    outln!("  right        {} of all {}", v.answered, v.samples);
    outln!("of those with enough dots:");
    outln!(
        "  orientation  {} of {}",
        v.orientation,
        v.orientation.trials
    );
    outln!("  all dots     {} of {}", v.identity, v.identity.trials);
    outln!(
        "  error of the right ones: mean {}, median {}",
        degrees_or_dash(v.mean_error_deg, 3),
        degrees_or_dash(v.median_error_deg, 3)
    );
    if let (Some(mean), Some(median)) = (v.us_per_identification, v.median_us_per_identification) {
        outln!("  {mean:.1} us an identification (median {median:.1})");
    }
    outln!("Brackets are 95 % intervals (Wilson).");
}
