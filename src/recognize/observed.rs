//! The file of observed dots: what a dot detector writes and `identify` reads.
//!
//! CSV with a header, one dot a row, the rows of one frame together:
//!
//! ```text
//! frame,x,y,z[,time_s][,sigma_deg][,var_radial_deg2,cov_deg2,var_across_deg2]
//! ```
//!
//! `frame` is any text, `x,y,z` the unit vector from the ball's center to the dot in the camera frame (x
//! right, y up, z towards the camera). Optional are the frame's time in seconds, and how far off a dot may
//! be: `sigma_deg`, the standard deviation along any one tangent axis, or a covariance in degrees squared,
//! whose first axis points radially outward in the image (towards the limb, along growing angle from z)
//! and whose second axis is `direction x first`, counter-clockwise as the camera sees it. For a dot
//! exactly on the z axis the first axis is x. Empty fields mean that nothing is known.
//!
//! Guarantees: directions are finite and of unit length, covariances positive definite, no frame occurs
//! twice; everything else is refused with the line and the field.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Matrix2;

use super::{DotUncertainty, ObservedDot};
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::{Spherical, Vec3, tangent_frame};
use crate::pattern::{LENGTH_ROUNDING, LENGTH_TOLERANCE};

const COLUMNS: [&str; 9] = [
    "frame",
    "x",
    "y",
    "z",
    "time_s",
    "sigma_deg",
    "var_radial_deg2",
    "cov_deg2",
    "var_across_deg2",
];
/// How many of [`COLUMNS`] a file must have.
const INDISPENSABLE: usize = 4;
/// Dots nearer to the z axis than this (sine) have no outward direction.
const CENTRE: f64 = 1e-12;

/// The dots seen in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedFrame {
    /// The frame's name.
    pub name: String,
    /// Time of the image in seconds, where the file gives it.
    pub time_s: Option<f64>,
    /// The dots, camera frame.
    pub dots: Vec<ObservedDot>,
}

impl ObservedFrame {
    /// The frame's time in seconds: as given, or from a name that is a whole number of nanoseconds.
    pub fn time_or_name_s(&self) -> Option<f64> {
        self.time_s
            .or_else(|| self.name.parse::<u64>().ok().map(|ns| ns as f64 * 1e-9))
    }
}

/// Unit tangent vectors at a direction: outward in the image, and counter-clockwise across.
pub fn image_axes(direction: &Vec3) -> [Vec3; 2] {
    if direction.xy().norm() < CENTRE {
        return [Vec3::x(), direction.cross(&Vec3::x())];
    }
    let outward = Spherical::from_direction(direction).jacobian().d_theta;
    [outward, direction.cross(&outward)]
}

/// Reads a file of observed dots. Dots of which no uncertainty is given get `sigma_rad` (radians, along
/// one tangent axis).
///
/// # Errors
/// [`Error::Read`], or [`Error::Input`] naming the line and what was expected there.
pub fn read_csv(path: &Path, sigma_rad: f64) -> Result<Vec<ObservedFrame>> {
    let bytes = files::read_bytes(path)?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(bytes.as_slice());
    let header = reader
        .headers()
        .map_err(|e| Error::input(path, "line 1", e.to_string()))?;
    let columns = find_columns(header).map_err(|p| Error::input(path, "line 1", p))?;
    let mut frames: Vec<ObservedFrame> = Vec::new();
    let mut names = HashSet::new();
    for (i, record) in reader.records().enumerate() {
        let at = |line: u64, problem| Error::input(path, format!("line {line}"), problem);
        let record = record.map_err(|e| {
            let line = files::line_of(&bytes, e.position(), i as u64 + 2);
            at(line, uneven(&e))
        })?;
        let line = files::line_of(&bytes, record.position(), i as u64 + 2);
        let row = Row { record, columns };
        let name = row.text(0).unwrap_or_default();
        let time_s = row.number(4).map_err(|p| at(line, p))?;
        let dot = row.dot(sigma_rad).map_err(|p| at(line, p))?;
        match frames.last_mut().filter(|f| f.name == name) {
            Some(frame) if frame.time_s == time_s => frame.dots.push(dot),
            Some(_) => {
                let problem = "time_s: expected one time for all dots of a frame";
                return Err(at(line, problem.into()));
            }
            None if names.insert(name.to_owned()) => frames.push(ObservedFrame {
                name: name.to_owned(),
                time_s,
                dots: vec![dot],
            }),
            None => {
                let problem = format!("frame: expected the rows of \"{name}\" to stand together");
                return Err(at(line, problem));
            }
        }
    }
    if frames.is_empty() {
        return Err(Error::input(path, "file", "expected at least one dot"));
    }
    Ok(frames)
}

/// The text of a file of observed dots, digits enough to read the directions back bit by bit.
pub fn to_csv(frames: &[ObservedFrame]) -> String {
    let mut text = COLUMNS.join(",");
    text.push('\n');
    for frame in frames {
        let name = csv_field(&frame.name);
        let time = frame.time_s.map_or(String::new(), |t| t.to_string());
        for dot in &frame.dots {
            let d = &dot.direction;
            let uncertainty = match dot.uncertainty {
                DotUncertainty::Isotropic { sigma_rad } => format!("{},,,", sigma_rad.to_degrees()),
                DotUncertainty::Tangent { covariance } => {
                    let c = turned(&covariance, &tangent_frame(d), &image_axes(d));
                    let degrees = 1f64.to_degrees().powi(2);
                    let [radial, mixed, across] =
                        [c[(0, 0)], c[(0, 1)], c[(1, 1)]].map(|x| x * degrees);
                    format!(",{radial},{mixed},{across}")
                }
            };
            // Writing to a String cannot fail.
            let _ = writeln!(text, "{name},{},{},{},{time},{uncertainty}", d.x, d.y, d.z);
        }
    }
    text
}

