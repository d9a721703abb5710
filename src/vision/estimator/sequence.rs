//! Frames of one sequence help each other: a ball turns evenly for a while.
//!
//! Frames that are identified independently give the spin around each of their neighbors in time; where it predicts the
//! orientation of a frame that has no pose, or another one, that is a [`Hint`] to identify the frame again. A hint may be
//! wrong, and says so: the recognizer weighs it against the dots.
//!
//! A hint is made of other frames only, and only of poses found without a hint: no frame confirms
//! itself, neither directly nor by way of a frame that it has itself hinted at.

use nalgebra::Matrix3;

use super::{Estimator, EstimatorWorkspace, FrameEstimate, OutlineSource, Pose};
use crate::recognize::Hint;
use crate::spin::robust::{RobustEstimator, SpinConfig};
use crate::spin::shared::SharedError;
use crate::spin::{Fit, Measurement, SpinRejection};
use crate::vision::detect::DotDetector;

/// No orientation is known better than this, radians: a tenth of a degree.
const MIN_SIGMA_RAD: f64 = 1.75e-3;

/// How frames of a sequence help each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequenceConfig {
    /// Estimation of the spin.
    pub spin: SpinConfig,
    /// Independent frames nearest in time that predict a frame.
    pub neighbors: usize,
    /// Error of a predicted orientation beyond the fit's own, radians, about every axis: the spin changes, and so does the
    /// direction under which the ball is seen.
    pub hint_sigma_rad: f64,
    /// Probability that a hint is altogether wrong.
    pub wrong: f64,
    /// A frame farther off the predicted orientation than this, radians, is estimated again.
    pub disagreement_rad: f64,
    /// Minimum probability of frames that predict others.
    pub trusted: f64,
}

impl Default for SequenceConfig {
    /// Ten neighbors, 5 deg, one hint in ten wrong, doubt from 25 deg, frames of 0.8.
    fn default() -> Self {
        Self {
            spin: SpinConfig::default(),
            neighbors: 10,
            hint_sigma_rad: 5f64.to_radians(),
            wrong: 0.1,
            disagreement_rad: 25f64.to_radians(),
            trusted: 0.8,
        }
    }
}

/// What a pass over a sequence did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SequenceSummary {
    /// Frames with a pose of their own: without a hint, on an outline that was found in the frame alone.
    pub alone: usize,
    /// Frames with a pose now.
    pub together: usize,
}

/// Estimates the frames of one sequence, which were processed, again with the help of each other. `times_s` are in seconds, one
/// a frame, each later than the one before.
pub fn track_sequence<D: DotDetector>(
    estimator: &Estimator<D>,
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &mut [FrameEstimate],
    ws: &mut EstimatorWorkspace<D::Workspace>,
) -> SequenceSummary {
    let is_own = |f: &&FrameEstimate| {
        f.outline_source != OutlineSource::Neighbors && f.pose().is_some_and(|p| !p.hinted)
    };
    let alone = frames.iter().filter(is_own).count();
    // What an earlier hint has brought is no evidence; it is found again if the frames still say so.
    for frame in frames.iter_mut() {
        if frame.pose().is_some_and(|p| p.hinted) {
            estimator.estimate_pose(None, ws, frame);
        }
    }
    let independent: Vec<Option<Measurement>> = times_s
        .iter()
        .zip(&*frames)
        .map(|(time_s, frame)| {
            let pose = frame.pose()?;
            (pose.pose_confidence >= config.trusted)
                .then(|| measurement(*time_s, pose.rotation, pose.pose_confidence))
        })
        .collect();
    let mut fitter = RobustEstimator::new(config.spin);
    let mut around = Vec::new();
    for (i, (time_s, frame)) in times_s.iter().zip(frames.iter_mut()).enumerate() {
        if frame.circle.is_none() {
            continue;
        }
        neighbors(config, times_s, &independent, i, &mut around);
        let Ok(fit) = fitter.fit(&around) else {
            continue;
        };
        let hint = predict(config, &fit, &around, *time_s);
        let off = frame
            .pose()
            .map(|pose| pose.rotation.angle_to(&hint.rotation));
        if off.is_none_or(|angle| angle >= config.disagreement_rad) {
            estimator.estimate_pose(Some(&hint), ws, frame);
        }
    }
    SequenceSummary {
        alone,
        together: frames.iter().filter(|f| f.pose().is_some()).count(),
    }
}

