//! What several measuring programs share: sets of frames, scoring, and tables.

pub mod frames;
pub mod hand;
pub mod noise;
pub mod painted;
pub mod pictures;
pub mod ranks;
pub mod score;
pub mod table;

/// The bound of the orientation error, shared with the tests.
#[path = "../../tests/it/common/orientation_bound.rs"]
pub mod orientation_bound;

/// What a measurement gives, or what hinders it.
pub type Outcome<T = ()> = Result<T, Box<dyn std::error::Error + Send + Sync>>;
