//! An orientations file written row by row.

use std::io::Write;

use super::OrientationRow;
use super::columns::{BALL, BallColumns, CAMERA_FRAME, CENTER, COLUMNS, FLASH, TABLE, TURN, UPPER};
use crate::files::csv::quoted;
use crate::geometry::{CameraFrame, to_wxyz};

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
