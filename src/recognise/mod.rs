//! Which dot is which, and therefore how the ball is turned.
//!
//! A recogniser takes the dots seen in one image (unit vectors in the camera frame, each with its
//! uncertainty) and answers with the rotation that maps the pattern to the camera, the identity of each
//! dot, the residual and the probability that the identification is right, or it refuses and says why.
//! Two are provided: [`paper::PaperRecogniser`] is Algorithm 2 of the SpinDOE paper
//! (arXiv 2303.03879) and serves as the baseline; [`robust::RobustRecogniser`] is the default.

pub mod robust;

use nalgebra::Matrix2;

use crate::geometry::{Rotation, Vec3};

/// How well a dot's direction is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DotUncertainty {
    /// The same standard deviation along both tangent axes, radians.
    Isotropic {
        /// Standard deviation per tangent axis, radians.
        sigma_rad: f64,
    },
    /// A covariance in the tangent plane, rad^2, in the axes of
    /// [`crate::geometry::tangent_frame`]`(direction)`.
    Tangent {
        /// Symmetric, positive definite.
        covariance: Matrix2<f64>,
    },
}

/// One dot as seen by the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObservedDot {
    /// Unit vector, camera frame.
    pub direction: Vec3,
    /// How well it is known.
    pub uncertainty: DotUncertainty,
}

/// A recogniser's answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// Maps the pattern's frame to the camera's.
    pub rotation: Rotation,
    /// For each observed dot the index of its pattern dot, or `None` for a dot held to be false.
    pub assignment: Vec<Option<u16>>,
    /// Root mean square angle between the matched dots and their pattern dots, radians.
    pub residual_rad: f64,
    /// Probability that the identification is right.
    pub confidence: f64,
}

impl Identification {
    /// Number of dots given an identity.
    pub fn matched(&self) -> usize {
        self.assignment.iter().flatten().count()
    }
}

/// Why there is no answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// Fewer dots than the method needs.
    TooFewDots {
        /// Dots given.
        found: usize,
        /// Dots needed.
        needed: usize,
    },
    /// No rotation explains the dots.
    NoHypothesis,
    /// The dots leave the rotation undetermined.
    Degenerate,
}

/// What became of one view.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The dots were identified.
    Identified(Identification),
    /// They were not.
    Unidentified(Refusal),
}

/// A method that identifies dots. Implementations are shared between threads; each thread brings its
/// own workspace, so that the loop over views allocates nothing but its answers.
pub trait Recogniser: Sync {
    /// Scratch memory, reused from call to call.
    type Workspace: Send;
    /// A fresh workspace.
    fn workspace(&self) -> Self::Workspace;
    /// Identifies the dots of one view.
    fn identify(&self, dots: &[ObservedDot], workspace: &mut Self::Workspace) -> Outcome;
    /// Fewest dots it can work with.
    fn min_dots(&self) -> usize;
}
