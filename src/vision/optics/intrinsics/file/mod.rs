//! The files that calibrations are kept in, and the images that they are for.
//!
//! Read: OpenCV (YAML, JSON, XML; `calibration.cpp`, `stereo_calib.cpp`), ROS' `camera_info`, Kalibr's `camchain`, EuRoC's `sensor.yaml`,
//! VINS, ORB-SLAM, COLMAP's `cameras.txt`, and NumPy archives of a matrix and its distortion. Keys count by their letters
//! alone: `dist_coeffs`, `distCoeffs` and `Dist-Coeffs` are one. A key that is not understood is named, never dropped.
//!
//! Of a file with several cameras one is named behind a colon, as in `stereo.yml:left` or `camchain.yaml:cam0`.

mod colmap;
mod keys;
mod rig;

use std::path::{Path, PathBuf};

use nalgebra::Matrix3;

use self::colmap::of_colmap;
use self::keys::{
    COEFFICIENTS, DISTORTION, FOCAL, HARMLESS, MATRIX, MODEL, OF_LENS, OTHER_MODELS, PARAMETERS,
    SIDES, SIZES, bare,
};
use self::rig::cameras;
use super::tree::{Value, of_xml, of_yaml, plain};
use super::{Intrinsics, Lens};
use crate::error::{Error, Result};
use crate::files;
use crate::npz;

/// Bytes of the largest file of intrinsics.
const MAX_BYTES: u64 = 1 << 20;
/// Unread keys that are named.
const MAX_NAMED: usize = 5;
/// Width and height of an image, pixels, at most.
const MAX_SIDE: f64 = 1e6;

/// The part of the sensor that a camera sends, as `sensor_msgs/CameraInfo` has it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Sent {
    /// Pixels of the sensor for one of the image.
    binning: [f64; 2],
    /// Its first column and row, its columns and rows; no columns for all of it.
    roi: [f64; 4],
}

/// Intrinsics with the images that they are for.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Of the images that the file describes.
    pub intrinsics: Intrinsics,
    /// Columns and rows of these images, where the file says.
    pub size: Option<[f64; 2]>,
    /// The whole sensor's, where the images are a part of it or binned.
    whole: Option<(Intrinsics, [f64; 2])>,
    /// Whether the images are a part of the sensor.
    is_part: bool,
    /// What is to be known of the file, in words.
    pub notes: Vec<String>,
    path: PathBuf,
}

impl Calibration {
    /// Reads a calibration's file; `FILE:NAME` names one of its cameras.
    ///
    /// # Errors
    /// [`Error::Read`] where the system refuses; [`Error::Input`] naming the field that is not as expected.
    pub fn read(path: &Path) -> Result<Self> {
        let named = path.to_str().and_then(|text| text.rsplit_once(':'));
        let (file, name) = match named {
            Some((file, name))
                if !path.exists() && !name.is_empty() && Path::new(file).exists() =>
            {
                (PathBuf::from(file), Some(name))
            }
            _ => (path.to_path_buf(), None),
        };
        let bytes = files::read_at_most(&file, MAX_BYTES)?;
        Self::from_bytes(&file, name, &bytes)
    }

    /// As [`read`](Self::read), from the file's bytes; `path` is for errors, `name` that of one of several cameras.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is not as expected.
    pub fn from_bytes(path: &Path, name: Option<&str>, bytes: &[u8]) -> Result<Self> {
        if bytes.starts_with(b"PK") {
            let tree = of_npz(bytes).map_err(|p| Error::input(path, p.place, p.problem))?;
            return Self::of_tree(path, name, &tree);
        }
        let text = std::str::from_utf8(bytes);
        let text =
            text.map_err(|_| Error::input(path, "file", "expected YAML, JSON, XML or NPZ"))?;
        Self::from_text(path, name, text)
    }

    /// As [`from_bytes`](Self::from_bytes), from text.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is not as expected.
    pub fn from_text(path: &Path, name: Option<&str>, text: &str) -> Result<Self> {
        let text = text.trim_start_matches('\u{feff}');
        if let Some(tree) = of_colmap(text) {
            let tree = tree.map_err(|problem| Error::input(path, "cameras", problem))?;
            return Self::of_tree(path, name, &tree);
        }
        let tree = match text.trim_start().starts_with('<') {
            true => of_xml(text).map_err(|e| format!("expected OpenCV's XML, found {e}")),
            false => of_yaml(text).map_err(|e| format!("expected YAML or JSON, found {e}")),
        };
        let tree = tree.map_err(|problem| Error::input(path, "file", problem))?;
        Self::of_tree(path, name, &tree)
    }

