//! The files that calibrations are kept in, and the images that they are for.
//!
//! Read: OpenCV (YAML, JSON, XML; `calibration.cpp`, `stereo_calib.cpp`), ROS' `camera_info`, Kalibr's `camchain`, EuRoC's `sensor.yaml`,
//! VINS, ORB-SLAM, COLMAP's `cameras.txt`, OpenSfM, NeRF's `transforms.json`, librealsense, ZED's `SN*.conf`, MATLAB (as JSON), and NumPy
//! archives of a matrix and its distortion. Keys count by their letters alone: `dist_coeffs`, `distCoeffs` and `Dist-Coeffs` are one. A key
//! that is not understood is named, never dropped.
//!
//! Of a file with several cameras one is named behind a colon, as in `stereo.yml:left` or `camchain.yaml:cam0`.

mod colmap;
mod extrinsics;
mod foreign;
mod keys;
mod reader;
mod rig;

use std::path::{Path, PathBuf};

use self::colmap::of_colmap;
use self::reader::Reader;
use self::rig::cameras;
use super::Intrinsics;
use super::tree::{Value, is_ini, of_ini, of_xml, of_yaml, plain};
use crate::error::{Error, Result};
use crate::files;
use crate::npz;
use crate::vision::optics::rig::RigCamera;

/// Bytes of the largest file of intrinsics.
const MAX_BYTES: u64 = 1 << 20;
/// Unread keys that are named.
const MAX_NAMED: usize = 5;

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
pub struct CameraCalibration {
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

impl CameraCalibration {
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

    /// Intrinsics that no file has, and columns and rows of the images that they are for.
    pub fn new(intrinsics: Intrinsics, size: Option<[usize; 2]>) -> Self {
        Self {
            intrinsics,
            size: size.map(|size| size.map(|n| n as f64)),
            whole: None,
            is_part: false,
            notes: Vec::new(),
            path: PathBuf::from("intrinsics"),
        }
    }

    /// The cameras of a rig's file, with the extrinsics of each from a frame that all have in common.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub(in crate::vision::optics) fn read_rig(path: &Path) -> Result<Vec<RigCamera>> {
        let bytes = files::read_at_most(path, MAX_BYTES)?;
        extrinsics::rig(path, &tree_of(path, &bytes)?)
    }

    /// As [`read`](Self::read), from the file's bytes; `path` is for errors, `name` that of one of several cameras.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is not as expected.
    pub fn from_bytes(path: &Path, name: Option<&str>, bytes: &[u8]) -> Result<Self> {
        Self::of_tree(path, name, &tree_of(path, bytes)?)
    }

    /// As [`from_bytes`](Self::from_bytes), from text.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is not as expected.
    pub fn from_text(path: &Path, name: Option<&str>, text: &str) -> Result<Self> {
        Self::of_tree(path, name, &tree_of_text(path, text)?)
    }

    fn of_tree(path: &Path, name: Option<&str>, tree: &Value) -> Result<Self> {
        let cameras = cameras(tree);
        let names = cameras.iter().map(|(name, _)| files::csv::shown(name));
        let names: Vec<String> = names.collect();
        let chosen = match (cameras.as_slice(), name) {
            ([], _) => None,
            ([(_, camera)], None) => Some(camera),
            (_, None) => {
                let problem = format!(
                    "expected one camera, found {}: FILE:{} names one",
                    listed(&names),
                    names[0]
                );
                return Err(Error::input(path, "cameras", problem));
            }
            (_, Some(name)) => match cameras.iter().find(|(own, _)| plain(own) == plain(name)) {
                Some((_, camera)) => Some(camera),
                None => {
                    let problem = format!(
                        "expected {}, found {}",
                        joined(&names, " or "),
                        files::csv::shown(name)
                    );
                    return Err(Error::input(path, "cameras", problem));
                }
            },
        };
        // Metashape and PhotoScan count the principal point from the middle, and swap the tangential coefficients.
        if tree.get(&["projection"]).is_some() && tree.get(&["f", "fx"]).is_some() {
            let problem = "expected OpenCV's matrix, found Metashape's own calibration: export it there as OpenCV's XML";
            return Err(Error::input(path, "projection", problem));
        }
        let Some(camera) = chosen else {
            let found = keys_of(tree);
            let keys = match found.is_empty() {
                true => String::new(),
                false => format!("; keys found: {}", listed(&found)),
            };
            let problem = format!(
                "expected the matrix fx s cx, 0 fy cy, 0 0 1, as OpenCV and ROS write it{keys}"
            );
            return Err(Error::input(path, "camera_matrix", problem));
        };
        Self::of_camera(path, camera)
    }

    /// That of one camera of a file.
    fn of_camera(path: &Path, camera: &Value) -> Result<Self> {
        let camera = foreign::as_opencv(camera);
        let camera = camera.map_err(|problem| Error::input(path, "camera", problem))?;
        Reader::new(path, &camera).read()
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

/// What a file's bytes hold.
fn tree_of(path: &Path, bytes: &[u8]) -> Result<Value> {
    if bytes.starts_with(b"PK") {
        return of_npz(bytes).map_err(|p| Error::input(path, p.place, p.problem));
    }
    let text = std::str::from_utf8(bytes);
    let text = text.map_err(|_| Error::input(path, "file", "expected YAML, JSON, XML or NPZ"))?;
    tree_of_text(path, text)
}

/// What a text holds.
fn tree_of_text(path: &Path, text: &str) -> Result<Value> {
    let text = text.trim_start_matches('\u{feff}');
    if let Some(tree) = of_colmap(text) {
        return tree.map_err(|problem| Error::input(path, "cameras", problem));
    }
    let tree = match text.trim_start().starts_with('<') {
        true => of_xml(text).map_err(|e| format!("expected OpenCV's XML, found {e}")),
        false if is_ini(text) => Ok(of_ini(text)),
        false => of_yaml(text).map_err(|e| format!("expected YAML or JSON, found {e}")),
    };
    tree.map_err(|problem| Error::input(path, "file", problem))
}

/// The keys of a file without a camera; of one that holds a single mapping, those within.
fn keys_of(tree: &Value) -> Vec<String> {
    match tree {
        Value::Map(entries) => match entries.as_slice() {
            [(_, inner @ (Value::Map(_) | Value::List(_)))] if !keys_of(inner).is_empty() => {
                keys_of(inner)
            }
            entries => entries
                .iter()
                .map(|(key, _)| files::csv::shown(key))
                .collect(),
        },
        Value::List(values) => values.first().map(keys_of).unwrap_or_default(),
        Value::Text(_) => Vec::new(),
    }
}

fn listed(keys: &[String]) -> String {
    joined(keys, ", ")
}

/// The first of some words, and whether there are more.
fn joined(words: &[String], separator: &str) -> String {
    let more = if words.len() > MAX_NAMED { ", ..." } else { "" };
    let first = &words[..words.len().min(MAX_NAMED)];
    format!("{}{more}", first.join(separator))
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
