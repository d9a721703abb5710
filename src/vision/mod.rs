//! The estimator on images: from pixels to dots, and from dots to the ball's orientation.
//!
//! The pipeline: a [`source`](crate::source) hands out frames. [`circle`] fits the ball's outline. [`patch`] cuts the
//! ball out at one scale and one brightness, whatever the camera. A detector finds the dots ([`detect`]): the trained
//! [`net`] or the classical [`blob`], chosen by name in [`detector`]. [`camera`] projects the dots onto the sphere with
//! their uncertainty. The recognizer identifies them, and the orientation is refined on the dots that it accepts.
//! [`estimator`] runs these stages for a frame and uses the frames of a sequence as hints for each other, or follows a
//! camera's frames as they come.
//!
//! The renderer `synth` draws frames with a known truth. `python/train` trains the
//! net on them.
//!
//! Pixels: u right, v down, the center of the top-left pixel at (0, 0). Camera frame: x right, y
//! up, z from the ball towards the camera.

mod ball_circle;
mod ball_pixels;
pub mod blob;
pub mod camera;
mod cap;
pub mod circle;
pub mod dense;
pub mod derived;
pub mod detect;
pub mod detector;
pub mod estimator;
pub mod frame_table;
mod grid;
pub mod intrinsics;
pub mod lens;
pub mod net;
mod off_center;
pub mod outline;
pub mod painted;
pub mod patch;
mod rim;
pub mod smear;
mod sums;
mod tilt;
pub mod verdict;
mod whole;

pub use blob::{BlobConfig, BlobDetector};
pub use camera::{BallCircle, BallView, Camera, Pixel};
pub use circle::{BallFinder, BallFit, CircleConfig, NoBall, Polarity, find_ball};
pub use detect::{DotDetection, DotDetector};
pub use detector::{DetectorName, NamedDetector};
pub use estimator::{
    Budget, Estimator, EstimatorConfig, FrameEstimate, FrameRejection, OutlinePrior, Pose, Prior,
};
pub use intrinsics::{Calibration, Intrinsics};
pub use lens::Lens;
pub use net::CnnDetector;
pub use off_center::OffCenter;
pub use outline::{Outline, OutlineSource};
pub use patch::Patch;
