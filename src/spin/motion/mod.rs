//! How a ball may turn: the motions that one mixture fit (`spin::mixture`) fits.
//!
//! A motion is an orientation `R0` at a reference time and `P` rates, the first three of them a spin
//! that is fixed in space:
//!
//! | motion | orientation at `t` after the reference time | rates |
//! |---|---|---|
//! | [`ConstantSpin`] | `exp([w]x t) R0` | `w` |
//! | [`DecayingSpin`] | `exp([w]x tau) R0`, `tau = (1 - exp(-c t)) / c` | `w, c` |
//! | [`PrecessingSpin`] | `exp([p]x tau) R0 exp([q]x tau)` | `p, q, c` |
//!
//! # Errors at the reference time
//! A measurement `M` at `t` is carried back by the motion: `B = exp(-[p]x tau) M exp(-[q]x tau)` is the
//! orientation that the ball had at the reference time, were the measurement exact. Its error is `e =
//! log(B R0^-1)`. The noise is isotropic, so that turning it changes nothing, and the derivatives are
//! simple. A change `R0 -> exp([a]x) R0` takes `a` from all errors alike; the change `d` of a rate
//! takes `J d` from them, to first order in `e`, with
//!
//! ```text
//! of p: tau Jl(-p tau)      of q: R0 tau Jl(q tau)      of c: (p + R0 q) dtau/dc
//! ```
//!
//! and `Jl` the left Jacobian of SO(3) (J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state
//! estimation in robotics", arXiv 1812.01537, eq. 143-145). The orientation is thus to the rates what
//! the intercept is to the slopes of a regression.
//!
//! Errors and spins are written in the frame of the spin, its axis last. There the derivative
//! by `p` falls apart: along the axis it is `tau`; across it, with vectors as complex numbers and
//! `theta = |p| tau`, it is `conj(g)`, `g = tau (exp(i theta) - 1) / (i theta)`. In a long sequence the
//! spin along the axis is known a million times better than across it, and sums over both never mix.

mod constant;
mod decaying;
mod precessing;

pub use constant::ConstantSpin;
pub use decaying::DecayingSpin;
pub use precessing::PrecessingSpin;

use nalgebra::{Complex, Matrix3, Quaternion, SMatrix, SVector};

use super::Measurement;
use crate::geometry::{Rotation, Vec3, tangent_frame};

/// Below this angle (radians) series replace quotients: the next term is below 1e-18.
const SMALL_ANGLE: f64 = 1e-4;
/// A spin below this, rad/s, has no axis.
const STILL: f64 = 1e-9;

/// A motion with `P` rates; see the module's head.
pub(super) trait Motion<const P: usize>: Copy {
    /// The orientation at `time_s`, pattern to camera.
    fn predict(&self, time_s: f64) -> Rotation;

    /// The frame that errors and spins are written in.
    fn local_frame(&self) -> LocalFrame;

    /// The error of a measurement, carried back to the reference time, and its derivative by the rates
    /// with the sign changed.
    ///
    /// What all measurements share is computed before the function is returned.
    fn jacobian(self) -> impl Fn(&Measurement) -> (Vec3, SMatrix<f64, 3, P>);

    /// The motion after a turn of its orientation and a change of its rates.
    #[must_use]
    fn retract(&self, turn: &Vec3, rates: &SVector<f64, P>) -> Self;

    /// Derivative of the rates by the rate at which the frame of the orientations turns, camera frame: a steady ball seen in it turns
    /// by as much more.
    fn by_turning(&self) -> SMatrix<f64, P, 3> {
        let mut rates = SMatrix::<f64, P, 3>::zeros();
        let to_local = self.local_frame().basis.transpose();
        rates.fixed_view_mut::<3, 3>(0, 0).copy_from(&to_local);
        rates
    }

    /// Derivative of the rates by a turn of that frame, and by the rate at which it turns: what is fixed in space turns with it, what is
    /// fixed in the ball does not.
    fn by_frame(&self) -> SMatrix<f64, P, 6> {
        let LocalFrame { basis, rate } = self.local_frame();
        let spin: Vec3 = basis.column(2) * rate;
        let mut rates = SMatrix::<f64, P, 6>::zeros();
        rates
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(basis.transpose() * -spin.cross_matrix()));
        rates
            .fixed_columns_mut::<3>(3)
            .copy_from(&self.by_turning());
        rates
    }

    /// The rates that may have a prior; 0 for all others.
    fn rates(&self) -> SVector<f64, P> {
        SVector::zeros()
    }
}

