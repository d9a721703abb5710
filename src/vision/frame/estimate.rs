//! The input frame, and the estimate from it: outline, detections, pose or rejection.

use std::time::Duration;

use nalgebra::Matrix3;

use super::config::CameraDistance;
use super::outline::Outline;
use super::view_evidence::ViewEvidence;
use crate::geometry::{Position, Rotation};
use crate::recognize::RecognizerRejection;
use crate::vision::dots::detector::DotDetection;
use crate::vision::dots::smear::DotBlur;
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::optics::grid::Grid;
use crate::vision::optics::oval::Oval;
use crate::vision::outline::circle::{BallFit, NoBall};
use crate::vision::pose::trust::PoseEvidence;

/// A picture of a sensor's shape whose shorter side is longer than so many radii of the ball is no crop about it: cut to
/// 420 x 420 pixels, balls of 120 pixels far off the axis had distances half as long.
const WHOLE_PICTURE: f64 = 6.0;
/// The longer sides of sensors over their shorter ones.
const SENSORS: [f64; 5] = [5.0 / 4.0, 4.0 / 3.0, 3.0 / 2.0, 16.0 / 10.0, 16.0 / 9.0];
/// A picture of a sensor's shape is within so much of it: sides are multiples of some pixels.
const SHAPE_TOLERANCE: f64 = 0.01;
/// Standard deviation of an axis about the middle of its picture, of the longer side.
const AXIS_SPREAD: f64 = 0.04;
/// More detections than either detector gives for a ball: capacity for as many is reserved beforehand.
pub(crate) const EXPECTED_DOTS: usize = 256;
/// The rejection of a mirrored frame.
pub(crate) const MIRRORED: FrameRejection =
    FrameRejection::Recognizer(RecognizerRejection::Mirrored);

/// An accepted orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// From the pattern's frame to the camera's; without intrinsics to the view frame, whose z points from this ball to the camera.
    pub rotation: Rotation,
    /// Covariance of the rotation vector that leads from it to the true one, in the same frame, rad^2.
    pub covariance: Matrix3<f64>,
    /// Probability that every dot is named correctly.
    pub dots_confidence: f64,
    /// Probability that the rotation is correct, whatever single dots are.
    pub confidence: f64,
    /// Root mean square angle between the named dots and the rotated pattern, radians.
    pub residual_rad: f64,
    /// Root mean square distance of the named dots from the projected pattern, pixels.
    pub residual_px: f64,
    /// How far the camera is, where the orientation is in the view frame: as estimated, or as given with the deviation 0.
    pub distance: Option<CameraDistance>,
    /// What the frame says of the camera, where that is not known: what frames of one camera have in common.
    pub view: Option<ViewEvidence>,
    /// The ball's center, fitted with the orientation, in the camera's frame; `None` where the intrinsics are not known.
    pub position: Option<Position>,
    /// Whether an expected orientation decided: the dots alone gave none, or another.
    pub hinted: bool,
}

/// Why a frame has no orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum FrameRejection {
    /// The frame is not processed yet, or its dots were to be found and not identified.
    NotProcessed,
    /// There is no ball to be seen.
    NoBall(NoBall),
    /// The ball's outline is too blurred for dots to be identified.
    TooBlurred {
        /// Width of the outline's edge, ball radii.
        edge_width: f64,
    },
    /// Too few dots.
    TooFewDots {
        /// Dots found.
        found: usize,
        /// Dots needed.
        needed: usize,
    },
    /// The best pose is not likely enough.
    Ambiguous {
        /// Its probability.
        confidence: f64,
    },
    /// The time for a frame ended before a pose was clear.
    OutOfTime,
    /// The recognizer refuses.
    Recognizer(RecognizerRejection),
    /// The file is no image that can be read.
    Unreadable,
    /// The frame has a pose, but all frames together say that the ball does not carry this pattern.
    Foreign,
    /// The cameras of a rig contradict each other as a whole.
    CamerasContradict,
    /// Cameras of a rig have poses that contradict each other, and none is sure enough.
    CamerasDisagree {
        /// Their squared difference over its variance.
        chi2: f64,
        /// The number of its degrees of freedom.
        freedom: usize,
    },
}

