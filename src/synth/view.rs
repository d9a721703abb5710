//! The camera's geometry: rays to the ball, points of the ball to pixels, the ball's outline.
//!
//! Lengths are in ball radii. In the camera's frame (x right, y up, z towards the camera) a pinhole
//! at the origin sees a ball of radius 1 whose center lies at the distance `D`, at the angle
//! `theta` from the optical axis, under the half angle `alpha = asin(1 / D)`. The rays that touch
//! it form a cone about the ray to its center; the image plane cuts the cone in an ellipse. With
//! the focal length `f`, along the direction from the principal point it reaches from
//! `f tan(theta - alpha)` to `f tan(theta + alpha)`, so that
//!
//! - the center lies at `f sin(theta) cos(theta) / q`,
//! - the half axis along that direction is `f sin(alpha) cos(alpha) / q`,
//! - the one across is `f sin(alpha) / sqrt(q)`, with `q = cos(theta)^2 - sin(alpha)^2`.
//!
//! A point `n` of the sphere (unit vector from its center) is visible where `n . e > 1 / D`, `e`
//! the unit vector from the ball's center to the camera.
//!
//! This module shares no code with [`crate::vision::optics::camera`], which is measured on its images.

use serde::{Deserialize, Serialize};

use crate::error::{Result, require};
use crate::geometry::{Rotation, Vec3};
use crate::vision::optics::camera::{BallCircle, Camera, Intrinsics, Pixel};
use crate::vision::optics::lens::Lens;

/// The ball's outline: an ellipse.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Ellipse {
    /// Its center.
    pub center: Pixel,
    /// Half its longer and its shorter axis, pixels.
    pub half_axes_px: [f64; 2],
    /// Angle of the longer axis from the image's u axis towards its v axis, radians.
    pub angle_rad: f64,
}

impl Ellipse {
    /// The point at the parameter `t` (radians), along the outline.
    pub fn point(&self, t: f64) -> Pixel {
        let [a, b] = self.half_axes_px;
        let ((s, c), (sin, cos)) = (t.sin_cos(), self.angle_rad.sin_cos());
        Pixel {
            u: self.center.u + a * c * cos - b * s * sin,
            v: self.center.v + a * c * sin + b * s * cos,
        }
    }

    /// The circle about the same center and of the same area.
    pub fn circle(&self) -> BallCircle {
        let [a, b] = self.half_axes_px;
        BallCircle::new(self.center, (a * b).sqrt())
    }
}

/// A camera and a ball in its view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    circle: BallCircle,
    pinhole: Option<RenderingPinhole>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct RenderingPinhole {
    focal: [f64; 2],
    principal: Pixel,
    /// The ball's center, camera frame, ball radii.
    center: Vec3,
    distance: f64,
}

impl View {
    /// The view of a ball whose center is seen at `circle.center` and whose outline has the half
    /// axis `circle.radius` across the direction to the principal point: to first order, the
    /// outline moved so that it is centered on the projection of the ball's center.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the circle or the intrinsics are not finite or not
    /// positive.
    pub fn new(camera: &Camera, circle: BallCircle) -> Result<Self> {
        let BallCircle { center, radius, .. } = circle;
        require(
            center.u.is_finite() && center.v.is_finite() && radius > 0.0 && radius.is_finite(),
            "circle",
            "a finite center and a positive radius",
            format_args!("{circle:?}"),
        )?;
        let Camera::Perspective(k) = *camera else {
            return Ok(Self {
                circle,
                pinhole: None,
            });
        };
        let good = |f: f64| f > 0.0 && f.is_finite();
        require(
            good(k.fx) && good(k.fy) && k.cx.is_finite() && k.cy.is_finite(),
            "intrinsics",
            "positive focal lengths and a finite principal point",
            format_args!("{k:?}"),
        )?;
        let is_pinhole = k.lens == Lens::Ideal && k.skew == 0.0;
        require(
            is_pinhole,
            "intrinsics",
            "no distortion",
            format_args!("{k:?}"),
        )?;
        let focal = [k.fx, k.fy];
        let principal = Pixel { u: k.cx, v: k.cy };
        let ray = ray(focal, principal, center);
        // Across the direction to the principal point, pixels at the ball's center are |ray| focal
        // lengths away.
        let half_angle = (radius / ((k.fx * k.fy).sqrt() * ray.norm())).atan();
        let distance = 1.0 / half_angle.sin();
        Ok(Self {
            circle,
            pinhole: Some(RenderingPinhole {
                focal,
                principal,
                center: ray.normalize() * distance,
                distance,
            }),
        })
    }

