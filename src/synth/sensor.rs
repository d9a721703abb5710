//! From light to the numbers in a file: lens blur, gain, noise, gamma, eight bits, compression.

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::scene::{SynthConfig, luma};
use crate::error::{Error, Result};
use crate::vision::image::RgbImage;

/// A camera's sensor and what comes after it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Standard deviation of the lens' blur, pixels.
    pub defocus_px: f64,
    /// Signal per light; a signal of 1 is full.
    pub gain: f32,
    /// Deviation of the noise in the dark, of full.
    pub read_noise: f32,
    /// Variance of the noise per signal.
    pub shot_noise: f32,
    /// Deviation of the color noise, which is coarser than a pixel.
    pub color_noise: f32,
    /// Values are the signal to the power `1 / gamma`.
    pub gamma: f32,
    /// Whether the camera sees colors.
    pub has_color: bool,
    /// Quality of JPEG compression, 1 to 100; `None` for none.
    pub jpeg_quality: Option<u8>,
}

impl Sensor {
    /// A random sensor, exposed for a ball of the given brightness in a crop of the given side.
    pub fn random<R: Rng + ?Sized>(
        brightest: f32,
        side: f64,
        config: &SynthConfig,
        rng: &mut R,
    ) -> Self {
        let target = if rng.random_bool(config.bad_exposure) {
            if rng.random_bool(0.5) {
                rng.random_range(0.04..0.15)
            } else {
                rng.random_range(1.1..1.8)
            }
        } else {
            rng.random_range(0.2..1.0f32)
        };
        let noise = rng.random_range(0.25..1.0f32) * config.max_noise as f32;
        let [low, high] = config.defocus_px;
        let has_color = rng.random_bool(0.7);
        let gamma = match rng.random_range(0..3) {
            0 => 1.0,
            1 => 2.2,
            _ => rng.random_range(1.0..2.4),
        };
        Self {
            defocus_px: (low + (high - low) * rng.random::<f64>()) * side / 60.0,
            gain: target / brightest.max(1e-3),
            read_noise: 0.004 * noise * rng.random::<f32>(),
            shot_noise: 0.0004 * noise * rng.random::<f32>(),
            color_noise: if has_color {
                0.006 * noise * rng.random::<f32>()
            } else {
                0.0
            },
            gamma,
            has_color,
            jpeg_quality: rng.random_bool(0.3).then(|| rng.random_range(55..=98)),
        }
    }

    /// Takes an image of the light on every pixel.
    ///
    /// # Errors
    /// [`Error::Argument`] where there is no pixel; [`Error::Internal`] where the compression fails.
    pub fn take(
        &self,
        light: &[[f32; 3]],
        [width, height]: [usize; 2],
        seed: u64,
    ) -> Result<RgbImage> {
        let mut signal = light.to_vec();
        blur(&mut signal, width, self.defocus_px);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let color = self.color_noise_map(width, height, &mut rng);
        for (pixel, color) in signal.iter_mut().zip(color) {
            let gray = luma(*pixel);
            let mut one = 0.0;
            for (k, c) in pixel.iter_mut().enumerate() {
                let s = self.gain * if self.has_color { *c } else { gray };
                if k == 0 || self.has_color {
                    let deviation = (self.read_noise.powi(2) + self.shot_noise * s.max(0.0)).sqrt();
                    one = deviation * rng.sample::<f32, _>(StandardNormal);
                }
                let noisy = (s + one + color[k]).clamp(0.0, 1.0);
                let value = noisy.powf(1.0 / self.gamma);
                *c = (255.0 * value).round() / 255.0;
            }
        }
        let image = RgbImage::new(width, height, signal)?;
        match self.jpeg_quality {
            Some(quality) => compress(&image, quality),
            None => Ok(image),
        }
    }

    /// Coarse color noise: white noise, averaged over three by three pixels, without brightness.
    fn color_noise_map(&self, width: usize, height: usize, rng: &mut ChaCha8Rng) -> Vec<[f32; 3]> {
        if self.color_noise <= 0.0 {
            return vec![[0.0; 3]; width * height];
        }
        let white: Vec<[f32; 3]> = (0..width * height)
            .map(|_| [0, 1, 2].map(|_| rng.sample::<f32, _>(StandardNormal)))
            .collect();
        (0..width * height)
            .map(|i| {
                let (u, v) = (i % width, i / width);
                let mut sum = [0.0f32; 3];
                for y in v.saturating_sub(1)..(v + 2).min(height) {
                    for x in u.saturating_sub(1)..(u + 2).min(width) {
                        for (s, w) in sum.iter_mut().zip(white[y * width + x]) {
                            *s += w;
                        }
                    }
                }
                let gray = luma(sum);
                // A sum of nine has the deviation 3.
                sum.map(|c| (c - gray) / 3.0 * 2.0 * self.color_noise)
            })
            .collect()
    }
}

/// A Gaussian blur, along rows and then along columns; the border repeats.
fn blur(values: &mut [[f32; 3]], width: usize, sigma: f64) {
    if sigma < 0.05 {
        return;
    }
    let reach = (3.0 * sigma).ceil() as isize;
    let kernel: Vec<f32> = (-reach..=reach)
        .map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp() as f32)
        .collect();
    let total: f32 = kernel.iter().sum();
    let height = values.len() / width;
    let mut line = Vec::new();
    let mut along = |start: usize, step: usize, count: usize| {
        line.clear();
        line.extend((0..count).map(|i| values[start + i * step]));
        for i in 0..count {
            let mut sum = [0.0f32; 3];
            for (k, weight) in kernel.iter().enumerate() {
                let from = (i as isize + k as isize - reach).clamp(0, count as isize - 1);
                for (s, c) in sum.iter_mut().zip(line[from as usize]) {
                    *s += weight * c;
                }
            }
            values[start + i * step] = sum.map(|s| s / total);
        }
    };
    for row in 0..height {
        along(row * width, 1, width);
    }
    for column in 0..width {
        along(column, width, height);
    }
}

/// To JPEG and back.
fn compress(image: &RgbImage, quality: u8) -> Result<RgbImage> {
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
