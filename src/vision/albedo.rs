//! What is drawn on a ball, in one image: its brightness over that of the unmarked surface.
//!
//! The surface is the polynomial of the second degree in the normal that the blob detector subtracts
//! (`vision/blob/flatten.rs`); what is divided by it is 1 on the bare ball, whatever the light, and less in ink. In the patch's
//! resolution: 64 x 64 values.

use super::blob::flatten::{Flat, Shading};
use super::camera::{BallCircle, Pixel};
use super::patch::{Patch, SIZE};
use crate::image::GrayImage;

/// The value of the bare surface.
const BARE: f32 = 128.0;

/// The brightness of a ball's image over that of its unmarked surface.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Albedo {
    /// Empty where no ball was seen.
    values: Vec<u8>,
}

/// Takes albedos from images, on several threads.
#[derive(Debug)]
pub struct AlbedoMaker {
    shading: Shading,
}

impl Default for AlbedoMaker {
    fn default() -> Self {
        Self {
            shading: Shading::new(),
        }
    }
}

impl AlbedoMaker {
    /// The albedo of the ball within `circle`.
    pub fn take(&self, image: &GrayImage, circle: &BallCircle) -> Albedo {
        let patch = Patch::cut(image, circle);
        let (values, mut flat) = (patch.values(), Flat::default());
        self.shading.flatten(values, &mut flat);
        let [mean, spread] = patch.levels();
        let values = values.iter().zip(flat.values()).map(|(value, over)| {
            let surface = mean + spread * (value - over);
            let ratio = 1.0 + spread * over / surface.max(spread * 0.1);
            (BARE * ratio).round().clamp(0.0, 255.0) as u8
        });
        Albedo {
            values: values.collect(),
        }
    }
}

impl Albedo {
    /// The ratio at a place of the image in which the ball lay within `circle`; `None` beyond the patch.
    pub fn at(&self, circle: &BallCircle, pixel: Pixel) -> Option<f32> {
        let place = Patch::place(circle, pixel);
        let (column, row) = (place.u.floor(), place.v.floor());
        let last = (SIZE - 1) as f64;
        if !(column >= 0.0 && row >= 0.0 && column < last && row < last) || self.values.is_empty() {
            return None;
        }
        let (x, y) = ((place.u - column) as f32, (place.v - row) as f32);
        let first = row as usize * SIZE + column as usize;
        let value = |k: usize| f32::from(self.values[first + k]);
        let above = value(0) * (1.0 - x) + value(1) * x;
        let below = value(SIZE) * (1.0 - x) + value(SIZE + 1) * x;
        Some((above * (1.0 - y) + below * y) / BARE)
    }
}
