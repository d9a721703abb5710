//! Flights of balls with known spin, in the format of the published SpinDOE set.
//!
//! A folder with `index.csv` (header `traj_file,x_spin,y_spin,z_spin`; a number and a spin vector in rad/s
//! per flight) and a file `NNN.csv` for each, rows `t;x;y;z` in seconds and metres without a header. The
//! frame is the publisher's: z points up, and it is not the camera frame of this crate.
//!
//! What cannot be read as numbers is an error. What can be read but not be believed (times that stand
//! still, gaps, jumps, spins beyond the sampling's reach, holes in the numbering) is listed as an
//! [`Oddity`]: real recordings have them, and a reader should know.

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

/// What is plausible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest spin, revolutions per second.
    pub max_rps: f64,
    /// Largest speed, m/s.
    pub max_speed: f64,
    /// Largest distance of a position from the origin, m.
    pub max_distance: f64,
    /// Least height z, m; a lower point means that the ball has missed the table.
    pub min_height: f64,
    /// Longest interval between points, in median intervals of the flight.
    pub max_gap: f64,
    /// Fewest points.
    pub min_points: usize,
}

impl Default for Limits {
    /// 175 rps (half a turn a frame at the paper's 350 frames per second: faster ones cannot have been
    /// measured so); 20 m/s (the set's median is 5, and a ball shot by a robot does not double it in one
    /// interval); 5 m; 5 cm below the table, whose top is z = 0; three intervals (two frames missing); ten points.
    fn default() -> Self {
        Self {
            max_rps: 175.0,
            max_speed: 20.0,
            max_distance: 5.0,
            min_height: -0.05,
            max_gap: 3.5,
            min_points: 10,
        }
    }
}

/// Something in a set that a user should know of. Rows count from 1, as editors do.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Oddity {
    /// Numbers left out.
    #[error("{}", hole(*first, *last))]
    Hole {
        /// First number left out.
        first: u32,
        /// Last number left out.
        last: u32,
    },
    /// A number in the index has no file.
    #[error("{number:03}.csv is in the index, but there is no such file")]
    NoFile {
        /// The number.
        number: u32,
    },
    /// A file is not in the index.
    #[error("{number:03}.csv is not in the index: its spin is unknown")]
    NoSpin {
        /// The number.
        number: u32,
    },
    /// Two flights have exactly the same spin.
    #[error("{number:03}.csv has exactly the spin of {other:03}.csv")]
    SameSpin {
        /// The later number.
        number: u32,
        /// The earlier number.
        other: u32,
    },
    /// A spin beyond the limit.
    #[error("{number:03}.csv: {rps:.1} rps, expected at most {limit:.0}")]
    Spin {
        /// The flight.
        number: u32,
        /// Its spin.
        rps: f64,
        /// The limit.
        limit: f64,
    },
    /// Few points.
    #[error("{number:03}.csv: {points} points, expected at least {limit}")]
    Short {
        /// The flight.
        number: u32,
        /// Its points.
        points: usize,
        /// The limit.
        limit: usize,
    },
    /// Time does not go on.
    #[error(
        "{number:03}.csv, line {line}: {interval_s:.3} s after the line before, expected more than 0"
    )]
    Time {
        /// The flight.
        number: u32,
        /// The row.
        line: usize,
        /// Time since the row before, seconds.
        interval_s: f64,
    },
    /// A gap in time.
    #[error("{number:03}.csv, line {line}: a gap of {interval_s:.3} s, {intervals:.1} intervals")]
    Gap {
        /// The flight.
        number: u32,
        /// The row after the gap.
        line: usize,
        /// Its length, seconds.
        interval_s: f64,
        /// Its length in median intervals.
        intervals: f64,
    },
    /// A jump.
    #[error(
        "{number:03}.csv, line {line}: {speed:.1} m/s since the line before, expected at most {limit:.0}"
    )]
    Speed {
        /// The flight.
        number: u32,
        /// The row after the jump.
        line: usize,
        /// Speed from the row before, m/s.
        speed: f64,
        /// The limit, m/s.
        limit: f64,
    },
    /// Positions below the table.
    #[error("{number:03}.csv, line {line}: below the table, later down to {height:.3} m")]
    Below {
        /// The flight.
        number: u32,
        /// The first such row.
        line: usize,
        /// Least height of the flight, m.
        height: f64,
    },
    /// A position far away.
    #[error(
        "{number:03}.csv, line {line}: {distance:.2} m from the origin, expected at most {limit:.0}"
    )]
    Position {
        /// The flight.
        number: u32,
        /// The row.
        line: usize,
        /// Distance from the origin, m.
        distance: f64,
        /// The limit, m.
        limit: f64,
    },
}

