//! What one frame's estimate is asked with, and what it answers: settings, [`Prior`] and [`Budget`], [`Outline`], [`FrameEstimate`]. Data
//! alone: the stages that work on it stand above.

pub(crate) mod config;
pub(crate) mod estimate;
pub(crate) mod outline;
pub(crate) mod position;
pub(crate) mod prior;
pub(crate) mod view_evidence;

pub use config::{CameraDistance, CameraModel, EstimatorConfig, OutlineMethod};
pub use estimate::{FrameEstimate, FrameRejection, Hypothesis, Pose, Timings};
pub use outline::{Outline, OutlineSource};
pub use prior::{Budget, Follows, OutlinePrior, Prior, SearchDepth};
pub use view_evidence::ViewEvidence;
