//! Designing patterns: objectives with gradients, the descent, and the search over many starts.

pub mod objective;
