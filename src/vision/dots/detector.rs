//! The dot detectors: what they find, and how one is chosen.

use nalgebra::Matrix2;

use super::blob::{BlobDetector, BlobWorkspace};
use super::heat::Heat;
use super::net::{CnnDetector, CnnWorkspace};
use super::patch::Patch;
use crate::error::{Error, Result};
use crate::vision::optics::camera::Pixel;
use crate::vision::optics::derived::USUAL_DOUBT;

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

/// A dot detector's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DetectorName {
    /// The trained net, the default.
    Cnn,
    /// Dark blobs on the flattened ball: classical, untrained.
    Blob,
}

impl DetectorName {
    /// All detectors.
    pub const ALL: [Self; 2] = [Self::Cnn, Self::Blob];

    /// The name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Cnn => "cnn",
            Self::Blob => "blob",
        }
    }

    /// The detector with its default configuration.
    ///
    /// # Errors
    /// [`Error::Internal`] where this crate was built with damaged weights.
    pub fn build(self) -> Result<DotDetector> {
        Ok(match self {
            Self::Cnn => DotDetector::Cnn(CnnDetector::built_in()?),
            Self::Blob => DotDetector::Blob(Box::default()),
        })
    }
}

impl std::str::FromStr for DetectorName {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "detector", name)
    }
}

impl std::fmt::Display for DetectorName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// A method that finds dots on a ball.
#[derive(Debug, Clone)]
pub enum DotDetector {
    /// See [`CnnDetector`].
    Cnn(CnnDetector),
    /// See [`BlobDetector`].
    Blob(Box<BlobDetector>),
    /// None: for frames that come with their detections.
    Given,
}

/// Working memory of any [`DotDetector`]: the buffers of a detector are made when it is first used with the workspace.
#[derive(Debug, Default)]
pub struct DetectorWorkspace {
    cnn: Option<CnnWorkspace>,
    blob: Option<Box<BlobWorkspace>>,
}

impl From<CnnDetector> for DotDetector {
    fn from(detector: CnnDetector) -> Self {
        Self::Cnn(detector)
    }
}

impl From<BlobDetector> for DotDetector {
    fn from(detector: BlobDetector) -> Self {
        Self::Blob(Box::new(detector))
    }
}

impl DotDetector {
    /// A new workspace, with the memory that this detector needs.
    pub fn workspace(&self) -> DetectorWorkspace {
        let mut ws = DetectorWorkspace::default();
        match self {
            Self::Cnn(detector) => ws.cnn = Some(detector.workspace()),
            Self::Blob(detector) => ws.blob = Some(Box::new(detector.workspace())),
            Self::Given => {}
        }
        ws
    }

    /// Finds the dots of a ball and writes them into `out`, the likeliest first. None is an answer too; a detector that exists
    /// cannot fail.
    pub fn detect_into(
        &self,
        patch: &Patch,
        ws: &mut DetectorWorkspace,
        out: &mut Vec<DotDetection>,
    ) {
        match self {
            Self::Cnn(detector) => {
                let ws = ws.cnn.get_or_insert_with(|| detector.workspace());
                detector.detect_into(patch, ws, out);
            }
            Self::Blob(detector) => {
                let ws = ws
                    .blob
                    .get_or_insert_with(|| Box::new(detector.workspace()));
                detector.detect_into(patch, ws, out);
            }
            Self::Given => out.clear(),
        }
    }

    /// Whether there are slower means for a patch that the dots of [`DotDetector::detect_into`] leave in doubt.
    pub fn looks_again(&self) -> bool {
        matches!(self, Self::Cnn(detector) if detector.looks_again())
    }

    /// Finds the dots by those means, and how likely each cell shows one. Without them, all stays as it was.
    pub fn look_again_into(
        &self,
        patch: &Patch,
        ws: &mut DetectorWorkspace,
        out: &mut Vec<DotDetection>,
        heat: &mut Heat,
    ) {
        if let Self::Cnn(detector) = self {
            let ws = ws.cnn.get_or_insert_with(|| detector.workspace());
            detector.look_again_into(patch, ws, out, heat);
        }
    }

    /// Where the probabilities of its detections are none that were fitted on images: the mean of `-ln p` to take for every
    /// ball's dots. `None` where they are.
    pub fn usual_doubt(&self) -> Option<f64> {
        match self {
            // A contrast is no probability: the net's doubt in the median ball is taken for it.
            Self::Blob(_) => Some(USUAL_DOUBT),
            Self::Cnn(_) | Self::Given => None,
        }
    }
}
