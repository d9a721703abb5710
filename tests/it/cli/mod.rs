//! Tests of the stage `cli`.

mod compare;
mod contract;
mod fictrac;
mod frames;
mod identify;
mod spin;
mod trust;
