//! The synthetic ball spinner: frames of a turning ball with exact truth.
//!
//! A [`Scene`] says everything about a frame: the ball and what is drawn on it, light, camera, motion and noise. It is drawn
//! at random ([`Scene::random`], as widely as [`SynthConfig`] allows) or set by hand, and [`Scene::render`] makes the image. The
//! stages follow the light: the ball's surface with dots and logo ([`surface`]), shading and
//! integration over the exposure ([`render`]), then the sensor ([`sensor`]): defocus, noise, gamma, compression.
//!
//! Colors are linear light until the sensor's gamma.

pub mod dataset;
pub mod folder;
pub mod logo;
pub mod render;
pub mod scene;
pub mod sensor;
pub mod surface;

pub use render::{Rendering, TrueDot};
pub use scene::{Scene, SynthConfig};
