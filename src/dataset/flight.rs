//! A clip's flights.

use std::path::{Path, PathBuf};

use super::bounce::{Bounce, BounceConfig, PathPoint, bounces};
use crate::clip::{self, BatchConfig, BatchObserver, TimeSource};
use crate::error::{Error, Result};
use crate::geometry::CameraFrame;
use crate::spin::estimate::{MotionModel, SpinEstimate};
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::spin::robust::SpinConfig;
use crate::spin::trajectories::{Trajectory, TrajectoryPoint};
use crate::spin::{Measurement, SpinRejection};
use crate::vision::Estimator;

/// How clips become flights.
#[derive(Debug, Clone, Default)]
pub struct DatasetConfig {
    /// How a clip is read; the largest spin is that of its sequence.
    pub batch: BatchConfig,
    /// What counts as a bounce.
    pub bounces: BounceConfig,
    /// The axes of positions, orientations and spins.
    pub axes: CameraFrame,
}

/// A ball from one bounce to the next, or as far as it was seen.
#[derive(Debug, Clone)]
pub struct Flight {
    /// Its frames, also those in which nothing was found.
    pub file: Orientations,
    /// The bounce with which it begins.
    pub bounce: Option<Bounce>,
    /// Its spin, or why there is none.
    pub spin: std::result::Result<SpinEstimate, SpinRejection>,
    /// How the spin was fitted.
    pub config: SpinConfig,
}

/// What a clip shows.
#[derive(Debug, Clone)]
pub struct FlightClip {
    /// The file or folder.
    pub path: PathBuf,
    /// Number of frames.
    pub frames: usize,
    /// Those with an orientation.
    pub identified: usize,
    /// Where their times came from.
    pub times: TimeSource,
    /// Which of several tables the ball has.
    pub table: usize,
    /// In the order of time.
    pub flights: Vec<Flight>,
}

/// Estimates a clip, of a ball with one of these tables, and cuts it at its bounces.
///
/// # Errors
/// [`Error::Argument`] where the camera is not known, and so no position; [`Error::Input`] where the frames have no times that increase; those of
/// [`clip::run`].
pub fn read_clip(
    estimators: &[Estimator],
    path: &Path,
    config: &DatasetConfig,
    observer: &impl BatchObserver,
) -> Result<FlightClip> {
    config.bounces.check()?;
    if estimators.iter().any(|e| e.camera().is_view()) {
        let problem = "expected the camera's: positions follow from them and the ball's diameter";
        return Err(Error::argument("intrinsics", problem));
    }
    let inputs = [path.to_path_buf()];
    let batch = clip::run(estimators, &inputs, &config.batch, observer)?;
    if !batch.is_sequence() {
        let problem = "expected two frames or more with times that increase (--fps, --times)";
        return Err(Error::input(path, "times", problem));
    }
    let file = batch.orientations(config.axes);
    let spin = batch.times.of_spin(config.batch.sequence.spin);
    Ok(FlightClip {
        path: path.to_path_buf(),
        frames: batch.frames.len(),
        identified: batch.identified(),
        times: batch.times,
        table: batch.judgment.table,
        flights: match batch.identified() {
            // What has an outline and no dots is no ball that is known.
            0 => Vec::new(),
            _ => flights(file, &spin, &config.bounces),
        },
    })
}

/// The flights of a sequence with positions, each with its own spin; those without any position are none.
pub fn flights(file: Orientations, spin: &SpinConfig, config: &BounceConfig) -> Vec<Flight> {
    let placed = file.rows.iter().enumerate();
    let placed: Vec<(usize, PathPoint)> = placed
        .filter_map(|(k, row)| Some((k, point(row)?)))
        .collect();
    let points: Vec<PathPoint> = placed.iter().map(|(_, point)| *point).collect();
    let covariances = file
        .rows
        .iter()
        .filter_map(|row| Some(row.position?.covariance));
    let noise = covariances.reduce(|a, b| a + b);
    let found = bounces(&points, noise.as_ref(), config);
    let Orientations { mut rows, .. } = file;
    let mut flights = Vec::with_capacity(found.len() + 1);
    for bounce in found.into_iter().rev() {
        // Frames without a position lie before a bounce or after it.
        let (from, _) = placed[bounce.after - 1];
        let after = rows[from..]
            .iter()
            .position(|row| row.time_s >= bounce.time_s);
        let behind = rows.split_off(from + after.unwrap_or(1));
        flights.push((behind, Some(bounce)));
    }
    flights.push((rows, None));
    flights.reverse();
    let flight = |(rows, bounce)| {
        let file = Orientations {
            rows,
            camera_frame: file.camera_frame,
            ..Orientations::default()
        };
        let config = file.spin_config(*spin);
        let spin = SpinEstimate::fit(&file.measurements(), MotionModel::Auto, &config);
        Flight {
            file,
            bounce,
            spin,
            config,
        }
    };
    let all = flights.into_iter().map(flight);
    all.filter(|flight| flight.points().next().is_some())
        .collect()
}

fn point(row: &OrientationRow) -> Option<PathPoint> {
    Some(PathPoint {
        time_s: row.time_s,
        position_m: row.position?.center_m,
    })
}

impl Flight {
    /// Where the ball was found.
    pub fn points(&self) -> impl Iterator<Item = PathPoint> {
        self.file.rows.iter().filter_map(point)
    }

    /// What the spin is fitted to.
    pub fn measurements(&self) -> Vec<Measurement> {
        self.file.measurements()
    }

    /// The flight in the authors' format: times from its first position on.
    pub fn trajectory(&self, number: u32) -> Trajectory {
        let start_s = self.points().next().map_or(0.0, |p| p.time_s);
        let points = self.points().map(|p| TrajectoryPoint {
            time_s: p.time_s - start_s,
            position_m: p.position_m,
        });
        Trajectory {
            number,
            spin: self.spin.as_ref().ok().map(|s| s.overall().motion.spin),
            points: points.collect(),
        }
    }
}
