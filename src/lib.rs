//! Dot patterns for balls: design, proof, hash table, stencil.

pub mod cli;
pub mod design;
pub mod error;
pub mod files;
pub mod geometry;
pub mod hash;
pub mod pattern;
pub mod plot;
pub mod recognise;
pub mod report;
pub mod spin;
pub mod stencil;
pub mod validate;

pub use error::{Error, Result};
