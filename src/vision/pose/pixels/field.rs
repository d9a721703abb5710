//! The pixels within a small ball's outline, freed of its shading, and how each place of the ball fits a dot.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use crate::stats::SIGMA_PER_MAD;
use crate::vision::dots::blob::flatten::{self, harmonics};
use crate::vision::net::graph::CELLS;
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::Pixel;
use crate::vision::pose::rotations::{Terms, place};

/// Number of spherical harmonics.
pub(crate) const SHADES: usize = flatten::TERMS;
/// Pixels nearer to the outline than this are those of what is behind the ball, too.
const EDGE_PX: f64 = 0.8;
/// The tone curve's bend, between a line and sRGB's (`cap::tone`).
const BEND: f64 = 0.6;
/// What dots are on average: angular radius in radians, blur in pixels, the share of the light that the ink takes.
pub(crate) const RHO: f64 = 0.09;
pub(crate) const BLUR: f64 = 0.5;
pub(crate) const INK: f64 = 0.75;
/// Rounds of the fit of the shading, in which what is darker than the rest loses its weight.
const ROUNDS: usize = 8;
/// Darker pixels than this many deviations are no paper; they keep this weight.
const DARK: f64 = 2.0;
const DARK_WEIGHT: f64 = 0.02;
/// The least light of a pixel over the ball's mean, and bounds of its weight.
const MIN_LIGHT: f64 = 0.15;
const WEIGHTS: (f64, f64) = (0.3, 1.5);
/// Share of the dots that cannot be seen.
const MISSED: f64 = 0.1;
/// For the search: least deviation of the pixels, and largest change of one that counts, of the ball's light.
const SEARCH_SIGMA: f64 = 0.08;
const CLIP: f64 = 0.6;
/// The largest logarithm of a likelihood ratio of one dot.
const SUREST: f64 = 30.0;
/// Squared deviations beyond which a dot darkens nothing.
pub(crate) const REACH2: f64 = 14.0;
/// The most pixels that are reserved for.
const EXPECTED: usize = 1024;
/// Fewer pixels show no orientation.
const MIN_PIXELS: usize = 30;

/// A pixel of the ball.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BallSample {
    pub at: Pixel,
    /// Its light over that of the shading.
    pub light: f64,
    /// What it weighs: dark sides are noisier once they are divided by their light.
    pub weight: f64,
    pub shades: [f64; SHADES],
}

/// A dot as the pixels have it.
#[derive(Debug, Clone, Copy)]
pub struct PlacedDot {
    /// The pattern's dot.
    pub name: u16,
    /// Its middle.
    pub pixel: Pixel,
    /// Covariance of that, px^2.
    pub covariance: Matrix2<f64>,
}

/// The pixels of a ball; their memory is reused.
#[derive(Debug, Clone)]
pub(crate) struct Pixels {
    pub(crate) samples: Vec<BallSample>,
    /// Orthonormal combinations of the weighed shades.
    bases: Vec<[f64; SHADES]>,
    /// What these leave of the light.
    rest: Vec<f64>,
    sorted: Vec<f64>,
    center: Pixel,
    radius: f64,
}

impl Default for Pixels {
    fn default() -> Self {
        Self {
            samples: Vec::with_capacity(EXPECTED),
            bases: Vec::with_capacity(EXPECTED),
            rest: Vec::with_capacity(EXPECTED),
            sorted: Vec::with_capacity(EXPECTED),
            center: Pixel::default(),
            radius: 1.0,
        }
    }
}

impl Pixels {
    /// Reads a ball; `None` where too little of it is seen.
    pub fn read(&mut self, pixels: &BallPixels<'_>) -> Option<()> {
        let circle = pixels.view.circle();
        (self.center, self.radius) = (circle.center, circle.radius);
        self.samples.clear();
        let reach = circle.radius - EDGE_PX;
        let at = pixels.grid.pixel_to_part(circle.center);
        let range = |middle: f64, count: usize| {
            let from = (middle - reach).ceil().max(0.0) as usize;
            from..((middle + reach).floor().max(-1.0) + 1.0).min(count as f64) as usize
        };
        for v in range(at.v, pixels.gray.height()) {
            for u in range(at.u, pixels.gray.width()) {
                let place = pixels.place(u, v);
                let x = (place.u - circle.center.u) / circle.radius;
                let y = (place.v - circle.center.v) / circle.radius;
                if x.hypot(y) * circle.radius > reach {
                    continue;
                }
                let value = f64::from(pixels.gray.at(u as isize, v as isize));
                self.samples.push(BallSample {
                    at: place,
                    light: (1.0 - BEND + BEND * value) * value,
                    weight: 1.0,
                    shades: shades(x, y),
                });
            }
        }
        (self.samples.len() >= MIN_PIXELS).then_some(())?;
        self.divide_by_shading()?;
        self.orthogonalize();
        Some(())
    }

