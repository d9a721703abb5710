//! Flights of balls with known spin, in the format of the published SpinDOE set.
//!
//! A folder with `index.csv` (header `traj_file,x_spin,y_spin,z_spin`; a number and a spin vector in rad/s
//! per flight) and a file `NNN.csv` for each, rows `t;x;y;z` in seconds and metres without a header. The
//! frame is the publisher's: z points up, and it is not the camera frame of this crate.
//!
//! What cannot be read as numbers is an error. What can be read but not be believed (times that stand
//! still, gaps, jumps, spins beyond the sampling's reach, holes in the numbering) is listed as an
//! [`Oddity`]: real recordings have them, and a reader should know.

mod oddities;

pub use oddities::{Limits, Oddity};

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files;
use crate::geometry::Vec3;
use crate::validate::median;

/// The index's header.
const INDEX_HEADER: [&str; 4] = ["traj_file", "x_spin", "y_spin", "z_spin"];

/// A flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Its number, which is also its file's name.
    pub number: u32,
    /// Spin, rad/s, in the publisher's frame; `None` where the index has none.
    pub spin: Option<Vec3>,
    /// Times (s) and positions (m), in the order of the file.
    pub points: Vec<(f64, Vec3)>,
}

impl Trajectory {
    /// Magnitude of the spin in revolutions per second.
    pub fn rps(&self) -> Option<f64> {
        self.spin.map(|s| s.norm() / std::f64::consts::TAU)
    }

    /// Time from the first to the last point, seconds.
    pub fn duration_s(&self) -> f64 {
        match (self.points.first(), self.points.last()) {
            (Some(first), Some(last)) => last.0 - first.0,
            _ => 0.0,
        }
    }

    /// Speeds between successive points, m/s, with the index of the later one; only where time goes on.
    fn speeds(&self) -> impl Iterator<Item = (usize, f64)> {
        self.points.windows(2).enumerate().filter_map(|(i, w)| {
            let interval = w[1].0 - w[0].0;
            (interval > 0.0).then(|| (i + 1, (w[1].1 - w[0].1).norm() / interval))
        })
    }
}

/// All flights of a folder, in order of number.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrajectorySet {
    /// The flights.
    pub trajectories: Vec<Trajectory>,
    /// Numbers in the index without a file, with their spins (rad/s).
    pub without_file: Vec<(u32, Vec3)>,
}

/// Figures that describe a set.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Summary {
    /// Flights.
    pub trajectories: usize,
    /// Points of all flights.
    pub points: usize,
    /// Fewest, median and most points of a flight.
    pub points_each: [f64; 3],
    /// Shortest, median and longest flight, seconds.
    pub duration_s: [f64; 3],
    /// Median interval between points, seconds.
    pub interval_s: f64,
    /// Median speed, m/s.
    pub speed_m_s: f64,
    /// Least, median and largest spin, revolutions per second.
    pub rps: [f64; 3],
}

impl TrajectorySet {
    /// Reads a folder.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Input`] naming the line and what was expected there.
    pub fn read_dir(dir: &Path) -> Result<Self> {
        let mut spins = read_index(&dir.join("index.csv"))?;
        let mut trajectories = Vec::new();
        for (number, path) in numbered_files(dir)? {
            let at = spins.iter().position(|s| s.0 == number);
            trajectories.push(Trajectory {
                number,
                spin: at.map(|i| spins.swap_remove(i).1),
                points: read_points(&path)?,
            });
        }
        trajectories.sort_by_key(|t| t.number);
        spins.sort_by_key(|s| s.0);
        Ok(Self {
            trajectories,
            without_file: spins,
        })
    }

    /// Writes the set as a folder in the same format; each file appears whole or not at all.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write_dir(&self, dir: &Path) -> Result<()> {
        files::create_dir(dir)?;
        let mut index = INDEX_HEADER.join(",") + "\n";
        let known = self
            .trajectories
            .iter()
            .filter_map(|t| Some((t.number, t.spin?)));
        let mut entries: Vec<_> = known.chain(self.without_file.iter().copied()).collect();
        entries.sort_by_key(|e| e.0);
        for (number, s) in entries {
            // Writing to a String cannot fail.
            let _ = writeln!(index, "{number},{},{},{}", s.x, s.y, s.z);
        }
        for t in &self.trajectories {
            let mut text = String::new();
            for (time, p) in &t.points {
                let [t, x, y, z] = [*time, p.x, p.y, p.z].map(decimal);
                let _ = writeln!(text, "{t};{x};{y};{z}");
            }
            let path = dir.join(format!("{:03}.csv", t.number));
            files::write_bytes(&path, text.as_bytes())?;
        }
        files::write_bytes(&dir.join("index.csv"), index.as_bytes())
    }

    /// Figures that describe the set; zeros for an empty one.
    pub fn summary(&self) -> Summary {
        let all = || self.trajectories.iter();
        let intervals = all().flat_map(|t| t.points.windows(2).map(|w| w[1].0 - w[0].0));
        Summary {
            trajectories: self.trajectories.len(),
            points: all().map(|t| t.points.len()).sum(),
            points_each: spread(all().map(|t| t.points.len() as f64).collect()),
            duration_s: spread(all().map(Trajectory::duration_s).collect()),
            interval_s: median(&mut intervals.collect::<Vec<_>>()),
            speed_m_s: median(
                &mut all()
                    .flat_map(|t| t.speeds().map(|s| s.1))
                    .collect::<Vec<_>>(),
            ),
            rps: spread(all().filter_map(Trajectory::rps).collect()),
        }
    }
}