    /// Distance of the camera from the ball's center, ball radii; `None` for parallel rays.
    pub fn distance(&self) -> Option<f64> {
        self.pinhole.map(|p| p.distance)
    }

    /// The unit vector from the ball's center to the camera, camera frame.
    pub fn towards(&self) -> Vec3 {
        self.pinhole.map_or(Vec3::z(), |p| -p.center / p.distance)
    }

    /// The smallest rotation that turns the direction to the camera into z: camera frame to view
    /// frame.
    pub fn to_view(&self) -> Rotation {
        // None only for a ball behind the camera, which a pixel's ray cannot be.
        Rotation::rotation_between(&self.towards(), &Vec3::z()).unwrap_or_default()
    }

    /// The cosine of the angle at which the surface at `n` (unit vector, camera frame) is seen: 1
    /// face on, 0 at the horizon, negative on the far side.
    pub fn facing(&self, n: &Vec3) -> f64 {
        match self.pinhole {
            None => n.z,
            Some(p) => {
                let to_camera = -(p.center + n);
                n.dot(&to_camera) / to_camera.norm()
            }
        }
    }

    /// Where the point `n` of the ball (unit vector, camera frame) lies in the image, seen or not.
    pub fn project(&self, n: &Vec3) -> Pixel {
        match self.pinhole {
            None => Pixel {
                u: self.circle.center.u + self.circle.radius * n.x,
                v: self.circle.center.v - self.circle.radius * n.y,
            },
            Some(p) => {
                let at = p.center + n;
                Pixel {
                    u: p.principal.u + p.focal[0] * at.x / -at.z,
                    v: p.principal.v - p.focal[1] * at.y / -at.z,
                }
            }
        }
    }

    /// The point of the ball (unit vector, camera frame) on the ray of a pixel; `None` where the
    /// ray misses.
    pub fn normal(&self, pixel: Pixel) -> Option<Vec3> {
        match self.pinhole {
            None => {
                let BallCircle { center, radius, .. } = self.circle;
                let (x, y) = ((pixel.u - center.u) / radius, (center.v - pixel.v) / radius);
                let z = 1.0 - x * x - y * y;
                (z > 0.0).then(|| Vec3::new(x, y, z.sqrt()))
            }
            Some(p) => {
                let q = ray(p.focal, p.principal, pixel).normalize();
                let along = q.dot(&p.center);
                let root = along * along - p.center.norm_squared() + 1.0;
                (root > 0.0).then(|| q * (along - root.sqrt()) - p.center)
            }
        }
    }

    /// The ball's outline. The focal lengths are taken as equal (their geometric mean).
    pub fn outline(&self) -> Ellipse {
        let Some(p) = self.pinhole else {
            return Ellipse {
                center: self.circle.center,
                half_axes_px: [self.circle.radius; 2],
                angle_rad: 0.0,
            };
        };
        let focal = (p.focal[0] * p.focal[1]).sqrt();
        let across = p.center.x.hypot(p.center.y);
        let (sin, cos) = (across / p.distance, -p.center.z / p.distance);
        let sin_alpha = 1.0 / p.distance;
        let cos_alpha = (1.0 - sin_alpha * sin_alpha).sqrt();
        let q = cos * cos - sin_alpha * sin_alpha;
        let [x, y] = if across > 0.0 {
            [p.center.x / across, -p.center.y / across]
        } else {
            [1.0, 0.0]
        };
        let out = focal * sin * cos / q;
        Ellipse {
            center: Pixel {
                u: p.principal.u + out * x,
                v: p.principal.v + out * y,
            },
            half_axes_px: [
                focal * sin_alpha * cos_alpha / q,
                focal * sin_alpha / q.sqrt(),
            ],
            angle_rad: y.atan2(x),
        }
    }
}

/// Where a pinhole without distortion sees a ball with its center there (camera frame, ball radii), as [`View::new`] takes it.
pub(super) fn circle_of(k: &Intrinsics, center: &Vec3) -> BallCircle {
    let ray = center / -center.z;
    let half_angle = (1.0 / center.norm()).asin();
    let at = Pixel {
        u: k.cx + k.fx * ray.x,
        v: k.cy - k.fy * ray.y,
    };
    BallCircle::new(at, (k.fx * k.fy).sqrt() * ray.norm() * half_angle.tan())
}

/// The ray through a pixel, camera frame, with z = -1.
fn ray(focal: [f64; 2], principal: Pixel, pixel: Pixel) -> Vec3 {
    Vec3::new(
        (pixel.u - principal.u) / focal[0],
        (principal.v - pixel.v) / focal[1],
        -1.0,
    )
}
