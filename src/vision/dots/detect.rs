//! The interface of a dot detector: its input and its output.

use nalgebra::Matrix2;

use super::heat::Heat;
use super::patch::Patch;
use crate::vision::optics::camera::Pixel;

/// A detection of this probability is more likely a dot than not.
pub(crate) const LIKELY_DOT: f64 = 0.5;

/// A dot found in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DotDetection {
    /// Its center in the image.
    pub pixel: Pixel,
    /// Covariance of the center (u, v), px^2.
    pub covariance: Matrix2<f64>,
    /// Probability that it is a dot, in [0, 1].
    pub probability: f64,
}

/// A method that finds dots on a ball.
pub trait DotDetector: Sync {
    /// Buffers reused from call to call; one a thread.
    type Workspace: Send;

    /// A new workspace.
    fn workspace(&self) -> Self::Workspace;

    /// Finds the dots of a ball and writes them into `out`, the likeliest first. None is an
    /// answer too; a detector that exists cannot fail.
    fn detect_into(&self, patch: &Patch, ws: &mut Self::Workspace, out: &mut Vec<DotDetection>);

    /// Whether there are slower means for a patch that the dots of [`DotDetector::detect_into`] leave in doubt.
    fn looks_again(&self) -> bool {
        false
    }

    /// Finds the dots by those means, and how likely each cell shows one. Without them, all stays as it was.
    fn look_again_into(
        &self,
        _patch: &Patch,
        _ws: &mut Self::Workspace,
        _out: &mut Vec<DotDetection>,
        _heat: &mut Heat,
    ) {
    }

    /// Where the probabilities of its detections are none that were fitted on images: the mean of `-ln p` to take for every
    /// ball's dots. `None` where they are.
    fn usual_doubt(&self) -> Option<f64> {
        None
    }
}

/// Finds nothing: for frames that come with their detections.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NoDetector;

impl DotDetector for NoDetector {
    type Workspace = ();

    fn workspace(&self) {}

    fn detect_into(&self, _: &Patch, (): &mut (), out: &mut Vec<DotDetection>) {
        out.clear();
    }
}
