//! Tables with a row a frame: times, outlines.
//!
//! A row names a frame by its file's name, with or without the ending, and by as many of the
//! folders before it as it gives: `7`, `7.png` and `left/7.png` all name `run/left/7.png`. Of
//! several such rows the one that gives most folders counts. Frames of a video `film.mkv` are named
//! `film_000001`, `film_000002` and so on.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

use super::config::FrameClock;
use crate::error::{Error, Result};
use crate::files::csv::{Columns, Table, TableRow, shown};
use crate::files::{self, MAX_ROWS};
use crate::source::stem;
use crate::vision::frame::prior::OutlinePrior;
use crate::vision::optics::camera::{BallCircle, Pixel};

static TIMES: Columns<2> = Columns {
    names: ["frame", "time_s"],
    required: 0..2,
};
static CIRCLES: Columns<5> = Columns {
    names: ["frame", "u", "v", "radius", "sigma"],
    required: 0..4,
};

/// What a table says of each of some frames.
#[derive(Debug, Clone)]
pub struct FrameTable<T> {
    path: PathBuf,
    /// In the order of their names, folders and lines.
    rows: Vec<FrameRow<T>>,
}

/// The times of frames, seconds.
pub type FrameTimes = FrameTable<f64>;
/// The ball's outlines in frames.
pub type FrameCircles = FrameTable<OutlinePrior>;

#[derive(Debug, Clone)]
struct FrameRow<T> {
    line: u64,
    /// The frame's name and the folders before it, with `/` between them.
    frame: Box<str>,
    value: T,
}

impl<T> FrameRow<T> {
    /// The name, and the folders before it.
    fn named(&self) -> (&str, &str) {
        let parts = self.frame.rsplit_once('/');
        parts.map_or((&self.frame, ""), |(folders, name)| (name, folders))
    }

    /// How many folders the row gives.
    fn depth(&self) -> usize {
        self.frame.matches('/').count()
    }
}

/// Reads a table of times: CSV with the header `frame,time_s`.
///
/// # Errors
/// [`Error::Read`], or [`Error::Input`] naming the line: for what is no time, and for a frame that
/// occurs twice.
pub fn read_times(path: &Path) -> Result<FrameTimes> {
    read(path, &TIMES, |row| number(row, 1, "time_s", "seconds"))
}

/// How the files of times begin that `rpicam-vid --save-pts` and mkvextract write: milliseconds, one a frame.
const ORDERED: [&str; 2] = ["# timecode format v2", "# timestamp format v2"];

/// Reads the times of frames: of the names in a table ([`read_times`]), or of frames in their order, as `rpicam-vid --save-pts` writes them.
///
/// # Errors
/// As [`read_times`].
pub fn read_clock(path: &Path) -> Result<FrameClock> {
    let longest = ORDERED.map(str::len).into_iter().max().unwrap_or(0);
    let mut start = Vec::new();
    let read = std::io::Read::take(files::open(path)?, longest as u64);
    std::io::Read::read_to_end(&mut { read }, &mut start).map_err(|e| Error::read(path, e))?;
    if !ORDERED
        .iter()
        .any(|begin| start.starts_with(begin.as_bytes()))
    {
        return read_times(path).map(FrameClock::Table);
    }
    let text = files::read_at_most(path, files::MAX_FILE_BYTES)?;
    let text = String::from_utf8_lossy(&text);
    let mut times_s = Vec::new();
    for (k, line) in text.lines().enumerate().skip(1) {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let ms = line.parse().ok().filter(|ms: &f64| ms.is_finite());
        let ms = ms.ok_or_else(|| {
            let problem = format!("expected milliseconds, found \"{}\"", shown(line));
            Error::input(path, format!("line {}", k + 1), problem)
        })?;
        times_s.push(1e-3 * ms);
    }
    Ok(FrameClock::Ordered(path.to_path_buf(), times_s))
}

/// Reads a table of outlines: CSV with the header `frame,u,v,radius`, pixels, and where it is known `sigma`, the
/// standard deviation of all three; else that is [`OutlinePrior::given`]'s.
///
/// # Errors
/// [`Error::Read`], or [`Error::Input`] naming the line: for what is no circle, and for a frame that
/// occurs twice.
pub fn read_circles(path: &Path) -> Result<FrameCircles> {
    read(path, &CIRCLES, |row| {
        let center = Pixel {
            u: number(row, 1, "u", "pixels")?,
            v: number(row, 2, "v", "pixels")?,
        };
        let radius = number(row, 3, "radius", "pixels")?;
        if radius <= 0.0 {
            let problem = format!("radius: expected a positive number of pixels, found {radius}");
            return Err(row.error(problem));
        }
        let given = OutlinePrior::given(BallCircle::new(center, radius));
        let sigma_px = match row.number(4).map_err(|problem| row.error(problem))? {
            None => given.sigma_px,
            Some(sigma) if sigma > 0.0 && sigma <= radius => sigma,
            Some(sigma) => {
                let problem = format!(
                    "sigma: expected a positive number of pixels up to the radius, found {sigma}"
                );
                return Err(row.error(problem));
            }
        };
        Ok(OutlinePrior { sigma_px, ..given })
    })
}

