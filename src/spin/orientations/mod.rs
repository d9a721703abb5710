//! The orientations file: what identification writes and the spin estimators read.
//!
//! CSV with a header, one frame a row, in order of time:
//!
//! ```text
//! frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence
//! ```
//!
//! `frame` is any text, `time_s` seconds in any one time base, `qw,qx,qy,qz` the unit quaternion
//! that maps the pattern's frame to the camera's (scalar first; SciPy and ROS put it last), all
//! four fields empty where the identification gave up; `dots` seen and `matched`, the matched dots'
//! RMS angular `residual_deg`, and the `confidence` in [0, 1] that the identification is correct.
//! Only `time_s` and the quaternion are indispensable; other columns may be missing or empty, and
//! unknown ones are passed over. What the image estimator writes has more columns:
//!
//! - `camera_frame`, the same in all rows: the frame that the quaternions are in, `camera` (x right, y up, z towards the camera; that of
//!   files without the column, and formerly called `ours`), `optical` (x right, y down, z forward), or where the camera's intrinsics are
//!   unknown `view` and `optical_view` ([`CameraFrame`]);
//! - `cov_xx,cov_xy,cov_xz,cov_yy,cov_yz,cov_zz`, rad^2: the covariance of the small rotation vector, in the same frame, that leads
//!   from the quaternion to the true orientation;
//! - `x_m,y_m,z_m`, m, of the camera's frame only: the center of the ball, also of rows without a quaternion whose outline was found, and
//!   `cov_m2_xx,cov_m2_xy,cov_m2_xz,cov_m2_yy,cov_m2_yz,cov_m2_zz`, m^2, its covariance, in the same frame ([`Position`]);
//! - `turn_x,turn_y,turn_z`, rad, of view frames only: all rows are in one view frame, that of the ball in the middle of its path; the turn from
//!   the row's own; and `sd1_x` to `sd3_z`, rad: what one standard deviation of each of three independent errors of the camera, which all rows
//!   share, does to the row's orientation ([`ViewTurn`]);
//! - `ball`, of frames with several balls: the number of the ball, one of which is read; `table`, where there were several: that of the
//!   ball; `flash`, of exposures with several flashes, whose rows are images of one ball: rows without a flash are none of them and are passed over, and of several exposures whose times
//!   do not follow each other one is read;
//! - `cameras`, of a rig's frames: how many cameras' orientations the row's is of.
//!
//! Rows of equal times are measurements of one orientation, as several cameras that are not fused give them.
//!
//! [`OrientationReader`] yields row after row from any input, in memory that does not grow with the
//! file; [`OrientationWriter`] writes them likewise.
//!
//! Guarantees: what is read has finite numbers, unit quaternions and times that do not decrease (equal ones are of one orientation); everything
//! else is rejected with the line at fault.

mod columns;
mod reader;
mod writer;

use std::io::BufRead;
use std::path::Path;

use nalgebra::Matrix3;

pub use self::columns::BallColumns;
pub use self::reader::OrientationReader;
pub use self::writer::OrientationWriter;
use super::robust::SpinConfig;
use super::shared::{SharedError, ViewTurn};
use super::{DEFAULT_CONFIDENCE, Measurement};
use crate::error::Result;
#[cfg(feature = "native")]
use crate::files;
use crate::geometry::{CameraFrame, Position, Rotation};

/// Maximum deviation of a quaternion's length from 1 that is normalized instead of rejected: most
/// writers keep six decimals, some only three.
pub const LENGTH_TOLERANCE: f64 = 2e-3;
/// A frame's noise scale is kept within this factor of the common noise either way: the residual of
/// a few dots is itself uncertain.
const SCALE_LIMIT: f64 = 2.0;
/// No orientation is known better than this, radians: a tenth of a degree.
const MIN_SIGMA_RAD: f64 = 1.75e-3;
/// What frames share takes no more of an orientation's deviation than leaves this part.
const LEAST_OWN: f64 = 0.5;
/// Dots of average quality that a frame's residual is averaged with, for the same reason.
const RESIDUAL_PRIOR_DOTS: f64 = 4.0;

