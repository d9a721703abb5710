//! What several measuring programs share.

pub mod noise;
pub mod pictures;
pub mod ranks;

/// The bound of the orientation error, shared with the tests.
#[path = "../../tests/it/common/orientation_bound.rs"]
pub mod orientation_bound;
