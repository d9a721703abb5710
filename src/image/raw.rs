//! Frames as cameras hand them out: 8 or 16 bits a channel, in memory that is not ours.
//!
//! A frame of 1280 x 1024 has 1.3 million pixels, a ball of 60 px some 3 thousand. A [`RawImage`] is a
//! view of the samples: whoever knows where the ball is converts its surroundings and nothing else.

use super::{GrayImage, RgbImage, Roi, luma};
use crate::error::{Error, Result};

/// The samples of a raw pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawPixel {
    /// Brightness.
    Gray,
    /// Red, green, blue.
    Rgb,
    /// Blue, green, red.
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

    /// Samples of a pixel: its bytes, where a sample has 8 bits.
    pub fn channels(self) -> usize {
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

/// Samples in memory that is not ours; the largest value is white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RawSamples<'a> {
    /// 8 bits each.
    Eight(&'a [u8]),
    /// 16 bits each.
    Sixteen(&'a [u16]),
}

impl RawSamples<'_> {
    /// How many there are.
    fn len(&self) -> usize {
        match self {
            Self::Eight(samples) => samples.len(),
            Self::Sixteen(samples) => samples.len(),
        }
    }
}

impl<'a> From<&'a [u8]> for RawSamples<'a> {
    fn from(samples: &'a [u8]) -> Self {
        Self::Eight(samples)
    }
}

impl<'a> From<&'a Vec<u8>> for RawSamples<'a> {
    fn from(samples: &'a Vec<u8>) -> Self {
        Self::Eight(samples)
    }
}

impl<'a> From<&'a Vec<u16>> for RawSamples<'a> {
    fn from(samples: &'a Vec<u16>) -> Self {
        Self::Sixteen(samples)
    }
}

impl<'a> From<&'a [u16]> for RawSamples<'a> {
    fn from(samples: &'a [u16]) -> Self {
        Self::Sixteen(samples)
    }
}

/// A view of an image of samples, row after row from the top, without gaps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RawImage<'a> {
    width: usize,
    height: usize,
    pixel: RawPixel,
    samples: RawSamples<'a>,
}

impl<'a> RawImage<'a> {
    /// The image of these samples.
    ///
    /// # Errors
    /// [`Error::Argument`] where their number is not that of the pixels, or there are none.
    pub fn new(
        width: usize,
        height: usize,
        pixel: RawPixel,
        samples: impl Into<RawSamples<'a>>,
    ) -> Result<Self> {
        let samples = samples.into();
        let expected = width
            .checked_mul(height)
            .and_then(|pixels| pixels.checked_mul(pixel.channels()));
        let found = samples.len();
        if found == 0 || expected != Some(found) {
            let name = pixel.as_str();
            let problem = format!(
                "expected the samples of {width} x {height} pixels ({name}), at least one, found {found}"
            );
            return Err(Error::argument("image", problem));
        }
        Ok(Self {
            width,
            height,
            pixel,
            samples,
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

    /// What the samples of a pixel mean.
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

    /// The luma of a part of the image.
    pub(crate) fn gray_into(&self, part: &Roi, out: &mut GrayImage) {
        match self.samples {
            RawSamples::Eight(samples) => self.grays(samples, part, out),
            RawSamples::Sixteen(samples) => self.grays(samples, part, out),
        }
    }

    fn grays<T: RawSample>(&self, samples: &[T], part: &Roi, out: &mut GrayImage) {
        out.fill_rows(part.width, part.height, |v, values| {
            let row = self.row(samples, part.top + v, part.left, part.width);
            match self.pixel {
                RawPixel::Gray => values.extend(row.iter().map(|sample| sample.gray())),
                _ => values.extend(row.chunks_exact(3).map(|c| luma(self.color(c)))),
            }
        });
    }

    /// The colors of a part of the image.
    pub(crate) fn color_into(&self, part: &Roi, out: &mut RgbImage) {
        match self.samples {
            RawSamples::Eight(samples) => self.colors(samples, part, out),
            RawSamples::Sixteen(samples) => self.colors(samples, part, out),
        }
    }

    fn colors<T: RawSample>(&self, samples: &[T], part: &Roi, out: &mut RgbImage) {
        out.fill_rows(part.width, part.height, |v, values| {
            let row = self.row(samples, part.top + v, part.left, part.width);
            match self.pixel {
                RawPixel::Gray => values.extend(row.iter().map(|sample| [sample.unit(); 3])),
                _ => values.extend(row.chunks_exact(3).map(|c| self.color(c))),
            }
        });
    }

    /// What is added of white by [`RawImage::add_colors`].
    pub(crate) fn white(&self) -> f32 {
        match self.samples {
            RawSamples::Eight(_) => u8::WHITE,
            RawSamples::Sixteen(_) => u16::WHITE,
        }
    }

    /// Adds the samples of a row's pixels in colors, from the column `left`, to the cells of `1 << level` pixels.
    pub(crate) fn add_colors(&self, v: usize, left: usize, level: u32, sums: &mut [[f32; 3]]) {
        match self.samples {
            RawSamples::Eight(samples) => self.add_channels(samples, v, left, level, sums),
            RawSamples::Sixteen(samples) => self.add_channels(samples, v, left, level, sums),
        }
    }

    fn add_channels<T: RawSample>(
        &self,
        samples: &[T],
        v: usize,
        left: usize,
        level: u32,
        sums: &mut [[f32; 3]],
    ) {
        let side = 1 << level;
        let row = self.row(samples, v, left, sums.len() * side);
        for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(3 * side)) {
            for (sum, total) in sum.iter_mut().zip(self.totals(cell)) {
                *sum += total as f32;
            }
        }
    }

    /// Adds the luma of a row's pixels, from the column `left`, to the cells of `1 << level` pixels.
    pub(crate) fn add_row(&self, v: usize, left: usize, level: u32, sums: &mut [f32]) {
        match self.samples {
            RawSamples::Eight(samples) => self.add_samples(samples, v, left, level, sums),
            RawSamples::Sixteen(samples) => self.add_samples(samples, v, left, level, sums),
        }
    }

    fn add_samples<T: RawSample>(
        &self,
        samples: &[T],
        v: usize,
        left: usize,
        level: u32,
        sums: &mut [f32],
    ) {
        let side = 1 << level;
        let row = self.row(samples, v, left, sums.len() * side);
        match self.pixel {
            RawPixel::Gray => {
                for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(side)) {
                    let total: u32 = cell.iter().map(|&sample| sample.into()).sum();
                    *sum += luma([share::<T>(total); 3]);
                }
            }
            _ => {
                for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(3 * side)) {
                    *sum += luma(self.totals(cell).map(share::<T>));
                }
            }
        }
    }

