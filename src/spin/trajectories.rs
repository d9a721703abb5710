//! Trajectories of balls with known spin, in the format of the published SpinDOE set.
//!
//! A folder with `index.csv` (header `traj_file,x_spin,y_spin,z_spin`; a number and a spin vector
//! in rad/s per trajectory) and a file `NNN.csv` for each, rows `t;x;y;z` in seconds and meters
//! without a header. The frame is the publisher's: z points up, and it is not the camera frame of
//! this crate.
//!
//! What cannot be read as numbers is an error, and so are two files of one number (`1.csv` and
//! `001.csv`). Not guaranteed: that values are plausible. Real recordings have repeated times, gaps,
//! jumps and missing numbers, and all of them are read as they are.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files;
use crate::files::csv::{CsvFormat, Rows};
use crate::geometry::Vec3;
use crate::stats::median;

/// The index of a folder.
pub const INDEX: &str = "index.csv";
/// The index's header.
const INDEX_HEADER: [&str; 4] = ["traj_file", "x_spin", "y_spin", "z_spin"];

/// Where a ball was at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPoint {
    /// Time, seconds.
    pub time_s: f64,
    /// Position, meters, in the publisher's frame.
    pub position_m: Vec3,
}

/// The trajectory of a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Its number, which is also its file's name.
    pub number: u32,
    /// Spin, rad/s, in the publisher's frame; `None` where the index has none.
    pub spin: Option<Vec3>,
    /// Its positions over time, in the order of the file.
    pub points: Vec<TrajectoryPoint>,
}

impl Trajectory {
    /// Magnitude of the spin in revolutions per second.
    pub fn rps(&self) -> Option<f64> {
        self.spin.map(|s| s.norm() / std::f64::consts::TAU)
    }

    /// Time from the first to the last point, seconds.
    pub fn duration_s(&self) -> f64 {
        match (self.points.first(), self.points.last()) {
            (Some(first), Some(last)) => last.time_s - first.time_s,
            _ => 0.0,
        }
    }

    /// Times between successive points, seconds.
    fn intervals(&self) -> impl Iterator<Item = f64> {
        self.points.windows(2).map(|w| w[1].time_s - w[0].time_s)
    }

    /// Speeds between successive points, m/s; only where time increases.
    fn speeds(&self) -> impl Iterator<Item = f64> {
        self.points.windows(2).filter_map(|w| {
            let interval = w[1].time_s - w[0].time_s;
            let distance = (w[1].position_m - w[0].position_m).norm();
            (interval > 0.0).then(|| distance / interval)
        })
    }
}

/// All trajectories of a folder, in order of number.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrajectorySet {
    /// The trajectories.
    pub trajectories: Vec<Trajectory>,
    /// Numbers in the index without a file, with their spins (rad/s).
    pub without_file: Vec<(u32, Vec3)>,
}

/// Values that describe a set.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Summary {
    /// Trajectories.
    pub trajectories: usize,
    /// Points of all trajectories.
    pub points: usize,
    /// Minimum, median and maximum number of points of a trajectory.
    pub points_each: [f64; 3],
    /// Shortest, median and longest trajectory, seconds.
    pub duration_s: [f64; 3],
    /// Median interval between points, seconds.
    pub interval_s: f64,
    /// Median speed, m/s.
    pub speed_m_s: f64,
    /// Smallest, median and largest spin, revolutions per second.
    pub rps: [f64; 3],
}

impl TrajectorySet {
    /// Reads a folder.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Input`] naming the line and what was expected there.
    pub fn read_dir(dir: &Path) -> Result<Self> {
        let mut spins = read_index(&dir.join(INDEX))?;
        let mut trajectories = Vec::new();
        for (number, path) in numbered_files(dir)? {
            trajectories.push(Trajectory {
                number,
                spin: spins.remove(&number),
                points: read_points(&path)?,
            });
        }
        Ok(Self {
            trajectories,
            without_file: spins.into_iter().collect(),
        })
    }

