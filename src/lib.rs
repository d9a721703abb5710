//! Dot patterns for balls: designed, evaluated, shipped, and recognized.
//!
//! A ball carries identical dots. Their arrangement identifies them (geometric hashing), which gives
//! the ball's orientation in one camera image; a sequence of orientations gives its spin. This crate
//! designs such patterns, proves them by Monte Carlo, writes the hash table that an estimator loads and
//! the stencil that a 3-D printer makes, and holds the estimator's stages. It follows T. Gossard, J.
//! Tebbe, A. Ziegler, A. Zell, "SpinDOE: a ball spin estimation method for table tennis robot", IROS
//! 2023 (arXiv 2303.03879), and keeps the paper's algorithms as named baselines.
//!
//! # Stages
//! Imports run from left to right only:
//! [`geometry`] <- [`pattern`] <- [`hash`] <- [`recognize`] <- [`validate`] <- [`design`];
//! [`pipeline`] (work on a stream) serves [`recognize`];
//! [`stencil`], [`mark`], [`spin`] and [`vision`] (from images to orientations) stand beside them, [`plot`], [`report`] and
//! [`cli`] on top.
//!
//! # Conventions
//! The library takes radians and SI units. Camera frame: x right, y up, z from the ball towards the
//! camera; a dot is visible where z > 0. A [`geometry::Rotation`] maps the pattern's frame to the
//! camera's. All that is random is seeded, and the same seed gives the same bytes on any number of
//! threads.
//!
//! # Example
//! How often is a pattern identified rightly?
//!
//! ```
//! use spindoe::hash::{HashTable, PairRule, RecognizerConfig};
//! use spindoe::pattern::Pattern;
//! use spindoe::recognize::RecognizerName;
//! use spindoe::validate::{Protocol, ProtocolName, validate_named};
//!
//! # fn main() -> spindoe::Result<()> {
//! # let mut rng = <rand_chacha::ChaCha8Rng as rand::SeedableRng>::seed_from_u64(1);
//! # let pattern = spindoe::pattern::random_pattern(20, 0.3, &mut rng)?;
//! // or: let pattern = Pattern::read_csv("pattern.csv".as_ref())?;
//! let table = HashTable::build(pattern, PairRule::default(), RecognizerConfig::default())?;
//! let protocol = Protocol::standard(ProtocolName::Paper);
//! let found = validate_named(&table, RecognizerName::Robust, &protocol, 7, 200)?;
//! println!("{} of {} trials", found.validation.identity, found.validation.samples);
//! assert!(found.validation.identity.rate > 0.9);
//! # Ok(())
//! # }
//! ```

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
mod concurrency;
pub mod design;
mod error;
pub mod files;
pub mod geometry;
pub mod hash;
pub mod mark;
mod npz;
pub mod pattern;
#[cfg(feature = "native")]
pub mod pipeline;
#[cfg(feature = "plot")]
pub mod plot;
pub mod recognize;
#[cfg(feature = "native")]
pub mod report;
pub mod spin;
pub mod stats;
pub mod stencil;
#[cfg(feature = "vision")]
pub mod synth;
pub mod validate;
#[cfg(feature = "vision")]
pub mod vision;

pub use error::{Error, Parameter, Result};
