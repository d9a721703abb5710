//! The input frame, and the estimate from it: outline, detections, pose or rejection.

use std::time::Duration;

use nalgebra::Matrix3;

use super::config::CameraDistance;
use super::trust::PoseEvidence;
use super::{EXPECTED_DOTS, is_mirrored};
use crate::geometry::Rotation;
use crate::recognize::RecognizerRejection;
use crate::vision::camera::BallCircle;
use crate::vision::circle::{BallFit, NoBall};
use crate::vision::detect::DotDetection;
use crate::vision::image::{GrayImage, RgbImage, luma};
use crate::vision::raw::{RawImage, RawPixel};
use crate::vision::roi::{Grid, Roi};

/// A frame as it comes from the camera.
#[derive(Debug, Clone, Copy)]
pub enum FrameImage<'a> {
    /// Brightness alone.
    Gray(&'a GrayImage),
    /// Colors: where brightness does not show the ball's outline, they may.
    Color(&'a RgbImage),
    /// Bytes as they came: what is not looked at is not converted.
    Raw(RawImage<'a>),
}

impl FrameImage<'_> {
    /// Columns.
    pub fn width(&self) -> usize {
        match self {
            Self::Gray(image) => image.width(),
            Self::Color(image) => image.width(),
            Self::Raw(image) => image.width(),
        }
    }

    /// Rows.
    pub fn height(&self) -> usize {
        match self {
            Self::Gray(image) => image.height(),
            Self::Color(image) => image.height(),
            Self::Raw(image) => image.height(),
        }
    }

    /// A part of it, in colors where it has some, copied into the memory at hand.
    pub(super) fn part<'b>(
        &self,
        part: &Roi,
        gray: &'b mut GrayImage,
        color: &'b mut RgbImage,
    ) -> FrameImage<'b> {
        let Roi {
            left,
            top,
            width,
            height,
        } = *part;
        match self {
            Self::Gray(image) => gray.fill_rows(width, height, |v, values| {
                values.extend_from_slice(image.row(top + v, left, width));
            }),
            Self::Color(image) => {
                color.fill_rows(width, height, |v, values| {
                    values.extend_from_slice(image.row(top + v, left, width));
                });
                return FrameImage::Color(color);
            }
            Self::Raw(image) if image.pixel() == RawPixel::Gray => image.gray_into(part, gray),
            Self::Raw(image) => {
                image.color_into(part, color);
                return FrameImage::Color(color);
            }
        }
        FrameImage::Gray(gray)
    }

    /// A part of it in gray, each value the mean of a square of `2^level` pixels; what does not fill a square at the
    /// right and at the bottom is left out.
    pub(super) fn shrink_into(&self, part: &Roi, level: u32, out: &mut GrayImage) {
        let side = 1usize << level;
        let (width, height) = (part.width >> level, part.height >> level);
        let area = 1.0 / (side * side) as f32;
        out.fill_rows(width, height, |v, values| {
            let from = values.len();
            values.resize(from + width, 0.0);
            let sums = &mut values[from..];
            for k in 0..side {
                let row = part.top + side * v + k;
                match self {
                    Self::Gray(image) => {
                        let row = image.row(row, part.left, width * side);
                        for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(side)) {
                            *sum += cell.iter().sum::<f32>();
                        }
                    }
                    Self::Color(image) => {
                        let row = image.row(row, part.left, width * side);
                        for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(side)) {
                            *sum += cell.iter().map(|c| luma(*c)).sum::<f32>();
                        }
                    }
                    Self::Raw(image) => image.add_row(row, part.left, level, sums),
                }
            }
            sums.iter_mut().for_each(|sum| *sum *= area);
        });
    }

    /// A part of it, each value the mean of a square of `2^level` pixels, in colors where it has some, written into the
    /// memory at hand.
    pub(super) fn shrunk<'b>(
        &self,
        part: &Roi,
        level: u32,
        gray: &'b mut GrayImage,
        color: &'b mut RgbImage,
    ) -> FrameImage<'b> {
        let side = 1usize << level;
        let area = 1.0 / (side * side) as f32;
        let color_at: &dyn Fn(usize, usize) -> [f32; 3] = match self {
            Self::Color(image) => &|u, v| image.row(v, u, 1)[0],
            Self::Raw(image) if image.pixel() != RawPixel::Gray => &|u, v| image.color_at(u, v),
            Self::Raw(_) | Self::Gray(_) => {
                self.shrink_into(part, level, gray);
                return FrameImage::Gray(gray);
            }
        };
        let (width, height) = (part.width >> level, part.height >> level);
        color.fill_rows(width, height, |v, values| {
            values.extend((0..width).map(|u| {
                let mut sum = [0.0; 3];
                for cell in 0..side * side {
                    let left = part.left + side * u + cell % side;
                    let found = color_at(left, part.top + side * v + cell / side);
                    (0..3).for_each(|c| sum[c] += found[c]);
                }
                sum.map(|s| s * area)
            }));
        });
        FrameImage::Color(color)
    }
}

