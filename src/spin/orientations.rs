//! The orientations file: what identification writes and the spin estimators read.
//!
//! CSV with a header, one frame a row, in order of time:
//!
//! ```text
//! frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence
//! ```
//!
//! `frame` is any text, `time_s` seconds in any one time base, `qw,qx,qy,qz` the unit quaternion that
//! maps the pattern's frame to the camera's (scalar first; SciPy and ROS put it last), all four fields
//! empty where the identification gave up; `dots` seen and `matched`, the matched dots' RMS angular
//! `residual_deg`, and the `confidence` in [0, 1] that the identification is right. Only `time_s` and
//! the quaternion are indispensable; other columns may be missing or empty, and unknown ones are
//! passed over.
//!
//! Guarantees: what is read has finite numbers, unit quaternions and increasing times; everything
//! else is refused with the line that is at fault.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Quaternion;

use super::{DEFAULT_CONFIDENCE, Measurement};
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::Rotation;

/// Largest deviation of a quaternion's length from 1 that is normalized instead of refused: six
/// decimals are kept by most writers, three by the most careless.
pub const LENGTH_TOLERANCE: f64 = 2e-3;
/// A frame's noise scale is kept within this factor of the common noise either way: the residual of a
/// handful of dots is itself a rough number.
const SCALE_LIMIT: f64 = 2.0;
/// Dots of average quality that a frame's residual is averaged with, for the same reason.
const RESIDUAL_PRIOR_DOTS: f64 = 4.0;

/// The columns, in the order in which they are written.
const COLUMNS: [&str; 10] = [
    "frame",
    "time_s",
    "qw",
    "qx",
    "qy",
    "qz",
    "dots",
    "matched",
    "residual_deg",
    "confidence",
];
/// How many of [`COLUMNS`] after the first a file must have: the time and the quaternion.
const INDISPENSABLE: std::ops::Range<usize> = 1..6;

/// One frame of an orientations file.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientationRow {
    /// The frame's name; empty where the file has none.
    pub frame: String,
    /// Time, seconds; NaN, an empty field in the file, where a frame has none. What is read has one.
    pub time_s: f64,
    /// Pattern to camera; `None` where the identification gave up.
    pub orientation: Option<Rotation>,
    /// Dots seen.
    pub dots: Option<usize>,
    /// Dots matched.
    pub matched: Option<usize>,
    /// RMS angular residual of the matched dots, radians.
    pub residual_rad: Option<f64>,
    /// Probability that the orientation is right, in [0, 1].
    pub confidence: Option<f64>,
}

/// The frames of a file, in order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Orientations {
    /// The frames.
    pub rows: Vec<OrientationRow>,
}

impl Orientations {
    /// Frames with measured orientations and nothing else known of them, named by their number.
    pub fn from_measurements(measurements: &[Measurement]) -> Self {
        let row = |(i, m): (usize, &Measurement)| OrientationRow {
            frame: i.to_string(),
            time_s: m.time_s,
            orientation: Some(m.orientation),
            dots: None,
            matched: None,
            residual_rad: None,
            confidence: Some(m.confidence),
        };
        Self {
            rows: measurements.iter().enumerate().map(row).collect(),
        }
    }

    /// Reads an orientations file.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Input`] naming the line and what was expected there.
    pub fn read_csv(path: &Path) -> Result<Self> {
        let bytes = files::read_bytes(path)?;
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(bytes.as_slice());
        let header = reader
            .headers()
            .map_err(|e| Error::input(path, "line 1", e.to_string()))?;
        let columns = find_columns(header).map_err(|p| Error::input(path, "line 1", p))?;
        let mut rows: Vec<OrientationRow> = Vec::new();
        for (i, record) in reader.records().enumerate() {
            let at = |line: u64, problem| Error::input(path, format!("line {line}"), problem);
            let record = record.map_err(|e| {
                let line = files::line_of(&bytes, e.position(), i as u64 + 2);
                at(line, uneven(&e))
            })?;
            let line = files::line_of(&bytes, record.position(), i as u64 + 2);
            let row = parse(&record, &columns).map_err(|problem| at(line, problem))?;
            if let Some(before) = rows.last().filter(|r| r.time_s >= row.time_s) {
                let problem = format!(
                    "expected a time later than the {} s before it, found {} s",
                    before.time_s, row.time_s
                );
                return Err(at(line, problem));
            }
            rows.push(row);
        }
        Ok(Self { rows })
    }

