//! From pixels on the ball's image to directions from its center, and back.
//!
//! Without intrinsics the camera points at the ball's center from a distance of `1 / k` ball radii.
//! With the outline's center `c` and radius `r` in pixels, the direction `(x, y, z)` is seen at
//!
//! ```text
//! u = c_u + r s x,   v = c_v - r s y,   s = sqrt(1 - k^2) / (1 - k z)
//! ```
//!
//! since the outline is where `z = k`. Parallel rays are `k = 0`. A camera at 12 radii moves a dot
//! at half the radius by 4 % of it.
//!
//! Off the optical axis a sphere's outline is an ellipse: `tilt.rs`. With intrinsics the projection is that of a pinhole camera with
//! its [`Lens`](super::lens::Lens). The ball's center then lies at the distance `d = R / sin(alpha)`, for the half angle `alpha` under
//! which the ball is seen, and a ray `q` meets the sphere at its nearer intersection.
//!
//! Directions are in the *view frame*, whose z points from the ball's center to the camera; it is
//! the camera's frame turned by the smallest rotation that does so. [`BallView::to_camera`] is the
//! rotation from the view frame to the camera's. Under an orthographic projection both are the
//! same.
//!
//! A pixel's covariance `S` becomes the tangent covariance `J S J^T`, `J` the derivative of the
//! tangent coordinates by the pixel. Towards the limb it grows as `1 / z` along the radius; there
//! the linearization fails, and the covariance is bounded by its value at a fixed depth.

use fearless_simd::{Level, Simd, dispatch};
use nalgebra::{Matrix2, Matrix2x3, Matrix3x2, Vector2};

pub use super::ball_circle::BallCircle;
pub use super::intrinsics::{Intrinsics, Pixel};
use super::tilt::Tilt;
use crate::error::{Error, Result, require};
use crate::geometry::{Rotation, Vec3, tangent_frame};
use crate::view::{DotUncertainty, ObservedDot};

/// Depth below which a dot's covariance grows no further: nearer to the limb the derivative has a
/// pole.
const MIN_DEPTH: f64 = 0.12;
/// Dots up to this far outside the circle, in radii, are projected onto the limb.
const BEYOND_LIMB: f64 = 0.06;
/// Lengths in pixels that an image can have: focal lengths and radii. What is farther out loses the digits
/// that the geometry needs.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-6..=1e9;
/// Largest distance of a ball from a pinhole, ball radii: farther out the sphere's roundness is lost in the
/// digits of its distance.
const FARTHEST: f64 = 1e6;
/// Step of the finite difference by the inverse distance.
const DIFFERENCE: f64 = 1e-6;

/// How the camera projects.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub enum Camera {
    /// Along parallel rays: correct for a ball that is small compared with its distance.
    #[default]
    Orthographic,
    /// From a known distance, pointed at the ball's center.
    Near {
        /// Ball radii over the distance from the camera to the ball's center, in [0, 1).
        inverse_distance: f64,
    },
    /// Through a pinhole.
    Perspective(Intrinsics),
}

/// A camera and a ball whose outline is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallView {
    circle: BallCircle,
    projection: Projection,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Projection {
    /// From 1 / `inverse_distance` radii, parallel rays for 0; pointed at the ball, or tilted away from it.
    Central {
        inverse_distance: f64,
        tilt: Option<Tilt>,
    },
    Perspective {
        intrinsics: Intrinsics,
        /// View frame to camera frame.
        to_camera: Rotation,
        /// Distance of the ball's center in ball radii.
        distance: f64,
    },
}

