//! A part of a frame that is searched.

use super::camera::Pixel;
use super::grid::Grid;
use crate::image::{GrayImage, ImageView};

/// A part of a frame, converted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Crop<'a> {
    pub image: ImageView<'a>,
    pub gray: &'a GrayImage,
    /// Where its pixels lie in the frame.
    pub grid: Grid,
    /// Columns and rows of the frame.
    pub size: [usize; 2],
}

impl Crop<'_> {
    /// The middle of the frame, in pixels of the crop.
    pub fn middle(&self) -> Pixel {
        let [width, height] = self.size.map(|s| 0.5 * (s as f64 - 1.0));
        self.grid.pixel_to_part(Pixel {
            u: width,
            v: height,
        })
    }
}
