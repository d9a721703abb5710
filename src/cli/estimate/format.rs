//! `--as`: what other programs read.

use std::fmt::Write as _;

use clap::{Args, ValueEnum};

use super::Asked;
use crate::error::{Error, Result};
use crate::spin::fictrac::{self, FicTracConfig};
use crate::spin::orientations::Orientations;

/// A program whose format is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Format {
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
    format: Option<Format>,
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
    /// After more frames without an orientation than this the path of --as fictrac begins anew [default: never].
    #[arg(hide = true, long, value_name = "N")]
    max_bad_frames: Option<u64>,
}

impl Asked {
    /// Whether rows are another program's.
    pub(in crate::cli) fn is_as(&self, format: Format) -> bool {
        self.format.format == Some(format)
    }

    /// Rejects a format that the flags do not fit.
    pub(super) fn check_format(&self) -> Result<()> {
        let given = &self.format;
        let is_fictrac = self.is_as(Format::Fictrac);
        if is_fictrac && self.is_several() {
            let problem = "fictrac: expected one ball, without --balls and --strobe-ms";
            return Err(Error::argument("--as", problem));
        }
        if self.is_as(Format::Gspro) && !(self.is_golf() && self.strobe_ms.is_some()) {
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
        if !self.is_as(Format::Fictrac) {
            return Ok(None);
        }
        let config = FicTracConfig {
            max_bad_frames: self.format.max_bad_frames,
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
        let mut text = String::new();
        for row in fictrac::rows(file, config)? {
            let _ = writeln!(text, "{row}");
        }
        Ok(text)
    }

    /// What is to be known of the rows, on standard error.
    pub(in crate::cli) fn say_format(&self) {
        if self.is_as(Format::Fictrac) && self.format.c2a_r.is_empty() {
            errln!(
                "note: lab frame: that of a level camera behind the animal (another one: --config c2a_r=X,Y,Z)"
            );
        }
    }
}
