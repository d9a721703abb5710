//! The estimator on images: from pixels to dots, and from dots to the ball's orientation.
//!
//! The pipeline: a [`source`](crate::source) hands out frames. [`circle`](outline::circle) fits the ball's outline. [`patch`](dots::patch) cuts the
//! ball out at one scale and one brightness, whatever the camera. A [`detector`](dots::detector) finds the dots: the trained
//! [`net`] or the classical [`blob`](dots::blob). [`camera`](optics::camera) projects the dots onto the sphere with
//! their uncertainty. The recognizer identifies them, and the orientation is refined on the dots that it accepts.
//! [`estimator`] runs these stages for a frame; a [`clip`](crate::clip) uses its frames as hints for each other, or follows a
//! camera's frames as they come.
//!
//! The renderer `synth` draws frames with a known truth. `python/train` trains the
//! net on them.
//!
//! Pixels: u right, v down, the center of the top-left pixel at (0, 0). Camera frame: x right, y
//! up, z from the ball towards the camera.

pub mod dots;
pub mod estimator;
pub mod frame;
pub mod net;
pub mod optics;
pub mod outline;
pub mod pose;

pub use dots::blob::BlobDetector;
pub use dots::detector::{DetectorName, DotDetection, DotDetector};
pub use dots::net::CnnDetector;
pub use dots::patch::Patch;
pub use estimator::Estimator;
pub use frame::{
    Budget, EstimatorConfig, FrameEstimate, FrameRejection, Outline, OutlinePrior, OutlineSource,
    Pose, Prior,
};
pub use optics::OffCenter;
pub use optics::camera::{BallCircle, BallView, Camera, Pixel};
pub use optics::intrinsics::{CameraCalibration, Intrinsics};
pub use optics::lens::Lens;
pub use optics::rig::{Extrinsics, Rig, RigCamera};
pub use outline::circle::{BallFinder, BallFit, CircleConfig, NoBall, Polarity, find_ball};