impl std::fmt::Display for FrameRejection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotProcessed => f.write_str("not processed"),
            Self::NoBall(why) => write!(f, "no ball: {why}"),
            Self::TooBlurred { edge_width } => write!(
                f,
                "too blurred: the outline's edge is {:.0} % of the radius wide",
                100.0 * edge_width
            ),
            Self::TooFewDots { found, needed } => {
                write!(f, "too few dots: {found}, needed {needed}")
            }
            Self::Ambiguous { confidence } => write!(
                f,
                "ambiguous: the best pose has a probability of {confidence:.2}"
            ),
            Self::OutOfTime => f.write_str("the time for a frame ended"),
            Self::Recognizer(refusal) => refusal.fmt(f),
            Self::Unreadable => f.write_str("cannot be read"),
            Self::Foreign => f.write_str("the table does not fit these images"),
            Self::CamerasContradict => {
                f.write_str("the cameras of the rig contradict each other as a whole")
            }
            Self::CamerasDisagree { chi2, freedom } => write!(
                f,
                "the cameras disagree: chi2 {chi2:.0} with {freedom} degrees of freedom"
            ),
        }
    }
}

/// How long the stages of a frame took.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Timings {
    /// Finding the ball.
    pub locate: Duration,
    /// Cutting it out and finding dots.
    pub detect: Duration,
    /// Identifying the dots and refining the orientation.
    pub identify: Duration,
}

/// Everything seen in a frame. Its memory is reused from frame to frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameEstimate {
    /// The ball's outline as given or found; `None` where there is no ball.
    pub outline: Option<Outline>,
    /// That outline, corrected by the dots where the frame has a pose.
    pub circle: Option<BallCircle>,
    /// The outline as fitted; `None` where it was given or there is none.
    pub fit: Option<BallFit>,
    /// What known intrinsics say of the outline, and by how much it is drawn out beyond that; `None` where they are not known or its
    /// rim is not clear.
    pub oval: Option<(BallCircle, Oval)>,
    /// The ball's center by its outline alone: see [`FrameEstimate::position`].
    pub(crate) outline_position: Option<Position>,
    /// All detections, the likeliest first.
    pub dots: Vec<DotDetection>,
    /// For each detection the pattern's dot that it is; `None` for a false one, or one that was left out.
    pub assignment: Vec<Option<u16>>,
    /// How the named dots are blurred, where they were measured in the image's pixels; none unless
    /// [`EstimatorConfig::measures_blur`](super::config::EstimatorConfig::measures_blur).
    pub blurs: Vec<DotBlur>,
    /// The orientation, or why there is none.
    pub outcome: std::result::Result<Pose, FrameRejection>,
    /// Time taken, for all outlines that were tried.
    pub timings: Timings,
    /// Runs of the recognizer on other outlines of this frame.
    pub(crate) earlier_attempts: usize,
    /// Those and the runs on this outline: each had its chance to be correct by accident.
    pub(crate) attempts: usize,
    /// What the outline was worth before its dots were seen.
    pub(crate) standing: Standing,
    /// Where the camera's axis is expected; `None` in a crop, which may be cut from anywhere.
    pub(crate) axis: Option<PrincipalPointPrior>,
    /// The best pose of this outline by its detections, and where these leave doubt by all places where dots may be.
    pub(crate) hypotheses: [Option<Hypothesis>; 2],
}

/// Where a camera's axis meets its picture, before anything is seen: about the middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PrincipalPointPrior {
    pub middle: Pixel,
    /// Standard deviation of either coordinate, pixels.
    pub sigma_px: f64,
}

impl PrincipalPointPrior {
    /// Of a picture of this size; `None` where it may be a crop: by its shape, or since the ball of this outline fills much of it.
    pub fn of_picture(width: usize, height: usize, outline: &BallCircle) -> Option<Self> {
        let [width, height] = [width, height].map(|n| n as f64);
        let (short, long) = (width.min(height), width.max(height));
        let is_sensor = |shape: &f64| (long / short / shape - 1.0).abs() < SHAPE_TOLERANCE;
        let is_whole = short > WHOLE_PICTURE * outline.radius && SENSORS.iter().any(is_sensor);
        is_whole.then_some(Self {
            middle: Pixel {
                u: 0.5 * (width - 1.0),
                v: 0.5 * (height - 1.0),
            },
            sigma_px: AXIS_SPREAD * long,
        })
    }
}

