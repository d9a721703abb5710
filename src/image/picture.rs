//! Images that own their memory: 8 bits a channel where the file has no more, a quarter of what the
//! estimator works on.

use std::borrow::Cow;
use std::io::{Cursor, Read};
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageReader};

use super::animation::{is_animation, is_stream};
use super::{GrayImage, ImageView, RawImage, RawPixel, RgbImage};
use crate::error::{Error, Result};
use crate::files;

/// Maximum number of pixels of a picture by default: more than any camera's but a few phones'.
pub const DEFAULT_MAX_PIXELS: u64 = 64_000_000;

/// An image that owns its memory.
#[derive(Debug, Clone)]
pub enum Picture {
    /// 8 bits a channel.
    Bytes {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// What the samples of a pixel mean.
        pixel: RawPixel,
        /// Row after row from the top, without gaps.
        values: Vec<u8>,
    },
    /// More than 8 bits, gray.
    Gray(GrayImage),
    /// More than 8 bits, or transparent.
    Color(RgbImage),
}

impl Default for Picture {
    /// A picture without pixels.
    fn default() -> Self {
        Self::Gray(GrayImage::default())
    }
}

/// Bytes that are read first; most files say their size within them.
const START: u64 = 1 << 16;
/// Maximum number of bytes of a pixel in a file: four channels of 32 bits.
const MAX_PIXEL_BYTES: u64 = 16;
/// Maximum number of bytes beside the pixels: profiles, previews, the camera's notes.
pub(crate) const MAX_HEAD: u64 = 32 << 20;

/// Maximum number of bytes of a file with so many pixels.
pub(crate) fn max_bytes(pixels: u64) -> u64 {
    MAX_PIXEL_BYTES
        .saturating_mul(pixels)
        .saturating_add(MAX_HEAD)
}

/// The number of pixels that the start of a file states; `None` where it does not reach so far.
fn stated_pixels(start: &[u8]) -> Option<u64> {
    let reader = ImageReader::new(Cursor::new(start)).with_guessed_format();
    let (width, height) = reader.ok()?.into_decoder().ok()?.dimensions();
    Some(u64::from(width) * u64::from(height))
}

/// Where a file's size stands at the latest, as its start says: a TIFF may have its pixels first.
fn size_stands_within(start: &[u8]) -> u64 {
    let directory = match start {
        [b'I', b'I', b'*', 0, rest @ ..] => rest.first_chunk().map(|b| u32::from_le_bytes(*b)),
        [b'M', b'M', 0, b'*', rest @ ..] => rest.first_chunk().map(|b| u32::from_be_bytes(*b)),
        _ => None,
    };
    MAX_HEAD + u64::from(directory.unwrap_or(0))
}

fn no_image(path: &Path) -> Error {
    let problem = "expected a PNG, JPEG, BMP, TIFF, PNM, GIF or WebP file, found none of them";
    Error::input(path, "image", problem)
}

/// What a decoder says, on one line: some explain themselves in several.
pub(super) fn broken(path: &Path, error: &image::ImageError) -> Error {
    let words = error.to_string();
    let line: Vec<&str> = words.split_whitespace().collect();
    let problem = format!("cannot be decoded: {}", files::csv::shown(&line.join(" ")));
    Error::input(path, "image", problem)
}

/// Rejects a picture of more than `max_pixels` pixels.
pub(super) fn check_pixels(
    path: &Path,
    (width, height): (u32, u32),
    max_pixels: u64,
) -> Result<()> {
    if u64::from(width) * u64::from(height) <= max_pixels {
        return Ok(());
    }
    let problem = format!(
        "expected at most {max_pixels} pixels, found {width} x {height} (--config max_pixels=N allows more)"
    );
    Err(Error::input(path, "image", problem))
}

impl Picture {
    /// Reads a PNG, JPEG, BMP, TIFF, PNM, GIF or WebP file of any depth, by its content and not its name.
    ///
    /// # Errors
    /// [`Error::Read`] where the file cannot be read, [`Error::Input`] where it is no image that
    /// can be decoded, or one of more than `max_pixels` pixels.
    pub fn read(path: &Path, max_pixels: u64) -> Result<Self> {
        let mut input = files::open(path)?;
        let (mut bytes, mut wanted) = (Vec::new(), START);
        // A file that is no image, or without an end, is read no further than its own start allows.
        loop {
            let more = wanted - bytes.len() as u64;
            files::read_rest(path, (&mut input).take(more), more, &mut bytes)?;
            if image::guess_format(&bytes).is_err() {
                return Err(no_image(path));
            }
            if (bytes.len() as u64) < wanted {
                break;
            }
            let most = size_stands_within(&bytes).min(max_bytes(max_pixels));
            match stated_pixels(&bytes) {
                Some(pixels) if pixels > max_pixels => break,
                Some(pixels) => {
                    files::read_rest(path, input, max_bytes(pixels), &mut bytes)?;
                    break;
                }
                None if wanted >= most => {
                    let problem =
                        format!("expected its size in the first {most} bytes, found none");
                    return Err(Error::input(path, "image", problem));
                }
                None => wanted = most.min(4 * wanted),
            }
        }
        Self::decode(path, &bytes, max_pixels)
    }

