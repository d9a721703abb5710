//! A spin that decays about a fixed axis.
//!
//! The spin is `w exp(-c (t - t0))`. The ball has then turned as far as one of constant spin `w` would
//! in the time `tau(t) = (1 - exp(-c (t - t0))) / c`: on that clock the spin is constant.

use nalgebra::{SMatrix, SVector, Vector3};

use super::{ConstantSpin, LocalFrame, Motion, elapsed, rotation_vector};
use crate::geometry::{Rotation, Vec3};
use crate::spin::Measurement;

/// A ball whose spin decays, or grows, exponentially.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecayingSpin {
    /// The motion at the reference time.
    pub start: ConstantSpin,
    /// Rate of decay c, 1/s; negative for a spin that grows.
    pub decay_per_s: f64,
}

impl DecayingSpin {
    /// The orientation at `time_s`.
    pub fn at(&self, time_s: f64) -> Rotation {
        let (tau, _) = elapsed(time_s - self.start.time_s, self.decay_per_s);
        self.start.at(self.start.time_s + tau)
    }

    /// Magnitude of the spin at `time_s`, rad/s.
    pub fn rate_at(&self, time_s: f64) -> f64 {
        self.start.spin.norm() * (-self.decay_per_s * (time_s - self.start.time_s)).exp()
    }

    /// The same motion with another reference time.
    #[must_use]
    pub fn rebased(&self, time_s: f64) -> Self {
        let slowed = (-self.decay_per_s * (time_s - self.start.time_s)).exp();
        Self {
            start: ConstantSpin {
                time_s,
                orientation: self.at(time_s),
                spin: self.start.spin * slowed,
            },
            decay_per_s: self.decay_per_s,
        }
    }
}

impl Motion<4> for DecayingSpin {
    fn predict(&self, time_s: f64) -> Rotation {
        self.at(time_s)
    }

    fn local_frame(&self) -> LocalFrame {
        LocalFrame::of(&self.start.spin)
    }

    fn jacobian(self) -> impl Fn(&Measurement) -> (Vec3, SMatrix<f64, 3, 4>) {
        let frame = self.local_frame();
        let to_local = frame.basis.transpose();
        let (start, decay) = (self.start.time_s, self.decay_per_s);
        let inverse = self.start.orientation.conjugate().into_inner();
        #[inline(always)]
        move |m| {
            let (tau, by_decay) = elapsed(m.time_s - start, decay);
            let turn = frame.turn(tau);
            let error = rotation_vector(&(turn.back * m.orientation.into_inner() * inverse));
            let mut jacobian = SMatrix::<f64, 3, 4>::zeros();
            jacobian
                .fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&turn.by_spin());
            jacobian[(2, 3)] = frame.rate * by_decay;
            (to_local * error, jacobian)
        }
    }

    fn retract(&self, turn: &Vec3, rates: &SVector<f64, 4>) -> Self {
        let spin: Vector3<f64> = rates.fixed_rows::<3>(0).into_owned();
        Self {
            start: self.start.retract(turn, &spin),
            decay_per_s: self.decay_per_s + rates[3],
        }
    }

    fn rates(&self) -> SVector<f64, 4> {
        SVector::<f64, 4>::new(0.0, 0.0, 0.0, self.decay_per_s)
    }
}
