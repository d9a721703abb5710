//! Reading a folder that a command wrote: JSON, tables, and whether they belong together.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::ball::Ball;
use crate::error::{Error, Result};
use crate::files;

/// A report as `T`, of the version that is known.
pub(super) fn report<T: DeserializeOwned>(path: &Path, version: u32) -> Result<T> {
    /// What every report begins with.
    #[derive(Deserialize)]
    struct ReportHead {
        format_version: u32,
    }
    let found = parsed::<ReportHead>(path)?.format_version;
    if found != version {
        let problem = format!("expected version {version}, found {found}");
        return Err(Error::input(path, "format_version", problem));
    }
    parsed(path)
}

/// Writes a report.
pub(super) fn write_report(path: &Path, report: &impl Serialize) -> Result<()> {
    let mut json = serde_json::to_string_pretty(report)
        .map_err(|e| Error::Internal(format!("report as JSON: {e}")))?;
    json.push('\n');
    files::write_bytes(path, json.as_bytes())
}

/// A file of JSON as `T`.
pub(super) fn parsed<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = files::read_bytes(path)?;
    serde_json::from_slice(&bytes)
        .map_err(|e| Error::input(path, format!("line {}", e.line()), e.to_string()))
}

/// The ball of the folder's table, where it is there and that of the pattern.
pub(super) fn read_ball(dir: &Path, sha256: &str) -> Result<Option<Ball>> {
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
