//! How the finalists of a search are ranked for a camera, as data: what a search is asked for, what its
//! shards carry to their merge, and what the report tells. `camera::CameraRanking` ranks them.

use serde::{Deserialize, Serialize};

use crate::stats::Proportion;

/// A camera that ranks the finalists of a design.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraRecord {
    /// The camera's conditions, as JSON.
    pub conditions: serde_json::Value,
    /// Frames of a finalist that is not clearly worse than the best.
    pub frames: u64,
    /// Their seed.
    pub seed: u64,
    /// The finalists, the best first; none before they were ranked.
    #[serde(default)]
    pub finalists: Vec<CameraRank>,
}

/// A finalist before the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraRank {
    /// The start it came from.
    pub start: usize,
    /// Frames answered with an error under 20 degrees.
    pub right: Proportion,
    /// Frames answered with a larger one.
    pub wrong: Proportion,
    /// Mean error of the right ones, degrees.
    pub mean_error_deg: f64,
    /// Root mean square error over `sqrt(right - 2 wrong)`, degrees: what they were ranked by.
    pub effective_error_deg: f64,
}
