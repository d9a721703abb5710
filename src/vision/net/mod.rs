//! The dot detector: a small fully convolutional net with a heat map.
//!
//! As in the SpinDOE paper (Sec. III-A), the net is of the CenterNet kind (X. Zhou, D. Wang, P. Krähenbühl, "Objects as points",
//! arXiv 1904.07850): it gives a heat map whose peaks are dots. It differs in three ways: it sees a
//! [`Patch`](super::Patch), that is, gray values at one scale and brightness, so that any ball and camera serve; its map
//! has half the patch's resolution, and each cell says where within it the dot lies; and each cell says how sure it is of
//! that, as the Cholesky factor of the dot's inverse covariance.
//!
//! - [`graph`]: the layers and how they are joined,
//! - [`weights`]: the numbers, as a NumPy archive,
//! - [`model`]: both together, run by burn on one thread,
//! - [`detector`]: from heat map to dots,
//! - [`onnx`]: the same net for other programs.

pub mod detector;
pub mod graph;
pub mod model;
pub mod onnx;
pub mod weights;

pub use detector::CnnDetector;
pub use weights::Weights;
