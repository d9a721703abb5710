//! The pixels about a ball, as the fits of its dots and of its rim read them.

use super::camera::{BallView, Pixel};
use super::grid::Grid;
use crate::image::GrayImage;

/// A part of an image, and how the ball is seen in the whole.
#[derive(Clone, Copy)]
pub(crate) struct BallPixels<'a> {
    /// The part.
    pub gray: &'a GrayImage,
    /// Where its pixels lie in the image.
    pub grid: Grid,
    /// The ball in the image.
    pub view: &'a BallView,
}

impl BallPixels<'_> {
    /// Where a column and row of the part lie in the image.
    pub fn place(&self, column: usize, row: usize) -> Pixel {
        self.grid.pixel_to_image(Pixel {
            u: column as f64,
            v: row as f64,
        })
    }
}
