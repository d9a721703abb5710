//! Tests of the stage `vision`.

mod camera;
mod circle;
mod detector;
mod estimate;
mod input;
