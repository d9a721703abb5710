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

use std::io::{BufRead, Write};
use std::path::Path;

use nalgebra::Matrix3;

use super::robust::SpinConfig;
use super::shared::{SharedError, ViewTurn};
use super::{DEFAULT_CONFIDENCE, Measurement};
use crate::error::{Error, Result};
#[cfg(feature = "native")]
use crate::files;
use crate::files::csv::{Columns, Field, Table, TableRow, quoted, shown};
use crate::geometry::{CameraFrame, Position, Rotation, Vec3, from_wxyz, to_wxyz};

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

/// Number of columns.
const COUNT: usize = 42;
/// The columns, in the order in which they are written.
static COLUMNS: Columns<COUNT> = Columns {
    names: [
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
        "camera_frame",
        "cov_xx",
        "cov_xy",
        "cov_xz",
        "cov_yy",
        "cov_yz",
        "cov_zz",
        "x_m",
        "y_m",
        "z_m",
        "cov_m2_xx",
        "cov_m2_xy",
        "cov_m2_xz",
        "cov_m2_yy",
        "cov_m2_yz",
        "cov_m2_zz",
        "turn_x",
        "turn_y",
        "turn_z",
        "sd1_x",
        "sd1_y",
        "sd1_z",
        "sd2_x",
        "sd2_y",
        "sd2_z",
        "sd3_x",
        "sd3_y",
        "sd3_z",
        "ball",
        "table",
        "flash",
        "cameras",
    ],
    // The time and the quaternion.
    required: 1..6,
};
/// The frame of the quaternions, from which column on what only files with it have.
const CAMERA_FRAME: usize = 10;
/// The first columns of the covariance, of the center and its covariance, and of the turns.
const COVARIANCE: usize = 11;
const CENTER: usize = 17;
const CENTER_COVARIANCE: usize = 20;
const TURN: usize = 26;
/// At most so many names are listed.
const LISTED: usize = 8;
/// The name of the frame; the number of the ball, its table and the number of the flash, of files with several balls.
const FRAME: usize = 0;
const BALL: usize = 38;
const TABLE: usize = 39;
const FLASH: usize = 40;
/// How many cameras a row is of, of files with several.
const CAMERAS: usize = 41;
/// The same where the times come from elsewhere: only the quaternion is needed.
static UNTIMED: Columns<COUNT> = Columns {
    names: COLUMNS.names,
    required: 2..6,
};

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

/// The columns of a file with several balls, or several images of one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BallColumns {
    /// The numbers of the balls.
    pub ball: bool,
    /// Their tables.
    pub table: bool,
    /// The numbers of the flashes.
    pub flash: bool,
    /// How many cameras a row is of.
    pub cameras: bool,
}

impl BallColumns {
    /// Those that are written, by their places among all columns.
    fn written(self) -> impl Iterator<Item = usize> {
        let all = [
            (self.ball, BALL),
            (self.table, TABLE),
            (self.flash, FLASH),
            (self.cameras, CAMERAS),
        ];
        all.into_iter()
            .filter_map(|(is_written, at)| is_written.then_some(at))
    }
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
            camera_frame: reader.camera_frame,
            columns: BallColumns {
                ball: reader.table.has(BALL),
                table: reader.table.has(TABLE),
                flash: reader.table.has(FLASH),
                cameras: reader.table.has(CAMERAS),
            },
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

/// The rows of an orientations file, one by one. After an error there are no more.
pub struct OrientationReader<R> {
    table: Table<R, COUNT>,
    /// Time of the row before, seconds.
    time_s: f64,
    /// The interval of the rows, where it does not come from the file, and their number.
    interval_s: Option<f64>,
    count: u64,
    camera_frame: Option<CameraFrame>,
    /// The ball that is read, where one is chosen, and that of the rows before.
    chosen: Option<usize>,
    ball: Option<usize>,
    /// The same of exposures with several flashes: frames.
    chosen_exposure: Option<String>,
    exposure: Option<String>,
    /// Whether rows are images of a ball by flashes.
    of_flashes: bool,
    ended: bool,
}

impl<R: BufRead> OrientationReader<R> {
    /// Reads the header of `input`; `path` names it in errors.
    ///
    /// # Errors
    /// [`crate::Error::Read`], or [`crate::Error::Input`] where a column is missing or occurs
    /// twice.
    pub fn new(path: &Path, input: R) -> Result<Self> {
        Ok(Self::of(Table::new(path, input, &COLUMNS)?, None))
    }