    /// Divides the light by that of the paper, whose pixels are the brighter ones.
    fn divide_by_shading(&mut self) -> Option<()> {
        let count = self.samples.len();
        let mut by = SVector::<f64, SHADES>::zeros();
        for round in 0..ROUNDS {
            let mut information = SMatrix::<f64, SHADES, SHADES>::identity() * 1e-6;
            let mut gradient = SVector::<f64, SHADES>::zeros();
            for sample in &self.samples {
                let shades = SVector::from(sample.shades);
                information += shades * shades.transpose() * sample.weight;
                gradient += shades * (sample.light * sample.weight);
            }
            by = information.cholesky()?.solve(&gradient);
            if round + 1 == ROUNDS {
                break;
            }
            let off = |s: &BallSample| s.light - by.dot(&SVector::from(s.shades));
            self.sorted.clear();
            self.sorted
                .extend(self.samples.iter().map(|s| off(s).abs()));
            let scale = deviation(&mut self.sorted).max(1e-4);
            for sample in &mut self.samples {
                let t = off(sample) / scale;
                let dark = (1.0 - (t / DARK).powi(2)).max(0.0).powi(2);
                sample.weight = match t < 0.0 {
                    true => dark.max(DARK_WEIGHT),
                    false => 1.0 / (1.0 + t * t / 9.0),
                };
            }
        }
        let paper = |s: &BallSample| by.dot(&SVector::from(s.shades));
        let mean = self.samples.iter().map(paper).sum::<f64>() / count as f64;
        for sample in &mut self.samples {
            let light = paper(sample).max(MIN_LIGHT * mean).max(1e-3);
            sample.light /= light;
            sample.weight = (light / mean.max(1e-3)).clamp(WEIGHTS.0, WEIGHTS.1);
        }
        Some(())
    }

    /// Where a pixel lies in the image, or in the mirrored one.
    pub(crate) fn at(&self, sample: &BallSample, is_mirrored: bool) -> Pixel {
        match is_mirrored {
            true => Pixel {
                u: 2.0 * self.center.u - sample.at.u,
                v: sample.at.v,
            },
            false => sample.at,
        }
    }

    /// The harmonics there.
    pub(crate) fn shades(&self, sample: &BallSample, is_mirrored: bool) -> [f64; SHADES] {
        let mut shades = sample.shades;
        if is_mirrored {
            [1, 4, 5].into_iter().for_each(|k| shades[k] = -shades[k]);
        }
        shades
    }

    /// The squares of what shading leaves of the light.
    pub(crate) fn squares(&self) -> f64 {
        self.rest.iter().map(|r| r * r).sum::<f64>().max(1e-12)
    }

    /// Orthonormal shades by Gram and Schmidt, and what they leave of the light.
    fn orthogonalize(&mut self) {
        let weighed = |s: &BallSample| s.shades.map(|y| s.weight * y);
        self.bases.clear();
        self.bases.extend(self.samples.iter().map(weighed));
        self.rest.clear();
        self.rest
            .extend(self.samples.iter().map(|s| s.weight * s.light));
        for k in 0..SHADES {
            // Twice, since once loses digits.
            for other in (0..k).chain(0..k) {
                let along: f64 = self.bases.iter().map(|b| b[k] * b[other]).sum();
                self.bases.iter_mut().for_each(|b| b[k] -= along * b[other]);
            }
            let length = self.bases.iter().map(|b| b[k] * b[k]).sum::<f64>().sqrt();
            self.bases.iter_mut().for_each(|b| b[k] /= length.max(1e-9));
            let pairs = self.bases.iter().zip(&self.rest);
            let along: f64 = pairs.map(|(b, r)| b[k] * r).sum();
            let pairs = self.bases.iter().zip(&mut self.rest);
            pairs.for_each(|(b, r)| *r -= along * b[k]);
        }
    }

