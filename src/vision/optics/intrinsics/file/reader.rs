//! One camera of a calibration's file: which keys say what.

use std::path::Path;

use nalgebra::Matrix3;

use super::super::tree::{Value, plain};
use super::super::{Intrinsics, Lens};
use super::keys::{
    COEFFICIENTS, DISTORTION, FOCAL, HARMLESS, MATRIX, MODEL, NEAR_MODELS, OF_LENS, OF_SIZE,
    OTHER_MODELS, PARAMETERS, SIDES, SIZES, bare,
};
use super::{CameraCalibration, Sent, listed};
use crate::error::{Error, Result};
use crate::files;

/// Width and height of an image, pixels, at most.
const MAX_SIDE: f64 = 1e6;

/// Reads one camera, and notes which keys it understands.
pub(super) struct Reader<'a> {
    path: &'a Path,
    camera: &'a Value,
    used: Vec<String>,
    /// A model that is known for no distortion alone, and its key.
    near_model: Option<(String, String)>,
}

impl<'a> Reader<'a> {
    pub fn new(path: &'a Path, camera: &'a Value) -> Self {
        Self {
            path,
            camera,
            used: Vec::new(),
            near_model: None,
        }
    }

    /// The value of the first key of one of these names, which counts as read.
    fn take(&mut self, names: &[&str]) -> Option<(&'a str, &'a Value)> {
        let (key, value) = self
            .camera
            .entries()
            .iter()
            .find(|(key, _)| names.contains(&bare(key).as_str()))?;
        self.used.push(bare(key));
        Some((key, value))
    }

    fn refused<T>(&self, at: &str, problem: impl Into<String>) -> Result<T> {
        Err(Error::input(self.path, at.to_owned(), problem.into()))
    }

    /// The camera, with what is to be known of its keys.
    pub fn read(mut self) -> Result<CameraCalibration> {
        let (at, matrix) = self.matrix()?;
        let is_fisheye = self.is_fisheye()?;
        let (lens_at, coefficients) = self.coefficients(is_fisheye)?;
        let in_file = |at: &str, error: Error| match error {
            Error::Argument { problem, .. } => Error::input(self.path, at.to_owned(), problem),
            other => other,
        };
        let lens = match (is_fisheye, &coefficients) {
            (true, Some(k)) => Lens::fisheye(k),
            (true, None) => Lens::fisheye(&[0.0; 4]),
            (false, k) => Lens::polynomial(k.as_deref().unwrap_or_default()),
        };
        let lens = lens.map_err(|error| in_file(&lens_at, error))?;
        if let Some((at, model)) = self.near_model.as_ref().filter(|_| lens != Lens::Ideal) {
            let problem = format!(
                "expected OpenCV's distortion, found {model}: undistort the images by the camera's own software, or calibrate"
            );
            return self.refused(at, problem);
        }
        let whole = Intrinsics::from_matrix(&matrix, lens).map_err(|error| in_file(&at, error))?;
        let size = self.size(&whole)?;
        let sent = self.sent()?;
        let mut unread = unread(self.camera, &self.used);
        if coefficients.is_some() {
            let names =
                |key: &str, parts: &[&str]| parts.iter().any(|part| plain(key).contains(part));
            unread.retain(|key| names(key, &OF_LENS) || size.is_none() && names(key, &OF_SIZE));
        }
        let notes = match (coefficients.is_none(), unread.is_empty()) {
            (true, false) => vec![format!(
                "no distortion found; unread keys: {}",
                listed(&unread)
            )],
            (false, false) => vec![format!("unread keys: {}", listed(&unread))],
            (_, true) => Vec::new(),
        };
        let [columns, rows] = [sent.roi[2], sent.roi[3]];
        let is_part = columns > 0.0 && rows > 0.0 && Some([columns, rows]) != size;
        let is_binned = sent.binning != [1.0; 2];
        let seen = match is_part {
            true => Some([columns, rows]),
            false => size,
        };
        Ok(CameraCalibration {
            intrinsics: whole.sent(&sent),
            size: seen.map(|seen| [0, 1].map(|k| (seen[k] / sent.binning[k]).floor())),
            whole: size
                .filter(|_| is_part || is_binned)
                .map(|size| (whole, size)),
            is_part,
            notes,
            path: self.path.to_path_buf(),
        })
    }

