//! The detectors by name, as chosen on the command line.

use super::blob::{BlobConfig, BlobDetector, BlobWorkspace};
use super::detect::{DotDetection, DotDetector};
use super::patch::Patch;

/// A dot detector's name.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize, clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum DetectorName {
    /// Dark blobs on the flattened ball: classical, untrained.
    Blob,
}

impl DetectorName {
    /// All detectors.
    pub const ALL: [Self; 1] = [Self::Blob];

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Blob => "blob",
        }
    }

    /// The detector with its default settings.
    pub fn build(self) -> NamedDetector {
        match self {
            Self::Blob => NamedDetector::Blob(BlobDetector::new(BlobConfig::default())),
        }
    }
}

impl std::fmt::Display for DetectorName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// A detector chosen at run time.
#[derive(Debug, Clone)]
pub enum NamedDetector {
    /// See [`BlobDetector`].
    Blob(BlobDetector),
}

/// Working memory of a [`NamedDetector`].
#[derive(Debug)]
pub enum NamedWorkspace {
    /// Of a [`BlobDetector`].
    Blob(Box<BlobWorkspace>),
}

impl DotDetector for NamedDetector {
    type Workspace = NamedWorkspace;

    fn workspace(&self) -> NamedWorkspace {
        match self {
            Self::Blob(detector) => NamedWorkspace::Blob(Box::new(detector.workspace())),
        }
    }

    fn detect_into(&self, patch: &Patch, ws: &mut NamedWorkspace, out: &mut Vec<DotDetection>) {
        match (self, ws) {
            (Self::Blob(detector), NamedWorkspace::Blob(ws)) => {
                detector.detect_into(patch, ws, out);
            }
        }
    }
}