    /// The file's text; quaternions scalar first with `qw >= 0`, digits enough to read back the same
    /// bits.
    pub fn to_csv(&self) -> String {
        let mut text = COLUMNS.join(",");
        text.push('\n');
        for row in &self.rows {
            let frame = quoted(&row.frame);
            let quaternion = row.orientation.map_or(",,,".to_owned(), |r| {
                let q = r.into_inner();
                let q = if q.w < 0.0 { -q } else { q };
                format!("{},{},{},{}", q.w, q.i, q.j, q.k)
            });
            // Writing to a String cannot fail.
            let _ = writeln!(
                text,
                "{frame},{},{quaternion},{},{},{},{}",
                optional(row.time_s.is_finite().then_some(row.time_s)),
                optional(row.dots),
                optional(row.matched),
                optional(row.residual_rad.map(f64::to_degrees)),
                optional(row.confidence),
            );
        }
        text
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write_csv(&self, path: &Path) -> Result<()> {
        files::write_bytes(path, self.to_csv().as_bytes())
    }

    /// What the estimators work on: the frames that have an orientation.
    ///
    /// Where residuals and dot counts are given, a frame's noise follows from them: `n` dots spread
    /// over the ball with noise `s` fix each axis of the orientation to `s sqrt(3 / (2 n))`, so that
    /// the scale is `s / sqrt(n)` relative to the median frame's.
    pub fn measurements(&self) -> Vec<Measurement> {
        let answered = || self.rows.iter().filter(|r| r.orientation.is_some());
        let mut residuals: Vec<f64> = answered()
            .filter_map(|r| r.residual_rad)
            .filter(|r| *r > 0.0)
            .collect();
        let typical = crate::validate::median(&mut residuals);
        let noise = |r: &OrientationRow| match (r.residual_rad, r.matched) {
            (Some(residual), Some(n)) if typical > 0.0 && n > 0 => {
                let n = n as f64;
                let squares = RESIDUAL_PRIOR_DOTS * typical * typical + n * residual * residual;
                (squares / (RESIDUAL_PRIOR_DOTS + n) / n).sqrt()
            }
            _ => 0.0,
        };
        let mut known: Vec<f64> = answered().map(noise).filter(|s| *s > 0.0).collect();
        let common = crate::validate::median(&mut known);
        let measurement = |r: &OrientationRow| {
            let sigma_scale = match noise(r) {
                s if s > 0.0 => (s / common).clamp(1.0 / SCALE_LIMIT, SCALE_LIMIT),
                _ => 1.0,
            };
            r.orientation.map(|orientation| Measurement {
                time_s: r.time_s,
                orientation,
                confidence: r.confidence.unwrap_or(DEFAULT_CONFIDENCE),
                sigma_scale,
            })
        };
        self.rows.iter().filter_map(measurement).collect()
    }
}

/// Where each of [`COLUMNS`] stands.
fn find_columns(header: &csv::StringRecord) -> std::result::Result<[Option<usize>; 10], String> {
    let places = COLUMNS.map(|name| header.iter().position(|h| h == name));
    for name in COLUMNS {
        if header.iter().filter(|h| *h == name).count() > 1 {
            return Err(format!("column {name} occurs more than once"));
        }
    }
    for i in INDISPENSABLE {
        if places[i].is_none() {
            let found = header.iter().collect::<Vec<_>>().join(",");
            let missing = COLUMNS[i];
            return Err(format!(
                "expected a header with {missing} (frame,time_s,qw,qx,qy,qz,...), found \"{found}\""
            ));
        }
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

fn parse(
    record: &csv::StringRecord,
    columns: &[Option<usize>; 10],
) -> std::result::Result<OrientationRow, String> {
    let field = |i: usize| {
        columns[i]
            .and_then(|c| record.get(c))
            .filter(|f| !f.is_empty())
    };
    let number = |i: usize| match field(i) {
        None => Ok(None),
        Some(text) => match text.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(Some(x)),
            _ => Err(format!(
                "{}: expected a finite number, found \"{text}\"",
                COLUMNS[i]
            )),
        },
    };
    let count = |i: usize| match field(i).map(str::parse::<usize>) {
        None => Ok(None),
        Some(Ok(n)) => Ok(Some(n)),
        Some(Err(_)) => Err(format!(
            "{}: expected a whole number, found \"{}\"",
            COLUMNS[i],
            field(i).unwrap_or_default()
        )),
    };
    let confidence = number(9)?;
    if let Some(c) = confidence.filter(|c| !(0.0..=1.0).contains(c)) {
        return Err(format!("confidence: expected 0 to 1, found {c}"));
    }
    let residual_deg = number(8)?;
    if let Some(r) = residual_deg.filter(|r| *r < 0.0) {
        return Err(format!("residual_deg: expected 0 or more, found {r}"));
    }
    Ok(OrientationRow {
        frame: field(0).unwrap_or_default().to_owned(),
        time_s: number(1)?.ok_or("time_s: expected a time in seconds, found nothing")?,
        orientation: quaternion([number(2)?, number(3)?, number(4)?, number(5)?])?,
        dots: count(6)?,
        matched: count(7)?,
        residual_rad: residual_deg.map(f64::to_radians),
        confidence,
    })
}

/// A unit quaternion from its fields w, x, y, z; all empty: none.
fn quaternion(fields: [Option<f64>; 4]) -> std::result::Result<Option<Rotation>, String> {
    let (w, x, y, z) = match fields {
        [Some(w), Some(x), Some(y), Some(z)] => (w, x, y, z),
        [None, None, None, None] => return Ok(None),
        _ => return Err("expected all of qw,qx,qy,qz or none of them".into()),
    };
    let q = Quaternion::new(w, x, y, z);
    let length = q.norm();
    if (length - 1.0).abs() <= LENGTH_TOLERANCE {
        // Normalizing what is rounded only would change its bits.
        let exact = (length - 1.0).abs() <= 4.0 * f64::EPSILON;
        return Ok(Some(if exact {
            Rotation::new_unchecked(q)
        } else {
            Rotation::new_normalize(q)
        }));
    }
    Err(format!(
        "qw,qx,qy,qz: expected a unit quaternion, found one of length {length:.6}"
    ))
}

/// A field of text; quoted where CSV demands it.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r', '#']) || text.trim() != text {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

fn optional<T: std::fmt::Display>(value: Option<T>) -> String {
    value.map_or(String::new(), |v| v.to_string())
}
