//! `spindoe trajectories`: summarizes trajectories with known spins.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::error::{Error, Result};
use crate::spin::trajectories::TrajectorySet;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Folder with index.csv (traj_file,x_spin,y_spin,z_spin; rad/s) and NNN.csv (t;x;y;z; s and
    /// m).
    dir: PathBuf,
    /// Draw the trajectories and the distribution of their spins into this folder.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
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
    let summary = set.summary();
    #[cfg(feature = "plot")]
    if let Some(dir) = &arguments.plots {
        crate::files::create_dir(dir)?;
        super::trajectories_plot::plot_trajectories(&dir.join("flights.png"), &set)?;
        super::trajectories_plot::plot_spins(&dir.join("spins.png"), &set)?;
    }
    if arguments.json {
        return super::print_json(&json!({ "summary": summary }));
    }
    let [fewest, middle, most] = summary.points_each;
    outln!(
        "{} trajectories, {} points ({fewest} to {most} each, median {middle})",
        summary.trajectories,
        summary.points
    );
    let [shortest, middle, longest] = summary.duration_s;
    outln!(
        "  duration  {shortest:.3} to {longest:.3} s, median {middle:.3}; a point every {:.4} s",
        summary.interval_s
    );
    let [smallest, middle, largest] = summary.rps;
    outln!("  spin      {smallest:.1} to {largest:.1} rps, median {middle:.1}");
    outln!("  speed     median {:.1} m/s", summary.speed_m_s);
    Ok(())
}
