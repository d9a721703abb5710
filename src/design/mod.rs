//! Designing patterns: objectives with their gradients, hard constraints, the descent, and the search.
//!
//! - [`objective`]: what makes a pattern easy to identify,
//! - [`constraints`]: what it must satisfy to be printed, drawn and read,
//! - [`feasible`]: whether that can be had,
//! - [`scp`]: the descent under these constraints,
//! - [`start`]: random patterns to start from,
//! - [`search`]: many starts, screening, and selection by Monte Carlo,
//! - [`rate`] and [`polish`]: the last stage, on the measured rate itself,
//! - [`checkpoint`]: a search on disk, whole.
//!
//! What is optimized against is not what a pattern is judged by: the objectives draw no trials, the
//! trials that select are fresh in every round, and what is reported comes from seeds used nowhere else.

mod candidate;
pub mod checkpoint;
mod config;
pub mod constraints;
pub mod feasible;
pub mod objective;
pub mod polish;
pub mod rate;
pub mod scp;
pub mod search;
pub mod start;
mod work;

pub use crate::pattern::random_pattern;
pub use candidate::{Candidate, Milestone, Stage};
pub use config::DesignConfig;
pub use constraints::{Constraints, KeepOut};
pub use objective::{Objective, ObjectiveName, OrientationBound};
pub use search::{DesignObserver, DesignOutcome, design};
