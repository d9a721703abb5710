//! A recognizer that is chosen by its name, for the command and the reports.

use super::paper::PaperWorkspace;
use super::robust::{RobustConfig, RobustRecognizer, RobustWorkspace};
use super::{Explanations, Hint, ObservedDot, PaperRecognizer, Recognizer, RecognizerRejection};
use crate::ball::Ball;
use crate::error::{Error, Result};
use crate::view::ViewModel;

/// A recognizer's name, as written on the command line and in reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecognizerName {
    /// The SpinDOE paper's algorithm, the baseline. Files of before have the name of the paper.
    #[serde(alias = "paper")]
    Voting,
    /// The explanation that the whole set of dots supports best, the default.
    Robust,
}

impl RecognizerName {
    /// All recognizers, the baseline last.
    pub const ALL: [Self; 2] = [Self::Robust, Self::Voting];

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Voting => "voting",
            Self::Robust => "robust",
        }
    }
}

impl std::str::FromStr for RecognizerName {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "recognizer", name)
    }
}

impl std::fmt::Display for RecognizerName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// One of the recognizers.
#[derive(Debug)]
pub enum NamedRecognizer {
    /// The paper's.
    Paper(Box<PaperRecognizer>),
    /// The robust one.
    Robust(Box<RobustRecognizer>),
}

/// Buffers for either recognizer.
#[derive(Debug, Default)]
pub struct NamedWorkspace {
    paper: PaperWorkspace,
    robust: RobustWorkspace,
}

impl NamedRecognizer {
    /// The recognizer of that name for a ball: the paper's has the parameters that the ball records,
    /// the robust one expects these views of dots that are where the pattern has them.
    ///
    /// # Errors
    /// [`Error::Argument`] for parameters outside their domains.
    pub fn new(name: RecognizerName, ball: &Ball, view: &ViewModel) -> Result<Self> {
        Ok(match name {
            RecognizerName::Voting => Self::Paper(Box::new(PaperRecognizer::for_ball(ball)?)),
            RecognizerName::Robust => Self::robust(ball, (*view).into())?,
        })
    }

    /// As [`NamedRecognizer::new`], where only the orientation counts: the robust one leaves the integrals of its
    /// confidences out, a fifth of its time.
    ///
    /// # Errors
    /// As [`NamedRecognizer::new`].
    pub fn for_orientations(name: RecognizerName, ball: &Ball, view: &ViewModel) -> Result<Self> {
        match name {
            RecognizerName::Voting => Self::new(name, ball, view),
            RecognizerName::Robust => Self::robust(
                ball,
                RobustConfig {
                    integrated_below: 0.0,
                    ..(*view).into()
                },
            ),
        }
    }

    fn robust(ball: &Ball, config: RobustConfig) -> Result<Self> {
        let robust = RobustRecognizer::new(ball.pattern(), config)?;
        Ok(Self::Robust(Box::new(robust)))
    }
}

impl Recognizer for NamedRecognizer {
    type Workspace = NamedWorkspace;

    fn workspace(&self) -> NamedWorkspace {
        match self {
            Self::Paper(_) => NamedWorkspace::default(),
            Self::Robust(robust) => NamedWorkspace {
                robust: robust.workspace(),
                ..NamedWorkspace::default()
            },
        }
    }

    fn explain<'w>(
        &self,
        dots: &[ObservedDot],
        hint: Option<&Hint>,
        ws: &'w mut NamedWorkspace,
    ) -> std::result::Result<&'w Explanations, RecognizerRejection> {
        match self {
            Self::Paper(paper) => paper.explain(dots, hint, &mut ws.paper),
            Self::Robust(robust) => robust.explain(dots, hint, &mut ws.robust),
        }
    }

    fn min_dots(&self) -> usize {
        match self {
            Self::Paper(paper) => paper.min_dots(),
            Self::Robust(robust) => robust.min_dots(),
        }
    }
}
