//! The estimator on images: from pixels to dots, and from dots to the ball's orientation.
//!
//! The way of a frame: [`input`] reads it, [`image`] decodes it to gray; [`circle`] fits the ball's outline; [`patch`] cuts the ball out at
//! one scale and brightness whatever the camera; a detector finds the dots ([`detect`], by name [`detector`]: the trained [`net`], or the classical [`blob`]); [`camera`] lays
//! them on the sphere with their uncertainty; the recognizer tells which is which, and the orientation is
//! refined on the dots that it accepts. [`estimator`] does all
//! that for a frame, and lets the frames of a flight help each other. [`synth`] draws frames with a known truth, on which the
//! workspace's `spindoe-train` makes the net.
//!
//! Pixels: u right, v down, the center of the top-left pixel at (0, 0). Camera frame: x right, y up, z from the
//! ball towards the camera.

pub mod blob;
pub mod camera;
pub mod circle;
pub mod detect;
pub mod detector;
pub mod estimator;
pub mod image;
pub mod input;
pub mod net;
pub mod patch;

pub use blob::{BlobConfig, BlobDetector};
pub use camera::{BallCircle, BallView, Camera, Intrinsics, Pixel};
pub use circle::{BallFinder, BallFit, CircleConfig, NoBall, Polarity, find_ball};
pub use detect::{DotDetection, DotDetector};
pub use detector::{DetectorName, NamedDetector};
pub use estimator::{Estimator, EstimatorConfig, FrameEstimate, FrameRejection, Pose};
pub use image::{GrayImage, RgbImage};
pub use net::CnnDetector;
pub use patch::Patch;
