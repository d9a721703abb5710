//! Hash features of a pattern, and the table that a run-time estimator loads.
//!
//! The method is geometric hashing as in Gossard et al., "SpinDOE" (arXiv 2303.03879), Sec. II-C
//! and Alg. 1. An ordered pair of dots (d, d') spans the basis `B = [d, d', d x d']` (columns). Any
//! third dot d'' has the coordinates `h = B^-1 d''` in it. Since `R d x R d' = R (d x d')`, h does
//! not change when the ball rotates: it is the key under which an observed triple of dots is found.
//!
//! The table guarantees that every feature of an allowed pair is present exactly once. It does not
//! guarantee that features are distinct: a pattern with symmetries has equal features.
//!
//! - [`features`]: bases, features and the rule by which pairs enter the table,
//! - [`table`]: the table with its search tree,
//! - [`npz`]: the table as a NumPy archive.

pub mod features;
pub mod npz;
pub mod table;

pub use features::{Basis, BasisFrame, Feature, PairRule};
pub use table::{CalibrationRecord, HashTable, ObjectiveRecord, RecognizerConfig, TableMeta};
