//! Robust least squares, once for all that fits: losses, normal equations, damped steps, polynomials.
//!
//! Gauss-Newton's step `x` on residuals `e_i` with derivatives `J_i` and information `W_i` solves
//!
//! ```text
//! (sum w_i J_i^T W_i J_i + P) x = sum w_i J_i^T W_i e_i + P (what is known - what is)
//! ```
//!
//! with the weights `w_i` of a loss: [`Student`]'s distribution or Tukey's [`biweight`]; `P` is what is known beforehand. [`Sums`] adds scalar
//! residuals (pixels, edges; [`LaneSums`] four pixels at a time), [`Normal`] vectors (dots, outlines); both have their size as a parameter and allocate nothing. Where a whole step
//! may lead uphill, [`Damping`] shortens it. Not here: the bundle adjustments, whose frames are eliminated (`calibrate/bundle/schur.rs`,
//! `surface/bundle.rs`), and the mixture of a spin, whose shares are fitted with it (`spin/mixture`).

mod damping;
#[cfg(feature = "vision")]
mod lanes;
mod loss;
mod normal;
mod polynomial;
mod sums;

pub(crate) use damping::{DampedDescent, Damping};
#[cfg(feature = "vision")]
pub(crate) use lanes::{FourPixels, LANES, LanePixels, LaneSums, normal_cdf_and_density};
pub(crate) use loss::{Student, biweight, weighted_sigma};
pub(crate) use normal::Normal;
pub(crate) use polynomial::Reweighting;
pub(crate) use sums::Sums;
