//! What is drawn on a ball, in one image: its brightness over that of the unmarked surface.
//!
//! The surface is the polynomial of the second degree in the normal that the blob detector subtracts
//! (`vision/blob/flatten.rs`); what is divided by it is 1 on the bare ball, whatever the light, and less in ink. In the image's
//! resolution: a mark of half a pixel's radius is still there when all frames of a clip are laid over each other ([`map`]).

pub mod map;

use super::blob::flatten::{Flat, Shading};
use super::camera::{BallCircle, Pixel};
use super::patch::{Patch, RIM, SIZE};
use crate::image::GrayImage;

/// The value of the bare surface.
const BARE: f32 = 128.0;
/// A ball of a larger radius, pixels, is taken at this one.
const MAX_RADIUS: f64 = 72.0;

/// The brightness of a ball's image over that of its unmarked surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Albedo {
    /// Row by row, `side` a row; empty where no ball was seen.
    values: Vec<u8>,
    side: usize,
    circle: BallCircle,
    /// Pixels of the image a value.
    step: f64,
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
        let mut flat = Flat::default();
        self.shading.flatten(patch.values(), &mut flat);
        let [mean, spread] = patch.levels();
        let bare = patch.values().iter().zip(flat.values());
        let bare: Vec<f32> = bare
            .map(|(value, over)| mean + spread * (value - over))
            .collect();
        let step = (circle.radius / MAX_RADIUS).max(1.0);
        let side = (2.0 * RIM * circle.radius / step).ceil() as usize + 1;
        let mut albedo = Albedo {
            values: Vec::with_capacity(side * side),
            side,
            circle: *circle,
            step,
        };
        for row in 0..side {
            for column in 0..side {
                let pixel = albedo.pixel(column, row);
                let place = patch.from_image(pixel);
                let surface = interpolate(&bare, SIZE, place).unwrap_or(mean);
                let value = image.sample(pixel.u, pixel.v);
                let ratio = 1.0 + (value - surface) / surface.max(spread * 0.1);
                let ratio = (BARE * ratio).round().clamp(0.0, 255.0);
                albedo.values.push(ratio as u8);
            }
        }
        albedo
    }
}

impl Default for Albedo {
    /// No ball.
    fn default() -> Self {
        Self {
            values: Vec::new(),
            side: 0,
            circle: BallCircle::new(Pixel::default(), 1.0),
            step: 1.0,
        }
    }
}

impl Albedo {
    /// The ratio at a place of the image; `None` beyond the ball's surroundings.
    pub fn at(&self, pixel: Pixel) -> Option<f32> {
        let middle = 0.5 * (self.side as f64 - 1.0);
        let place = Pixel {
            u: middle + (pixel.u - self.circle.center.u) / self.step,
            v: middle + (pixel.v - self.circle.center.v) / self.step,
        };
        Some(interpolate(&self.values, self.side, place)? / BARE)
    }

    /// Where a value lies in the image.
    fn pixel(&self, column: usize, row: usize) -> Pixel {
        let middle = 0.5 * (self.side as f64 - 1.0);
        Pixel {
            u: self.circle.center.u + self.step * (column as f64 - middle),
            v: self.circle.center.v + self.step * (row as f64 - middle),
        }
    }
}

/// A value between those of a square of `side` values a row; `None` beyond it.
fn interpolate<T: Copy + Into<f32>>(values: &[T], side: usize, place: Pixel) -> Option<f32> {
    let (column, row) = (place.u.floor(), place.v.floor());
    let last = side as f64 - 1.0;
    if !(column >= 0.0 && row >= 0.0 && column < last && row < last) {
        return None;
    }
    let (x, y) = ((place.u - column) as f32, (place.v - row) as f32);
    let first = row as usize * side + column as usize;
    let value = |k: usize| -> f32 { values[first + k].into() };
    let above = value(0) * (1.0 - x) + value(1) * x;
    let below = value(side) * (1.0 - x) + value(side + 1) * x;
    Some(above * (1.0 - y) + below * y)
}
