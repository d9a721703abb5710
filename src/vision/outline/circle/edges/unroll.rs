//! The image along rays around a center, and the edges on each.
//!
//! Samples of one radius lie beside each other for all rays, so that slopes are summed and peaks are looked for on several
//! rays at once.

use std::f64::consts::TAU;

use fearless_simd::{Level, Simd, dispatch};
use nalgebra::{Vector2, Vector3};

use crate::image::GrayImage;

/// Rays around a center.
pub(super) const RAYS: usize = 72;
/// Samples a pixel along a ray.
const FINE: f64 = 2.0;
/// Maximum number of samples on a ray, and of edges on it.
const SAMPLES: usize = 96;
pub(super) const EDGES: usize = 4;
/// Standard deviation of the smoothing of derivatives, pixels.
pub(super) const SMOOTHING: f64 = 0.8;
/// Samples to either side that the smoothing reaches: 2.5 deviations.
const HALF: usize = 4;
/// Edges below this part of the strong ones' slope (the upper quartile of the rays' strongest) are none.
const FAINT: f32 = 0.15;
/// Edges below this slope, brightness per pixel, are none: a step of 1 of 255.
const FAINTEST: f32 = 0.004;
/// On both sides of an edge, within so many samples, the slope falls below this part of its peak: else it is a ramp.
const FLANK: (usize, f32) = (8, 0.75);
/// Rays whose marks are looked at together.
const TOGETHER: usize = 8;

/// A value of each ray.
type OfRays<T> = [T; RAYS];

/// An edge on a ray.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Edge {
    pub radius: f64,
    /// Fall of the brightness outwards (for dark balls, rise), per pixel; 0 for no edge.
    pub slope: f32,
}

/// Working memory.
#[derive(Debug)]
pub(crate) struct Unrolled {
    level: Level,
    /// Where the rays begin.
    pub(super) origin: Vector2<f64>,
    pub(super) directions: OfRays<[f64; 2]>,
    /// The weight of the difference of the samples so many before and behind, from one on.
    kernel: [f32; HALF],
    values: Box<[OfRays<f32>; SAMPLES]>,
    slopes: Box<[OfRays<f32>; SAMPLES]>,
    pub(super) edges: OfRays<[Edge; EDGES]>,
    /// How far the image reaches along each ray.
    pub(super) reaches: OfRays<f64>,
}

impl Default for Unrolled {
    fn default() -> Self {
        let direction = |ray: usize| {
            let (sin, cos) = (TAU * ray as f64 / RAYS as f64).sin_cos();
            [cos, sin]
        };
        let sigma = SMOOTHING * FINE;
        let weight = |k: usize| {
            let x = (k + 1) as f64 / sigma;
            x * (-0.5 * x * x).exp()
        };
        // A ramp that falls by 1 a pixel has the slope 1.
        let norm: f64 = (0..HALF)
            .map(|k| 2.0 * weight(k) * (k + 1) as f64)
            .sum::<f64>()
            / FINE;
        Self {
            level: Level::new(),
            origin: Vector2::zeros(),
            directions: std::array::from_fn(direction),
            kernel: std::array::from_fn(|k| (-weight(k) / norm) as f32),
            values: Box::new([[0.0; RAYS]; SAMPLES]),
            slopes: Box::new([[0.0; RAYS]; SAMPLES]),
            edges: [[Edge::default(); EDGES]; RAYS],
            reaches: [0.0; RAYS],
        }
    }
}

impl Unrolled {
    /// Finds the edges on all rays from a center (u, v, _) between two radii.
    pub(super) fn find_edges(
        &mut self,
        image: &GrayImage,
        center: &Vector3<f64>,
        range: (f64, f64),
        sign: f64,
    ) {
        dispatch!(self.level, simd => simd.vectorize(
            #[inline(always)]
            || self.find_edges_now(image, center, range, sign)
        ));
    }

