//! Designing patterns: objectives with their gradients, hard constraints, the descent, and the
//! search.
//!
//! - [`objective`]: what makes a pattern easy to identify,
//! - [`constraints`]: the constraints for printing, drawing and reading it,
//! - [`descent`]: the descent under these constraints,
//! - [`dot_set`]: whether the dots of a ball are good, and where one more would help,
//! - [`state`]: how far a search has come, also on disk, and its shards,
//! - [`search`]: whether the constraints can be met; then many starts, screening, and selection by
//!   Monte Carlo.
//!
//! The evaluation is separate from the optimization. The objectives draw no trials of the pattern they judge, no trial
//! that selects serves twice, and reported rates come from seeds used nowhere else.

mod config;
pub mod constraints;
pub mod descent;
pub mod dot_set;
pub mod objective;
mod ranking;
mod request;
pub mod search;
pub mod state;
mod views;

pub use crate::pattern::random_pattern;
pub use config::DesignConfig;
pub use constraints::{Constraints, KeepOut};
pub use descent::DescentMethod;
pub use objective::{Objective, ObjectiveName, OrientationBound};
pub use ranking::{CameraRank, CameraRecord, CameraRequest};
pub use request::DesignRequest;
pub use search::{DesignObserver, DesignOutcome, Stage, design, search_rounds};
pub use state::{DesignCandidate, Milestone, SearchState, Shard};
pub use views::DesignViews;
