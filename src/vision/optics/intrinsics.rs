//! A camera's intrinsics: rays to pixels and back, and the files that hold them.
//!
//! A point `(X, Y, Z)` of the camera frame (x right, y up, z towards the camera) lies at `(x, y) = (X, -Y) / -Z` at unit
//! depth, y down; its [`Lens`] shows it at `(x', y')`, and the matrix `K` of OpenCV and ROS at
//!
//! ```text
//! u = fx x' + s y' + cx,   v = fy y' + cy
//! ```
//!
//! Distortion is undone where a ball is looked at, by a camera that points at it; images are never undistorted as a whole.

mod file;
mod size;
mod tree;

use std::path::Path;

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2};
use serde::{Deserialize, Serialize};

pub use self::file::CameraCalibration;
use super::lens::Lens;
use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Focal lengths, the principal point and the skew, pixels, at most.
const MAX_PX: f64 = 1e7;

/// A position in an image, pixels: u right, v down, the center of the top-left pixel at (0, 0).
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Pixel {
    /// To the right.
    pub u: f64,
    /// Downwards.
    pub v: f64,
}

/// A pinhole camera with its lens.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Focal length in pixels along u.
    pub fx: f64,
    /// Focal length in pixels along v.
    pub fy: f64,
    /// Principal point, u.
    pub cx: f64,
    /// Principal point, v.
    pub cy: f64,
    /// Pixels along u for one down, times the focal length.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub skew: f64,
    /// The lens.
    #[serde(default, skip_serializing_if = "is_ideal")]
    pub lens: Lens,
}

fn is_zero(skew: &f64) -> bool {
    *skew == 0.0
}

fn is_ideal(lens: &Lens) -> bool {
    *lens == Lens::Ideal
}

impl Intrinsics {
    /// A pinhole camera without distortion.
    pub const fn pinhole(fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self {
            fx,
            fy,
            cx,
            cy,
            skew: 0.0,
            lens: Lens::Ideal,
        }
    }

    /// Those of a matrix `K` as OpenCV and ROS have it, rows `fx s cx`, `0 fy cy`, `0 0 1`.
    ///
    /// # Errors
    /// [`Error::Argument`] for another matrix, a transposed one among them.
    pub fn from_matrix(k: &Matrix3<f64>, lens: Lens) -> Result<Self> {
        let refused = |problem: String| Err(Error::argument("camera_matrix", problem));
        if (k[(2, 0)], k[(2, 1)]) != (0.0, 0.0) && (k[(0, 2)], k[(1, 2)]) == (0.0, 0.0) {
            return refused(
                "expected the principal point in the last column: it is transposed".into(),
            );
        }
        let rest = [k[(1, 0)], k[(2, 0)], k[(2, 1)], k[(2, 2)] - 1.0];
        let read = Self {
            skew: k[(0, 1)],
            lens,
            ..Self::pinhole(k[(0, 0)], k[(1, 1)], k[(0, 2)], k[(1, 2)])
        };
        if !read.is_a_camera() || rest.iter().any(|x| *x != 0.0) {
            return refused(format!(
                "expected rows fx s cx, 0 fy cy, 0 0 1 with positive focal lengths, found {}",
                crate::files::csv::shown(&format!("{:?}", k.transpose().as_slice()))
            ));
        }
        Ok(read)
    }

    fn is_a_camera(&self) -> bool {
        let numbers = [self.fx, self.fy, self.cx, self.cy, self.skew];
        numbers.iter().all(|x| x.abs() <= MAX_PX) && self.fx > 0.0 && self.fy > 0.0
    }