    /// The matrix, and the key that has it.
    fn matrix(&mut self) -> Result<(String, Matrix3<f64>)> {
        let named = MATRIX.iter().find_map(|name| {
            let value = self
                .camera
                .entries()
                .iter()
                .find(|(key, _)| bare(key) == *name)?;
            let numbers = value.1.numbers()?;
            matches!(numbers.len(), 4 | 9).then_some((value.0.clone(), numbers))
        });
        if let Some((key, numbers)) = named {
            self.used.push(bare(&key));
            let matrix = match numbers[..] {
                [fx, fy, cx, cy] => self.matrix_of([fx, fy, cx, cy])?,
                _ => {
                    self.used.push("skew".to_owned());
                    Matrix3::from_row_slice(&numbers)
                }
            };
            return self.in_pixels(key, matrix);
        }
        let mut found = [0.0; 4];
        for (number, names) in found.iter_mut().zip(FOCAL) {
            let Some(value) = self.single(names)? else {
                let problem =
                    "expected the matrix fx s cx, 0 fy cy, 0 0 1, as OpenCV and ROS write it";
                return self.refused("camera_matrix", problem);
            };
            *number = value;
        }
        if self.has("flx") {
            // NeRF's files, as COLMAP's, have pixels' centers at halves.
            found[2] -= 0.5;
            found[3] -= 0.5;
        }
        let matrix = self.matrix_of(found)?;
        self.in_pixels("fx".to_owned(), matrix)
    }

    /// The matrix of four numbers, with the skew where the file names one.
    fn matrix_of(&mut self, [fx, fy, cx, cy]: [f64; 4]) -> Result<Matrix3<f64>> {
        let skew = self.single(&["skew"])?.unwrap_or(0.0);
        Ok(Matrix3::new(fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0))
    }

    /// Refuses a matrix over the images' sides: no image has its middle in its first pixel.
    fn in_pixels(&self, key: String, k: Matrix3<f64>) -> Result<(String, Matrix3<f64>)> {
        let is_inside = |at: f64| at > 0.0 && at < 1.0;
        if is_inside(k[(0, 2)]) && is_inside(k[(1, 2)]) {
            let problem = "expected pixels, found a principal point within 1: of lengths over the images' sides?";
            return self.refused(&key, problem);
        }
        Ok((key, k))
    }

    /// A number by its name, on the camera's own level or in a mapping of parameters.
    fn single(&mut self, names: &[&str]) -> Result<Option<f64>> {
        if let Some((key, value)) = self.take(names) {
            let is_none =
                matches!(value, Value::Text(word) if ["", "null", "~"].contains(&word.trim()));
            return match value.number() {
                None if !is_none => self.refused(key, "expected a number"),
                number => Ok(number),
            };
        }
        let mut groups = self
            .camera
            .entries()
            .iter()
            .filter(|(key, _)| PARAMETERS.contains(&bare(key).as_str()));
        let Some((key, value)) = groups.find_map(|(key, group)| Some((key, group.get(names)?)))
        else {
            return Ok(None);
        };
        let Some(number) = value.number() else {
            return self.refused(key, "expected numbers");
        };
        self.used.push(bare(key));
        self.used
            .extend(names.iter().map(|name| format!("{}.{name}", bare(key))));
        Ok(Some(number))
    }