impl<'a> From<RawImage<'a>> for FrameImage<'a> {
    fn from(image: RawImage<'a>) -> Self {
        Self::Raw(image)
    }
}

impl<'a> From<&'a GrayImage> for FrameImage<'a> {
    fn from(image: &'a GrayImage) -> Self {
        Self::Gray(image)
    }
}

impl<'a> From<&'a RgbImage> for FrameImage<'a> {
    fn from(image: &'a RgbImage) -> Self {
        Self::Color(image)
    }
}

/// An accepted orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// From the pattern's frame to the camera's; without intrinsics to the view frame, whose z points from this ball to the camera.
    pub rotation: Rotation,
    /// Covariance of the rotation vector that leads from it to the true one, in the same frame, rad^2.
    pub covariance: Matrix3<f64>,
    /// Probability that every dot is identified correctly.
    pub confidence: f64,
    /// Probability that the rotation is correct, whatever single dots are.
    pub pose_confidence: f64,
    /// Root mean square angle between the named dots and the rotated pattern, radians.
    pub residual_rad: f64,
    /// Root mean square distance of the named dots from the projected pattern, pixels.
    pub residual_px: f64,
    /// How far the camera is, where the orientation is in the view frame: as estimated, or as given with the deviation 0.
    pub distance: Option<CameraDistance>,
    /// Whether an expected orientation decided: the dots alone gave none, or another.
    pub hinted: bool,
}

/// Why a frame has no orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum FrameRejection {
    /// The frame is not processed yet.
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
        pose_confidence: f64,
    },
    /// The time for a frame ended before a pose was clear.
    OutOfTime,
    /// The recognizer refuses.
    Recognizer(RecognizerRejection),
    /// The file is no image that can be read.
    Unreadable,
    /// The frame has a pose, but all frames together say that the ball does not carry this pattern.
    Foreign,
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
            Self::Ambiguous { pose_confidence } => write!(
                f,
                "ambiguous: the best pose has a probability of {pose_confidence:.2}"
            ),
            Self::OutOfTime => f.write_str("the time for a frame ended"),
            Self::Recognizer(refusal) => refusal.fmt(f),
            Self::Unreadable => f.write_str("cannot be read"),
            Self::Foreign => f.write_str("the table does not fit these images"),
        }
    }
}

/// The ball's outline before the dots correct it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outline {
    /// The circle.
    pub circle: BallCircle,
    /// Covariance of the center's u and v and the radius, px^2.
    pub covariance: Matrix3<f64>,
}

impl From<&BallFit> for Outline {
    fn from(fit: &BallFit) -> Self {
        Self {
            circle: fit.circle,
            covariance: fit.covariance,
        }
    }
}