/// From where a ball is seen by a camera whose intrinsics are not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenFrom {
    /// Its outline, corrected by the dots.
    pub circle: BallCircle,
    /// How far the camera is.
    pub distance: CameraDistance,
    /// What else the frame says of the camera.
    pub evidence: Option<ViewEvidence>,
}

/// What an outline is worth before the dots within it are seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Standing {
    /// It is given, or the likeliest of a thorough search: any pose of its dots is the ball's.
    #[default]
    Likely,
    /// One of many that may be anything, whose dots came near to an answer: other outlines about it are tried, too. It is the
    /// ball's where the dots make that evident.
    Promising,
    /// One of many that may be anything: it is the ball's where its dots make that evident.
    Doubtful,
}

/// A pose that may be accepted or not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hypothesis {
    /// Pattern to camera frame, before it is refined.
    pub rotation: Rotation,
    /// What speaks for it and against it.
    pub evidence: PoseEvidence,
}

impl Default for FrameEstimate {
    /// Not processed.
    fn default() -> Self {
        Self::NOT_PROCESSED
    }
}

impl FrameEstimate {
    /// Becomes a copy of another, in memory that is there.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.dots.clone_from(&other.dots);
        self.assignment.clone_from(&other.assignment);
        self.blurs.clone_from(&other.blurs);
        *self = Self {
            dots: std::mem::take(&mut self.dots),
            assignment: std::mem::take(&mut self.assignment),
            blurs: std::mem::take(&mut self.blurs),
            ..*other
        };
    }

    /// Nothing is known.
    pub(crate) const NOT_PROCESSED: Self = Self {
        outline: None,
        circle: None,
        fit: None,
        oval: None,
        outline_position: None,
        dots: Vec::new(),
        assignment: Vec::new(),
        outcome: Err(FrameRejection::NotProcessed),
        timings: Timings {
            locate: Duration::ZERO,
            detect: Duration::ZERO,
            identify: Duration::ZERO,
        },
        earlier_attempts: 0,
        attempts: 0,
        standing: Standing::Likely,
        axis: None,
        hypotheses: [None; 2],
        blurs: Vec::new(),
    };

    /// The probability of its pose, accepted or not.
    pub(crate) fn promise(&self) -> f64 {
        match &self.outcome {
            Ok(pose) => pose.confidence,
            Err(FrameRejection::Ambiguous { confidence }) => *confidence,
            Err(_) => 0.0,
        }
    }

    /// A frame whose ball and dots another detector has found; it is not identified yet.
    pub fn from_detections(outline: Outline, dots: Vec<DotDetection>) -> Self {
        Self {
            outline: Some(outline),
            circle: Some(outline.circle),
            assignment: vec![None; dots.len()],
            dots,
            ..Self::default()
        }
    }

    /// Whether another look at the dots is of no use: there is a pose, the dots are those of the mirrored pattern, or no
    /// outline was found.
    pub fn is_settled(&self) -> bool {
        self.pose().is_some() || is_mirrored(self) || self.outline.is_none()
    }

    /// The orientation, if accepted.
    pub fn pose(&self) -> Option<&Pose> {
        self.outcome.as_ref().ok()
    }

    /// The ball's center in the camera's frame: fitted with the orientation, else by the outline alone. `None` where the intrinsics are
    /// not known or no outline was found. What is round but no ball has one too.
    pub fn position(&self) -> Option<Position> {
        match self.pose() {
            Some(pose) => pose.position,
            None => self.outline_position,
        }
    }

    /// What was found in the pixels of a part, in those of the image.
    pub(crate) fn place(&mut self, grid: &Grid) {
        let area = grid.side * grid.side;
        if let Some(outline) = &mut self.outline {
            outline.circle = grid.circle_to_image(&outline.circle);
            outline.covariance *= area;
        }
        if let Some(fit) = &mut self.fit {
            fit.circle = grid.circle_to_image(&fit.circle);
            fit.covariance *= area;
            fit.edge_width *= grid.side;
        }
        if let Some(circle) = &mut self.circle {
            *circle = grid.circle_to_image(circle);
        }
        self.place_dots(grid);
    }

    /// The same of the dots alone.
    pub(crate) fn place_dots(&mut self, grid: &Grid) {
        for dot in &mut self.dots {
            dot.pixel = grid.pixel_to_image(dot.pixel);
            dot.covariance *= grid.side * grid.side;
        }
    }

    /// Runs of the recognizer on this frame, on all outlines: each had its chance to be correct by
    /// accident.
    pub fn attempts(&self) -> usize {
        self.attempts
    }

    /// What the frame's outline suggests, accepted or not: by its detections, then by all places where dots may be, which
    /// are weighed where the detections leave doubt. An accepted pose is the last one's.
    pub fn hypotheses(&self) -> impl DoubleEndedIterator<Item = &Hypothesis> {
        self.hypotheses.iter().flatten()
    }

    /// The outline and the camera's distance of a pose in the view frame.
    pub(crate) fn seen_from(&self) -> Option<SeenFrom> {
        let pose = self.pose()?;
        Some(SeenFrom {
            circle: self.circle?,
            distance: pose.distance?,
            evidence: pose.view,
        })
    }

    /// Number of detections that have a name.
    pub fn matched(&self) -> usize {
        self.assignment.iter().flatten().count()
    }

    /// Not processed, with the memory for what is found.
    pub(crate) fn with_capacity() -> Self {
        let mut this = Self::default();
        this.clear();
        this
    }

    /// Nothing is known; there is memory for what will be.
    pub(crate) fn clear(&mut self) {
        (self.outline, self.circle, self.fit, self.oval) = (None, None, None, None);
        self.outline_position = None;
        self.dots.clear();
        self.dots.reserve(EXPECTED_DOTS);
        self.assignment.clear();
        self.assignment.reserve(EXPECTED_DOTS);
        self.outcome = Err(FrameRejection::NotProcessed);
        self.timings = Timings::default();
        (self.earlier_attempts, self.attempts) = (0, 0);
        self.hypotheses = [None; 2];
        self.blurs.clear();
        self.standing = Standing::Likely;
        self.axis = None;
    }

    /// Takes back a pose, where there is one, for this reason.
    pub(crate) fn take_back(&mut self, why: FrameRejection) {
        if self.pose().is_some() {
            self.reject_pose();
            self.outcome = Err(why);
        }
    }

    /// Takes back a pose.
    pub(crate) fn reject_pose(&mut self) {
        if let Ok(pose) = self.outcome {
            self.outcome = Err(FrameRejection::Ambiguous {
                confidence: pose.confidence,
            });
            self.circle = self.outline.map(|o| o.circle);
            self.assignment.fill(None);
            self.blurs.clear();
        }
    }
}

/// Whether the dots are those of the mirrored pattern: no other outline makes up for that.
pub(crate) fn is_mirrored(frame: &FrameEstimate) -> bool {
    matches!(frame.outcome, Err(MIRRORED))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(width: usize, height: usize, radius: f64) -> Option<PrincipalPointPrior> {
        let center = Pixel { u: 100.0, v: 80.0 };
        PrincipalPointPrior::of_picture(width, height, &BallCircle::new(center, radius))
    }

    #[test]
    fn whole_pictures_have_their_axis_near_the_middle() {
        for (width, height) in [
            (640, 480),
            (1280, 1024),
            (1920, 1080),
            (1080, 1920),
            (1440, 1080),
        ] {
            let axis = axis(width, height, 60.0).expect("whole");
            let middle = [0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)];
            assert_eq!([axis.middle.u, axis.middle.v], middle);
        }
    }

    #[test]
    fn crops_may_be_cut_from_anywhere() {
        // Square, of a shape that no sensor has, or about the ball.
        for (width, height, radius) in [(420, 420, 60.0), (700, 480, 60.0), (640, 480, 81.0)] {
            assert_eq!(axis(width, height, radius), None, "{width} x {height}");
        }
    }
}