    /// As [`OrientationReader::new`], of rows at equal intervals, so many a second; times in the
    /// file are passed over.
    ///
    /// # Errors
    /// Those of [`OrientationReader::new`], and [`crate::Error::Argument`] for a rate that is not
    /// positive.
    pub fn at_rate(path: &Path, input: R, fps: f64) -> Result<Self> {
        let inside = fps > 0.0 && fps.is_finite();
        crate::error::require(inside, "fps", "a positive number", fps)?;
        let table = Table::new(path, input, &UNTIMED)?;
        Ok(Self::of(table, Some(fps.recip())))
    }

    fn of(table: Table<R, COUNT>, interval_s: Option<f64>) -> Self {
        Self {
            time_s: f64::NEG_INFINITY,
            interval_s,
            count: 0,
            camera_frame: None,
            chosen: None,
            ball: None,
            chosen_exposure: None,
            exposure: None,
            of_flashes: table.has(FLASH),
            table,
            ended: false,
        }
    }

    /// The same of one of several balls: rows of others are passed over.
    #[must_use]
    pub fn of_ball(self, number: usize) -> Self {
        Self {
            chosen: Some(number),
            ..self
        }
    }

    /// The same of one of several exposures with flashes: rows of other frames are passed over.
    #[must_use]
    pub fn of_exposure(self, frame: &str) -> Self {
        Self {
            chosen_exposure: Some(frame.to_owned()),
            ..self
        }
    }

    /// What the rows from here on hold in a column, beside what came before them: "a, b and c".
    fn held(&mut self, column: usize, before: [String; 2]) -> Result<String> {
        let mut names: Vec<String> = before.into();
        while names.len() <= LISTED
            && let Some(row) = self.table.next_row()?
        {
            if let Some(name) = row.text(column)
                && names.iter().all(|known| known != name)
            {
                names.push(name.to_owned());
            }
        }
        if column == BALL {
            names.sort_by_key(|name| name.parse::<usize>().unwrap_or(usize::MAX));
        }
        let last = match names.len() > LISTED {
            true => "more".to_owned(),
            false => names.pop().unwrap_or_default(),
        };
        names.truncate(LISTED);
        Ok(format!("{} and {last}", names.join(", ")))
    }

    /// The frame of the orientations, where the rows read so far say it.
    pub fn camera_frame(&self) -> Option<CameraFrame> {
        self.camera_frame
    }

