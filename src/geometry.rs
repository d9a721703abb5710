//! Directions, rotations and their estimation: the vocabulary of every later stage.
//!
//! Conventions: right-handed frames, radians, and orientations that map the pattern's frame to the
//! camera's, `p_camera = R * p_pattern`. The camera frame has x right, y up and z from the ball
//! towards the camera.
//!
//! The rotation between two sets of directions is Kabsch's: with `H = sum_i w_i b_i a_i^T`
//! (W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Cryst. A32,
//! 1976), `R = U diag(1, 1, det(U V^T)) V^T` minimizes `sum_i w_i |b_i - R a_i|^2` over proper
//! rotations. What it does not promise: an answer for sets that leave a rotation undetermined (one
//! direction, or several on one line, or a mirror image that fits two rotations equally well). Those
//! are errors.

mod quaternion;

pub use quaternion::{from_wxyz, to_wxyz};

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};

use crate::error::{Error, Result};

/// A direction or point in space.
pub type Vec3 = Vector3<f64>;
/// A proper rotation. nalgebra stores its coordinates as x, y, z, w; files order them w, x, y, z.
pub type Rotation = UnitQuaternion<f64>;

/// Sums and products of two unit vectors shorter than this have no direction.
const MIN_NORMAL: f64 = 1e-9;

/// Below this ratio of singular-value sums the rotation counts as undetermined.
const DEGENERATE_RATIO: f64 = 1e-9;

/// A direction in spherical coordinates, radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spherical {
    /// Polar angle from +z, in [0, pi].
    pub theta: f64,
    /// Azimuth from +x towards +y.
    pub phi: f64,
}

/// Partial derivatives of a unit vector with respect to its spherical coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphericalJacobian {
    /// d(unit vector)/d(theta), a unit vector.
    pub d_theta: Vec3,
    /// d(unit vector)/d(phi), of length sin(theta): it vanishes at the poles.
    pub d_phi: Vec3,
}

impl Spherical {
    /// The coordinates of a direction (its length does not matter, but must not be zero).
    pub fn from_direction(v: &Vec3) -> Self {
        Self {
            theta: v.xy().norm().atan2(v.z),
            phi: v.y.atan2(v.x),
        }
    }

    /// The unit vector.
    pub fn to_unit(self) -> Vec3 {
        let (st, ct) = self.theta.sin_cos();
        let (sp, cp) = self.phi.sin_cos();
        Vec3::new(st * cp, st * sp, ct)
    }

    /// Derivatives of [`Spherical::to_unit`].
    pub fn jacobian(self) -> SphericalJacobian {
        let (st, ct) = self.theta.sin_cos();
        let (sp, cp) = self.phi.sin_cos();
        SphericalJacobian {
            d_theta: Vec3::new(ct * cp, ct * sp, -st),
            d_phi: Vec3::new(-st * sp, st * cp, 0.0),
        }
    }
}

/// Angle between two unit vectors, accurate for small and for nearly straight angles.
pub fn angle_between(a: &Vec3, b: &Vec3) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

/// Angle of the rotation that takes one orientation to the other, in [0, pi].
pub fn rotation_angle(a: &Rotation, b: &Rotation) -> f64 {
    a.angle_to(b)
}

/// A rotation uniform on SO(3) (K. Shoemake, "Uniform random rotations", Graphics Gems III, 1992).
pub fn random_rotation<R: Rng + ?Sized>(rng: &mut R) -> Rotation {
    use std::f64::consts::TAU;
    let u: f64 = rng.random();
    let (s1, c1) = (TAU * rng.random::<f64>()).sin_cos();
    let (s2, c2) = (TAU * rng.random::<f64>()).sin_cos();
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    Rotation::from_quaternion(Quaternion::new(b * c2, a * s1, a * c1, b * s2))
}

/// A direction uniform on the part of the unit sphere with `z >= z_min` (Archimedes: z is uniform).
pub fn random_direction_above<R: Rng + ?Sized>(rng: &mut R, z_min: f64) -> Vec3 {
    let z = z_min + (1.0 - z_min) * rng.random::<f64>();
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (s, c) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
    Vec3::new(r * c, r * s, z)
}

