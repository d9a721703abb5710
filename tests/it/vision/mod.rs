//! Tests of the stage `vision`.

mod allocation;
mod budget;
mod calibrations;
mod camera;
mod circle;
#[cfg(feature = "cli")]
mod damage;
mod detector;
mod estimate;
pub(crate) mod input;
mod noise;
mod off_axis;
mod outline;
pub(crate) mod painted;
mod pipe;
mod position;
mod rolling;
mod sequence;
mod small;
mod smear;
mod tracker;
mod window;