    fn read_row(&mut self) -> Result<Option<OrientationRow>> {
        loop {
            let Some(row) = self.table.next_row()? else {
                return Ok(None);
            };
            let line = row.line();
            let ball = row.count(BALL).map_err(|problem| row.error(problem))?;
            let flags = (self.chosen, self.chosen_exposure.as_deref());
            if is_passed_over(&row, ball, flags, self.of_flashes) {
                continue;
            }
            // A frame that shows no ball has a row without a number.
            let is_other = |(found, before): &(usize, usize)| found != before;
            let other = ball.zip(self.ball).filter(is_other);
            if let Some((found, before)) = other.filter(|_| !self.of_flashes) {
                let held = self.held(BALL, [before, found].map(|n| n.to_string()))?;
                let problem = format!(
                    "ball: expected one ball, found {found} after {before}: the file holds balls {held} (--ball chooses one)"
                );
                return Err(self.error(line, problem));
            }
            self.ball = ball.or(self.ball);
            let time_s = self.interval_s.map(|interval| interval * self.count as f64);
            let parsed = parse(&row, time_s).map_err(|problem| row.error(problem))?;
            let named = row
                .text(CAMERA_FRAME)
                .map(str::parse::<CameraFrame>)
                .transpose();
            let frame = named.map_err(|_| {
                let found = shown(row.text(CAMERA_FRAME).unwrap_or_default());
                row.error(format!(
                    "camera_frame: expected camera, optical, view or optical_view, found \"{found}\""
                ))
            })?;
            if self.count > 0 && frame != self.camera_frame {
                return Err(row.error("camera_frame: expected the same in all rows"));
            }
            self.camera_frame = frame;
            self.count += 1;
            // Rows of equal times are of several cameras, but not those of an exposure's flashes.
            let is_before =
                parsed.time_s < self.time_s || self.of_flashes && parsed.time_s == self.time_s;
            if is_before {
                let order = if self.of_flashes {
                    "later"
                } else {
                    "not earlier"
                };
                let problem = format!(
                    "expected a time {order} than the {} s before it, found {} s",
                    self.time_s, parsed.time_s
                );
                return Err(match self.exposure.take() {
                    Some(before) if self.of_flashes && before != parsed.frame => {
                        let held = self.held(FRAME, [before, parsed.frame])?;
                        let words = format!(
                            "{problem}: the file holds exposures {held} (--exposure chooses one)"
                        );
                        self.error(line, words)
                    }
                    _ => self.error(line, problem),
                });
            }
            self.time_s = parsed.time_s;
            if self.of_flashes {
                self.exposure = Some(parsed.frame.clone());
            }
            return Ok(Some(parsed));
        }
    }

    fn error(&self, line: u64, problem: String) -> Error {
        Error::input(self.table.path(), format!("line {line}"), problem)
    }
}

/// Whether a row is none of those that are read: another ball's or exposure's than the one that is `chosen`, or, in a file of
/// exposures with flashes, one that no flash lit.
fn is_passed_over(
    row: &TableRow<'_, COUNT>,
    ball: Option<usize>,
    chosen: (Option<usize>, Option<&str>),
    of_flashes: bool,
) -> bool {
    let is_other = chosen.0.is_some() && ball != chosen.0;
    let is_elsewhere = chosen.1.is_some() && row.text(FRAME) != chosen.1;
    is_other || is_elsewhere || (of_flashes && row.text(FLASH).is_none())
}

impl<R: BufRead> Iterator for OrientationReader<R> {
    type Item = Result<OrientationRow>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let row = self.read_row();
        self.ended = !matches!(row, Ok(Some(_)));
        row.transpose()
    }
}

/// Writes an orientations file row by row; the header goes before the first one.
pub struct OrientationWriter<W> {
    to: W,
    camera_frame: Option<CameraFrame>,
    columns: BallColumns,
    begun: bool,
}

impl<W: Write> OrientationWriter<W> {
    /// Nothing is written yet.
    pub fn new(to: W) -> Self {
        Self::in_frame(to, None)
    }

    /// As [`OrientationWriter::new`]; every row names this frame, which the orientations are in, and has their covariance.
    pub fn in_frame(to: W, camera_frame: Option<CameraFrame>) -> Self {
        Self {
            to,
            camera_frame,
            columns: BallColumns::default(),
            begun: false,
        }
    }

    /// The same with what several balls have besides.
    #[must_use]
    pub fn with_columns(self, columns: BallColumns) -> Self {
        Self { columns, ..self }
    }