/// The right-handed frame of a spin: two directions across it, and its axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalFrame {
    /// Local to camera.
    pub basis: Matrix3<f64>,
    /// The spin's magnitude, rad/s.
    pub rate: f64,
}

impl LocalFrame {
    /// The frame of `spin`; that of x where it vanishes.
    pub fn of(spin: &Vec3) -> Self {
        let (axis, rate) = axis_and_rate(spin);
        let [e1, e2] = tangent_frame(&axis);
        Self {
            basis: Matrix3::from_columns(&[e1, e2, axis]),
            rate,
        }
    }

    /// A turn (rotation vector in this frame) of an orientation.
    fn turned(&self, turn: &Vec3, orientation: &Rotation) -> Rotation {
        let turned = Rotation::from_scaled_axis(self.basis * turn) * orientation;
        Rotation::new_normalize(turned.into_inner())
    }

    /// What `time_s` at this spin turns.
    fn turn(&self, time_s: f64) -> AxisTurn {
        let theta = self.rate * time_s;
        let (sin, cos) = (0.5 * theta).sin_cos();
        let lever = if theta.abs() < SMALL_ANGLE {
            Complex::new(1.0 - theta * theta / 6.0, 0.5 * theta) * time_s
        } else {
            // sin theta and 1 - cos theta by the half angle: without cancellation.
            Complex::new(2.0 * sin * cos, 2.0 * sin * sin) * (time_s / theta)
        };
        let axis = self.basis.column(2);
        AxisTurn {
            back: Quaternion::new(cos, -sin * axis.x, -sin * axis.y, -sin * axis.z),
            lever,
            time_s,
        }
    }
}

/// A turn about the axis of a [`LocalFrame`].
struct AxisTurn {
    /// The turn undone.
    back: Quaternion<f64>,
    /// `g` of the module's head.
    lever: Complex<f64>,
    time_s: f64,
}

impl AxisTurn {
    /// Derivative by the spin, local frame.
    fn by_spin(&self) -> Matrix3<f64> {
        let g = self.lever;
        Matrix3::new(g.re, g.im, 0.0, -g.im, g.re, 0.0, 0.0, 0.0, self.time_s)
    }
}

/// The rotation vector of a unit quaternion, the shorter of the two.
fn rotation_vector(q: &Quaternion<f64>) -> Vec3 {
    let v = q.imag();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let n2 = v.norm_squared();
    // 2 asin(n) / n by its series where that is exact to 1e-11 (up to 16 deg), else without shortcuts.
    if n2 < 0.02 {
        let high = 5.0 / 56.0 + n2 * (35.0 / 576.0 + n2 * (63.0 / 1408.0));
        return v * (sign * (2.0 + n2 * (1.0 / 3.0 + n2 * (3.0 / 20.0 + n2 * high))));
    }
    let n = n2.sqrt();
    v * (sign * 2.0 * n.atan2(q.w.abs()) / n)
}

/// Axis and rate of a spin; x where it vanishes.
pub(super) fn axis_and_rate(spin: &Vec3) -> (Vec3, f64) {
    let rate = spin.norm();
    if rate < STILL {
        (Vec3::x(), 0.0)
    } else {
        (spin / rate, rate)
    }
}

/// Time in which a constant spin would turn as far as one with the decay `c` (1/s) in `t`, and its
/// derivative with respect to the decay.
fn elapsed(t: f64, c: f64) -> (f64, f64) {
    let tau = decayed_time(t, c);
    let x = c * t;
    let derivative = if x.abs() < 1e-3 {
        // (t exp(-x) - tau) / c by its series: the next term is below 1e-13.
        t * t * (-0.5 + x * (1.0 / 3.0 + x * (-1.0 / 8.0 + x / 30.0)))
    } else {
        (t * (-x).exp() - tau) / c
    };
    (tau, derivative)
}

/// Time in which a ball without decay would turn as far as one with it does in `time_s`:
/// `(1 - exp(-c t)) / c`.
pub fn decayed_time(time_s: f64, decay_per_s: f64) -> f64 {
    let x = decay_per_s * time_s;
    if x.abs() < 1e-12 {
        time_s
    } else {
        -(-x).exp_m1() / decay_per_s
    }
}
