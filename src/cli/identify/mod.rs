//! `spindoe identify`: identifies observed dots and estimates the ball's orientation.

mod outputs;

use std::num::NonZero;
use std::path::{Path, PathBuf};

use clap::Args;

use self::outputs::Outputs;
use crate::ball::Ball;
use crate::error::{Error, Result, require};
use crate::recognize::learn::ConditionsPrior;
use crate::recognize::observed::ObservedReader;
use crate::recognize::robust::{RobustConfig, RobustRecognizer};
use crate::recognize::stream::{LearningConfig, LearningOrder, identify_frames, identify_learning};
use crate::recognize::{self, PaperRecognizer, RecognizerName};
use crate::view::{Detection, FalseDots, ProtocolName, ViewModel};

#[derive(Debug, Args)]
#[command(after_help = "\
Observed dots: CSV with a header, frame,x,y,z: unit vectors in the camera frame (x right, y up, z towards
the camera), the rows of one frame together. Optional columns: time_s; sigma_deg, a dot's standard
deviation along one tangent axis; or its covariance var_radial_deg2,cov_deg2,var_across_deg2, first axis
outward in the image, second across it, counter-clockwise.

Without time_s, a frame named by a whole number is that many nanoseconds, unless such names step by less than 10000 in
the median: these number the frames. Any other has no time.

The robust recognizer learns noise, misses and false dots from the frames themselves, a file's from its first 256,
a pipe's from those that came before, and says what it learned, the share of frames that show something else among
it; --protocol, or the settings false_dots, miss_probability and foreign_share, say what is known; the setting no_learning
takes the defaults. Its confidence is the probability that the orientation is correct;
that of the paper's recognizer is a share of votes and no probability. --json also has the probability that every
dot is identified correctly, and lists the rival poses of each frame: a pattern with a rotational symmetry has
several of about the same confidence.

Answers leave as the frames arrive: a detector that writes to a pipe gets each frame's row when the next frame
begins. A file of orientations appears complete or not at all, and so does the JSON object.

Examples:
  spindoe identify --table table.npz dots.csv -o orientations.csv
  detector | spindoe identify --table table.npz -")]
pub struct Arguments {
    /// The observed dots; - is standard input.
    #[arg(value_name = "DOTS.csv")]
    dots: PathBuf,
    /// The ball: a table (.npz), a pattern (CSV of unit vectors x,y,z), or the folder of a design or
    /// calibration.
    #[arg(long, value_name = "TABLE.npz")]
    table: PathBuf,
    /// The recognizer to run.
    #[arg(hide = true, long, value_parser = super::output::one_of(&RecognizerName::ALL, RecognizerName::as_str), default_value_t = RecognizerName::Robust)]
    recognizer: RecognizerName,
    /// Write the orientations to this file instead of standard output.
    #[arg(short, long, value_name = "ORIENTATIONS.csv")]
    output: Option<PathBuf>,
    /// Standard deviation, along one tangent axis, of dots for which the file gives none, degrees
    /// [default: the table's noise / sqrt 3].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    dot_sigma_deg: Option<f64>,
    /// Placement error: standard deviation of a drawn dot's place from the pattern's, along one tangent
    /// axis, degrees. It is added to the dots' own noise [default: 0, the dots' noise has it in it].
    #[arg(hide = true, long, value_name = "S", allow_negative_numbers = true)]
    placement_sigma_deg: Option<f64>,
    /// Expect misses, false dots and noise as in this validation protocol.
    #[arg(long, value_parser = super::output::one_of(&ProtocolName::ALL, ProtocolName::as_str), value_name = "PROTOCOL")]
    protocol: Option<ProtocolName>,
    /// Expected number of false dots per frame.
    #[arg(hide = true, long, value_name = "N", allow_negative_numbers = true)]
    false_dots: Option<f64>,
    /// Probability that a visible dot is missed.
    #[arg(hide = true, long, value_name = "P", allow_negative_numbers = true)]
    miss_probability: Option<f64>,
    /// Share of the frames that show something else than the ball [default: learned; none with --protocol;
    /// a fifth with no_learning].
    #[arg(hide = true, long, value_name = "S", allow_negative_numbers = true)]
    foreign_share: Option<f64>,
    /// Do not learn misses, false dots and noise from the frames: take defaults for what is not
    /// given.
    #[arg(hide = true, long, conflicts_with = "protocol")]
    no_learning: bool,
    /// Least confidence.
    #[arg(long, value_name = "P", allow_negative_numbers = true, help = format!(
        "Reject orientations with a lower confidence than this, 0 to 1 [default: {}; the paper's recognizer: 0]",
        recognize::MIN_CONFIDENCE_DOTS
    ))]
    min_confidence: Option<f64>,
    /// Print one JSON object instead, with every dot's identity and the rival poses.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(p) = arguments
        .min_confidence
        .filter(|p| !(0.0..=1.0).contains(p))
    {
        let problem = format!("expected 0 to 1, found {p}");
        return Err(Error::argument("--min-confidence", problem));
    }
    let ball = Ball::read(&arguments.table)?;
    let config = arguments.config(&ball)?;
    let sigma_rad = arguments.sigma_rad(&ball)?;
    let input = super::open_input(&arguments.dots)?;
    let placement_rad = arguments.placement_sigma_rad()?;
    let frames = ObservedReader::new(&input.name, input.reader, sigma_rad)?.map(|frame| {
        let mut frame = frame?;
        for dot in &mut frame.dots {
            dot.uncertainty = dot.uncertainty.widened(placement_rad);
        }
        Ok(frame)
    });
    let threads = NonZero::new(rayon::current_num_threads()).unwrap_or(NonZero::<usize>::MIN);
    let mut outputs = Outputs::create(arguments)?;
    match arguments.recognizer {
        RecognizerName::Voting => {
            let recognizer = PaperRecognizer::for_ball(&ball)?;
            identify_frames(&recognizer, frames, threads, &mut outputs)?;
        }
        RecognizerName::Robust => {
            if arguments.learns() {
                let learning = arguments.learning(&ball);
                let outputs = &mut outputs;
                let learned =
                    identify_learning(&ball, &config, &learning, frames, threads, outputs)?;
                outputs.learned = Some(learned);
            } else {
                let recognizer = RobustRecognizer::for_ball(&ball, config)?;
                identify_frames(&recognizer, frames, threads, &mut outputs)?;
            }
        }
    }
    outputs.finish(&input.name)
}