/// One frame of an orientations file.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientationRow {
    /// The frame's name; empty where the file has none.
    pub frame: String,
    /// Time, seconds; NaN, an empty field in the file, where a frame has none. What is read has
    /// one.
    pub time_s: f64,
    /// Pattern to camera; `None` where the identification gave up.
    pub orientation: Option<Rotation>,
    /// Dots seen.
    pub dots: Option<usize>,
    /// Dots matched.
    pub matched: Option<usize>,
    /// RMS angular residual of the matched dots, radians.
    pub residual_rad: Option<f64>,
    /// Probability that the orientation is correct, in [0, 1].
    pub confidence: Option<f64>,
    /// Covariance of the rotation vector that leads from the orientation to the true one, in its frame, rad^2.
    pub covariance: Option<Matrix3<f64>>,
    /// The ball's center in the camera's frame, by the axes of the file, with or without an orientation. The file leaves out its covariance
    /// with that.
    pub position: Option<Position>,
    /// How the row's own view frame was turned, about the x and y of its frame.
    pub turn: Option<ViewTurn>,
    /// The number of the ball, of frames with several.
    pub ball: Option<usize>,
    /// The table that the ball carries, where there are several.
    pub table: Option<String>,
    /// The number of the flash that lit it, of exposures with several.
    pub flash: Option<usize>,
    /// How many cameras' orientations it is of, of a rig.
    pub cameras: Option<usize>,
}

impl Default for OrientationRow {
    /// A frame without a name and a time, of which nothing is known.
    fn default() -> Self {
        Self {
            frame: String::new(),
            time_s: f64::NAN,
            orientation: None,
            dots: None,
            matched: None,
            residual_rad: None,
            confidence: None,
            covariance: None,
            position: None,
            turn: None,
            ball: None,
            table: None,
            flash: None,
            cameras: None,
        }
    }
}

impl OrientationRow {
    /// Root mean square deviation about the axes, radians, where the covariance is known, without what all rows share of the camera's
    /// error: at least a tenth of a degree.
    fn sigma_rad(&self) -> Option<f64> {
        let all = self.covariance?.trace() / 3.0;
        let shared = self
            .turn
            .map_or(0.0, |turn| turn.shared_covariance().trace() / 3.0);
        Some((all - shared).max(0.0).sqrt().max(MIN_SIGMA_RAD))
    }
}

/// The frames of a file, in order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Orientations {
    /// The frames.
    pub rows: Vec<OrientationRow>,
    /// The frame of the orientations, where the file says it.
    pub camera_frame: Option<CameraFrame>,
    /// What is written of several balls.
    pub columns: BallColumns,
}

impl Orientations {
    /// Frames with measured orientations and nothing else known of them, named by their number.
    pub fn from_measurements(measurements: &[Measurement]) -> Self {
        let row = |(i, m): (usize, &Measurement)| OrientationRow {
            frame: i.to_string(),
            time_s: m.time_s,
            orientation: Some(m.orientation),
            confidence: Some(m.confidence),
            ..OrientationRow::default()
        };
        Self {
            rows: measurements.iter().enumerate().map(row).collect(),
            ..Self::default()
        }
    }

    /// Reads an orientations file.
    ///
    /// # Errors
    /// [`crate::Error::Read`], or [`crate::Error::Input`] naming the line and what was expected
    /// there.
    #[cfg(feature = "native")]
    pub fn read_csv(path: &Path) -> Result<Self> {
        Self::read(path, files::open(path)?)
    }

    /// As [`Orientations::read_csv`], from any input; `path` names it in errors.
    ///
    /// # Errors
    /// [`crate::Error::Read`], or [`crate::Error::Input`] naming the line and what was expected
    /// there.
    pub fn read(path: &Path, input: impl BufRead) -> Result<Self> {
        Self::collect(OrientationReader::new(path, input)?)
    }

    /// All rows of a reader.
    ///
    /// # Errors
    /// Those of [`Orientations::read`].
    pub fn collect<R: BufRead>(mut reader: OrientationReader<R>) -> Result<Self> {
        let rows = reader.by_ref().collect::<Result<_>>()?;
        Ok(Self {
            rows,
            camera_frame: reader.camera_frame(),
            columns: reader.columns(),
        })
    }

