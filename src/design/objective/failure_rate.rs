//! The expected rate of views that fail: that show too few dots, or four dots that look like four others.
//!
//! ```text
//! too few + w confusion
//! ```
//!
//! with [`TooFewDots`] over every view, and [`Confusion`], the union bound for four visible dots of `sparse`. It
//! overstates what trials of `sparse` measure twofold: `w` is 1/2. Views that detect dots one by one, with misses and
//! false dots, confuse more: `w` is 5 (`docs/measurements/objectives.md`). Each part alone misleads: confusion knows
//! nothing of views that show too few dots and gains by hiding dots, and to show as many as possible from everywhere
//! makes patterns regular, so that views look alike.
//!
//! Confusion is computed for up to 24 dots. For more the value is that of too few dots alone, by which no pattern
//! should be designed ([`super::ObjectiveName::suits`]).

use super::confusion::{Confusion, MAX_DOTS};
use super::evaluation::Evaluation;
use super::too_few::TooFewDots;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::view::{Detection, ViewModel};

/// The measured rate over the union bound, where views give four dots: the same for all patterns.
pub const WEIGHT_GIVEN: f64 = 0.5;
/// The same where views detect dots one by one. Of twelve dots designed with 1/2 instead, which are confused in 0.4 % of
/// the `sparse` views, 7.5 % of the `image` views and 13.7 % of `clutter` fail; with large weights, at 0.05 %, 5.8 and
/// 11.6 %.
pub const WEIGHT_EACH: f64 = 5.0;

/// The objective's assumptions about a view.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FailureRate {
    /// Views with too few dots, several kinds in equal parts.
    pub too_few: Vec<TooFewDots>,
    /// Views that look like others; `None` leaves them out.
    pub confusion: Option<Confusion>,
    /// What a confusion of four dots counts.
    #[serde(default = "given")]
    pub confusion_weight: f64,
}

/// The weight of searches and reports that do not state it.
fn given() -> f64 {
    WEIGHT_GIVEN
}

impl Default for FailureRate {
    /// As in the `sparse` protocol.
    fn default() -> Self {
        Self {
            too_few: vec![TooFewDots::default()],
            confusion: Some(Confusion::default()),
            confusion_weight: WEIGHT_GIVEN,
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
        let weights = views.iter().map(|view| match view.detection {
            Detection::Given { .. } => WEIGHT_GIVEN,
            Detection::Each { .. } => WEIGHT_EACH,
        });
        let confusion_weight = weights.sum::<f64>() / views.len().max(1) as f64;
        let too_few: Result<Vec<_>> = views
            .iter()
            .map(|view| TooFewDots::of_view(view, dots))
            .collect();
        Ok(Self {
            too_few: too_few?,
            confusion: (dots <= MAX_DOTS)
                .then(|| of_given.map_or_else(Confusion::default, Confusion::of_view)),
            confusion_weight,
        })
    }

    /// For a camera's views of patterns of so many dots.
    pub fn of_camera(too_few: TooFewDots, dots: usize) -> Self {
        Self {
            too_few: vec![too_few],
            confusion: (dots <= MAX_DOTS).then(Confusion::default),
            confusion_weight: WEIGHT_EACH,
        }
    }

    /// The expected rate, a fraction (as confusion is a bound, it may exceed 1), and its derivative.
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
            add(self.confusion_weight, confusion.evaluate(dots));
        }
        at
    }
}
