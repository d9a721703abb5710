//! Pictures as they wait to be estimated: 8 bits a color where the file has no more, a quarter of
//! what the estimator works on.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageReader};

use super::image::RgbImage;
use super::raw::{RawImage, RawPixel};
use crate::error::{Error, Result};
use crate::files;

/// Maximum number of pixels of a picture by default: more than any camera's but a few phones'.
pub const DEFAULT_MAX_PIXELS: u64 = 64_000_000;

/// A picture.
#[derive(Debug, Clone)]
pub enum Picture {
    /// 8 bits a color.
    Bytes(RgbBytes),
    /// More, or transparent.
    Deep(RgbImage),
}

/// A picture of 8 bits a color: red, green, blue, row after row from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbBytes {
    width: usize,
    height: usize,
    values: Vec<u8>,
}

impl RgbBytes {
    /// A picture of the given bytes.
    ///
    /// # Errors
    /// [`Error::Argument`] where there are not `3 width height` bytes, or none.
    pub fn new(width: usize, height: usize, values: Vec<u8>) -> Result<Self> {
        let expected = width.checked_mul(height).and_then(|n| n.checked_mul(3));
        if width == 0 || height == 0 || Some(values.len()) != expected {
            let problem = format!(
                "expected 3 x {width} x {height} bytes, at least one color, found {}",
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
}

/// Bytes that show the format of a file.
const START: u64 = 64;
/// Maximum number of bytes of a pixel in a file: four channels of 32 bits.
const MAX_PIXEL_BYTES: u64 = 16;
/// Maximum number of bytes beside the pixels: profiles, previews, the camera's notes.
const MAX_HEAD: u64 = 64 << 20;

fn no_image(path: &Path) -> Error {
    let problem = "expected a PNG, JPEG, BMP, TIFF or PNM file, found none of them";
    Error::input(path, "image", problem)
}

impl Picture {
    /// Reads a PNG, JPEG, BMP, TIFF or PNM file of any depth, by its content and not its name.
    ///
    /// # Errors
    /// [`Error::Read`] where the file cannot be read, [`Error::Input`] where it is no image that
    /// can be decoded, or one of more than `max_pixels` pixels.
    pub fn read(path: &Path, max_pixels: u64) -> Result<Self> {
        let mut input = files::open(path)?;
        let mut bytes = Vec::new();
        files::read_rest(path, (&mut input).take(START), START, &mut bytes)?;
        // What is no image at all is not read to its end.
        if image::guess_format(&bytes).is_err() {
            return Err(no_image(path));
        }
        let most = MAX_PIXEL_BYTES
            .saturating_mul(max_pixels)
            .saturating_add(MAX_HEAD);
        files::read_rest(path, input, most, &mut bytes)?;
        Self::decode(path, &bytes, max_pixels)
    }

    /// Decodes the bytes of an image file; `path` is for messages only.
    ///
    /// # Errors
    /// [`Error::Input`] as in [`Picture::read`].
    pub fn decode(path: &Path, bytes: &[u8], max_pixels: u64) -> Result<Self> {
        let reject = |problem: String| Error::input(path, "image", problem);
        let reader = ImageReader::new(std::io::Cursor::new(bytes))
            .with_guessed_format()
            .map_err(|e| reject(e.to_string()))?;
        if reader.format().is_none() {
            return Err(no_image(path));
        }
        // Some decoders explain themselves in several lines.
        let broken = |e: image::ImageError| {
            let words = e.to_string();
            let line: Vec<&str> = words.split_whitespace().collect();
            reject(format!("cannot be decoded: {}", line.join(" ")))
        };
        let mut decoder = reader.into_decoder().map_err(broken)?;
        let (width, height) = decoder.dimensions();
        if u64::from(width) * u64::from(height) > max_pixels {
            let problem = format!(
                "expected at most {max_pixels} pixels, found {width} x {height} (--max-pixels allows more)"
            );
            return Err(reject(problem));
        }
        let orientation = decoder.orientation().map_err(broken)?;
        let mut decoded = DynamicImage::from_decoder(decoder).map_err(broken)?;
        decoded.apply_orientation(orientation);
        let size = [decoded.width() as usize, decoded.height() as usize];
        match decoded {
            DynamicImage::ImageRgb8(image) => Self::of_bytes(size, image.into_raw()),
            DynamicImage::ImageLuma8(image) => {
                let values = image.into_raw().into_iter().flat_map(|l| [l; 3]);
                Self::of_bytes(size, values.collect())
            }
            deep => deep_image(&deep).map(Self::Deep),
        }
        .map_err(|e| reject(e.to_string()))
    }

    fn of_bytes([width, height]: [usize; 2], values: Vec<u8>) -> Result<Self> {
        RgbBytes::new(width, height, values).map(Self::Bytes)
    }

    /// Columns.
    pub fn width(&self) -> usize {
        match self {
            Self::Bytes(bytes) => bytes.width,
            Self::Deep(image) => image.width(),
        }
    }

    /// Rows.
    pub fn height(&self) -> usize {
        match self {
            Self::Bytes(bytes) => bytes.height,
            Self::Deep(image) => image.height(),
        }
    }

    /// The bytes, where the picture has no more than 8 bits a color.
    pub fn bytes(&self) -> Option<RawImage<'_>> {
        match self {
            Self::Bytes(b) => RawImage::new(b.width, b.height, RawPixel::Rgb, &b.values).ok(),
            Self::Deep(_) => None,
        }
    }

    /// The colors, as the estimator takes them.
    ///
    /// # Errors
    /// [`Error::Internal`] where a picture lacks colors.
    pub fn to_rgb(&self) -> Result<Cow<'_, RgbImage>> {
        match self {
            Self::Deep(image) => Ok(Cow::Borrowed(image)),
            Self::Bytes(bytes) => {
                let colors = bytes.values.chunks_exact(3);
                let colors = colors.map(|c| [c[0], c[1], c[2]].map(|x| f32::from(x) / 255.0));
                RgbImage::new(bytes.width, bytes.height, colors.collect()).map(Cow::Owned)
            }
        }
    }

    /// The picture as a mirror shows it: left and right exchanged.
    ///
    /// # Errors
    /// [`Error::Internal`] where a picture lacks colors.
    pub fn mirrored(mut self) -> Result<Self> {
        match &mut self {
            Self::Bytes(bytes) => {
                for row in bytes.values.chunks_exact_mut(3 * bytes.width) {
                    for (left, right) in (0..bytes.width / 2).map(|u| (u, bytes.width - 1 - u)) {
                        (0..3).for_each(|c| row.swap(3 * left + c, 3 * right + c));
                    }
                }
                Ok(self)
            }
            Self::Deep(image) => {
                let rows = image.values().chunks_exact(image.width());
                let values = rows.flat_map(|row| row.iter().rev().copied()).collect();
                RgbImage::new(image.width(), image.height(), values).map(Self::Deep)
            }
        }
    }
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
        Picture::Bytes(RgbBytes::new(3, 2, values).unwrap())
    }

