//! An orientations file read row by row.

use std::io::BufRead;
use std::path::Path;

use nalgebra::Matrix3;

use super::columns::{
    BALL, CAMERA_FRAME, CAMERAS, CENTER, CENTER_COVARIANCE, COLUMNS, COUNT, COVARIANCE, FLASH,
    FRAME, TABLE, TURN, UNTIMED, UPPER,
};
use super::{BallColumns, LENGTH_TOLERANCE, OrientationRow};
use crate::error::{Error, Result};
use crate::files::csv::{Field, Table, TableRow, shown};
use crate::geometry::{CameraFrame, Position, Rotation, Vec3, from_wxyz};
use crate::spin::shared::ViewTurn;

/// At most so many names are listed.
const LISTED: usize = 8;

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

    /// What it has of several balls.
    pub(super) fn columns(&self) -> BallColumns {
        BallColumns {
            ball: self.table.has(BALL),
            table: self.table.has(TABLE),
            flash: self.table.has(FLASH),
            cameras: self.table.has(CAMERAS),
        }
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
            if let Some((found, before)) = ball.zip(self.ball)
                && found != before
                && !self.of_flashes
            {
                return Err(self.second_ball(line, found, before));
            }
            self.ball = ball.or(self.ball);
            let time_s = self.interval_s.map(|interval| interval * self.count as f64);
            let parsed = parse(&row, time_s).map_err(|problem| row.error(problem))?;
            let frame = camera_frame(&row)?;
            if self.count > 0 && frame != self.camera_frame {
                return Err(row.error("camera_frame: expected the same in all rows"));
            }
            self.camera_frame = frame;
            self.count += 1;
            self.require_order(line, &parsed)?;
            self.time_s = parsed.time_s;
            if self.of_flashes {
                self.exposure = Some(parsed.frame.clone());
            }
            return Ok(Some(parsed));
        }
    }

    fn second_ball(&mut self, line: u64, found: usize, before: usize) -> Error {
        match self.held(BALL, [before, found].map(|n| n.to_string())) {
            Ok(held) => self.error(
                line,
                format!(
                    "ball: expected one ball, found {found} after {before}: the file holds balls {held} (--ball chooses one)"
                ),
            ),
            Err(error) => error,
        }
    }

    /// Rows of equal times are of several cameras, but not those of an exposure's flashes.
    fn require_order(&mut self, line: u64, row: &OrientationRow) -> Result<()> {
        let is_before = row.time_s < self.time_s || self.of_flashes && row.time_s == self.time_s;
        if !is_before {
            return Ok(());
        }
        let order = if self.of_flashes {
            "later"
        } else {
            "not earlier"
        };
        let problem = format!(
            "expected a time {order} than the {} s before it, found {} s",
            self.time_s, row.time_s
        );
        Err(match self.exposure.take() {
            Some(before) if self.of_flashes && before != row.frame => {
                let held = self.held(FRAME, [before, row.frame.clone()])?;
                let words =
                    format!("{problem}: the file holds exposures {held} (--exposure chooses one)");
                self.error(line, words)
            }
            _ => self.error(line, problem),
        })
    }

    fn error(&self, line: u64, problem: String) -> Error {
        Error::input(self.table.path(), format!("line {line}"), problem)
    }
}

/// The frame that a row says its orientation is in.
fn camera_frame(row: &TableRow<'_, COUNT>) -> Result<Option<CameraFrame>> {
    let Some(text) = row.text(CAMERA_FRAME) else {
        return Ok(None);
    };
    text.parse().map(Some).map_err(|_| {
        row.error(format!(
            "camera_frame: expected camera, optical, view or optical_view, found \"{}\"",
            shown(text)
        ))
    })
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
