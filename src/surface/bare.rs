//! Faces of a ball that is bare but for dots: the brightness over that of the bare surface.
//!
//! The bare surface is the polynomial of the second degree in the normal that the blob detector subtracts (`vision/blob/flatten.rs`): it is
//! known up to the limb, where the mean about a place ([`face`](super::face)) is one-sided, and takes nothing from large dots.

use super::face::{Face, FaceSamples, Rays};
use super::frame::PaintedFrame;
use crate::image::GrayImage;
use crate::vision::dots::blob::flatten::{Flat, Shading};
use crate::vision::dots::patch::{Patch, SIZE};
use crate::vision::optics::camera::{BallView, Pixel};

/// The bare surface is no darker, over the spread of the brightness.
const DARKEST: f32 = 0.1;
/// What is darker, over the bare surface, counts as this: its logarithm is mostly noise.
const DARK: f32 = 0.1;

/// Takes faces of bare balls with dots.
#[derive(Debug)]
pub(crate) struct BareFaceMaker {
    shading: Shading,
}

impl Default for BareFaceMaker {
    fn default() -> Self {
        Self {
            shading: Shading::new(),
        }
    }
}

impl BareFaceMaker {
    /// What a frame shows of the ball under a view of it; `None` where it shows none.
    pub fn take(&self, frame: &PaintedFrame, view: &BallView) -> Option<Face> {
        let (image, grid) = frame.image()?;
        let patch = Patch::cut(&image, &grid.circle_to_part(view.circle()));
        let mut flat = Flat::default();
        self.shading.flatten(patch.values(), &mut flat);
        let [mean, spread] = patch.levels();
        let bare = GrayImage::from_fn(SIZE, SIZE, |u, v| {
            let at = v * SIZE + u;
            mean + spread * (patch.values()[at] - flat.values()[at])
        });
        let over_bare = |pixel: Pixel| {
            let at = grid.pixel_to_part(pixel);
            let place = patch.from_image(at);
            let surface = bare.sample(place.u, place.v);
            1.0 + (image.sample(at.u, at.v) - surface) / surface.max(spread * DARKEST)
        };
        let mut samples = FaceSamples::take(
            over_bare,
            view.circle().radius / grid.side,
            view,
            Rays::WithinAPixel,
        );
        for value in &mut samples.values {
            *value = value.max(DARK).ln();
        }
        Some(samples.to_face(0.0))
    }
}
