//! Dot patterns for balls: design, proof, hash table, stencil.

pub mod error;
pub mod files;
pub mod geometry;
pub mod pattern;
pub mod stencil;

pub use error::{Error, Result};
