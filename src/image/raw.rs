//! Frames as cameras hand them out: 8 bits a channel, in memory that is not ours.
//!
//! A frame of 1280 x 1024 has 1.3 million pixels, a ball of 60 px some 3 thousand. A [`RawImage`] is a
//! view of the bytes: whoever knows where the ball is converts its surroundings and nothing else.

use super::{GrayImage, RgbImage, Roi, luma};
use crate::error::{Error, Result};

/// The bytes of a raw pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawPixel {
    /// One byte of brightness.
    Gray,
    /// Red, green, blue, a byte each.
    Rgb,
    /// Blue, green, red, a byte each.
    Bgr,
}

impl RawPixel {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Gray, Self::Rgb, Self::Bgr];

    /// The name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Gray => "gray",
            Self::Rgb => "rgb",
            Self::Bgr => "bgr",
        }
    }

    /// Bytes of a pixel.
    pub fn bytes(self) -> usize {
        match self {
            Self::Gray => 1,
            Self::Rgb | Self::Bgr => 3,
        }
    }
}

impl std::str::FromStr for RawPixel {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "pixel", name)
    }
}

/// A view of an image of bytes, row after row from the top, without gaps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RawImage<'a> {
    width: usize,
    height: usize,
    pixel: RawPixel,
    bytes: &'a [u8],
}

impl<'a> RawImage<'a> {
    /// The image of these bytes.
    ///
    /// # Errors
    /// [`Error::Argument`] where their number is not that of the pixels, or there are none.
    pub fn new(width: usize, height: usize, pixel: RawPixel, bytes: &'a [u8]) -> Result<Self> {
        let expected = width
            .checked_mul(height)
            .and_then(|pixels| pixels.checked_mul(pixel.bytes()));
        if bytes.is_empty() || expected != Some(bytes.len()) {
            let (name, found) = (pixel.as_str(), bytes.len());
            let problem = format!(
                "expected the bytes of {width} x {height} pixels ({name}), at least one, found {found} bytes"
            );
            return Err(Error::argument("image", problem));
        }
        Ok(Self {
            width,
            height,
            pixel,
            bytes,
        })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// What the bytes of a pixel mean.
    pub fn pixel(&self) -> RawPixel {
        self.pixel
    }

    /// The luma of every pixel.
    pub fn to_gray(&self) -> GrayImage {
        let mut gray = GrayImage::default();
        self.gray_into(&Roi::whole(self.width, self.height), &mut gray);
        gray
    }

    /// The color of every pixel.
    pub fn to_rgb(&self) -> RgbImage {
        let mut color = RgbImage::default();
        self.color_into(&Roi::whole(self.width, self.height), &mut color);
        color
    }

    /// The bytes of a row between two columns.
    fn row(&self, v: usize, left: usize, width: usize) -> &'a [u8] {
        let bytes = self.pixel.bytes();
        &self.bytes[(v * self.width + left) * bytes..][..width * bytes]
    }

    /// The luma of a part of the image.
    pub(crate) fn gray_into(&self, part: &Roi, out: &mut GrayImage) {
        out.fill_rows(part.width, part.height, |v, values| {
            let row = self.row(part.top + v, part.left, part.width);
            match self.pixel {
                RawPixel::Gray => values.extend(row.iter().map(|b| GRAYS[usize::from(*b)])),
                _ => values.extend(row.chunks_exact(3).map(|c| luma(self.color(c)))),
            }
        });
    }

    /// The colors of a part of the image.
    pub(crate) fn color_into(&self, part: &Roi, out: &mut RgbImage) {
        out.fill_rows(part.width, part.height, |v, values| {
            let row = self.row(part.top + v, part.left, part.width);
            match self.pixel {
                RawPixel::Gray => values.extend(row.iter().map(|b| [unit(*b); 3])),
                _ => values.extend(row.chunks_exact(3).map(|c| self.color(c))),
            }
        });
    }

    /// The color of a pixel.
    pub(crate) fn color_at(&self, u: usize, v: usize) -> [f32; 3] {
        let bytes = self.row(v, u, 1);
        match self.pixel {
            RawPixel::Gray => [unit(bytes[0]); 3],
            _ => self.color(bytes),
        }
    }

    fn color(&self, bytes: &[u8]) -> [f32; 3] {
        let [red, green, blue] = match self.pixel {
            RawPixel::Bgr => [2, 1, 0],
            RawPixel::Gray | RawPixel::Rgb => [0, 1, 2],
        };
        [unit(bytes[red]), unit(bytes[green]), unit(bytes[blue])]
    }

    /// Adds the luma of a row's pixels, from the column `left`, to the cells of `1 << level` pixels.
    pub(crate) fn add_row(&self, v: usize, left: usize, level: u32, sums: &mut [f32]) {
        let side = 1 << level;
        let row = self.row(v, left, sums.len() * side);
        match self.pixel {
            RawPixel::Gray => {
                for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(side)) {
                    let total: u32 = cell.iter().map(|b| u32::from(*b)).sum();
                    *sum += total as f32 / 255.0;
                }
            }
            _ => {
                for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(3 * side)) {
                    let mut totals = [0u32; 3];
                    for pixel in cell.chunks_exact(3) {
                        for (total, byte) in totals.iter_mut().zip(pixel) {
                            *total += u32::from(*byte);
                        }
                    }
                    if self.pixel == RawPixel::Bgr {
                        totals.reverse();
                    }
                    *sum += luma(totals.map(|t| t as f32 / 255.0));
                }
            }
        }
    }
}

/// A byte as a value from 0 to 1, as image files are decoded.
fn unit(byte: u8) -> f32 {
    f32::from(byte) / 255.0
}

/// The luma of equal channels differs from their value by rounding; files are read this way.
static GRAYS: std::sync::LazyLock<[f32; 256]> =
    std::sync::LazyLock::new(|| std::array::from_fn(|k| luma([unit(k as u8); 3])));