/// Where an outline comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OutlineSource {
    /// It was found in the frame alone.
    #[default]
    Detected,
    /// It was given.
    Given,
    /// It was found where the frames before and after expected it.
    Neighbors,
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
    /// Where the outline comes from.
    pub outline_source: OutlineSource,
    /// That outline, corrected by the dots where the frame has a pose.
    pub circle: Option<BallCircle>,
    /// The outline as fitted; `None` where it was given or there is none.
    pub fit: Option<BallFit>,
    /// All detections, the most confident first.
    pub dots: Vec<DotDetection>,
    /// For each detection the pattern's dot that it is; `None` for a false one, or one that was left out.
    pub assignment: Vec<Option<u16>>,
    /// The orientation, or why there is none.
    pub outcome: std::result::Result<Pose, FrameRejection>,
    /// Time taken.
    pub timings: Timings,
    /// Runs of the recognizer on other outlines of this frame.
    pub(super) earlier_attempts: usize,
    /// Those and the runs on this outline: each had its chance to be correct by accident.
    pub(super) attempts: usize,
    /// What the outline was worth before its dots were seen.
    pub(super) standing: Standing,
    /// The best pose of this outline, accepted or not.
    pub(super) hypothesis: Option<Hypothesis>,
}

/// What an outline is worth before the dots within it are seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Standing {
    /// It is given, or the likeliest of a thorough search.
    #[default]
    Likely,
    /// One of many that may be anything: it is the ball's where its dots make that evident.
    Doubtful,
}

/// A pose that may be accepted or not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hypothesis {
    /// Pattern to camera frame.
    pub rotation: Rotation,
    pub evidence: PoseEvidence,
}

impl Default for FrameEstimate {
    /// Not processed.
    fn default() -> Self {
        Self {
            outline: None,
            outline_source: OutlineSource::default(),
            circle: None,
            fit: None,
            dots: Vec::new(),
            assignment: Vec::new(),
            outcome: Err(FrameRejection::NotProcessed),
            timings: Timings::default(),
            earlier_attempts: 0,
            attempts: 0,
            standing: Standing::default(),
            hypothesis: None,
        }
    }
}

impl FrameEstimate {
    /// A frame whose ball and dots another detector has found; it is not identified yet.
    pub fn from_detections(outline: Outline, dots: Vec<DotDetection>) -> Self {
        Self {
            outline: Some(outline),
            outline_source: OutlineSource::Given,
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

    /// What was found in the pixels of a part, in those of the image.
    pub(super) fn place(&mut self, grid: &Grid) {
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
    pub(super) fn place_dots(&mut self, grid: &Grid) {
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

    /// What speaks for the frame's best pose, accepted or not; `None` where no dots were identified.
    pub fn evidence(&self) -> Option<&PoseEvidence> {
        self.hypothesis.as_ref().map(|h| &h.evidence)
    }

    /// The rotation of that pose before it is refined, pattern to camera frame.
    pub fn unrefined_rotation(&self) -> Option<Rotation> {
        self.hypothesis.map(|h| h.rotation)
    }

    /// The outline and the camera's distance of a pose in the view frame.
    pub(super) fn seen_from(&self) -> Option<(BallCircle, CameraDistance)> {
        self.circle.zip(self.pose()?.distance)
    }

    /// Number of detections that have a name.
    pub fn matched(&self) -> usize {
        self.assignment.iter().flatten().count()
    }

    /// Not processed, with the memory for what is found.
    pub(super) fn with_capacity() -> Self {
        let mut this = Self::default();
        this.dots.reserve(EXPECTED_DOTS);
        this.assignment.reserve(EXPECTED_DOTS);
        this
    }

    /// Nothing is known; memory stays.
    pub(super) fn clear(&mut self) {
        (self.outline, self.circle, self.fit) = (None, None, None);
        self.outline_source = OutlineSource::Detected;
        self.dots.clear();
        self.assignment.clear();
        self.outcome = Err(FrameRejection::NotProcessed);
        self.timings = Timings::default();
        (self.earlier_attempts, self.attempts) = (0, 0);
        self.hypothesis = None;
        self.standing = Standing::Likely;
    }

    /// Takes back a pose.
    pub(super) fn reject_pose(&mut self) {
        if let Ok(pose) = self.outcome {
            self.outcome = Err(FrameRejection::Ambiguous {
                pose_confidence: pose.pose_confidence,
            });
            self.circle = self.outline.map(|o| o.circle);
            self.assignment.fill(None);
        }
    }
}
