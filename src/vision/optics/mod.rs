//! How a ball is seen: [`camera`], [`lens`] and [`intrinsics`], the outline of a ball anywhere in the picture, places in parts of
//! pictures.

mod ball_circle;
pub(crate) mod ball_pixels;
pub mod camera;
pub(crate) mod crop;
pub mod derived;
pub(crate) mod grid;
pub mod intrinsics;
pub mod lens;
pub(crate) mod off_center;
pub(crate) mod oval;
pub mod rig;
mod tilt;

pub use off_center::OffCenter;
pub use oval::Oval;
