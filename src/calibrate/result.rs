//! The calibrated ball, or why there is none.

use nalgebra::{Matrix2, Matrix3, Matrix3x2};

use super::presence::FAR_OFF;
use crate::ball::{Ball, CalibrationRecord};
use crate::error::Result;
use crate::geometry::{Vec3, angle_between, tangent_frame};
use crate::pattern::Pattern;
use crate::stats::median;
use crate::vision::FrameEstimate;

/// Median length of a normal vector in the plane over its standard deviation per axis.
const MEDIAN_OFFSET: f64 = 1.1774;

/// What the clip says of a dot of the nominal pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DotState {
    /// It was seen, and its place is measured.
    Measured,
    /// Too few frames show its place on the ball: it stays at its nominal place.
    Unseen,
    /// Something is seen that may be no dot: print or a stain, beside which the dot is hidden or missing; or it
    /// is seen at the limb only. Its place is what is seen, and the standard deviation covers that.
    Doubtful,
    /// It is not found where it should be: forgotten, washed off, or on a dark mark. It is left out.
    Missing,
}

impl DotState {
    /// The name in reports.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Unseen => "unseen",
            Self::Doubtful => "doubtful",
            Self::Missing => "missing",
        }
    }
}

/// A dot of the nominal pattern as it was drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibratedDot {
    /// Its place in the nominal pattern.
    pub nominal: Vec3,
    /// Where it is, pattern frame; the nominal place where it was not measured.
    pub direction: Vec3,
    /// Covariance of the direction, rad^2, in the axes of
    /// [`tangent_frame(direction)`](crate::geometry::tangent_frame).
    pub covariance: Matrix2<f64>,
    /// Frames in which it was found; 0 for a dot that was not measured.
    pub views: usize,
    /// Frames in which it faced the camera well, and those of them in which it was found.
    pub facing_frames: usize,
    /// See `facing_frames`.
    pub facing_views: usize,
    /// Expected number of the latter, at a cautious estimate of the rate at which the other dots are found.
    pub expected_views: f64,
    /// The detector's mean probability that what is seen there is a dot, over that of the ball's middle dot; 1
    /// where nothing is seen.
    pub likeness: f64,
    /// See [`DotState`].
    pub state: DotState,
}

impl CalibratedDot {
    /// Angle from the nominal place, radians.
    pub fn offset_rad(&self) -> f64 {
        angle_between(&self.nominal, &self.direction)
    }

    /// Root mean square standard deviation per tangent axis, radians.
    pub fn sigma_rad(&self) -> f64 {
        rms_sigma_rad(&self.covariance)
    }
}

/// A mark on the ball that the pattern lacks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SteadyMark {
    /// Where it is, pattern frame.
    pub direction: Vec3,
    /// Covariance, as a dot's; `None` where the mark was not taken in.
    pub covariance: Option<Matrix2<f64>>,
    /// Frames in which it was found.
    pub found: usize,
    /// Frames in which it faced the camera well.
    pub views: usize,
}

/// A dot that is off by less is worth no word, however exactly the others were drawn: one degree.
const NOTICED_RAD: f64 = std::f64::consts::PI / 180.0;

/// The ball as it was drawn.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The dots of the nominal pattern, in its order.
    pub dots: Vec<CalibratedDot>,
    /// Steady marks that the pattern lacks.
    pub marks: Vec<SteadyMark>,
    /// All frames, identified with [`Calibration::pattern`].
    pub frames: Vec<FrameEstimate>,
    /// Frames that show a ball.
    pub with_ball: usize,
    /// Frames that took part in the fit.
    pub fitted: usize,
    /// Frames that show more than one ball.
    pub with_rivals: usize,
    /// Standard deviation of the detections over what the detector states.
    pub noise_scale: f64,
    /// Whether a smooth rotation was used.
    pub smooth: bool,
    /// Ball radii over the camera's distance, where that was fitted.
    pub inverse_distance: Option<f64>,
    /// Angle between the camera's axis and the ball, radians, where that was fitted.
    pub axis_rad: Option<f64>,
    /// Mean rate at which the detector finds a dot that faces the camera well.
    pub detection_rate: f64,
}

impl Calibration {
    /// The dots that are on the ball: the nominal ones that are not missing, then the marks that were
    /// taken in.
    ///
    /// # Errors
    /// As [`Pattern::new`].
    pub fn pattern(&self) -> Result<Pattern> {
        let dots = self.dots.iter().filter(|d| d.state != DotState::Missing);
        let dots = dots.map(|d| d.direction);
        Pattern::new(dots.chain(self.learned().map(|m| m.direction)).collect())
    }

    /// For each dot of [`Calibration::pattern`] its number in the nominal pattern; `None` for a mark.
    pub fn nominal_numbers(&self) -> Vec<Option<u16>> {
        let dots = self.dots.iter().enumerate();
        let kept = dots.filter(|(_, d)| d.state != DotState::Missing);
        let numbers = kept.map(|(j, _)| Some(j as u16));
        numbers.chain(self.learned().map(|_| None)).collect()
    }