fn number<const N: usize>(
    row: &TableRow<'_, N>,
    column: usize,
    name: &str,
    unit: &str,
) -> Result<f64> {
    let number = row.number(column).map_err(|problem| row.error(problem))?;
    number.ok_or_else(|| row.error(format!("{name}: expected {unit}, found nothing")))
}

fn read<T, const N: usize>(
    path: &Path,
    columns: &'static Columns<N>,
    value: impl Fn(&TableRow<'_, N>) -> Result<T>,
) -> Result<FrameTable<T>> {
    let mut table = Table::new(path, files::open(path)?, columns)?;
    let mut rows = Vec::new();
    while let Some(row) = table.next_row()? {
        if rows.len() == MAX_ROWS {
            return Err(row.error(format!("expected at most {MAX_ROWS} rows, found more")));
        }
        let frame = components(Path::new(row.text(0).unwrap_or_default())).join("/");
        if frame.is_empty() {
            return Err(row.error("frame: expected a name, found nothing"));
        }
        rows.push(FrameRow {
            line: row.line(),
            frame: frame.into(),
            value: value(&row)?,
        });
    }
    rows.sort_unstable_by(|a, b| (a.named(), a.line).cmp(&(b.named(), b.line)));
    let path = path.to_path_buf();
    let found = FrameTable { path, rows };
    let twice = |pair: &&[FrameRow<T>]| pair[0].named() == pair[1].named();
    let repeated = found.rows.windows(2).filter(twice);
    if let Some([before, row]) = repeated.min_by_key(|pair| pair[1].line) {
        let (frame, before) = (shown(&row.frame), before.line);
        let problem = format!("frame: \"{frame}\" occurs on line {before} already");
        return Err(found.error(row.line, problem));
    }
    Ok(found)
}

impl<T> FrameTable<T> {
    fn error(&self, line: u64, problem: String) -> Error {
        Error::input(&self.path, format!("line {line}"), problem)
    }
}

impl<T: Copy> FrameTable<T> {
    /// What the table says of each frame; frames by [`Frame::path`](crate::source::Frame::path).
    ///
    /// # Errors
    /// [`Error::Input`] for a frame that no row names, or two alike, and for a row that names two
    /// frames.
    pub fn of_frames(&self, frames: &[PathBuf]) -> Result<Vec<T>> {
        let mut taken: HashMap<usize, &Path> = HashMap::new();
        let mut values = Vec::with_capacity(frames.len());
        for frame in frames {
            let Some(i) = self.row_of(frame)? else {
                let problem = format!("expected a row for frame {}", frame.display());
                return Err(Error::input(&self.path, "file", problem));
            };
            let row = &self.rows[i];
            if let Some(other) = taken.insert(i, frame) {
                let (frame, other) = (frame.display(), other.display());
                let problem =
                    format!("frame: names both {other} and {frame}: expected their folders too");
                return Err(self.error(row.line, problem));
            }
            values.push(row.value);
        }
        Ok(values)
    }

    /// What the table says of a frame; `None` where no row names it.
    ///
    /// # Errors
    /// [`Error::Input`] for a frame that two rows name alike.
    pub fn of_frame(&self, frame: &Path) -> Result<Option<T>> {
        Ok(self.row_of(frame)?.map(|i| self.rows[i].value))
    }

    /// The lines of the rows that name none of these frames, in their order.
    ///
    /// # Errors
    /// As [`FrameTable::of_frame`].
    pub fn unused_lines(&self, frames: &[PathBuf]) -> Result<Vec<u64>> {
        let mut is_unused = vec![true; self.rows.len()];
        for frame in frames {
            if let Some(i) = self.row_of(frame)? {
                is_unused[i] = false;
            }
        }
        let rows = self.rows.iter().zip(is_unused);
        let mut lines: Vec<u64> = rows.filter(|(_, u)| *u).map(|(r, _)| r.line).collect();
        lines.sort_unstable();
        Ok(lines)
    }

    /// The row that names a frame most specifically.
    fn row_of(&self, frame: &Path) -> Result<Option<usize>> {
        let mut folders = components(frame);
        let name = folders.pop().unwrap_or_default();
        let folders = folders.join("/");
        // Whole components of the folders, the last ones.
        let is_last = |last: &str| match folders.strip_suffix(last) {
            Some(rest) => last.is_empty() || rest.is_empty() || rest.ends_with('/'),
            None => false,
        };
        let stem = stem(frame);
        let names = [Some(&name), Some(&stem).filter(|s| **s != name)];
        let rows = names.into_iter().flatten().flat_map(|name| {
            let [from, to] = [Ordering::Less, Ordering::Equal]
                .map(|most| self.rows.partition_point(|r| r.named().0.cmp(name) <= most));
            from..to
        });
        let mut naming: Vec<usize> = rows.filter(|&i| is_last(self.rows[i].named().1)).collect();
        naming.sort_by_key(|&i| std::cmp::Reverse(self.rows[i].depth()));
        match naming[..] {
            [] => Ok(None),
            [a, b, ..] if self.rows[a].depth() == self.rows[b].depth() => {
                let (a, b) = (self.rows[a].line, self.rows[b].line);
                let frame = frame.display();
                let problem = format!("frame: names {frame}, as does line {}", a.min(b));
                Err(self.error(a.max(b), problem))
            }
            [i, ..] => Ok(Some(i)),
        }
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
