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

    /// Where the region's pixel (0, 0) lies in the image.
    pub fn origin(&self) -> Pixel {
        Pixel {
            u: self.left as f64,
            v: self.top as f64,
        }
    }
}

/// A camera's intrinsics for pixels that are counted from `origin`.
pub(super) fn shifted_intrinsics(k: &Intrinsics, origin: Pixel) -> Intrinsics {
    Intrinsics {
        cx: k.cx - origin.u,
        cy: k.cy - origin.v,
        ..*k
    }
}
