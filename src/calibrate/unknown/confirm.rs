//! The dots of a built pattern, measured: a calibration by detections, and the pixels of its frames.

use nalgebra::Matrix2;

use super::{BuiltPattern, MissingSide, UnknownRejection};
use crate::calibrate::bundle::Observation;
use crate::calibrate::calibrate;
use crate::calibrate::config::CalibrationConfig;
use crate::calibrate::fitted::FittedFrame;
use crate::calibrate::identify::identify_frames;
use crate::calibrate::pixels::{Landmark, PosedFrame, by_pixels};
use crate::calibrate::result::{CalibratedDot, Calibration, CalibrationRejection, DotState};
use crate::error::{Result, require};
use crate::geometry::angle_between;
use crate::surface::PaintedFrame;
use crate::vision::FrameEstimate;

/// A dot's place is known where its standard deviation per axis is no larger, radians. On nine plain balls (`bench calibration-unknown`, seed
/// 35200020) seven dots were known so to the estimator alone: all within 0.7 degrees.
const KNOWN_RAD: f64 = 0.3 * std::f64::consts::PI / 180.0;
/// Estimator and pixels that both know a place and differ by more, radians: one of them errs, and neither says which.
const APART_RAD: f64 = std::f64::consts::PI / 180.0;

/// Calibrates a built pattern, with each dot where it is known best: where the estimator has found it, or where the pixels of its frames
/// show it. These are not misled by detections of neighbors. `frames` are the clip's, identified with the pattern, `shown` is what they show, as
/// [`survey`](super::survey) was given it, and `times_s` their times in seconds, where all are known.
///
/// # Errors
/// As [`calibrate`]; [`Error::Argument`](crate::Error::Argument) where `shown` is of another number than the frames. Where neither estimator nor pixels know
/// the place of a dot, or each knows another, that is no error but [`UnknownRejection::Unconfirmed`].
pub fn calibrate_built(
    built: &BuiltPattern,
    frames: &[FrameEstimate],
    shown: &[PaintedFrame],
    times_s: Option<&[f64]>,
    config: &CalibrationConfig,
) -> Result<std::result::Result<Calibration, UnknownRejection>> {
    let expected = "as many as the frames";
    require(shown.len() == frames.len(), "shown", expected, shown.len())?;
    let calibration = calibrate(&built.pattern, frames, times_s, config)?;
    match calibration {
        Ok(calibration) => confirmed(calibration, built, shown, times_s, config),
        Err(rejection) => Ok(Err(rejection.into())),
    }
}

impl From<CalibrationRejection> for UnknownRejection {
    fn from(rejection: CalibrationRejection) -> Self {
        match rejection {
            // There is no other table to be tried.
            CalibrationRejection::OtherBall { identified, balls } => {
                Self::Unidentified { identified, balls }
            }
            CalibrationRejection::Contradiction { missing, expected } => Self::Unconfirmed {
                dots: missing,
                found: expected,
                first: None,
            },
            other => Self::Uncalibrated(other),
        }
    }
}

/// A calibration, where estimator or pixels know all dots.
fn confirmed(
    mut calibration: Calibration,
    built: &BuiltPattern,
    shown: &[PaintedFrame],
    times_s: Option<&[f64]>,
    config: &CalibrationConfig,
) -> Result<std::result::Result<Calibration, UnknownRejection>> {
    let found = calibration.dots.len();
    let landmarks = landmarks(&calibration, built, shown, times_s, config);
    let is_known =
        |dot: &CalibratedDot| matches!(dot.state, DotState::Measured | DotState::Doubtful);
    let (mut unknown, mut is_renumbered) = (Vec::new(), false);
    for (j, dot) in calibration.dots.iter_mut().enumerate() {
        let by_pixels = landmarks.as_ref().and_then(|l| l.get(j));
        let found_rad = match is_known(dot) {
            true => dot.sigma_rad(),
            false => f64::INFINITY,
        };
        let (direction, seen_rad) = by_pixels.map_or((dot.direction, f64::INFINITY), |l| {
            (l.direction, l.known_to())
        });
        let is_apart = angle_between(&dot.direction, &direction) > APART_RAD;
        match () {
            () if found_rad.min(seen_rad) > KNOWN_RAD
                || is_apart && found_rad.max(seen_rad) <= KNOWN_RAD =>
            {
                unknown.push(direction);
            }
            () if found_rad <= seen_rad => {}
            () => {
                is_renumbered |= dot.state == DotState::Missing;
                dot.views = dot.views.max(by_pixels.map_or(0, |l| l.found));
                dot.state = DotState::Measured;
                dot.direction = direction;
                let variance = seen_rad.powi(2) + config.shared_sigma_rad.powi(2);
                dot.covariance = Matrix2::from_diagonal_element(variance);
            }
        }
    }
    let Some(first) = unknown.first() else {
        if is_renumbered {
            let ball = calibration.ball(None)?;
            calibration.frames = identify_frames(&ball, &config.estimator, &calibration.frames)?;
        }
        return Ok(Ok(calibration));
    };
    let seen = posed(&calibration, config).map(|f| (f.index, f.view.to_view * f.rotation * first));
    Ok(Err(UnknownRejection::Unconfirmed {
        dots: unknown.len(),
        found,
        first: MissingSide::of(seen),
    }))
}

/// The frames of a calibration whose orientation is beyond doubt.
fn posed(
    calibration: &Calibration,
    config: &CalibrationConfig,
) -> impl Iterator<Item = FittedFrame> {
    let frames = calibration.frames.iter().enumerate();
    frames.filter_map(|(k, frame)| {
        frame.pose().filter(|p| p.confidence >= config.trusted)?;
        FittedFrame::new(k, frame, &config.estimator.camera)
    })
}

/// The dots of a calibration by the pixels of its frames.
fn landmarks(
    calibration: &Calibration,
    built: &BuiltPattern,
    shown: &[PaintedFrame],
    times_s: Option<&[f64]>,
    config: &CalibrationConfig,
) -> Option<Vec<Landmark>> {
    if built.radii_rad.len() != calibration.dots.len() {
        return None;
    }
    let numbers = calibration.nominal_numbers();
    let frame = |fitted: FittedFrame| {
        let frame = &calibration.frames[fitted.index];
        let named = frame.dots.iter().zip(&frame.assignment);
        let detected = named.filter_map(|(dot, name)| {
            Some(Observation {
                dot: usize::from(numbers[usize::from((*name)?)]?),
                pixel: dot.pixel,
                covariance: dot.covariance,
            })
        });
        Some(PosedFrame {
            paint: &shown[fitted.index],
            view: fitted.view,
            outline: frame.outline?,
            axis: frame.axis,
            rotation: fitted.rotation,
            time_s: times_s.map(|t| t[fitted.index]),
            detected: detected.collect(),
        })
    };
    let frames = posed(calibration, config).filter_map(frame);
    let dots = calibration.dots.iter().map(|d| d.direction);
    let dots = dots.zip(built.radii_rad.iter().copied());
    by_pixels(
        frames.collect(),
        dots,
        &config.estimator.camera,
        config.smooth,
    )
}