    fn of_tree(path: &Path, name: Option<&str>, tree: &Value) -> Result<Self> {
        let cameras = cameras(tree);
        let names: Vec<&str> = cameras.iter().map(|(name, _)| name.as_str()).collect();
        let chosen = match (cameras.as_slice(), name) {
            ([], _) => None,
            ([(_, camera)], None) => Some(camera),
            (_, None) => {
                let problem = format!(
                    "expected one camera, found {}: FILE:{} names one",
                    names.join(", "),
                    names[0]
                );
                return Err(Error::input(path, "cameras", problem));
            }
            (_, Some(name)) => match cameras.iter().find(|(own, _)| plain(own) == plain(name)) {
                Some((_, camera)) => Some(camera),
                None => {
                    let problem = format!(
                        "expected {}, found {}",
                        names.join(" or "),
                        files::csv::shown(name)
                    );
                    return Err(Error::input(path, "cameras", problem));
                }
            },
        };
        let Some(camera) = chosen else {
            let found = unread(tree, &[]);
            let keys = match found.is_empty() {
                true => String::new(),
                false => format!("; keys found: {}", listed(&found)),
            };
            let problem = format!(
                "expected the matrix fx s cx, 0 fy cy, 0 0 1, as OpenCV and ROS write it{keys}"
            );
            return Err(Error::input(path, "camera_matrix", problem));
        };
        Reader {
            path,
            camera,
            used: Vec::new(),
        }
        .read()
    }

    /// The intrinsics for images of this size, and what was done to them in words: as the file has them, or scaled
    /// where the images have the same aspect.
    ///
    /// # Errors
    /// [`Error::Input`] for images of another aspect, or of another size than the part of the sensor that the file
    /// describes.
    pub fn for_image(&self, [width, height]: [usize; 2]) -> Result<(Intrinsics, Option<String>)> {
        let image = [width as f64, height as f64];
        let Some(size) = self.size.filter(|size| *size != image) else {
            return Ok((self.intrinsics, None));
        };
        if let Some((whole, _)) = self.whole.filter(|(_, size)| *size == image) {
            let words = format!(
                "intrinsics of the whole sensor, {width} x {height}, without the file's binning and region"
            );
            return Ok((whole, Some(words)));
        }
        let [across, down] = [image[0] / size[0], image[1] / size[1]];
        // Within a pixel of rounding.
        let is_alike = (across - down).abs() * size[0].max(size[1]) <= across.max(1.0);
        if self.is_part || !is_alike {
            let problem = format!(
                "expected the calibration of images of {width} x {height}, found one of {} x {}{}",
                size[0],
                size[1],
                if self.is_part {
                    ", a part of the sensor"
                } else {
                    ", another aspect: how they were cropped is not known"
                }
            );
            return Err(Error::input(&self.path, "image_width", problem));
        }
        let words = format!(
            "intrinsics of {} x {} scaled to {width} x {height}",
            size[0], size[1]
        );
        Ok((self.intrinsics.scaled([across, down]), Some(words)))
    }
}

/// Reads one camera, and notes which keys it understands.
struct Reader<'a> {
    path: &'a Path,
    camera: &'a Value,
    used: Vec<String>,
}

impl<'a> Reader<'a> {
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

