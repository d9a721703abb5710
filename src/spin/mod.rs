//! Spin from time-stamped orientations: the last stage, which must tolerate wrong ones.
//!
//! Some orientations are wrong by any angle (a misidentified pattern), some are missing, the times
//! may be uneven, and a quaternion and its negative mean the same. Two estimators answer the same
//! question:
//!
//! - [`quatera`]: the paper's, a regression in the plane of the quaternions with RANSAC before it
//!   (T. Gossard et al., "SpinDOE", arXiv 2303.03879, Sec. II-D). The baseline.
//! - [`robust`]: maximum likelihood on SO(3) under a mixture of noise and outliers, global over
//!   every number of turns that may lie between two frames. The default.
//!
//! Frames and units: orientations map the pattern's frame to the camera's; a spin is a vector in
//! the camera frame, rad/s, right-hand rule, such that
//!
//! ```text
//! R(t) = exp([w]x (t - t0)) R(t0)
//! ```
//!
//! The other modules: [`orientations`] is the file that they read, [`alias`] lists the spins that
//! the sampling cannot distinguish, [`summary`] says all of a sequence at once; [`windows`] and
//! [`decay`] (with the theory in [`air`]) follow a spin through a long sequence, [`precession`] that
//! of an uneven ball, [`free`] that of one that is pushed, and [`estimate`] takes the motion for which there is evidence; [`pair`] is the spin of two orientations, [`golf`] says a spin in golf's words, [`golf_shot`] as simulators read it, [`fictrac`] a treadmill's in those of FicTrac; [`simulate`] makes sequences with a known truth, and [`trajectories`] reads the
//! published ones.
//!
//! Not guaranteed, by any estimator: that aliases, spins which agree at all the given times, are
//! distinguished.

pub mod air;
pub mod alias;
pub mod clock;
pub mod decay;
pub mod estimate;
pub mod evidence;
pub mod fictrac;
pub mod free;
pub mod golf;
pub mod golf_shot;
pub mod motion;
pub mod orientations;
pub mod pair;
pub mod precession;
pub mod quatera;
mod repeated;
pub mod robust;
pub mod shared;
pub mod simulate;
pub mod summary;
#[cfg(feature = "native")]
pub mod trajectories;
pub mod windows;

mod angles;
mod belief;
mod chance;
mod config;
mod fitted;
mod mixture;
mod search;
mod widening;

use nalgebra::Matrix3;

use crate::error::Error;
use crate::geometry::{Rotation, Vec3};
use motion::ConstantSpin;

/// Minimum number of orientations that determine a spin and check it: two determine it, the third
/// checks it.
pub const MIN_FRAMES: usize = 3;

/// Maximum number of turns between successive orientations that the search goes through one by one:
/// far more than any sampling can decide, and few enough to be searched quickly.
pub const MAX_TURNS: usize = 200;

/// Minimum time between successive orientations, seconds: a million frames a second. Frames
/// numbered in nanoseconds by mistake are closer.
pub const MIN_INTERVAL_S: f64 = 1e-6;

/// Frames per second where none are stated: the camera of the SpinDOE paper.
pub const DEFAULT_FPS: f64 = 350.0;

/// The prior probability that an orientation is an inlier.
///
/// A tenth of the frames wrong is a cautious reading of the 93 % that the paper's identification
/// reaches on real images; the estimate hardly depends on it.
pub const DEFAULT_CONFIDENCE: f64 = 0.9;

/// The two-sided 95 % quantile of the standard normal distribution.
const Z95: f64 = 1.959_963_984_540_054;
/// That of the chi-square distribution with three degrees of freedom.
const CHI2_95: f64 = 7.814_727_903_251_178;

/// A range of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

impl Interval {
    /// The 95 % interval of a normal distribution.
    pub(crate) fn normal(mean: f64, std: f64) -> Self {
        Self {
            low: mean - Z95 * std,
            high: mean + Z95 * std,
        }
    }
}

/// One measured orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Time, seconds, in any one time base.
    pub time_s: f64,
    /// Pattern to camera.
    pub orientation: Rotation,
    /// Probability that the orientation is an inlier, in [0, 1].
    pub confidence: f64,
    /// This frame's noise as a multiple of the common one, positive; 1 where nothing is known.
    pub sigma_scale: f64,
}