fn hole(first: u32, last: u32) -> String {
    if first == last {
        format!("number {first} is missing")
    } else {
        format!("numbers {first} to {last} are missing")
    }
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

    /// Everything that is odd about the set.
    pub fn oddities(&self, limits: &Limits) -> Vec<Oddity> {
        let mut found = self.set_oddities();
        for t in &self.trajectories {
            flight_oddities(t, limits, &mut found);
        }
        found
    }

    fn set_oddities(&self) -> Vec<Oddity> {
        let mut found = Vec::new();
        let mut next = 0;
        for t in &self.trajectories {
            if t.number > next {
                let (first, last) = (next, t.number - 1);
                found.push(Oddity::Hole { first, last });
            }
            next = t.number + 1;
        }
        for &(number, _) in &self.without_file {
            found.push(Oddity::NoFile { number });
        }
        for (i, t) in self.trajectories.iter().enumerate() {
            let number = t.number;
            if t.spin.is_none() {
                found.push(Oddity::NoSpin { number });
            }
            let same = |o: &&Trajectory| o.spin.is_some() && o.spin == t.spin;
            if let Some(o) = self.trajectories[..i].iter().find(same) {
                let other = o.number;
                found.push(Oddity::SameSpin { number, other });
            }
        }
        found
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

fn flight_oddities(t: &Trajectory, limits: &Limits, found: &mut Vec<Oddity>) {
    let number = t.number;
    if let Some(rps) = t.rps().filter(|r| *r > limits.max_rps) {
        let limit = limits.max_rps;
        found.push(Oddity::Spin { number, rps, limit });
    }
    if t.points.len() < limits.min_points {
        let (points, limit) = (t.points.len(), limits.min_points);
        found.push(Oddity::Short {
            number,
            points,
            limit,
        });
    }
    let intervals = || t.points.windows(2).map(|w| w[1].0 - w[0].0).enumerate();
    let typical = median(&mut intervals().map(|i| i.1).collect::<Vec<_>>());
    for (i, interval_s) in intervals() {
        let line = i + 2;
        if interval_s <= 0.0 {
            found.push(Oddity::Time {
                number,
                line,
                interval_s,
            });
        }
        let intervals = interval_s / typical;
        if intervals > limits.max_gap {
            found.push(Oddity::Gap {
                number,
                line,
                interval_s,
                intervals,
            });
        }
    }
    for (i, speed) in t.speeds().filter(|s| s.1 > limits.max_speed) {
        let (line, limit) = (i + 1, limits.max_speed);
        found.push(Oddity::Speed {
            number,
            line,
            speed,
            limit,
        });
    }
    if let Some(i) = t.points.iter().position(|p| p.1.z < limits.min_height) {
        let height = t.points.iter().map(|p| p.1.z).fold(f64::INFINITY, f64::min);
        let line = i + 1;
        found.push(Oddity::Below {
            number,
            line,
            height,
        });
    }
    for (i, (_, p)) in t.points.iter().enumerate() {
        let (distance, limit) = (p.norm(), limits.max_distance);
        if distance > limit {
            let line = i + 1;
            found.push(Oddity::Position {
                number,
                line,
                distance,
                limit,
            });
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
        let line = record.position().map_or(i as u64 + 1, csv::Position::line);
        rows.push((line, record.iter().map(str::to_owned).collect()));
    }
    Ok(rows)
}
