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
//! - [`observed`]: the file of observed dots,
//! - [`robust`]: the posterior over all explanations of the dots, the default,
//! - [`stream`]: frame after frame from an endless input, on all cores.

use nalgebra::{Matrix2, Vector2};

use crate::geometry::{Rotation, Vec3, tangent_frame};

pub mod kent;
pub mod observed;
pub mod paper;
pub mod robust;
#[cfg(feature = "native")]
pub mod stream;

pub use paper::{PaperConfig, PaperRecognizer};

/// A recognizer's name, as written on the command line and in reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecognizerName {
    /// The SpinDOE paper's algorithm, the baseline.
    Paper,
    /// The explanation that the whole set of dots supports best, the default.
    Robust,
}

impl RecognizerName {
    /// All recognizers, the baseline first.
    pub const ALL: [Self; 2] = [Self::Paper, Self::Robust];

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Robust => "robust",
        }
    }
}

impl std::str::FromStr for RecognizerName {
    type Err = crate::error::Error;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        crate::error::by_name(&Self::ALL, Self::as_str, "recognizer", name)
    }
}

impl std::fmt::Display for RecognizerName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// Uncertainty of an observed direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DotUncertainty {
    /// The same in all tangent directions.
    Isotropic {
        /// Standard deviation of the angular error along one tangent axis, radians.
        sigma_rad: f64,
    },
    /// Different along different tangent directions.
    Tangent {
        /// Covariance, rad^2, in the axes of
        /// [`tangent_frame(direction)`](crate::geometry::tangent_frame).
        covariance: Matrix2<f64>,
    },
}

impl ObservedDot {
    /// Squared distance of `direction` in standard deviations: over two axes, so 2 on average. Holds for
    /// directions near the dot's.
    pub fn squared_deviations(&self, direction: &Vec3) -> f64 {
        let [e1, e2] = tangent_frame(&self.direction);
        let off = Vector2::new(e1.dot(direction), e2.dot(direction));
        match self.uncertainty {
            DotUncertainty::Isotropic { sigma_rad } => off.norm_squared() / (sigma_rad * sigma_rad),
            DotUncertainty::Tangent { covariance } => covariance
                .try_inverse()
                .map_or(f64::INFINITY, |inverse| off.dot(&(inverse * off))),
        }
    }
}

impl DotUncertainty {
    /// The uncertainty with an independent error of `sigma_rad` along either tangent axis besides.
    #[must_use]
    pub fn widened(self, sigma_rad: f64) -> Self {
        match self {
            Self::Isotropic { sigma_rad: own } => Self::Isotropic {
                sigma_rad: own.hypot(sigma_rad),
            },
            Self::Tangent { covariance } => Self::Tangent {
                covariance: covariance + Matrix2::identity() * (sigma_rad * sigma_rad),
            },
        }
    }
}

/// An observed dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObservedDot {
    /// Unit vector from the ball's center to the dot, camera frame.
    pub direction: Vec3,
    /// Uncertainty of the direction.
    pub uncertainty: DotUncertainty,
}

/// A recognizer's answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// Rotation from the pattern's frame to the camera's.
    pub rotation: Rotation,
    /// For each observed dot, in order, the pattern's dot that it is; `None` for a false dot.
    pub assignment: Vec<Option<u16>>,
    /// Root mean square angle between the matched observed dots and the rotated pattern, radians.
    pub residual_rad: f64,
    /// Probability that the identification is correct, in [0, 1].
    pub confidence: f64,
    /// Probability that the rotation is correct, regardless of single dots, in [0, 1]. Never below
    /// the confidence.
    pub pose_confidence: f64,
}

impl Default for Identification {
    /// No dots, the identity, no confidence: a value for [`Recognizer::identify_into`] to fill.
    fn default() -> Self {
        Self {
            rotation: Rotation::identity(),
            assignment: Vec::new(),
            residual_rad: 0.0,
            confidence: 0.0,
            pose_confidence: 0.0,
        }
    }
}

impl Identification {
    /// Number of observed dots that are matched with a pattern's dot.
    pub fn matched(&self) -> usize {
        self.assignment.iter().flatten().count()
    }
}

/// The outcome of an attempt to identify the dots.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The dots are identified.
    Identified(Identification),
    /// The dots are not identified.
    Unidentified(RecognizerRejection),
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

    /// Identifies `dots` and writes the answer into `out`, whose memory is reused. The answer
    /// depends on the dots alone, not on earlier calls with the workspace. A rejection leaves the
    /// content of `out` unspecified.
    ///
    /// # Errors
    /// A [`RecognizerRejection`] that states why there is no answer.
    fn identify_into(
        &self,
        dots: &[ObservedDot],
        ws: &mut Self::Workspace,
        out: &mut Identification,
    ) -> Result<(), RecognizerRejection>;

    /// As [`Recognizer::identify_into`], with a newly allocated answer.
    fn identify(&self, dots: &[ObservedDot], ws: &mut Self::Workspace) -> Outcome {
        let mut found = Identification::default();
        match self.identify_into(dots, ws, &mut found) {
            Ok(()) => Outcome::Identified(found),
            Err(rejection) => Outcome::Unidentified(rejection),
        }
    }

    /// Minimum number of dots that can be identified.
    fn min_dots(&self) -> usize;
}
