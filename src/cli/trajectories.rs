//! `spindoe trajectories`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use crate::error::{Error, Result};
use crate::files;
use crate::plot::{LinePlot, LineSeries, PathGroup, PathPlot, line_plot, path_groups};
use crate::spin::trajectories::{Limits, Trajectory, TrajectorySet};

/// Upper ends (rps) of the classes in which flights are drawn; the last class is open.
const CLASSES: [f64; 3] = [20.0, 40.0, 80.0];

#[derive(Debug, Args)]
pub struct Arguments {
    /// Folder with index.csv (traj_file,x_spin,y_spin,z_spin; rad/s) and NNN.csv (t;x;y;z; s and m).
    dir: PathBuf,
    /// Draw the flights and the distribution of their spins into this folder.
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
    if let Some(dir) = &arguments.plots {
        files::create_dir(dir)?;
        plot_flights(&dir.join("flights.png"), &set)?;
        plot_spins(&dir.join("spins.png"), &set)?;
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
fn by_class(set: &TrajectorySet) -> Vec<(String, Vec<&Trajectory>)> {
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

/// Height over the horizontal distance from each trajectory's first point, by classes of spin.
fn plot_flights(path: &Path, set: &TrajectorySet) -> Result<()> {
    let way = |t: &Trajectory| -> Vec<(f64, f64)> {
        let positions = || t.points.iter().map(|p| p.position_m);
        let start = positions().next().unwrap_or_default().xy();
        positions()
            .map(|p| ((p.xy() - start).norm(), p.z))
            .collect()
    };
    let groups = by_class(set).into_iter().map(|(name, members)| PathGroup {
        name,
        paths: members.into_iter().map(way).collect(),
    });
    let plot = PathPlot {
        title: format!("{} flights from the side", set.trajectories.len()),
        x_label: "horizontal distance from the first point (m)".into(),
        y_label: "height (m)".into(),
        groups: groups.collect(),
    };
    path_groups(path, &plot)
}

/// Share of the flights up to a spin.
fn plot_spins(path: &Path, set: &TrajectorySet) -> Result<()> {
    let mut rps: Vec<f64> = set
        .trajectories
        .iter()
        .filter_map(Trajectory::rps)
        .collect();
    rps.sort_by(f64::total_cmp);
    let n = rps.len() as f64;
    let share = |(i, r): (usize, &f64)| (*r, 100.0 * (i as f64 + 1.0) / n);
    let plot = LinePlot {
        title: "Spins of the flights".into(),
        x_label: "spin (revolutions per second)".into(),
        y_label: "flights with at most this spin (%)".into(),
        log_y: false,
        series: vec![LineSeries {
            name: format!("{} flights with a known spin", rps.len()),
            points: rps.iter().enumerate().map(share).collect(),
        }],
    };
    line_plot(path, &plot)
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
