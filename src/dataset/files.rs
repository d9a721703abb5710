//! The folder of a data set.

use std::path::Path;

use super::flight::Clip;
#[cfg(feature = "plot")]
use super::plots;
use super::record::Record;
use crate::error::{Error, Result};
use crate::files::{self, Replacement};
use crate::spin::trajectories::{INDEX, TrajectorySet};

/// What a folder with a data set holds; numbered files and folders besides.
pub const FILES: [&str; 2] = [INDEX, "dataset.json"];

/// Writes a data set into a folder by a set of files that was begun for it; the folder has all of it or nothing.
///
/// # Errors
/// [`Error::NoAnswer`] where no clip has a flight; [`Error::Write`] where the system refuses.
pub fn write(set: Replacement, dir: &Path, clips: &[Clip], record: &Record) -> Result<()> {
    let flights = || clips.iter().flat_map(|clip| &clip.flights);
    if flights().next().is_none() {
        return Err(Error::NoAnswer {
            path: clips.first().map_or(dir, |clip| &clip.path).to_path_buf(),
            reason: "no clip shows the ball: there is no flight".into(),
        });
    }
    let trajectories = (0..)
        .zip(flights())
        .map(|(number, flight)| flight.trajectory(number));
    let trajectories = TrajectorySet {
        trajectories: trajectories.collect(),
        without_file: Vec::new(),
    };
    trajectories.write_dir(set.path())?;
    let rows = set.path().join("orientations");
    files::create_dir(&rows)?;
    for (number, flight) in flights().enumerate() {
        flight
            .file
            .write_csv(&rows.join(format!("{number:03}.csv")))?;
    }
    #[cfg(feature = "plot")]
    {
        let plots = set.path().join("plots");
        files::create_dir(&plots)?;
        for (number, flight) in flights().enumerate() {
            plots::write(&plots, number, flight)?;
        }
    }
    let mut json = serde_json::to_string_pretty(record)
        .map_err(|e| Error::Internal(format!("dataset.json: {e}")))?;
    json.push('\n');
    files::write_bytes(&set.path().join("dataset.json"), json.as_bytes())?;
    // Flights of an earlier set that had more.
    let old = numbered(dir)?;
    let old: Vec<&str> = old.iter().map(String::as_str).collect();
    set.publish(&old, INDEX)
}

/// The files of a folder that the authors' reader takes for flights.
fn numbered(dir: &Path) -> Result<Vec<String>> {
    let entries = std::fs::read_dir(dir).map_err(|e| Error::read(dir, e))?;
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let is_flight = |name: &String| {
        let stem = name.strip_suffix(".csv").unwrap_or_default();
        !stem.is_empty() && stem.bytes().all(|b| b.is_ascii_digit())
    };
    Ok(names.filter(is_flight).collect())
}
