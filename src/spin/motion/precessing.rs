//! The spin of an uneven ball: it precesses about an axis of the ball, and about its angular momentum.
//!
//! A ball whose moments of inertia about one axis `b` and across it differ by the ratio `1 + e`
//! (a seam, a thicker cap, a logo's ink) turns, without torque, as a symmetric top: seen from the ball
//! its angular velocity circles `b` at the constant rate `e` times its component along `b` (L. D.
//! Landau, E. M. Lifshitz, "Mechanics", 3rd ed. 1976, Sec. 33 and 36). The orientation is the product
//! of two even turns,
//!
//! ```text
//! R(t) = exp([p]x t) R(0) exp([q]x t),      w(t) = p + R(t) q
//! ```
//!
//! with `p` fixed in space (along the angular momentum) and `q` fixed in the ball (along `b`), `|q| =
//! |e w_b|`. The mean spin lies along `p` and is `p + u (u . R(0) q)`, `u = p / |p|`.
//!
//! Air slows the ball down: with the torque `-c I w` on every axis the motion is the same at the times
//! `tau(t) = (1 - exp(-c t)) / c` for `t`, as in [`DecayingSpin`](super::DecayingSpin).

use nalgebra::{Quaternion, SMatrix, SVector, Vector3};

use super::decayed_time;
use super::{ConstantSpin, LocalFrame, Motion, axis_and_rate, elapsed, rotation_vector};
use crate::geometry::{Rotation, Vec3, left_jacobian};
use crate::spin::Measurement;

/// A ball that precesses while its spin decays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PrecessingSpin {
    /// Orientation at the reference time, and the rotation that is fixed in space: along the angular
    /// momentum, camera frame, rad/s.
    pub space: ConstantSpin,
    /// The rotation that is fixed in the ball, pattern frame, rad/s: the spin turns about it, against
    /// its sense, as the ball sees it.
    pub body_rate: Vec3,
    /// Rate at which the spin decays, 1/s.
    pub decay_per_s: f64,
}

impl PrecessingSpin {
    /// The orientation at `time_s`, pattern to camera.
    pub fn at(&self, time_s: f64) -> Rotation {
        let tau = self.elapsed(time_s);
        self.space.at(self.space.time_s + tau) * Rotation::from_scaled_axis(self.body_rate * tau)
    }

    /// The constant spin about which it precesses, along the angular momentum.
    pub fn mean(&self) -> ConstantSpin {
        let (axis, rate) = axis_and_rate(&self.space.spin);
        let spin = axis * (rate + self.axis_in_body().dot(&self.body_rate));
        ConstantSpin { spin, ..self.space }
    }

    /// Speed at which the spin's axis drifts through the ball, rad/s: the part of the body's rate
    /// across the spin.
    pub fn drift_rad_s(&self) -> f64 {
        self.across().norm()
    }

    /// Angle between the spin and the axis of the precession, radians.
    pub fn tilt_rad(&self) -> f64 {
        let share = self.drift_rad_s() / self.body_rate.norm();
        share.clamp(0.0, 1.0).asin()
    }

    /// The same motion with another reference time.
    #[must_use]
    pub fn rebased(&self, time_s: f64) -> Self {
        let slowed = (-self.decay_per_s * (time_s - self.space.time_s)).exp();
        Self {
            space: ConstantSpin {
                time_s,
                orientation: self.at(time_s),
                spin: self.space.spin * slowed,
            },
            body_rate: self.body_rate * slowed,
            decay_per_s: self.decay_per_s,
        }
    }

    /// A constant spin, of which the share `body` (rad/s, about the spin's axis) is fixed in the ball.
    pub(in crate::spin) fn split(motion: ConstantSpin, body: f64) -> Self {
        let (axis, rate) = axis_and_rate(&motion.spin);
        Self {
            space: ConstantSpin {
                spin: axis * (rate - body),
                ..motion
            },
            body_rate: motion.orientation.inverse() * axis * body,
            decay_per_s: 0.0,
        }
    }

