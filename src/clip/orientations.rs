//! Estimated frames as a file of orientations, which `spindoe spin` and the spin estimators read.

use super::sequence_view::SequenceView;
use crate::geometry::{CameraFrame, turned_covariance};
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::vision::frame::estimate::FrameEstimate;

/// A frame of a file of orientations.
#[derive(Debug, Clone, Copy)]
pub struct NamedFrame<'a> {
    /// The frame's name.
    pub name: &'a str,
    /// Its time, seconds, if it has one.
    pub time_s: Option<f64>,
    /// What was estimated.
    pub estimate: &'a FrameEstimate,
}

impl<'a> NamedFrame<'a> {
    /// A frame without a name.
    pub fn of(time_s: f64, estimate: &'a FrameEstimate) -> Self {
        Self {
            name: "",
            time_s: Some(time_s),
            estimate,
        }
    }

    /// Frames of a sequence without names, with their times in seconds.
    pub fn of_times(times_s: &[f64], estimates: &'a [FrameEstimate]) -> Vec<Self> {
        let timed = times_s.iter().zip(estimates);
        let named = timed.map(|(time_s, estimate)| Self::of(*time_s, estimate));
        named.collect()
    }
}

/// The orientations of frames, in `frame`. View frames ([`CameraModel::is_view`](crate::vision::frame::config::CameraModel::is_view)) of a sequence are
/// brought into one ([`SequenceView`]); else each row is in its own.
pub fn orientations(
    frames: &[NamedFrame<'_>],
    frame: CameraFrame,
    is_sequence: bool,
) -> Orientations {
    let estimates = frames.iter().map(|f| f.estimate);
    let view = SequenceView::of_frames(estimates).filter(|_| is_sequence);
    let row = |named: &NamedFrame<'_>| {
        let estimate = named.estimate;
        let pose = estimate.pose();
        let place = |view: SequenceView| Some(view.place(&estimate.circle?, pose?));
        let placed = view.and_then(place);
        let seen = placed.map(|p| (p.rotation, p.covariance()));
        let seen = seen.or(pose.map(|p| (p.rotation, p.covariance)));
        OrientationRow {
            frame: named.name.to_owned(),
            time_s: named.time_s.unwrap_or(f64::NAN),
            orientation: seen.map(|(rotation, _)| frame.turn() * rotation),
            dots: Some(estimate.dots.len()),
            matched: Some(estimate.matched()),
            residual_rad: pose.map(|p| p.residual_rad),
            confidence: pose.map(|p| p.confidence),
            covariance: seen.map(|(_, covariance)| turned_covariance(&frame.turn(), &covariance)),
            position: estimate.position().map(|p| p.turned(&frame.turn())),
            turn: placed.map(|p| p.turn.in_axes(frame)),
            ..OrientationRow::default()
        }
    };
    Orientations {
        rows: frames.iter().map(row).collect(),
        camera_frame: Some(frame),
        ..Orientations::default()
    }
}
