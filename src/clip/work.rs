//! What is found in each frame of a clip, and the memory for it.

use super::balls::{BallEstimate, BallsEstimator, BallsWorkspace};
use super::strobe::Strobe;
use crate::error::Result;
use crate::image::ImageView;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};
use crate::vision::frame::prior::{Budget, Prior};
use crate::vision::outline::find::{OutlineFinder, OutlineSearch};

/// What is found in each frame of a clip.
#[derive(Debug, Clone, Copy)]
pub enum Work<'a> {
    /// The pose of one ball, by its dots: one estimator for each table that it may carry.
    Poses(&'a [Estimator]),
    /// All balls of every frame, or with flashes all images of one ball in each exposure.
    Balls(&'a BallsEstimator, Option<&'a Strobe>),
    /// The outline of one ball whose dots are not known.
    Outlines(&'a OutlineFinder),
}

impl<'a> From<&'a Estimator> for Work<'a> {
    fn from(estimator: &'a Estimator) -> Self {
        Self::Poses(std::slice::from_ref(estimator))
    }
}

impl<'a> From<&'a [Estimator]> for Work<'a> {
    fn from(tables: &'a [Estimator]) -> Self {
        Self::Poses(tables)
    }
}

impl<'a> From<&'a BallsEstimator> for Work<'a> {
    fn from(balls: &'a BallsEstimator) -> Self {
        Self::Balls(balls, None)
    }
}

impl<'a> From<&'a OutlineFinder> for Work<'a> {
    fn from(finder: &'a OutlineFinder) -> Self {
        Self::Outlines(finder)
    }
}

impl<'a> Work<'a> {
    /// One estimator for each table.
    pub(super) fn tables(&self) -> &'a [Estimator] {
        match self {
            Self::Poses(tables) => tables,
            Self::Balls(balls, _) => balls.estimators(),
            Self::Outlines(_) => &[],
        }
    }

    /// What is known of a frame that cannot be read.
    pub(super) fn unreadable(&self) -> Vec<BallEstimate> {
        let frame = FrameEstimate {
            outcome: Err(FrameRejection::Unreadable),
            ..FrameEstimate::default()
        };
        match self {
            Self::Balls(..) => Vec::new(),
            Self::Poses(_) | Self::Outlines(_) => vec![BallEstimate::of(frame, 0)],
        }
    }
}

/// A thread that does the work, with its memory.
// One a thread: a box is not worth its trouble.
#[allow(clippy::large_enum_variant)]
pub(super) enum Worker<'a> {
    Pose(&'a Estimator, usize, EstimatorWorkspace),
    Balls(&'a BallsEstimator, Option<&'a Strobe>, BallsWorkspace<'a>),
    Outline(&'a OutlineFinder, OutlineSearch),
}

impl<'a> Worker<'a> {
    /// For a work; one ball's poses are by this table.
    pub fn new(work: Work<'a>, table: usize) -> Result<Self> {
        Ok(match work {
            Work::Poses(tables) => {
                let estimator = &tables[table];
                Self::Pose(estimator, table, estimator.workspace())
            }
            Work::Balls(balls, strobe) => Self::Balls(balls, strobe, balls.workspace()?),
            Work::Outlines(finder) => Self::Outline(finder, finder.workspace()),
        })
    }

    /// What a frame shows by itself.
    pub fn alone(
        &mut self,
        image: ImageView<'_>,
        prior: &Prior,
        budget: &Budget,
    ) -> Vec<BallEstimate> {
        let mut found = FrameEstimate::default();
        match self {
            Self::Pose(estimator, table, ws) => {
                estimator.estimate(image, prior, budget, ws, &mut found);
                vec![BallEstimate::of(found, *table)]
            }
            Self::Outline(finder, ws) => {
                finder.find(image, prior, ws, &mut found);
                vec![BallEstimate::of(found, 0)]
            }
            Self::Balls(balls, Some(strobe), ws) => {
                balls.estimate_strobed(image, prior.region, strobe, budget, ws)
            }
            Self::Balls(balls, None, ws) => balls.estimate(image, prior.region, &[], budget, ws),
        }
    }
}
