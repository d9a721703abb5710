//! `spindoe identify`: identifies observed dots and estimates the ball's orientation.

use std::io::{BufWriter, Seek, Write};
use std::num::NonZero;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::output::Counter;
use crate::ball::Ball;
use crate::error::{Error, Result, require};
use crate::files::OutputFile;
use crate::files::csv::shown;
use crate::geometry::to_wxyz;
use crate::pipeline::Sink;
use crate::recognize::learn::ConditionsPrior;
use crate::recognize::observed::ObservedReader;
use crate::recognize::robust::{RobustConfig, RobustRecognizer};
use crate::recognize::stream::{
    FrameAnswer, LearnedView, LearningConfig, LearningOrder, identify_frames, identify_learning,
};
use crate::recognize::{
    self, Identification, PaperRecognizer, RecognizerName, RecognizerRejection,
};
use crate::spin::orientations::{OrientationRow, OrientationWriter};
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

/// Minimum ratio of a rival's probability to the best one's that counts as a tie.
const TIE: f64 = 0.5;
/// Bytes per write.
const WRITE_BYTES: usize = 1 << 16;

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

/// Destination of the answers.
struct Outputs<'a> {
    arguments: &'a Arguments,
    file: Option<OrientationWriter<BufWriter<OutputFile>>>,
    stdout: Stdout,
    tally: Tally,
    /// What was learned of the conditions.
    learned: Option<LearnedView>,
    /// Where the answers do not stand on the terminal themselves.
    counter: Option<Counter>,
}

/// Content of standard output.
enum Stdout {
    Nothing,
    Orientations(OrientationWriter<BufWriter<std::io::Stdout>>),
    Json(JsonFrames),
}

/// The JSON object, kept on disk until it is complete: half of one is not valid JSON.
struct JsonFrames {
    spool: BufWriter<std::fs::File>,
    is_first: bool,
}

impl<'a> Outputs<'a> {
    fn create(arguments: &'a Arguments) -> Result<Self> {
        let file = arguments.output.as_deref().map(OutputFile::create);
        let buffered = |file| OrientationWriter::new(BufWriter::with_capacity(WRITE_BYTES, file));
        Ok(Self {
            arguments,
            file: file.transpose()?.map(buffered),
            stdout: if arguments.json {
                let spool = tempfile::tempfile().map_err(spool_error)?;
                Stdout::Json(JsonFrames {
                    spool: BufWriter::with_capacity(WRITE_BYTES, spool),
                    is_first: true,
                })
            } else if arguments.output.is_none() {
                let stdout = BufWriter::with_capacity(WRITE_BYTES, std::io::stdout());
                Stdout::Orientations(OrientationWriter::new(stdout))
            } else {
                Stdout::Nothing
            },
            tally: Tally::default(),
            learned: None,
            counter: arguments
                .output
                .is_some()
                .then(|| Counter::new(0, "frames")),
        })
    }

    /// Ends the outputs, and summarizes the frames.
    fn finish(self, input: &Path) -> Result<()> {
        if let Some(counter) = &self.counter {
            counter.finish();
        }
        if let (Some(writer), Some(path)) = (self.file, &self.arguments.output) {
            let error = |e| Error::write(path, e);
            let buffer = writer.finish().map_err(error)?;
            let file = buffer.into_inner().map_err(|e| error(e.into_error()))?;
            file.finish()?;
        }
        match self.stdout {
            Stdout::Nothing => {}
            Stdout::Orientations(writer) => {
                writer.finish().map_err(super::stdout_error)?;
            }
            Stdout::Json(frames) => {
                frames.print(
                    self.arguments.recognizer,
                    &self.tally,
                    self.learned.as_ref(),
                )?;
            }
        }
        if let Some(learned) = self.learned.as_ref().filter(|l| l.frames > 0) {
            errln!("{}: {}", input.display(), words(learned));
        }
        self.tally.say(input)
    }
}

