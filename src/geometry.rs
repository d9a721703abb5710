//! Directions, rotations and their estimation: the vocabulary of every later stage.
//!
//! Conventions: right-handed frames, radians, and orientations that map the pattern's frame to the
//! camera's, `p_camera = R * p_pattern`. The camera frame has x right, y up and z from the ball
//! towards the camera.
//!
//! The rotation between two sets of directions is Wahba's problem: maximize
//! `trace(R^T H)`, `H = sum_i w_i b_i a_i^T`, which minimizes `sum_i w_i |b_i - R a_i|^2` over
//! proper rotations (W. Kabsch, "A solution for the best rotation to relate two sets of vectors",
//! Acta Cryst. A32, 1976). Horn's method finds it: the unit quaternion of `R` is the leading
//! eigenvector of a symmetric 4 x 4 matrix made of `H` (B. K. P. Horn, "Closed-form solution of
//! absolute orientation using unit quaternions", J. Opt. Soc. Am. A 4, 1987, Sec. 4). Its error is
//! that of rounding over the gap below the leading eigenvalue, and that gap falls with the square
//! of the directions' separation. [`kabsch`] therefore fits the angle about the weakest axis anew
//! from the directions themselves, where the error is that of rounding over the separation.
//!
//! Guaranteed: a proper rotation, and for exact directions `d` radians apart an error of some
//! `1e-16 / d`. Not guaranteed: an answer for sets that leave the rotation undetermined (one
//! direction, several on one line or within a nanoradian, a mirror image that fits two rotations
//! equally well). Those are errors.

mod camera_frame;
mod position;
mod quaternion;

pub use camera_frame::CameraFrame;
pub use position::Position;
pub use quaternion::{from_wxyz, to_wxyz};

use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};

use crate::error::{Error, Result, require};

/// A direction or point in space.
pub type Vec3 = Vector3<f64>;
/// A proper rotation. nalgebra stores its coordinates as x, y, z, w; files order them w, x, y, z.
pub type Rotation = UnitQuaternion<f64>;

/// Sums and products of two unit vectors shorter than this have no direction.
const MIN_NORMAL: f64 = 1e-9;

/// Below this share of the leading eigenvalue the gap under it counts as none: the rotation is
/// undetermined.
const MIN_GAP: f64 = 1e-9;

/// From this ratio of singular values on the fast decomposition is exact to 1e-11 rad.
const WELL_CONDITIONED: f64 = 1e-2;

/// From this gap on Horn's quaternion needs no correction: its error is below 1e-11 rad.
const WIDE_GAP: f64 = 1e-4;

/// Directions whose root mean square distance from one line (radians) is less than this leave the
/// angle about it undetermined: rounding alone would turn it by 1e-7 rad and more.
const MIN_SPREAD: f64 = 1e-9;

/// Fits of the angle about the weakest axis. The first may turn far, the second corrects its error.
const TWISTS: usize = 2;

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

/// The volume of SO(3) in rotation vectors near the identity.
pub(crate) const ROTATIONS: f64 = 8.0 * std::f64::consts::PI * std::f64::consts::PI;

