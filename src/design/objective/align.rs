//! Alignment of a few dots with as many others: the rotation between them, and the remaining
//! distance.

use nalgebra::Matrix3;

use crate::geometry::Vec3;

/// Maximum number of Gauss-Newton steps; two or three settle most starts from a pair's rotation.
const STEPS: usize = 10;
/// A step shorter than this (radians) ends the iteration. Convergence is quadratic, so the
/// rotation's error is then of the order of the square, and the distance's of the fourth power.
const SETTLED: f64 = 1e-4;

/// The best rotation of some dots onto others.
#[derive(Debug, Clone, Copy)]
pub struct Alignment {
    /// Maps the other dots onto the observed ones.
    pub rotation: Matrix3<f64>,
    /// `sum_i |seen_i - R other_i|^2`.
    pub distance_squared: f64,
}

/// Least squares by Gauss-Newton from `start`: `argmin_R sum |seen_i - R other_i|^2`, with dots
/// given by index. The caller starts from a pair's rotation. `None` where the dots leave the
/// rotation open.
///
/// The information matrix is `R (sum I - p p^T) R^T`: its inverse is taken once, in the others'
/// frame.
pub fn align(
    dots: &[Vec3],
    seen: &[usize],
    other: &[usize],
    start: &Matrix3<f64>,
) -> Option<Alignment> {
    let count = seen.len() as f64;
    let moment: Matrix3<f64> = other.iter().map(|&c| dots[c] * dots[c].transpose()).sum();
    let inverse = (Matrix3::identity() * count - moment).try_inverse()?;
    let mut rotation = *start;
    for _ in 0..STEPS {
        let mut gradient = Vec3::zeros();
        for (&a, &c) in seen.iter().zip(other) {
            let q = rotation * dots[c];
            gradient += q.cross(&dots[a]);
        }
        let turn = rotation * (inverse * rotation.tr_mul(&gradient));
        rotation = cayley(&turn) * rotation;
        if turn.norm_squared() < SETTLED * SETTLED {
            break;
        }
    }
    let distance_squared = seen
        .iter()
        .zip(other)
        .map(|(&a, &c)| (dots[a] - rotation * dots[c]).norm_squared())
        .sum();
    Some(Alignment {
        rotation,
        distance_squared,
    })
}

/// The rotation about `w` by `2 atan(|w| / 2)`, which is `|w|` to third order: Gauss-Newton
/// converges as well with it as with the exponential, and it takes no trigonometry.
fn cayley(w: &Vec3) -> Matrix3<f64> {
    let h = 0.5 * w;
    let s = h.norm_squared();
    let k = h.cross_matrix();
    Matrix3::identity() + (k + k * k) * (2.0 / (1.0 + s))
}

/// Adds the derivative of `slope * distance_squared` with respect to all dots involved. The
/// rotation is at its optimum, so that its own change does not count (envelope theorem).
pub fn add_gradient(
    dots: &[Vec3],
    seen: &[usize],
    other: &[usize],
    rotation: &Matrix3<f64>,
    slope: f64,
    gradient: &mut [Vec3],
) {
    for (&a, &c) in seen.iter().zip(other) {
        let r = dots[a] - rotation * dots[c];
        gradient[a] += 2.0 * slope * r;
        gradient[c] -= 2.0 * slope * rotation.tr_mul(&r);
    }
}