    /// Compiled for each level.
    #[inline(always)]
    fn find_edges_now(
        &mut self,
        image: &GrayImage,
        center: &Vector3<f64>,
        (from, to): (f64, f64),
        sign: f64,
    ) {
        self.origin = center.xy();
        let margin = HALF as f64 / FINE;
        let begin = (from - margin).max(0.0);
        let count = (((to + margin - begin) * FINE) as usize).min(SAMPLES);
        let (right, bottom) = ((image.width() - 1) as f64, (image.height() - 1) as f64);
        // Where no ray leaves the image, no place has to be compared with its borders.
        let farthest = begin + count as f64 / FINE;
        let is_inside = center.x - farthest >= 0.0
            && center.y - farthest >= 0.0
            && center.x + farthest < right
            && center.y + farthest < bottom;
        self.edges = [[Edge::default(); EDGES]; RAYS];
        if is_inside {
            self.read_inside(image, farthest, begin, count);
            self.reaches = [begin + count.saturating_sub(HALF) as f64 / FINE; RAYS];
            self.find_slopes(count, sign);
        } else {
            let read = self.read(image, begin, count);
            self.reaches = read.map(|read| begin + read.saturating_sub(HALF) as f64 / FINE);
            self.find_slopes(count, sign);
            for (ray, read) in read.into_iter().enumerate() {
                let unknown = read.saturating_sub(HALF).min(count)..count;
                self.slopes[unknown].iter_mut().for_each(|s| s[ray] = 0.0);
            }
        }
        self.find_peaks(begin, count);
        self.drop_faint();
    }

    /// Reads the samples of rays that do not leave the image.
    #[inline(always)]
    fn read_inside(&mut self, image: &GrayImage, farthest: f64, begin: f64, count: usize) {
        // From a corner on, single precision has all the digits that a place needs.
        let [left, top] = [self.origin.x, self.origin.y].map(|x| (x - farthest) as usize);
        let (u0, v0) = (self.origin.x - left as f64, self.origin.y - top as f64);
        let (u0, v0) = (u0 as f32, v0 as f32);
        let width = image.width();
        let corner = &image.values()[top * width + left..];
        let directions = self.directions.map(|of_ray| of_ray.map(|x| x as f32));
        for (k, values) in self.values[..count].iter_mut().enumerate() {
            let radius = (begin + k as f64 / FINE) as f32;
            for (value, [cos, sin]) in values.iter_mut().zip(&directions) {
                let (u, v) = (u0 + radius * cos, v0 + radius * sin);
                let (column, row) = (u as u32, v as u32);
                let (fu, fv) = (u - column as f32, v - row as f32);
                let rows = &corner[row as usize * width + column as usize..][..width + 2];
                let above = rows[0] + fu * (rows[1] - rows[0]);
                let below = rows[width] + fu * (rows[width + 1] - rows[width]);
                *value = above + fv * (below - above);
            }
        }
    }

    /// Reads the samples of rays as far as they are in the image: how many there are of each.
    fn read(&mut self, image: &GrayImage, begin: f64, count: usize) -> OfRays<usize> {
        let (right, bottom) = ((image.width() - 1) as f64, (image.height() - 1) as f64);
        let mut read = [0; RAYS];
        for (ray, read) in read.iter_mut().enumerate() {
            let [cos, sin] = self.directions[ray];
            for k in 0..count {
                let radius = begin + k as f64 / FINE;
                let (u, v) = (self.origin.x + radius * cos, self.origin.y + radius * sin);
                if !(u >= -0.5 && v >= -0.5 && u <= right + 0.5 && v <= bottom + 0.5) {
                    break;
                }
                self.values[k][ray] = image.sample(u, v);
                *read = k + 1;
            }
        }
        read
    }

    /// The slopes of the samples; 0 where the smoothing reaches beyond them.
    #[inline(always)]
    fn find_slopes(&mut self, count: usize, sign: f64) {
        let kernel = self
            .kernel
            .map(|w| if sign == 0.0 { w } else { -(sign as f32) * w });
        self.slopes[..count].fill([0.0; RAYS]);
        for k in HALF..count.saturating_sub(HALF) {
            let slopes = &mut self.slopes[k];
            for (j, weight) in kernel.iter().enumerate() {
                let (before, behind) = (&self.values[k - j - 1], &self.values[k + j + 1]);
                for ((slope, a), b) in slopes.iter_mut().zip(before).zip(behind) {
                    *slope += weight * (a - b);
                }
            }
            if sign == 0.0 {
                slopes.iter_mut().for_each(|s| *s = s.abs());
            }
        }
    }

