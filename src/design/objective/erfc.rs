//! The normal distribution's tail.

use crate::stats::normal_cdf;

/// `P(N(0, 1) > x)` and the density at `x`.
pub(super) fn normal_tail(x: f64) -> (f64, f64) {
    let density = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    (normal_cdf(-x), density)
}
