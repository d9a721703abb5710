//! Frames as cameras hand them out: 8 or 16 bits a channel, in memory that is not ours.
//!
//! A frame of 1280 x 1024 has 1.3 million pixels, a ball of 60 px some 3 thousand. A [`RawImage`] is a
//! view of the samples: whoever knows where the ball is converts its surroundings and nothing else.

use super::{GrayImage, RgbImage, Roi, luma};
use crate::error::{Error, Result};

/// Sums of columns that are held at once: whole pixels.
const SUMMED: usize = 1536;

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
        out.fill_rows(part.width, part.height, |v, values| {
            let from = values.len();
            values.resize(from + part.width, 0.0);
            self.cell_row(part.top + v, part.left, 0, &mut values[from..]);
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
            let (pixels, _) = row.as_chunks();
            let unit = |color: [T; 3]| color.map(T::unit);
            match self.pixel {
                RawPixel::Gray => values.extend(row.iter().map(|sample| [sample.unit(); 3])),
                RawPixel::Rgb => values.extend(pixels.iter().map(|rgb| unit(*rgb))),
                RawPixel::Bgr => values.extend(pixels.iter().map(|[b, g, r]| unit([*r, *g, *b]))),
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
        let is_reversed = self.pixel == RawPixel::Bgr;
        let add = |sum: &mut [f32; 3], totals: [u32; 3]| {
            let [first, green, last] = totals.map(|total| total as f32);
            let (red, blue) = match is_reversed {
                false => (first, last),
                true => (last, first),
            };
            for (sum, total) in sum.iter_mut().zip([red, green, blue]) {
                *sum += total;
            }
        };
        // Most are seen at half their size.
        if level == 1 {
            let (cells, _) = row.as_chunks::<6>();
            for (sum, &[a, b, c, d, e, f]) in sums.iter_mut().zip(cells) {
                add(
                    sum,
                    [[a, d], [b, e], [c, f]].map(|[one, other]| one.into() + other.into()),
                );
            }
            return;
        }
        for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(3 * side)) {
            add(sum, totals(cell));
        }
    }

    /// The lumas of a row of cells of `1 << level` pixels a side, whose first pixel lies in the column `left` and the row `top`.
    pub(crate) fn cell_row(&self, top: usize, left: usize, level: u32, lumas: &mut [f32]) {
        match self.samples {
            RawSamples::Eight(samples) => self.cells(samples, [top, left], level, lumas),
            RawSamples::Sixteen(samples) => self.cells(samples, [top, left], level, lumas),
        }
    }

    fn cells<T: RawSample>(
        &self,
        samples: &[T],
        [top, left]: [usize; 2],
        level: u32,
        lumas: &mut [f32],
    ) {
        let (side, all) = (1 << level, lumas.len() << level);
        if level == 0 {
            return self.pixels(self.row(samples, top, left, all), lumas);
        }
        let width = side * self.pixel.channels();
        let white = f64::from(T::WHITE) * (side * side) as f64;
        // Down the rows first, many columns at once.
        let sum_rows = |from: usize, sums: &mut [u32]| {
            sums.fill(0);
            for v in top..top + side {
                let row = self.row(samples, v, left, all);
                for (sum, &sample) in sums.iter_mut().zip(&row[from..]) {
                    *sum += sample.into();
                }
            }
        };
        let mut sums = [0u32; SUMMED];
        let luma_of = |totals: [u64; 3]| luma(totals.map(|total| (total as f64 / white) as f32));
        let cells = SUMMED / width;
        if cells == 0 {
            for (k, y) in lumas.iter_mut().enumerate() {
                let mut totals = [0; 3];
                for from in (0..width).step_by(SUMMED) {
                    let sums = &mut sums[..SUMMED.min(width - from)];
                    sum_rows(k * width + from, sums);
                    self.add(sums, &mut totals);
                }
                *y = luma_of(totals);
            }
            return;
        }
        for (k, lumas) in lumas.chunks_mut(cells).enumerate() {
            let sums = &mut sums[..lumas.len() * width];
            sum_rows(k * cells * width, sums);
            for (y, cell) in lumas.iter_mut().zip(sums.chunks_exact(width)) {
                let mut totals = [0; 3];
                self.add(cell, &mut totals);
                *y = luma_of(totals);
            }
        }
    }

    /// The lumas of the pixels of a row.
    fn pixels<T: RawSample>(&self, row: &[T], lumas: &mut [f32]) {
        let (pixels, _) = row.as_chunks();
        let lumas = lumas.iter_mut();
        match self.pixel {
            RawPixel::Gray => lumas.zip(row).for_each(|(y, sample)| *y = sample.gray()),
            RawPixel::Rgb => lumas.zip(pixels).for_each(|(y, rgb)| *y = T::luma(*rgb)),
            RawPixel::Bgr => {
                let reversed = pixels.iter().map(|[b, g, r]| [*r, *g, *b]);
                lumas.zip(reversed).for_each(|(y, rgb)| *y = T::luma(rgb));
            }
        }
    }

    /// Adds sums of columns to those of red, green and blue.
    fn add(&self, columns: &[u32], [red, green, blue]: &mut [u64; 3]) {
        let (pixels, _) = columns.as_chunks::<3>();
        match self.pixel {
            RawPixel::Gray => {
                let total = columns.iter().copied().map(u64::from).sum::<u64>();
                for sum in [red, green, blue] {
                    *sum += total;
                }
            }
            RawPixel::Rgb | RawPixel::Bgr => {
                let sum =
                    |channel: usize| pixels.iter().map(|p| u64::from(p[channel])).sum::<u64>();
                let (first, last) = match self.pixel {
                    RawPixel::Bgr => (2, 0),
                    _ => (0, 2),
                };
                *red += sum(first);
                *green += sum(1);
                *blue += sum(last);
            }
        }
    }

    /// The samples of a row between two columns.
    fn row<'b, T>(&self, samples: &'b [T], v: usize, left: usize, width: usize) -> &'b [T] {
        let channels = self.pixel.channels();
        &samples[(v * self.width + left) * channels..][..width * channels]
    }
}