    /// The measurement of a ball that turns with the part fixed in space alone, and does not slow down.
    pub(in crate::spin) fn straightened(&self, m: &Measurement) -> Measurement {
        let tau = self.elapsed(m.time_s);
        Measurement {
            time_s: self.space.time_s + tau,
            orientation: m.orientation * Rotation::from_scaled_axis(self.body_rate * -tau),
            ..*m
        }
    }

    /// The spin's axis as the ball sees it at the reference time, pattern frame.
    pub(in crate::spin) fn axis_in_body(&self) -> Vec3 {
        self.space.orientation.inverse() * axis_and_rate(&self.space.spin).0
    }

    /// The part of the body's rate across the spin, pattern frame.
    pub(in crate::spin) fn across(&self) -> Vec3 {
        let axis = self.axis_in_body();
        self.body_rate - axis * axis.dot(&self.body_rate)
    }

    /// Time in which the ball would turn as far without a decay, from the reference time.
    fn elapsed(&self, time_s: f64) -> f64 {
        decayed_time(time_s - self.space.time_s, self.decay_per_s)
    }
}

impl Motion<7> for PrecessingSpin {
    fn predict(&self, time_s: f64) -> Rotation {
        self.at(time_s)
    }

    fn local_frame(&self) -> LocalFrame {
        LocalFrame::of(&self.space.spin)
    }

    fn jacobian(self) -> impl Fn(&Measurement) -> (Vec3, SMatrix<f64, 3, 7>) {
        let frame = self.local_frame();
        let to_local = frame.basis.transpose();
        let (start, decay, body) = (self.space.time_s, self.decay_per_s, self.body_rate);
        let (body_axis, body_rate) = axis_and_rate(&body);
        let orientation = self.space.orientation.to_rotation_matrix();
        let inverse = self.space.orientation.conjugate().into_inner();
        let body_to_local = to_local * orientation.matrix();
        let spin = to_local * self.space.spin + body_to_local * body;
        #[inline(always)]
        move |m| {
            let (tau, by_decay) = elapsed(m.time_s - start, decay);
            let turn = frame.turn(tau);
            let (sin, cos) = (0.5 * body_rate * tau).sin_cos();
            let body_back = Quaternion::from_parts(cos, body_axis * -sin);
            let measured = m.orientation.into_inner();
            let error = rotation_vector(&(turn.back * measured * body_back * inverse));
            let mut jacobian = SMatrix::<f64, 3, 7>::zeros();
            jacobian
                .fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&turn.by_spin());
            jacobian
                .fixed_view_mut::<3, 3>(0, 3)
                .copy_from(&(body_to_local * left_jacobian(&(body * tau)) * tau));
            jacobian.set_column(6, &(spin * by_decay));
            (to_local * error, jacobian)
        }
    }

    fn retract(&self, turn: &Vec3, rates: &SVector<f64, 7>) -> Self {
        let part = |at: usize| -> Vector3<f64> { rates.fixed_rows::<3>(at).into_owned() };
        Self {
            space: self.space.retract(turn, &part(0)),
            body_rate: self.body_rate + part(3),
            decay_per_s: self.decay_per_s + rates[6],
        }
    }

    /// A spin `w` seen in a frame that turns at `d` turns itself at `d x w`, as that of a ball in which `-d` is fixed: `p` is then `w + 2 d`.
    fn by_turning(&self) -> SMatrix<f64, 7, 3> {
        let mut rates = SMatrix::<f64, 7, 3>::zeros();
        let to_local = self.local_frame().basis.transpose();
        let to_body = self.space.orientation.inverse().to_rotation_matrix();
        rates
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(to_local * 2.0));
        rates
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&-to_body.matrix());
        rates
    }

    fn rates(&self) -> SVector<f64, 7> {
        let mut rates = SVector::<f64, 7>::zeros();
        rates.fixed_rows_mut::<3>(3).copy_from(&self.body_rate);
        rates[6] = self.decay_per_s;
        rates
    }
}
