//! Frames of one flight help each other: a ball turns evenly for a while.
//!
//! Frames that are told alone give the spin around each of their neighbors in time; where it predicts the
//! orientation of a frame that is not told, or told otherwise, that is a [`Hint`] to tell the frame again. A hint may be
//! wrong, and says so: the recognizer weighs it against the dots. It is made of other frames only, so that no frame
//! confirms itself. This goes on, forwards and backwards, until nothing changes.

use nalgebra::Matrix3;

use super::{Estimator, EstimatorWorkspace, FrameEstimate};
use crate::recognize::robust::Hint;
use crate::spin::dots::{DotFrame, DotRefineConfig, SeenDot, refine_on_dots};
use crate::spin::robust::{RobustEstimator, RobustSpinConfig};
use crate::spin::{Fit, MIN_FRAMES, Measurement, SpinRejection};
use crate::vision::detect::DotDetector;

/// How frames of a sequence help each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequenceConfig {
    /// Estimation of the spin.
    pub spin: RobustSpinConfig,
    /// PoseHypothesis frames nearest in time that predict a frame.
    pub neighbors: usize,
    /// Error of a predicted orientation beyond the fit's own, radians, about every axis: the spin changes, and so does the
    /// direction under which the ball is seen.
    pub hint_sigma_rad: f64,
    /// Probability that a hint is altogether wrong.
    pub wrong: f64,
    /// A told frame farther off the predicted orientation than this, radians, is told again.
    pub disagreement_rad: f64,
    /// Least probability of frames that predict others.
    pub trusted: f64,
    /// Rounds at most.
    pub rounds: usize,
}

impl Default for SequenceConfig {
    /// Ten neighbors, 5 deg, one hint in ten wrong, doubt from 25 deg, frames of 0.8, four rounds.
    fn default() -> Self {
        Self {
            spin: RobustSpinConfig::default(),
            neighbors: 10,
            hint_sigma_rad: 5f64.to_radians(),
            wrong: 0.1,
            disagreement_rad: 25f64.to_radians(),
            trusted: 0.8,
            rounds: 4,
        }
    }
}

/// What a pass over a sequence did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SequenceSummary {
    /// Frames told before.
    pub alone: usize,
    /// Frames told now.
    pub together: usize,
}

/// Tells the frames of one sequence, which were looked at, again with the help of each other. `times_s` are in seconds, one
/// a frame, each later than the one before.
pub fn track_sequence<D: DotDetector>(
    estimator: &Estimator<D>,
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &mut [FrameEstimate],
    ws: &mut EstimatorWorkspace<D::Workspace>,
) -> SequenceSummary {
    let told = |frames: &[FrameEstimate]| frames.iter().filter(|f| f.pose().is_some()).count();
    let alone = told(frames);
    let mut fitter = RobustEstimator::new(config.spin);
    let mut around = Vec::new();
    for _ in 0..config.rounds {
        let mut changed = false;
        for i in 0..frames.len().min(times_s.len()) {
            if frames[i].circle.is_none() {
                continue;
            }
            neighbors(config, times_s, frames, i, &mut around);
            let Ok(fit) = fitter.fit(&around) else {
                continue;
            };
            let hint = predict(config, &fit, &around, times_s[i]);
            let off = frames[i]
                .pose()
                .map(|pose| pose.rotation.angle_to(&hint.rotation));
            if off.is_some_and(|angle| angle < config.disagreement_rad) {
                continue;
            }
            let before = frames[i].pose().map(|p| (p.rotation, p.hinted));
            estimator.estimate_pose(Some(&hint), ws, &mut frames[i]);
            changed |= match (before, frames[i].pose()) {
                (None, None) => false,
                (Some((rotation, _)), Some(pose)) => {
                    rotation.angle_to(&pose.rotation) > config.disagreement_rad
                }
                _ => true,
            };
        }
        if !changed {
            break;
        }
    }
    SequenceSummary {
        alone,
        together: told(frames),
    }
}

/// The told frames nearest in time to frame `i`, without it, in order of time.
fn neighbors(
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &[FrameEstimate],
    i: usize,
    into: &mut Vec<Measurement>,
) {
    into.clear();
    let measurement = |k: usize| {
        let pose = frames[k].pose()?;
        (pose.pose_confidence >= config.trusted)
            .then(|| measurement(times_s[k], pose.rotation, pose.pose_confidence))
    };
    let (mut before, mut after) = (i, i + 1);
    while into.len() < config.neighbors {
        let left = before.checked_sub(1).map(|k| times_s[i] - times_s[k]);
        let right = times_s.get(after).map(|t| t - times_s[i]);
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
        into.extend(measurement(k));
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
fn predict(config: &SequenceConfig, fit: &Fit, around: &[Measurement], time_s: f64) -> Hint {
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

/// The spin of a sequence, refined on the dots of the frames that agree with it.
///
/// # Errors
/// A [`SpinRejection`] where too few frames are told, or they agree on nothing.
pub fn estimate_spin<D: DotDetector>(
    estimator: &Estimator<D>,
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &[FrameEstimate],
) -> Result<Fit, SpinRejection> {
    let poses = || {
        times_s
            .iter()
            .zip(frames)
            .filter(|(_, f)| f.pose().is_some())
    };
    let measurements: Vec<_> = poses()
        .filter_map(|(t, f)| {
            f.pose()
                .map(|p| measurement(*t, p.rotation, p.pose_confidence))
        })
        .collect();
    let mut fitter = RobustEstimator::new(config.spin);
    let fit = fitter.fit(&measurements)?;
    let agreeing: Vec<_> = poses()
        .zip(fitter.inlier_probabilities())
        .filter(|(_, p)| **p > 0.5)
        .map(|((t, frame), _)| DotFrame {
            time_s: *t,
            dots: estimator
                .named_directions(frame)
                .map(|(dot, direction)| SeenDot {
                    dot: usize::from(dot),
                    direction,
                })
                .collect(),
        })
        .collect();
    if agreeing.len() < MIN_FRAMES {
        return Ok(fit);
    }
    // A refinement that fails leaves the fit to the orientations, which stands by itself.
    let refined = refine_on_dots(
        estimator.pattern(),
        &agreeing,
        &fit,
        &DotRefineConfig::default(),
    );
    Ok(refined.unwrap_or(fit))
}