impl Sink<FrameAnswer> for Outputs<'_> {
    type Error = Error;

    fn take(&mut self, mut answer: FrameAnswer) -> Result<()> {
        let confidence = answer.identification().map(|found| found.confidence);
        // Also of an answer that is rejected for it.
        let is_tied = is_tied(&answer);
        let doubtful = confidence.filter(|c| *c < self.arguments.min_confidence());
        if doubtful.is_some() {
            answer.outcome = Err(RecognizerRejection::NoHypothesis);
        }
        self.tally.tied += u64::from(is_tied);
        self.tally.count(&answer, doubtful.is_some());
        if let Some(counter) = &self.counter {
            counter.add(1);
        }
        let row = row(&answer);
        if let (Some(file), Some(path)) = (&mut self.file, &self.arguments.output) {
            file.write(&row).map_err(|e| Error::write(path, e))?;
        }
        match &mut self.stdout {
            Stdout::Nothing => Ok(()),
            Stdout::Orientations(writer) => writer.write(&row).map_err(super::stdout_error),
            Stdout::Json(frames) => frames.push(&answer, doubtful),
        }
    }

    /// No answer waits here while the input is slow.
    fn idle(&mut self) -> Result<()> {
        if let (Some(file), Some(path)) = (&mut self.file, &self.arguments.output) {
            file.flush().map_err(|e| Error::write(path, e))?;
        }
        if let Stdout::Orientations(writer) = &mut self.stdout {
            writer.flush().map_err(super::stdout_error)?;
        }
        Ok(())
    }
}

fn spool_error(error: std::io::Error) -> Error {
    Error::write(std::env::temp_dir(), error)
}

impl JsonFrames {
    /// Adds a frame; `doubtful` is the confidence for which its answer was rejected.
    fn push(&mut self, answer: &FrameAnswer, doubtful: Option<f64>) -> Result<()> {
        let lead = if self.is_first { "{\"frames\":[" } else { "," };
        self.is_first = false;
        self.spool.write_all(lead.as_bytes()).map_err(spool_error)?;
        let mut json = to_json(answer);
        if let Some(confidence) = doubtful {
            let words = format!("ambiguous: the best pose has a probability of {confidence:.2}");
            json["refusal"] = words.into();
        }
        serde_json::to_writer(&mut self.spool, &json).map_err(|e| spool_error(e.into()))
    }

    fn print(
        mut self,
        recognizer: RecognizerName,
        tally: &Tally,
        learned: Option<&LearnedView>,
    ) -> Result<()> {
        let identified = tally.identified;
        let begin = if self.is_first { "{\"frames\":[" } else { "" };
        // What the conditions were taken for, where they were learned.
        let conditions = learned.map(learned_json);
        let conditions = json!(conditions);
        writeln!(
            self.spool,
            "{begin}],\"identified\":{identified},\"recognizer\":\"{recognizer}\",\"conditions\":{conditions}}}"
        )
        .map_err(spool_error)?;
        let mut spool = self
            .spool
            .into_inner()
            .map_err(|e| spool_error(e.into_error()))?;
        spool.rewind().map_err(spool_error)?;
        let mut stdout = std::io::stdout();
        std::io::copy(&mut spool, &mut stdout).map_err(super::stdout_error)?;
        stdout.flush().map_err(super::stdout_error)
    }
}

/// Whether another pose is about as probable as the answer's.
fn is_tied(answer: &FrameAnswer) -> bool {
    let best = answer.identification().map(|found| found.confidence);
    let rival = answer.rivals().first().map(|r| r.confidence);
    matches!((best, rival), (Some(b), Some(r)) if r >= TIE * b)
}

/// A frame's row; the field of an unknown time stays empty.
fn row(answer: &FrameAnswer) -> OrientationRow {
    let found = answer.identification();
    OrientationRow {
        frame: answer.frame.name.clone(),
        time_s: answer.frame.time_s.unwrap_or(f64::NAN),
        orientation: found.map(|f| f.rotation),
        dots: Some(answer.frame.dots.len()),
        matched: Some(found.map_or(0, Identification::matched)),
        residual_rad: found.map(|f| f.residual_rad),
        confidence: found.map(|f| f.confidence),
        ..OrientationRow::default()
    }
}

/// What was learned of the views, in words.
fn words(learned: &LearnedView) -> String {
    let LearnedView { view, frames } = learned;
    let false_dots = match view.false_dots {
        FalseDots::Usual(n) => format!("{n} false dots in nearly every frame"),
        FalseDots::Poisson(mean) => format!("{mean:.2} false dots a frame"),
    };
    format!(
        "learned from {frames} frames: {false_dots}, {:.0} % of the dots with z > {:.2} missed, noise {:.2} times that given, \
         {:.0} % of the frames of something else",
        100.0 * (1.0 - detection_probability(view)),
        view.visibility_limit,
        view.noise_scale,
        100.0 * (view.foreign_share + view.mirrored_share),
    )
}