    /// Those of numbers: fx, fy, cx, cy, and the coefficients of [`Lens::polynomial`].
    ///
    /// # Errors
    /// [`Error::Argument`] for other numbers.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self> {
        if let [fx, fy, cx, cy, distortion @ ..] = numbers {
            let read = Self {
                lens: Lens::polynomial(distortion)?,
                ..Self::pinhole(*fx, *fy, *cx, *cy)
            };
            if read.is_a_camera() {
                return Ok(read);
            }
        }
        let problem =
            "expected fx, fy, cx, cy with positive focal lengths, and the distortion behind them";
        Err(Error::argument("intrinsics", problem))
    }

    /// Reads the intrinsics of a file; see [`CameraCalibration::read`].
    ///
    /// # Errors
    /// As [`CameraCalibration::read`].
    pub fn read(path: &Path) -> Result<Self> {
        Ok(CameraCalibration::read(path)?.intrinsics)
    }

    /// As [`read`](Self::read), from the file's text; `path` is for errors.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is not as expected.
    pub fn from_text(path: &Path, text: &str) -> Result<Self> {
        Ok(CameraCalibration::from_text(path, None, text)?.intrinsics)
    }

    /// Where a point before the camera (camera frame) is seen.
    pub fn project(&self, point: &Vec3) -> Pixel {
        let (shown, _) = self.lens.distort(&at_unit_depth(point));
        Pixel {
            u: self.cx + self.fx * shown.x + self.skew * shown.y,
            v: self.cy + self.fy * shown.y,
        }
    }

    /// Hands on where the points `from + k step` are seen, for `k` from 0 on: as [`Intrinsics::project`], several times as fast where the lens is ideal.
    pub(crate) fn project_along(
        &self,
        from: &Vec3,
        step: &Vec3,
        count: usize,
        mut seen: impl FnMut(usize, Pixel),
    ) {
        if self.lens != Lens::Ideal {
            (0..count).for_each(|k| seen(k, self.project(&(from + step * k as f64))));
            return;
        }
        let in_plane = |p: &Vec3| {
            let u = self.cx * p.z - self.fx * p.x + self.skew * p.y;
            Vec3::new(u, self.cy * p.z + self.fy * p.y, p.z)
        };
        let (from, step) = (in_plane(from), in_plane(step));
        for k in 0..count {
            let at = from + step * k as f64;
            let by_depth = at.z.recip();
            let (u, v) = (at.x * by_depth, at.y * by_depth);
            seen(k, Pixel { u, v });
        }
    }

    /// d(pixel)/d(point), 2 x 3.
    pub fn jacobian(&self, point: &Vec3) -> Matrix2x3<f64> {
        let at = at_unit_depth(point);
        let by_point = Matrix2x3::new(-1.0, 0.0, -at.x, 0.0, 1.0, -at.y) / point.z;
        self.matrix() * self.lens.distort(&at).1 * by_point
    }

    /// The ray through a pixel, camera frame, with z = -1; `None` where the lens shows nothing there.
    pub fn ray(&self, pixel: Pixel) -> Option<Vec3> {
        let y = (pixel.v - self.cy) / self.fy;
        let x = (pixel.u - self.cx - self.skew * y) / self.fx;
        let at = self.lens.undistort(&Vector2::new(x, y))?;
        Some(Vec3::new(at.x, -at.y, -1.0))
    }

    /// Pixels for the tangent of an angle across a ray (camera frame, z = -1): their geometric mean over all directions in the
    /// image, but for the stretch away from the axis that a plane has.
    pub fn scale_at(&self, ray: &Vec3) -> f64 {
        let (_, jacobian) = self.lens.distort(&at_unit_depth(ray));
        self.focal() * ray.norm() * jacobian.determinant().abs().sqrt()
    }

    /// The mean focal length, pixels.
    pub fn focal(&self) -> f64 {
        (self.fx * self.fy).sqrt()
    }

    fn matrix(&self) -> Matrix2<f64> {
        Matrix2::new(self.fx, self.skew, 0.0, self.fy)
    }
}

/// Where a point of the camera frame lies at unit depth, y down.
fn at_unit_depth(point: &Vec3) -> Vector2<f64> {
    Vector2::new(-point.x, point.y) / point.z
}

#[cfg(test)]
mod tests;