    fn read(mut self) -> Result<Calibration> {
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
        let whole = Intrinsics::from_matrix(&matrix, lens).map_err(|error| in_file(&at, error))?;
        let size = self.size(&whole)?;
        let sent = self.sent()?;
        let mut unread = unread(self.camera, &self.used);
        if coefficients.is_some() {
            unread.retain(|key| OF_LENS.iter().any(|part| plain(key).contains(part)));
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
        Ok(Calibration {
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
                [fx, fy, cx, cy] => Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
                _ => Matrix3::from_row_slice(&numbers),
            };
            return Ok((key, matrix));
        }
        let mut found = [0.0; 4];
        for (number, names) in found.iter_mut().zip(FOCAL) {
            let Some(value) = self.single(names) else {
                let problem =
                    "expected the matrix fx s cx, 0 fy cy, 0 0 1, as OpenCV and ROS write it";
                return self.refused("camera_matrix", problem);
            };
            *number = value;
        }
        let [fx, fy, cx, cy] = found;
        Ok((
            "fx".to_owned(),
            Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
        ))
    }

    /// A number by its name, on the camera's own level or in a mapping of parameters.
    fn single(&mut self, names: &[&str]) -> Option<f64> {
        if let Some(number) = self.take(names).and_then(|(_, value)| value.number()) {
            return Some(number);
        }
        let mut groups = self
            .camera
            .entries()
            .iter()
            .filter(|(key, _)| PARAMETERS.contains(&bare(key).as_str()));
        let (key, number) =
            groups.find_map(|(key, group)| Some((key, group.get(names)?.number()?)))?;
        self.used.push(bare(key));
        Some(number)
    }

    /// Whether the coefficients are a fisheye's.
    fn is_fisheye(&mut self) -> Result<bool> {
        let mut is_fisheye = false;
        for name in MODEL {
            let Some((key, value)) = self.take(&[name]) else {
                continue;
            };
            let Value::Text(word) = value else { continue };
            let is_flag = name.starts_with("fisheye");
            match plain(word).as_str() {
                "1" | "true" | "yes" if is_flag => is_fisheye = true,
                "0" | "false" | "no" if is_flag => {}
                "" | "plumbbob" | "rationalpolynomial" | "radtan" | "radialtangential"
                | "opencv" | "pinhole" | "brown" | "brownconrady" | "perspective" | "standard"
                | "none" | "fullopencv" | "rectified" => {}
                "equidistant" | "fisheye" | "equi" | "kannalabrandt" | "kannalabrandt4"
                | "kannalabrandt8" | "opencvfisheye" => {
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
                bare(key) == *name && !matches!(value, Value::Map(_))
                    || bare(key) == *name && value.get(&["data"]).is_some()
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
        let found: Vec<Option<f64>> = names.iter().map(|name| self.single(&[name])).collect();
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
                    value.get(&["width"])?.number()?,
                    value.get(&["height"])?.number()?,
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

impl Intrinsics {
    /// Those of an image so many times as wide and high: pixels' centers keep their place.
    #[must_use]
    pub(crate) fn scaled(&self, [across, down]: [f64; 2]) -> Self {
        Self {
            fx: across * self.fx,
            fy: down * self.fy,
            skew: across * self.skew,
            cx: across * (self.cx + 0.5) - 0.5,
            cy: down * (self.cy + 0.5) - 0.5,
            lens: self.lens,
        }
    }

    /// Those of the part of the sensor that a camera sends, as ROS' `image_geometry` has them: the corner's offset,
    /// then the binning.
    fn sent(&self, sent: &Sent) -> Self {
        let ([x, y], [left, top, ..]) = (sent.binning, sent.roi);
        Self {
            fx: self.fx / x,
            fy: self.fy / y,
            skew: self.skew / x,
            cx: (self.cx - left) / x,
            cy: (self.cy - top) / y,
            lens: self.lens,
        }
    }
}

/// The keys of a camera that are not understood, as they are written.
fn unread(camera: &Value, used: &[String]) -> Vec<String> {
    let is_known = |key: &str| used.contains(&key.to_owned()) || HARMLESS.contains(&key);
    let entries = camera.entries().iter();
    let mut unread: Vec<String> = entries
        .filter(|(key, _)| !is_known(&bare(key)))
        .map(|(key, _)| files::csv::shown(key))
        .collect();
    unread.dedup();
    unread
}

fn listed(keys: &[String]) -> String {
    let more = if keys.len() > MAX_NAMED { ", ..." } else { "" };
    format!(
        "{}{more}",
        keys.iter()
            .take(MAX_NAMED)
            .cloned()
            .collect::<Vec<_>>()
            .join(", ")
    )
}

/// The matrices and vectors of a NumPy archive.
fn of_npz(bytes: &[u8]) -> npz::Checked<Value> {
    let arrays = npz::small_arrays(bytes)?;
    let text = |x: &f64| Value::Text(x.to_string());
    let entries = arrays.iter().map(|(name, numbers)| {
        let value = match numbers.as_slice() {
            [one] => text(one),
            all => Value::List(all.iter().map(text).collect()),
        };
        (name.clone(), value)
    });
    Ok(Value::Map(entries.collect()))
}
