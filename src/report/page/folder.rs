//! Reading a folder that a command wrote: JSON, tables, and whether they belong together.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::ball::Ball;
use crate::error::{Error, Result};
use crate::files;
use crate::stats::Proportion;

/// Rates in a page.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Rates {
    /// None where one holds for all.
    #[serde(default)]
    pub recognizer: Option<String>,
    pub protocol: String,
    pub samples: u64,
    pub sigma_deg: f64,
    pub skipped: u64,
    pub identity: Proportion,
    pub orientation: Proportion,
    /// `None` where no view succeeded.
    pub mean_error_deg: Option<f64>,
    pub median_error_deg: Option<f64>,
}

/// Rejects a report of a version that is not known yet.
pub(in crate::report) fn known_version(path: &Path, found: u32, newest: u32) -> Result<()> {
    if found <= newest {
        return Ok(());
    }
    let problem = format!("expected at most version {newest}, found {found}");
    Err(Error::input(path, "format_version", problem))
}

/// A file of JSON as `T`.
pub(in crate::report) fn parsed<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = files::read_bytes(path)?;
    serde_json::from_slice(&bytes)
        .map_err(|e| Error::input(path, format!("line {}", e.line()), e.to_string()))
}

/// The ball of the folder's table, where it is there and that of the pattern.
pub(in crate::report) fn read_ball(dir: &Path, sha256: &str) -> Result<Option<Ball>> {
    let path = dir.join("table.npz");
    if !path.exists() {
        return Ok(None);
    }
    let ball = Ball::read_npz(&path)?;
    same_pattern(&path, "meta", &ball.pattern().sha256(), sha256)?;
    Ok(Some(ball))
}

pub(super) fn same_pattern(path: &Path, place: &str, found: &str, expected: &str) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    let problem = format!("expected pattern {expected:.12} as in report.json, found {found:.12}");
    Err(Error::input(path, place, problem))
}