    /// The file's text; quaternions scalar first with `qw >= 0`, digits enough to read back the
    /// same bits.
    pub fn to_csv(&self) -> String {
        let mut text = Vec::new();
        let mut writer =
            OrientationWriter::in_frame(&mut text, self.camera_frame).with_columns(self.columns);
        for row in &self.rows {
            // Writing to memory cannot fail.
            let _ = writer.write(row);
        }
        let _ = writer.finish();
        String::from_utf8(text).unwrap_or_default()
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// [`crate::Error::Write`].
    #[cfg(feature = "native")]
    pub fn write_csv(&self, path: &Path) -> Result<()> {
        files::write_bytes(path, self.to_csv().as_bytes())
    }

    /// The error that frames share, as the residuals and the view frame's turns show it; `None` without any.
    pub fn shared_error(&self) -> Option<SharedError> {
        let answered = self.rows.iter().filter(|r| r.orientation.is_some());
        let turns = answered.clone().filter_map(|r| Some((r.time_s, r.turn?)));
        let residuals = answered.filter_map(|r| r.residual_rad);
        SharedError::with_turns(SharedError::of_residuals(residuals), turns)
    }

    /// These settings with what the file knows of its errors: those that the rows share, and the noise of an
    /// orientation where all have covariances.
    pub fn spin_config(&self, config: SpinConfig) -> SpinConfig {
        SpinConfig {
            sigma_rad: self.noise_rad().unwrap_or(config.sigma_rad),
            shared: self.shared_error(),
            ..config
        }
    }

    /// The typical noise of an orientation about an axis, radians, by the rows' covariances without what rows share, which is counted
    /// apart ([`Orientations::shared_error`]); `None` where a row lacks its covariance.
    pub fn noise_rad(&self) -> Option<f64> {
        let typical = self.typical_sigma_rad()?;
        let shared = self.shared_error().map_or(0.0, |s| s.sigma_rad);
        let least = LEAST_OWN * typical;
        let own = typical * typical - shared * shared;
        Some(own.max(least * least).sqrt())
    }

    /// The median deviation of an orientation about an axis, radians, by the rows' covariances; `None` where one lacks it.
    fn typical_sigma_rad(&self) -> Option<f64> {
        let answered = self.rows.iter().filter(|r| r.orientation.is_some());
        let sigmas: Option<Vec<f64>> = answered.map(OrientationRow::sigma_rad).collect();
        sigmas
            .filter(|s| !s.is_empty())
            .map(|mut s| crate::stats::median(&mut s))
    }

    /// What the estimators work on: the frames that have an orientation.
    ///
    /// Where all have covariances, a frame's noise is the root mean square of its deviations about the axes. Else it follows from
    /// residuals and dot counts, where these are given: `n` dots spread over the ball with noise `s` fix each axis of the orientation
    /// to `s sqrt(3 / (2 n))`, so that the scale is `s / sqrt(n)` relative to the median frame's.
    pub fn measurements(&self) -> Vec<Measurement> {
        let scales: Vec<f64> = match self.typical_sigma_rad() {
            Some(typical) => {
                let scale = |r: &OrientationRow| r.sigma_rad().unwrap_or(typical) / typical;
                self.rows.iter().map(scale).collect()
            }
            None => self.scales_by_residuals(),
        };
        let measurement = |(r, sigma_scale): (&OrientationRow, f64)| {
            r.orientation.map(|orientation| Measurement {
                time_s: r.time_s,
                orientation,
                confidence: r.confidence.unwrap_or(DEFAULT_CONFIDENCE),
                sigma_scale,
            })
        };
        let rows = self.rows.iter().zip(scales);
        rows.filter_map(measurement).collect()
    }

    /// Each row's noise over the median row's, by residuals and counts of dots.
    fn scales_by_residuals(&self) -> Vec<f64> {
        let answered = || self.rows.iter().filter(|r| r.orientation.is_some());
        let mut residuals: Vec<f64> = answered()
            .filter_map(|r| r.residual_rad)
            .filter(|r| *r > 0.0)
            .collect();
        let typical = crate::stats::median(&mut residuals);
        let noise = |r: &OrientationRow| match (r.residual_rad, r.matched) {
            (Some(residual), Some(n)) if typical > 0.0 && n > 0 => {
                let n = n as f64;
                let squares = RESIDUAL_PRIOR_DOTS * typical * typical + n * residual * residual;
                (squares / (RESIDUAL_PRIOR_DOTS + n) / n).sqrt()
            }
            _ => 0.0,
        };
        let mut known: Vec<f64> = answered().map(noise).filter(|s| *s > 0.0).collect();
        let common = crate::stats::median(&mut known);
        let scale = |r: &OrientationRow| match noise(r) {
            s if s > 0.0 => (s / common).clamp(1.0 / SCALE_LIMIT, SCALE_LIMIT),
            _ => 1.0,
        };
        self.rows.iter().map(scale).collect()
    }
}