impl Measurement {
    /// A measurement of which nothing but time and orientation is known.
    pub fn new(time_s: f64, orientation: Rotation) -> Self {
        Self {
            time_s,
            orientation,
            confidence: DEFAULT_CONFIDENCE,
            sigma_scale: 1.0,
        }
    }
}

/// An estimator's answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The estimated motion.
    pub motion: ConstantSpin,
    /// Covariance of the spin vector, (rad/s)^2, camera frame; `None` where the method has none.
    pub spin_covariance: Option<Matrix3<f64>>,
    /// Noise of an orientation per axis, radians, as assumed or estimated; `None` as above.
    pub sigma_rad: Option<f64>,
    /// Log-likelihood of the measurements (density with respect to the rotation vector), as above.
    pub log_likelihood: Option<f64>,
    /// Number of inliers.
    pub inliers: usize,
    /// How much more parts of the sequence differ from the motion than their noise explains, a ratio of variances by which the
    /// covariance is widened; `None` where that is not evident.
    pub lack_of_fit: Option<f64>,
}

impl Fit {
    /// Standard deviation of the spin's magnitude, rad/s; without an axis the largest of all directions.
    pub fn magnitude_std_rad_s(&self) -> Option<f64> {
        let covariance = self.spin_covariance?;
        let variance = match self.motion.spin.try_normalize(0.0) {
            Some(axis) => axis.dot(&(covariance * axis)),
            None => covariance.symmetric_eigenvalues().max(),
        };
        Some(variance.max(0.0).sqrt())
    }

    /// Whether the spin's 95 % region holds none at all: then it has no axis.
    pub fn is_at_rest(&self) -> bool {
        let spin = self.motion.spin;
        let covariance = self.spin_covariance.and_then(|c| c.cholesky());
        match covariance {
            Some(covariance) => spin.dot(&covariance.solve(&spin)) < CHI2_95,
            None => spin == Vec3::zeros(),
        }
    }

    /// The same in another camera frame, which `turn` leads to.
    #[must_use]
    pub fn turned(mut self, turn: &Rotation) -> Self {
        let matrix = *turn.to_rotation_matrix().matrix();
        self.motion.spin = turn * self.motion.spin;
        self.motion.orientation = turn * self.motion.orientation;
        self.spin_covariance = self
            .spin_covariance
            .map(|c| matrix * c * matrix.transpose());
        self
    }
}

/// Why an estimator rejects a sequence.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpinRejection {
    /// Too few orientations.
    #[error("expected at least {needed} orientations, found {found}")]
    TooFewFrames {
        /// Orientations given.
        found: usize,
        /// Orientations needed.
        needed: usize,
    },
    /// A time is not finite, or earlier than the one before it.
    #[error(
        "orientation {index}: expected a time not earlier than the one before, found {time_s} s"
    )]
    Times {
        /// Index of the measurement, from 0.
        index: usize,
        /// The offending time.
        time_s: f64,
    },
    /// A measurement has a value outside its domain.
    #[error("orientation {index}: {problem}")]
    Measurement {
        /// Index of the measurement, from 0.
        index: usize,
        /// What was expected.
        problem: &'static str,
    },
    /// The times are so far apart that the number of turns between them is undetermined.
    #[error(
        "orientations {interval_s} s apart leave {turns:.0} turns open between them at up to {max_rps:.0} rps, \
         expected at most {MAX_TURNS} (are the times in seconds? --fps gives others)"
    )]
    Sparse {
        /// The minimum interval between successive orientations, seconds.
        interval_s: f64,
        /// Turns possible within it.
        turns: f64,
        /// Largest spin searched, revolutions per second.
        max_rps: f64,
    },
    /// A setting is outside its domain.
    #[error("{setting}: expected {expected}, found {value}")]
    Setting {
        /// The setting, named as its field.
        setting: &'static str,
        /// Its domain.
        expected: &'static str,
        /// What was found.
        value: f64,
    },
    /// Two orientations follow each other faster than any camera takes them.
    #[error(
        "orientation {index}: {interval_s:e} s after the one before, expected at least \
         {MIN_INTERVAL_S:e} s (are the times in seconds? --fps gives others)"
    )]
    Close {
        /// Index of the later measurement, from 0.
        index: usize,
        /// Time since the one before, seconds.
        interval_s: f64,
    },
    /// The orientations turn about one axis, but no motion leads to them at these times.
    #[error(
        "no spin: the {frames} orientations turn about one axis, but not steadily at these times (best: {agreeing} of them): frames are \
         lost, repeated, out of order or wrongly timed, or the ball is pushed{}",
        order_words(*in_order_rps)
    )]
    NotAtTheseTimes {
        /// Orientations that agree with the best motion found.
        agreeing: usize,
        /// Orientations given.
        frames: usize,
        /// Revolutions per second of the steady turn that has these orientations in another order.
        in_order_rps: Option<f64>,
    },
    /// The orientations that agree on a motion speak less for it than the others against it.
    #[error(
        "no spin: {agreeing} of the {frames} orientations agree on a motion, and the others speak more against it"
    )]
    NoMotion {
        /// Orientations that agree with the best motion found.
        agreeing: usize,
        /// Orientations given.
        frames: usize,
    },
    /// Too few of the orientations agree on any one spin.
    #[error(
        "no spin up to {max_rps:.0} rps agrees with enough of the {frames} orientations (best: {agreeing})"
    )]
    NoConsensus {
        /// Orientations that agree with the best spin found.
        agreeing: usize,
        /// Orientations given.
        frames: usize,
        /// Largest spin searched, revolutions per second.
        max_rps: f64,
    },
}