    /// For each cell of a patch the logarithm of how much likelier the pixels are with a dot there than without.
    pub fn fill(&mut self, terms: &mut Terms) {
        self.sorted.clear();
        self.sorted.extend(self.rest.iter().map(|r| r.abs()));
        let sigma = deviation(&mut self.sorted).max(SEARCH_SIGMA);
        for row in 0..CELLS {
            for column in 0..CELLS {
                let ratio = self
                    .ratio(place(column, row), sigma)
                    .unwrap_or(f64::NEG_INFINITY);
                let explained = MISSED + (1.0 - MISSED) * ratio.min(SUREST).exp();
                terms[row * CELLS + column] = explained.ln() as f32;
            }
        }
    }

    /// The logarithm of the likelihood ratio of a dot, whose ink is the usual one, and none.
    fn ratio(&self, [x, y]: [f64; 2], sigma: f64) -> Option<f64> {
        let z2 = 1.0 - x * x - y * y;
        let blob = BlurredDot::new([x, y], z2.max(0.0).sqrt(), RHO * self.radius, BLUR)?;
        if z2 < 0.03 {
            return None;
        }
        let (mut along, mut squares, mut shades) = (0.0, 0.0, [0.0; SHADES]);
        for ((sample, bases), rest) in self.samples.iter().zip(&self.bases).zip(&self.rest) {
            let off = Vector2::new(
                sample.at.u - self.center.u - self.radius * x,
                sample.at.v - self.center.v - self.radius * y,
            );
            let Some((darker, _)) = blob.at(&off) else {
                continue;
            };
            let darker = darker * sample.weight;
            along -= darker * rest.clamp(-CLIP, CLIP);
            squares += darker * darker;
            for (sum, base) in shades.iter_mut().zip(bases) {
                *sum += darker * base;
            }
        }
        let squares = squares - shades.iter().map(|s| s * s).sum::<f64>();
        Some((INK * along - 0.5 * INK * INK * squares) / (sigma * sigma))
    }
}

/// The harmonics at a place, radii to the right of the middle and below it.
fn shades(x: f64, y: f64) -> [f64; SHADES] {
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    harmonics([x, y, z])
}

/// The robust standard deviation of some absolute values.
fn deviation(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    SIGMA_PER_MAD * *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// A blurred dot in the image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BlurredDot {
    pub inverse: Matrix2<f64>,
    /// How the covariance changes with the logarithm of the dot's radius.
    pub by_radius: Matrix2<f64>,
    amplitude: f64,
}

impl BlurredDot {
    /// Of a dot seen at a place (radii to the right and below) and z, of a radius and a blur in pixels.
    pub fn new([x, y]: [f64; 2], z: f64, radius: f64, blur: f64) -> Option<Self> {
        let out = Vector2::new(x, y) / x.hypot(y).max(1e-9);
        let z = z.max(0.1);
        let own = 0.25 * radius * radius;
        let shape = (Matrix2::identity() - out * out.transpose() * (1.0 - z * z)) * own;
        let covariance = shape + Matrix2::from_diagonal_element(blur * blur);
        Some(Self {
            inverse: covariance.try_inverse()?,
            by_radius: shape * 2.0,
            amplitude: 0.5 * radius * radius * z / covariance.determinant().sqrt(),
        })
    }

    /// The part of a pixel that it covers, and the slope `S^-1 (p - m)`; `None` far off.
    pub fn at(&self, off: &Vector2<f64>) -> Option<(f64, Vector2<f64>)> {
        let slope = self.inverse * off;
        let squared = off.dot(&slope);
        (squared < REACH2).then(|| (self.amplitude * (-0.5 * squared).exp(), slope))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dot_darkens_as_much_as_it_covers() {
        for (place, z) in [([0.0, 0.0], 1.0f64), ([0.48, -0.64], 0.6)] {
            let radius = 1.3;
            let blob = BlurredDot::new(place, z, radius, 0.7).expect("a dot");
            let mut sum = 0.0;
            for v in -12..=12 {
                for u in -12..=12 {
                    let off = Vector2::new(f64::from(u) + 0.3, f64::from(v) - 0.2);
                    sum += blob.at(&off).map_or(0.0, |(covered, _)| covered);
                }
            }
            // An ellipse of the half axes r and r z; the tails beyond the reach are left out.
            let area = std::f64::consts::PI * radius * radius * z;
            assert!((sum / area - 1.0).abs() < 3e-3, "{sum} for {area}");
        }
    }
}
