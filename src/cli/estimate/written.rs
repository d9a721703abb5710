//! What all modes write alike: the rows of a clip or stream as a file and as JSON, and what is said of it.

use nalgebra::Matrix3;
use serde_json::{Value, json};

use super::Asked;
use super::verdict::VerdictWords;
use crate::cli::motion::ObservedMotion;
use crate::cli::{inputs, spin_summary};
use crate::clip::{Batch, NamedFrame, SequenceEvidence, TimeSource, orientations};
use crate::files::csv::shown;
use crate::geometry::{CameraFrame, to_wxyz};
use crate::spin::SpinRejection;
use crate::spin::alias::AliasConfig;
#[cfg(feature = "plot")]
use crate::spin::estimate::FittedMotion;
use crate::spin::estimate::{MotionModel, SpinEstimate};
use crate::spin::orientations::{BallColumns, OrientationRow, Orientations};
use crate::spin::summary::SpinSummary;
use crate::vision::optics::camera::BallCircle;
use crate::vision::{FrameEstimate, Pose};

/// The spin of a sequence and its motion, or why there is none.
pub(super) type FoundSpin = Result<(SpinSummary, ObservedMotion), SpinRejection>;

/// The spin, from the very orientations that are written: without other evidence `spindoe spin` on the file gives the same.
pub(super) fn found_spin(
    asked: &Asked,
    (file, times): (&Orientations, &TimeSource),
    model: MotionModel,
    evidence: &SequenceEvidence<'_>,
) -> FoundSpin {
    let config = file.spin_config(times.of_spin(asked.spin()));
    let listed = AliasConfig::of(&config);
    let measurements = file.measurements();
    let together = evidence.together();
    let estimate = match &together {
        Some(all) => SpinEstimate::fit_with(&measurements, model, &config, all),
        None => SpinEstimate::fit(&measurements, model, &config),
    };
    let frames = file.rows.len();
    let (summary, motion) =
        ObservedMotion::new(estimate?, model, &measurements, None, &listed, frames);
    let summary = match &together {
        Some(all) => summary.weighed(all, &listed),
        None => summary,
    };
    Ok((summary, motion))
}

/// A spin and its motion by the crate's axes, as pages show them.
#[cfg(feature = "plot")]
pub(super) fn by_own_axes(
    spin: &FoundSpin,
    axes: CameraFrame,
) -> Result<(SpinSummary, FittedMotion), SpinRejection> {
    let (summary, motion) = spin.as_ref().map_err(|rejection| *rejection)?;
    let turn = axes.turn();
    let motion = match motion.estimate.motion.clone() {
        FittedMotion::Free(fit) => FittedMotion::Free(fit.turned(&turn)),
        other => other,
    };
    Ok((summary.clone().turned(&turn), motion))
}

/// The row of a frame that stands for itself.
pub(in crate::cli) fn own_row(named: NamedFrame<'_>, axes: CameraFrame) -> OrientationRow {
    let file = orientations(&[named], axes, false);
    file.rows.into_iter().next().unwrap_or_default()
}

/// A ball of a frame as JSON, its orientation as its row has it.
pub(in crate::cli) fn ball_json(
    row: &OrientationRow,
    axes: CameraFrame,
    ball: &FrameEstimate,
) -> Value {
    let mut json = json!({
        "circle": ball.circle.as_ref().map(circle_json),
        "outline_source": ball.outline.map(|o| o.source),
        "dots": ball.dots.len(),
        "matched": ball.matched(),
    });
    add_orientation(row, axes, &mut json);
    match &ball.outcome {
        Ok(pose) => add_pose(pose, &mut json),
        Err(rejection) => json["refusal"] = rejection.to_string().into(),
    }
    json
}

pub(in crate::cli) fn circle_json(circle: &BallCircle) -> Value {
    json!({ "u": circle.center.u, "v": circle.center.v, "radius": circle.radius })
}

/// Adds a row's orientation and the ball's center, where it has them.
pub(super) fn add_orientation(row: &OrientationRow, axes: CameraFrame, json: &mut Value) {
    if let Some(orientation) = &row.orientation {
        json["orientation_wxyz"] = json!(to_wxyz(orientation));
        json["camera_frame"] = json!(axes);
        json["covariance_rad2"] = json!(row.covariance.as_ref().map(rows));
    }
    if let Some(position) = &row.position {
        json["position_m"] = json!(<[f64; 3]>::from(position.center_m));
        json["position_covariance_m2"] = json!(rows(&position.covariance));
        json["camera_frame"] = json!(axes);
    }
    if let Some(both) = row.position.as_ref().and_then(|p| p.with_rotation) {
        json["position_rotation_covariance_m_rad"] = json!(rows(&both));
    }
    if let Some(turn) = &row.turn {
        json["view_turn_rad"] = json!(<[f64; 3]>::from(turn.turn_rad));
        json["view_shared_rad"] = json!(turn.shared_rad.map(<[f64; 3]>::from));
    }
}

fn rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[(i, j)]))
}

