//! What a pattern gives before a camera, without rendering an image.
//!
//! A protocol such as `sparse` states noise and missed dots; a user has a camera. Here the scene is
//! drawn as [`crate::synth`] draws it (ball, ink, light, occluders, sensor), but instead of its
//! pixels a [`DetectionModel`] gives what the estimator's first stages would find in them:
//! outline, dots with their covariances, false dots. The estimator's own stages then identify and
//! refine as they do on images. That is some hundred times faster than rendering and as good where
//! the model is: docs/measurements/camera.md compares both.
//!
//! The conditions that a user states are [`CameraConditions`]; [`Predictor`] gives the rates of
//! right, wrong and missing answers, the orientation's error, and the spin's over sequences.

mod advice;
mod assumptions;
pub mod conditions;
mod frames;
mod judge;
pub mod lasting;
mod learn;
pub mod model;
pub mod quantiles;
pub mod regression;
mod second_look;
mod spins;
mod sweep;

pub use advice::{
    Advice, AdviceConfig, ChangeAdvice, DotSize, MAX_DOT, NamedPattern, PatternAdvice, advise,
    effective_error_deg, predictions, shipped_designs,
};
pub use assumptions::coverage;
pub use conditions::{CameraConditions, Surroundings};
pub use frames::{FrameOutcome, FramePrediction, FrameRates, PredictConfig, Predictor, paired};
pub use judge::{Judge, Judgment, Trial, rendered};
pub use learn::Observation;
pub use model::{Detected, DetectionModel, Provenance};
pub use second_look::SecondLook;
pub use spins::{SpinPrediction, rendered_spins};
pub use sweep::{CameraParameter, CameraPoint, CameraSweep, SweptCamera, sweep_csv};
