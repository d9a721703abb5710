//! What is known of a frame before its pixels are seen, and what may be spent on it.
//!
//! First frames, tracked frames, frames with a hint and frames that are looked at again between their neighbors
//! differ in these alone; [`Estimator::estimate`](crate::vision::estimator::Estimator::estimate) is the same for all.

use std::time::{Duration, Instant};

use super::estimate::Timings;
use super::outline::{Outline, OutlineSource};
use crate::concurrency::StopFlag;
use crate::image::Roi;
use crate::recognize::Hint;
use crate::vision::optics::camera::BallCircle;
use nalgebra::Matrix3;

/// An outline known to this part of its radius is believed; any other is only where to look.
const BELIEVED: f64 = 0.05;
/// Standard deviation of an outline that is given without one, as a part of its radius.
const GIVEN: f64 = 0.01;
/// Runs of the recognizer by each of several tables in which a ball is looked for: a frame need not show a ball of each.
const SHORT_RUNS: usize = 6;
/// Standard deviations within which an expected ball is looked for.
const REACH: f64 = 3.0;

/// What is known of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Prior {
    /// The part of the image that holds the ball; by default all of it.
    pub region: Option<Roi>,
    /// The ball's outline as it is given or expected.
    pub outline: Option<OutlinePrior>,
    /// The orientation as it is expected, camera frame. It counts where the dots alone are not clear, or show another
    /// orientation.
    pub rotation: Option<Hint>,
    /// What the image follows.
    pub follows: Follows,
}

/// The image before one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Follows {
    /// The image stands for itself.
    #[default]
    Nothing,
    /// It is the next one of the camera that gave the workspace's last image: what has moved since may be the ball.
    LastImage,
}

/// The ball's outline before the image is seen, in its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutlinePrior {
    /// The circle as the image shows it: of a ball off the axis, whose image is an ellipse, that of the same center and area.
    pub circle: BallCircle,
    /// Standard deviation of its center's u and v and of its radius, pixels. Up to 5 % of the radius the
    /// circle is taken for the outline; beyond, the ball is looked for near it, and within three standard deviations of
    /// it; where it is infinite, then everywhere.
    pub sigma_px: f64,
    /// Where it comes from: one that is given is taken as it is, any other is corrected by the image's rim and by the dots.
    pub source: OutlineSource,
}

impl OutlinePrior {
    /// An outline that someone has measured, to 1 % of its radius.
    pub fn given(circle: BallCircle) -> Self {
        Self {
            circle,
            sigma_px: GIVEN * circle.radius,
            source: OutlineSource::Given,
        }
    }

    /// An outline that was found.
    pub(crate) fn found(circle: BallCircle, sigma_px: f64) -> Self {
        Self {
            circle,
            sigma_px,
            source: OutlineSource::Detected,
        }
    }

    /// The outline, where it is known well enough to be one.
    pub(crate) fn believed(&self) -> Option<Outline> {
        let is_believed = self.sigma_px <= BELIEVED * self.circle.radius;
        is_believed.then_some(Outline {
            circle: self.circle,
            covariance: Matrix3::from_diagonal_element(self.sigma_px.powi(2)),
            source: self.source,
        })
    }

    /// How far around the circle the ball may be, radii.
    pub(crate) fn reach(&self) -> f64 {
        REACH * self.sigma_px / self.circle.radius
    }
}

/// What may be spent on a frame. The likeliest outlines and cameras are tried first, until one is clear or this ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Runs of the recognizer from which on no further outline is tried; with none the dots of the first outline that may be the ball's
    /// are found and not identified.
    pub runs: usize,
    /// Runs on this frame that were made before: the more, the likelier one of them is right by accident.
    pub spent: usize,
    /// The time from which on nothing further is begun.
    pub deadline: Option<Instant>,
    /// What ends the search before: once it is set nothing further is begun.
    pub stop: Option<StopFlag>,
    /// How images beyond 480 pixels are searched.
    pub search: SearchDepth,
}

impl Default for Budget {
    /// Runs enough for nearly every ball that can be identified (docs/measurements/detector.md), no deadline, the thorough search.
    fn default() -> Self {
        Self {
            runs: 32,
            spent: 0,
            deadline: None,
            stop: None,
            search: SearchDepth::Thorough,
        }
    }
}

impl Budget {
    /// The default with a deadline from now on.
    pub fn within(time: Duration) -> Self {
        Self {
            deadline: Instant::now().checked_add(time),
            ..Self::default()
        }
    }

    /// That of a frame which is searched by one of several tables.
    pub(crate) fn short(&self) -> Self {
        Self {
            runs: SHORT_RUNS.min(self.runs),
            search: SearchDepth::Coarse,
            ..*self
        }
    }
}

/// How a large image is searched for a ball of which nothing is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SearchDepth {
    /// At coarse scales alone: balls of some contrast, in a few milliseconds.
    Coarse,
    /// Where that finds nothing, by all edges of the image.
    #[default]
    Thorough,
}

/// What has been spent on the frame in hand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spending {
    pub budget: Budget,
    /// Runs of the recognizer, those before included.
    pub runs: usize,
    /// Outlines among which the one in hand was chosen by its dots.
    pub choices: usize,
    /// Whether an outline had its turn, where dots are to be found alone.
    pub has_detected: bool,
    pub timings: Timings,
}

impl Default for Spending {
    fn default() -> Self {
        Self::of(Budget::default())
    }
}

impl Spending {
    pub fn of(budget: Budget) -> Self {
        Self {
            runs: budget.spent,
            choices: 1,
            has_detected: false,
            budget,
            timings: Timings::default(),
        }
    }

    /// How often something had its chance to fit the outline in hand by accident.
    pub fn chances(&self) -> usize {
        self.runs * self.choices
    }

    /// Whether nothing further is to be begun.
    pub fn is_over(&self) -> bool {
        let is_spent = match self.is_detecting() {
            true => self.has_detected,
            false => self.runs - self.budget.spent >= self.budget.runs,
        };
        is_spent || self.is_late()
    }

    /// Whether dots are to be found alone.
    pub fn is_detecting(&self) -> bool {
        self.budget.runs == 0
    }

    /// Whether the deadline has passed, or the flag is set.
    pub fn is_late(&self) -> bool {
        self.budget.stop.is_some_and(StopFlag::is_set)
            || self.budget.deadline.is_some_and(|d| Instant::now() >= d)
    }
}