/// A step from `center` towards the weighted mean of rotations near it, each with its weight: it leaves about the square of the angle.
pub(crate) fn toward_mean(
    center: &Rotation,
    weighted: impl Iterator<Item = (Rotation, f64)>,
) -> Rotation {
    let (mut sum, mut total) = (Vec3::zeros(), 0.0);
    for (rotation, weight) in weighted {
        sum += (rotation * center.inverse()).scaled_axis() * weight;
        total += weight;
    }
    Rotation::from_scaled_axis(sum / total) * center
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

/// The `k`-th of `count` nearly evenly spread rotations (M. Alexa, "Super-Fibonacci Spirals", CVPR 2022).
pub fn spread_rotation(k: usize, count: usize) -> Rotation {
    // The real root of psi^4 = psi + 4, and the square root of two.
    const PSI: f64 = 1.533_751_168_755_204_3;
    let s = k as f64 + 0.5;
    let t = s / count as f64;
    let turn = std::f64::consts::TAU * s;
    let (alpha, beta) = (turn / std::f64::consts::SQRT_2, turn / PSI);
    let (r, q) = (t.sqrt(), (1.0 - t).sqrt());
    let (sin_a, cos_a) = alpha.sin_cos();
    let (sin_b, cos_b) = beta.sin_cos();
    Rotation::new_normalize(nalgebra::Quaternion::new(
        q * cos_b,
        r * sin_a,
        r * cos_a,
        q * sin_b,
    ))
}

/// The proper rotation `R` that minimizes `sum_i w_i |to_i - R from_i|^2` (Kabsch).
///
/// `weights` are non-negative; `None` weighs all alike.
///
/// # Errors
/// [`Error::Argument`] where lengths differ or a weight is negative or not finite;
/// [`Error::Degenerate`] where the sets leave the rotation undetermined: see the module's head.
pub fn kabsch(from: &[Vec3], to: &[Vec3], weights: Option<&[f64]>) -> Result<Rotation> {
    let n = from.len();
    require(to.len() == n, "to", &format!("{n} directions"), to.len())?;
    if let Some(weights) = weights {
        let found = weights.len();
        require(found == n, "weights", &format!("{n} weights"), found)?;
        for w in weights {
            let inside = w.is_finite() && *w >= 0.0;
            require(inside, "weights", "finite weights of 0 or more", w)?;
        }
    }
    let matches = Matches { from, to, weights };
    let h = matches.correlation();
    if let Some(rotation) = well_conditioned(&h) {
        return Ok(rotation);
    }
    let horn = Horn::new(&h)?;
    if horn.gap >= WIDE_GAP {
        return Ok(horn.rotation);
    }
    let mut rotation = horn.rotation;
    for _ in 0..TWISTS {
        rotation = matches.twisted(&rotation)?;
    }
    Ok(rotation)
}

/// The proper rotation that maximizes `trace(R^T H)` for the correlation `H = sum w to from^T`.
///
/// # Errors
/// [`Error::Degenerate`] where several rotations do so.
pub fn rotation_from_correlation(h: &Matrix3<f64>) -> Result<Rotation> {
    if let Some(rotation) = well_conditioned(h) {
        return Ok(rotation);
    }
    let horn = Horn::new(h)?;
    if horn.gap > MIN_GAP {
        Ok(horn.rotation)
    } else {
        Err(undetermined())
    }
}

fn undetermined() -> Error {
    Error::Degenerate("the points lie on one line, or fit several rotations equally well".into())
}

/// Kabsch's own solution, `R = U diag(1, 1, det(U V^T)) V^T` of `H = U S V^T`; `None` where Horn's
/// is more accurate. It takes a fifth of the time, but nalgebra's decomposition of a 3 x 3 matrix
/// goes by `H^T H`, so that its error grows with the square of the condition.
fn well_conditioned(h: &Matrix3<f64>) -> Option<Rotation> {
    let scale = h.amax();
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    // A power of two, so that nothing is rounded, and the squares neither over- nor underflow.
    let svd = (h / scale.log2().floor().exp2()).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let s = svd.singular_values;
    let sign = (u * v_t).determinant().signum();
    // Half of the gap between Horn's two largest eigenvalues.
    if s[1] + sign * s[2] < WELL_CONDITIONED * s[0] {
        return None;
    }
    let r = u * Matrix3::from_diagonal(&Vec3::new(1.0, 1.0, sign)) * v_t;
    Some(to_rotation(&r))
}

/// Horn's solution.
struct Horn {
    rotation: Rotation,
    /// Gap between the two largest eigenvalues as a share of the largest magnitude, in [0, 2].
    gap: f64,
}

impl Horn {
    fn new(h: &Matrix3<f64>) -> Result<Self> {
        // The matrix's scale does not matter; without it, neither huge nor tiny weights do.
        let scale = h.amax();
        if !scale.is_finite() {
            return Err(Error::Degenerate("a coordinate is not finite".into()));
        }
        if scale == 0.0 {
            return Err(undetermined());
        }
        let h = h / scale;
        // trace(R^T H) = q^T K q, with q ordered x, y, z, w.
        let asymmetry = Vec3::new(
            h[(2, 1)] - h[(1, 2)],
            h[(0, 2)] - h[(2, 0)],
            h[(1, 0)] - h[(0, 1)],
        );
        let trace = h.trace();
        let mut k = Matrix4::zeros();
        k.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(h + h.transpose() - Matrix3::from_diagonal_element(trace)));
        k.fixed_view_mut::<3, 1>(0, 3).copy_from(&asymmetry);
        k.fixed_view_mut::<1, 3>(3, 0)
            .copy_from(&asymmetry.transpose());
        k[(3, 3)] = trace;
        let eigen = k.symmetric_eigen();
        let values = eigen.eigenvalues;
        let leading = values.imax();
        let second = (0..4)
            .filter(|i| *i != leading)
            .map(|i| values[i])
            .fold(f64::NEG_INFINITY, f64::max);
        let q = Quaternion::from_vector(eigen.eigenvectors.column(leading).into_owned());
        Ok(Self {
            rotation: Rotation::from_quaternion(q),
            gap: (values[leading] - second) / values.amax(),
        })
    }
}

