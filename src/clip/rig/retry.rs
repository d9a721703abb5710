//! Frames that one camera misses, looked at again where another one expects the ball.
//!
//! The other camera's orientation, turned into this camera's frame, is a hint, and its position, projected, says where to look. The answer is
//! fitted to this camera's own dots.

use nalgebra::Matrix3;

use super::fuse::{CameraReading, quantile_999};
use super::{Assembly, CameraClip};
use crate::clip::sequence::{FrameInDoubt, ImageResults, ImageWork, TRUSTED};
use crate::image::ImageView;
use crate::recognize::Hint;
use crate::vision::estimator::EstimatorWorkspace;
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};
use crate::vision::frame::prior::{OutlinePrior, Prior};
use crate::vision::optics::camera::{BallView, Camera};

/// Standard deviation of another camera's orientation beyond its own, about every axis: that of extrinsics.
const HINT_SIGMA_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// An expected outline is where to look and no outline: at least this part of its radius is left open.
const MIN_SPREAD: f64 = 0.06;
/// Bounds of the probability that another camera's answer is altogether wrong.
const WRONG: (f64, f64) = (0.01, 0.5);

/// Looks again at the frames that cameras miss and others answer; how many were settled.
pub(super) fn missed<E>(
    rig: &Assembly<'_>,
    clips: &mut [CameraClip<'_>],
    on_images: &mut impl FnMut(usize, &[usize], &ImageWork<'_>) -> ImageResults<E>,
) -> std::result::Result<usize, E> {
    let doubts = in_doubt(rig, clips);
    let mut settled = 0;
    for (camera, mut doubts) in doubts.into_iter().enumerate() {
        doubts.sort_by_key(|doubt| doubt.frame);
        let numbers: Vec<usize> = doubts.iter().map(|doubt| doubt.frame).collect();
        if numbers.is_empty() {
            continue;
        }
        let (estimator, before) = (clips[camera].estimator, &clips[camera].frames);
        let stop = rig.config.sequence.stop;
        let again = |k: usize, image: ImageView<'_>, ws: &mut EstimatorWorkspace| {
            let doubt = &doubts[numbers.binary_search(&k).ok()?];
            estimator.estimate_again(image, doubt, &before[k], stop, ws)
        };
        for (k, found) in on_images(camera, &numbers, &again)? {
            settled += usize::from(found.pose().is_some());
            clips[camera].frames[k] = found;
        }
    }
    Ok(settled)
}

/// The frames of each camera that another one may settle.
fn in_doubt(rig: &Assembly<'_>, clips: &[CameraClip<'_>]) -> Vec<Vec<FrameInDoubt>> {
    let mut doubts: Vec<Vec<FrameInDoubt>> = clips.iter().map(|_| Vec::new()).collect();
    for group in rig.groups(clips) {
        let readings = rig.readings(&group, clips);
        for (camera, frame) in group.members.iter().enumerate() {
            let Some(frame) = frame.filter(|_| rig.counts[camera]) else {
                continue;
            };
            let estimate = &clips[camera].frames[frame];
            let trusted = readings.iter().filter(|(k, r)| {
                let is_own = *k == camera;
                !is_own && r.rotation.is_some() && !r.hinted && r.confidence >= TRUSTED
            });
            let surest = trusted.max_by(|a, b| a.1.confidence.total_cmp(&b.1.confidence));
            let Some((_, surest)) =
                surest.filter(|(_, r)| is_in_doubt(estimate, r, &readings, camera))
            else {
                continue;
            };
            if let Some(prior) = prior(rig, clips, camera, surest) {
                doubts[camera].push(FrameInDoubt::expected(frame, prior));
            }
        }
    }
    doubts
}

/// Whether a camera's frame has no pose, or one that contradicts a surer one.
fn is_in_doubt(
    estimate: &FrameEstimate,
    surest: &CameraReading,
    readings: &[(usize, CameraReading)],
    camera: usize,
) -> bool {
    if estimate.outcome == Err(FrameRejection::Unreadable) {
        return false;
    }
    let own = readings
        .iter()
        .find(|(k, r)| *k == camera && r.rotation.is_some());
    own.is_none_or(|(_, own)| {
        let turn = surest.rotation.zip(own.rotation);
        let off = turn.map_or(0.0, |(a, b)| a.angle_to(&b));
        let variance = (surest.block(0, 0) + own.block(0, 0)).trace() / 3.0;
        off * off > quantile_999(3) * variance && own.confidence < surest.confidence
    })
}

/// What another camera's reading says of a camera's frame.
fn prior(
    rig: &Assembly<'_>,
    clips: &[CameraClip<'_>],
    camera: usize,
    by: &CameraReading,
) -> Option<Prior> {
    let from_rig = rig.rig.cameras()[camera].extrinsics.in_camera_axes();
    let estimator = clips[camera].estimator;
    let CameraModel::Known(Camera::Perspective(k)) = estimator.config().camera else {
        return None;
    };
    let turned = crate::geometry::turned_covariance(&from_rig.rotation, &by.block(0, 0));
    let rotation = Hint {
        rotation: from_rig.rotation * by.rotation?,
        covariance: turned + Matrix3::from_diagonal_element(HINT_SIGMA_RAD.powi(2)),
        wrong: (1.0 - by.confidence).clamp(WRONG.0, WRONG.1),
    };
    let position = from_rig.place(&by.position()?);
    let radius_m = estimator.ball_radius_m();
    let circle = BallView::of_center(k, &(position.center_m / radius_m)).ok()?;
    let by_center = k.jacobian(&position.center_m);
    let spread = by_center * position.covariance * by_center.transpose();
    let across_px = spread.symmetric_eigenvalues().max().max(0.0).sqrt();
    let along = position.covariance.trace().sqrt() / position.center_m.norm();
    let sigma_px = across_px.max(along * circle.radius);
    Some(Prior {
        outline: Some(OutlinePrior::found(
            estimator.shown_circle(&circle),
            sigma_px.max(MIN_SPREAD * circle.radius),
        )),
        rotation: Some(rotation),
        ..Prior::default()
    })
}