    /// Whether the coefficients are a fisheye's.
    fn is_fisheye(&mut self) -> Result<bool> {
        let mut is_fisheye = false;
        for name in MODEL {
            let Some((key, value)) = self.take(&[name]) else {
                continue;
            };
            let is_number = name == "distortion" && value.numbers().is_some();
            let (Value::Text(word), false) = (value, is_number) else {
                // No name of a model.
                self.used.pop();
                continue;
            };
            let is_flag = name.contains("fisheye");
            let own = plain(word);
            match own.strip_prefix("distortion").unwrap_or(&own) {
                "0" if name == "cameratype" => {}
                "1" if name == "cameratype" => is_fisheye = true,
                own if NEAR_MODELS.contains(&own) => {
                    self.near_model = Some((key.to_owned(), files::csv::shown(word)));
                }
                "1" | "true" | "yes" if is_flag => is_fisheye = true,
                "0" | "false" | "no" if is_flag => {}
                "" if name != "distortion" => {}
                "plumbbob" | "rationalpolynomial" | "radtan" | "radialtangential" | "opencv"
                | "opencvstandard" | "pinhole" | "brown" | "brownconrady" | "perspective"
                | "standard" | "none" | "fullopencv" | "rectified" | "pinholeradtan8"
                | "radtan8" | "simplepinhole" | "simpleradial" | "radial" => {}
                "equidistant"
                | "fisheye"
                | "equi"
                | "kannalabrandt"
                | "kannalabrandt4"
                | "kannalabrandt8"
                | "kb4"
                | "opencvfisheye"
                | "simpleradialfisheye"
                | "radialfisheye" => {
                    is_fisheye = true;
                }
                // The name of a product, as it may be.
                word if ["model", "cameramodel", "type"].contains(&name)
                    && !OTHER_MODELS.contains(&word) =>
                {
                    self.used.pop();
                }
                _ => {
                    let problem = format!(
                        "expected plumb_bob, rational_polynomial, equidistant or fisheye, found {}",
                        files::csv::shown(word)
                    );
                    return self.refused(key, problem);
                }
            }
        }
        Ok(is_fisheye)
    }

    /// The coefficients and the key that has them, as a list or one by one; `None` where there are none.
    fn coefficients(&mut self, is_fisheye: bool) -> Result<(String, Option<Vec<f64>>)> {
        let listed = DISTORTION.iter().find_map(|name| {
            let mut entries = self.camera.entries().iter();
            entries.find(|(key, value)| {
                let is_model = *name == "distortion" && matches!(value, Value::Text(_));
                bare(key) == *name
                    && (!matches!(value, Value::Map(_)) || value.get(&["data"]).is_some())
                    && (!is_model || value.numbers().is_some())
            })
        });
        if let Some((key, value)) = listed {
            self.used.push(bare(key));
            let is_none = matches!(value, Value::List(all) if all.is_empty());
            return match value.numbers() {
                None if is_none => Ok((key.clone(), Some(Vec::new()).filter(|_| !is_fisheye))),
                None => self.refused(key, "expected numbers"),
                numbers => Ok((key.clone(), numbers)),
            };
        }
        // VINS counts a fisheye's from 2 on.
        let names: Vec<&str> = match (is_fisheye, self.has("k5") && !self.has("k1")) {
            (true, true) => vec!["k2", "k3", "k4", "k5"],
            (true, false) => vec!["k1", "k2", "k3", "k4"],
            (false, _) => COEFFICIENTS.to_vec(),
        };
        let found = names.iter().map(|name| self.single(&[name]));
        let found = found.collect::<Result<Vec<Option<f64>>>>()?;
        // Agisoft's, NeRF's and others' fourth is of the numerator.
        let is_rational = self.has("k5") || self.has("k6");
        if !is_fisheye && !is_rational && found[5].is_some_and(|k4| k4 != 0.0) {
            return self.refused(
                "k4",
                "expected k5 and k6 beside it, as OpenCV's rational model has them",
            );
        }
        let Some(last) = found.iter().rposition(Option::is_some) else {
            return Ok(("distortion_coefficients".to_owned(), None));
        };
        let count = match is_fisheye {
            true => 4,
            // The numbers of coefficients that OpenCV knows.
            false => [4, 5, 8, 12].into_iter().find(|n| *n > last).unwrap_or(12),
        };
        let numbers = found.iter().take(count).map(|k| k.unwrap_or(0.0));
        Ok((names[last].to_owned(), Some(numbers.collect())))
    }