impl BallView {
    /// The view of a ball with the outline `circle`.
    ///
    /// The outline of a sphere off the optical axis of a pinhole is an ellipse. There `circle` has its center where the ball's
    /// center is seen, and the radius `sqrt(fx fy) |q| m tan a`, with `q` the ray to the center at unit depth, `m` the lens'
    /// magnification there ([`Intrinsics::scale_at`]) and `a` the half angle of the ball: without distortion to first order in
    /// `a` the ellipse's half-axis across the direction to the principal point.
    ///
    /// # Errors
    /// [`Error::Argument`] where the radius or a focal length is not within 1e-6 to 1e9 pixels, a center farther
    /// out, or the ball more than 1e6 of its radii away.
    pub fn new(camera: &Camera, circle: BallCircle) -> Result<Self> {
        if !(is_near(circle.center.u, circle.center.v) && LENGTHS.contains(&circle.radius)) {
            let problem = format!(
                "expected a center within 1e9 pixels and a radius of 1e-6 to 1e9, found {circle:?}"
            );
            return Err(Error::argument("circle", problem));
        }
        let projection = match *camera {
            Camera::Orthographic => Self::central(0.0, &circle)?,
            Camera::Near { inverse_distance } => {
                let inside = (0.0..1.0).contains(&inverse_distance);
                require(inside, "inverse_distance", "0 to 1", inverse_distance)?;
                Self::central(inverse_distance, &circle)?
            }
            Camera::Perspective(k) => Self::perspective(k, &circle)?,
        };
        Ok(Self { circle, projection })
    }

    fn central(inverse_distance: f64, circle: &BallCircle) -> Result<Projection> {
        let eccentricity = circle.eccentricity.norm();
        let problem = "0 to 1, 1 excluded";
        require(
            (0.0..1.0).contains(&eccentricity),
            "eccentricity",
            problem,
            eccentricity,
        )?;
        let tilt = Tilt::new(inverse_distance, &circle.eccentricity);
        Ok(Projection::Central {
            inverse_distance,
            tilt,
        })
    }

    fn perspective(k: Intrinsics, circle: &BallCircle) -> Result<Projection> {
        if !(LENGTHS.contains(&k.fx) && LENGTHS.contains(&k.fy) && is_near(k.cx, k.cy)) {
            let problem = format!(
                "expected focal lengths of 1e-6 to 1e9 pixels and a center within 1e9, found {k:?}"
            );
            return Err(Error::argument("intrinsics", problem));
        }
        let ray = k.ray(circle.center).ok_or_else(|| {
            Error::argument("circle", "expected a center that the camera's lens shows")
        })?;
        // Angle between the rays to the center and to the outline, across the direction to the
        // principal point, where the distance from the pinhole to the image point is that of the
        // center.
        let half_angle = (circle.radius / k.scale_at(&ray)).atan();
        let distance = 1.0 / half_angle.sin();
        if distance > FARTHEST {
            let problem = format!("expected a ball within 1e6 of its radii, found {distance:e}");
            return Err(Error::argument("circle", problem));
        }
        let towards = -ray.normalize();
        let to_camera = Rotation::rotation_between(&Vec3::z(), &towards)
            .ok_or_else(|| Error::argument("circle", "expected a ball before the camera"))?;
        Ok(Projection::Perspective {
            intrinsics: k,
            to_camera,
            distance,
        })
    }

    /// The outline of a ball with its center there (camera frame, ball radii), as [`BallView::new`] takes it.
    ///
    /// # Errors
    /// [`Error::Argument`] for a center behind the camera or within the ball.
    pub fn of_center(intrinsics: Intrinsics, center: &Vec3) -> Result<BallCircle> {
        let distance = center.norm();
        if !(center.z < 0.0 && distance > 1.0 && distance.is_finite()) {
            let problem = format!("expected a ball before the camera, found {center:?}");
            return Err(Error::argument("center", problem));
        }
        let half_angle = (1.0 / distance).asin();
        let ray = center / -center.z;
        let radius = intrinsics.scale_at(&ray) * half_angle.tan();
        Ok(BallCircle::new(intrinsics.project(center), radius))
    }

