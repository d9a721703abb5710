//! Quaternions in files and interfaces: scalar first, `[qw, qx, qy, qz]`, and `qw >= 0`, since a
//! quaternion and its negative are the same rotation. SciPy and ROS put the scalar last.

use nalgebra::Quaternion;

use super::Rotation;

/// Lengths off 1 by no more than this are rounding and left alone: normalizing would change bits.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// A rotation's unit quaternion, scalar first and not negative.
///
/// ```
/// use spindoe::geometry::{Rotation, Vec3, to_wxyz};
///
/// let half_turn = Rotation::from_scaled_axis(Vec3::z() * std::f64::consts::PI);
/// let [w, x, y, z] = to_wxyz(&half_turn);
/// assert!(w.abs() < 1e-15 && x == 0.0 && y == 0.0 && (z.abs() - 1.0).abs() < 1e-15);
/// ```
pub fn to_wxyz(rotation: &Rotation) -> [f64; 4] {
    let q = rotation.into_inner();
    let q = if q.w < 0.0 { -q } else { q };
    [q.w, q.i, q.j, q.k]
}

/// The rotation of a quaternion, scalar first and of either sign, whose length is within
/// `tolerance` of 1.
///
/// # Errors
/// The length, where it is not.
pub fn from_wxyz([w, x, y, z]: [f64; 4], tolerance: f64) -> Result<Rotation, f64> {
    let q = Quaternion::new(w, x, y, z);
    let length = q.norm();
    match (length - 1.0).abs() {
        off if off <= ROUNDING => Ok(Rotation::new_unchecked(q)),
        off if off <= tolerance => Ok(Rotation::new_normalize(q)),
        _ => Err(length),
    }
}
