//! The output of `spindoe estimate`.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::verdict::VerdictWords;
use super::written::{
    ClipRows, FoundSpin, WrittenRow, add_spin, ball_json, found_spin, say_times, spin_words,
};
use super::{Arguments, Asked, Picture};
use crate::clip::{Batch, BatchFrame, SequenceEvidence, SequenceOutcome};
use crate::files::csv::shown;
use crate::geometry::CameraFrame;
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::vision::frame::outline::OutlineSource;
use crate::vision::{FrameEstimate, FrameRejection, OffCenter};

/// Fields of view along the longer side for which a cost is named, degrees: that of a 25 mm lens before a sensor of half an inch,
/// and that of a phone.
const FIELDS_DEG: [f64; 2] = [15.0, 65.0];

/// Smears that are longer or shorter than the spin makes them by more than this factor are doubted.
const MAX_FACTOR: f64 = 1.15;

/// Everything that is reported.
pub(super) struct SequenceReport<'a> {
    arguments: &'a Arguments,
    rows: ClipRows<'a, Picture>,
    verdict: VerdictWords<'a>,
    /// Where the frames have times.
    spin: Option<FoundSpin>,
    /// The smears that were weighed.
    smeared: Option<ReportedSmears>,
}

/// What is reported of smears.
#[derive(Clone, Copy)]
struct ReportedSmears {
    /// Number of frames used.
    frames: usize,
    /// See [`SequenceSmears::exposure_factor`](crate::clip::SequenceSmears::exposure_factor).
    factor: Option<f64>,
}

/// The rows of the frames, whose orientations are those of a file.
fn rows<'a>(
    asked: &'a Asked,
    axes: CameraFrame,
    batch: &'a Batch<Picture>,
    file: Orientations,
) -> ClipRows<'a, Picture> {
    let row = |(shown, row): (&BatchFrame<Picture>, OrientationRow)| {
        let frame = shown.estimate();
        // Of cameras that contradict each other no frame has an answer, which is said once.
        let is_said = frame.outcome == Err(FrameRejection::CamerasContradict);
        let needs_look = frame.pose().is_none() || frame.fit.is_some_and(|f| f.rivals > 0);
        vec![WrittenRow {
            json: frame_json(axes, frame, &row),
            note: (needs_look && !is_said).then(|| words(frame)),
            row,
        }]
    };
    ClipRows {
        asked,
        axes,
        batch,
        frames: batch.frames.iter().zip(file.rows).map(row).collect(),
        columns: file.columns,
    }
}

/// The outcome of a frame, in words.
pub(super) fn words(frame: &FrameEstimate) -> String {
    let second = match frame.fit.map_or(0, |f| f.rivals) {
        0 => "",
        _ => "; more than one ball in view",
    };
    match &frame.outcome {
        Ok(pose) => format!(
            "p = {:.2}, {} of {} dots, {:.1} deg, {:.2} px{}{second}",
            pose.confidence,
            frame.matched(),
            frame.dots.len(),
            pose.residual_rad.to_degrees(),
            pose.residual_px,
            match (pose.hinted, frame.outline.map(|o| o.source)) {
                (true, Some(OutlineSource::Neighbors)) => ", hinted, outline by its neighbors",
                (false, Some(OutlineSource::Neighbors)) => ", outline by its neighbors",
                (true, _) => ", hinted",
                (false, _) => "",
            },
        ),
        Err(rejection) => format!("{rejection}{second}"),
    }
}

impl<'a> SequenceReport<'a> {
    /// The report of a batch.
    pub fn new(
        arguments: &'a Arguments,
        frame: CameraFrame,
        batch: &'a Batch<Picture>,
        evidence: &SequenceEvidence<'_>,
    ) -> Self {
        Self::of_rows(arguments, frame, batch, evidence, batch.orientations(frame))
    }