impl Arguments {
    /// Whether what to expect of the frames is learned from them.
    fn learns(&self) -> bool {
        self.protocol.is_none() && !self.no_learning
    }

    /// How that is learned, and what is known before.
    fn learning(&self, ball: &Ball) -> LearningConfig {
        let known = ConditionsPrior::default();
        let is_file = std::fs::metadata(&self.dots).is_ok_and(|m| m.is_file());
        LearningConfig {
            prior: ConditionsPrior {
                visibility_limit: known
                    .visibility_limit
                    .max(ball.recognizer().visibility_limit),
                detection_probability: self.miss_probability.map(|p| 1.0 - p),
                expected_false_dots: self.false_dots,
                foreign_share: self.foreign_share,
                ..known
            },
            // Answers to a pipe must not wait.
            order: match is_file && self.dots != Path::new("-") {
                true => LearningOrder::InAdvance,
                false => LearningOrder::AsTheyCome,
            },
            ..LearningConfig::default()
        }
    }

    fn min_confidence(&self) -> f64 {
        self.min_confidence.unwrap_or(match self.recognizer {
            RecognizerName::Robust => recognize::MIN_CONFIDENCE_DOTS,
            // A share of votes is no probability.
            RecognizerName::Voting => 0.0,
        })
    }

    fn sigma_rad(&self, ball: &Ball) -> Result<f64> {
        match self.dot_sigma_deg {
            None => Ok(ball.recognizer().sigma_rad / 3f64.sqrt()),
            Some(deg) if deg > 0.0 && deg.is_finite() => Ok(deg.to_radians()),
            Some(deg) => {
                let problem = format!("expected a positive number, found {deg}");
                Err(Error::argument("dot_sigma_deg", problem))
            }
        }
    }

    fn placement_sigma_rad(&self) -> Result<f64> {
        let degrees = self.placement_sigma_deg.unwrap_or(0.0);
        let inside = (0.0..25.0).contains(&degrees);
        let expected = "0 or more and less than 25";
        require(inside, "placement_sigma_deg", expected, degrees)?;
        Ok(degrees.to_radians())
    }

    fn config(&self, ball: &Ball) -> Result<RobustConfig> {
        let mut view = match self.protocol {
            Some(name) => name.view(),
            None => {
                let limit = ball.recognizer().visibility_limit;
                ViewModel {
                    visibility_limit: limit,
                    false_dot_limit: limit,
                    ..ViewModel::default()
                }
            }
        };
        if let Some(mean) = self.false_dots {
            if !(mean > 0.0 && mean.is_finite()) {
                let problem = format!("expected a positive number, found {mean}");
                return Err(Error::argument("--false-dots", problem));
            }
            view.false_dots = FalseDots::Poisson(mean);
        }
        if let Some(p) = self.miss_probability {
            if !(p > 0.0 && p < 1.0) {
                let problem = format!("expected a probability in (0, 1), found {p}");
                return Err(Error::argument("--miss-probability", problem));
            }
            view.detection = Detection::Each {
                probability: 1.0 - p,
            };
        }
        if let Some(share) = self.foreign_share {
            let inside = (0.0..0.95).contains(&share);
            require(
                inside,
                "--foreign-share",
                "0 or more and less than 0.95",
                share,
            )?;
            view.foreign_share = share;
        }
        Ok(view.into())
    }
}
