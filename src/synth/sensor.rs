//! The sensor, from light to the values in a file: lens blur, gain, noise, color mosaic, tone
//! curve, sharpening, eight bits, compression.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::color::{Color, luma};
use super::compression::Compression;
use super::config::SynthConfig;
use super::random::{between, between_f32, log_between};
use crate::error::Result;
use crate::image::RgbImage;

/// How a camera encodes its signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// As it is: most machine-vision cameras.
    Linear,
    /// sRGB (IEC 61966-2-1): phones, videos, most files.
    Srgb,
}

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
    /// Whether the camera sees colors.
    pub has_color: bool,
    /// Whether each pixel sees one color of a Bayer mosaic (RGGB), the others interpolated.
    pub has_mosaic: bool,
    /// How the signal is encoded.
    pub encoding: Encoding,
    /// Exponent on the encoded values.
    pub gamma: f32,
    /// Strength of the sharpening: the part of the difference from the mean of 3 x 3 pixels that is
    /// added.
    pub sharpening: f32,
    /// How the image is compressed.
    pub compression: Compression,
}

impl Sensor {
    /// A sensor without faults: linear, without noise and blur.
    pub const PERFECT: Self = Self {
        defocus_px: 0.0,
        gain: 1.0,
        read_noise: 0.0,
        shot_noise: 0.0,
        color_noise: 0.0,
        has_color: true,
        has_mosaic: false,
        encoding: Encoding::Linear,
        gamma: 1.0,
        sharpening: 0.0,
        compression: Compression::None,
    };

    /// A random sensor, exposed for a ball of the given brightness; `scale` is the crop's side over
    /// 60 pixels.
    pub(super) fn random<R: Rng + ?Sized>(
        brightest: f32,
        scale: f64,
        config: &SynthConfig,
        rng: &mut R,
    ) -> Self {
        let is_bad = rng.random_bool(config.bad_exposure);
        let is_dark = rng.random_bool(0.5);
        let target = match (is_bad, is_dark) {
            (true, true) => rng.random_range(0.04..0.15),
            (true, false) => rng.random_range(1.1..2.0),
            _ => rng.random_range(0.2..1.0f32),
        };
        // Most cameras are good; the factor's square root is uniform.
        let noise = rng.random::<f32>().powi(2) * config.max_noise as f32;
        let has_color = rng.random_bool(0.7);
        let gamma = log_between(config.gamma, rng) as f32;
        let has_gamma = rng.random_bool(config.gamma_share) && !is_bad;
        let gamma = if has_gamma { gamma } else { 1.0 };
        // Who darkens an image exposes it for that: the ball's brightest part ends at the target.
        let target = target.powf(1.0 / gamma.max(1.0));
        Self {
            defocus_px: between(config.defocus_px, rng) * scale,
            gain: target / brightest.max(1e-3),
            read_noise: 0.004 * noise * rng.random::<f32>(),
            shot_noise: 0.0004 * noise * rng.random::<f32>(),
            color_noise: 0.006 * noise.min(4.0) * rng.random::<f32>() * f32::from(has_color),
            has_color,
            has_mosaic: has_color && rng.random_bool(config.mosaic_share),
            encoding: if rng.random_bool(0.6) {
                Encoding::Srgb
            } else {
                Encoding::Linear
            },
            gamma,
            sharpening: if rng.random_bool(config.sharpen_share) {
                rng.random_range(0.2..1.5)
            } else {
                0.0
            },
            compression: random_compression(config, rng),
        }
    }

    /// Takes an image of the light on every pixel.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where there is no pixel; [`crate::Error::Internal`] where the
    /// compression fails.
    pub fn take(
        &self,
        light: Vec<Color>,
        [width, height]: [usize; 2],
        seed: u64,
    ) -> Result<RgbImage> {
        let mut signal = light;
        blur(&mut signal, width, self.defocus_px);
        self.expose(&mut signal, width, seed);
        if self.has_mosaic {
            signal = through_mosaic(&signal, width);
        }
        for pixel in &mut signal {
            *pixel = pixel.map(|s| self.encode(s));
        }
        if self.sharpening > 0.0 {
            sharpen(&mut signal, width, self.sharpening);
        }
        for pixel in &mut signal {
            *pixel = pixel.map(|c| (255.0 * c).round() / 255.0);
        }
        self.compression
            .apply(RgbImage::new(width, height, signal)?)
    }

    /// The value of a signal.
    pub(super) fn encode(&self, signal: f32) -> f32 {
        let s = signal.clamp(0.0, 1.0);
        let encoded = match self.encoding {
            Encoding::Linear => s,
            Encoding::Srgb if s <= 0.003_130_8 => 12.92 * s,
            Encoding::Srgb => 1.055 * s.powf(1.0 / 2.4) - 0.055,
        };
        if self.gamma == 1.0 {
            encoded
        } else {
            encoded.powf(self.gamma)
        }
    }