    /// Writes the set into a folder, as [`Self::read_dir`] reads it, bit by bit the same numbers: the index, and a file for each trajectory, whose
    /// names have three digits or more. Trajectories without a spin are not in the index.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write_dir(&self, dir: &Path) -> Result<()> {
        let spun = self
            .trajectories
            .iter()
            .filter_map(|t| Some((t.number, t.spin?)));
        let mut spins: Vec<(u32, Vec3)> = spun.chain(self.without_file.iter().copied()).collect();
        spins.sort_by_key(|(number, _)| *number);
        let mut index = INDEX_HEADER.join(",") + "\n";
        for (number, spin) in spins {
            let _ = writeln!(index, "{number},{},{},{}", spin.x, spin.y, spin.z);
        }
        for trajectory in &self.trajectories {
            let mut text = String::new();
            for TrajectoryPoint {
                time_s,
                position_m: p,
            } in &trajectory.points
            {
                let _ = writeln!(text, "{time_s};{};{};{}", p.x, p.y, p.z);
            }
            let path = dir.join(format!("{:03}.csv", trajectory.number));
            files::write_bytes(&path, text.as_bytes())?;
        }
        // A folder with an index is whole.
        files::write_bytes(&dir.join(INDEX), index.as_bytes())
    }

    /// Values that describe the set; zeros for an empty one.
    pub fn summary(&self) -> Summary {
        let all = || self.trajectories.iter();
        Summary {
            trajectories: self.trajectories.len(),
            points: all().map(|t| t.points.len()).sum(),
            points_each: spread(all().map(|t| t.points.len() as f64).collect()),
            duration_s: spread(all().map(Trajectory::duration_s).collect()),
            interval_s: median(&mut all().flat_map(Trajectory::intervals).collect::<Vec<_>>()),
            speed_m_s: median(&mut all().flat_map(Trajectory::speeds).collect::<Vec<_>>()),
            rps: spread(all().filter_map(Trajectory::rps).collect()),
        }
    }
}

/// Smallest, median and largest; zeros for none.
fn spread(mut values: Vec<f64>) -> [f64; 3] {
    let middle = median(&mut values);
    match (values.first(), values.last()) {
        (Some(min), Some(max)) => [*min, middle, *max],
        _ => [0.0; 3],
    }
}

/// The files of a folder whose names are numbers, in their order.
fn numbered_files(dir: &Path) -> Result<BTreeMap<u32, PathBuf>> {
    let entries = std::fs::read_dir(dir).map_err(|e| Error::read(dir, e))?;
    let mut found: BTreeMap<u32, PathBuf> = BTreeMap::new();
    for entry in entries {
        let path = entry.map_err(|e| Error::read(dir, e))?.path();
        let stem = path
            .file_stem()
            .and_then(|s| s.to_str())
            .unwrap_or_default();
        let is_csv = path.extension().is_some_and(|e| e == "csv");
        let is_numbered = !stem.is_empty() && stem.bytes().all(|b| b.is_ascii_digit());
        if !(is_csv && is_numbered) {
            continue;
        }
        let Ok(number) = stem.parse() else {
            let problem = format!("expected a number of at most {}", u32::MAX);
            return Err(Error::input(&path, "name", problem));
        };
        if let Some(other) = found.get(&number) {
            // Folders are listed in no particular order, messages are not.
            let (first, second) = if *other < path {
                (other, &path)
            } else {
                (&path, other)
            };
            let first = first.file_name().unwrap_or_default().to_string_lossy();
            let problem = format!("is trajectory {number}, and so is {first}");
            return Err(Error::input(second, "name", problem));
        }
        found.insert(number, path);
    }
    Ok(found)
}

fn read_index(path: &Path) -> Result<BTreeMap<u32, Vec3>> {
    let mut rows = Rows::new(path, files::open(path)?, format(b','));
    let expected = INDEX_HEADER.join(",");
    match rows.next_row()? {
        Some(header) if header.fields().eq(INDEX_HEADER) => {}
        Some(header) => {
            let found = header.shown();
            let problem = format!("expected the header \"{expected}\", found \"{found}\"");
            return Err(header.error(problem));
        }
        None => {
            let problem = format!("expected the header \"{expected}\", found nothing");
            return Err(Error::input(path, "line 1", problem));
        }
    }
    let mut spins = BTreeMap::new();
    while let Some(row) = rows.next_row()? {
        let number = row.get(0).and_then(|f| f.parse::<u32>().ok());
        let (Some(number), Some([_, x, y, z])) = (number, row.numbers()) else {
            let found = row.shown();
            let problem = format!("expected a number and a spin x,y,z, found \"{found}\"");
            return Err(row.error(problem));
        };
        if spins.insert(number, Vec3::new(x, y, z)).is_some() {
            return Err(row.error(format!("number {number} occurs twice")));
        }
    }
    Ok(spins)
}

fn read_points(path: &Path) -> Result<Vec<TrajectoryPoint>> {
    let mut rows = Rows::new(path, files::open(path)?, format(b';'));
    let mut points = Vec::new();
    while let Some(row) = rows.next_row()? {
        let Some([time_s, x, y, z]) = row.numbers() else {
            let found = row.shown();
            return Err(row.error(format!("expected numbers t;x;y;z, found \"{found}\"")));
        };
        points.push(TrajectoryPoint {
            time_s,
            position_m: Vec3::new(x, y, z),
        });
    }
    Ok(points)
}

/// The set's files have no comments.
fn format(delimiter: u8) -> CsvFormat {
    CsvFormat {
        delimiter,
        comments: false,
    }
}