/// Least, median and largest; zeros for none.
fn spread(mut values: Vec<f64>) -> [f64; 3] {
    let middle = median(&mut values);
    match (values.first(), values.last()) {
        (Some(least), Some(most)) => [*least, middle, *most],
        _ => [0.0; 3],
    }
}

/// The shortest text that reads back the same number, with three decimals at least, as published.
fn decimal(x: f64) -> String {
    let (short, padded) = (x.to_string(), format!("{x:.3}"));
    if short.len() > padded.len() {
        short
    } else {
        padded
    }
}

/// The files of a folder whose names are numbers.
fn numbered_files(dir: &Path) -> Result<Vec<(u32, PathBuf)>> {
    let entries = std::fs::read_dir(dir).map_err(|e| Error::read(dir, e))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| Error::read(dir, e))?.path();
        let stem = path.file_stem().and_then(|s| s.to_str());
        let is_csv = path.extension().is_some_and(|e| e == "csv");
        if let Some(number) = stem.filter(|_| is_csv).and_then(|s| s.parse().ok()) {
            found.push((number, path));
        }
    }
    Ok(found)
}

fn read_index(path: &Path) -> Result<Vec<(u32, Vec3)>> {
    let rows = read_rows(path, b',')?;
    let header = rows.first().map(|r| r.1.as_slice()).unwrap_or_default();
    if header != INDEX_HEADER {
        let problem = format!(
            "expected the header \"{}\", found \"{}\"",
            INDEX_HEADER.join(","),
            header.join(",")
        );
        return Err(Error::input(path, "line 1", problem));
    }
    let mut spins: Vec<(u32, Vec3)> = Vec::new();
    for (line, fields) in &rows[1..] {
        let at = |problem: String| Error::input(path, format!("line {line}"), problem);
        let number = fields.first().and_then(|f| f.parse::<u32>().ok());
        let spin = fields.get(1..).and_then(numbers::<3>);
        let (Some(number), Some([x, y, z])) = (number, spin) else {
            let found = fields.join(",");
            return Err(at(format!(
                "expected a number and a spin x,y,z, found \"{found}\""
            )));
        };
        if spins.iter().any(|s| s.0 == number) {
            return Err(at(format!("number {number} occurs twice")));
        }
        spins.push((number, Vec3::new(x, y, z)));
    }
    Ok(spins)
}

fn read_points(path: &Path) -> Result<Vec<(f64, Vec3)>> {
    let point = |(line, fields): &(u64, Vec<String>)| match numbers::<4>(fields) {
        Some([t, x, y, z]) => Ok((t, Vec3::new(x, y, z))),
        None => {
            let problem = format!("expected numbers t;x;y;z, found \"{}\"", fields.join(";"));
            Err(Error::input(path, format!("line {line}"), problem))
        }
    };
    read_rows(path, b';')?.iter().map(point).collect()
}

/// `N` finite numbers and nothing else.
fn numbers<const N: usize>(fields: &[String]) -> Option<[f64; N]> {
    let parsed = fields
        .iter()
        .map(|f| f.parse().ok().filter(|x: &f64| x.is_finite()));
    parsed.collect::<Option<Vec<f64>>>()?.try_into().ok()
}

/// The fields of each row, with its line.
fn read_rows(path: &Path, delimiter: u8) -> Result<Vec<(u64, Vec<String>)>> {
    let bytes = files::read_bytes(path)?;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .delimiter(delimiter)
        .trim(csv::Trim::All)
        .from_reader(bytes.as_slice());
    let mut rows = Vec::new();
    for (i, record) in reader.records().enumerate() {
        let record =
            record.map_err(|e| Error::input(path, format!("row {}", i + 1), e.to_string()))?;
        let line = files::line_of(&bytes, record.position(), i as u64 + 1);
        rows.push((line, record.iter().map(str::to_owned).collect()));
    }
    Ok(rows)
}
