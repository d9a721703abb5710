//! Image compression: JPEG, and the blocks of video codecs.
//!
//! Video codecs keep color at half the resolution and quantize the cosine transform of blocks. Here
//! each block of 8 x 8 is coded alone, with the flat quantizer step of H.264, `2^((QP - 4) / 6)` in
//! steps of 8 bits (ITU-T H.264, 8.5.12), which shows the same blocks, ringing and lost detail as a
//! codec's intra frames; motion compensation is not modeled.

use std::f32::consts::PI;

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::image::RgbImage;

/// Side of a block.
const SIDE: usize = 8;
/// Added before a coefficient is cut to a whole number of steps; below 1/2, as encoders have it,
/// small ones vanish.
const ROUNDING: f32 = 1.0 / 3.0;

/// How an image is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Compression {
    /// Not at all.
    None,
    /// JPEG.
    Jpeg {
        /// Quality, 1 to 100.
        quality: u8,
        /// Whether color is kept at half the resolution.
        half_color: bool,
    },
    /// A video's blocks.
    Video {
        /// Quantizer, 0 to 51.
        qp: f32,
    },
}

impl Compression {
    /// To the compressed form and back.
    ///
    /// # Errors
    /// [`Error::Internal`] where the JPEG library fails.
    pub fn apply(self, image: RgbImage) -> Result<RgbImage> {
        match self {
            Self::None => Ok(image),
            Self::Jpeg {
                quality,
                half_color: false,
            } => jpeg(&image, quality),
            Self::Jpeg { quality, .. } => jpeg(&Planes::split(&image).join()?, quality),
            Self::Video { qp } => {
                let step = ((qp - 4.0) / 6.0).exp2() / 255.0;
                let mut planes = Planes::split(&image);
                for plane in &mut planes.planes {
                    plane.quantize(step);
                }
                planes.join()
            }
        }
    }
}

fn jpeg(image: &RgbImage, quality: u8) -> Result<RgbImage> {
    let internal = |e: image::ImageError| Error::Internal(format!("JPEG: {e}"));
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode(
            &image.to_bytes(),
            image.width() as u32,
            image.height() as u32,
            ExtendedColorType::Rgb8,
        )
        .map_err(internal)?;
    let decoded = image::load_from_memory_with_format(&bytes, ImageFormat::Jpeg)
        .map_err(internal)?
        .to_rgb32f();
    let values = decoded.pixels().map(|p| p.0).collect();
    RgbImage::new(image.width(), image.height(), values)
}

/// Brightness at full resolution, two color differences at half (BT.601, as JPEG and most cameras
/// have it).
struct Planes {
    size: [usize; 2],
    planes: [ColorPlane; 3],
}

struct ColorPlane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Planes {
    fn split(image: &RgbImage) -> Self {
        let (width, height) = (image.width(), image.height());
        let half = [width.div_ceil(2), height.div_ceil(2)];
        let gray = |c: &[f32; 3]| 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2];
        let luma = image.values().iter().map(gray).collect();
        let color = |channel: usize, scale: f32| {
            let mut values = Vec::with_capacity(half[0] * half[1]);
            for v in 0..half[1] {
                for u in 0..half[0] {
                    let mut sum = 0.0;
                    for (du, dv) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let (x, y) = ((2 * u + du).min(width - 1), (2 * v + dv).min(height - 1));
                        let c = &image.values()[y * width + x];
                        sum += (c[channel] - gray(c)) * scale;
                    }
                    values.push(0.25 * sum);
                }
            }
            ColorPlane {
                width: half[0],
                height: half[1],
                values,
            }
        };
        Self {
            size: [width, height],
            planes: [
                ColorPlane {
                    width,
                    height,
                    values: luma,
                },
                color(2, 0.564),
                color(0, 0.713),
            ],
        }
    }

    /// The image, in eight bits.
    fn join(&self) -> Result<RgbImage> {
        let [width, height] = self.size;
        let [luma, blue, red] = &self.planes;
        let values = (0..width * height)
            .map(|i| {
                let half = (i / width / 2) * blue.width + (i % width) / 2;
                let (y, b, r) = (
                    luma.values[i],
                    blue.values[half] / 0.564,
                    red.values[half] / 0.713,
                );
                let green = -(0.299 * r + 0.114 * b) / 0.587;
                [y + r, y + green, y + b].map(|c| (255.0 * c.clamp(0.0, 1.0)).round() / 255.0)
            })
            .collect();
        RgbImage::new(width, height, values)
    }
}

impl ColorPlane {
    /// Rounds the cosine transform of each block to steps; the border is repeated to whole blocks.
    fn quantize(&mut self, step: f32) {
        let basis = basis();
        for top in (0..self.height).step_by(SIDE) {
            for left in (0..self.width).step_by(SIDE) {
                let mut block = [[0.0f32; SIDE]; SIDE];
                for (j, row) in block.iter_mut().enumerate() {
                    let y = (top + j).min(self.height - 1);
                    for (i, value) in row.iter_mut().enumerate() {
                        *value = self.values[y * self.width + (left + i).min(self.width - 1)];
                    }
                }
                let mut steps = transform(&block, &basis, false);
                for value in steps.iter_mut().flatten() {
                    let count = (value.abs() / step + ROUNDING).floor();
                    *value = count.copysign(*value) * step;
                }
                let block = transform(&steps, &basis, true);
                for (j, row) in block.iter().enumerate().take(self.height - top) {
                    let start = (top + j) * self.width + left;
                    let count = SIDE.min(self.width - left);
                    self.values[start..start + count].copy_from_slice(&row[..count]);
                }
            }
        }
    }
}

/// The orthonormal cosine basis, a frequency a row.
fn basis() -> [[f32; SIDE]; SIDE] {
    std::array::from_fn(|k| {
        let scale = if k == 0 { 0.125f32 } else { 0.25 }.sqrt();
        std::array::from_fn(|i| scale * (PI * (i as f32 + 0.5) * k as f32 / SIDE as f32).cos())
    })
}

/// Along rows and columns; `back` leads from frequencies to values.
fn transform(
    block: &[[f32; SIDE]; SIDE],
    basis: &[[f32; SIDE]; SIDE],
    back: bool,
) -> [[f32; SIDE]; SIDE] {
    let entry = |k: usize, i: usize| if back { basis[i][k] } else { basis[k][i] };
    let along: [[f32; SIDE]; SIDE] = std::array::from_fn(|j| {
        std::array::from_fn(|k| (0..SIDE).map(|i| entry(k, i) * block[j][i]).sum())
    });
    std::array::from_fn(|k| {
        std::array::from_fn(|i| (0..SIDE).map(|j| entry(k, j) * along[j][i]).sum())
    })
}
