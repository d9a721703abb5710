//! `spindoe trajectories`.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::error::{Error, Result};
use crate::files;
use crate::spin::trajectories::{Limits, Trajectory, TrajectorySet};

/// Upper ends (rps) of the classes in which flights are drawn; the last class is open.
const CLASSES: [f64; 3] = [20.0, 40.0, 80.0];

#[derive(Debug, Args)]
pub struct Arguments {
    /// Folder with index.csv (traj_file,x_spin,y_spin,z_spin; rad/s) and NNN.csv (t;x;y;z; s and m).
    dir: PathBuf,
    /// Draw the flights and the distribution of their spins into this folder.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    /// Write the set as read into this folder, in the same format.
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    /// Largest plausible spin, revolutions per second.
    #[arg(long, default_value_t = Limits::default().max_rps)]
    max_spin_rps: f64,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let set = TrajectorySet::read_dir(&arguments.dir)?;
    if set.trajectories.is_empty() {
        let problem = "expected files NNN.csv, found none";
        return Err(Error::input(&arguments.dir, "folder", problem));
    }
    let limits = Limits {
        max_rps: arguments.max_spin_rps,
        ..Limits::default()
    };
    let oddities: Vec<String> = set
        .oddities(&limits)
        .iter()
        .map(ToString::to_string)
        .collect();
    let summary = set.summary();
    if let Some(dir) = &arguments.write {
        set.write_dir(dir)?;
    }
    #[cfg(feature = "plot")]
    if let Some(dir) = &arguments.plots {
        files::create_dir(dir)?;
        super::trajectories_plot::plot_flights(&dir.join("flights.png"), &set)?;
        super::trajectories_plot::plot_spins(&dir.join("spins.png"), &set)?;
    }
    if arguments.json {
        return super::print_json(&json!({ "summary": summary, "oddities": oddities }));
    }
    let [fewest, middle, most] = summary.points_each;
    outln!(
        "{} flights, {} points ({fewest} to {most} each, median {middle})",
        summary.trajectories,
        summary.points
    );
    let [shortest, middle, longest] = summary.duration_s;
    outln!(
        "  duration  {shortest:.3} to {longest:.3} s, median {middle:.3}; a point every {:.4} s",
        summary.interval_s
    );
    let [least, middle, largest] = summary.rps;
    outln!("  spin      {least:.1} to {largest:.1} rps, median {middle:.1}");
    outln!("  speed     median {:.1} m/s", summary.speed_m_s);
    outln!("{} oddities", oddities.len());
    for oddity in oddities {
        outln!("  {oddity}");
    }
    Ok(())
}

/// The trajectories that have points, by classes of spin with their names; unknown spins are a class
/// of their own, where there are any.
pub(super) fn by_class(set: &TrajectorySet) -> Vec<(String, Vec<&Trajectory>)> {
    let last = CLASSES.len();
    let name = |i: usize| match (i.checked_sub(1), CLASSES.get(i)) {
        (None, Some(high)) => format!("below {high} rps"),
        (Some(low), Some(high)) => format!("{} to {high}", CLASSES[low]),
        (Some(low), None) => format!("above {}", CLASSES[low]),
        (None, None) => String::new(),
    };
    let mut classes: Vec<_> = (0..=last).map(|i| (name(i), Vec::new())).collect();
    let mut unknown = Vec::new();
    for t in set.trajectories.iter().filter(|t| !t.points.is_empty()) {
        match t.rps() {
            Some(rps) => {
                let class = CLASSES.iter().filter(|limit| rps >= **limit).count();
                classes[class].1.push(t);
            }
            None => unknown.push(t),
        }
    }
    if !unknown.is_empty() {
        classes.push(("unknown".into(), unknown));
    }
    classes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;
    use crate::spin::trajectories::TrajectoryPoint;

    #[test]
    fn unknown_spins_are_not_drawn_as_slow_ones() {
        let trajectory = |number, rps: Option<f64>| Trajectory {
            number,
            spin: rps.map(|r| Vec3::x() * r * std::f64::consts::TAU),
            points: vec![TrajectoryPoint {
                time_s: 0.0,
                position_m: Vec3::zeros(),
                line: 1,
            }],
        };
        let set = TrajectorySet {
            trajectories: vec![trajectory(0, Some(5.0)), trajectory(1, None)],
            without_file: Vec::new(),
        };
        let classes = by_class(&set);
        let numbers = |i: usize| classes[i].1.iter().map(|t| t.number).collect::<Vec<_>>();
        assert_eq!(
            (classes[0].0.as_str(), numbers(0)),
            ("below 20 rps", vec![0])
        );
        assert_eq!((classes[4].0.as_str(), numbers(4)), ("unknown", vec![1]));
    }
}
