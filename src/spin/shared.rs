//! Errors that frames share: the covariance of a spin whose orientations come from drawn dots.
//!
//! A dot that was drawn a degree off its place is a degree off in every frame that shows it. The
//! error of an orientation is then a function `b(v)` of the side `v` that the ball shows to the
//! camera, the same whenever that side comes round again: more turns do not average it out. It tilts
//! the axis of a spin that is otherwise known to a thousandth.
//!
//! `b` is modeled as a Gaussian process on the sphere in the pattern's frame, isotropic, with the
//! deviation `s` and the correlation `exp(-(a / l)^2 / 2)` over the angle `a` between two sides: from
//! one side to another half of the dots change over some 50 degrees. For the weighted least squares
//! of the fit with the information `H`, Jacobians `J_i` and weights `w_i`, the covariance that it adds is
//! the sandwich `H^-1 (sum_ij w_i w_j J_i^T C_ij J_j) H^-1` with `C_ij = s^2 c_ij R_i R_j^T`
//! (P. Huber, "The behavior of maximum likelihood estimates under nonstandard conditions", 1967).

use nalgebra::{Matrix3, Matrix6, SMatrix};

use super::refine::{Residual, axis_and_rate, jacobian};
use super::{Measurement, Motion};
use crate::geometry::Vec3;

/// Frames that are looked at; longer sequences are sampled evenly, since the sum goes over pairs.
const MAX_FRAMES: usize = 128;
/// An orientation's shared error over that of a dot: some eight dots are seen, and the residuals of
/// their fit are smaller than their errors. Measured on rendered sequences (`spin_coverage`).
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

/// A frame's part in the sum: `w R^T J`, and the side seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    weighted: SMatrix<f64, 3, 6>,
    side: Vec3,
}

/// What the shared error adds to the covariance of the spin; `None` where the fit leaves the spin
/// undetermined. `parts` is working memory.
pub(super) fn shared_covariance(
    measurements: &[Measurement],
    motion: &Motion,
    sigma_rad: f64,
    probabilities: &[f64],
    shared: &SharedError,
    parts: &mut Vec<Part>,
) -> Option<Matrix3<f64>> {
    let (axis, rate) = axis_and_rate(&motion.spin);
    let mut information = Matrix6::zeros();
    let stride = measurements.len().div_ceil(MAX_FRAMES).max(1);
    parts.clear();
    // By the frames, not by those that count: a sequence as long then needs no more.
    parts.reserve(measurements.len().div_ceil(stride));
    for (m, &p) in measurements.iter().zip(probabilities).step_by(stride) {
        if p < MIN_PROBABILITY {
            continue;
        }
        let jacobian = jacobian(&axis, &Residual::new(motion, &axis, rate, m));
        let weight = p / (sigma_rad * m.sigma_scale).powi(2);
        information += jacobian.transpose() * jacobian * weight;
        let orientation = motion.at(m.time_s);
        let back = orientation.inverse();
        parts.push(Part {
            weighted: back.to_rotation_matrix().matrix() * jacobian * weight,
            side: back * Vec3::z(),
        });
    }
    let mut meat = Matrix6::zeros();
    for (i, a) in parts.iter().enumerate() {
        for (j, b) in parts[i..].iter().enumerate() {
            let angle = a.side.dot(&b.side).clamp(-1.0, 1.0).acos();
            let correlation = (-0.5 * (angle / shared.correlation_rad).powi(2)).exp();
            let term = a.weighted.transpose() * b.weighted * correlation;
            meat += if j == 0 {
                term
            } else {
                term + term.transpose()
            };
        }
    }
    let inverse = information.cholesky()?.inverse();
    let sandwich = inverse * meat * inverse * shared.sigma_rad.powi(2);
    Some(sandwich.fixed_view::<3, 3>(3, 3).into_owned())
}
