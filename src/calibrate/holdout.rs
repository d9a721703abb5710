//! What a calibration is worth on frames that it has not seen.
//!
//! The frames are dealt into folds. Each fold is identified with the nominal pattern, and with the
//! pattern that is calibrated on the other folds: the residuals of both are those of frames that took no
//! part. A pattern that fits only its own frames shows here.

use super::config::CalibrationConfig;
use super::identify::identify_frames;
use super::{Calibration, calibrate};
use crate::ball::Ball;
use crate::error::Result;
use crate::geometry::Rotation;
use crate::pattern::Pattern;
use crate::spin::Measurement;
use crate::spin::precession::{PrecessionOutcome, fit_precession};
use crate::spin::robust::{RobustEstimator, SpinConfig};
use crate::stats::median;
use crate::vision::FrameEstimate;

/// Up to so many frames each is a fold of its own; more are dealt into [`FOLDS`].
const LEAVE_ONE_OUT: usize = 30;
/// Folds of long clips.
const FOLDS: usize = 5;

/// How well a frame's named dots fit its pose.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FrameResidual {
    /// Root mean square angle between the named dots and the pattern, degrees.
    pub residual_deg: f64,
    /// Number of named dots.
    pub matched: usize,
}

/// A frame that took no part in the calibration it is judged by; `None` where it is not identified.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HeldOutFrame {
    /// Its position in the clip.
    pub frame: usize,
    /// With the nominal pattern.
    pub before: Option<FrameResidual>,
    /// With the pattern calibrated on other frames.
    pub after: Option<FrameResidual>,
}

/// The residuals of held-out frames.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HeldOut {
    /// Number of folds.
    pub folds: usize,
    /// The frames of the folds whose calibration succeeded.
    pub frames: Vec<HeldOutFrame>,
    /// Median residual over the frames identified with both patterns, degrees: before and after.
    pub median_deg: [f64; 2],
    /// Mean number of named dots in the same frames: before and after.
    pub mean_matched: [f64; 2],
}

/// Judges the calibration of this clip by cross-validation; see the module's head. The arguments are
/// those of [`calibrate`].
///
/// # Errors
/// As [`calibrate`].
pub fn held_out(
    nominal: &Pattern,
    frames: &[FrameEstimate],
    times_s: Option<&[f64]>,
    config: &CalibrationConfig,
) -> Result<HeldOut> {
    held_out_with(nominal, frames, times_s, config, &|_| {})
}

/// The same; `done` hears how many frames more have been judged.
///
/// # Errors
/// As [`held_out`].
pub fn held_out_with(
    nominal: &Pattern,
    frames: &[FrameEstimate],
    times_s: Option<&[f64]>,
    config: &CalibrationConfig,
    done: &(dyn Fn(usize) + Sync),
) -> Result<HeldOut> {
    let folds = if frames.len() <= LEAVE_ONE_OUT {
        frames.len()
    } else {
        FOLDS
    };
    let nominal_ball = Ball::new(nominal.clone());
    let judge = |fold: u64| -> Result<Vec<HeldOutFrame>> {
        let is_out = |k: &usize| *k % folds == fold as usize;
        let (out, kept): (Vec<usize>, Vec<usize>) = (0..frames.len()).partition(is_out);
        let of = |which: &[usize]| -> Vec<FrameEstimate> {
            which.iter().map(|&k| frames[k].clone()).collect()
        };
        let times: Option<Vec<f64>> = times_s.map(|t| kept.iter().map(|&k| t[k]).collect());
        let Ok(found) = calibrate(nominal, &of(&kept), times.as_deref(), config)? else {
            return Ok(Vec::new());
        };
        let unseen = of(&out);
        let before = identify_frames(&nominal_ball, &config.estimator, &unseen)?;
        let after = identify_frames(&found.ball(None)?, &config.estimator, &unseen)?;
        done(out.len());
        let judged = out.iter().zip(before.iter().zip(&after));
        Ok(judged
            .map(|(&frame, (before, after))| HeldOutFrame {
                frame,
                before: residual(before),
                after: residual(after),
            })
            .collect())
    };
    let judged: Result<Vec<_>> = crate::concurrency::map_range(0..folds as u64, judge)
        .into_iter()
        .collect();
    Ok(HeldOut::of(folds, judged?.into_iter().flatten().collect()))
}

