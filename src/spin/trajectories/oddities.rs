//! Anomalies of a set of trajectories.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::{Trajectory, TrajectoryPoint, TrajectorySet};
use crate::validate::median;

/// What is plausible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest spin, revolutions per second.
    pub max_rps: f64,
    /// Largest speed, m/s.
    pub max_speed: f64,
    /// Largest distance of a position from the origin, m.
    pub max_distance: f64,
    /// Minimum height z, m; a lower point means that the ball has missed the table.
    pub min_height: f64,
    /// Longest interval between points, in median intervals of the trajectory.
    pub max_gap: f64,
    /// Minimum number of points.
    pub min_points: usize,
}

impl Default for Limits {
    /// 175 rps (half a turn a frame at the paper's 350 frames per second: faster ones cannot have
    /// been measured so); 20 m/s (the set's median is 5, and a ball shot by a robot does not double
    /// it in one interval); 5 m; 5 cm below the table, whose top is z = 0; three intervals (two
    /// frames missing); ten points.
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

/// An anomaly in a set. Lines count from 1, as editors do.
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
    /// Two trajectories have exactly the same spin.
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
        /// The trajectory.
        number: u32,
        /// Its spin.
        rps: f64,
        /// The limit.
        limit: f64,
    },
    /// Few points.
    #[error("{number:03}.csv: {points} points, expected at least {limit}")]
    Short {
        /// The trajectory.
        number: u32,
        /// Its points.
        points: usize,
        /// The limit.
        limit: usize,
    },
    /// Time does not increase.
    #[error(
        "{number:03}.csv, line {line}: {interval_s:.3} s after the line before, expected more than 0"
    )]
    Time {
        /// The trajectory.
        number: u32,
        /// The line.
        line: u64,
        /// Time since the line before, seconds.
        interval_s: f64,
    },
    /// A gap in time.
    #[error("{number:03}.csv, line {line}: a gap of {interval_s:.3} s, {intervals:.1} intervals")]
    Gap {
        /// The trajectory.
        number: u32,
        /// The line after the gap.
        line: u64,
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
        /// The trajectory.
        number: u32,
        /// The line after the jump.
        line: u64,
        /// Speed from the line before, m/s.
        speed: f64,
        /// The limit, m/s.
        limit: f64,
    },
    /// Positions below the table.
    #[error("{number:03}.csv, line {line}: below the table, later down to {height:.3} m")]
    Below {
        /// The trajectory.
        number: u32,
        /// The first such line.
        line: u64,
        /// Minimum height of the trajectory, m.
        height: f64,
    },
    /// A position far away.
    #[error(
        "{number:03}.csv, line {line}: {distance:.2} m from the origin, expected at most {limit:.0}"
    )]
    Position {
        /// The trajectory.
        number: u32,
        /// The line.
        line: u64,
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

impl TrajectorySet {
    /// All anomalies of the set.
    pub fn oddities(&self, limits: &Limits) -> Vec<Oddity> {
        let mut found = self.set_oddities();
        for t in &self.trajectories {
            trajectory_oddities(t, limits, &mut found);
        }
        found
    }

    fn set_oddities(&self) -> Vec<Oddity> {
        let mut found = Vec::new();
        // The number that is expected next; none after the last that there is.
        let mut next = Some(0);
        for t in &self.trajectories {
            if let Some(first) = next.filter(|n| t.number > *n) {
                let last = t.number - 1;
                found.push(Oddity::Hole { first, last });
            }
            next = t.number.checked_add(1);
        }
        for &(number, _) in &self.without_file {
            found.push(Oddity::NoFile { number });
        }
        // Zeros of either sign are the same spin, and nothing else has two patterns of bits.
        let mut first_with = HashMap::new();
        for t in &self.trajectories {
            let number = t.number;
            let Some(spin) = t.spin else {
                found.push(Oddity::NoSpin { number });
                continue;
            };
            match first_with.entry([spin.x, spin.y, spin.z].map(|c| (c + 0.0).to_bits())) {
                Entry::Occupied(first) => {
                    let other = *first.get();
                    found.push(Oddity::SameSpin { number, other });
                }
                Entry::Vacant(place) => {
                    place.insert(number);
                }
            }
        }
        found
    }
}

fn trajectory_oddities(t: &Trajectory, limits: &Limits, found: &mut Vec<Oddity>) {
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
    let typical = median(&mut t.intervals().map(|i| i.1).collect::<Vec<_>>());
    for (point, interval_s) in t.intervals() {
        let line = point.line;
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
    for (point, speed) in t.speeds().filter(|s| s.1 > limits.max_speed) {
        let (line, limit) = (point.line, limits.max_speed);
        found.push(Oddity::Speed {
            number,
            line,
            speed,
            limit,
        });
    }
    let heights = || t.points.iter().map(|p| p.position_m.z);
    let below = |p: &&TrajectoryPoint| p.position_m.z < limits.min_height;
    if let Some(first) = t.points.iter().find(below) {
        let height = heights().fold(f64::INFINITY, f64::min);
        let line = first.line;
        found.push(Oddity::Below {
            number,
            line,
            height,
        });
    }
    for p in &t.points {
        let (distance, limit) = (p.position_m.norm(), limits.max_distance);
        if distance > limit {
            let line = p.line;
            found.push(Oddity::Position {
                number,
                line,
                distance,
                limit,
            });
        }
    }
}