    #[test]
    fn bytes_and_colors_agree() {
        let rgb = picture().to_rgb().unwrap().into_owned();
        assert_eq!(rgb.values()[1], [30.0, 40.0, 50.0].map(|x| x / 255.0));
        assert_eq!(picture().bytes().unwrap().to_rgb(), rgb);
        let deep = Picture::Deep(rgb).mirrored().unwrap();
        let bytes = picture().mirrored().unwrap();
        assert_eq!(deep.to_rgb().unwrap(), bytes.to_rgb().unwrap());
        let values = bytes.to_rgb().unwrap().values().to_vec();
        assert_eq!(values[0], [60.0, 70.0, 80.0].map(|x| x / 255.0));
    }

    #[test]
    fn a_file_is_read_as_the_estimator_reads_it() {
        let rgb = picture().to_rgb().unwrap().into_owned();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        rgb.write_png(&path).unwrap();
        let read = Picture::read(&path, 6).unwrap();
        assert!(matches!(read, Picture::Bytes(_)));
        assert_eq!(*read.to_rgb().unwrap(), RgbImage::read(&path).unwrap());
        let error = Picture::read(&path, 5).unwrap_err().to_string();
        assert!(error.contains("at most 5 pixels, found 3 x 2"), "{error}");
    }
}
