//! What one image shows of a ball's paint, seen straight on.
//!
//! Values over the ball's near side, by the `x` and `y` of the direction in the view frame, whatever the camera's distance: what is
//! compared with the surface then only needs a rotation. A value is the logarithm of the brightness less its mean over what lies within
//! [`ABOUT`] on the ball: light and exposure, which vary slowly over the ball, leave, and marks stay. FicTrac thresholds each pixel
//! against its surroundings for the same reason (R. J. D. Moore et al., J. Neurosci. Methods 225, 2014).

use super::cover::opened;
use super::frame::PaintedFrame;
use crate::geometry::{Vec3, spiral_directions};
use crate::vision::optics::camera::{BallView, Pixel};

/// Values along the ball's diameter, at least and at most: a picture has no more than the image.
const SIDE: [f64; 2] = [24.0, 128.0];
/// The surroundings of a place, radians.
const ABOUT: f64 = 0.4;
/// Places at which brightness is read for the means, over the whole ball, and the least depth of these.
const MEANS: usize = 3_000;
const READ: f64 = 0.12;
/// Means along the ball's diameter.
const COARSE: usize = 32;
/// Added to the brightness, over its mean: the noise of what is dark does not count.
const DARK: f64 = 0.15;
/// Rings of a decoy.
const RINGS: u8 = 3;
/// A step of the stored values.
const STEP: f64 = 0.02;

/// Takes faces from images.
#[derive(Debug)]
pub struct FaceMaker {
    /// Places on the near side.
    places: Vec<Vec3>,
    /// For each mean which places it is of.
    about: Vec<Vec<u32>>,
}

impl Default for FaceMaker {
    fn default() -> Self {
        let places: Vec<Vec3> = spiral_directions(MEANS).filter(|d| d.z > READ).collect();
        let about = (0..COARSE * COARSE)
            .map(|cell| {
                let along = |k: usize| 2.0 * (k as f64 + 0.5) / COARSE as f64 - 1.0;
                let (x, y) = (along(cell % COARSE), -along(cell / COARSE));
                let out = x.hypot(y).max(1e-9);
                // What lies outside the ball has the mean of the limb.
                let held = (0.995f64 / out).min(1.0);
                let (x, y) = (x * held, y * held);
                let middle = Vec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt());
                let near = places.iter().enumerate();
                let near = near.filter(|(_, p)| p.dot(&middle) > ABOUT.cos());
                near.map(|(k, _)| k as u32).collect()
            })
            .collect();
        Self { places, about }
    }
}

/// The ball's paint in one image, in the view frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Face {
    /// Row by row from the top, `side` a row, over x and y from -1 to 1, in steps of [`STEP`].
    values: Vec<i8>,
    side: usize,
    /// Minimum z that is visible.
    horizon: f64,
    /// Standard deviation of the outline's center over the radius: turns about x and y that it feigns, radians.
    center_sigma: f64,
    /// What hides the ball, one a value; empty where that is not known.
    pub(crate) covered: Vec<bool>,
}

/// How many rays a value of a large ball is the mean of, along each side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rays {
    /// As many as lie nearest to a pixel apart, which paint is followed by as well.
    OnePixelApart,
    /// As many as lie no farther apart: marks are small, and a faint one is told from noise.
    WithinAPixel,
}

/// Values over the ball's near side, as a [`Face`] has them.
pub(crate) struct FaceSamples {
    pub values: Vec<f32>,
    side: usize,
    horizon: f64,
}

impl FaceSamples {
    /// By the brightness at pixels of an image, under whose `view` the ball's radius is so many known pixels.
    pub fn take(sample: impl Fn(Pixel) -> f32, radius: f64, view: &BallView, rays: Rays) -> Self {
        let side = (2.0 * radius).clamp(SIDE[0], SIDE[1]).round() as usize;
        let pixels = 2.0 * radius / side as f64;
        let fine = match rays {
            Rays::OnePixelApart => pixels.round(),
            Rays::WithinAPixel => pixels.ceil(),
        };
        let fine = fine.max(1.0) as usize;
        let horizon = view.horizon();
        let along = |ray: usize| {
            let at = (ray / fine) as f64 + ((ray % fine) as f64 + 0.5) / fine as f64;
            2.0 * at / side as f64 - 1.0
        };
        let places: Vec<f64> = (0..side * fine).map(along).collect();
        let (left, right) = places.split_at(places.len() / 2);
        let mut values = Vec::with_capacity(side * side);
        let mut sums = vec![(0.0f32, 0u32); side];
        let mut seen = [const { Vec::new() }; 2];
        for rows in places.chunks_exact(fine) {
            sums.fill((0.0, 0));
            for y in rows.iter().map(|along| -along) {
                let in_sight = |x: &f64| 1.0 - x * x - y * y > horizon * horizon;
                let from = left.partition_point(|x| !in_sight(x));
                let to = left.len() + right.partition_point(in_sight);
                let row = &places[from..to];
                view.project_row(y, row, &mut seen);
                for (ray, (u, v)) in (from..).zip(seen[0].iter().zip(&seen[1])) {
                    let (sum, count) = &mut sums[ray / fine];
                    *sum += sample(Pixel { u: *u, v: *v });
                    *count += 1;
                }
            }
            let mean = |&(sum, count): &(f32, u32)| match count {
                0 => 0.0,
                count => sum / count as f32,
            };
            values.extend(sums.iter().map(mean));
        }
        Self {
            values,
            side,
            horizon,
        }
    }

