//! The plots of `spindoe trajectories --plots`.

use std::path::Path;

use super::trajectories::by_class;
use crate::error::Result;
use crate::plot::{LinePlot, LineSeries, PathGroup, PathPlot, line_plot, path_groups};
use crate::spin::trajectories::{Trajectory, TrajectorySet};

/// Height over the horizontal distance from each trajectory's first point, by classes of spin.
pub(super) fn plot_flights(path: &Path, set: &TrajectorySet) -> Result<()> {
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
