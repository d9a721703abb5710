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
//!
//! # The turn of the view frame
//! Orientations of a camera without intrinsics are in view frames, which turn as the ball crosses the picture; they are brought
//! into one. What is uncertain of the camera, three numbers, is so in all frames alike: one standard deviation of the `j`-th of three
//! independent errors turns the orientation at `t_i` by the rotation vector `s_j(t_i)` ([`ViewTurn`]). With `a_j` its mean and `b_j` the rate at
//! which it grows (straight lines by least squares) a spin `w` is off by `b_j + a_j x w`, and its covariance has the further terms `(b_j + a_j x
//! w)(b_j + a_j x w)^T`.

use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector6};

use super::Measurement;
use super::motion::Motion;
use crate::geometry::{CameraFrame, Rotation, Vec3};

/// Frames that are looked at; longer sequences are sampled evenly, since the sum goes over pairs.
const MAX_FRAMES: usize = 128;
/// An orientation's shared error over that of a dot: some eight dots are seen, and the residuals of
/// their fit are smaller than their errors. Measured on rendered sequences (`bench spin-coverage`).
const SHARED: f64 = 0.5;
/// Over this angle the visible dots, and with them the shared error, change.
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
    /// Covariance of a turn of the frame of the orientations, rad, in the middle of their times, and of the rate at which it turns, rad/s:
    /// neither do they show.
    pub turning: Matrix6<f64>,
}

impl SharedError {
    /// The error that the residuals of the frames' dots show, root mean square angles in radians;
    /// `None` without residuals.
    pub fn of_residuals(residuals_rad: impl Iterator<Item = f64>) -> Option<Self> {
        let (squares, count) = residuals_rad.fold((0.0, 0.0), |(sum, n), residual| {
            (sum + residual * residual, n + 1.0)
        });
        // Half of a residual's square lies along either axis.
        (count > 0.0).then(|| Self {
            sigma_rad: SHARED * (0.5 * squares / count).sqrt(),
            correlation_rad: CORRELATION_RAD,
            turning: Matrix6::zeros(),
        })
    }

    /// With the uncertain turns of the view frame, by the times of the orientations in seconds; `shared` is `None` where
    /// nothing else is known.
    pub fn with_turns(
        shared: Option<Self>,
        turns: impl Iterator<Item = (f64, ViewTurn)> + Clone,
    ) -> Option<Self> {
        let Some(turning) = turning(turns) else {
            return shared;
        };
        let none = Self {
            sigma_rad: 0.0,
            correlation_rad: CORRELATION_RAD,
            turning,
        };
        Some(Self {
            turning,
            ..shared.unwrap_or(none)
        })
    }
}

impl SharedError {
    /// Variance about an axis of the difference between the errors of drawn dots in two orientations, rad^2.
    pub(super) fn variance_between(&self, first: &Rotation, second: &Rotation) -> f64 {
        let sides = [first, second].map(|orientation| orientation.inverse() * Vec3::z());
        2.0 * self.sigma_rad.powi(2) * (1.0 - self.correlation(&sides[0], &sides[1]))
    }

    /// Correlation of the errors where the ball shows two sides, unit vectors.
    fn correlation(&self, a: &Vec3, b: &Vec3) -> f64 {
        let angle = a.dot(b).clamp(-1.0, 1.0).acos();
        (-0.5 * (angle / self.correlation_rad).powi(2)).exp()
    }

    /// Covariance of the rate at which the frame turns, rad^2/s^2.
    pub fn turn_rate_covariance(&self) -> Matrix3<f64> {
        self.turning.fixed_view::<3, 3>(3, 3).into_owned()
    }

    /// What the frame's turn adds to the covariance of a spin.
    pub(super) fn of_spin(&self, spin: &Vec3) -> Matrix3<f64> {
        let mut by = SMatrix::<f64, 3, 6>::zeros();
        by.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&-spin.cross_matrix());
        by.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&Matrix3::identity());
        by * self.turning * by.transpose()
    }
}

/// Independent errors of a camera that all frames of a sequence share.
pub const CAMERA_ERRORS: usize = 3;

/// The turn from the view frame of one orientation to the view frame that all of a sequence are in.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ViewTurn {
    /// The turn that the orientation contains, a rotation vector, radians.
    pub turn_rad: Vec3,
    /// By how much the orientation is off, a rotation vector, radians, by one standard deviation of each of the camera's errors.
    pub shared_rad: [Vec3; CAMERA_ERRORS],
}

impl ViewTurn {
    /// The same in other axes of the frame, or from them.
    pub fn in_axes(&self, axes: CameraFrame) -> Self {
        Self {
            turn_rad: axes.turn() * self.turn_rad,
            shared_rad: self.shared_rad.map(|s| axes.turn() * s),
        }
    }