    /// The face of these values. `center_sigma` is the standard deviation of the outline's center over the radius.
    pub fn to_face(&self, center_sigma: f64) -> Face {
        let step = |value: &f32| {
            let steps = f64::from(*value) / STEP;
            (steps + 0.5f64.copysign(steps)).clamp(-127.0, 127.0) as i8
        };
        Face {
            values: self.values.iter().map(step).collect(),
            side: self.side,
            horizon: self.horizon,
            center_sigma,
            covered: Vec::new(),
        }
    }
}

impl FaceMaker {
    /// What a frame shows under a view of the ball in the image; `None` where it shows none. `center_sigma` is the standard deviation of the
    /// outline's center over the radius.
    pub fn take(&self, frame: &PaintedFrame, view: &BallView, center_sigma: f64) -> Option<Face> {
        let (image, grid) = frame.image()?;
        let sample = |pixel: Pixel| {
            let at = grid.pixel_to_part(pixel);
            image.sample(at.u, at.v)
        };
        let mut samples = FaceSamples::take(
            sample,
            view.circle().radius / grid.side,
            view,
            Rays::OnePixelApart,
        );
        self.flatten(&mut samples);
        Some(samples.to_face(center_sigma))
    }

    /// The logarithms less their means about them.
    fn flatten(&self, samples: &mut FaceSamples) {
        let FaceSamples {
            values,
            side,
            horizon,
        } = samples;
        let (side, horizon) = (*side, *horizon);
        // The spiral falls in z: the places in sight are the first ones.
        let in_sight = self.places.partition_point(|p| depth(p, horizon) > READ);
        let in_sight = &self.places[..in_sight];
        let read = |values: &[f32]| -> Vec<f64> {
            let values = in_sight.iter().map(|p| bilinear(values, side, p.x, p.y));
            values.collect()
        };
        let mean = read(values).iter().sum::<f64>() / f64::max(in_sight.len() as f64, 1.0);
        let dark = (DARK * mean).max(1e-3) as f32;
        values.iter_mut().for_each(|v| *v = (*v + dark).ln());
        let read = read(values);
        let means: Vec<f32> = self
            .about
            .iter()
            .map(|about| mean_of(&read, about))
            .collect();
        // The means between which each column lies, and each row.
        let between: Vec<Between> = (0..side)
            .map(|k| Between::new(2.0 * (k as f64 + 0.5) / side as f64 - 1.0, COARSE))
            .collect();
        for (row, values) in between.iter().zip(values.chunks_exact_mut(side)) {
            let [above, below] = [row.first, row.second].map(|j| &means[j * COARSE..][..COARSE]);
            let mut line = [0.0; COARSE];
            for ((mean, above), below) in line.iter_mut().zip(above).zip(below) {
                *mean = above + row.part * (below - above);
            }
            for (column, value) in between.iter().zip(values) {
                let [left, right] = [column.first, column.second].map(|i| line[i]);
                *value -= left + column.part * (right - left);
            }
        }
    }
}

/// How far a direction faces the camera: 0 at the limb, 1 in the middle.
fn depth(direction: &Vec3, horizon: f64) -> f64 {
    (direction.z - horizon) / (1.0 - horizon)
}

/// The mean of the numbers in sight about a place, whose numbers rise.
fn mean_of(read: &[f64], about: &[u32]) -> f32 {
    let in_sight = about.partition_point(|k| (*k as usize) < read.len());
    // Four sums, none of which waits for another.
    let mut sums = [0.0; 4];
    for four in about[..in_sight].chunks(4) {
        for (sum, k) in sums.iter_mut().zip(four) {
            *sum += read[*k as usize];
        }
    }
    (sums.iter().sum::<f64>() / f64::max(in_sight as f64, 1.0)) as f32
}