    /// Gain, color and noise.
    fn expose(&self, signal: &mut [Color], width: usize, seed: u64) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let color = self.color_noise_map(width, signal.len() / width.max(1), &mut rng);
        for (i, pixel) in signal.iter_mut().enumerate() {
            let gray = luma(*pixel);
            let mut noise = 0.0;
            for (k, c) in pixel.iter_mut().enumerate() {
                let s = self.gain * if self.has_color { *c } else { gray };
                if k == 0 || self.has_color {
                    let deviation = (self.read_noise.powi(2) + self.shot_noise * s.max(0.0)).sqrt();
                    noise = deviation * rng.sample::<f32, _>(StandardNormal);
                }
                // A pixel is full before it is read.
                *c = s.min(1.0) + noise + color.get(i).map_or(0.0, |c| c[k]);
            }
        }
    }

    /// Coarse color noise: white noise, averaged over three by three pixels, without brightness;
    /// empty where there is none.
    fn color_noise_map(&self, width: usize, height: usize, rng: &mut ChaCha8Rng) -> Vec<Color> {
        if self.color_noise <= 0.0 {
            return Vec::new();
        }
        let white: Vec<Color> = (0..width * height)
            .map(|_| [0, 1, 2].map(|_| rng.sample::<f32, _>(StandardNormal)))
            .collect();
        (0..width * height)
            .map(|i| {
                let sum = sum_about(&white, width, i);
                let gray = luma(sum);
                // A sum of nine has the deviation 3.
                sum.map(|c| (c - gray) / 3.0 * 2.0 * self.color_noise)
            })
            .collect()
    }
}

fn random_compression<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Compression {
    let [jpeg, video] = [config.jpeg_share, config.video_share].map(|p| rng.random_bool(p));
    let quality = between(config.jpeg_quality, rng).round() as u8;
    let half_color = rng.random_bool(0.6);
    let qp = between_f32(config.video_qp, rng);
    match (jpeg, video) {
        (true, _) => Compression::Jpeg {
            quality,
            half_color,
        },
        (_, true) => Compression::Video { qp },
        _ => Compression::None,
    }
}

/// The sum of a pixel's three by three neighbors, as far as there are.
fn sum_about(values: &[Color], width: usize, i: usize) -> Color {
    let (u, v, height) = (i % width, i / width, values.len() / width);
    let mut sum = [0.0f32; 3];
    for y in v.saturating_sub(1)..(v + 2).min(height) {
        for x in u.saturating_sub(1)..(u + 2).min(width) {
            for (s, w) in sum.iter_mut().zip(values[y * width + x]) {
                *s += w;
            }
        }
    }
    sum
}

/// What is left when each pixel keeps one color (RGGB) and takes the others from the mean of its
/// neighbors.
fn through_mosaic(signal: &[Color], width: usize) -> Vec<Color> {
    let height = signal.len() / width;
    let channel = |u: usize, v: usize| match (u % 2, v % 2) {
        (0, 0) => 0,
        (1, 1) => 2,
        _ => 1,
    };
    (0..signal.len())
        .map(|i| {
            let (u, v) = (i % width, i / width);
            let (mut sum, mut count) = ([0.0f32; 3], [0.0f32; 3]);
            for y in v.saturating_sub(1)..(v + 2).min(height) {
                for x in u.saturating_sub(1)..(u + 2).min(width) {
                    let k = channel(x, y);
                    sum[k] += signal[y * width + x][k];
                    count[k] += 1.0;
                }
            }
            let own = channel(u, v);
            [0, 1, 2].map(|k| {
                if k == own || count[k] == 0.0 {
                    signal[i][k]
                } else {
                    sum[k] / count[k]
                }
            })
        })
        .collect()
}

/// Adds a part of the difference from the neighbors' mean.
fn sharpen(values: &mut [Color], width: usize, strength: f32) {
    let before = values.to_vec();
    let height = before.len() / width;
    for (i, value) in values.iter_mut().enumerate() {
        let (u, v) = (i % width, i / width);
        let columns = (u + 2).min(width) - u.saturating_sub(1);
        let rows = (v + 2).min(height) - v.saturating_sub(1);
        let sum = sum_about(&before, width, i);
        for (c, sum) in value.iter_mut().zip(sum) {
            *c = (*c + strength * (*c - sum / (columns * rows) as f32)).clamp(0.0, 1.0);
        }
    }
}

/// A Gaussian blur, along rows and then along columns; the border repeats.
fn blur(values: &mut [Color], width: usize, sigma: f64) {
    if sigma < 0.05 || values.is_empty() {
        return;
    }
    let reach = (3.0 * sigma).ceil() as usize;
    let weights: Vec<f32> = (0..=2 * reach)
        .map(|k| (-0.5 * ((k as f64 - reach as f64) / sigma).powi(2)).exp() as f32)
        .collect();
    let total: f32 = weights.iter().sum();
    let kernel: Vec<f32> = weights.iter().map(|w| w / total).collect();
    let height = values.len() / width;
    // The line with its ends repeated, so that the inner loop asks nothing.
    let mut line: Vec<Color> = Vec::new();
    let mut along = |start: usize, step: usize, count: usize| {
        let at = |i: usize| values[start + i.saturating_sub(reach).min(count - 1) * step];
        line.clear();
        line.extend((0..count + 2 * reach).map(at));
        for i in 0..count {
            let mut sum = [0.0f32; 3];
            for (weight, color) in kernel.iter().zip(&line[i..]) {
                for (s, c) in sum.iter_mut().zip(color) {
                    *s += weight * c;
                }
            }
            values[start + i * step] = sum;
        }
    };
    for row in 0..height {
        along(row * width, 1, width);
    }
    for column in 0..width {
        along(column, width, height);
    }
}
