//! `--as`: what other programs read.

use std::fmt::Write as _;

use clap::{Args, ValueEnum};

use super::Asked;
use crate::error::{Error, Result};
use crate::files::csv::shown;
use crate::spin::fictrac::{self, FicTracConfig};
use crate::spin::orientations::{OrientationRow, Orientations};

/// A program whose format is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum ForeignFormat {
    /// FicTrac, of treadmills.
    Fictrac,
    /// GSPro, and other golf simulators that read its Open Connect V1.
    Gspro,
}

#[derive(Debug, Args)]
pub struct FormatArguments {
    /// What another program reads: fictrac, the columns of FicTrac for an animal on a treadmill's ball, or gspro, with --preset golf a JSON object a shot
    /// (Open Connect V1).
    #[arg(
        long = "as",
        value_enum,
        value_name = "fictrac|gspro",
        conflicts_with = "frame"
    )]
    format: Option<ForeignFormat>,
    /// FicTrac's camera-to-lab rotation: the rotation vector, radians, that turns camera axes (x right, y down, z forward) into the animal's (x
    /// front, y right, z down), as `c2a_r` in FicTrac's configuration [default: a level camera behind the animal, 1.2092,1.2092,1.2092].
    #[arg(
        hide = true,
        long,
        value_name = "X,Y,Z",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    c2a_r: Vec<f64>,
    /// After more frames without an orientation than this the path of --as fictrac begins anew; -1 is never [default: -1].
    #[arg(
        hide = true,
        long,
        value_name = "N",
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(i64).range(-1..)
    )]
    max_bad_frames: Option<i64>,
}

impl Asked {
    /// Whether rows are another program's.
    pub(in crate::cli) fn is_as(&self, format: ForeignFormat) -> bool {
        self.format.format == Some(format)
    }

    /// Rejects a format that the flags do not fit.
    pub(super) fn check_format(&self) -> Result<()> {
        let given = &self.format;
        let is_fictrac = self.is_as(ForeignFormat::Fictrac);
        if is_fictrac && self.is_several() {
            let problem = "fictrac: expected one ball, without --balls and --strobe-ms";
            return Err(Error::argument("--as", problem));
        }
        if self.is_as(ForeignFormat::Gspro) && !(self.is_golf() && self.strobe_ms.is_some()) {
            let problem = "gspro: expected --strobe-ms and --preset golf";
            return Err(Error::argument("--as", problem));
        }
        let others = [
            ("c2a_r", !given.c2a_r.is_empty()),
            ("max_bad_frames", given.max_bad_frames.is_some()),
        ];
        let foreign = others.iter().find(|(_, is_given)| *is_given && !is_fictrac);
        if let Some((key, _)) = foreign {
            return Err(Error::argument(*key, "expected only with --as fictrac"));
        }
        self.fictrac().map(drop)
    }

    /// How FicTrac's rows are made, where they are asked for.
    pub(in crate::cli) fn fictrac(&self) -> Result<Option<FicTracConfig>> {
        if !self.is_as(ForeignFormat::Fictrac) {
            return Ok(None);
        }
        let config = FicTracConfig {
            // -1 is never.
            max_bad_frames: self.format.max_bad_frames.and_then(|n| n.try_into().ok()),
            ..FicTracConfig::default()
        };
        let given = &self.format.c2a_r;
        match given[..] {
            [] => Ok(Some(config)),
            [x, y, z] => config.with_c2a_r([x, y, z]).map(Some),
            _ => {
                let problem = format!("expected three numbers, found {}", given.len());
                Err(Error::argument("c2a_r", problem))
            }
        }
    }

    /// The rows of one ball's sequence as they are asked for.
    pub(super) fn rows(&self, file: &Orientations) -> Result<String> {
        let Some(config) = self.fictrac()? else {
            return Ok(file.to_csv());
        };
        let is_untimed =
            |row: &&OrientationRow| row.orientation.is_some() && !row.time_s.is_finite();
        if let Some(row) = file.rows.iter().find(is_untimed) {
            let problem = format!(
                "fictrac: expected a time for every frame, {} has none (--fps, --times)",
                shown(&row.frame)
            );
            return Err(Error::argument("--as", problem));
        }
        let mut text = String::new();
        for row in fictrac::rows(file, config)? {
            let _ = writeln!(text, "{row}");
        }
        Ok(text)
    }

    /// What is to be known of the rows, on standard error.
    pub(in crate::cli) fn say_format(&self) -> Result<()> {
        let is_fictrac = self.is_as(ForeignFormat::Fictrac);
        if is_fictrac && self.format.c2a_r.is_empty() {
            errln!(
                "note: lab frame: that of a level camera behind the animal (another one: --config c2a_r=X,Y,Z)"
            );
        }
        if self.frame()?.is_view() {
            if is_fictrac {
                errln!(
                    "note: without --intrinsics the camera's axes are those of one that points at the ball: turned, where the ball is not in the \
                     picture's center"
                );
            }
            if self.is_as(ForeignFormat::Gspro) {
                errln!(
                    "note: without --intrinsics a shot has no speed and no direction, and its ContainsBallData is false"
                );
            }
        }
        Ok(())
    }
}
