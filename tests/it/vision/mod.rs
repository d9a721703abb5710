//! Tests of the stage `vision`.

mod allocation;
mod camera;
mod circle;
mod detector;
mod estimate;
mod input;
mod noise;
mod off_axis;
mod outline;
mod pipe;
mod sequence;
mod tracker;
mod window;
