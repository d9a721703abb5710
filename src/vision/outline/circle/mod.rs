//! Where the ball is: its outline fitted to a fraction of a pixel.
//!
//! # Method
//! 1. The image is halved again and again. At every size, pixels on strong edges vote for centers 10 to
//!    20 pixels along their gradient (Hough's transform for circles: D. H. Ballard, "Generalizing the Hough
//!    transform to detect arbitrary shapes", Pattern Recognition 13, 1981), apart for balls brighter and darker than what is
//!    behind them, and where that gives no complete outline, for edges of either sign: such circles are only offered ([`BallFinder::others`]). A ball of any size is of that size at one of them.
//! 2. Around each center with many votes the image is unrolled into angle and radius; edges of the correct sign are
//!    found on every ray to a fraction of a sample, and the circle is fitted to them by iteratively reweighted
//!    least squares with Tukey's biweight (P. J. Huber, "Robust Statistics", 1981), which leaves out dots on the
//!    rim, logos and things behind the ball.
//! 3. Of the circles that are complete enough, the best is the ball. What else is as good is counted: two balls.
//!
//! # What it does and does not promise
//! A ball may be cut by the border, or touch all four; rays that leave the image say nothing. It finds circles, not
//! balls: a round lamp is one too. A ball as bright as what is behind it is not found, nor one that is brighter here and darker there over long stretches
//! of its outline: give its outline.

pub(crate) mod coarse;
mod edges;
mod finder;
mod vote;

use nalgebra::Matrix3;

pub(crate) use self::finder::WHOLE;
pub(crate) use self::finder::all::is_one_place;
pub use self::finder::{BallFinder, find_ball};
use crate::image::GrayImage;
use crate::vision::optics::camera::{BallCircle, Pixel};

/// What is accepted as a ball.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CircleConfig {
    /// Minimum radius, pixels. Where nothing looks like a ball in a crop of up to 100 pixels, smaller ones are looked for,
    /// down to five eighths of that.
    pub min_radius_px: f64,
    /// Largest radius as a multiple of the image's longer side.
    pub max_radius: f64,
    /// Minimum share of the rays within the image on which the outline's edge is seen.
    pub min_support: f64,
    /// Minimum share of the whole circle that lies within the image.
    pub min_visible: f64,
    /// Minimum difference in brightness across the outline (the image's values span 0 to 1).
    pub min_contrast: f64,
    /// Another circle counts as a second ball where its score is this part of the best one's.
    pub rival_score: f64,
}

impl Default for CircleConfig {
    /// Radius from 8 px to three quarters of the longer side, six tenths of the outline's rays with an edge, three
    /// tenths of it within the image, a contrast of 4 of 255, rivals from six tenths of the best score.
    fn default() -> Self {
        Self {
            min_radius_px: 8.0,
            max_radius: 0.75,
            min_support: 0.6,
            min_visible: 0.3,
            min_contrast: 0.016,
            rival_score: 0.6,
        }
    }
}

/// How the brightness steps across an outline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Polarity {
    /// The ball is brighter than what is behind it.
    Brighter,
    /// The ball is darker.
    Darker,
    /// Here the one, there the other. Noise has such outlines too: they are candidates, but no evidence of a ball.
    Mixed,
}

impl Polarity {
    /// The other one.
    fn opposite(self) -> Self {
        match self {
            Self::Darker => Self::Brighter,
            Self::Brighter | Self::Mixed => Self::Darker,
        }
    }

    /// The sign of the edges searched for; 0 for either.
    fn sign(self) -> f64 {
        match self {
            Self::Brighter => 1.0,
            Self::Darker => -1.0,
            Self::Mixed => 0.0,
        }
    }
}

/// The ball's outline, and how good it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallFit {
    /// The outline.
    pub circle: BallCircle,
    /// Covariance of the center's u and v and the radius, px^2, from the scatter of the edges.
    pub covariance: Matrix3<f64>,
    /// Share of the rays within the image on which the edge lies on the outline.
    pub support: f64,
    /// Share of the outline within the image.
    pub visible: f64,
    /// Which way the brightness steps.
    pub polarity: Polarity,
    /// Difference in brightness across the outline; negative for a ball darker than what is behind it.
    pub contrast: f64,
    /// Width of the outline's edge from dark to bright, pixels: the blur.
    pub edge_width: f64,
    /// Other circles nearly as good that do not overlap this one: a second ball.
    pub rivals: usize,
}

/// Why no ball is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoBall {
    /// The image is too small to hold one.
    TooSmall {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Nothing stands out from anything.
    NoContrast,
    /// No outline is complete enough; the best had this share of its edge.
    NoCircle {
        /// See [`BallFit::support`].
        support: f64,
    },
}

impl std::fmt::Display for NoBall {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooSmall { width, height } => {
                write!(f, "the image of {width} x {height} pixels is too small")
            }
            Self::NoContrast => f.write_str("nothing stands out in the image"),
            Self::NoCircle { support } => write!(
                f,
                "no complete outline (the best circle has {:.0} % of its edge)",
                100.0 * support
            ),
        }
    }
}
