//! What all modes write alike: the rows of a clip or stream as a file and as JSON, and what is said of it.

use nalgebra::Matrix3;
use serde_json::{Value, json};

use super::Asked;
use super::verdict::VerdictWords;
use crate::cli::{inputs, spin_summary};
use crate::clip::{Batch, NamedFrame, orientations};
use crate::geometry::{CameraFrame, to_wxyz};
use crate::spin::SpinRejection;
use crate::spin::orientations::OrientationRow;
use crate::spin::summary::SpinSummary;
use crate::vision::optics::camera::BallCircle;
use crate::vision::{FrameEstimate, Pose};

/// The spin of a sequence, or why there is none.
pub(super) type FoundSpin = Result<SpinSummary, SpinRejection>;

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

pub(super) fn circle_json(circle: &BallCircle) -> Value {
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

/// A clip as JSON, with these frames.
pub(super) fn clip_json<K>(
    asked: &Asked,
    axes: CameraFrame,
    batch: &Batch<K>,
    frames: Vec<Value>,
    identified: usize,
) -> Value {
    let skipped = batch.skipped.iter();
    let skipped = skipped.map(|s| json!({ "folder": s.folder, "files": s.names }));
    json!({
        "frame": axes,
        "mirrored": asked.mirrored,
        "frames": frames,
        "identified": identified,
        "times": batch.times,
        "times_words": inputs::times_words(&batch.times, batch.frames.len()),
        "verdict": VerdictWords::new(&batch.judgment, &asked.table).to_json(),
        "skipped": skipped.collect::<Vec<_>>(),
        "focal_doubt": batch.focal_doubt,
    })
}

/// Adds the spin, or why there is none; nothing where there are no times.
pub(super) fn add_spin(spin: Option<&FoundSpin>, axes: CameraFrame, json: &mut Value) {
    match spin {
        Some(Ok(summary)) => json["spin"] = spin_summary::to_json(summary, axes),
        Some(Err(rejection)) => json["spin_refusal"] = rejection.to_string().into(),
        None => {}
    }
}

/// The spin in words.
pub(super) fn spin_words(spin: Option<&FoundSpin>, axes: CameraFrame) -> Option<String> {
    spin.map(|spin| match spin {
        Ok(summary) => spin_summary::lines(summary, axes).join("\n"),
        Err(rejection) => rejection.to_string(),
    })
}

/// Says where the times came from.
pub(super) fn say_times<K>(batch: &Batch<K>) {
    if let Some(words) = inputs::times_words(&batch.times, batch.frames.len()) {
        errln!("times: {words}");
    }
}