    /// Writes a row; a quaternion scalar first with `qw >= 0`, digits enough to read back the same
    /// bits.
    ///
    /// # Errors
    /// Those of the output.
    pub fn write(&mut self, row: &OrientationRow) -> std::io::Result<()> {
        self.begin()?;
        write!(self.to, "{},", quoted(&row.frame))?;
        optional(&mut self.to, Some(row.time_s).filter(|t| t.is_finite()))?;
        match &row.orientation {
            Some(rotation) => {
                let [w, x, y, z] = to_wxyz(rotation);
                write!(self.to, ",{w},{x},{y},{z},")?;
            }
            None => self.to.write_all(b",,,,,")?,
        }
        optional(&mut self.to, row.dots)?;
        self.to.write_all(b",")?;
        optional(&mut self.to, row.matched)?;
        self.to.write_all(b",")?;
        optional(&mut self.to, row.residual_rad.map(f64::to_degrees))?;
        self.to.write_all(b",")?;
        optional(&mut self.to, row.confidence)?;
        if let Some(frame) = self.camera_frame {
            write!(self.to, ",{frame}")?;
            self.numbers(row.covariance.map(|c| UPPER.map(|at| c[at])))?;
            if frame.is_view() {
                self.numbers(row.turn.map(|turn| turn.numbers()))?;
            } else {
                self.numbers::<3>(row.position.map(|p| p.center_m.into()))?;
                self.numbers(row.position.map(|p| UPPER.map(|at| p.covariance[at])))?;
            }
        }
        for column in self.columns.written() {
            self.to.write_all(b",")?;
            match column {
                BALL => optional(&mut self.to, row.ball)?,
                TABLE => optional(&mut self.to, row.table.as_deref().map(quoted))?,
                FLASH => optional(&mut self.to, row.flash)?,
                _ => optional(&mut self.to, row.cameras)?,
            }
        }
        self.to.write_all(b"\n")
    }

    /// Numbers that stand together, or as many empty fields.
    fn numbers<const N: usize>(&mut self, numbers: Option<[f64; N]>) -> std::io::Result<()> {
        for k in 0..N {
            self.to.write_all(b",")?;
            optional(&mut self.to, numbers.map(|n| n[k]))?;
        }
        Ok(())
    }

    /// Flushes the buffer.
    ///
    /// # Errors
    /// Those of the output.
    pub fn flush(&mut self) -> std::io::Result<()> {
        self.to.flush()
    }

    /// Ends the file, which has a header even where it has no row.
    ///
    /// # Errors
    /// Those of the output.
    pub fn finish(mut self) -> std::io::Result<W> {
        self.begin()?;
        self.to.flush()?;
        Ok(self.to)
    }

    fn begin(&mut self) -> std::io::Result<()> {
        if !self.begun {
            self.begun = true;
            let (of_frame, of_place) = match self.camera_frame {
                None => (0..0, 0..0),
                Some(frame) if frame.is_view() => (CAMERA_FRAME..CENTER, TURN..BALL),
                Some(_) => (CAMERA_FRAME..CENTER, CENTER..TURN),
            };
            let columns = (0..CAMERA_FRAME).chain(of_frame).chain(of_place);
            let columns = columns.chain(self.columns.written());
            let names: Vec<&str> = columns.map(|at| COLUMNS.names[at]).collect();
            writeln!(self.to, "{}", names.join(","))?;
        }
        Ok(())
    }
}

fn optional(to: &mut impl Write, value: Option<impl std::fmt::Display>) -> std::io::Result<()> {
    value.map_or(Ok(()), |v| write!(to, "{v}"))
}

/// A row; `time_s` is its time where that does not come from the file.
fn parse(row: &TableRow<'_, COUNT>, time_s: Option<f64>) -> Field<OrientationRow> {
    let time_s = match time_s {
        Some(time_s) => time_s,
        None => row.number(1)?.ok_or(
            "time_s: expected a time in seconds, found nothing (--fps gives equal intervals)",
        )?,
    };
    let confidence = row.number(9)?;
    if let Some(c) = confidence.filter(|c| !(0.0..=1.0).contains(c)) {
        return Err(format!("confidence: expected 0 to 1, found {c}"));
    }
    let residual_deg = row.number(8)?;
    if let Some(r) = residual_deg.filter(|r| *r < 0.0) {
        return Err(format!("residual_deg: expected 0 or more, found {r}"));
    }
    let quaternion = [
        row.number(2)?,
        row.number(3)?,
        row.number(4)?,
        row.number(5)?,
    ];
    Ok(OrientationRow {
        frame: row.text(0).unwrap_or_default().to_owned(),
        time_s,
        orientation: orientation(quaternion)?,
        dots: row.count(6)?,
        matched: row.count(7)?,
        residual_rad: residual_deg.map(f64::to_radians),
        confidence,
        covariance: covariance(row, COVARIANCE, "cov_xx to cov_zz")?,
        position: position(row)?,
        turn: turn(row)?,
        ball: row.count(BALL)?,
        table: row.text(TABLE).map(str::to_owned),
        flash: row.count(FLASH)?,
        cameras: row.count(CAMERAS)?,
    })
}

