//! Patterns judged by what a camera sees of them: predicted, or rendered and read.

use super::advice::effective_error_deg;
use super::conditions::CameraConditions;
use super::frames::{FrameOutcome, FrameRates, Predictor, each_frame};
use super::model::DetectionModel;
use crate::error::{Result, require};
use crate::pattern::Pattern;
use crate::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

/// Maximum number of rendered frames.
const MAX_RENDERED: u64 = 1_000_000;

/// How patterns are judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trial {
    /// On this many predicted frames.
    Predicted(u64),
    /// On this many frames that are rendered and read by the whole estimator: some 10 ms each.
    Rendered(u64),
}

/// Judges patterns for a camera.
#[derive(Debug)]
pub struct Judge {
    model: DetectionModel,
    conditions: CameraConditions,
    estimator: EstimatorConfig,
    trial: Trial,
}

/// A pattern's rates, and what they amount to.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgment {
    /// The rates.
    pub rates: FrameRates,
    /// See [`effective_error_deg`]; smaller is better.
    pub effective_error_deg: f64,
}

impl Judge {
    /// A judge for this camera, with the shipped model and the default estimator.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for conditions outside their domain.
    pub fn new(conditions: CameraConditions, trial: Trial) -> Result<Self> {
        conditions.check()?;
        Ok(Self {
            model: DetectionModel::shipped()?,
            conditions,
            estimator: EstimatorConfig::default(),
            trial,
        })
    }

    /// The same judge for dots of another diameter, in ball diameters.
    #[must_use]
    pub fn with_dot_diameter(mut self, dot_diameter: f64) -> Self {
        self.conditions.dot_diameter = dot_diameter;
        self
    }

    /// Judges a pattern on the frames of a seed: the same scenes for every pattern.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a number of frames outside its domain.
    pub fn judge(&self, pattern: &Pattern, seed: u64) -> Result<Judgment> {
        let outcomes = match self.trial {
            Trial::Predicted(frames) => {
                let predictor = Predictor::new(&self.model, pattern, self.estimator)?;
                predictor.outcomes(&self.conditions, seed, frames)?.0
            }
            Trial::Rendered(frames) => {
                rendered(pattern, &self.conditions, self.estimator, seed, frames)?
            }
        };
        let rates = FrameRates::of(&outcomes);
        Ok(Judgment {
            effective_error_deg: effective_error_deg(&rates),
            rates,
        })
    }
}

/// The outcomes of the frames `0..frames` of a seed when they are rendered and read by the whole
/// estimator, in their order.
///
/// # Errors
/// [`crate::Error::Argument`] for conditions or numbers outside their domain.
pub fn rendered(
    pattern: &Pattern,
    conditions: &CameraConditions,
    config: EstimatorConfig,
    seed: u64,
    frames: u64,
) -> Result<Vec<FrameOutcome>> {
    conditions.check()?;
    require(
        (1..=MAX_RENDERED).contains(&frames),
        "render",
        "1 to 1000000 frames",
        frames,
    )?;
    let estimator = Estimator::new(pattern, config, DetectorName::Cnn.build()?)?;
    each_frame(
        frames,
        || (estimator.workspace(), FrameEstimate::default()),
        |k, (ws, found)| {
            let rendering = conditions.scene(pattern, seed, k)?.render()?;
            estimator.estimate(
                &rendering.image,
                &Prior::default(),
                &Budget::default(),
                ws,
                found,
            );
            Ok(FrameOutcome::of(found, &rendering.rotation))
        },
    )
}
