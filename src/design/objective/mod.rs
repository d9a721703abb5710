//! Objectives: how easy a pattern is to identify, as a value with its gradient.
//!
//! - [`mean_nn`]: the paper's, the mean distance from each hash feature to its nearest neighbor. It
//!   serves comparisons with the paper.
//! - [`whitened`]: the same mean in units of the noise that the dots give to a feature, so that
//!   bases near singular do not count as distinct.
//! - [`confusion`]: the expected rate at which four visible dots are mistaken for four others. It
//!   is an analytic failure rate, and the default: `docs/objectives.md` shows how well each
//!   objective predicts the measured rate.
//! - [`coverage`]: the expected rate of views in which a camera detects too few dots. For any number
//!   of dots.
//!
//! The optimizer minimizes the logarithm of the value (with its sign reversed where larger is
//! better): scales then do not matter, and a step is a relative change.

pub mod align;
pub mod basis;
pub mod bound;
pub mod confusion;
pub mod coverage;
mod erfc;
mod evaluation;
mod lookalikes;
pub mod mean_nn;
pub mod whitened;

use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::view::{Detection, ViewModel};

pub use bound::OrientationBound;
pub use confusion::Confusion;
pub use coverage::Coverage;
pub use evaluation::Evaluation;
pub use mean_nn::MeanNearestNeighbor;
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
    /// The expected rate at which four visible dots are mistaken for four others.
    #[default]
    Confusion,
    /// The expected rate of views in which a camera detects too few dots.
    Coverage,
}

/// What `coverage` was called while it also counted false poses.
pub(crate) const NAME_BEFORE: &str = "coincidence";

impl ObjectiveName {
    /// All objectives, the paper's first.
    pub const ALL: [Self; 4] = [
        Self::MeanNn,
        Self::WhitenedNn,
        Self::Confusion,
        Self::Coverage,
    ];

    /// The default objective for so many dots: `confusion` as far as it can be computed,
    /// `whitened-nn` beyond.
    pub fn for_dots(dots: usize) -> Self {
        if dots <= confusion::MAX_DOTS {
            Self::Confusion
        } else {
            Self::WhitenedNn
        }
    }

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::MeanNn => "mean-nn",
            Self::WhitenedNn => "whitened-nn",
            Self::Confusion => "confusion",
            Self::Coverage => "coverage",
        }
    }

    /// Whether it can be computed for so many dots.
    pub fn suits(self, dots: usize) -> bool {
        self != Self::Confusion || dots <= confusion::MAX_DOTS
    }
}

impl std::str::FromStr for ObjectiveName {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        if name == NAME_BEFORE {
            let problem = "coincidence was replaced by coverage, which counts no false poses";
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
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "name", rename_all = "kebab-case")]
pub enum Objective {
    /// See [`mean_nn`].
    MeanNn(MeanNearestNeighbor),
    /// See [`whitened`].
    WhitenedNn(WhitenedNearestNeighbor),
    /// See [`confusion`].
    Confusion(Confusion),
    /// See [`coverage`].
    Coverage(Coverage),
}

impl Default for Objective {
    fn default() -> Self {
        Self::Confusion(Confusion::default())
    }
}

impl Objective {
    /// The objective of that name for these views. `coverage` counts all dots that a view shows, also
    /// where only some of them are given.
    pub fn for_view(name: ObjectiveName, view: &ViewModel) -> Self {
        // Without noise nothing is confused; a hundredth of a degree keeps the values finite.
        let sigma_rad = (view.noise_scale * view.noise.tangent_sigma_rad()).max(2e-4);
        match name {
            ObjectiveName::MeanNn => Self::MeanNn(MeanNearestNeighbor::default()),
            ObjectiveName::WhitenedNn => Self::WhitenedNn(WhitenedNearestNeighbor { sigma_rad }),
            ObjectiveName::Confusion => Self::Confusion(Confusion {
                sigma_rad,
                visibility_limit: view.visibility_limit,
                ..Confusion::default()
            }),
            ObjectiveName::Coverage => Self::Coverage(Coverage {
                visibility_limit: view.visibility_limit,
                softness: 0.04,
                limit_spread: 0.0,
                detection_probability: match view.detection {
                    Detection::Each { probability } => probability,
                    Detection::Given { .. } => 1.0,
                },
                crowding: 0.0,
            }),
        }
    }

    /// Its name.
    pub fn name(&self) -> ObjectiveName {
        match self {
            Self::MeanNn(_) => ObjectiveName::MeanNn,
            Self::WhitenedNn(_) => ObjectiveName::WhitenedNn,
            Self::Confusion(_) => ObjectiveName::Confusion,
            Self::Coverage(_) => ObjectiveName::Coverage,
        }
    }

    /// Whether larger values are better.
    pub fn larger_is_better(&self) -> bool {
        !matches!(self, Self::Confusion(_) | Self::Coverage(_))
    }

    /// The value itself: a mean distance (`mean-nn`, without unit; `whitened-nn`, in units of
    /// sigma) or a failure rate (`confusion`, `coverage`).
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for coordinates that are not finite.
    pub fn evaluate_at(&self, dots: &[Vec3]) -> Result<Evaluation> {
        match self {
            Self::MeanNn(o) => o.evaluate(dots),
            Self::WhitenedNn(o) => o.evaluate(dots),
            Self::Confusion(o) => Ok(o.evaluate(dots)),
            Self::Coverage(o) => Ok(o.evaluate(dots)),
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