    /// The sums of red, green and blue over pixels in colors.
    #[inline]
    fn totals<T: RawSample>(&self, pixels: &[T]) -> [u32; 3] {
        let mut totals = [0u32; 3];
        for pixel in pixels.chunks_exact(3) {
            for (total, &sample) in totals.iter_mut().zip(pixel) {
                *total += sample.into();
            }
        }
        if self.pixel == RawPixel::Bgr {
            totals.reverse();
        }
        totals
    }

    /// The samples of a row between two columns.
    fn row<'b, T>(&self, samples: &'b [T], v: usize, left: usize, width: usize) -> &'b [T] {
        let channels = self.pixel.channels();
        &samples[(v * self.width + left) * channels..][..width * channels]
    }

    /// The color of a pixel's samples.
    fn color<T: RawSample>(&self, samples: &[T]) -> [f32; 3] {
        let [red, green, blue] = match self.pixel {
            RawPixel::Gray => [0; 3],
            RawPixel::Rgb => [0, 1, 2],
            RawPixel::Bgr => [2, 1, 0],
        };
        [red, green, blue].map(|channel| samples[channel].unit())
    }
}

/// A sum of samples over white: rounded once, so that samples of 8 and of 16 bits with the same values have the same sum.
fn share<T: RawSample>(total: u32) -> f32 {
    (f64::from(total) / f64::from(T::WHITE)) as f32
}

/// A sample.
trait RawSample: Copy + Into<u32> {
    /// The largest value.
    const WHITE: f32;

    /// As a value from 0 to 1, as image files are decoded.
    fn unit(self) -> f32;

    /// The luma of a gray pixel: that of equal channels differs from their value by rounding; files are read this way.
    fn gray(self) -> f32 {
        luma([self.unit(); 3])
    }
}

impl RawSample for u8 {
    const WHITE: f32 = 255.0;

    fn unit(self) -> f32 {
        f32::from(self) / Self::WHITE
    }

    fn gray(self) -> f32 {
        GRAYS[usize::from(self)]
    }
}

impl RawSample for u16 {
    const WHITE: f32 = 65_535.0;

    fn unit(self) -> f32 {
        f32::from(self) / Self::WHITE
    }
}

static GRAYS: std::sync::LazyLock<[f32; 256]> =
    std::sync::LazyLock::new(|| std::array::from_fn(|k| luma([(k as u8).unit(); 3])));

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_sample_is_white() {
        for pixel in RawPixel::ALL {
            let bytes = vec![u8::MAX; pixel.channels()];
            let words = vec![u16::MAX; pixel.channels()];
            for samples in [RawSamples::Eight(&bytes), RawSamples::Sixteen(&words)] {
                let image = RawImage::new(1, 1, pixel, samples).expect("one pixel");
                let gray = image.to_gray().row(0, 0, 1)[0];
                assert!((gray - 1.0).abs() < 1e-6, "{pixel:?}: {gray}");
            }
        }
    }
}
