//! The weight of a false pose in the integral over all rotations.

use nalgebra::Matrix3;

use super::rivals::{Rival, Rivals};
use super::{Kernel, WINDOW_RAD};
use crate::geometry::Vec3;

/// Added to the sum over all pairs: pairs that hardly coincide themselves fade.
const FADE: f64 = 0.05;

/// The weight of a rival in the integral over all rotations, and its derivatives.
pub(super) struct Weight {
    pub value: f64,
    /// Its logarithm's derivative by each pair weight `w_i`: `1 / w - dN / N` of the two of the
    /// pair, `-dN / N` of all others; here the matrix `M` with `dN/dw_i = p_i M p_i`.
    pub invariant: Matrix3<f64>,
    pub second: f64,
    pub window: f64,
    pub window_slope: f64,
}

impl Weight {
    pub fn new(dots: &[Vec3], found: &Rivals, rival: &Rival, kernel: &Kernel) -> Self {
        let mut moment = Matrix3::zeros();
        let mut own = [0.0; 2];
        for m in found.matches_of(rival) {
            let (w, _) = kernel.pair_weight(squared(dots, rival, m.seen, m.other));
            if w > 0.0 {
                let p = dots[usize::from(m.seen)];
                moment += p * p.transpose() * w;
                for (own, (seen, other)) in own.iter_mut().zip(rival.pair.iter().zip(&rival.onto)) {
                    if (*seen, *other) == (usize::from(m.seen), usize::from(m.other)) {
                        *own = w;
                    }
                }
            }
        }
        let trace = moment.trace();
        // sum over pairs of w_i w_k sin^2(angle) = ((tr T)^2 - |T|^2) / 2, T = sum w p p^T.
        let second = 0.5 * (trace * trace - moment.norm_squared());
        let (window, window_slope) = window(rival.rotation.trace());
        let [i, k] = rival.pair.map(|i| dots[i]);
        let sine = i.cross(&k).norm();
        // The integral of the pair's own weight: (4 pi sigma^2)^(3/2) / (sqrt(2) sine), over that of
        // a pose.
        let value = if own[0] * own[1] > 0.0 && second > 0.0 {
            own[0] * own[1] * sine * window / (4.0 * (second + FADE))
        } else {
            0.0
        };
        Self {
            value,
            invariant: Matrix3::identity() * trace - moment,
            second: second + FADE,
            window,
            window_slope,
        }
    }
}

/// The squared distance of a dot from the one that a rival brings there.
pub(super) fn squared(dots: &[Vec3], rival: &Rival, seen: u16, other: u16) -> f64 {
    let at = rival.rotation * dots[usize::from(other)];
    (dots[usize::from(seen)] - at).norm_squared()
}

/// 0 for rotations that are the true pose, 1 for false ones; by the trace, with its slope.
fn window(trace: f64) -> (f64, f64) {
    let [near, far] = WINDOW_RAD.map(|angle| 1.0 + 2.0 * angle.cos());
    let t = ((near - trace) / (near - far)).clamp(0.0, 1.0);
    (t * t * (3.0 - 2.0 * t), -6.0 * t * (1.0 - t) / (near - far))
}
