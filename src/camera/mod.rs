//! What a pattern gives for a camera, measured on rendered frames.
//!
//! A protocol such as `sparse` states noise and missed dots; a user has a camera, described by
//! [`CameraConditions`]. Scene `k` of a seed is drawn once for all patterns (ball, view, light,
//! occluders, sensor), so that their outcomes are pairs and only the dots differ. [`crate::synth`]
//! renders it, and the whole estimator reads it, as it reads a user's frame: see [`CameraTrials`].
//!
//! - [`race_patterns`] finds the best of several patterns, with few frames for those that are clearly
//!   worse, and measures them on others,
//! - [`advise`] races the shipped designs, or others, and tries changes of the camera,
//! - [`rank_finalists`] races those of a search,
//! - [`CameraSweep`] varies one property of the camera at a time,
//! - [`advise_exposures`] races patterns on a launch monitor's exposures with several flashes,
//! - [`coverage`] fits the assumptions of an objective to what the camera shows.
//!
//! The outcomes depend on the seed alone, not on the number of threads. They are worth what the
//! synthetic world is worth: what real frames show beyond it is not measured here.

mod advice;
mod conditions;
mod coverage;
mod exposures;
mod frames;
mod racing;
mod ranking;
mod sequences;
mod sweep;
mod trials;

pub use advice::{Advice, AdviceConfig, ChangeAdvice, DotSize, MAX_DOT, PatternAdvice, advise};
pub use conditions::{CameraConditions, Surroundings};
pub use coverage::{COVERAGE_FRAMES, coverage};
pub use exposures::{
    ExposureAdvice, ExposureOutcome, ExposureRates, ExposureSpin, ExposureTrials, advise_exposures,
    is_at,
};
pub use frames::{ErrorRatio, FrameOutcome, FrameRates, paired};
pub use racing::{RaceConfig, RaceResult, Racer, race, race_patterns};
pub use ranking::{rank_finalists, requested_conditions};
pub use sequences::{SPIN_TOLERANCE, SpinRates};
pub use sweep::{CameraParameter, CameraPoint, CameraSweep, SweptCamera, sweep_csv};
pub use trials::CameraTrials;