    /// Decodes the bytes of an image file; `path` is for messages only.
    ///
    /// # Errors
    /// [`Error::Input`] as in [`Picture::read`].
    pub fn decode(path: &Path, bytes: &[u8], max_pixels: u64) -> Result<Self> {
        let reader = ImageReader::new(Cursor::new(bytes))
            .with_guessed_format()
            .map_err(|e| Error::input(path, "image", e.to_string()))?;
        if reader.format().is_none() {
            return Err(no_image(path));
        }
        if is_animation(bytes) {
            let problem = "expected one picture, found an animation";
            return Err(Error::input(path, "image", problem));
        }
        if is_stream(bytes) {
            let problem = "expected one picture, found several, one behind the other: split it into files, or end its name in .mjpeg if they are JPEG";
            return Err(Error::input(path, "image", problem));
        }
        let broken = |e: image::ImageError| broken(path, &e);
        let mut decoder = reader.into_decoder().map_err(broken)?;
        check_pixels(path, decoder.dimensions(), max_pixels)?;
        let orientation = decoder.orientation().map_err(broken)?;
        let mut decoded = DynamicImage::from_decoder(decoder).map_err(broken)?;
        decoded.apply_orientation(orientation);
        Self::of_decoded(path, decoded)
    }

    /// A picture that is decoded.
    pub(super) fn of_decoded(path: &Path, decoded: DynamicImage) -> Result<Self> {
        let size = [decoded.width() as usize, decoded.height() as usize];
        match decoded {
            DynamicImage::ImageRgb8(image) => Self::of(size, RawPixel::Rgb, image.into_raw()),
            DynamicImage::ImageLuma8(image) => Self::of(size, RawPixel::Gray, image.into_raw()),
            // Nothing of it is transparent, as nearly always.
            DynamicImage::ImageRgba8(image) if image.pixels().all(|p| p.0[3] == u8::MAX) => {
                let colors = image.pixels().flat_map(|p| [p.0[0], p.0[1], p.0[2]]);
                Self::of(size, RawPixel::Rgb, colors.collect())
            }
            deep => deep_image(&deep).map(Self::Color),
        }
        .map_err(|e| Error::input(path, "image", e.to_string()))
    }

    fn of([width, height]: [usize; 2], pixel: RawPixel, values: Vec<u8>) -> Result<Self> {
        RawImage::new(width, height, pixel, &values)?;
        Ok(Self::Bytes {
            width,
            height,
            pixel,
            values,
        })
    }

