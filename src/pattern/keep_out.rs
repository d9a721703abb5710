//! Zones of a ball that stay free of dots, such as a printed logo, and the file that keeps them beside
//! a pattern.
//!
//! A pattern's CSV has only dots, since other programs read it. Its zones stand beside it:
//! `ball.csv` has `ball.zones.json`, which names the pattern by its SHA-256, so that zones of another
//! pattern are rejected.

use std::path::{Path, PathBuf};

use super::Pattern;
use crate::error::{Error, Result, require};
#[cfg(feature = "native")]
use crate::files;
use crate::geometry::{Vec3, angle_between};

/// A dot may lie this much inside a zone, radians: a search meets its constraints to 1e-3.
const TOLERANCE_RAD: f64 = 2e-3;
/// Maximum number of zones.
const MAX_ZONES: usize = 8;
/// Version of the file.
#[cfg(feature = "native")]
const FORMAT_VERSION: u32 = 1;

/// A cone that must stay free of dots: a printed logo.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct KeepOut {
    /// Unit vector to the cone's center, pattern frame.
    pub axis: Vec3,
    /// Angle between the axis and the nearest dot's center, radians.
    pub half_angle_rad: f64,
}

impl KeepOut {
    /// Checks axis and angle.
    ///
    /// # Errors
    /// [`Error::Argument`] for `keep_out` with what was expected.
    pub fn check(&self) -> Result<()> {
        let is_unit = (self.axis.norm() - 1.0).abs() < super::LENGTH_TOLERANCE;
        require(is_unit, "keep_out", "a unit axis", self.axis.norm())?;
        let degrees = self.half_angle_rad.to_degrees();
        require(
            degrees > 0.0 && degrees <= 90.0,
            "keep_out",
            "a half angle of 0 to 90 degrees",
            degrees,
        )
    }
}

/// The file beside a pattern.
#[cfg(feature = "native")]
#[derive(Debug, serde::Serialize, serde::Deserialize)]
struct ZonesFile {
    format_version: u32,
    pattern_sha256: String,
    keep_out: Vec<KeepOut>,
}

/// The file that keeps the zones of the pattern in `csv`.
pub fn zones_path(csv: &Path) -> PathBuf {
    csv.with_extension("zones.json")
}

impl Pattern {
    /// The same dots with zones that they stay out of.
    ///
    /// # Errors
    /// [`Error::Argument`] for a zone that is none, too many of them, or a dot within one.
    pub fn with_keep_out(mut self, zones: Vec<KeepOut>) -> Result<Self> {
        require(
            zones.len() <= MAX_ZONES,
            "keep_out",
            &format!("at most {MAX_ZONES} zones"),
            zones.len(),
        )?;
        for (k, zone) in zones.iter().enumerate() {
            zone.check()?;
            for (i, dot) in self.dots.iter().enumerate() {
                let apart = angle_between(dot, &zone.axis);
                if apart < zone.half_angle_rad - TOLERANCE_RAD {
                    let problem = format!(
                        "dot {i} lies in zone {k}: {:.2} degrees from its axis, expected at least {:.2}",
                        apart.to_degrees(),
                        zone.half_angle_rad.to_degrees()
                    );
                    return Err(Error::argument("keep_out", problem));
                }
            }
        }
        self.keep_out = zones;
        Ok(self)
    }

    /// The zones without dots.
    pub fn keep_out(&self) -> &[KeepOut] {
        &self.keep_out
    }

    /// The pattern with the zones in the file beside `csv`, where there is one.
    #[cfg(feature = "native")]
    pub(crate) fn with_zones_of(self, csv: &Path) -> Result<Self> {
        let path = zones_path(csv);
        if !path.exists() {
            return Ok(self);
        }
        let file: ZonesFile =
            serde_json::from_slice(&files::read_at_most(&path, files::MAX_TEXT_BYTES)?)
                .map_err(|e| Error::input(&path, format!("line {}", e.line()), e.to_string()))?;
        if file.format_version != FORMAT_VERSION {
            let problem = format!("expected {FORMAT_VERSION}, found {}", file.format_version);
            return Err(Error::input(&path, "format_version", problem));
        }
        let own = self.sha256();
        if file.pattern_sha256 != own {
            let problem = format!(
                "expected {own}, that of {}, found {}",
                csv.display(),
                file.pattern_sha256
            );
            return Err(Error::input(&path, "pattern_sha256", problem));
        }
        self.with_keep_out(file.keep_out).map_err(|e| match e {
            Error::Argument { problem, .. } => Error::input(&path, "keep_out", problem),
            other => other,
        })
    }

    /// Writes the zones beside `csv`; where there are none, removes those of an earlier pattern.
    #[cfg(feature = "native")]
    pub(super) fn write_zones(&self, csv: &Path) -> Result<()> {
        let path = zones_path(csv);
        if self.keep_out.is_empty() {
            return files::remove_if_present(&path);
        }
        let file = ZonesFile {
            format_version: FORMAT_VERSION,
            pattern_sha256: self.sha256(),
            keep_out: self.keep_out.clone(),
        };
        let mut text = serde_json::to_string_pretty(&file)
            .map_err(|e| Error::Internal(format!("zones as JSON: {e}")))?;
        text.push('\n');
        files::write_bytes(&path, text.as_bytes())
    }
}
