//! The dots of a ball in an image: the [`patch`] that is cut out around it, the detectors ([`net`] and [`blob`], chosen by name in
//! [`detector`]), and dots measured in the image's own pixels, at rest as caps and moving as a [`smear`].

pub mod blob;
pub(crate) mod cap;
pub mod detector;
pub mod heat;
pub mod net;
pub mod patch;
pub mod smear;
