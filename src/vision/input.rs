//! Images from files, folders and videos, in the order in which they were taken.
//!
//! Folders are read for files with the extension of an image. Names are sorted by number and not by
//! letter: runs of digits compare as numbers, so that "3333333" comes before "103333323". Images
//! and videos whose metadata says that the camera was rotated are rotated upright. Times: a file's
//! stem as an integer is nanoseconds (SpinDOE's convention); a video's frames have the container's
//! own time stamps, even or not; [`read_times`] reads others from a table. [`video`](super::video)
//! reads the frames of videos.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

use super::picture::Picture;
pub use super::video::VideoClock;
use super::video::read_video;
use crate::error::{Error, Result};
use crate::files;
use crate::files::csv::{Columns, Table, shown};

/// Endings of image files, lower case.
const IMAGES: [&str; 10] = [
    "png", "jpg", "jpeg", "bmp", "tif", "tiff", "pgm", "ppm", "pnm", "pbm",
];
/// Endings of video files, lower case.
const VIDEOS: [&str; 9] = [
    "mp4", "avi", "mov", "mkv", "webm", "m4v", "mpg", "mpeg", "wmv",
];

/// Compares names in natural order: runs of digits as numbers, the rest by letter. Names that
/// differ only in leading zeros are ordered by these.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    loop {
        let (x, y) = (digits(left), digits(right));
        if x > 0 && y > 0 {
            let number = |s: &str| s.trim_start_matches('0').to_owned();
            let (m, n) = (number(&left[..x]), number(&right[..y]));
            let by_number = m.len().cmp(&n.len()).then_with(|| m.cmp(&n));
            if by_number != Ordering::Equal {
                return by_number;
            }
            (left, right) = (&left[x..], &right[y..]);
            continue;
        }
        match (left.chars().next(), right.chars().next()) {
            (None, None) => return a.cmp(b),
            (Some(c), Some(d)) if c == d => {
                (left, right) = (&left[c.len_utf8()..], &right[d.len_utf8()..]);
            }
            (c, d) => return c.cmp(&d),
        }
    }
}

/// Number of digits at the start, which are bytes.
fn digits(text: &str) -> usize {
    text.bytes().take_while(u8::is_ascii_digit).count()
}

/// The time of a file whose stem is an integer number of nanoseconds, seconds.
pub fn time_of_stem(stem: &str) -> Option<f64> {
    stem.parse::<u64>().ok().map(|ns| ns as f64 / 1e9)
}

/// A file to read frames from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// One image.
    Image(PathBuf),
    /// A video.
    Video(PathBuf),
}

/// A frame as read.
#[derive(Debug)]
pub struct InputFrame {
    /// The file's stem, or the video's with the frame's number.
    pub name: String,
    /// The file; a video's frame is named as if it were a file beside the video.
    pub path: PathBuf,
    /// Seconds, where the name says it.
    pub time_s: Option<f64>,
    /// The picture, or why the file is none.
    pub picture: Result<Picture>,
}

/// The times of a source's frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SourceTimes {
    /// One a frame, seconds; empty for an image.
    pub times_s: Vec<Option<f64>>,
    /// The clock of a video.
    pub clock: Option<VideoClock>,
    /// Why a video ends early, where it does.
    pub cut_short: Option<String>,
}

/// Files in a folder that are no images, which are passed over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SkippedFiles {
    /// The folder.
    pub folder: PathBuf,
    /// The names, in natural order.
    pub names: Vec<String>,
}

/// What files and folders hold.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SourceList {
    /// The sources, in order.
    pub sources: Vec<Source>,
    /// What is passed over.
    pub skipped: Vec<SkippedFiles>,
}

/// The sources behind files and folders, in order, and what the folders hold beside. A file that is
/// named is taken whatever its ending.
///
/// # Errors
/// [`Error::Read`] where a path cannot be read, [`Error::Input`] for a folder without images.
pub fn list_sources(paths: &[PathBuf]) -> Result<SourceList> {
    let mut found = Vec::new();
    let mut all_skipped = Vec::new();
    for path in paths {
        let kind = std::fs::metadata(path).map_err(|e| Error::read(path, e))?;
        if !kind.is_dir() {
            found.push(path.clone());
            continue;
        }
        let before = found.len();
        let mut skipped = Vec::new();
        for entry in std::fs::read_dir(path).map_err(|e| Error::read(path, e))? {
            let file = entry.map_err(|e| Error::read(path, e))?.path();
            if has_ending(&file, &IMAGES) && file.is_file() {
                found.push(file);
            } else {
                let name = file.file_name().unwrap_or_default();
                skipped.push(name.to_string_lossy().into_owned());
            }
        }
        if found.len() == before {
            let problem = format!("expected images ({}), found none", IMAGES.join(", "));
            return Err(Error::input(path, "folder", problem));
        }
        if !skipped.is_empty() {
            skipped.sort_by(|a, b| natural_order(a, b));
            all_skipped.push(SkippedFiles {
                folder: path.clone(),
                names: skipped,
            });
        }
    }
    found.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    found.dedup();
    let source = |path: PathBuf| {
        if has_ending(&path, &VIDEOS) {
            Source::Video(path)
        } else {
            Source::Image(path)
        }
    };
    Ok(SourceList {
        sources: found.into_iter().map(source).collect(),
        skipped: all_skipped,
    })
}

/// The sources of [`list_sources`] alone.
///
/// # Errors
/// Those of [`list_sources`].
pub fn sources(paths: &[PathBuf]) -> Result<Vec<Source>> {
    Ok(list_sources(paths)?.sources)
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    ending.is_some_and(|e| endings.contains(&e.as_str()))
}

