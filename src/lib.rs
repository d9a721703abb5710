//! Dot patterns for balls: design, proof, hash table, stencil.

pub mod error;
pub mod files;
pub mod geometry;
pub mod hash;
pub mod pattern;
pub mod recognise;

pub use error::{Error, Result};