    /// Covariance of each dot of [`Calibration::pattern`], rad^2, pattern frame; singular along the dot.
    pub fn covariances(&self) -> Vec<Matrix3<f64>> {
        let dots = self.dots.iter().filter(|d| d.state != DotState::Missing);
        let dots = dots.map(|d| (d.direction, d.covariance));
        let marks = self
            .learned()
            .filter_map(|m| Some((m.direction, m.covariance?)));
        let in_space = |(direction, covariance)| in_space(&direction, &covariance);
        dots.chain(marks).map(in_space).collect()
    }

    /// The ball with the dots of [`Calibration::pattern`] and their covariances. `nominal_sha256` names
    /// the nominal pattern, where there was one.
    ///
    /// # Errors
    /// As [`Calibration::pattern`] and [`Ball::with_calibration`].
    pub fn ball(&self, nominal_sha256: Option<String>) -> Result<Ball> {
        let views = self.dots.iter().filter(|d| d.state != DotState::Missing);
        let views = views
            .map(|d| d.views)
            .chain(self.learned().map(|m| m.found));
        let record = CalibrationRecord {
            nominal_sha256,
            nominal_numbers: self.nominal_numbers(),
            views: views.map(|v| v as u32).collect(),
        };
        Ball::new(self.pattern()?).with_calibration(self.covariances(), record)
    }

    /// Number of dots in this state.
    pub fn count(&self, state: DotState) -> usize {
        self.dots.iter().filter(|d| d.state == state).count()
    }

    /// Number of measured dots.
    pub fn measured(&self) -> usize {
        self.count(DotState::Measured)
    }

    /// Root mean square angle of the measured dots from their nominal places, radians; per tangent
    /// axis it is smaller by the square root of 2.
    pub fn rms_offset_rad(&self) -> f64 {
        let measured = self.dots.iter().filter(|d| d.state == DotState::Measured);
        let sum: f64 = measured.map(|d| d.offset_rad().powi(2)).sum();
        (sum / self.measured().max(1) as f64).sqrt()
    }

    /// The measured dots that lie farther off than nearly all dots that are drawn as these are: drawn in
    /// a wrong place, or a stain in a hidden dot's.
    pub fn far_off(&self) -> impl Iterator<Item = usize> + '_ {
        let measured = || {
            let dots = self.dots.iter().enumerate();
            dots.filter(|(_, d)| d.state == DotState::Measured)
        };
        let drawn = FAR_OFF * drawing_sigma_rad(measured().map(|(_, d)| d.offset_rad()));
        let limit = drawn.max(NOTICED_RAD);
        measured()
            .filter(move |(_, d)| d.offset_rad() > limit)
            .map(|(j, _)| j)
    }

    fn learned(&self) -> impl Iterator<Item = &SteadyMark> {
        self.marks.iter().filter(|m| m.covariance.is_some())
    }
}

/// Standard deviation per tangent axis of dots that are drawn off by these angles, radians.
pub(super) fn drawing_sigma_rad(offsets: impl Iterator<Item = f64>) -> f64 {
    median(&mut offsets.collect::<Vec<f64>>()) / MEDIAN_OFFSET
}

/// Root mean square standard deviation per tangent axis, radians.
pub(super) fn rms_sigma_rad(covariance: &Matrix2<f64>) -> f64 {
    (0.5 * covariance.trace()).sqrt()
}

/// A covariance in the axes of the direction's tangent frame, in the pattern's frame.
pub(super) fn in_space(direction: &Vec3, covariance: &Matrix2<f64>) -> Matrix3<f64> {
    let axes = Matrix3x2::from_columns(&tangent_frame(direction));
    let turned = axes * covariance * axes.transpose();
    0.5 * (turned + turned.transpose())
}

/// Why a clip cannot be calibrated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationRejection {
    /// No frame shows a ball.
    #[error("none of the {frames} frames shows a ball")]
    NoBall {
        /// Frames given.
        frames: usize,
    },
    /// Too few frames, or too few that show the ball.
    #[error("too few frames: {found} show a ball, needed are {needed} or more")]
    TooFewFrames {
        /// Frames with a ball.
        found: usize,
        /// Frames needed.
        needed: usize,
    },
    /// The ball is not one of this pattern.
    #[error(
        "the table does not fit the ball: {identified} of {balls} frames with a ball are identified (another \
         table, a mirrored image, or too blurred a clip?)"
    )]
    OtherBall {
        /// Frames identified beyond doubt.
        identified: usize,
        /// Frames with a ball.
        balls: usize,
    },
    /// The identified frames contradict each other.
    #[error(
        "the table does not fit the ball: {missing} of the {expected} dots in view are never found where they \
         should be"
    )]
    Contradiction {
        /// Dots that are missing.
        missing: usize,
        /// Dots that face the camera in enough frames.
        expected: usize,
    },
    /// The frames do not determine the dots.
    #[error("the frames do not determine the dots: the fit is singular")]
    Singular,
}
