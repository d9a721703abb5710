//! `spindoe identify`: which dot is which, and how is the ball turned?

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::print_json;
use crate::error::{Error, Result};
use crate::geometry::Rotation;
use crate::hash::HashTable;
use crate::recognize::observed::{self, ObservedFrame};
use crate::recognize::robust::{RobustConfig, RobustRecognizer};
use crate::recognize::{
    Identification, Outcome, PaperRecognizer, Recognizer, RecognizerName, RecognizerRejection,
};
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::validate::{Protocol, ProtocolName};

#[derive(Debug, Args)]
#[command(after_help = "\
Observed dots: CSV with a header, frame,x,y,z: unit vectors in the camera frame (x right, y up, z towards
the camera), the rows of one frame together. Optional columns: time_s; sigma_deg, a dot's standard
deviation along one tangent axis; or its covariance var_radial_deg2,cov_deg2,var_across_deg2, first axis
outward in the image, second across it, counter-clockwise.

Without time_s, a frame named by a whole number is that many nanoseconds; any other has no time.

The robust recognizer's confidence is the probability that every dot has its right name, given that misses,
false dots and noise are about as expected (--expect, --false-dots, --miss-probability, --sigma-deg). That of
the paper's recognizer is a share of votes and no probability. --json lists the rival poses of each frame:
a pattern that looks like itself when turned has several of about the same confidence.

Example:
  spindoe identify --table table.npz dots.csv -o orientations.csv")]
pub struct Arguments {
    /// The observed dots.
    #[arg(value_name = "DOTS.csv")]
    dots: PathBuf,
    /// The pattern's hash table (.npz), or the pattern (CSV of unit vectors x,y,z).
    #[arg(long, value_name = "TABLE.npz")]
    table: PathBuf,
    /// The recognizer that is asked.
    #[arg(long, value_parser = super::output::one_of(&RecognizerName::ALL, RecognizerName::as_str), default_value_t = RecognizerName::Robust)]
    recognizer: RecognizerName,
    /// Write the orientations to this file instead of standard output.
    #[arg(short, long, value_name = "ORIENTATIONS.csv")]
    output: Option<PathBuf>,
    /// Standard deviation, along one tangent axis, of dots for which the file gives none, degrees
    /// [default: the table's noise / sqrt 3].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    sigma_deg: Option<f64>,
    /// Expect misses, false dots and noise as in this validation protocol.
    #[arg(long, value_parser = super::output::one_of(&ProtocolName::ALL, ProtocolName::as_str), value_name = "PROTOCOL")]
    expect: Option<ProtocolName>,
    /// Expected number of false dots in a frame.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    false_dots: Option<f64>,
    /// Probability that a dot in plain view is missed.
    #[arg(long, value_name = "P", allow_negative_numbers = true)]
    miss_probability: Option<f64>,
    /// Leave out answers with a lower confidence than this, 0 to 1.
    #[arg(
        long,
        value_name = "P",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    min_confidence: f64,
    /// Print one JSON object instead, with every dot's identity and the rival poses.
    #[arg(long)]
    json: bool,
}

/// A frame and what came of it.
struct Answer {
    frame: ObservedFrame,
    outcome: Outcome,
    /// Other poses that explain the dots, likeliest first.
    rivals: Vec<Identification>,
}

/// Rivals whose pose is less likely than this are not told.
const MIN_RIVAL: f64 = 0.001;
/// Most rivals that are told.
const MAX_RIVALS: usize = 60;
/// A rival with this part of the best one's probability makes a tie.
const TIE: f64 = 0.5;

pub fn run(arguments: &Arguments) -> Result<()> {
    let table = super::read_table(&arguments.table)?;
    let frames = observed::read_csv(&arguments.dots, arguments.sigma_rad(&table)?)?;
    if !(0.0..=1.0).contains(&arguments.min_confidence) {
        let problem = format!("expected 0 to 1, found {}", arguments.min_confidence);
        return Err(Error::argument("--min-confidence", problem));
    }
    let mut answers = match arguments.recognizer {
        RecognizerName::Paper => identify_paper(&PaperRecognizer::from_table(&table)?, frames),
        RecognizerName::Robust => {
            let config = arguments.config(&table)?;
            identify_robust(&RobustRecognizer::new(table.pattern(), config)?, frames)
        }
    };
    for answer in &mut answers {
        let confidence = answer.identification().map(|found| found.confidence);
        if confidence.is_some_and(|c| c < arguments.min_confidence) {
            answer.outcome = Outcome::Unidentified(RecognizerRejection::NoHypothesis);
        }
    }
    let text = orientations_csv(&answers);
    if let Some(path) = &arguments.output {
        crate::files::write_bytes(path, text.as_bytes())?;
    }
    if arguments.json {
        print_json(&to_json(arguments, &answers))?;
    } else if arguments.output.is_none() {
        std::io::stdout()
            .write_all(text.as_bytes())
            .map_err(|e| Error::write("standard output", e))?;
    }
    say(&arguments.dots, &answers);
    Ok(())
}

impl Arguments {
    fn sigma_rad(&self, table: &HashTable) -> Result<f64> {
        match self.sigma_deg {
            None => Ok(table.meta().recognizer.sigma_rad / 3f64.sqrt()),
            Some(deg) if deg > 0.0 && deg.is_finite() => Ok(deg.to_radians()),
            Some(deg) => {
                let problem = format!("expected a positive number, found {deg}");
                Err(Error::argument("--sigma-deg", problem))
            }
        }
    }

