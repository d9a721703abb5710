//! The folder of a data set.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::flight::FlightClip;
#[cfg(feature = "plot")]
use super::plots;
use super::record::{FORMAT_VERSION, Record};
use crate::error::{Error, Result};
use crate::files::{self, Replacement};
use crate::spin::trajectories::{INDEX, TrajectorySet};

/// The record, in a data set's folder.
const RECORD: &str = "dataset.json";
/// A data set's folders within its own.
const FOLDERS: [&str; 2] = ["orientations", "plots"];

/// A folder that a data set is written to.
#[derive(Debug)]
pub struct Destination {
    dir: PathBuf,
    overwrite: bool,
    set: Replacement,
}

impl Destination {
    /// Begins a data set of clips in a folder, which is made if it does not exist. Where it has files in a data set's places, they are
    /// replaced with `overwrite`, and only those that the `dataset.json` there lists.
    ///
    /// # Errors
    /// [`Error::Argument`] for a folder that is one of the clips, or that has files that are not replaced; [`Error::Write`] where the
    /// system refuses.
    pub fn begin(dir: &Path, clips: &[PathBuf], overwrite: bool) -> Result<Self> {
        let whole = |path: &Path| path.canonicalize().ok();
        if let Some(own) = whole(dir)
            && clips.iter().any(|clip| whole(clip).as_ref() == Some(&own))
        {
            let problem = format!("{} is a clip's own folder; choose another", dir.display());
            return Err(Error::argument("output", problem));
        }
        let this = Self {
            set: Replacement::begin(dir)?,
            dir: dir.to_path_buf(),
            overwrite,
        };
        this.replaced()?;
        Ok(this)
    }

    /// The files and folders that the new set replaces.
    fn replaced(&self) -> Result<Vec<String>> {
        let found = taken(&self.dir)?;
        let dir = self.dir.display();
        if let (Some(name), false) = (found.first(), self.overwrite) {
            let what = match self.dir.join(RECORD).exists() {
                true => "a data set",
                false => "a data set's name",
            };
            let problem = format!(
                "{dir} holds {what} already ({name}); choose another folder, or set overwrite"
            );
            return Err(Error::argument("output", problem));
        }
        let listed = match found.is_empty() {
            true => BTreeSet::new(),
            false => listed(&self.dir)?,
        };
        if let Some(name) = found.iter().find(|name| !listed.contains(*name)) {
            let problem = format!(
                "{dir} holds {name}, which no {RECORD} there lists; move it, or choose another folder"
            );
            return Err(Error::argument("output", problem));
        }
        let is_above = |name: &String| !name.contains('/');
        Ok(found.into_iter().filter(is_above).collect())
    }
}

/// What a folder has in the places of a data set, with `/` between a folder and what is in it.
fn taken(dir: &Path) -> Result<Vec<String>> {
    let mut found = Vec::new();
    for name in names(dir)? {
        let stem = name.strip_suffix(".csv").unwrap_or_default();
        // The authors' reader takes such a file for a flight.
        let is_flight = !stem.is_empty() && stem.bytes().all(|b| b.is_ascii_digit());
        let is_folder = FOLDERS.contains(&name.as_str());
        if is_folder && dir.join(&name).is_dir() {
            let inside = names(&dir.join(&name))?;
            found.extend(inside.iter().map(|inner| format!("{name}/{inner}")));
        }
        if is_flight || is_folder || [INDEX, RECORD].contains(&name.as_str()) {
            found.push(name);
        }
    }
    found.sort();
    Ok(found)
}

/// The names in a folder, also those that are no text.
fn names(dir: &Path) -> Result<Vec<String>> {
    let io = |e| Error::read(dir, e);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(io)? {
        names.push(
            entry
                .map_err(io)?
                .file_name()
                .to_string_lossy()
                .into_owned(),
        );
    }
    Ok(names)
}

/// The part of a record that says which files are its set's.
#[derive(Deserialize)]
struct Listed {
    format_version: u32,
    clips: Vec<ListedClip>,
}

#[derive(Deserialize)]
struct ListedClip {
    flights: Vec<ListedFlight>,
}

#[derive(Deserialize)]
struct ListedFlight {
    number: u32,
}

/// The files and folders of the data set in a folder, by its record; none where it has no record that can be read.
fn listed(dir: &Path) -> Result<BTreeSet<String>> {
    let path = dir.join(RECORD);
    if !path.exists() {
        return Ok(BTreeSet::new());
    }
    let text = files::read_bytes(&path)?;
    let record = serde_json::from_slice::<Listed>(&text);
    let Some(record) = record.ok().filter(|r| r.format_version == FORMAT_VERSION) else {
        return Ok(BTreeSet::new());
    };
    let mut listed: BTreeSet<String> = FOLDERS.map(String::from).into();
    listed.extend([INDEX, RECORD].map(String::from));
    for flight in record.clips.iter().flat_map(|clip| &clip.flights) {
        let number = flight.number;
        listed.extend([
            format!("{number:03}.csv"),
            format!("orientations/{number:03}.csv"),
            format!("plots/{number:03}_spin.png"),
            format!("plots/{number:03}_positions.png"),
        ]);
    }
    Ok(listed)
}

/// Writes a data set into a folder; it has all of it or nothing.
///
/// # Errors
/// [`Error::NoAnswer`] where no clip has a flight; those of [`Destination::begin`], where files came meanwhile.
pub fn write(to: Destination, clips: &[FlightClip], record: &Record) -> Result<()> {
    let flights = || clips.iter().flat_map(|clip| &clip.flights);
    if flights().next().is_none() {
        return Err(Error::NoAnswer {
            path: clips
                .first()
                .map_or(&*to.dir, |clip| &clip.path)
                .to_path_buf(),
            reason: "no clip shows the ball: there is no flight".into(),
        });
    }
    let set = &to.set;
    let trajectories = (0..)
        .zip(flights())
        .map(|(number, flight)| flight.trajectory(number));
    let trajectories = TrajectorySet {
        trajectories: trajectories.collect(),
        without_file: Vec::new(),
    };
    trajectories.write_dir(set.path())?;
    let rows = set.path().join(FOLDERS[0]);
    files::create_dir(&rows)?;
    for (number, flight) in flights().enumerate() {
        flight
            .file
            .write_csv(&rows.join(format!("{number:03}.csv")))?;
    }
    #[cfg(feature = "plot")]
    {
        let plots = set.path().join(FOLDERS[1]);
        files::create_dir(&plots)?;
        for (number, flight) in flights().enumerate() {
            plots::write(&plots, number, flight)?;
        }
    }
    let mut json = serde_json::to_string_pretty(record)
        .map_err(|e| Error::Internal(format!("{RECORD}: {e}")))?;
    json.push('\n');
    files::write_bytes(&set.path().join(RECORD), json.as_bytes())?;
    let old = to.replaced()?;
    let old: Vec<&str> = old.iter().map(String::as_str).collect();
    to.set.publish(&old, INDEX)
}
