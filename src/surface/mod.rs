//! Balls painted with marks of any shape: blotches, letters, a map of the world.
//!
//! No pattern is known and no mark is named. A frame's `face` is what it shows of the paint, whatever the light; the `surface` is the
//! paint all over the ball, by all frames; `fit` lays a face on the surface by least squares, and `search` finds where it lies when
//! nothing is known. `track` follows a clip: each frame is laid on the surface that those before it show, from where the last turn leads,
//! and what it shows joins the surface. After 16 frames, 32, 64 and so on, and at the end, `bundle` fits all frames, the surface, and what
//! all views share in a `clip` (outlines that are off alike, the camera's distance) at once: a bundle adjustment of pixels, by which a turn
//! that comes around closes. `follow` lays the frames of a stream on the surface of an earlier clip. Frames that agree with the surface nowhere have no pose. Related: R. J. D. Moore et al., "FicTrac: a visual
//! method for tracking spherical motion", J. Neurosci. Methods 225, 2014, which keeps a map of thresholded pixels.
//!
//! # What is promised
//! Orientations relative to the first frame, and on the surface of an earlier clip in that clip's frame. How far they are off, and how
//! often wrong, is measured (`bench painted`). What is not: a ball with hardly any paint, or paint that repeats, is refused or wrong; a clip
//! may drift where the ball does not come around, which no covariance says.

mod bare;
mod bundle;
mod chart;
mod clip;
mod cover;
mod darkness;
mod decoy;
mod dots;
mod face;
mod file;
mod fit;
mod follow;
mod frame;
mod laid;
mod mapper;
mod order;
mod search;
mod surface_map;
mod track;
mod viewed;

pub use chart::SurfaceChart;
pub(crate) use darkness::Darkness;
pub use darkness::SurfacePlace;
pub use dots::{ExpectedDot, FoundDot, contrasts, find_dots};
pub use follow::PaintedFollower;
pub use frame::PaintedFrame;
pub use mapper::{MappedClip, MappedFrame, PaintMapper};
pub use surface_map::{PLACES, SurfaceMap};
pub(crate) use track::SYSTEMATIC;
pub use track::{PaintedPose, PaintedPoses, PaintedRejection, PaintedTrack, PaintedTracker};
pub use viewed::ViewedPlaces;