    /// That of a batch whose orientations are these.
    pub fn of_rows(
        arguments: &'a Arguments,
        frame: CameraFrame,
        batch: &'a Batch<Picture>,
        evidence: &SequenceEvidence<'_>,
        file: Orientations,
    ) -> Self {
        let spin = batch.is_sequence().then(|| {
            let file = (&file, &batch.times);
            found_spin(&arguments.asked, file, arguments.motion, evidence)
        });
        let rows = rows(&arguments.asked, frame, batch, file);
        let found = spin.as_ref().and_then(|spin| spin.as_ref().ok());
        let smeared = evidence.smears.map(|smears| ReportedSmears {
            frames: smears.frames(),
            factor: found.and_then(|(summary, _)| smears.exposure_factor(&summary.fit.motion.spin)),
        });
        Self {
            arguments,
            rows,
            verdict: VerdictWords::new(&batch.judgment, &arguments.asked.table),
            spin,
            smeared,
        }
    }

    /// The spin and its motion where the frames have times.
    #[cfg(feature = "plot")]
    pub fn spin(&self) -> Option<&FoundSpin> {
        self.spin.as_ref()
    }

    /// The rows.
    pub fn rows(&self) -> &ClipRows<'a, Picture> {
        &self.rows
    }

    pub fn to_json(&self) -> Value {
        let mut json = self.rows.to_json();
        json["detector"] = json!(self.arguments.asked.source.detector);
        add_spin(self.spin.as_ref(), self.rows.axes, &mut json);
        if let Some(Ok(_)) = self.spin {
            if let Some(ms) = self.arguments.readout_ms {
                json["spin"]["readout_ms"] = ms.into();
            }
            if let Some(ms) = self.arguments.exposure_ms {
                json["spin"]["smears"] = json!({
                    "exposure_ms": ms,
                    "frames": self.smeared.map_or(0, |s| s.frames),
                    "length_factor": self.smeared.and_then(|s| s.factor),
                });
            }
        }
        json
    }

    /// The few frames of another size than nearly all: one camera's have all the same. Crops of many sizes are no such set.
    fn size_words(&self) -> Option<String> {
        let sizes: Vec<_> = self
            .rows
            .batch
            .frames
            .iter()
            .filter_map(|f| f.size)
            .collect();
        let usual = usual_size(&sizes)?;
        let is_other = |f: &&BatchFrame<_>| f.size.is_some_and(|size| size != usual);
        let others: Vec<_> = self.rows.batch.frames.iter().filter(is_other).collect();
        let [first, ..] = others[..] else {
            return None;
        };
        let ([width, height], [columns, rows]) = (first.size?, usual);
        Some(format!(
            "warning: {} of {} frames are not of {columns} x {rows} pixels as most are, the first of them {} ({width} x {height})",
            others.len(),
            self.rows.batch.frames.len(),
            shown(&first.name),
        ))
    }

    /// What smears have to say of the spin, where an exposure is given.
    fn smear_words(&self) -> Option<String> {
        let ms = self.arguments.exposure_ms?;
        let Some(ReportedSmears { frames, factor }) = self.smeared else {
            return Some(format!(
                "  smears    no frame shows a dot whose blur is measured: {ms} ms of exposure settle nothing"
            ));
        };
        let words = format!(
            "  smears    of {frames} frames, {ms} ms of exposure, weigh the spins that the orientations leave open"
        );
        let off = factor.filter(|factor| !(1.0 / MAX_FACTOR..=MAX_FACTOR).contains(factor));
        Some(match off {
            Some(factor) => format!(
                "{words}\n            warning: the smears are {factor:.2} times as long as this spin makes them: is the exposure right?"
            ),
            None => words,
        })
    }

    /// What it costs that no camera is given, where the ball stands off the center.
    fn off_center_words(&self) -> Option<String> {
        let seen = self.rows.batch.frames.iter().filter_map(|frame| {
            frame.estimate().pose()?;
            Some((frame.estimate().circle?, frame.size?))
        });
        let off = OffCenter::farthest(seen).filter(|_| self.rows.axes.is_view())?;
        let angle = |field_deg: f64| off.angle_rad(field_deg.to_radians()).to_degrees();
        let [narrow, wide] = FIELDS_DEG;
        Some(format!(
            "no camera is given, and the ball stands up to {:.0} px off the center of {} x {}: the view frame of orientations and \
             spin is turned against the camera's by {:.1} deg if the field of view is {narrow} deg, {:.1} deg if it is {wide} \
             (--intrinsics)",
            off.offset_px,
            off.size[0],
            off.size[1],
            angle(narrow),
            angle(wide),
        ))
    }

    /// Summarizes the outcome of the frames on standard error.
    pub fn say(&self) {
        self.rows.say_inputs();
        if let Some(words) = self.size_words() {
            errln!("{words}");
        }
        let count = self.rows.frames.len();
        (0..count).for_each(|k| self.rows.say_frame(k));
        errln!("{} of {count} frames identified", self.rows.identified());
        if let Some(words) = self.verdict.words() {
            errln!("{words}");
        }
        if let SequenceOutcome::Estimated { summary, .. } = &self.rows.batch.sequence
            && summary.together > summary.alone
        {
            errln!("{} of them independently", summary.alone);
        }
        say_times(self.rows.batch);
        if let Some(words) = self.off_center_words() {
            errln!("{words}");
        }
        if let Some(words) = spin_words(self.spin.as_ref(), self.rows.axes) {
            errln!("spin: {words}");
        }
        if let Some(Ok(_)) = self.spin {
            let rows = self.arguments.readout_ms.map(|ms| {
                format!("  rows      {ms} ms of readout: times and poses are those of the ball's center, and the rows weigh the spins")
            });
            let more = rows.into_iter().chain(self.smear_words());
            more.for_each(|words| errln!("{words}"));
        }
    }

    /// Why nothing is answered, where no frame is.
    pub fn no_answer(&self) -> Option<String> {
        let count = self.rows.batch.frames.len();
        match self.rows.identified() {
            0 => Some(self.verdict.rejection().unwrap_or_else(|| {
                let first = self.rows.batch.frames.first();
                let why = first.map(|f| words(f.estimate())).unwrap_or_default();
                // A ball was found, and no dots on it.
                let is_found = self
                    .rows
                    .batch
                    .frames
                    .iter()
                    .any(|f| f.estimate().outline.is_some());
                let negative = match is_found && !self.arguments.asked.source.bright_dots {
                    true => " (a dark ball with bright dots: --config bright_dots=true)",
                    false => "",
                };
                format!("none of {count} frames is identified; the first: {why}{negative}")
            })),
            _ => None,
        }
    }
}

