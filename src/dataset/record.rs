//! `dataset.json`: where a data set comes from, and what is known of each flight beside its positions.

use nalgebra::Matrix3;
use serde::Serialize;

use super::bounce::Bounce;
use super::flight::{DatasetConfig, Flight, FlightClip};
use crate::clip::TimeSource;
use crate::geometry::CameraFrame;
use crate::spin::estimate::{FittedMotion, SpinEstimate};
use crate::vision::Estimator;
use crate::vision::frame::config::CameraModel;
use crate::vision::optics::camera::{Camera, Intrinsics};

/// Version of the format.
pub const FORMAT_VERSION: u32 = 1;

/// The content of `dataset.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Record {
    /// [`FORMAT_VERSION`].
    pub format_version: u32,
    /// The crate's version.
    pub spindoe: &'static str,
    /// The frame of positions, orientations and spins.
    pub camera_frame: CameraFrame,
    /// The balls' tables.
    pub tables: Vec<TableRecord>,
    /// The camera's intrinsics, as `truth.json` has them.
    pub intrinsics: Option<Intrinsics>,
    /// In the order in which they were given.
    pub clips: Vec<ClipRecord>,
}

/// A ball's table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TableRecord {
    /// As it was named.
    pub name: String,
    /// The digest of its pattern.
    pub pattern_sha256: String,
    /// The ball's diameter, mm.
    pub ball_diameter_mm: f64,
    /// Whether its dots are those of a calibration.
    pub is_calibrated: bool,
}

/// A clip.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClipRecord {
    /// The file or folder.
    pub path: String,
    /// Number of frames.
    pub frames: usize,
    /// Those with an orientation.
    pub identified: usize,
    /// Where their times came from.
    pub times: TimeSource,
    /// The place of the ball's table among [`Record::tables`].
    pub table: usize,
    /// In the order of time.
    pub flights: Vec<FlightRecord>,
}

/// A flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightRecord {
    /// Its number, which is its files' name.
    pub number: u32,
    /// Time of its first position in the clip, seconds: time 0 in `NNN.csv`.
    pub start_s: f64,
    /// Time from its first position to its last, seconds.
    pub duration_s: f64,
    /// Number of frames, of positions, of orientations.
    pub frames: usize,
    /// See [`Self::frames`].
    pub positions: usize,
    /// See [`Self::frames`].
    pub orientations: usize,
    /// The bounce with which it begins.
    pub bounce: Option<BounceRecord>,
    /// Its spin.
    pub spin: Option<SpinRecord>,
    /// Why it has none.
    pub spin_refusal: Option<String>,
}

/// A bounce.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BounceRecord {
    /// Its time in the clip, seconds.
    pub time_s: f64,
    /// Change of the velocity, m/s.
    pub jump_m_s: [f64; 3],
    /// Natural logarithm of the odds for it.
    pub log_odds: f64,
}

/// A spin, that of the index: in the middle of the flight, of a free motion its mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpinRecord {
    /// The spin, rad/s.
    pub spin_rad_s: [f64; 3],
    /// Its covariance, (rad/s)^2, row by row.
    pub covariance_rad2_s2: Option<[[f64; 3]; 3]>,
    /// Its time in the clip, seconds.
    pub time_s: f64,
    /// The motion: constant, decaying, precessing or free.
    pub motion: &'static str,
    /// Rate of decay, 1/s; 0 where there is no evidence for any.
    pub decay_per_s: f64,
    /// Its standard deviation, of a decaying spin.
    pub decay_std_per_s: Option<f64>,
    /// Orientations that agree with it.
    pub inliers: usize,
}

impl Record {
    /// That of clips, whose balls have these tables by these names.
    pub fn new(
        names: &[String],
        estimators: &[Estimator],
        config: &DatasetConfig,
        clips: &[FlightClip],
    ) -> Self {
        let mut numbers = 0..;
        let mut flight =
            |flight: &Flight| FlightRecord::new(numbers.next().unwrap_or(u32::MAX), flight);
        let clips = clips.iter().map(|clip| ClipRecord {
            path: clip.path.display().to_string(),
            frames: clip.frames,
            identified: clip.identified,
            times: clip.times,
            table: clip.table,
            flights: clip.flights.iter().map(&mut flight).collect(),
        });
        let tables = names
            .iter()
            .zip(estimators)
            .map(|(name, estimator)| TableRecord {
                name: name.clone(),
                pattern_sha256: estimator.pattern().sha256(),
                ball_diameter_mm: 2e3 * estimator.ball_radius_m(),
                is_calibrated: estimator.ball().dot_covariances().is_some(),
            });
        Self {
            format_version: FORMAT_VERSION,
            spindoe: env!("CARGO_PKG_VERSION"),
            camera_frame: config.axes,
            tables: tables.collect(),
            intrinsics: estimators.first().and_then(|e| match e.camera() {
                CameraModel::Known(Camera::Perspective(intrinsics)) => Some(*intrinsics),
                _ => None,
            }),
            clips: clips.collect(),
        }
    }

    /// All flights, in the order of their numbers.
    pub fn flights(&self) -> impl Iterator<Item = &FlightRecord> {
        self.clips.iter().flat_map(|clip| &clip.flights)
    }
}

impl FlightRecord {
    fn new(number: u32, flight: &Flight) -> Self {
        let times = || flight.points().map(|p| p.time_s);
        let start_s = times().next().unwrap_or(f64::NAN);
        Self {
            number,
            start_s,
            duration_s: times().last().map_or(0.0, |last| last - start_s),
            frames: flight.file.rows.len(),
            positions: times().count(),
            orientations: flight.measurements().len(),
            bounce: flight.bounce.as_ref().map(BounceRecord::new),
            spin: flight.spin.as_ref().ok().map(SpinRecord::new),
            spin_refusal: flight.spin.as_ref().err().map(ToString::to_string),
        }
    }
}

impl BounceRecord {
    fn new(bounce: &Bounce) -> Self {
        Self {
            time_s: bounce.time_s,
            jump_m_s: bounce.jump_m_s.into(),
            log_odds: bounce.log_odds,
        }
    }
}

impl SpinRecord {
    fn new(estimate: &SpinEstimate) -> Self {
        let fit = estimate.overall();
        let rows = |m: Matrix3<f64>| [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)]));
        Self {
            spin_rad_s: fit.motion.spin.into(),
            covariance_rad2_s2: fit.spin_covariance.map(rows),
            time_s: fit.motion.time_s,
            motion: estimate.motion.model().as_str(),
            decay_per_s: estimate.motion.decay_per_s(),
            decay_std_per_s: match &estimate.motion {
                FittedMotion::Decaying(fit) => Some(fit.std_per_s()),
                _ => None,
            },
            inliers: fit.inliers,
        }
    }
}
