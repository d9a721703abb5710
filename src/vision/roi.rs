//! A rectangle of pixels: the part of an image in which a ball is looked for.

use super::camera::{BallCircle, Intrinsics, Pixel};
use crate::error::{Error, Result};

/// A region of interest: columns from `left` on, rows from `top` on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Roi {
    /// The first column.
    pub left: usize,
    /// The first row.
    pub top: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Roi {
    /// The square of pixels that reaches so many radii from a circle's center, cut at the borders of
    /// an image of this size; `None` where nothing is left.
    pub fn around(circle: &BallCircle, reach: f64, width: usize, height: usize) -> Option<Self> {
        let reach = reach * circle.radius;
        let side = |center: f64, pixels: usize| {
            let from = (center - reach).floor().max(0.0);
            let to = (center + reach).ceil().min(pixels as f64 - 1.0);
            (from <= to).then(|| (from as usize, (to - from) as usize + 1))
        };
        let (left, width) = side(circle.center.u, width)?;
        let (top, height) = side(circle.center.v, height)?;
        Some(Self {
            left,
            top,
            width,
            height,
        })
    }

    /// The whole of an image.
    pub fn whole(width: usize, height: usize) -> Self {
        Self {
            left: 0,
            top: 0,
            width,
            height,
        }
    }

    /// The region, where an image of this size has all of it.
    ///
    /// # Errors
    /// [`Error::Argument`] where a part of it lies outside, or it is empty.
    pub fn within(self, width: usize, height: usize) -> Result<Self> {
        let ends = |from: usize, count: usize, end: usize| {
            count > 0 && from.checked_add(count).is_some_and(|to| to <= end)
        };
        if ends(self.left, self.width, width) && ends(self.top, self.height, height) {
            return Ok(self);
        }
        let Self {
            left,
            top,
            width: columns,
            height: rows,
        } = self;
        let problem = format!(
            "expected a region within the image of {width} x {height} pixels, found {columns} x {rows} at {left}, {top}"
        );
        Err(Error::argument("roi", problem))
    }

    /// What an image of this size has of the region; `None` where that is nothing.
    pub fn cut(self, width: usize, height: usize) -> Option<Self> {
        let columns = self.width.min(width.saturating_sub(self.left));
        let rows = self.height.min(height.saturating_sub(self.top));
        (columns > 0 && rows > 0).then_some(Self {
            width: columns,
            height: rows,
            ..self
        })
    }

    /// The pixels of this region, halved so often.
    pub(super) fn grid(&self, level: u32) -> Grid {
        Grid {
            left: self.left as f64,
            top: self.top as f64,
            ..Grid::halved(level)
        }
    }
}

/// The pixels of a part of an image, each the mean of a square of the image's.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    left: f64,
    top: f64,
    /// Pixels of the image along a pixel of the part.
    pub side: f64,
}

impl Grid {
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
        Pixel {
            u: (pixel.u - (self.left + self.half())) / self.side,
            v: (pixel.v - (self.top + self.half())) / self.side,
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
        let grid = part.grid(1);
        let circle = BallCircle::new(Pixel { u: 10.0, v: 0.0 }, 5.0);
        let found = grid.circle_to_image(&circle);
        // The part's pixel 10 covers the image's columns 120 and 121.
        assert_eq!((found.center.u, found.center.v), (120.5, 7.5));
        assert_eq!(found.radius, 10.0);
        assert_eq!(grid.circle_to_part(&found), circle);
        // The camera's axis is the same point of either.
        let k = Intrinsics {
            fx: 800.0,
            fy: 800.0,
            cx: 120.5,
            cy: 7.5,
        };
        let half = grid.intrinsics_to_part(&k);
        assert_eq!((half.fx, half.cx, half.cy), (400.0, 10.0, 0.0));
    }
}
