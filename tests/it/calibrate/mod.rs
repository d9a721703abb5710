//! Tests of the stage `calibrate`: clips of detections with a known truth, made without its code.

mod bad_input;
pub mod clip;
mod command;
mod filmed;
mod fit;
mod marked;
mod real;
mod unknown;
