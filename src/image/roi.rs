//! A rectangle of pixels: the part of an image in which a ball is looked for.

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
}
