//! Where the answers go: a file, standard output, and what is said at the end.

use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use serde_json::json;

use super::Arguments;
use crate::cli::output::Counter;
use crate::error::{Error, Result};
use crate::files::OutputFile;
use crate::files::csv::shown;
use crate::geometry::to_wxyz;
use crate::pipeline::Sink;
use crate::recognize::stream::{FrameAnswer, LearnedView};
use crate::recognize::{Identification, RecognizerName, RecognizerRejection};
use crate::spin::orientations::{OrientationRow, OrientationWriter};
use crate::view::{Detection, FalseDots, ViewModel};

/// Minimum ratio of a rival's probability to the best one's that counts as a tie.
pub(super) const TIE: f64 = 0.5;
/// Bytes per write.
pub(super) const WRITE_BYTES: usize = 1 << 16;

/// Destination of the answers.
pub(super) struct Outputs<'a> {
    pub(super) arguments: &'a Arguments,
    pub(super) file: Option<OrientationWriter<BufWriter<OutputFile>>>,
    pub(super) stdout: Stdout,
    pub(super) tally: OutcomeTally,
    /// What was learned of the conditions.
    pub(super) learned: Option<LearnedView>,
    /// Where the answers do not stand on the terminal themselves.
    pub(super) counter: Option<Counter>,
}

/// Content of standard output.
pub(super) enum Stdout {
    Nothing,
    Orientations(OrientationWriter<BufWriter<std::io::Stdout>>),
    Json(JsonFrames),
}

/// The JSON object, kept on disk until it is complete: half of one is not valid JSON.
pub(super) struct JsonFrames {
    pub(super) spool: BufWriter<std::fs::File>,
    pub(super) is_first: bool,
}

impl<'a> Outputs<'a> {
    pub(super) fn create(arguments: &'a Arguments) -> Result<Self> {
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
            tally: OutcomeTally::default(),
            learned: None,
            counter: arguments
                .output
                .is_some()
                .then(|| Counter::new(0, "frames")),
        })
    }

    /// Ends the outputs, and summarizes the frames.
    pub(super) fn finish(self, input: &Path) -> Result<()> {
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
                writer.finish().map_err(crate::cli::stdout_error)?;
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
            Stdout::Orientations(writer) => writer.write(&row).map_err(crate::cli::stdout_error),
            Stdout::Json(frames) => frames.push(&answer, doubtful),
        }
    }

    /// No answer waits here while the input is slow.
    fn idle(&mut self) -> Result<()> {
        if let (Some(file), Some(path)) = (&mut self.file, &self.arguments.output) {
            file.flush().map_err(|e| Error::write(path, e))?;
        }
        if let Stdout::Orientations(writer) = &mut self.stdout {
            writer.flush().map_err(crate::cli::stdout_error)?;
        }
        Ok(())
    }
}

pub(super) fn spool_error(error: std::io::Error) -> Error {
    Error::write(std::env::temp_dir(), error)
}

impl JsonFrames {
    /// Adds a frame; `doubtful` is the confidence for which its answer was rejected.
    pub(super) fn push(&mut self, answer: &FrameAnswer, doubtful: Option<f64>) -> Result<()> {
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

    pub(super) fn print(
        mut self,
        recognizer: RecognizerName,
        tally: &OutcomeTally,
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
        std::io::copy(&mut spool, &mut stdout).map_err(crate::cli::stdout_error)?;
        stdout.flush().map_err(crate::cli::stdout_error)
    }
}

/// Whether another pose is about as probable as the answer's.
pub(super) fn is_tied(answer: &FrameAnswer) -> bool {
    let best = answer.identification().map(|found| found.confidence);
    let rival = answer.rivals().first().map(|r| r.confidence);
    matches!((best, rival), (Some(b), Some(r)) if r >= TIE * b)
}

/// A frame's row; the field of an unknown time stays empty.
pub(super) fn row(answer: &FrameAnswer) -> OrientationRow {
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
pub(super) fn words(learned: &LearnedView) -> String {
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
pub(super) fn learned_json(LearnedView { view, frames }: &LearnedView) -> serde_json::Value {
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
pub(super) fn detection_probability(view: &ViewModel) -> f64 {
    match view.detection {
        Detection::Each { probability } => probability,
        Detection::Given { .. } => 1.0,
    }
}

pub(super) fn to_json(answer: &FrameAnswer) -> serde_json::Value {
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
pub(super) struct OutcomeTally {
    pub(super) frames: u64,
    pub(super) identified: u64,
    pub(super) tied: u64,
    pub(super) mirrored: u64,
    pub(super) doubtful: u64,
    /// Whose names only number them.
    pub(super) numbered: u64,
    /// The first frame that was rejected, and why.
    pub(super) first_rejected: Option<(String, RecognizerRejection)>,
}

impl OutcomeTally {
    pub(super) fn count(&mut self, answer: &FrameAnswer, is_doubtful: bool) {
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
    pub(super) fn say(&self, input: &Path) -> Result<()> {
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