    /// The image.
    ///
    /// # Errors
    /// [`Error::Argument`] where there are not as many bytes as the pixels have, or none.
    pub fn view(&self) -> Result<ImageView<'_>> {
        match self {
            Self::Bytes {
                width,
                height,
                pixel,
                values,
            } => RawImage::new(*width, *height, *pixel, values).map(ImageView::Raw),
            Self::Gray(image) => Ok(ImageView::Gray(image)),
            Self::Color(image) => Ok(ImageView::Color(image)),
        }
    }

    /// The memory that its pixels take.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Bytes { values, .. } => values.len(),
            Self::Gray(image) => size_of_val(image.values()),
            Self::Color(image) => size_of_val(image.values()),
        }
    }

    /// The colors; where it has none, its gray thrice.
    ///
    /// # Errors
    /// As [`Picture::view`].
    pub fn to_rgb(&self) -> Result<Cow<'_, RgbImage>> {
        Ok(match self.view()? {
            ImageView::Raw(image) => Cow::Owned(image.to_rgb()),
            ImageView::Gray(image) => {
                let colors = image.values().iter().map(|gray| [*gray; 3]);
                Cow::Owned(RgbImage::new(
                    image.width(),
                    image.height(),
                    colors.collect(),
                )?)
            }
            ImageView::Color(image) => Cow::Borrowed(image),
        })
    }

    /// The picture with bright and dark exchanged: of a dark ball with bright dots, a bright one with dark dots.
    ///
    /// # Errors
    /// [`Error::Internal`] where a picture lacks colors.
    pub fn negative(mut self) -> Result<Self> {
        match &mut self {
            Self::Bytes { values, .. } => {
                values.iter_mut().for_each(|value| *value = !*value);
                Ok(self)
            }
            Self::Gray(image) => {
                let values = image.values().iter().map(|gray| 1.0 - gray);
                GrayImage::new(image.width(), image.height(), values.collect()).map(Self::Gray)
            }
            Self::Color(image) => {
                let values = image.values().iter().map(|color| color.map(|c| 1.0 - c));
                RgbImage::new(image.width(), image.height(), values.collect()).map(Self::Color)
            }
        }
    }

    /// The picture as a mirror shows it: left and right exchanged.
    ///
    /// # Errors
    /// [`Error::Internal`] where a picture lacks colors.
    pub fn mirrored(mut self) -> Result<Self> {
        match &mut self {
            Self::Bytes {
                width,
                pixel,
                values,
                ..
            } => {
                let bytes = pixel.channels();
                for row in values.chunks_exact_mut((bytes * *width).max(1)) {
                    for (left, right) in (0..*width / 2).map(|u| (u, *width - 1 - u)) {
                        (0..bytes).for_each(|c| row.swap(bytes * left + c, bytes * right + c));
                    }
                }
                Ok(self)
            }
            Self::Gray(image) => {
                let values = reversed(image.values(), image.width());
                GrayImage::new(image.width(), image.height(), values).map(Self::Gray)
            }
            Self::Color(image) => {
                let values = reversed(image.values(), image.width());
                RgbImage::new(image.width(), image.height(), values).map(Self::Color)
            }
        }
    }
}

/// Rows from right to left.
fn reversed<T: Copy>(values: &[T], width: usize) -> Vec<T> {
    let rows = values.chunks_exact(width.max(1));
    rows.flat_map(|row| row.iter().rev().copied()).collect()
}

/// Colors of any depth; transparent ones lie on black.
fn deep_image(decoded: &DynamicImage) -> Result<RgbImage> {
    let pixels = decoded.to_rgba32f();
    let (width, height) = (pixels.width() as usize, pixels.height() as usize);
    let color = |p: &image::Rgba<f32>| {
        let [r, g, b, alpha] = p.0;
        [r, g, b].map(|c| (c * alpha).clamp(0.0, 1.0))
    };
    RgbImage::new(width, height, pixels.pixels().map(color).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn picture() -> Picture {
        let values = (0..18).map(|x| x * 10).collect();
        Picture::of([3, 2], RawPixel::Rgb, values).unwrap()
    }

    #[test]
    fn bytes_and_colors_agree() {
        let rgb = picture().to_rgb().unwrap().into_owned();
        assert_eq!(rgb.values()[1], [30.0, 40.0, 50.0].map(|x| x / 255.0));
        let deep = Picture::Color(rgb).mirrored().unwrap();
        let bytes = picture().mirrored().unwrap();
        assert_eq!(deep.to_rgb().unwrap(), bytes.to_rgb().unwrap());
        let values = bytes.to_rgb().unwrap().values().to_vec();
        assert_eq!(values[0], [60.0, 70.0, 80.0].map(|x| x / 255.0));
    }

    #[test]
    fn gray_of_any_depth_agrees() {
        let bytes = Picture::of([3, 2], RawPixel::Gray, (0..6).map(|x| x * 51).collect()).unwrap();
        let values = (0..6u8).map(|x| f32::from(x * 51) / 255.0).collect();
        let deep = Picture::Gray(GrayImage::new(3, 2, values).unwrap());
        assert_eq!(bytes.to_rgb().unwrap(), deep.to_rgb().unwrap());
        let (bytes, deep) = (bytes.mirrored().unwrap(), deep.mirrored().unwrap());
        assert_eq!(bytes.to_rgb().unwrap(), deep.to_rgb().unwrap());
    }

    #[test]
    fn a_file_is_read_as_the_estimator_reads_it() {
        let rgb = picture().to_rgb().unwrap().into_owned();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        rgb.write_png(&path).unwrap();
        let read = Picture::read(&path, 6).unwrap();
        assert!(matches!(read, Picture::Bytes { .. }));
        assert_eq!(*read.to_rgb().unwrap(), RgbImage::read(&path).unwrap());
        let error = Picture::read(&path, 5).unwrap_err().to_string();
        assert!(error.contains("at most 5 pixels, found 3 x 2"), "{error}");
    }
}
