//! Tests of the stage `cli`.

mod compare;
mod contract;
mod identify;
mod spin;
mod trust;
