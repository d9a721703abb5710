//! Laying a few dots on as many others: the rotation between them, and how far apart they stay.

use nalgebra::Matrix3;

use crate::geometry::Vec3;

/// Most Gauss-Newton steps; two or three settle most starts from a pair's rotation.
const STEPS: usize = 10;
/// A step shorter than this (radians) ends the iteration: convergence being quadratic, the rotation then
/// is right to its square, and the distance to the fourth power.
const SETTLED: f64 = 1e-4;

/// The best rotation of some dots onto others.
#[derive(Debug, Clone, Copy)]
pub struct Alignment {
    /// Maps the other dots onto the seen.
    pub rotation: Matrix3<f64>,
    /// `sum_i |seen_i - R other_i|^2`.
    pub distance_squared: f64,
}

/// The rotation that lays one pair of unit vectors on another, midpoint on midpoint; `None` for pairs
/// that are parallel or opposite.
pub fn pair_rotation(from: [&Vec3; 2], to: [&Vec3; 2]) -> Option<Matrix3<f64>> {
    let frame = |[a, b]: [&Vec3; 2]| -> Option<Matrix3<f64>> {
        let mid = (a + b).try_normalize(1e-9)?;
        let normal = a.cross(b).try_normalize(1e-9)?;
        Some(Matrix3::from_columns(&[mid, normal, mid.cross(&normal)]))
    };
    Some(frame(to)? * frame(from)?.transpose())
}

/// Least squares by Gauss-Newton from `start`: `argmin_R sum |seen_i - R other_i|^2`, with dots given by
/// index. Close to the start's valley only; the caller starts from a pair's rotation.
pub fn align(dots: &[Vec3], seen: &[usize], other: &[usize], start: &Matrix3<f64>) -> Alignment {
    let mut rotation = *start;
    for _ in 0..STEPS {
        let mut information = Matrix3::zeros();
        let mut gradient = Vec3::zeros();
        for (&a, &c) in seen.iter().zip(other) {
            let q = rotation * dots[c];
            information += Matrix3::identity() - q * q.transpose();
            gradient += q.cross(&dots[a]);
        }
        let Some(inverse) = information.try_inverse() else {
            break;
        };
        let step = inverse * gradient;
        rotation = cayley(&step) * rotation;
        if step.norm_squared() < SETTLED * SETTLED {
            break;
        }
    }
    let distance_squared = seen
        .iter()
        .zip(other)
        .map(|(&a, &c)| (dots[a] - rotation * dots[c]).norm_squared())
        .sum();
    Alignment {
        rotation,
        distance_squared,
    }
}

/// The rotation about `w` by `2 atan(|w| / 2)`, which is `|w|` to third order: Gauss-Newton converges as
/// well with it as with the exponential, and it takes no trigonometry.
fn cayley(w: &Vec3) -> Matrix3<f64> {
    let h = 0.5 * w;
    let s = h.norm_squared();
    let k = h.cross_matrix();
    Matrix3::identity() + (k + k * k) * (2.0 / (1.0 + s))
}

/// Adds the derivative of `slope * distance_squared` with respect to all dots involved. The rotation is
/// at its optimum, so that its own change does not count (envelope theorem).
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