/// Adds what is known of an orientation.
fn add_pose(pose: &Pose, json: &mut Value) {
    json["residual_deg"] = pose.residual_rad.to_degrees().into();
    json["residual_px"] = pose.residual_px.into();
    json["dots_confidence"] = pose.dots_confidence.into();
    json["confidence"] = pose.confidence.into();
    json["hinted"] = pose.hinted.into();
    if let Some(distance) = pose.distance {
        json["inverse_distance"] = distance.inverse_distance.into();
        json["inverse_distance_sigma"] = distance.sigma.into();
    }
}

/// A ball of a frame: its row, the same as JSON, and what is to be said of it.
pub(in crate::cli) struct WrittenRow {
    pub row: OrientationRow,
    pub json: Value,
    /// Why the frame is to be named among those that need a look.
    pub note: Option<String>,
}

/// A clip as all modes write it: the rows of each frame's balls.
pub(super) struct ClipRows<'a, K> {
    pub asked: &'a Asked,
    /// The frame of orientations and spins.
    pub axes: CameraFrame,
    pub batch: &'a Batch<K>,
    /// For each frame its balls.
    pub frames: Vec<Vec<WrittenRow>>,
    /// What is written of several balls. Where there is one, its values in JSON are those of the frame.
    pub columns: BallColumns,
}

impl<K> ClipRows<'_, K> {
    /// All rows as a file has them.
    pub fn orientations(&self) -> Orientations {
        Orientations {
            rows: self
                .frames
                .iter()
                .flatten()
                .map(|r| r.row.clone())
                .collect(),
            camera_frame: Some(self.axes),
            columns: self.columns,
        }
    }

    /// Balls with an orientation.
    pub fn identified(&self) -> usize {
        let all = self.frames.iter().flatten();
        all.filter(|r| r.row.orientation.is_some()).count()
    }

    /// The rows as they are asked for.
    ///
    /// # Errors
    /// Those of [`crate::spin::fictrac::rows`].
    pub fn text(&self) -> crate::error::Result<String> {
        self.asked.rows(&self.orientations())
    }

    /// The clip as JSON.
    pub fn to_json(&self) -> Value {
        let frames = self.batch.frames.iter().zip(&self.frames);
        let frames = frames.map(|(frame, rows)| {
            let mut json = match &rows[..] {
                [row] if !self.columns.ball => row.json.clone(),
                _ => json!({ "balls": rows.iter().map(|r| &r.json).collect::<Vec<_>>() }),
            };
            json["frame"] = frame.name.as_str().into();
            json["time_s"] = frame.time_s.into();
            if let Some(words) = &frame.unreadable {
                json["refusal"] = words.as_str().into();
            }
            json
        });
        let skipped = self.batch.skipped.iter();
        let skipped = skipped.map(|s| json!({ "folder": s.folder, "files": s.names }));
        json!({
            "frame": self.axes,
            "mirrored": self.asked.mirrored,
            "frames": frames.collect::<Vec<_>>(),
            "identified": self.identified(),
            "times": self.batch.times,
            "times_words": inputs::times_words(&self.batch.times, self.batch.frames.len()),
            "verdict": VerdictWords::new(&self.batch.judgment, &self.asked.table).to_json(),
            "skipped": skipped.collect::<Vec<_>>(),
            "focal_doubt": self.batch.focal_doubt,
        })
    }

    /// What is to be known of a clip's files and camera, on standard error.
    pub fn say_inputs(&self) {
        inputs::say_skipped(&self.batch.skipped);
        inputs::say_cut_short(&self.batch.cut_short);
        inputs::say_camera(self.batch.focal_doubt.as_ref());
    }

    /// What is to be said of a frame and its balls, on standard error.
    pub fn say_frame(&self, k: usize) {
        let frame = &self.batch.frames[k];
        if let Some(why) = &frame.unreadable {
            errln!("{why}");
            return;
        }
        for row in &self.frames[k] {
            if let Some(note) = &row.note {
                let number = row.row.ball.map(|b| format!(", ball {b}"));
                errln!(
                    "{}{}: {note}",
                    shown(&frame.name),
                    number.unwrap_or_default()
                );
            }
        }
    }
}

/// Adds the spin, or why there is none; nothing where there are no times.
pub(super) fn add_spin(spin: Option<&FoundSpin>, axes: CameraFrame, json: &mut Value) {
    match spin {
        Some(Ok((summary, motion))) => {
            json["spin"] = spin_summary::to_json(summary, axes);
            motion.add_to(&mut json["spin"]);
        }
        Some(Err(rejection)) => json["spin_refusal"] = rejection.to_string().into(),
        None => {}
    }
}

/// The spin in words.
pub(super) fn spin_words(spin: Option<&FoundSpin>, axes: CameraFrame) -> Option<String> {
    spin.map(|spin| match spin {
        Ok((summary, motion)) => {
            let mut lines = spin_summary::lines(summary, axes);
            lines.extend(motion.lines());
            lines.join("\n")
        }
        Err(rejection) => rejection.to_string(),
    })
}

/// Says where the times came from.
pub(super) fn say_times<K>(batch: &Batch<K>) {
    if let Some(words) = inputs::times_words(&batch.times, batch.frames.len()) {
        errln!("times: {words}");
    }
}