/// What JSON says of a frame.
fn frame_json(axes: CameraFrame, frame: &FrameEstimate, row: &OrientationRow) -> Value {
    let dots: Vec<Value> = frame
        .dots
        .iter()
        .zip(&frame.assignment)
        .map(|(dot, name)| {
            let c = dot.covariance;
            json!({
                "u": dot.pixel.u,
                "v": dot.pixel.v,
                "covariance_px2": [[c[(0, 0)], c[(0, 1)]], [c[(1, 0)], c[(1, 1)]]],
                "probability": dot.probability,
                "name": name,
            })
        })
        .collect();
    let ms = |d: std::time::Duration| 1e3 * d.as_secs_f64();
    let mut json = ball_json(row, axes, frame);
    json["detections"] = dots.into();
    json["milliseconds"] = json!({
        "locate": ms(frame.timings.locate),
        "detect": ms(frame.timings.detect),
        "identify": ms(frame.timings.identify),
    });
    if let Some(fit) = &frame.fit {
        json["outline"] = json!({
            "support": fit.support,
            "visible": fit.visible,
            "contrast": fit.contrast,
            "edge_width_px": fit.edge_width,
            "other_balls": fit.rivals,
        });
    }
    json
}

/// The size of all frames but one, or of all but a tenth of many; none where they differ more.
fn usual_size(sizes: &[[usize; 2]]) -> Option<[usize; 2]> {
    let mut counts = BTreeMap::new();
    for size in sizes {
        *counts.entry(*size).or_insert(0) += 1;
    }
    let (usual, count) = counts.into_iter().max_by_key(|(_, count)| *count)?;
    let is_usual = count > 1 && sizes.len() - count <= (sizes.len() / 10).max(1);
    is_usual.then_some(usual)
}