    fn has(&self, name: &str) -> bool {
        let groups = self.camera.entries().iter().map(|(_, group)| group);
        self.camera.get(&[name]).is_some()
            || groups.into_iter().any(|group| group.get(&[name]).is_some())
    }

    /// Columns and rows of the images.
    fn size(&mut self, k: &Intrinsics) -> Result<Option<[f64; 2]>> {
        let mut found = None;
        for names in SIDES {
            let [width, height] = names.map(|names| self.take(names));
            if let (Some((key, width)), Some((_, height))) = (width, height) {
                found = found.or(Some((
                    key,
                    width.number().zip(height.number()).map(|(w, h)| [w, h]),
                )));
            }
        }
        if let Some((key, value)) = self.take(&SIZES) {
            let numbers = value
                .numbers()
                .filter(|n| n.len() >= 2)
                .map(|n| [n[0], n[1]]);
            let numbers = numbers.or_else(|| {
                Some([
                    value.get(&["width", "w"])?.number()?,
                    value.get(&["height", "h"])?.number()?,
                ])
            });
            // A shape of NumPy's has the rows first: the principal point says which.
            let is_shape = plain(key).contains("shape");
            let is_swapped = |[w, h]: &[f64; 2]| is_shape && (w > h) != (k.cx > k.cy);
            let numbers = numbers.map(|size| {
                if is_swapped(&size) {
                    [size[1], size[0]]
                } else {
                    size
                }
            });
            found = found.or(Some((key, numbers)));
        }
        let is_size = |size: &[f64; 2]| {
            size.iter()
                .all(|n| n.fract() == 0.0 && (1.0..=MAX_SIDE).contains(n))
        };
        match found {
            None => Ok(None),
            // ROS' files of no calibration.
            Some((_, Some([0.0, 0.0]))) => Ok(None),
            Some((key, numbers)) => match numbers.filter(is_size) {
                Some(size) => Ok(Some(size)),
                None => self.refused(key, "expected an image's width and height in pixels"),
            },
        }
    }

    /// Binning and region.
    fn sent(&mut self) -> Result<Sent> {
        let mut binning = [1.0; 2];
        for (number, name) in binning.iter_mut().zip(["binningx", "binningy"]) {
            let Some((key, value)) = self.take(&[name]) else {
                continue;
            };
            match value
                .number()
                .filter(|n| n.fract() == 0.0 && (0.0..=64.0).contains(n))
            {
                // 0 is 1, as the message says.
                Some(n) => *number = f64::max(n, 1.0),
                None => return self.refused(key, "expected 0 to 64"),
            }
        }
        let mut roi = [0.0; 4];
        if let Some((key, value)) = self.take(&["roi"]) {
            for (number, name) in roi
                .iter_mut()
                .zip(["xoffset", "yoffset", "width", "height"])
            {
                match value.get(&[name]).map(Value::number) {
                    None => {}
                    Some(Some(n)) if n.fract() == 0.0 && (0.0..=MAX_SIDE).contains(&n) => {
                        *number = n
                    }
                    Some(_) => {
                        return self.refused(
                            key,
                            "expected x_offset, y_offset, width and height in pixels",
                        );
                    }
                }
            }
        }
        Ok(Sent { binning, roi })
    }
}

/// The keys of a camera that are not understood, as they are written.
fn unread(camera: &Value, used: &[String]) -> Vec<String> {
    let is_known = |key: &String| used.contains(key) || HARMLESS.contains(&key.as_str());
    let mut unread: Vec<String> = Vec::new();
    for (key, value) in camera.entries() {
        let own = bare(key);
        let is_group = PARAMETERS.contains(&own.as_str()) && used.contains(&own);
        let within = value.entries().iter().filter(|_| is_group);
        let left = within.filter(|(part, _)| !is_known(&format!("{own}.{}", plain(part))));
        unread.extend(left.map(|(part, _)| files::csv::shown(part)));
        if !is_known(&own) {
            unread.push(files::csv::shown(key));
        }
    }
    unread.dedup();
    unread
}
