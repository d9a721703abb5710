//! Places in a part of an image, halved or not, and in the image.

use super::camera::{BallCircle, Intrinsics, Pixel};
use crate::image::Roi;

/// The pixels of a part of an image, each the mean of a square of the image's.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    left: f64,
    top: f64,
    /// Pixels of the image along a pixel of the part.
    pub side: f64,
}

impl Grid {
    /// A part of an image, halved so often.
    pub fn of(part: &Roi, level: u32) -> Self {
        Self {
            left: part.left as f64,
            top: part.top as f64,
            ..Self::halved(level)
        }
    }

    /// A whole image, halved so often.
    pub fn halved(level: u32) -> Self {
        Self {
            left: 0.0,
            top: 0.0,
            side: f64::from(1u32 << level),
        }
    }

    /// Half of what a pixel of the part is wider: its center lies so far from that of its first one.
    fn half(&self) -> f64 {
        0.5 * (self.side - 1.0)
    }

    /// A place in the part, in the image.
    pub fn pixel_to_image(&self, pixel: Pixel) -> Pixel {
        Pixel {
            u: self.side * pixel.u + (self.left + self.half()),
            v: self.side * pixel.v + (self.top + self.half()),
        }
    }

    /// A circle of the part, in the image.
    pub fn circle_to_image(&self, circle: &BallCircle) -> BallCircle {
        BallCircle {
            center: self.pixel_to_image(circle.center),
            radius: self.side * circle.radius,
            ..*circle
        }
    }

    /// A place in the image, in the part.
    pub fn pixel_to_part(&self, pixel: Pixel) -> Pixel {
        // Exact: the side is a power of two.
        let by_side = self.side.recip();
        Pixel {
            u: (pixel.u - (self.left + self.half())) * by_side,
            v: (pixel.v - (self.top + self.half())) * by_side,
        }
    }

    /// A circle of the image, in the part.
    pub fn circle_to_part(&self, circle: &BallCircle) -> BallCircle {
        BallCircle {
            center: self.pixel_to_part(circle.center),
            radius: circle.radius / self.side,
            ..*circle
        }
    }

    /// The intrinsics of the image's camera, in the part.
    pub fn intrinsics_to_part(&self, k: &Intrinsics) -> Intrinsics {
        Intrinsics {
            fx: k.fx / self.side,
            fy: k.fy / self.side,
            cx: (k.cx - (self.left + self.half())) / self.side,
            cy: (k.cy - (self.top + self.half())) / self.side,
            skew: k.skew / self.side,
            ..*k
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_halved_returns_to_the_pixels_it_covers() {
        let part = Roi {
            left: 100,
            top: 7,
            width: 64,
            height: 64,
        };
        let grid = Grid::of(&part, 1);
        let circle = BallCircle::new(Pixel { u: 10.0, v: 0.0 }, 5.0);
        let found = grid.circle_to_image(&circle);
        // The part's pixel 10 covers the image's columns 120 and 121.
        assert_eq!((found.center.u, found.center.v), (120.5, 7.5));
        assert_eq!(found.radius, 10.0);
        assert_eq!(grid.circle_to_part(&found), circle);
        // The camera's axis is the same point of either.
        let k = Intrinsics::pinhole(800.0, 800.0, 120.5, 7.5);
        let half = grid.intrinsics_to_part(&k);
        assert_eq!((half.fx, half.cx, half.cy), (400.0, 10.0, 0.0));
    }
}