    /// The same camera's view of another outline.
    ///
    /// # Errors
    /// As [`BallView::new`].
    pub(crate) fn at(&self, circle: BallCircle) -> Result<Self> {
        let camera = match self.projection {
            Projection::Central {
                inverse_distance, ..
            } => Camera::Near { inverse_distance },
            Projection::Perspective { intrinsics, .. } => Camera::Perspective(intrinsics),
        };
        Self::new(&camera, circle)
    }

    /// The ball's outline.
    pub fn circle(&self) -> &BallCircle {
        &self.circle
    }

    /// The rotation from the view frame to the camera's frame.
    pub fn to_camera(&self) -> Rotation {
        match self.projection {
            Projection::Central { .. } => Rotation::identity(),
            Projection::Perspective { to_camera, .. } => to_camera,
        }
    }

    /// The ball's center, camera frame, ball radii; `None` where the camera's intrinsics are not known.
    pub fn center(&self) -> Option<Vec3> {
        match self.projection {
            Projection::Central { .. } => None,
            Projection::Perspective {
                to_camera,
                distance,
                ..
            } => Some(to_camera * Vec3::z() * -distance),
        }
    }

    /// Minimum z, in the view frame, that is visible: 0, or under perspective the ball's radius
    /// over its distance.
    pub fn horizon(&self) -> f64 {
        match self.projection {
            Projection::Central {
                inverse_distance, ..
            } => inverse_distance,
            Projection::Perspective { distance, .. } => 1.0 / distance,
        }
    }

    /// d(pixel of a direction)/d(ball radii over the camera's distance), pixels; `None` where the
    /// distance follows from the intrinsics.
    pub fn by_inverse_distance(&self, direction: &Vec3) -> Option<Vector2<f64>> {
        let Projection::Central {
            inverse_distance: k,
            tilt,
        } = self.projection
        else {
            return None;
        };
        let root = (1.0 - k * k).sqrt();
        let depth = 1.0 - k * direction.z;
        let rate = root * direction.z / (depth * depth) - k / (root * depth);
        let straight = Vector2::new(direction.x, -direction.y) * rate;
        let seen = match tilt {
            Some(tilt) => {
                let at = plane(direction, k);
                let other = Tilt::new(k + DIFFERENCE, &self.circle.eccentricity);
                let by_tilt = other.map_or(Vector2::zeros(), |o| o.see(at) - tilt.see(at));
                tilt.jacobian(at) * straight + by_tilt / DIFFERENCE
            }
            None => straight,
        };
        Some(seen * self.circle.radius)
    }

    /// The same ball a little farther off the axis, along u and along v.
    pub(crate) fn off_axis(&self, by: f64) -> [Option<Self>; 2] {
        [Vector2::x(), Vector2::y()].map(|axis| {
            let mut circle = self.circle;
            circle.eccentricity += axis * by;
            let camera = Camera::Near {
                inverse_distance: self.horizon(),
            };
            Self::new(&camera, circle).ok()
        })
    }

    /// d(pixel of a direction)/d(outline's center u, v and radius): the shift moves all dots alike, the
    /// growth moves them away from the center. The camera's distance stays as it is.
    pub fn by_outline(&self, direction: &Vec3) -> Matrix2x3<f64> {
        let BallCircle { center, radius, .. } = self.circle;
        let at = self.project(direction);
        let (u, v) = ((at.u - center.u) / radius, (at.v - center.v) / radius);
        Matrix2x3::new(1.0, 0.0, u, 0.0, 1.0, v)
    }

    /// A point of the outline in the image, by its angle in the view frame.
    pub(crate) fn limb(&self, angle: f64) -> Pixel {
        let depth = self.horizon();
        let aside = (1.0 - depth * depth).sqrt();
        let (s, c) = angle.sin_cos();
        self.project(&Vec3::new(aside * c, aside * s, depth))
    }

