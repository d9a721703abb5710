//! A ball that turns at a constant rate.

use nalgebra::{Matrix3, Vector3};

use super::{LocalFrame, Motion, rotation_vector};
use crate::geometry::{Rotation, Vec3};
use crate::spin::Measurement;

/// A ball that turns at a constant rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantSpin {
    /// The reference time, seconds.
    pub time_s: f64,
    /// Orientation at the reference time, pattern to camera.
    pub orientation: Rotation,
    /// Spin vector, camera frame, rad/s.
    pub spin: Vec3,
}

impl ConstantSpin {
    /// The orientation at `time_s`.
    pub fn at(&self, time_s: f64) -> Rotation {
        Rotation::from_scaled_axis(self.spin * (time_s - self.time_s)) * self.orientation
    }

    /// Revolutions per second.
    pub fn rps(&self) -> f64 {
        self.spin.norm() / std::f64::consts::TAU
    }

    /// The same motion with another reference time.
    #[must_use]
    pub fn rebased(&self, time_s: f64) -> Self {
        Self {
            time_s,
            orientation: self.at(time_s),
            spin: self.spin,
        }
    }
}

impl Motion<3> for ConstantSpin {
    fn predict(&self, time_s: f64) -> Rotation {
        self.at(time_s)
    }

    fn local_frame(&self) -> LocalFrame {
        LocalFrame::of(&self.spin)
    }

    fn jacobian(self) -> impl Fn(&Measurement) -> (Vec3, Matrix3<f64>) {
        let frame = self.local_frame();
        let to_local = frame.basis.transpose();
        let (start, inverse) = (self.time_s, self.orientation.conjugate().into_inner());
        #[inline(always)]
        move |m| {
            let turn = frame.turn(m.time_s - start);
            let error = rotation_vector(&(turn.back * m.orientation.into_inner() * inverse));
            (to_local * error, turn.by_spin())
        }
    }

    fn retract(&self, turn: &Vec3, rates: &Vector3<f64>) -> Self {
        let frame = LocalFrame::of(&self.spin);
        Self {
            time_s: self.time_s,
            orientation: frame.turned(turn, &self.orientation),
            spin: self.spin + frame.basis * rates,
        }
    }
}