/// Directions that a rotation is to lay on others.
struct Matches<'a> {
    from: &'a [Vec3],
    to: &'a [Vec3],
    weights: Option<&'a [f64]>,
}

impl Matches<'_> {
    fn iter(&self) -> impl Iterator<Item = (&Vec3, &Vec3, f64)> {
        let pairs = self.from.iter().zip(self.to).enumerate();
        pairs.map(|(i, (a, b))| (a, b, self.weights.map_or(1.0, |w| w[i])))
    }

    fn correlation(&self) -> Matrix3<f64> {
        self.iter().map(|(a, b, w)| b * a.transpose() * w).sum()
    }

    /// `rotation`, turned to the best angle about the axis about which the directions determine it
    /// worst.
    ///
    /// With `c_i = R a_i` the objective falls with a small turn `x` by `x^T M x / 2`, `M = sum_i
    /// w_i (c_i.b_i I - (c_i b_i^T + b_i c_i^T) / 2)`: the axis `u` is the eigenvector of its
    /// smallest eigenvalue. About `u` the best angle is that of the sums of `u.(c_i x b_i)` and
    /// `(c_i x u).(b_i x u)`, whose terms are as small as the directions are close, without
    /// cancellation.
    fn twisted(&self, rotation: &Rotation) -> Result<Rotation> {
        let mut curvature = Matrix3::zeros();
        for (a, b, w) in self.iter() {
            let outer = rotation * a * b.transpose();
            let symmetric = 0.5 * (outer + outer.transpose());
            curvature += (Matrix3::from_diagonal_element(outer.trace()) - symmetric) * w;
        }
        let eigen = curvature.symmetric_eigen();
        let axis: Vec3 = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imin())
            .normalize();
        let (mut cosine, mut sine) = (0.0, 0.0);
        let (mut from_spread, mut to_spread, mut total) = (0.0, 0.0, 0.0);
        for (a, b, w) in self.iter() {
            let moved = rotation * a;
            let (c, d) = (moved.cross(&axis), b.cross(&axis));
            cosine += w * c.dot(&d);
            sine += w * axis.dot(&c.cross(&d));
            from_spread += w * c.norm_squared();
            to_spread += w * d.norm_squared();
            total += w * moved.norm() * b.norm();
        }
        let spread = (from_spread * to_spread).sqrt();
        let determined =
            spread > MIN_SPREAD * MIN_SPREAD * total && sine.hypot(cosine) > MIN_GAP * spread;
        if !determined {
            return Err(undetermined());
        }
        let twist = Rotation::from_scaled_axis(axis * sine.atan2(cosine));
        Ok(Rotation::new_normalize((twist * rotation).into_inner()))
    }
}

/// The rotation of a matrix that is one.
pub(crate) fn to_rotation(matrix: &Matrix3<f64>) -> Rotation {
    Rotation::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(*matrix))
}

/// The rotation matrix that lays one pair of unit vectors on another, midpoint on midpoint, so that
/// a difference of their angles is shared evenly; `None` for pairs that are parallel or opposite. Where the pairs are alike but for
/// their size, vectors of any length will do.
pub fn pair_rotation(from: [&Vec3; 2], to: [&Vec3; 2]) -> Option<Matrix3<f64>> {
    let frame = |[a, b]: [&Vec3; 2]| -> Option<Matrix3<f64>> {
        let mid = (a + b).try_normalize(MIN_NORMAL)?;
        let normal = a.cross(b).try_normalize(MIN_NORMAL)?;
        Some(Matrix3::from_columns(&[mid, normal, mid.cross(&normal)]))
    };
    Some(frame(to)? * frame(from)?.transpose())
}

/// The left Jacobian of SO(3) at the rotation vector `a`: `exp(a + d) = exp(J d) exp(a)` for a small
/// `d` (J. Sola, J. Deray, D. Atchuthan, arXiv 1812.01537, eq. 145).
pub fn left_jacobian(a: &Vec3) -> nalgebra::Matrix3<f64> {
    let angle = a.norm();
    let cross = a.cross_matrix();
    if angle < 1e-4 {
        return nalgebra::Matrix3::identity() + cross * 0.5;
    }
    let (sin, cos) = angle.sin_cos();
    nalgebra::Matrix3::identity()
        + cross * ((1.0 - cos) / (angle * angle))
        + cross * cross * ((angle - sin) / angle.powi(3))
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

/// A covariance in a frame that is turned.
pub fn turned_covariance(turn: &Rotation, covariance: &Matrix3<f64>) -> Matrix3<f64> {
    let matrix = turn.to_rotation_matrix();
    matrix.matrix() * covariance * matrix.matrix().transpose()
}
