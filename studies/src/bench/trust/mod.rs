//! How far answers can be trusted: the tables of docs/measurements/trust.md, and the map of an estimate's
//! confidence.

pub mod conditions;
pub mod kinds;
pub mod logistic;
pub mod spins;
pub mod verdicts;