pub(super) fn stem(path: &Path) -> String {
    path.file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

/// Passes the frames of a source on one by one, pictures of up to `max_pixels` pixels. A file that
/// is no image comes as a frame with the reason. A video's times are known at its end only: they
/// are returned.
///
/// # Errors
/// Those of reading a video, and of `visit`.
pub fn read_frames(
    source: &Source,
    max_pixels: u64,
    visit: &mut dyn FnMut(InputFrame) -> Result<()>,
) -> Result<SourceTimes> {
    match source {
        Source::Image(path) => {
            let name = stem(path);
            visit(InputFrame {
                time_s: time_of_stem(&name),
                name,
                path: path.clone(),
                picture: Picture::read(path, max_pixels),
            })?;
            Ok(SourceTimes::default())
        }
        Source::Video(path) => read_video(path, max_pixels, visit),
    }
}

static COLUMNS: Columns<2> = Columns {
    names: ["frame", "time_s"],
    required: 0..2,
};

/// Reads a table of times: CSV with the header `frame,time_s`; see [`FrameTimes`].
///
/// # Errors
/// [`Error::Read`], or [`Error::Input`] naming the line: for what is no time, and for a frame that
/// occurs twice.
pub fn read_times(path: &Path) -> Result<FrameTimes> {
    let mut table = Table::new(path, files::open(path)?, &COLUMNS)?;
    let mut found = FrameTimes {
        path: path.to_path_buf(),
        rows: Vec::new(),
        by_name: HashMap::new(),
    };
    while let Some(row) = table.next_row()? {
        let frame = row.text(0).unwrap_or_default();
        let mut folders = components(Path::new(frame));
        let Some(name) = folders.pop() else {
            return Err(row.error("frame: expected a name, found nothing"));
        };
        let time_s = row.number(1).map_err(|problem| row.error(problem))?;
        let Some(time_s) = time_s else {
            return Err(row.error("time_s: expected seconds, found nothing"));
        };
        let same = found.by_name.entry(name).or_default();
        if let Some(&before) = same.iter().find(|&&i| found.rows[i].folders == folders) {
            let (frame, before) = (shown(frame), found.rows[before].line);
            let problem = format!("frame: \"{frame}\" occurs on line {before} already");
            return Err(row.error(problem));
        }
        same.push(found.rows.len());
        found.rows.push(TimeRow {
            line: row.line(),
            folders,
            time_s,
        });
    }
    Ok(found)
}

/// The times of frames, by their names.
///
/// A row names a frame by its file's name, with or without the ending, and by as many of the
/// folders before it as it gives: `7`, `7.png` and `left/7.png` all name `run/left/7.png`. Of
/// several such rows the one that gives most folders counts. Frames of a video `film.mkv` are named
/// `film_000001`, `film_000002` and so on.
#[derive(Debug, Clone)]
pub struct FrameTimes {
    path: PathBuf,
    rows: Vec<TimeRow>,
    /// Rows by the last component of their names.
    by_name: HashMap<String, Vec<usize>>,
}

#[derive(Debug, Clone)]
struct TimeRow {
    line: u64,
    folders: Vec<String>,
    time_s: f64,
}

impl FrameTimes {
    /// The time of each frame, seconds; frames by [`InputFrame::path`].
    ///
    /// # Errors
    /// [`Error::Input`] for a frame that no row names, or two alike, and for a row that names two
    /// frames.
    pub fn of_frames(&self, frames: &[PathBuf]) -> Result<Vec<f64>> {
        let mut taken: HashMap<usize, &Path> = HashMap::new();
        let mut times = Vec::with_capacity(frames.len());
        for frame in frames {
            let i = self.row_of(frame)?;
            let row = &self.rows[i];
            if let Some(other) = taken.insert(i, frame) {
                let (frame, other) = (frame.display(), other.display());
                let problem =
                    format!("frame: names both {other} and {frame}: expected their folders too");
                return Err(self.error(row.line, problem));
            }
            times.push(row.time_s);
        }
        Ok(times)
    }

    /// The row that names a frame most specifically.
    fn row_of(&self, frame: &Path) -> Result<usize> {
        let mut folders = components(frame);
        let name = folders.pop().unwrap_or_default();
        let stem = stem(frame);
        let names = [Some(&name), Some(&stem).filter(|s| **s != name)];
        let rows = names
            .into_iter()
            .flatten()
            .filter_map(|n| self.by_name.get(n))
            .flatten()
            .copied();
        let mut naming: Vec<usize> = rows
            .filter(|&i| folders.ends_with(&self.rows[i].folders))
            .collect();
        naming.sort_by_key(|&i| std::cmp::Reverse(self.rows[i].folders.len()));
        let frame = frame.display();
        match naming[..] {
            [] => {
                let problem = format!("expected a time of frame {frame}");
                Err(Error::input(&self.path, "file", problem))
            }
            [a, b, ..] if self.rows[a].folders.len() == self.rows[b].folders.len() => {
                let (a, b) = (self.rows[a].line, self.rows[b].line);
                let problem = format!("frame: names {frame}, as does line {}", a.min(b));
                Err(self.error(a.max(b), problem))
            }
            [i, ..] => Ok(i),
        }
    }

    fn error(&self, line: u64, problem: String) -> Error {
        Error::input(&self.path, format!("line {line}"), problem)
    }
}

/// The folders and the name of a path, without `.` components.
fn components(path: &Path) -> Vec<String> {
    let component = |c| match c {
        Component::CurDir => None,
        other => Some(other.as_os_str().to_string_lossy().into_owned()),
    };
    path.components().filter_map(component).collect()
}
