//! The expected rate of views that fail: that show too few dots, or four dots that look like four others.
//!
//! ```text
//! too few + confusion / 2
//! ```
//!
//! with [`TooFewDots`] over every view, and [`Confusion`], the union bound for four visible dots of `sparse`, which
//! overstates what trials measure twofold. Views that detect dots one by one rank patterns best by the same sum, as if
//! four dots were all that they give (`docs/measurements/objectives.md`). Each alone misleads: confusion knows nothing of
//! views that show too few dots and gains by hiding dots, and to show as many as possible from everywhere makes
//! patterns regular, so that views look alike.
//!
//! Confusion is computed for up to 24 dots. For more the value is that of too few dots alone, by which no pattern
//! should be designed ([`super::ObjectiveName::suits`]).

use super::confusion::{Confusion, MAX_DOTS};
use super::evaluation::Evaluation;
use super::too_few::TooFewDots;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::view::{Detection, ViewModel};

/// The measured rate over the union bound.
const CONFUSION_WEIGHT: f64 = 0.5;

/// The objective's assumptions about a view.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FailureRate {
    /// Views with too few dots, several kinds in equal parts.
    pub too_few: Vec<TooFewDots>,
    /// Views that look like others; `None` leaves them out.
    pub confusion: Option<Confusion>,
}

impl Default for FailureRate {
    /// As in the `sparse` protocol.
    fn default() -> Self {
        Self {
            too_few: vec![TooFewDots::default()],
            confusion: Some(Confusion::default()),
        }
    }
}

impl FailureRate {
    /// For these views, in equal parts, of patterns of so many dots.
    ///
    /// # Errors
    /// As [`TooFewDots::of_view`].
    pub fn of_views(views: &[ViewModel], dots: usize) -> Result<Self> {
        let is_given = |view: &&ViewModel| matches!(view.detection, Detection::Given { .. });
        let of_given = views.iter().find(is_given);
        let too_few: Result<Vec<_>> = views
            .iter()
            .map(|view| TooFewDots::of_view(view, dots))
            .collect();
        Ok(Self {
            too_few: too_few?,
            confusion: (dots <= MAX_DOTS)
                .then(|| of_given.map_or_else(Confusion::default, Confusion::of_view)),
        })
    }

    /// The expected rate, a fraction (as confusion is a bound, it may exceed 1 a little), and its derivative.
    pub fn evaluate(&self, dots: &[Vec3]) -> Evaluation {
        let mut at = Evaluation {
            value: 0.0,
            gradient: vec![Vec3::zeros(); dots.len()],
        };
        let mut add = |weight: f64, term: Evaluation| {
            at.value += weight * term.value;
            for (g, t) in at.gradient.iter_mut().zip(&term.gradient) {
                *g += weight * t;
            }
        };
        let part = 1.0 / self.too_few.len() as f64;
        for too_few in &self.too_few {
            add(part, too_few.evaluate(dots));
        }
        if let Some(confusion) = self.confusion {
            add(CONFUSION_WEIGHT, confusion.evaluate(dots));
        }
        at
    }
}