/// The two of `side` values over -1 to 1 between which a place lies, and how far it is from the first.
#[derive(Debug, Clone, Copy)]
struct Between {
    first: usize,
    second: usize,
    part: f32,
}

impl Between {
    fn new(x: f64, side: usize) -> Self {
        let last = (side - 1) as f64;
        let at = (0.5 * side as f64 * (x + 1.0) - 0.5).clamp(0.0, last);
        let first = at as usize;
        Self {
            first,
            second: (first + 1).min(side - 1),
            part: (at - first as f64) as f32,
        }
    }
}

/// The value at x and y of a square of `side` values a row over -1 to 1.
#[inline]
fn bilinear<T: Copy + Into<f32>>(values: &[T], side: usize, x: f64, y: f64) -> f64 {
    // Just before the last value: the next one is always there.
    let (half, last) = (0.5 * side as f32, side as f32 - 1.001);
    let place = |x: f64| (half * (x as f32 + 1.0) - 0.5).clamp(0.0, last);
    let (u, v) = (place(x), place(-y));
    let (i, j) = (u as i32, v as i32);
    let (a, b) = (u - i as f32, v - j as f32);
    let on_row = |first: usize| match values.get(first..first + 2) {
        Some(&[left, right]) => {
            let (left, right): (f32, f32) = (left.into(), right.into());
            left + a * (right - left)
        }
        _ => 0.0,
    };
    let first = j as usize * side + i as usize;
    let (above, below) = (on_row(first), on_row(first + side));
    f64::from(above + b * (below - above))
}

impl Face {
    /// How far a direction of the view frame faces the camera: 0 at the limb, 1 in the middle.
    pub fn depth(&self, direction: &Vec3) -> f64 {
        depth(direction, self.horizon)
    }

    /// The z from which directions of the view frame face the camera by a depth.
    pub fn least_z(&self, depth: f64) -> f64 {
        depth + (1.0 - depth) * self.horizon
    }

    /// The value at a direction of the view frame that is visible.
    pub fn at(&self, direction: &Vec3) -> f64 {
        STEP * bilinear(&self.values, self.side, direction.x, direction.y)
    }

    /// The face cut into rings of equal areas that are turned against each other.
    pub(crate) fn decoy(&self) -> Self {
        let side = self.side;
        let along = |cell: usize| 2.0 * (cell as f64 + 0.5) / side as f64 - 1.0;
        let value = |at: usize| {
            let (x, y) = (along(at % side), -along(at / side));
            let ring = (f64::from(RINGS) * (x * x + y * y)).floor();
            let (sin, cos) = (ring * std::f64::consts::TAU / f64::from(RINGS)).sin_cos();
            let (x, y) = (cos * x - sin * y, sin * x + cos * y);
            bilinear(&self.values, side, x, y).round() as i8
        };
        Self {
            values: (0..side * side).map(value).collect(),
            ..self.clone()
        }
    }

    /// What hides the ball, one a value: what is darker than this value and larger than a disc of so many radians.
    pub(crate) fn cover(&self, darkest: f64, radius: f64) -> Vec<bool> {
        let along = |cell: usize| 2.0 * (cell as f64 + 0.5) / self.side as f64 - 1.0;
        let limb = 1.0 - self.horizon * self.horizon;
        let is_light = |(at, value): (usize, &i8)| {
            let (x, y) = (along(at % self.side), along(at / self.side));
            STEP * f64::from(*value) > darkest && x * x + y * y < limb
        };
        let light: Vec<bool> = self.values.iter().enumerate().map(is_light).collect();
        opened(&light, self.side, 0.5 * self.side as f64 * radius)
    }

    /// Whether something hides the ball at a direction of the view frame that is visible.
    pub fn is_covered(&self, direction: &Vec3) -> bool {
        let cell = |x: f64| {
            let at = 0.5 * self.side as f64 * (x + 1.0);
            (at.max(0.0) as usize).min(self.side - 1)
        };
        let at = cell(-direction.y) * self.side + cell(direction.x);
        self.covered.get(at).copied().unwrap_or(false)
    }

    /// Turns about x and y that the outline's error feigns, radians: their standard deviation.
    pub fn center_sigma(&self) -> f64 {
        self.center_sigma
    }

    /// How many of so many places all over the ball share a value, at least 1: they are no more independent than the values under them.
    pub fn places_a_value(&self, places: usize) -> f64 {
        let values = std::f64::consts::PI * (self.side * self.side) as f64;
        (places as f64 / values).max(1.0)
    }
}
