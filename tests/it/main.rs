//! The integration tests, in one program so that the crate is linked once; modules by stage.
//!
//! Slow ones run a part of their cases. `SPINDOE_SEEDS=20 cargo test --release --test it` runs all of them; [`breaks`] names its own.

#![allow(clippy::unwrap_used)]

mod ball;
mod breaks;
mod calibrate;
mod cli;
mod common;

#[cfg(feature = "vision")]
mod derived;
mod design;
#[cfg(feature = "cli")]
mod docs;
mod geometry;

#[cfg(feature = "vision")]
mod camera;
mod mark;
mod pattern;
mod plot;
mod recognize;
mod report;
mod several;
mod spin;
mod stencil;
mod synth;
mod validate;
mod view;
mod vision;
