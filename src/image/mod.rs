//! Images in memory: reading, decoding and writing them.
//!
//! Gray is the luma of ITU-R BT.709, `0.2126 R + 0.7152 G + 0.0722 B`, of the values as stored
//! (without undoing the gamma curve: the detector is trained on what cameras store). Transparent
//! pixels are laid on black.
//!
//! Four shapes: [`GrayImage`] and [`RgbImage`] have values in [0, 1]; [`RawImage`] is a view of a camera's
//! samples; [`Picture`] owns what was read, and [`ImageView`] is any of them.

pub(crate) mod animation;
pub(crate) mod picture;
mod raw;
mod roi;
mod view;

use std::path::Path;

use ::image::{ImageFormat, imageops};
use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x8};

pub use picture::{DEFAULT_MAX_PIXELS, Picture};
pub use raw::{RawImage, RawPixel, RawSamples};
pub use roi::Roi;
pub use view::ImageView;

use crate::error::{Error, Result};
use crate::files;

/// The middle and the corners of an image: distances from its center, in sides.
const MIDDLE: f32 = 0.3;
const CORNERS: f32 = 0.58;
/// Minimum distance of their mean colors.
const MIN_CONTRAST: f32 = 0.02;
/// Weights of red, green and blue in gray.
const LUMA: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// A gray image with values in [0, 1], row after row from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GrayImage {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl GrayImage {
    /// An image of the given values, row after row.
    ///
    /// # Errors
    /// [`Error::Argument`] where there are not `width * height` values, or none.
    pub fn new(width: usize, height: usize, values: Vec<f32>) -> Result<Self> {
        if width == 0 || height == 0 || values.len() != width * height {
            let problem = format!(
                "expected {width} x {height} values, at least one, found {}",
                values.len()
            );
            return Err(Error::argument("image", problem));
        }
        Ok(Self {
            width,
            height,
            values,
        })
    }

    /// The image whose pixel in column `u` and row `v` is `value(u, v)`.
    pub fn from_fn(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Self {
        let values = (0..width * height)
            .map(|i| value(i % width, i / width))
            .collect();
        Self {
            width,
            height,
            values,
        }
    }

    /// As [`GrayImage::from_fn`], into the memory at hand: how frames that arrive in another memory
    /// layout enter without a copy in between.
    pub fn fill_with(&mut self, width: usize, height: usize, value: impl Fn(usize, usize) -> f32) {
        (self.width, self.height) = (width, height);
        self.values.clear();
        self.values
            .extend((0..width * height).map(|i| value(i % width, i / width)));
    }

    /// As [`GrayImage::fill_with`], a row at a time: `row(v, values)` appends the values of the row `v`.
    pub(crate) fn fill_rows(
        &mut self,
        width: usize,
        height: usize,
        mut row: impl FnMut(usize, &mut Vec<f32>),
    ) {
        (self.width, self.height) = (width, height);
        self.values.clear();
        self.values.reserve(width * height);
        (0..height).for_each(|v| row(v, &mut self.values));
    }

    /// The values of a row between two columns.
    pub(crate) fn row(&self, v: usize, left: usize, width: usize) -> &[f32] {
        &self.values[v * self.width + left..][..width]
    }

    /// Makes room for as many pixels.
    pub(crate) fn reserve(&mut self, pixels: usize) {
        self.values
            .reserve(pixels.saturating_sub(self.values.len()));
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All values, row after row.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The value in column `u` and row `v`, of the nearest pixel where that lies outside.
    pub fn at(&self, u: isize, v: isize) -> f32 {
        let u = u.clamp(0, self.width as isize - 1) as usize;
        let v = v.clamp(0, self.height as isize - 1) as usize;
        self.values[v * self.width + u]
    }

    /// The median of 5 x 5 values about each value; the border repeats. Lines less than three values wide vanish.
    pub(crate) fn median_into(&self, out: &mut Self) {
        let level = Level::new();
        out.fill_rows(self.width, self.height, |v, values| {
            let rows: [&[f32]; 5] = std::array::from_fn(|k| {
                let row = (v + k).saturating_sub(2).min(self.height - 1);
                self.row(row, 0, self.width)
            });
            dispatch!(level, simd => simd.vectorize(
                #[inline(always)]
                || median_row(simd, rows, values)
            ));
        });
    }

    /// Half as large along both sides, each value the mean of four, written into `out`, whose
    /// memory is reused. The pixel (u, v) of `out` has its center at (2 u + 0.5, 2 v + 0.5) of this
    /// image.
    pub fn halve_into(&self, out: &mut Self) {
        (out.width, out.height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        out.values.clear();
        for v in 0..out.height {
            let upper = &self.values[2 * v * self.width..][..self.width];
            let lower = &self.values[(2 * v + 1).min(self.height - 1) * self.width..][..self.width];
            let (uppers, last_upper) = upper.as_chunks::<2>();
            let (lowers, last_lower) = lower.as_chunks::<2>();
            let both = uppers.iter().zip(lowers);
            let means = both.map(|(a, b)| 0.25 * (a[0] + a[1] + b[0] + b[1]));
            out.values.extend(means);
            // A last column stands for its neighbor, too.
            if let (&[a], &[b]) = (last_upper, last_lower) {
                out.values.push(0.25 * (a + a + b + b));
            }
        }
    }

    /// The value between pixels (bilinear); outside, that of the nearest border.
    #[inline]
    pub fn sample(&self, u: f64, v: f64) -> f32 {
        let u = u.clamp(0.0, (self.width - 1) as f64);
        let v = v.clamp(0.0, (self.height - 1) as f64);
        let (u0, v0) = (u as usize, v as usize);
        let (u1, v1) = ((u0 + 1).min(self.width - 1), (v0 + 1).min(self.height - 1));
        let (fu, fv) = ((u - u0 as f64) as f32, (v - v0 as f64) as f32);
        let row = |v: usize| {
            let row = &self.values[v * self.width..(v + 1) * self.width];
            row[u0] + fu * (row[u1] - row[u0])
        };
        let top = row(v0);
        top + fv * (row(v1) - top)
    }
}

/// Values whose medians are found at once.
const LANES: usize = 8;

/// The medians of the 25 values about each of the middle one of five rows; beyond an end stands its own value.
#[inline(always)]
fn median_row<S: Simd>(simd: S, rows: [&[f32]; 5], into: &mut Vec<f32>) {
    let width = rows[0].len();
    for left in (0..width).step_by(LANES) {
        let mut near = [f32x8::splat(simd, 0.0); 25];
        for (k, values) in near.iter_mut().enumerate() {
            let (row, shift) = (rows[k / 5], k % 5);
            let mut copied = [0.0; LANES];
            let inside = (left + shift).wrapping_sub(2);
            match row.get(inside..inside.wrapping_add(LANES)) {
                Some(inside) => copied.copy_from_slice(inside),
                None => {
                    for (lane, value) in copied.iter_mut().enumerate() {
                        *value = row[(left + lane + shift).saturating_sub(2).min(width - 1)];
                    }
                }
            }
            *values = f32x8::simd_from(simd, copied);
        }
        let medians: [f32; LANES] = medians(near).into();
        into.extend_from_slice(&medians[..LANES.min(width - left)]);
    }
}

/// The median of 25 values in each lane: of more than half of them neither the least nor the greatest is the median; these two are
/// dropped, another value is taken in, and so on.
#[inline(always)]
fn medians<S: Simd>(mut values: [f32x8<S>; 25]) -> f32x8<S> {
    // In hand are the values from `first` to the last of these.
    const LAST: usize = 13;
    for first in 0..LAST - 1 {
        for k in first + 1..=LAST {
            let (a, b) = (values[first], values[k]);
            (values[first], values[k]) = (a.min(b), a.max(b));
        }
        for k in first + 1..LAST {
            let (a, b) = (values[k], values[LAST]);
            (values[k], values[LAST]) = (a.min(b), a.max(b));
        }
        if let Some(next) = values.get(LAST + 1 + first) {
            values[LAST] = *next;
        }
    }
    values[LAST - 1]
}

/// Adds colors, and how many they are.
fn add_colors(sum: &mut [f32; 4], colors: &[[f32; 3]]) {
    for color in colors {
        (0..3).for_each(|c| sum[c] += color[c]);
    }
    sum[3] += colors.len() as f32;
}

/// The gray of a color (ITU-R BT.709).
pub fn luma([red, green, blue]: [f32; 3]) -> f32 {
    LUMA[0] * red + LUMA[1] * green + LUMA[2] * blue
}

/// A color image with values in [0, 1], row after row from the top, as a screen would show them
/// (sRGB).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RgbImage {
    width: usize,
    height: usize,
    values: Vec<[f32; 3]>,
}

impl RgbImage {
    /// An image of the given colors, row after row.
    ///
    /// # Errors
    /// [`Error::Argument`] where there are not `width * height` colors, or none.
    pub fn new(width: usize, height: usize, values: Vec<[f32; 3]>) -> Result<Self> {
        if width == 0 || height == 0 || values.len() != width * height {
            let problem = format!(
                "expected {width} x {height} colors, at least one, found {}",
                values.len()
            );
            return Err(Error::argument("image", problem));
        }
        Ok(Self {
            width,
            height,
            values,
        })
    }

    /// Gives the pixel in column `u` and row `v` the color `value(u, v)`, in the memory at hand.
    pub fn fill_with(
        &mut self,
        width: usize,
        height: usize,
        value: impl Fn(usize, usize) -> [f32; 3],
    ) {
        (self.width, self.height) = (width, height);
        self.values.clear();
        self.values
            .extend((0..width * height).map(|i| value(i % width, i / width)));
    }

    /// As [`RgbImage::fill_with`], a row at a time: `row(v, values)` appends the colors of the row `v`.
    pub(crate) fn fill_rows(
        &mut self,
        width: usize,
        height: usize,
        mut row: impl FnMut(usize, &mut Vec<[f32; 3]>),
    ) {
        (self.width, self.height) = (width, height);
        self.values.clear();
        self.values.reserve(width * height);
        (0..height).for_each(|v| row(v, &mut self.values));
    }

    /// The colors of a row between two columns.
    pub(crate) fn row(&self, v: usize, left: usize, width: usize) -> &[[f32; 3]] {
        &self.values[v * self.width + left..][..width]
    }

    /// Reads a PNG, JPEG, BMP, TIFF, PNM, GIF or WebP file of any depth, by its content and not its name.
    ///
    /// # Errors
    /// [`Error::Read`] where the file cannot be read, [`Error::Input`] where it is no image that
    /// can be decoded.
    pub fn read(path: &Path) -> Result<Self> {
        let picture = Picture::read(path, DEFAULT_MAX_PIXELS)?;
        Ok(picture.to_rgb()?.into_owned())
    }

    /// Decodes the bytes of an image file; `path` is for messages only.
    ///
    /// # Errors
    /// [`Error::Input`] where the bytes are no image that can be decoded.
    pub fn decode(path: &Path, bytes: &[u8]) -> Result<Self> {
        let picture = Picture::decode(path, bytes, DEFAULT_MAX_PIXELS)?;
        Ok(picture.to_rgb()?.into_owned())
    }

    /// Writes a PNG file atomically.
    ///
    /// # Errors
    /// [`Error::Write`] where the system refuses; [`Error::Internal`] where the image cannot be
    /// encoded.
    pub fn write_png(&self, path: &Path) -> Result<()> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        self.to_buffer()?
            .write_to(&mut bytes, ImageFormat::Png)
            .map_err(|e| Error::Internal(format!("an image cannot be encoded: {e}")))?;
        files::write_bytes(path, bytes.get_ref())
    }

    /// The image at another size (Catmull and Rom's spline).
    ///
    /// # Errors
    /// [`Error::Argument`] where the size is zero.
    pub fn resized(&self, width: usize, height: usize) -> Result<Self> {
        let (w, h) = (width as u32, height as u32);
        let resized = imageops::resize(&self.to_buffer()?, w, h, imageops::FilterType::CatmullRom);
        let values = resized.pixels().map(|p| p.0.map(|c| f32::from(c) / 255.0));
        Self::new(width, height, values.collect())
    }

    fn to_buffer(&self) -> Result<::image::RgbImage> {
        ::image::RgbImage::from_raw(self.width as u32, self.height as u32, self.to_bytes())
            .ok_or_else(|| Error::Internal("an image lacks pixels".into()))
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All colors, row after row.
    pub fn values(&self) -> &[[f32; 3]] {
        &self.values
    }

    /// The color between pixels (bilinear); outside, that of the nearest border.
    pub fn sample(&self, u: f64, v: f64) -> [f32; 3] {
        let u = u.clamp(0.0, (self.width - 1) as f64);
        let v = v.clamp(0.0, (self.height - 1) as f64);
        let (u0, v0) = (u as usize, v as usize);
        let (u1, v1) = ((u0 + 1).min(self.width - 1), (v0 + 1).min(self.height - 1));
        let (fu, fv) = ((u - u0 as f64) as f32, (v - v0 as f64) as f32);
        let at = |u: usize, v: usize| self.values[v * self.width + u];
        [0, 1, 2].map(|c| {
            let top = at(u0, v0)[c] + fu * (at(u1, v0)[c] - at(u0, v0)[c]);
            let low = at(u0, v1)[c] + fu * (at(u1, v1)[c] - at(u0, v1)[c]);
            top + fv * (low - top)
        })
    }

    /// The part of the image from column `left` and row `top`, cut where the image ends.
    ///
    /// # Errors
    /// [`Error::Argument`] where nothing is left.
    pub fn part(&self, left: usize, top: usize, width: usize, height: usize) -> Result<Self> {
        let width = width.min(self.width.saturating_sub(left));
        let height = height.min(self.height.saturating_sub(top));
        let rows = (top..top + height)
            .flat_map(|v| &self.values[v * self.width + left..][..width])
            .copied();
        Self::new(width, height, rows.collect())
    }

    /// The luma of every pixel.
    pub fn to_gray(&self) -> GrayImage {
        let mut gray = GrayImage::default();
        self.to_gray_into(&mut gray);
        gray
    }

    /// As [`RgbImage::to_gray`], into existing memory.
    pub fn to_gray_into(&self, gray: &mut GrayImage) {
        (gray.width, gray.height) = (self.width, self.height);
        gray.values.clear();
        gray.values.extend(self.values.iter().map(|c| luma(*c)));
    }

    /// Gray along the color in which the middle differs most plainly from the corners (their means'
    /// difference), from 0 to 1: a ball as bright as what is behind it, but of another color,
    /// stands out. Says whether there is such a color; where there is none, `gray` stays as it is.
    pub(crate) fn to_contrast_into(&self, gray: &mut GrayImage) -> bool {
        let (mut middle, mut corners) = ([0.0f32; 4], [0.0f32; 4]);
        for (v, row) in self.values.chunks_exact(self.width).enumerate() {
            let y = (v as f32 + 0.5) / self.height as f32 - 0.5;
            // The columns that are nearer to the middle than so much.
            let within = |radius: f32| {
                let half = (radius * radius - y * y).max(0.0).sqrt();
                let column = |x: f32| (x * self.width as f32 - 0.5).ceil().max(0.0) as usize;
                column(0.5 - half)..column(0.5 + half).min(self.width)
            };
            let (inner, outer) = (within(MIDDLE), within(CORNERS));
            add_colors(&mut middle, &row[inner]);
            add_colors(&mut corners, &row[..outer.start]);
            add_colors(&mut corners, &row[outer.end..]);
        }
        if middle[3] == 0.0 || corners[3] == 0.0 {
            return false;
        }
        let axis: [f32; 3] =
            std::array::from_fn(|k| middle[k] / middle[3] - corners[k] / corners[3]);
        let length = axis.iter().map(|x| x * x).sum::<f32>().sqrt();
        if length < MIN_CONTRAST {
            return false;
        }
        let along = |c: &[f32; 3]| (c[0] * axis[0] + c[1] * axis[1] + c[2] * axis[2]) / length;
        // Values along a unit vector span at most the cube's diagonal, either way.
        let values = self
            .values
            .iter()
            .map(|c| (0.5 + 0.5 * along(c)).clamp(0.0, 1.0));
        (gray.width, gray.height) = (self.width, self.height);
        gray.values.clear();
        gray.values.extend(values);
        true
    }

    /// Eight bits a channel, red, green, blue, row after row: what PNG encoders take.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.values
            .iter()
            .flat_map(|c| c.map(|x| (255.0 * x.clamp(0.0, 1.0) + 0.5) as u8))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_middle_of_25_sorted_values() {
        for (width, height) in [(1, 1), (7, 3), (8, 9), (21, 6)] {
            let image = GrayImage::from_fn(width, height, |u, v| {
                ((17 * u + 29 * v + u * u * v) % 23) as f32
            });
            let mut found = GrayImage::default();
            image.median_into(&mut found);
            for at in 0..width * height {
                let (u, v) = ((at % width) as isize, (at / width) as isize);
                let mut near: Vec<f32> = (0..25)
                    .map(|k| image.at(u + k % 5 - 2, v + k / 5 - 2))
                    .collect();
                near.sort_unstable_by(f32::total_cmp);
                assert_eq!(found.values()[at], near[12], "{width} x {height}, {u}, {v}");
            }
        }
    }
}
