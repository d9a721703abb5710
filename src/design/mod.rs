//! Designing patterns: objectives with their gradients, hard constraints, the descent, and the
//! search.
//!
//! - [`objective`]: what makes a pattern easy to identify,
//! - [`constraints`]: the constraints for printing, drawing and reading it,
//! - [`feasible`]: whether the constraints can be met,
//! - [`descent`]: the descent under these constraints,
//! - [`start`]: random patterns to start from,
//! - [`search`]: many starts, screening, and selection by Monte Carlo,
//! - [`shard`]: a search in parts, on several machines,
//! - [`checkpoint`]: the state of a search on disk.
//!
//! The evaluation is separate from the optimization. The objectives draw no trials, the trials that
//! select are fresh in every round, and reported rates come from seeds used nowhere else.

mod candidate;
pub mod checkpoint;
mod config;
pub mod constraints;
pub mod descent;
pub mod feasible;
pub mod objective;
pub mod search;
pub mod shard;
pub mod start;
mod work;

pub use crate::pattern::random_pattern;
pub use candidate::{Candidate, Milestone, Stage};
pub use config::DesignConfig;
pub use constraints::{Constraints, KeepOut};
pub use objective::{Objective, ObjectiveName, OrientationBound};
pub use search::{DesignObserver, DesignOutcome, design, search_rounds};
pub use shard::Shard;
