//! Errors that frames share: the covariance of a spin whose orientations come from drawn dots.
//!
//! A dot that was drawn a degree off its place is a degree off in every frame that shows it. The
//! error of an orientation is then a function `b(v)` of the side `v` that the ball shows to the
//! camera, the same whenever that side comes round again: more turns do not average it out. It tilts
//! the axis of a spin that is otherwise known to a thousandth.
//!
//! `b` is modeled as a Gaussian process on the sphere in the pattern's frame, isotropic, with the
//! deviation `s` and the correlation `c_ij = exp(-(a / l)^2 / 2)` over the angle `a` between two sides: from
//! one side to another half of the dots change over some 50 degrees. Carried back to the reference time,
//! as the fit compares errors (see [`super::motion`]), the shared errors of two frames have the covariance `s^2
//! c_ij I`. For the weighted least squares of the fit with the weights `w_i`, Jacobians `J_i` about their
//! weighted mean and the information `H = sum_i w_i J_i^T J_i`, the covariance that this adds is the
//! sandwich `s^2 H^-1 (sum_ij w_i w_j c_ij J_i^T J_j) H^-1` (P. Huber, "The behavior of maximum
//! likelihood estimates under nonstandard conditions", 1967).

use nalgebra::Matrix3;

use super::Measurement;
use super::motion::{ConstantSpin, LocalFrame, Motion};
use crate::geometry::Vec3;

/// Frames that are looked at; longer sequences are sampled evenly, since the sum goes over pairs.
const MAX_FRAMES: usize = 128;
/// An orientation's shared error over that of a dot: some eight dots are seen, and the residuals of
/// their fit are smaller than their errors. Measured on rendered sequences (`bench spin-coverage`).
const SHARED: f64 = 0.5;
/// Over this angle the dots in sight, and with them the shared error, change.
const CORRELATION_RAD: f64 = 0.7;
/// Frames with a smaller probability have no say.
const MIN_PROBABILITY: f64 = 1e-3;

/// An error that orientations share where they show the same side of the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedError {
    /// Its standard deviation about an axis, radians.
    pub sigma_rad: f64,
    /// Angle over which it changes, radians.
    pub correlation_rad: f64,
}

impl SharedError {
    /// The error that the residuals of the frames' dots tell of, root mean square angles in radians;
    /// `None` without residuals.
    pub fn of_residuals(residuals_rad: impl Iterator<Item = f64>) -> Option<Self> {
        let (squares, count) = residuals_rad.fold((0.0, 0.0), |(sum, n), residual| {
            (sum + residual * residual, n + 1.0)
        });
        // Half of a residual's square lies along either axis.
        (count > 0.0).then(|| Self {
            sigma_rad: SHARED * (0.5 * squares / count).sqrt(),
            correlation_rad: CORRELATION_RAD,
        })
    }
}

/// A frame's part in the sum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    weight: f64,
    jacobian: Matrix3<f64>,
    /// The side seen: the direction towards the camera, pattern frame.
    side: Vec3,
}

/// What the shared error adds to the covariance of the spin; `None` where the fit leaves the spin
/// undetermined. `parts` is working memory.
pub(super) fn shared_covariance(
    measurements: &[Measurement],
    motion: &ConstantSpin,
    sigma_rad: f64,
    probabilities: &[f64],
    shared: &SharedError,
    parts: &mut Vec<Part>,
) -> Option<Matrix3<f64>> {
    let stride = measurements.len().div_ceil(MAX_FRAMES).max(1);
    parts.clear();
    // By the frames, not by those that count: a sequence as long then needs no more.
    parts.reserve(measurements.len().div_ceil(stride));
    let jacobian = motion.jacobian();
    for (m, &p) in measurements.iter().zip(probabilities).step_by(stride) {
        if p < MIN_PROBABILITY {
            continue;
        }
        parts.push(Part {
            weight: p / (sigma_rad * m.sigma_scale).powi(2),
            jacobian: jacobian(m).1,
            side: motion.at(m.time_s).inverse() * Vec3::z(),
        });
    }
    let total: f64 = parts.iter().map(|p| p.weight).sum();
    let mean = parts
        .iter()
        .map(|p| p.jacobian * p.weight)
        .sum::<Matrix3<f64>>()
        / total;
    let mut information = Matrix3::zeros();
    for part in parts.iter_mut() {
        part.jacobian -= mean;
        information += part.jacobian.tr_mul(&part.jacobian) * part.weight;
    }
    let mut meat = Matrix3::zeros();
    for (i, a) in parts.iter().enumerate() {
        for (j, b) in parts[i..].iter().enumerate() {
            let angle = a.side.dot(&b.side).clamp(-1.0, 1.0).acos();
            let correlation = (-0.5 * (angle / shared.correlation_rad).powi(2)).exp();
            let term = a.jacobian.tr_mul(&b.jacobian) * (a.weight * b.weight * correlation);
            meat += if j == 0 {
                term
            } else {
                term + term.transpose()
            };
        }
    }
    let inverse = information.cholesky()?.inverse();
    let sandwich = inverse * meat * inverse * shared.sigma_rad.powi(2);
    let basis = LocalFrame::of(&motion.spin).basis;
    Some(basis * sandwich * basis.transpose())
}