impl HeldOut {
    fn of(folds: usize, mut frames: Vec<HeldOutFrame>) -> Self {
        frames.sort_by_key(|f| f.frame);
        let both: Vec<[FrameResidual; 2]> = frames
            .iter()
            .filter_map(|f| Some([f.before?, f.after?]))
            .collect();
        let of = |side: usize| {
            let mut residuals: Vec<f64> = both.iter().map(|b| b[side].residual_deg).collect();
            let matched: usize = both.iter().map(|b| b[side].matched).sum();
            (
                median(&mut residuals),
                matched as f64 / both.len().max(1) as f64,
            )
        };
        let (before, after) = (of(0), of(1));
        Self {
            folds,
            frames,
            median_deg: [before.0, after.0],
            mean_matched: [before.1, after.1],
        }
    }
}

fn residual(frame: &FrameEstimate) -> Option<FrameResidual> {
    let pose = frame.pose()?;
    Some(FrameResidual {
        residual_deg: pose.residual_rad.to_degrees(),
        matched: frame.matched(),
    })
}

/// How well orientations follow one smooth rotation.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MotionResidual {
    /// Number of frames that agree.
    pub frames: usize,
    /// Root mean square angle of these from the one motion, degrees.
    pub rms_deg: f64,
    /// The median of all frames with an orientation, degrees.
    pub median_deg: f64,
    /// Whether that rotation is the one of an uneven ball: see [`crate::spin::precession`].
    pub precessing: bool,
}

/// The angle of each orientation from that of one spin, precessing where there is evidence for it;
/// `None` where no spin explains them.
pub fn motion_residual(frames: &[FrameEstimate], times_s: &[f64]) -> Option<MotionResidual> {
    let measured: Vec<Measurement> = frames
        .iter()
        .zip(times_s)
        .filter_map(|(frame, time_s)| Some(Measurement::new(*time_s, frame.pose()?.rotation)))
        .collect();
    let precession = fit_precession(&measured, &SpinConfig::default()).ok();
    let (inliers, mut angles) = match precession {
        Some(PrecessionOutcome::Found { fit, .. }) => {
            (fit.inliers, angles_off(&measured, |t| fit.motion.at(t)))
        }
        Some(PrecessionOutcome::Constant { fit, .. }) => {
            (fit.inliers, angles_off(&measured, |t| fit.motion.at(t)))
        }
        None => {
            let fit = RobustEstimator::new(SpinConfig::default())
                .fit(&measured)
                .ok()?;
            (fit.inliers, angles_off(&measured, |t| fit.motion.at(t)))
        }
    };
    angles.sort_unstable_by(f64::total_cmp);
    let agreeing = &angles[..inliers.min(angles.len())];
    let squares: f64 = agreeing.iter().map(|a| a * a).sum();
    Some(MotionResidual {
        frames: agreeing.len(),
        rms_deg: (squares / agreeing.len().max(1) as f64).sqrt(),
        median_deg: median(&mut angles),
        precessing: matches!(precession, Some(PrecessionOutcome::Found { .. })),
    })
}

/// The angles of the orientations from a motion's, degrees.
fn angles_off(measured: &[Measurement], motion: impl Fn(f64) -> Rotation) -> Vec<f64> {
    let angle = |m: &Measurement| motion(m.time_s).angle_to(&m.orientation).to_degrees();
    measured.iter().map(angle).collect()
}

impl Calibration {
    /// The residual to one spin of the frames as given, and as identified with the calibrated pattern;
    /// `None` where no one spin explains either.
    pub fn motion_residuals(
        &self,
        given: &[FrameEstimate],
        times_s: &[f64],
    ) -> Option<[MotionResidual; 2]> {
        Some([
            motion_residual(given, times_s)?,
            motion_residual(&self.frames, times_s)?,
        ])
    }
}
