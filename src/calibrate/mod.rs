//! Calibration: the dots of a ball as they were really drawn, from a clip of it.
//!
//! A hand-drawn dot lies a degree or more from its nominal place, a dot gets forgotten, a logo shows.
//! A clip of the ball shows every dot from many sides: that measures the drawn pattern far better than
//! any one frame. [`calibrate`] alternates between two steps until they agree:
//!
//! 1. the dots, the frames' orientations and outlines, and the camera's distance are fitted together
//!    (bundle adjustment: robust, with every detection's covariance, and a smooth rotation where the
//!    frames have times);
//! 2. the frames are identified anew with the fitted dots, which takes in more frames and more
//!    detections; dots that are not found where they should be are left out, and steady marks that have
//!    no name are found.
//!
//! The calibrated pattern is the one least rotated from the nominal one, so that orientations mean
//! the same as before.
//!
//! # What is promised
//! Every dot has a covariance and the number of frames that saw it; what no frame shows stays at its
//! nominal place with the placement error that was expected. A clip that does not show the pattern,
//! or in too few frames, is rejected with the reason ([`CalibrationRejection`]).
//!
//! # What is not
//! The covariances are those of a local linearization, with the noise's scale learned from the
//! residuals. An error that all views of a dot share, such as ink that is not where the dot's middle is,
//! shows in no residual: it is a setting ([`CalibrationConfig::shared_sigma_rad`]). A dot that a logo hides is not
//! distinguished from one that was never drawn: either way it is of no use to an estimator. A stain that looks
//! like a dot, near the place of one that is missing, is taken for it.
//!
//! ```
//! use spindoe::calibrate::{CalibrationConfig, calibrate};
//! # use spindoe::synth::{SynthConfig, dataset::{SynthSequence, ClipConfig}};
//! # use spindoe::vision::{Budget, DetectorName, Prior};
//! # use spindoe::{Estimator, EstimatorConfig, FrameEstimate, Pattern};
//! # fn main() -> spindoe::Result<()> {
//! # let text = include_bytes!("../../designs/dots20/pattern.csv");
//! let nominal = Pattern::from_csv("pattern.csv".as_ref(), text)?;
//! // The frames of a clip as an estimator gives them, here three: too few.
//! # let estimator = Estimator::new(&nominal, EstimatorConfig::default(), DetectorName::Cnn.build()?)?;
//! # let mut workspace = estimator.workspace();
//! # let turning = ClipConfig { fps: 100.0, ..ClipConfig::default() };
//! # let clip = SynthSequence::random(&nominal, &SynthConfig::good(), &turning, 1, 3)?;
//! # let mut frames = Vec::new();
//! # for k in 0..3 {
//! #     let mut frame = FrameEstimate::default();
//! #     estimator.estimate(&clip.frame(k)?.image, &Prior::default(), &Budget::default(), &mut workspace, &mut frame);
//! #     frames.push(frame);
//! # }
//! match calibrate(&nominal, &frames, None, &CalibrationConfig::default())? {
//!     Ok(calibration) => println!("{} dots measured", calibration.measured()),
//!     Err(rejection) => println!("{rejection}"),
//! }
//! # Ok(())
//! # }
//! ```

mod bundle;
mod clip_dot;
mod config;
mod fitted;
mod holdout;
mod identify;
#[cfg(feature = "native")]
pub mod live;
mod marks;
mod pixels;
mod presence;
mod result;
mod rounds;
mod unknown;

pub use config::CalibrationConfig;
pub use holdout::{
    FrameResidual, HeldOut, HeldOutFrame, MotionResidual, held_out, held_out_with, motion_residual,
};
pub use identify::identify_frames;
pub use presence::MIN_EXPECTED_VIEWS;
pub use result::{CalibratedDot, Calibration, CalibrationRejection, DotState, SteadyMark};
pub use unknown::{
    BuiltPattern, DecidedMarks, KnownDots, MARK_FEATURES, MarkEvidence, MarkKind, MarkedSurface,
    MissingSide, Side, SurfaceMark, SurfaceObserver, SurfacePlace, Survey, UnknownRejection,
    calibrate_built, matching_design, survey,
};

use crate::error::{Error, Result};
use crate::pattern::Pattern;
use crate::vision::FrameEstimate;
use rounds::Rounds;

/// Calibrates a ball of the pattern `nominal` from the frames of a clip, as an estimator for that
/// pattern gives them. `times_s` are the frames' times in seconds, where all are known.
///
/// # Errors
/// [`Error::Argument`] for settings outside their domains, or times of another number than the frames.
/// A clip that cannot be calibrated is no error but a [`CalibrationRejection`].
pub fn calibrate(
    nominal: &Pattern,
    frames: &[FrameEstimate],
    times_s: Option<&[f64]>,
    config: &CalibrationConfig,
) -> Result<std::result::Result<Calibration, CalibrationRejection>> {
    config.check()?;
    if let Some(times) = times_s.filter(|t| t.len() != frames.len()) {
        let problem = format!("expected {} times, found {}", frames.len(), times.len());
        return Err(Error::argument("times_s", problem));
    }
    Rounds::new(nominal, frames, times_s, config).run()
}
