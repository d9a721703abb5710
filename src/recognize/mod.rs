//! Recognizers: they identify each observed dot with a dot of the pattern, and estimate the ball's
//! orientation.
//!
//! Every recognizer takes observed dots with their uncertainty. It returns a rotation, an
//! assignment, a residual and a confidence, or the reason for its rejection. Rotations map the
//! pattern's frame to the camera's, `p_camera = R p_pattern`.
//!
//! A recognizer's answer depends on the dots alone, not on earlier calls. An answer may be wrong.
//! The robust recognizer's confidence is its own probability that the answer is correct; that of
//! the paper's recognizer is not calibrated.
//!
//! - [`paper`]: the SpinDOE paper's algorithm, kept as the baseline,
//! - [`kent`]: the density that the paper's algorithm scores with,
//! - [`learn`]: noise, misses and false dots, and the share of other frames, learned from frames,
//! - [`observed`]: the file of observed dots,
//! - [`robust`]: the posterior over all explanations of the dots, the default,
//! - [`stream`]: frame after frame from an endless input, on all cores.

use crate::geometry::Rotation;

mod explanations;
mod hint;
pub mod kent;
pub mod learn;
mod ln_sum;
mod named;
mod nodes;
pub mod observed;
pub mod paper;
pub mod robust;
#[cfg(feature = "native")]
pub mod stream;

pub use crate::view::{DotUncertainty, ObservedDot};
pub use explanations::Explanations;
pub use hint::Hint;
pub use named::{NamedRecognizer, NamedWorkspace, RecognizerName};
pub use paper::{PaperConfig, PaperRecognizer};

/// Orientation errors of this value or more are failures, radians (20 degrees, SpinDOE Sec. IV).
pub const ORIENTATION_FAILURE_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;

/// Orientations from dots with a smaller [confidence](Identification::confidence) are rejected, where nothing else is asked for:
/// the likelier answer is that they are wrong.
pub const MIN_CONFIDENCE_DOTS: f64 = 0.5;
/// Those from images: with less, several in a hundred images of other balls and things are answered
/// (docs/measurements/trust.md).
pub const MIN_CONFIDENCE_IMAGES: f64 = 0.85;

/// A recognizer's answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// Rotation from the pattern's frame to the camera's.
    pub rotation: Rotation,
    /// For each observed dot, in order, the pattern's dot that it is; `None` for a false dot.
    pub assignment: Vec<Option<u16>>,
    /// Root mean square angle between the matched observed dots and the rotated pattern, radians.
    pub residual_rad: f64,
    /// Probability that every dot is named correctly, in [0, 1].
    pub dots_confidence: f64,
    /// Probability that the rotation is correct, its error less than [`ORIENTATION_FAILURE_RAD`],
    /// regardless of single dots, in [0, 1]. Never below the dots'.
    pub confidence: f64,
}

impl Default for Identification {
    /// No dots, the identity, no confidence.
    fn default() -> Self {
        Self {
            rotation: Rotation::identity(),
            assignment: Vec::new(),
            residual_rad: 0.0,
            dots_confidence: 0.0,
            confidence: 0.0,
        }
    }
}

impl Identification {
    /// Number of observed dots that are matched with a pattern's dot.
    pub fn matched(&self) -> usize {
        self.assignment.iter().flatten().count()
    }
}

/// Why a recognizer gives no answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecognizerRejection {
    /// Fewer dots than the recognizer needs.
    TooFewDots {
        /// Dots given.
        found: usize,
        /// Dots needed.
        needed: usize,
    },
    /// No hypothesis explains the dots.
    NoHypothesis,
    /// The dots are those of the pattern's mirror image: an axis of the image is flipped.
    Mirrored,
    /// The dots do not determine the rotation, or are not directions at all.
    Degenerate,
}

impl std::fmt::Display for RecognizerRejection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooFewDots { found, needed } => {
                write!(f, "too few dots: {found}, needed {needed}")
            }
            Self::NoHypothesis => f.write_str("no hypothesis explains the dots"),
            Self::Mirrored => f.write_str("the dots are those of the pattern's mirror image"),
            Self::Degenerate => f.write_str("the dots leave the rotation undetermined"),
        }
    }
}

/// A recognizer of dots.
pub trait Recognizer: Sync {
    /// Buffers reused from call to call; one per thread.
    type Workspace: Send;

    /// A new workspace.
    fn workspace(&self) -> Self::Workspace;

    /// Identifies `dots`: the explanations of the view, whose memory is that of `ws`. They depend on the dots
    /// and the hint alone, not on earlier calls with the workspace. The hint only helps to decide which dot
    /// is which; the rotation depends on the dots. A recognizer that knows no hints leaves it aside.
    ///
    /// # Errors
    /// A [`RecognizerRejection`] that states why there is no answer.
    fn explain<'w>(
        &self,
        dots: &[ObservedDot],
        hint: Option<&Hint>,
        ws: &'w mut Self::Workspace,
    ) -> Result<&'w Explanations, RecognizerRejection>;

    /// The best explanation without a hint, as a value of its own.
    ///
    /// # Errors
    /// As [`Recognizer::explain`].
    fn identify(
        &self,
        dots: &[ObservedDot],
        ws: &mut Self::Workspace,
    ) -> Result<Identification, RecognizerRejection> {
        Ok(self.explain(dots, None, ws)?.best().clone())
    }

    /// Minimum number of dots that can be identified.
    fn min_dots(&self) -> usize;
}
