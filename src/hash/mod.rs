//! Hash features of a pattern, and the table that a run-time estimator loads.
//!
//! Geometric hashing as in Gossard et al., "SpinDOE" (arXiv 2303.03879), Sec. II-C and Alg. 1: an
//! ordered pair of dots (d, d') spans the basis `B = [d, d', d x d']` (columns), and any third dot d''
//! has in it the coordinates `h = B^-1 d''`. Since `R d x R d' = R (d x d')`, h does not change when
//! the ball turns: it is the key under which a seen triple of dots is looked up.
//!
//! - [`features`]: bases, features and the rule by which pairs enter the table,
//! - [`table`]: the table with its search tree,
//! - [`npz`]: the table as a NumPy archive.

pub mod features;
pub mod npz;
pub mod table;

pub use features::{Basis, BasisFrame, Feature, PairRule};
pub use table::{HashTable, ObjectiveRecord, RecognizerConfig, TableMeta};