/// What is said of another order that fits.
fn order_words(in_order_rps: Option<f64>) -> String {
    in_order_rps.map_or(String::new(), |rps| {
        format!("; in another order they are those of {rps:.3} rps, one way or the other: are the frames named in their order?")
    })
}

impl SpinRejection {
    /// Whether the orientations are usable and have no spin, rather than the input being wrong.
    pub fn is_no_spin(&self) -> bool {
        matches!(
            self,
            Self::NoConsensus { .. } | Self::NotAtTheseTimes { .. } | Self::NoMotion { .. }
        )
    }

    /// The error to report where the measurements came from the file `path`.
    pub fn in_file(self, path: &std::path::Path) -> Error {
        match self {
            Self::Setting { .. } => self.into(),
            _ => Error::input(path, "orientations", self.to_string()),
        }
    }
}

impl From<SpinRejection> for Error {
    fn from(rejection: SpinRejection) -> Self {
        match rejection {
            SpinRejection::Setting {
                setting,
                expected,
                value,
            } => Error::argument(setting, format!("expected {expected}, found {value}")),
            _ => Error::argument("orientations", rejection.to_string()),
        }
    }
}

/// Checks a setting against its domain.
fn require(
    inside: bool,
    setting: &'static str,
    expected: &'static str,
    value: f64,
) -> Result<(), SpinRejection> {
    let rejection = SpinRejection::Setting {
        setting,
        expected,
        value,
    };
    if inside { Ok(()) } else { Err(rejection) }
}

/// Checks what every estimator relies on. Measurements of equal times are of one orientation, as several cameras give them.
///
/// # Errors
/// The first violation: measurements of fewer than `needed` times, times that decrease, values out of domain.
pub fn check(measurements: &[Measurement], needed: usize) -> Result<(), SpinRejection> {
    let mut before = f64::NEG_INFINITY;
    let mut found = 0;
    for (index, m) in measurements.iter().enumerate() {
        if !m.time_s.is_finite() || m.time_s < before {
            let time_s = m.time_s;
            return Err(SpinRejection::Times { index, time_s });
        }
        let interval_s = m.time_s - before;
        // Both times may be rounded.
        let rounding_s = 2.0 * f64::EPSILON * m.time_s.abs();
        if interval_s > 0.0 && interval_s + rounding_s < MIN_INTERVAL_S {
            return Err(SpinRejection::Close { index, interval_s });
        }
        found += usize::from(interval_s > 0.0);
        before = m.time_s;
        let unit = (m.orientation.coords.norm_squared() - 1.0).abs() < 1e-6;
        let problem = match m {
            _ if !unit => "expected a unit quaternion",
            _ if !(0.0..=1.0).contains(&m.confidence) => "expected a confidence between 0 and 1",
            _ if !(1e-6..=1e6).contains(&m.sigma_scale) => {
                "expected a noise scale between a millionth and a million"
            }
            _ => continue,
        };
        return Err(SpinRejection::Measurement { index, problem });
    }
    if found < needed {
        return Err(SpinRejection::TooFewFrames { found, needed });
    }
    Ok(())
}
