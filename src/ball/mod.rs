//! A ball: its dots, how uncertain their places are, its zones without dots, and where it comes
//! from.
//!
//! A [`Ball`] is what a design ends in, what a calibration measures, and what a table's file
//! ([`table`]) keeps. Recognizers and estimators are made for one. Its hash features ([`features`])
//! are no part of it: they follow from the dots. The paper's recognizer makes them for itself, and
//! a table's file has them for estimators that are not this crate's.
//!
//! - [`features`]: bases, features and the rule by which pairs of dots enter a table,
//! - [`record`]: what a file records beside the dots,
//! - [`table`]: the ball as a NumPy archive.

pub mod features;
mod placement;
pub mod record;
mod sizes;
pub mod table;

pub use crate::pattern::DesignRecord;
pub use features::{Basis, BasisFrame, Feature, PairRule};
pub use placement::Placement;
pub use record::{CalibrationRecord, ObjectiveRecord, PaperConfig, VoteSum};
pub use sizes::{USUAL_BALL_MM, usual_dot_mm};
pub use table::TableMeta;

use nalgebra::Matrix3;

use crate::error::Result;
use crate::pattern::Pattern;

/// A ball with a pattern of dots.
///
/// ```
/// use spindoe::{Ball, Pattern};
///
/// # fn main() -> spindoe::Result<()> {
/// # let text = include_bytes!("../../designs/dots20/pattern.csv");
/// let ball = Ball::new(Pattern::from_csv("pattern.csv".as_ref(), text)?);
/// let bytes = ball.to_npz()?;
/// assert_eq!(Ball::from_npz("table.npz".as_ref(), &bytes)?, ball);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Ball {
    pattern: Pattern,
    calibration: Option<MeasuredDots>,
    pair_rule: PairRule,
    recognizer: PaperConfig,
    objective: Option<ObjectiveRecord>,
    validation: Option<serde_json::Value>,
    design: Option<DesignRecord>,
}

/// What is known of dots that were measured on the ball.
#[derive(Debug, Clone, PartialEq)]
struct MeasuredDots {
    /// Of each dot, checked by [`placement::check`].
    covariances: Vec<Matrix3<f64>>,
    record: CalibrationRecord,
}

impl Ball {
    /// A ball whose dots are where `pattern` has them, with the default rule and recognizer.
    pub fn new(pattern: Pattern) -> Self {
        Self {
            pattern,
            calibration: None,
            pair_rule: PairRule::default(),
            recognizer: PaperConfig::default(),
            objective: None,
            validation: None,
            design: None,
        }
    }

    /// Selects the pairs of dots that serve as bases of hash features.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) where the rule is outside its domain, or leaves
    /// out every pair.
    pub fn with_pair_rule(mut self, rule: PairRule) -> Result<Self> {
        rule.check()?;
        rule.count(self.pattern.dots())?;
        self.pair_rule = rule;
        Ok(self)
    }

    /// Records the recognizer that the ball's table is made for.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) naming the parameter outside its domain.
    pub fn with_recognizer(mut self, recognizer: PaperConfig) -> Result<Self> {
        recognizer.check()?;
        self.recognizer = recognizer;
        Ok(self)
    }

    /// The ball with dots that were measured: their covariances (rad^2, pattern frame, singular
    /// along the dot), and how they were measured.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) where the record or the covariances are not those
    /// of as many dots, or a covariance is not one.
    pub fn with_calibration(
        mut self,
        covariances: Vec<Matrix3<f64>>,
        record: CalibrationRecord,
    ) -> Result<Self> {
        placement::check(self.pattern.dots(), &covariances, &record)?;
        self.calibration = Some(MeasuredDots {
            covariances,
            record,
        });
        Ok(self)
    }

    /// Records what the pattern was optimized for.
    pub fn set_objective(&mut self, objective: Option<ObjectiveRecord>) {
        self.objective = objective;
    }

    /// Records what the pattern was designed for.
    ///
    /// # Errors
    /// As [`DesignRecord::check`].
    pub fn with_design(mut self, design: Option<DesignRecord>) -> Result<Self> {
        design.as_ref().map_or(Ok(()), DesignRecord::check)?;
        self.design = design;
        Ok(self)
    }

    /// Records the validation result that the ball's table ships with.
    pub fn set_validation(&mut self, validation: Option<serde_json::Value>) {
        self.validation = validation;
    }

    /// The pattern: the dots, and the zones without dots.
    pub fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// The pattern by itself.
    pub fn into_pattern(self) -> Pattern {
        self.pattern
    }

    /// Covariance of each dot's direction, rad^2, pattern frame, singular along the dot; `None`
    /// where the dots were not measured.
    pub fn dot_covariances(&self) -> Option<&[Matrix3<f64>]> {
        self.calibration.as_ref().map(|c| c.covariances.as_slice())
    }

    /// Variances of the dots' places per tangent axis; `None` where the dots were not measured.
    pub fn placement(&self) -> Option<Placement> {
        self.dot_covariances().map(Placement::of)
    }

    /// How the dots were measured; `None` where they were not.
    pub fn calibration(&self) -> Option<&CalibrationRecord> {
        self.calibration.as_ref().map(|c| &c.record)
    }

    /// The rule by which pairs of dots enter the ball's table.
    pub fn pair_rule(&self) -> &PairRule {
        &self.pair_rule
    }

    /// The recognizer that the ball's table is made for.
    pub fn recognizer(&self) -> &PaperConfig {
        &self.recognizer
    }

    /// What the pattern was optimized for.
    pub fn objective(&self) -> Option<&ObjectiveRecord> {
        self.objective.as_ref()
    }

    /// What the pattern was designed for, where that is known: sizes, camera and criterion.
    pub fn design(&self) -> Option<&DesignRecord> {
        self.design.as_ref()
    }

    /// The validation result that the ball's table ships with.
    pub fn validation(&self) -> Option<&serde_json::Value> {
        self.validation.as_ref()
    }
}
