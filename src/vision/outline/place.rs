//! Where in a frame an outline is looked for.

use crate::image::{ImageView, Roi};
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::BallCircle;

/// What is cut out around a circle, in radii: what the net for outlines sees, and a rough circle's error.
pub(crate) const SURROUNDINGS: f64 = 1.8;
/// Balls of larger radii, pixels, are looked at at a smaller scale: of no pixel's more than the detectors, 28 values a radius, and the fit of
/// circles, up to 44, make use. The image's own pixels are read last, about a pose.
pub(crate) const FOR_DOTS: f64 = 60.0;
/// The same where the outline is all that is looked for: its rim is read there.
pub(crate) const FOR_OUTLINE: f64 = 250.0;

/// Where an outline is looked for, in the frame's pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Place {
    /// It is known.
    Known(Outline),
    /// It is near a circle.
    Near(BallCircle),
    /// It is anywhere in a part.
    Within(Roi),
}

impl Place {
    /// The part of the image that is converted, and how often it is halved, until the radius of a ball is no more than `most`;
    /// `None` where nothing of it can be seen.
    pub fn part(&self, image: &ImageView<'_>, most: f64) -> Option<(Roi, u32)> {
        let (width, height) = (image.width(), image.height());
        match self {
            Self::Known(outline) => {
                let part = outline.circle.region(SURROUNDINGS, width, height);
                Some((part.unwrap_or(Roi::whole(width, height)), 0))
            }
            Self::Near(circle) => {
                let level = level_of(circle.radius, most);
                let part = circle.region(SURROUNDINGS, width, height)?;
                let is_seen = part.width.min(part.height) >> level > 0;
                is_seen.then_some((part, level))
            }
            Self::Within(part) => Some((*part, 0)),
        }
    }
}

/// How often a part is halved until it has no more pixels than this.
pub(crate) fn level_of_part(part: &Roi, most: f64) -> u32 {
    let pixels = (part.width * part.height) as f64;
    level_of(pixels.sqrt(), most.sqrt())
}

/// How often a length is halved until it is no more than another.
pub(crate) fn level_of(length: f64, most: f64) -> u32 {
    (length / most).log2().ceil().max(0.0) as u32
}