    /// Where a direction (unit vector, view frame) lies in the image, seen or not.
    pub fn project(&self, direction: &Vec3) -> Pixel {
        let BallCircle { center, radius, .. } = self.circle;
        match self.projection {
            Projection::Central {
                inverse_distance: k,
                tilt,
            } => {
                let straight = plane(direction, k);
                let at = tilt.map_or(straight, |t| t.see(straight)) * radius;
                Pixel {
                    u: center.u + at.x,
                    v: center.v + at.y,
                }
            }
            Projection::Perspective {
                intrinsics: k,
                to_camera,
                distance,
            } => k.project(&(to_camera * (direction - Vec3::z() * distance))),
        }
    }

    /// Where the directions `(x, y, sqrt(1 - x^2 - y^2))` of one `y` are seen, as [`BallView::project`] has it: u and v. Several times as fast where
    /// the camera points at the ball.
    pub(crate) fn project_row(&self, y: f64, row: &[f64], seen: &mut [Vec<f64>; 2]) {
        seen.iter_mut().for_each(Vec::clear);
        let [us, vs] = seen;
        let Projection::Central {
            inverse_distance: k,
            tilt: None,
        } = self.projection
        else {
            for x in row {
                let z = (1.0 - x * x - y * y).sqrt();
                let at = self.project(&Vec3::new(*x, y, z));
                us.push(at.u);
                vs.push(at.v);
            }
            return;
        };
        let BallCircle { center, radius, .. } = self.circle;
        let root = (1.0 - k * k).sqrt();
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || {
                let scale = |x: f64| root / (1.0 - k * (1.0 - x * x - y * y).sqrt());
                vs.extend(row.iter().map(|x| center.v + -y * scale(*x) * radius));
                us.extend(row.iter().map(|x| center.u + x * scale(*x) * radius));
            }
        ));
    }

    /// The direction (unit vector, view frame) of the ball's point that is seen at a pixel. Points
    /// just outside the outline are laid on it; `None` for those farther out.
    pub fn direction(&self, pixel: Pixel) -> Option<Vec3> {
        match self.projection {
            Projection::Central {
                inverse_distance, ..
            } => {
                let at = self.aside(pixel);
                on_sphere(at.x, at.y, inverse_distance)
            }
            Projection::Perspective {
                intrinsics,
                to_camera,
                distance,
            } => {
                // Ray from the camera at (0, 0, d) in the view frame along q: |d e_z + s q|^2 = 1.
                let q = (to_camera.inverse() * intrinsics.ray(pixel)?).normalize();
                let along = -distance * q.z;
                let off = (distance * distance - along * along).max(0.0);
                if !q.z.is_finite() || off.sqrt() > 1.0 + BEYOND_LIMB {
                    return None;
                }
                let s = along - (1.0 - off).max(0.0).sqrt();
                (Vec3::z() * distance + q * s).try_normalize(0.5)
            }
        }
    }

    /// Where the ray of a pixel passes the ball's center, ball radii along x and y of the view frame: of the length 1 at the rim.
    pub(crate) fn aside(&self, pixel: Pixel) -> Vector2<f64> {
        match self.projection {
            Projection::Central { tilt, .. } => {
                let BallCircle { center, radius, .. } = self.circle;
                let seen = Vector2::new(pixel.u - center.u, pixel.v - center.v) / radius;
                let at = tilt.map_or(seen, |t| t.straighten(seen));
                Vector2::new(at.x, -at.y)
            }
            Projection::Perspective {
                intrinsics,
                to_camera,
                distance,
            } => {
                // A pixel that the lens does not show is beyond any ball.
                let Some(ray) = intrinsics.ray(pixel) else {
                    return Vector2::repeat(f64::INFINITY);
                };
                let q = (to_camera.inverse() * ray).normalize();
                let nearest = Vec3::z() * distance - q * (distance * q.z);
                nearest.xy() * (nearest.norm() / nearest.xy().norm().max(1e-12))
            }
        }
    }

    /// The dot seen at a pixel with the covariance `covariance_px2` (u, v), in the view frame.
    /// `None` outside the ball.
    pub fn back_project(&self, pixel: Pixel, covariance_px2: &Matrix2<f64>) -> Option<ObservedDot> {
        let direction = self.direction(pixel)?;
        let forward = self.jacobian(&direction);
        let [e1, e2] = tangent_frame(&direction);
        let tangent = Matrix3x2::from_columns(&[e1, e2]);
        // d(pixel)/d(tangent), inverted with its small singular value bounded from below.
        let svd = (forward * tangent).svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let min_value = MIN_DEPTH * svd.singular_values.max();
        let inverse = svd.singular_values.map(|s| 1.0 / s.max(min_value));
        let back = v_t.transpose() * Matrix2::from_diagonal(&inverse) * u.transpose();
        let covariance = back * covariance_px2 * back.transpose();
        Some(ObservedDot {
            direction,
            uncertainty: DotUncertainty::Tangent {
                covariance: 0.5 * (covariance + covariance.transpose()),
            },
        })
    }

    /// d(direction)/d(pixel), 3 x 2, along the sphere; `None` at the limb, where a pixel is no direction.
    pub(crate) fn by_pixel(&self, direction: &Vec3) -> Option<Matrix3x2<f64>> {
        let tangents = Matrix3x2::from_columns(&tangent_frame(direction));
        Some(tangents * (self.jacobian(direction) * tangents).try_inverse()?)
    }

    /// d(pixel)/d(direction), 2 x 3.
    pub fn jacobian(&self, direction: &Vec3) -> Matrix2x3<f64> {
        match self.projection {
            Projection::Central {
                inverse_distance: k,
                tilt,
            } => {
                let depth = 1.0 - k * direction.z;
                let r = self.circle.radius * (1.0 - k * k).sqrt() / depth;
                let (x, y) = (direction.x * k / depth, direction.y * k / depth);
                let straight = Matrix2x3::new(r, 0.0, r * x, 0.0, -r, -r * y);
                match tilt {
                    Some(tilt) => tilt.jacobian(plane(direction, k)) * straight,
                    None => straight,
                }
            }
            Projection::Perspective {
                intrinsics: k,
                to_camera,
                distance,
            } => {
                let turn = to_camera.to_rotation_matrix();
                let p = turn * (direction - Vec3::z() * distance);
                k.jacobian(&p) * turn.matrix()
            }
        }
    }
}