    /// The strongest peaks of the slopes along each ray, between samples by a parabola.
    #[inline(always)]
    fn find_peaks(&mut self, begin: f64, count: usize) {
        for k in 1..count.saturating_sub(1) {
            let [before, here, behind] = [k - 1, k, k + 1].map(|k| &self.slopes[k]);
            let mut marks = [0u8; RAYS];
            for (((mark, a), b), c) in marks.iter_mut().zip(before).zip(here).zip(behind) {
                // Ends of the range, where no slope is known, are no edges.
                let is_peak = *b >= FAINTEST && *a < *b && *c <= *b && *a != 0.0 && *c != 0.0;
                *mark = u8::from(is_peak);
            }
            for (group, marks) in marks.chunks_exact(TOGETHER).enumerate() {
                if marks == [0; TOGETHER] {
                    continue;
                }
                for (i, _) in marks.iter().enumerate().filter(|(_, mark)| **mark != 0) {
                    self.keep_peak(TOGETHER * group + i, k, begin, count);
                }
            }
        }
    }

    /// Keeps the peak of a ray at a sample, where it is none of a ramp and among the strongest.
    fn keep_peak(&mut self, ray: usize, k: usize, begin: f64, count: usize) {
        let [a, b, c] = [k - 1, k, k + 1].map(|k| self.slopes[k][ray]);
        let falls = |flank: &[OfRays<f32>]| flank.iter().any(|s| s[ray] < FLANK.1 * b);
        let after = (k + 1 + FLANK.0).min(count);
        let before = k.saturating_sub(FLANK.0);
        if !falls(&self.slopes[before..k]) || !falls(&self.slopes[k + 1..after]) {
            return;
        }
        let found = &mut self.edges[ray];
        if let Some(at) = found.iter().position(|e| e.slope < b) {
            let shift = f64::from(0.5 * (a - c) / (a - 2.0 * b + c));
            found[at..].rotate_right(1);
            found[at] = Edge {
                radius: begin + (k as f64 + shift) / FINE,
                slope: b,
            };
        }
    }

    /// Forgets edges that are faint against the strong ones.
    fn drop_faint(&mut self) {
        // The first of a ray is its strongest.
        let mut strongest = self.edges.map(|of_ray| of_ray[0].slope);
        strongest.sort_unstable_by(f32::total_cmp);
        let least = (FAINT * strongest[RAYS * 3 / 4]).max(FAINTEST);
        for edge in self.edges.iter_mut().flatten() {
            if edge.slope < least {
                edge.slope = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc with a soft edge, seen whole and cut by the border.
    #[test]
    fn edges_lie_on_a_disc_as_far_as_the_image_reaches() {
        let (u, v, radius) = (40.3, 37.8, 21.4);
        let disc = |du: usize, width: usize| {
            GrayImage::from_fn(width, 80, |column, row| {
                let out = ((column + du) as f64 - u).hypot(row as f64 - v) - radius;
                (0.5 - 0.4 * out).clamp(0.1, 0.9) as f32
            })
        };
        let mut unrolled = Unrolled::default();
        let mut edges = |image: &GrayImage, du: f64| {
            let center = Vector3::new(u - du, v, 0.0);
            unrolled.find_edges(image, &center, (14.0, 28.0), 1.0);
            unrolled.edges.map(|of_ray| of_ray[0])
        };
        let whole = edges(&disc(0, 82), 0.0);
        for edge in &whole {
            assert!(
                (edge.radius - radius).abs() < 0.05 && edge.slope > 0.2,
                "{edge:?}"
            );
        }
        // The left 30 columns are missing: the disc's left edge is at 19.
        let cut = edges(&disc(30, 52), 30.0);
        let seen = |edge: &&Edge| edge.slope > 0.0;
        let count = cut.iter().filter(seen).count();
        assert!(count > RAYS / 2 && count < RAYS - 10, "{count}");
        for (edge, other) in cut.iter().zip(&whole).filter(|(edge, _)| seen(edge)) {
            assert!(
                (edge.radius - other.radius).abs() < 1e-3,
                "{edge:?} {other:?}"
            );
        }
    }
}