/// The measurements nearest in time to frame `i`, without its own, in order of time.
fn neighbors(
    config: &SequenceConfig,
    times_s: &[f64],
    measurements: &[Option<Measurement>],
    i: usize,
    into: &mut Vec<Measurement>,
) {
    into.clear();
    let (mut before, mut after) = (i, i + 1);
    while into.len() < config.neighbors {
        let left = before.checked_sub(1).map(|k| times_s[i] - times_s[k]);
        let right = times_s[..measurements.len()]
            .get(after)
            .map(|t| t - times_s[i]);
        let go_left = match (left, right) {
            (None, None) => break,
            (Some(l), Some(r)) => l <= r,
            (l, _) => l.is_some(),
        };
        let k = if go_left {
            before -= 1;
            before
        } else {
            after += 1;
            after - 1
        };
        into.extend(measurements[k]);
    }
    into.sort_unstable_by(|a, b| a.time_s.total_cmp(&b.time_s));
}

fn measurement(
    time_s: f64,
    orientation: crate::geometry::Rotation,
    confidence: f64,
) -> Measurement {
    Measurement {
        confidence,
        ..Measurement::new(time_s, orientation)
    }
}

/// The orientation at `time_s` by a fit, with its error.
pub(super) fn predict(
    config: &SequenceConfig,
    fit: &Fit,
    around: &[Measurement],
    time_s: f64,
) -> Hint {
    // The fit is best known amid its frames; from there its error grows with the spin's.
    let middle = around.iter().map(|m| m.time_s).sum::<f64>() / around.len().max(1) as f64;
    let elapsed = time_s - middle;
    let own = fit
        .spin_covariance
        .map_or(Matrix3::zeros(), |c| c * (elapsed * elapsed));
    let noise = fit.sigma_rad.unwrap_or(config.spin.sigma_rad) / (fit.inliers.max(1) as f64).sqrt();
    let sigma2 = config.hint_sigma_rad.powi(2) + noise * noise;
    Hint {
        rotation: fit.motion.at(time_s),
        covariance: own + Matrix3::from_diagonal_element(sigma2),
        wrong: config.wrong,
    }
}

/// The spin of a sequence, from the orientations of its frames.
///
/// Each frame has the weight of its pose's covariance; how large the deviations are altogether is
/// estimated from the residuals, with the covariances' typical value for a prior.
///
/// It is not refined on the dots of all frames: those of one frame share the errors of its outline and of the camera's
/// distance, so that taking them as independent makes the covariance too small and the spin no better.
///
/// # Errors
/// A [`SpinRejection`] where too few frames have a pose, or they agree on nothing.
pub fn estimate_spin(
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &[FrameEstimate],
) -> Result<Fit, SpinRejection> {
    let poses = || {
        let frames = times_s.iter().zip(frames);
        frames.filter_map(|(time_s, frame)| Some((*time_s, frame.pose()?)))
    };
    let mut sigmas: Vec<f64> = poses().map(|(_, pose)| sigma(pose)).collect();
    sigmas.sort_unstable_by(f64::total_cmp);
    let Some(&typical) = sigmas.get(sigmas.len() / 2) else {
        return RobustEstimator::new(config.spin).fit(&[]);
    };
    let measurements: Vec<_> = poses()
        .map(|(time_s, pose)| Measurement {
            sigma_scale: sigma(pose) / typical,
            ..measurement(time_s, pose.rotation, pose.pose_confidence)
        })
        .collect();
    let spin = SpinConfig {
        sigma_rad: typical,
        shared: SharedError::of_residuals(poses().map(|(_, pose)| pose.residual_rad)),
        ..config.spin
    };
    RobustEstimator::new(spin).fit(&measurements)
}

/// Standard deviation of a pose about an axis, radians: the root mean square over all axes.
fn sigma(pose: &Pose) -> f64 {
    (pose.covariance.trace() / 3.0)
        .max(MIN_SIGMA_RAD * MIN_SIGMA_RAD)
        .sqrt()
}
