//! The detectors by name, as chosen on the command line.

use super::blob::{BlobConfig, BlobDetector, BlobWorkspace};
use super::detect::{DotDetection, DotDetector};
use super::heat::Heat;
use super::net::{CnnDetector, CnnWorkspace};
use super::patch::Patch;
use crate::error::{Error, Result};

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
    pub fn build(self) -> Result<NamedDetector> {
        Ok(match self {
            Self::Cnn => NamedDetector::Cnn(CnnDetector::built_in()?),
            Self::Blob => NamedDetector::Blob(Box::new(BlobDetector::new(BlobConfig::default()))),
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

/// A detector chosen at run time.
#[derive(Debug, Clone)]
pub enum NamedDetector {
    /// See [`CnnDetector`].
    Cnn(CnnDetector),
    /// See [`BlobDetector`].
    Blob(Box<BlobDetector>),
}

/// Working memory of a [`NamedDetector`]. It serves any of them: the buffers of a detector are made
/// when it is first used with the workspace.
#[derive(Debug, Default)]
pub struct NamedWorkspace {
    cnn: Option<CnnWorkspace>,
    blob: Option<Box<BlobWorkspace>>,
}

impl DotDetector for NamedDetector {
    type Workspace = NamedWorkspace;

    fn workspace(&self) -> NamedWorkspace {
        let mut ws = NamedWorkspace::default();
        match self {
            Self::Cnn(detector) => ws.cnn = Some(detector.workspace()),
            Self::Blob(detector) => ws.blob = Some(Box::new(detector.workspace())),
        }
        ws
    }

    fn usual_doubt(&self) -> Option<f64> {
        match self {
            Self::Cnn(detector) => detector.usual_doubt(),
            Self::Blob(detector) => detector.usual_doubt(),
        }
    }

    fn looks_again(&self) -> bool {
        match self {
            Self::Cnn(detector) => detector.looks_again(),
            Self::Blob(detector) => detector.looks_again(),
        }
    }

    fn look_again_into(
        &self,
        patch: &Patch,
        ws: &mut NamedWorkspace,
        out: &mut Vec<DotDetection>,
        heat: &mut Heat,
    ) {
        if let Self::Cnn(detector) = self {
            let ws = ws.cnn.get_or_insert_with(|| detector.workspace());
            detector.look_again_into(patch, ws, out, heat);
        }
    }

    fn detect_into(&self, patch: &Patch, ws: &mut NamedWorkspace, out: &mut Vec<DotDetection>) {
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
        }
    }
}
