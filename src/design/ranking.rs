//! How the finalists of a search are ranked for a camera, as data: what a search and its shards are asked for, and what came
//! of it. `camera::rank_finalists` ranks them.

use serde::{Deserialize, Serialize};

use crate::stats::{Proportion, or_nan};

/// A camera that is to rank the finalists of a search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraRequest {
    /// The camera's conditions, as JSON.
    pub conditions: serde_json::Value,
    /// Frames of a finalist that is not clearly worse than the best: half rank, half measure.
    pub frames: u64,
    /// Their seed.
    pub seed: u64,
}

/// The finalists of a design as a camera ranks them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraRecord {
    /// What was asked for.
    #[serde(flatten)]
    pub request: CameraRequest,
    /// The finalists, the best first.
    pub finalists: Vec<CameraRank>,
}

/// A finalist's rates on frames of the camera that did not rank it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraRank {
    /// The start it came from.
    pub start: usize,
    /// Frames answered with an error under 20 degrees.
    pub right: Proportion,
    /// Frames answered with a larger one.
    pub wrong: Proportion,
    /// Mean error of the right ones, degrees; this and the next are NaN without any, which JSON has as null.
    #[serde(deserialize_with = "or_nan")]
    pub mean_error_deg: f64,
    /// Root mean square error over `sqrt(right - 2 wrong)`, degrees: what the race ranks by.
    #[serde(deserialize_with = "or_nan")]
    pub effective_error_deg: f64,
}
