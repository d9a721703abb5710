//! Objectives: how easy a pattern is to identify, as a value with its gradient.
//!
//! - [`mean_nn`]: the paper's, the mean distance from each hash feature to its nearest neighbor. It
//!   serves comparisons with the paper.
//! - [`whitened`]: the same mean in units of the noise that the dots give to a feature, so that
//!   bases near singular do not count as distinct.
//! - [`failure_rate`]: the expected rate of views that fail. It is an analytic failure rate, and the default up to 24
//!   dots: `docs/objectives.md` shows how well each objective predicts the measured rate. Its two parts are
//!   [`too_few`], views that show too few dots, and [`confusion`], four visible dots mistaken for four others.
//!
//! The optimizer minimizes the logarithm of the value (with its sign reversed where larger is
//! better): scales then do not matter, and a step is a relative change.

pub mod align;
pub mod basis;
pub mod bound;
pub mod confusion;
mod erfc;
mod evaluation;
pub mod failure_rate;
mod lookalikes;
pub mod mean_nn;
pub mod too_few;
pub mod whitened;

use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::view::ViewModel;

pub use bound::OrientationBound;
pub use confusion::Confusion;
pub use evaluation::Evaluation;
pub use failure_rate::FailureRate;
pub use mean_nn::MeanNearestNeighbor;
pub use too_few::{CountFailures, CountedView, TooFewDots};
pub use whitened::WhitenedNearestNeighbor;

/// The objective that a descent minimizes.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum ObjectiveName {
    /// The mean distance from each hash feature to its nearest neighbor, as in the SpinDOE paper.
    MeanNn,
    /// The mean distance from each triple of dots to the most similar other one, in units of the
    /// noise.
    WhitenedNn,
    /// The expected rate of views that fail.
    #[default]
    FailureRate,
}

/// Objectives of former versions, which counted a part of the failures each.
pub(crate) const PARTS: [&str; 3] = ["confusion", "coverage", "coincidence"];

impl ObjectiveName {
    /// All objectives, the paper's first.
    pub const ALL: [Self; 3] = [Self::MeanNn, Self::WhitenedNn, Self::FailureRate];

    /// The default objective for so many dots: `failure-rate` as far as all of it can be computed,
    /// `whitened-nn` beyond.
    pub fn for_dots(dots: usize) -> Self {
        if dots <= confusion::MAX_DOTS {
            Self::FailureRate
        } else {
            Self::WhitenedNn
        }
    }

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::MeanNn => "mean-nn",
            Self::WhitenedNn => "whitened-nn",
            Self::FailureRate => "failure-rate",
        }
    }

    /// Whether it can be computed for so many dots.
    pub fn suits(self, dots: usize) -> bool {
        self != Self::FailureRate || dots <= confusion::MAX_DOTS
    }
}

impl std::str::FromStr for ObjectiveName {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        if PARTS.contains(&name) {
            let problem =
                format!("{name} was replaced by failure-rate, which counts all views that fail");
            return Err(Error::argument("objective", problem));
        }
        crate::error::by_name(&Self::ALL, Self::as_str, "objective", name)
    }
}

impl std::fmt::Display for ObjectiveName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// An objective with its parameters.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "name", rename_all = "kebab-case")]
pub enum Objective {
    /// See [`mean_nn`].
    MeanNn(MeanNearestNeighbor),
    /// See [`whitened`].
    WhitenedNn(WhitenedNearestNeighbor),
    /// See [`failure_rate`].
    FailureRate(FailureRate),
}

/// Noise of a dot in these views, radians per tangent axis. Without noise nothing is confused; a hundredth of a degree
/// keeps the values finite.
fn sigma_rad(view: &ViewModel) -> f64 {
    (view.noise_scale * view.noise.tangent_sigma_rad()).max(2e-4)
}

impl Default for Objective {
    fn default() -> Self {
        Self::FailureRate(FailureRate::default())
    }
}

impl Objective {
    /// The objective of that name for these views, in equal parts, of patterns of so many dots. The unit of
    /// `whitened-nn` is the noise of the first.
    ///
    /// # Errors
    /// As [`FailureRate::of_views`].
    pub fn for_views(name: ObjectiveName, views: &[ViewModel], dots: usize) -> Result<Self> {
        Ok(match name {
            ObjectiveName::MeanNn => Self::MeanNn(MeanNearestNeighbor::default()),
            ObjectiveName::WhitenedNn => Self::WhitenedNn(match views.first() {
                Some(view) => WhitenedNearestNeighbor {
                    sigma_rad: sigma_rad(view),
                },
                None => WhitenedNearestNeighbor::default(),
            }),
            ObjectiveName::FailureRate => Self::FailureRate(FailureRate::of_views(views, dots)?),
        })
    }

    /// What the end of a descent lowers: the same without the softness that its beginning needs.
    #[must_use]
    pub fn sharpened(self) -> Self {
        match self {
            Self::FailureRate(o) => Self::FailureRate(FailureRate {
                too_few: o.too_few.into_iter().map(TooFewDots::sharpened).collect(),
                ..o
            }),
            other => other,
        }
    }

    /// Its name.
    pub fn name(&self) -> ObjectiveName {
        match self {
            Self::MeanNn(_) => ObjectiveName::MeanNn,
            Self::WhitenedNn(_) => ObjectiveName::WhitenedNn,
            Self::FailureRate(_) => ObjectiveName::FailureRate,
        }
    }

    /// Whether larger values are better.
    pub fn larger_is_better(&self) -> bool {
        !matches!(self, Self::FailureRate(_))
    }

    /// The value itself: a mean distance (`mean-nn`, without unit; `whitened-nn`, in units of
    /// sigma) or a failure rate (`failure-rate`).
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for coordinates that are not finite.
    pub fn evaluate_at(&self, dots: &[Vec3]) -> Result<Evaluation> {
        match self {
            Self::MeanNn(o) => o.evaluate(dots),
            Self::WhitenedNn(o) => o.evaluate(dots),
            Self::FailureRate(o) => Ok(o.evaluate(dots)),
        }
    }

    /// The cost to be minimized: the value's logarithm, sign reversed where larger is better.
    ///
    /// # Errors
    /// As [`Objective::evaluate_at`].
    pub fn cost(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let mut at = self.evaluate_at(dots)?;
        // A value of exactly 0 (no match at all within reach) has no logarithm.
        let floored = at.value.max(1e-12);
        let sign = if self.larger_is_better() { -1.0 } else { 1.0 };
        at.gradient.iter_mut().for_each(|g| *g *= sign / floored);
        at.value = sign * floored.ln();
        Ok(at)
    }
}
