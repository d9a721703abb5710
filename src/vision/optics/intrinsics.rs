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

use std::path::Path;

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2};
use saphyr_parser::{Event, Parser};
use serde::{Deserialize, Serialize};

use super::lens::Lens;
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::Vec3;

/// Bytes of the largest file of intrinsics.
const MAX_BYTES: u64 = 1 << 20;
/// The keys under which files have the matrix, and the distortion: OpenCV's samples, ROS, NumPy's users.
const MATRIX: [&str; 5] = ["camera_matrix", "Camera_Matrix", "K", "k", "mtx"];
const DISTORTION: [&str; 8] = [
    "distortion_coefficients",
    "Distortion_Coefficients",
    "dist_coeffs",
    "distCoeffs",
    "dist",
    "D",
    "d",
    "distortion",
];
/// The keys under which a file names the model of its distortion.
const MODEL: [&str; 2] = ["distortion_model", "model"];

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
                "expected rows fx s cx, 0 fy cy, 0 0 1 with positive focal lengths, found {:?}",
                k.transpose().as_slice()
            ));
        }
        Ok(read)
    }

    fn is_a_camera(&self) -> bool {
        let numbers = [self.fx, self.fy, self.cx, self.cy, self.skew];
        numbers.iter().all(|x| x.is_finite()) && self.fx > 0.0 && self.fy > 0.0
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

    /// Reads the intrinsics of a file: OpenCV's YAML or JSON, or ROS' camera_info.
    ///
    /// # Errors
    /// [`Error::Read`] where the system refuses; [`Error::Input`] naming the field that is not as expected.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = files::read_at_most(path, MAX_BYTES)?;
        let text = String::from_utf8(bytes)
            .map_err(|_| Error::input(path, "file", "expected YAML or JSON"))?;
        Self::from_text(path, &text)
    }

    /// As [`read`](Self::read), from the file's text; `path` is for errors.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is not as expected.
    pub fn from_text(path: &Path, text: &str) -> Result<Self> {
        let fields = fields(text).map_err(|error| {
            Error::input(
                path,
                "file",
                format!("expected YAML or JSON, found {error}"),
            )
        })?;
        let field = |names: &[&'static str]| {
            let mut named = names.iter();
            named.find_map(|name| Some((*name, &fields.iter().find(|(n, _)| n == name)?.1)))
        };
        let expected = "expected the matrix fx s cx, 0 fy cy, 0 0 1, as OpenCV and ROS write it";
        let matrix = field(&MATRIX).and_then(|(name, field)| Some((name, field.numbers()?)));
        let Some((name, numbers)) = matrix.filter(|(_, n)| n.len() == 9) else {
            return Err(Error::input(path, MATRIX[0], expected));
        };
        let (at, coefficients) = match field(&DISTORTION) {
            Some((name, field)) => {
                let expected = || Error::input(path, name, "expected numbers");
                (name, field.numbers().ok_or_else(expected)?)
            }
            None => (DISTORTION[0], Vec::new()),
        };
        let lens = match field(&MODEL).map(|(name, field)| (name, field.text.as_str())) {
            None | Some((_, "plumb_bob" | "rational_polynomial" | "radtan" | "opencv" | "")) => {
                Lens::polynomial(&coefficients)
            }
            Some((_, "equidistant" | "fisheye")) => Lens::fisheye(&coefficients),
            Some((name, other)) => {
                let problem = format!(
                    "expected plumb_bob, rational_polynomial, equidistant or fisheye, found {}",
                    files::csv::shown(other)
                );
                return Err(Error::input(path, name, problem));
            }
        };
        let in_file = |at: &str, error: Error| match error {
            Error::Argument { problem, .. } => Error::input(path, at.to_owned(), problem),
            other => other,
        };
        let lens = lens.map_err(|error| in_file(at, error))?;
        Self::from_matrix(&Matrix3::from_row_slice(&numbers), lens)
            .map_err(|error| in_file(name, error))
    }

    /// Where a point before the camera (camera frame) is seen.
    pub fn project(&self, point: &Vec3) -> Pixel {
        let (shown, _) = self.lens.distort(&at_unit_depth(point));
        Pixel {
            u: self.cx + self.fx * shown.x + self.skew * shown.y,
            v: self.cy + self.fy * shown.y,
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

/// What a file has under a key of its first level.
#[derive(Debug, Default)]
struct Field {
    /// A value that is no list.
    text: String,
    /// The values within lists.
    listed: Vec<String>,
}

impl Field {
    /// The values of a list, of lists in a list, or of a matrix' `data`; `None` where one is no number, or there are none.
    fn numbers(&self) -> Option<Vec<f64>> {
        let numbers: Option<Vec<f64>> = self.listed.iter().map(|n| n.parse().ok()).collect();
        numbers.filter(|n| !n.is_empty())
    }
}

/// A list, or a mapping between its keys or behind one.
#[derive(Debug, PartialEq)]
enum Level {
    List,
    Mapping { key: Option<String> },
}

impl Level {
    /// Ends a value: the next of a mapping is a key.
    fn end_value(&mut self) {
        if let Self::Mapping { key } = self {
            *key = None;
        }
    }
}

/// The fields of the first level. Events are read one after the other, however deep a file goes.
fn fields(text: &str) -> std::result::Result<Vec<(String, Field)>, saphyr_parser::ScanError> {
    // OpenCV's first line is not YAML's.
    let text = text.strip_prefix("%YAML:1.0").unwrap_or(text);
    let mut fields: Vec<(String, Field)> = Vec::new();
    let mut levels: Vec<Level> = Vec::new();
    for event in Parser::new_from_str(text) {
        match event?.0 {
            Event::MappingStart(..) => levels.push(Level::Mapping { key: None }),
            Event::SequenceStart(..) => levels.push(Level::List),
            Event::MappingEnd | Event::SequenceEnd => {
                levels.pop();
                if let Some(level) = levels.last_mut() {
                    level.end_value();
                }
            }
            Event::Scalar(value, ..) => {
                let is_first = levels.len() == 1;
                // Of a matrix only the data: others of its keys may have lists, too.
                let is_data = levels.get(1).is_none_or(|level| match level {
                    Level::List => true,
                    Level::Mapping { key } => key.as_deref() == Some("data"),
                });
                match levels.last_mut() {
                    Some(Level::Mapping { key: key @ None }) => {
                        if is_first {
                            fields.push((value.to_string(), Field::default()));
                        }
                        *key = Some(value.into_owned());
                    }
                    Some(level) => {
                        if let Some((_, field)) = fields.last_mut() {
                            match level {
                                Level::List if is_data => field.listed.push(value.into_owned()),
                                Level::Mapping { .. } if is_first => {
                                    field.text = value.into_owned();
                                }
                                _ => {}
                            }
                        }
                        level.end_value();
                    }
                    None => {}
                }
            }
            Event::DocumentEnd => break,
            _ => {}
        }
    }
    Ok(fields)
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPECTED: [f64; 4] = [650.0, 640.0, 320.5, 240.25];

    fn read(text: &str) -> Result<Intrinsics> {
        Intrinsics::from_text("camera.yaml".as_ref(), text)
    }

    #[test]
    fn files_of_opencv_ros_and_json_are_read() {
        let data = "[ 6.5e+02, 0., 3.205e+02, 0., 640., 2.4025e+02, 0., 0., 1. ]";
        let opencv = format!(
            "%YAML:1.0\n---\ncalibration_time: \"Wed\"\nnframes: 3\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
             data: {data}\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.28, 0.09,\n       \
             1.2e-03, -1e-4, 0. ]\navg_reprojection_error: 0.3\n"
        );
        let ros = format!(
            "image_width: 640\ncamera_name: cam\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: {data}\ndistortion_model: plumb_bob\n\
             distortion_coefficients: {{rows: 1, cols: 5, data: [-0.28, 0.09, 0.0012, -0.0001, 0.0]}}\nprojection_matrix:\n  rows: 3\n  \
             cols: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]\n"
        );
        let json = r#"{"K": [[650, 0, 320.5], [0, 640, 240.25], [0, 0, 1]], "dist": [[-0.28, 0.09, 0.0012, -0.0001, 0]]}"#;
        let flat = opencv.replace("rows: 1\n   cols: 5\n   dt: d", "sizes: [ 5 ]\n   dt: d");
        let lens = Lens::polynomial(&[-0.28, 0.09, 0.0012, -1e-4, 0.0]).expect("a lens");
        for text in [&*opencv, &*flat, &*ros, json] {
            let k = read(text).expect(text);
            assert_eq!([k.fx, k.fy, k.cx, k.cy], EXPECTED);
            assert_eq!((k.skew, k.lens), (0.0, lens));
        }
        let fisheye = ros
            .replace("plumb_bob", "equidistant")
            .replace(", 0.0]}", "]}");
        assert!(matches!(
            read(&fisheye).expect("a camera").lens,
            Lens::Fisheye { .. }
        ));
    }

    #[test]
    fn other_files_are_refused_with_the_field() {
        let deep = "- ".repeat(100_000);
        let nested = format!("{{\"K\": {}", "[".repeat(2_000));
        for (text, word) in [
            ("", "camera_matrix"),
            ("a: [1, 2", "YAML or JSON"),
            (&*deep, "camera_matrix"),
            (&*nested, "YAML or JSON"),
            ("K: [1, 2, 3]", "camera_matrix"),
            ("K: [650, 0, 0, 0, 640, 0, 320, 240, 1]", "transposed"),
            ("K: [-650, 0, 320, 0, 640, 240, 0, 0, 1]", "positive focal"),
            (
                "K: [650, 0, 320, 0, 640, 240, 0, 0, 1]\ndist: [1, 2, 3]",
                "found 3",
            ),
            ("K: [650, 0, 320, 0, 640, 240, 0, 0, 1]\ndist: none", "dist"),
            (
                "K: [650, 0, 320, 0, 640, 240, 0, 0, 1]\ndistortion_model: ftheta",
                "ftheta",
            ),
        ] {
            let error = read(text).expect_err("no camera").to_string();
            assert!(
                error.contains(word) && error.lines().count() == 1,
                "{text:.60}: {error}"
            );
        }
    }

    #[test]
    fn a_pixel_and_its_ray_lead_to_each_other() {
        let k = Intrinsics {
            skew: 3.0,
            lens: Lens::polynomial(&[-0.25, 0.1, 1e-3, 2e-3, -0.02]).expect("a lens"),
            ..Intrinsics::pinhole(420.0, 400.0, 310.0, 250.0)
        };
        for (u, v) in [(310.0, 250.0), (12.0, 400.0), (600.5, 3.0)] {
            let ray = k.ray(Pixel { u, v }).expect("a ray");
            let back = k.project(&(ray * 7.0));
            assert!((back.u - u).hypot(back.v - v) < 1e-9, "{back:?}");
            for axis in 0..3 {
                let mut step = Vec3::zeros();
                step[axis] = 1e-6;
                let (a, b) = (k.project(&(ray + step)), k.project(&(ray - step)));
                let change = Vector2::new(a.u - b.u, a.v - b.v) / 2e-6;
                assert!((change - k.jacobian(&ray).column(axis)).norm() < 1e-5);
            }
        }
    }
}