/// A covariance in the axes `to` instead of `from`, both orthonormal bases of one plane.
fn turned(covariance: &Matrix2<f64>, from: &[Vec3; 2], to: &[Vec3; 2]) -> Matrix2<f64> {
    let turn = Matrix2::from_fn(|i, j| to[i].dot(&from[j]));
    turn * covariance * turn.transpose()
}

/// Where each of [`COLUMNS`] stands.
fn find_columns(header: &csv::StringRecord) -> std::result::Result<[Option<usize>; 9], String> {
    for name in COLUMNS {
        if header.iter().filter(|h| *h == name).count() > 1 {
            return Err(format!("column {name} occurs more than once"));
        }
    }
    let places = COLUMNS.map(|name| header.iter().position(|h| h == name));
    let missing = |range: std::ops::Range<usize>| range.clone().find(|&i| places[i].is_none());
    if let Some(i) = missing(0..INDISPENSABLE) {
        let found = header.iter().collect::<Vec<_>>().join(",");
        return Err(format!(
            "expected a header with {} (frame,x,y,z), found \"{found}\"",
            COLUMNS[i]
        ));
    }
    let covariance = 6..9;
    if let Some(i) =
        missing(covariance.clone()).filter(|_| covariance.clone().any(|i| places[i].is_some()))
    {
        let problem = "expected all of var_radial_deg2,cov_deg2,var_across_deg2 or none of them";
        return Err(format!("{problem}, {} is missing", COLUMNS[i]));
    }
    Ok(places)
}

/// A record's problem in words.
fn uneven(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => format!("expected {expected_len} fields as in the header, found {len}"),
        _ => error.to_string(),
    }
}

/// A line of the file.
struct Row {
    record: csv::StringRecord,
    columns: [Option<usize>; 9],
}

impl Row {
    fn text(&self, column: usize) -> Option<&str> {
        self.columns[column]
            .and_then(|c| self.record.get(c))
            .filter(|f| !f.is_empty())
    }

    fn number(&self, column: usize) -> std::result::Result<Option<f64>, String> {
        let Some(text) = self.text(column) else {
            return Ok(None);
        };
        match text.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(Some(x)),
            _ => Err(format!(
                "{}: expected a finite number, found \"{text}\"",
                COLUMNS[column]
            )),
        }
    }

    fn dot(&self, sigma_rad: f64) -> std::result::Result<ObservedDot, String> {
        let mut direction = Vec3::zeros();
        for axis in 0..3 {
            let missing = || format!("{}: expected a number, found nothing", COLUMNS[axis + 1]);
            direction[axis] = self.number(axis + 1)?.ok_or_else(missing)?;
        }
        let length = direction.norm();
        if (length - 1.0).abs() > LENGTH_TOLERANCE {
            return Err(format!(
                "x,y,z: expected a unit vector, found one of length {length:.6}"
            ));
        }
        if (length - 1.0).abs() > LENGTH_ROUNDING {
            direction /= length;
        }
        let uncertainty = self.uncertainty(&direction, sigma_rad)?;
        Ok(ObservedDot {
            direction,
            uncertainty,
        })
    }

    fn uncertainty(
        &self,
        direction: &Vec3,
        sigma_rad: f64,
    ) -> std::result::Result<DotUncertainty, String> {
        let sigma = self.number(5)?;
        let covariance = match [self.number(6)?, self.number(7)?, self.number(8)?] {
            [None, None, None] => None,
            [Some(radial), Some(mixed), Some(across)] => Some((radial, mixed, across)),
            _ => {
                return Err(
                    "expected all of var_radial_deg2,cov_deg2,var_across_deg2 or none of them"
                        .into(),
                );
            }
        };
        match (sigma, covariance) {
            (None, None) => Ok(DotUncertainty::Isotropic { sigma_rad }),
            (Some(deg), None) if deg > 0.0 => Ok(DotUncertainty::Isotropic {
                sigma_rad: deg.to_radians(),
            }),
            (Some(deg), None) => Err(format!(
                "sigma_deg: expected a positive number, found {deg}"
            )),
            (None, Some((radial, mixed, across))) => {
                if !(radial > 0.0 && across > 0.0 && radial * across > mixed * mixed) {
                    return Err(format!(
                        "var_radial_deg2,cov_deg2,var_across_deg2: expected a positive definite covariance, found {radial},{mixed},{across}"
                    ));
                }
                let rad2 = 1f64.to_radians().powi(2);
                let image = Matrix2::new(radial, mixed, mixed, across) * rad2;
                let covariance = turned(&image, &image_axes(direction), &tangent_frame(direction));
                Ok(DotUncertainty::Tangent { covariance })
            }
            (Some(_), Some(_)) => Err("sigma_deg: expected it or a covariance, found both".into()),
        }
    }
}

/// A field of text; quoted where CSV demands it.
fn csv_field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r', '#']) || text.trim() != text {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}