    fn config(&self, table: &HashTable) -> Result<RobustConfig> {
        let mut config = match self.expect {
            Some(name) => Protocol::standard(name).recognizer_config(),
            None => RobustConfig {
                visibility_limit: table.meta().recognizer.visibility_limit,
                ..RobustConfig::default()
            },
        };
        if let Some(mean) = self.false_dots {
            if !(mean > 0.0 && mean.is_finite()) {
                let problem = format!("expected a positive number, found {mean}");
                return Err(Error::argument("--false-dots", problem));
            }
            config.expected_false_dots = mean;
            config.usual_false_dots = None;
        }
        if let Some(p) = self.miss_probability {
            if !(p > 0.0 && p < 1.0) {
                let problem = format!("expected a probability in (0, 1), found {p}");
                return Err(Error::argument("--miss-probability", problem));
            }
            config.detection_probability = 1.0 - p;
        }
        Ok(config)
    }
}

fn identify_paper(recognizer: &PaperRecognizer<'_>, frames: Vec<ObservedFrame>) -> Vec<Answer> {
    let mut workspace = recognizer.workspace();
    frames
        .into_iter()
        .map(|frame| Answer {
            outcome: recognizer.identify(&frame.dots, &mut workspace),
            rivals: Vec::new(),
            frame,
        })
        .collect()
}

fn identify_robust(recognizer: &RobustRecognizer, frames: Vec<ObservedFrame>) -> Vec<Answer> {
    let mut workspace = recognizer.workspace();
    frames
        .into_iter()
        .map(|frame| {
            let outcome = recognizer.identify(&frame.dots, &mut workspace);
            let mut rivals = Vec::new();
            if matches!(outcome, Outcome::Identified(_)) {
                let mut rival = Identification::default();
                for rank in 1..=MAX_RIVALS {
                    if !recognizer.explanation(rank, &workspace, &mut rival)
                        || rival.pose_confidence < MIN_RIVAL
                    {
                        break;
                    }
                    rivals.push(rival.clone());
                }
            }
            Answer {
                outcome,
                rivals,
                frame,
            }
        })
        .collect()
}

/// A rotation's quaternion, scalar first and not negative.
fn wxyz(rotation: &Rotation) -> [f64; 4] {
    let q = rotation.into_inner();
    let q = if q.w < 0.0 { -q } else { q };
    [q.w, q.i, q.j, q.k]
}

impl Answer {
    fn identification(&self) -> Option<&Identification> {
        match &self.outcome {
            Outcome::Identified(found) => Some(found),
            Outcome::Unidentified(_) => None,
        }
    }

    /// Whether another pose is about as likely as the answer's.
    fn is_tied(&self) -> bool {
        let best = self.identification().map(|found| found.pose_confidence);
        let rival = self.rivals.first().map(|r| r.pose_confidence);
        matches!((best, rival), (Some(b), Some(r)) if r >= TIE * b)
    }

    fn row(&self) -> OrientationRow {
        let found = self.identification();
        OrientationRow {
            frame: self.frame.name.clone(),
            time_s: self.frame.time_or_name_s().unwrap_or(f64::NAN),
            orientation: found.map(|f| f.rotation),
            dots: Some(self.frame.dots.len()),
            matched: Some(found.map_or(0, Identification::matched)),
            residual_rad: found.map(|f| f.residual_rad),
            confidence: found.map(|f| f.confidence),
        }
    }

    fn to_json(&self) -> serde_json::Value {
        let mut json = json!({
            "frame": self.frame.name,
            "time_s": self.frame.time_or_name_s(),
            "dots": self.frame.dots.len(),
        });
        match &self.outcome {
            Outcome::Identified(found) => {
                json["orientation_wxyz"] = json!(wxyz(&found.rotation));
                json["assignment"] = json!(found.assignment);
                json["matched"] = found.matched().into();
                json["residual_deg"] = found.residual_rad.to_degrees().into();
                json["confidence"] = found.confidence.into();
                json["pose_confidence"] = found.pose_confidence.into();
                let rival = |r: &Identification| {
                    json!({
                        "orientation_wxyz": wxyz(&r.rotation),
                        "pose_confidence": r.pose_confidence,
                    })
                };
                json["rivals"] = self.rivals.iter().map(rival).collect();
            }
            Outcome::Unidentified(refusal) => json["refusal"] = refusal.to_string().into(),
        }
        json
    }
}

/// The orientations file; frames without a time leave its field empty.
fn orientations_csv(answers: &[Answer]) -> String {
    let rows = answers.iter().map(Answer::row).collect();
    Orientations { rows }.to_csv()
}

fn to_json(arguments: &Arguments, answers: &[Answer]) -> serde_json::Value {
    json!({
        "recognizer": arguments.recognizer,
        "frames": answers.iter().map(Answer::to_json).collect::<Vec<_>>(),
        "identified": answers.iter().filter(|a| a.identification().is_some()).count(),
    })
}

/// Says on standard error what became of the frames.
fn say(path: &Path, answers: &[Answer]) {
    let identified = answers.iter().filter(|a| a.identification().is_some());
    let path = path.display();
    errln!(
        "{path}: {} of {} frames identified",
        identified.count(),
        answers.len()
    );
    let tied = answers.iter().filter(|a| a.is_tied()).count();
    if tied > 0 {
        errln!(
            "{path}: {tied} frames have another pose that explains them about as well (--json lists it): does the pattern look like itself when turned?"
        );
    }
    let mirrored = Outcome::Unidentified(RecognizerRejection::Mirrored);
    let mirrored = answers.iter().filter(|a| a.outcome == mirrored).count();
    if mirrored > 0 {
        errln!(
            "{path}: {mirrored} frames show the pattern's mirror image: is an axis of the image flipped (y points up, x right)?"
        );
    }
}
