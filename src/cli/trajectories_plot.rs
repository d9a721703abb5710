//! The plots of `spindoe trajectories --plots`.

use std::path::Path;

use crate::error::Result;
use crate::plot::{LinePlot, LineSeries, PathGroup, PathPlot, line_plot, path_groups};
use crate::spin::trajectories::{Trajectory, TrajectorySet};

/// Upper ends (rps) of the classes in which trajectories are drawn; the last class is open.
const CLASSES: [f64; 3] = [20.0, 40.0, 80.0];

/// The trajectories that have points, by classes of spin with their names; unknown spins are a
/// class of their own, where there are any.
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
pub(super) fn plot_trajectories(path: &Path, set: &TrajectorySet) -> Result<()> {
    let path_of = |t: &Trajectory| -> Vec<(f64, f64)> {
        let positions = || t.points.iter().map(|p| p.position_m);
        let start = positions().next().unwrap_or_default().xy();
        positions()
            .map(|p| ((p.xy() - start).norm(), p.z))
            .collect()
    };
    let groups = by_class(set).into_iter().map(|(name, members)| PathGroup {
        name,
        paths: members.into_iter().map(path_of).collect(),
    });
    let plot = PathPlot {
        title: format!("{} trajectories from the side", set.trajectories.len()),
        x_label: "horizontal distance from the first point (m)".into(),
        y_label: "height (m)".into(),
        groups: groups.collect(),
    };
    path_groups(path, &plot)
}

/// Cumulative share of the trajectories by spin.
pub(super) fn plot_spins(path: &Path, set: &TrajectorySet) -> Result<()> {
    let mut rps: Vec<f64> = set
        .trajectories
        .iter()
        .filter_map(Trajectory::rps)
        .collect();
    rps.sort_by(f64::total_cmp);
    let n = rps.len() as f64;
    let share = |(i, r): (usize, &f64)| (*r, 100.0 * (i as f64 + 1.0) / n);
    let plot = LinePlot {
        title: "Spins of the trajectories".into(),
        x_label: "spin (revolutions per second)".into(),
        y_label: "trajectories with at most this spin (%)".into(),
        log_y: false,
        series: vec![LineSeries {
            name: format!("{} trajectories with a known spin", rps.len()),
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