/// The places of a covariance's six numbers.
const UPPER: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// The covariance of a row from a column on, if it has one.
fn covariance(row: &TableRow<'_, COUNT>, first: usize, names: &str) -> Field<Option<Matrix3<f64>>> {
    let Some(numbers) = all_or_none::<6>(row, first, names)? else {
        return Ok(None);
    };
    let mut covariance = Matrix3::zeros();
    for ((i, j), value) in UPPER.into_iter().zip(numbers) {
        covariance[(i, j)] = value;
        covariance[(j, i)] = value;
    }
    let least = covariance.symmetric_eigenvalues().min();
    // Rounded numbers may lie a little below.
    if least < -1e-6 * covariance.trace().abs() {
        return Err(format!(
            "{names}: expected a covariance, found one without a root"
        ));
    }
    Ok(Some(covariance))
}

/// The ball's center of a row, if it has one.
fn position(row: &TableRow<'_, COUNT>) -> Field<Option<Position>> {
    let center = all_or_none::<3>(row, CENTER, "x_m to z_m")?;
    let names = "cov_m2_xx to cov_m2_zz";
    match (center, covariance(row, CENTER_COVARIANCE, names)?) {
        (None, None) => Ok(None),
        (Some(center), Some(covariance)) => Ok(Some(Position {
            center_m: Vec3::from(center),
            covariance,
            with_rotation: None,
        })),
        _ => Err(format!("expected x_m to z_m and {names}, or none of them")),
    }
}

/// The turn of a row's view frame, if it has one.
fn turn(row: &TableRow<'_, COUNT>) -> Field<Option<ViewTurn>> {
    let of_earlier = row.number(TURN + 1)?.is_some() && row.number(TURN + 2)?.is_none();
    if of_earlier {
        let problem = "expected turn_x to sd3_z, found turn_y without turn_z: an earlier version wrote this file, estimate its images again";
        return Err(problem.into());
    }
    let numbers = all_or_none(row, TURN, "turn_x to sd3_z")?;
    Ok(numbers.map(|numbers| ViewTurn::of_numbers(&numbers)))
}

/// Numbers of a row that stand together from a column on.
fn all_or_none<const N: usize>(
    row: &TableRow<'_, COUNT>,
    first: usize,
    names: &str,
) -> Field<Option<[f64; N]>> {
    let mut numbers = [0.0; N];
    let mut found = 0;
    for (k, number) in numbers.iter_mut().enumerate() {
        if let Some(value) = row.number(first + k)? {
            *number = value;
            found += 1;
        }
    }
    match found {
        0 => Ok(None),
        _ if found == N => Ok(Some(numbers)),
        _ => Err(format!("expected all of {names} or none of them")),
    }
}

/// A unit quaternion from its fields w, x, y, z; all empty: none.
fn orientation(fields: [Option<f64>; 4]) -> Field<Option<Rotation>> {
    let wxyz = match fields {
        [Some(w), Some(x), Some(y), Some(z)] => [w, x, y, z],
        [None, None, None, None] => return Ok(None),
        _ => return Err("expected all of qw,qx,qy,qz or none of them".into()),
    };
    from_wxyz(wxyz, LENGTH_TOLERANCE)
        .map(Some)
        .map_err(|length| {
            format!("qw,qx,qy,qz: expected a unit quaternion, found one of length {length:.6}")
        })
}