/// The sums of the three channels over pixels in colors.
#[inline]
fn totals<T: RawSample>(pixels: &[T]) -> [u32; 3] {
    let mut totals = [0u32; 3];
    for pixel in pixels.chunks_exact(3) {
        for (total, &sample) in totals.iter_mut().zip(pixel) {
            *total += sample.into();
        }
    }
    totals
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

    /// The luma of red, green and blue.
    fn luma(color: [Self; 3]) -> f32 {
        luma(color.map(Self::unit))
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

    /// Of cells that are summed many at once, of a part that ends within, and of one that is wider than what is summed at once.
    #[test]
    fn lumas_of_cells_are_those_of_their_mean_color() {
        let sample = |k: usize| ((k * k * 7 + k * 13) % 251) as u8;
        for (width, height, level) in [(1030, 9, 1), (1030, 9, 3), (1100, 1100, 10)] {
            for pixel in RawPixel::ALL {
                let channels = pixel.channels();
                let bytes: Vec<u8> = (0..width * height * channels).map(sample).collect();
                let words: Vec<u16> = bytes.iter().map(|b| 257 * u16::from(*b)).collect();
                let side = 1 << level;
                let count = (width - 3) / side;
                let [of_bytes, of_words] = [
                    RawImage::new(width, height, pixel, &bytes),
                    RawImage::new(width, height, pixel, &words),
                ]
                .map(|image| {
                    let mut lumas = vec![0.0; count];
                    image.expect("an image").cell_row(1, 3, level, &mut lumas);
                    lumas
                });
                assert_eq!(of_bytes, of_words);
                for (k, y) in of_bytes.iter().enumerate() {
                    let mean = |channel: usize| {
                        let of = |v: usize, u: usize| bytes[(v * width + u) * channels + channel];
                        let left = 3 + k * side;
                        let rows = 1..1 + side;
                        let all = rows.flat_map(|v| (left..left + side).map(move |u| (v, u)));
                        let total: f64 = all.map(|(v, u)| f64::from(of(v, u))).sum();
                        (total / (side * side) as f64 / 255.0) as f32
                    };
                    let expected = match pixel {
                        RawPixel::Gray => mean(0),
                        RawPixel::Rgb => luma([mean(0), mean(1), mean(2)]),
                        RawPixel::Bgr => luma([mean(2), mean(1), mean(0)]),
                    };
                    assert!((y - expected).abs() < 1e-6, "{pixel:?} {level} {k}");
                }
            }
        }
    }

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
