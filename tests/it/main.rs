//! The integration tests, in one program so that the crate is linked once; modules by stage.

#![allow(clippy::unwrap_used)]

mod ball;
mod breaks;
mod calibrate;
mod cli;
#[cfg(all(feature = "cli", feature = "vision"))]
mod clip;
mod common;

#[cfg(feature = "vision")]
mod dataset;
#[cfg(feature = "vision")]
mod derived;
mod design;
#[cfg(feature = "cli")]
mod docs;
mod geometry;
mod layers;

#[cfg(feature = "vision")]
mod camera;
mod mark;
mod pattern;
mod plot;
mod recognize;
mod report;
#[cfg(all(feature = "cli", feature = "vision"))]
mod rig;
mod several;
mod spin;
mod stencil;
mod synth;
mod validate;
mod view;
mod vision;
