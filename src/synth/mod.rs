//! The synthetic ball spinner: frames of a turning ball with exact truth.
//!
//! A [`Scene`] describes a frame completely: the ball and what is drawn on it, light, camera,
//! motion and noise. It is drawn at random ([`Scene::random`], as widely as [`SynthConfig`] allows)
//! or set by the caller, and [`Scene::render`] makes the image. The stages follow the light:
//!
//! 1. the ball's [`surface`] with the dots of a [`pen`] and with [`logo`]s, under the [`light`];
//! 2. the camera's [`view`] of it, integrated over the exposure ([`render`]), before a
//!    [`background`] and behind what hides it ([`occlusion`]);
//! 3. the [`sensor`]: defocus, noise, tone; and [`compression`].
//!
//! A frame may show several balls, or one several times by the flashes of one exposure: [`several`].
//! [`dataset`] makes sets and sequences, [`folder`] writes them. Colors are linear light until the
//! sensor's encoding.
//!
//! Guaranteed: the truth is exact for the scene. Not modeled: lens distortion, rolling shutters,
//! shadows of the background's things, motion compensation of video, a spin that is not
//! constant.
//!
//! ```
//! use spindoe::geometry::spiral_directions;
//! use spindoe::pattern::Pattern;
//! use spindoe::synth::{SynthConfig, dataset::independent_frame};
//!
//! # fn main() -> spindoe::Result<()> {
//! let pattern = Pattern::new(spiral_directions(20).collect())?;
//! let frame = independent_frame(&pattern, &SynthConfig::good(), 7, 0)?;
//! let to_find = frame.truth.dots.iter().filter(|d| d.visible).count();
//! assert!(to_find > 0);
//! # Ok(())
//! # }
//! ```

pub mod background;
mod ball_image;
pub mod blotches;
mod canvas;
mod color;
pub mod compression;
pub mod config;
pub mod dataset;
pub mod dimples;
mod flying;
pub mod folder;
pub mod ground;
pub mod light;
pub mod logo;
mod noise;
pub mod occlusion;
pub mod pen;
mod random;
pub mod render;
pub mod rig;
pub mod scene;
pub mod sensor;
pub mod several;
pub mod signal;
mod spot;
pub mod surface;
pub mod texture;
pub mod training;
pub mod view;
mod world;

pub use color::Color;
pub use config::{SynthConfig, SynthKind};
pub use render::{Rendering, TrueDot};
pub use scene::Scene;
pub use world::world_sha256;
