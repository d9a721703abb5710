//! Designing patterns: objectives with their gradients, hard constraints, the descent, and the search.
//!
//! - [`objective`]: what makes a pattern easy to identify,
//! - [`constraints`]: what it must satisfy to be printed, drawn and read,
//! - [`scp`]: the descent under these constraints,
//! - [`start`]: random patterns to start from,
//! - [`search`]: many starts, screening, and selection by Monte Carlo,
//! - [`checkpoint`]: a search on disk, whole.
//!
//! What is optimized against is not what a pattern is judged by: the objectives draw no trials, the
//! trials that select are fresh in every round, and what is reported comes from seeds used nowhere else.

pub mod checkpoint;
pub mod constraints;
pub mod objective;
pub mod scp;
pub mod search;
pub mod start;
mod work;

pub use constraints::{Constraints, KeepOut};
pub use objective::{Objective, ObjectiveName, OrientationBound};
pub use search::{
    Candidate, DesignConfig, DesignObserver, DesignOutcome, Milestone, Stage, design,
};
pub use start::random_pattern;
