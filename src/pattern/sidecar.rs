//! The file beside a pattern's CSV: what a design knows that the CSV cannot say.
//!
//! A pattern's CSV has only dots, since other programs read it. `ball.csv` therefore has
//! `ball.ball.json`, with the zones that stay free of dots and the [`DesignRecord`]. It names the pattern
//! by its SHA-256, so that what belongs to another pattern is rejected. Files of version 1, with zones
//! only, were named `ball.zones.json`; they are still read.

use std::path::{Path, PathBuf};

use super::{KeepOut, Pattern};
use crate::error::{Error, Result, require};
#[cfg(feature = "native")]
use crate::files;

/// Version of the file.
const FORMAT_VERSION: u32 = 2;

/// What a pattern was designed for.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DesignRecord {
    /// Diameter of the ball, mm.
    pub ball_diameter_mm: f64,
    /// Diameter of a dot on it, mm.
    pub dot_diameter_mm: f64,
    /// The camera's conditions, where it was designed for a camera: as in `report.json`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<serde_json::Value>,
    /// What it was chosen by among the candidates, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub criterion: Option<String>,
}

impl DesignRecord {
    /// A dot's diameter over the ball's.
    pub fn dot_diameter(&self) -> f64 {
        self.dot_diameter_mm / self.ball_diameter_mm
    }

    /// Angle between a dot's center and its edge, seen from the ball's center, radians.
    pub fn dot_radius_rad(&self) -> f64 {
        self.dot_diameter().asin()
    }

    /// Checks the diameters.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the field.
    pub fn check(&self) -> Result<()> {
        let (ball, dot) = (self.ball_diameter_mm, self.dot_diameter_mm);
        let inside = (1.0..=1000.0).contains(&ball);
        require(inside, "design.ball_diameter_mm", "1 to 1000 mm", ball)?;
        let inside = dot > 0.0 && dot < ball;
        require(
            inside,
            "design.dot_diameter_mm",
            "more than 0 mm and less than the ball",
            dot,
        )
    }
}

/// The file.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
struct Sidecar {
    format_version: u32,
    pattern_sha256: String,
    #[serde(default)]
    keep_out: Vec<KeepOut>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    design: Option<DesignRecord>,
}

/// The file beside the pattern in `csv`.
pub fn sidecar_path(csv: &Path) -> PathBuf {
    csv.with_extension("ball.json")
}

/// The same file of version 1.
#[cfg(feature = "native")]
fn zones_path(csv: &Path) -> PathBuf {
    csv.with_extension("zones.json")
}

impl Pattern {
    /// The pattern with the zones in the file beside `csv`, and what else is there, where there is one.
    #[cfg(feature = "native")]
    pub(crate) fn with_sidecar_of(self, csv: &Path) -> Result<(Self, Option<DesignRecord>)> {
        let paths = [sidecar_path(csv), zones_path(csv)];
        let Some(path) = paths.iter().find(|path| path.exists()) else {
            return Ok((self, None));
        };
        self.with_sidecar(path, &files::read_at_most(path, files::MAX_TEXT_BYTES)?)
    }

    /// The same from the file's bytes; `path` only names the file in errors.
    pub(super) fn with_sidecar(
        self,
        path: &Path,
        bytes: &[u8],
    ) -> Result<(Self, Option<DesignRecord>)> {
        let file: Sidecar = serde_json::from_slice(bytes)
            .map_err(|e| Error::input(path, format!("line {}", e.line()), e.to_string()))?;
        if !(1..=FORMAT_VERSION).contains(&file.format_version) {
            let problem = format!(
                "expected 1 to {FORMAT_VERSION}, found {}",
                file.format_version
            );
            return Err(Error::input(path, "format_version", problem));
        }
        let own = self.sha256();
        if file.pattern_sha256 != own {
            let problem = format!(
                "expected {own}, that of the pattern, found {}",
                file.pattern_sha256
            );
            return Err(Error::input(path, "pattern_sha256", problem));
        }
        let named = |e: Error| match e {
            Error::Argument { parameter, problem } => {
                Error::input(path, parameter.as_str(), problem)
            }
            other => other,
        };
        if let Some(design) = &file.design {
            design.check().map_err(named)?;
        }
        let pattern = self.with_keep_out(file.keep_out).map_err(named)?;
        Ok((pattern, file.design))
    }

    /// Writes the pattern as CSV atomically, and beside it its zones and `design`; where there is neither,
    /// what an earlier pattern had there is removed.
    #[cfg(feature = "native")]
    pub(crate) fn write_with(&self, csv: &Path, design: Option<&DesignRecord>) -> Result<()> {
        // Never what belongs to one pattern beside the dots of another, even for a moment.
        files::remove_if_present(&sidecar_path(csv))?;
        files::remove_if_present(&zones_path(csv))?;
        files::write_bytes(csv, self.to_csv().as_bytes())?;
        if self.keep_out.is_empty() && design.is_none() {
            return Ok(());
        }
        let file = Sidecar {
            format_version: FORMAT_VERSION,
            pattern_sha256: self.sha256(),
            keep_out: self.keep_out.clone(),
            design: design.cloned(),
        };
        let mut text = serde_json::to_string_pretty(&file)
            .map_err(|e| Error::Internal(format!("a pattern's sidecar as JSON: {e}")))?;
        text.push('\n');
        files::write_bytes(&sidecar_path(csv), text.as_bytes())
    }
}