/// What was learned of the views, as JSON.
fn learned_json(LearnedView { view, frames }: &LearnedView) -> serde_json::Value {
    json!({
        "noise": view.noise.shape(),
        "noise_scale": view.noise_scale,
        "visibility_limit": view.visibility_limit,
        "detection_probability": detection_probability(view),
        "expected_false_dots": view.false_dots.mean(),
        "usual_false_dots": view.false_dots.usual(),
        "foreign_share": view.foreign_share,
        "mirrored_share": view.mirrored_share,
        "frames": frames,
    })
}

/// Learned views find each dot on its own.
fn detection_probability(view: &ViewModel) -> f64 {
    match view.detection {
        Detection::Each { probability } => probability,
        Detection::Given { .. } => 1.0,
    }
}

fn to_json(answer: &FrameAnswer) -> serde_json::Value {
    let mut json = json!({
        "frame": answer.frame.name,
        "time_s": answer.frame.time_s,
        "dots": answer.frame.dots.len(),
    });
    match &answer.outcome {
        Ok(explanations) => {
            let found = explanations.best();
            json["orientation_wxyz"] = json!(to_wxyz(&found.rotation));
            json["assignment"] = json!(found.assignment);
            json["matched"] = found.matched().into();
            json["residual_deg"] = found.residual_rad.to_degrees().into();
            json["dots_confidence"] = found.dots_confidence.into();
            json["confidence"] = found.confidence.into();
            let rival = |r: &Identification| {
                json!({
                    "orientation_wxyz": to_wxyz(&r.rotation),
                    "confidence": r.confidence,
                })
            };
            json["rivals"] = explanations.rivals().iter().map(rival).collect();
        }
        Err(rejection) => json["refusal"] = rejection.to_string().into(),
    }
    json
}

/// Counts of the frames' outcomes.
#[derive(Default)]
struct Tally {
    frames: u64,
    identified: u64,
    tied: u64,
    mirrored: u64,
    doubtful: u64,
    /// Whose names only number them.
    numbered: u64,
    /// The first frame that was rejected, and why.
    first_rejected: Option<(String, RecognizerRejection)>,
}

impl Tally {
    fn count(&mut self, answer: &FrameAnswer, is_doubtful: bool) {
        self.frames += 1;
        self.numbered += u64::from(answer.frame.is_numbered);
        self.doubtful += u64::from(is_doubtful);
        match answer.outcome {
            Ok(_) => self.identified += 1,
            Err(rejection) => {
                self.mirrored += u64::from(rejection == RecognizerRejection::Mirrored);
                if !is_doubtful && self.first_rejected.is_none() {
                    self.first_rejected = Some((answer.frame.name.clone(), rejection));
                }
            }
        }
    }

    /// Summarizes the frames on standard error.
    fn say(&self, input: &Path) -> Result<()> {
        let path = input.display();
        let (tied, mirrored) = (self.tied, self.mirrored);
        errln!(
            "{path}: {} of {} frames identified",
            self.identified,
            self.frames
        );
        if self.numbered > 0 {
            errln!(
                "{path}: times: the names are frame numbers, not times in nanoseconds: give `spindoe spin` --fps"
            );
        }
        if tied > 0 {
            errln!(
                "{path}: {tied} frames have another pose of about the same probability (--json lists it): does the pattern have a rotational symmetry?"
            );
        }
        if mirrored > 0 {
            errln!(
                "{path}: {mirrored} frames show the pattern's mirror image: is an axis of the image flipped (y points up, x right)?"
            );
        }
        if self.identified > 0 {
            return Ok(());
        }
        let mut reasons = Vec::new();
        if self.doubtful > 0 {
            let doubtful = self.doubtful;
            reasons.push(format!("{doubtful} answers are below --min-confidence"));
        }
        if let Some((name, rejection)) = &self.first_rejected {
            reasons.push(format!("frame {}: {rejection}", shown(name)));
        }
        Err(Error::NoAnswer {
            path: input.to_path_buf(),
            reason: format!("no frame is identified; {}", reasons.join("; ")),
        })
    }
}