/// A direction uniform on the unit sphere.
pub fn random_direction<R: Rng + ?Sized>(rng: &mut R) -> Vec3 {
    random_direction_above(rng, -1.0)
}

/// `n` nearly evenly spread directions (the golden-angle spiral), for quadrature over viewpoints.
pub fn spiral_directions(n: usize) -> impl ExactSizeIterator<Item = Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..n).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
        let r = (1.0 - z * z).max(0.0).sqrt();
        let (s, c) = (golden * i as f64).sin_cos();
        Vec3::new(r * c, r * s, z)
    })
}

/// The proper rotation `R` that minimizes `sum_i w_i |to_i - R from_i|^2` (Kabsch).
///
/// `weights` are non-negative; `None` weighs all alike.
///
/// # Errors
/// [`Error::Argument`] where lengths differ or a weight is negative or not finite;
/// [`Error::Degenerate`] where the sets leave the rotation undetermined.
pub fn kabsch(from: &[Vec3], to: &[Vec3], weights: Option<&[f64]>) -> Result<Rotation> {
    if from.len() != to.len() || weights.is_some_and(|w| w.len() != from.len()) {
        return Err(Error::argument(
            "kabsch",
            "the point sets and weights must be of one length",
        ));
    }
    if weights.is_some_and(|w| w.iter().any(|w| !w.is_finite() || *w < 0.0)) {
        return Err(Error::argument(
            "kabsch",
            "weights must be finite and not negative",
        ));
    }
    let mut h = Matrix3::zeros();
    for i in 0..from.len() {
        h += to[i] * from[i].transpose() * weights.map_or(1.0, |w| w[i]);
    }
    rotation_from_correlation(&h)
}

/// The proper rotation that maximizes `trace(R^T H)` for the correlation `H = sum w to from^T`.
///
/// # Errors
/// [`Error::Degenerate`] where several rotations do so.
pub fn rotation_from_correlation(h: &Matrix3<f64>) -> Result<Rotation> {
    if h.iter().any(|x| !x.is_finite()) {
        return Err(Error::Degenerate("a coordinate is not finite".into()));
    }
    let svd = h.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err(Error::Internal("singular vectors are missing".into()));
    };
    let s = svd.singular_values;
    let sign = if (u * v_t).determinant() < 0.0 {
        -1.0
    } else {
        1.0
    };
    // The maximizer is unique exactly when the two smallest (signed) singular values do not cancel.
    if s[0] <= 0.0 || s[1] + sign * s[2] <= DEGENERATE_RATIO * s[0] {
        return Err(Error::Degenerate(
            "the points lie on one line, or fit several rotations equally well".into(),
        ));
    }
    let r = u * Matrix3::from_diagonal(&Vec3::new(1.0, 1.0, sign)) * v_t;
    Ok(Rotation::from_rotation_matrix(
        &nalgebra::Rotation3::from_matrix_unchecked(r),
    ))
}

/// The rotation matrix that lays one pair of unit vectors on another, midpoint on midpoint, so that a
/// difference of their angles is shared evenly; `None` for pairs that are parallel or opposite.
pub fn pair_rotation(from: [&Vec3; 2], to: [&Vec3; 2]) -> Option<Matrix3<f64>> {
    let frame = |[a, b]: [&Vec3; 2]| -> Option<Matrix3<f64>> {
        let mid = (a + b).try_normalize(MIN_NORMAL)?;
        let normal = a.cross(b).try_normalize(MIN_NORMAL)?;
        Some(Matrix3::from_columns(&[mid, normal, mid.cross(&normal)]))
    };
    Some(frame(to)? * frame(from)?.transpose())
}

/// Two unit vectors that complete `axis` (a unit vector) to an orthonormal frame.
pub fn tangent_frame(axis: &Vec3) -> [Vec3; 2] {
    let helper = if axis.x.abs() < 0.6 {
        Vec3::x()
    } else {
        Vec3::y()
    };
    let e1 = axis.cross(&helper).normalize();
    [e1, axis.cross(&e1)]
}