/// Where a direction is seen by a camera that looks straight at the ball, outline radii from its center, u and v.
fn plane(direction: &Vec3, inverse_distance: f64) -> Vector2<f64> {
    let k = inverse_distance;
    let scale = (1.0 - k * k).sqrt() / (1.0 - k * direction.z);
    Vector2::new(direction.x, -direction.y) * scale
}

/// Whether a point is one of an image; not so for NaN.
fn is_near(u: f64, v: f64) -> bool {
    u.abs() <= *LENGTHS.end() && v.abs() <= *LENGTHS.end()
}

/// The direction seen at `(x, y)` radii from the outline's center, from a camera at `1 / k` radii.
///
fn on_sphere(x: f64, y: f64, k: f64) -> Option<Vec3> {
    let at = Vector2::new(x, y);
    let out = at.norm();
    if !out.is_finite() || out > 1.0 + BEYOND_LIMB {
        return None;
    }
    let held = at / out.max(1.0);
    // (x, y) = a (1 - k z) with a = held / sqrt(1 - k^2), and x^2 + y^2 + z^2 = 1: a quadratic in
    // z, whose larger root faces the camera.
    let a = held / (1.0 - k * k).sqrt();
    let a2 = a.norm_squared();
    let denominator = 1.0 + k * k * a2;
    let root = (1.0 - a2 * (1.0 - k * k)).max(0.0).sqrt();
    let z = (k * a2 + root) / denominator;
    let flat = a * (1.0 - k * z);
    Vec3::new(flat.x, flat.y, z).try_normalize(0.0)
}
