//! The dot detector: a small fully convolutional net with a heat map.
//!
//! As in the SpinDOE paper (Sec. III-A), the net is of the CenterNet kind (X. Zhou, D. Wang, P.
//! Krähenbühl, "Objects as points", arXiv 1904.07850): it gives a heat map whose peaks are dots. It
//! differs in three ways. It sees a [`Patch`](super::Patch), that is, gray values at one scale and
//! brightness, so that any ball and camera serve. Its map has half the patch's resolution, and each
//! cell says where within it the dot lies. Each cell says the uncertainty of that position, as the
//! Cholesky factor of the dot's inverse covariance.
//!
//! - [`graph`]: the layers and how they are joined,
//! - [`weights`]: the numbers, as a NumPy archive,
//! - [`network`]: both together, run on one thread,
//! - [`onnx`]: the same net for other programs.
//!
//! `python/train` makes the weights, of samples that [`synth::training`](crate::synth::training) draws.

mod convolution;
pub mod graph;
pub mod network;
pub mod onnx;
pub mod weights;

pub use weights::Weights;