    /// Its numbers: the turn, and the errors one after another.
    pub fn numbers(&self) -> [f64; Self::NUMBERS] {
        let mut numbers = [0.0; Self::NUMBERS];
        let vectors = std::iter::once(&self.turn_rad).chain(&self.shared_rad);
        for (number, value) in numbers.iter_mut().zip(vectors.flat_map(Vec3::iter)) {
            *number = *value;
        }
        numbers
    }

    /// Of its numbers.
    pub fn of_numbers(numbers: &[f64; Self::NUMBERS]) -> Self {
        let vector = |k: usize| Vec3::from_fn(|i, _| numbers[3 * k + i]);
        Self {
            turn_rad: vector(0),
            shared_rad: [vector(1), vector(2), vector(3)],
        }
    }

    /// How many numbers it has.
    pub const NUMBERS: usize = 3 + 3 * CAMERA_ERRORS;

    /// The covariance that all of a sequence share, rad^2.
    pub fn shared_covariance(&self) -> Matrix3<f64> {
        self.shared_rad.iter().map(|s| s * s.transpose()).sum()
    }
}

/// The covariance of the turn of a sequence's view frame and of its rate; `None` for fewer than two turns.
fn turning(turns: impl Iterator<Item = (f64, ViewTurn)> + Clone) -> Option<Matrix6<f64>> {
    let (count, sum) = turns
        .clone()
        .fold((0.0, 0.0), |(n, sum), (t, _)| (n + 1.0, sum + t));
    let middle = sum / count;
    let spread: f64 = turns.clone().map(|(t, _)| (t - middle).powi(2)).sum();
    // Neither without turns nor with one.
    if spread.is_nan() || spread <= 0.0 {
        return None;
    }
    let mut covariance = Matrix6::zeros();
    for k in 0..CAMERA_ERRORS {
        let (mut mean, mut rate) = (Vec3::zeros(), Vec3::zeros());
        for (t, turn) in turns.clone() {
            mean += turn.shared_rad[k] / count;
            rate += turn.shared_rad[k] * ((t - middle) / spread);
        }
        let line = Vector6::from_iterator(mean.iter().chain(rate.iter()).copied());
        covariance += line * line.transpose();
    }
    Some(covariance)
}

/// A frame's part in the sum.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameTerm<const P: usize> {
    weight: f64,
    jacobian: SMatrix<f64, 3, P>,
    /// The side seen: the direction towards the camera, pattern frame.
    side: Vec3,
}

/// What the shared error adds to the covariance of a motion's rates, local frame, without the turns of the view frame; `None`
/// where the fit leaves the rates undetermined. `prior` has the inverse variances of the rates before the fit, `parts` is
/// working memory.
pub(super) fn shared_covariance<M: Motion<P>, const P: usize>(
    measurements: &[Measurement],
    motion: &M,
    sigma_rad: f64,
    probabilities: &[f64],
    (shared, prior): (&SharedError, &SVector<f64, P>),
    parts: &mut Vec<FrameTerm<P>>,
) -> Option<SMatrix<f64, P, P>> {
    let stride = measurements.len().div_ceil(MAX_FRAMES).max(1);
    parts.clear();
    // By the frames, not by those that count: a sequence as long then needs no more.
    parts.reserve(measurements.len().div_ceil(stride));
    let jacobian = motion.jacobian();
    for (m, &p) in measurements.iter().zip(probabilities).step_by(stride) {
        if p < MIN_PROBABILITY {
            continue;
        }
        parts.push(FrameTerm {
            weight: p / (sigma_rad * m.sigma_scale).powi(2),
            jacobian: jacobian(m).1,
            side: motion.predict(m.time_s).inverse() * Vec3::z(),
        });
    }
    let total: f64 = parts.iter().map(|p| p.weight).sum();
    let mean = parts
        .iter()
        .map(|p| p.jacobian * p.weight)
        .sum::<SMatrix<f64, 3, P>>()
        / total;
    // The frames that are left out say as much: against a prior it counts how much all say.
    let mut information = SMatrix::<f64, P, P>::from_diagonal(&(prior / stride as f64));
    for part in parts.iter_mut() {
        part.jacobian -= mean;
        information += part.jacobian.tr_mul(&part.jacobian) * part.weight;
    }
    let mut meat = SMatrix::<f64, P, P>::zeros();
    for (i, a) in parts.iter().enumerate() {
        for (j, b) in parts[i..].iter().enumerate() {
            let correlation = shared.correlation(&a.side, &b.side);
            let term = a.jacobian.tr_mul(&b.jacobian) * (a.weight * b.weight * correlation);
            meat += if j == 0 {
                term
            } else {
                term + term.transpose()
            };
        }
    }
    let inverse = information.cholesky()?.inverse();
    Some(inverse * meat * inverse * shared.sigma_rad.powi(2))
}
