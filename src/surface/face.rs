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

/// Values over the ball's near side, as a [`Face`] has them.
pub(crate) struct FaceSamples {
    pub values: Vec<f32>,
    side: usize,
    horizon: f64,
}

impl FaceSamples {
    /// By the brightness at pixels of an image, under whose `view` the ball's radius is so many known pixels.
    pub fn take(sample: impl Fn(Pixel) -> f32, radius: f64, view: &BallView) -> Self {
        let side = (2.0 * radius).clamp(SIDE[0], SIDE[1]).round() as usize;
        // A value of a large ball is the mean of so many rays squared.
        let fine = (2.0 * radius / side as f64).ceil().max(1.0) as usize;
        let horizon = view.horizon();
        let mut values = Vec::with_capacity(side * side);
        for row in 0..side {
            for column in 0..side {
                let (mut sum, mut count) = (0.0, 0);
                for ray in 0..fine * fine {
                    let along = |cell: usize, part: usize| {
                        let at = cell as f64 + (part as f64 + 0.5) / fine as f64;
                        2.0 * at / side as f64 - 1.0
                    };
                    let (x, y) = (along(column, ray % fine), -along(row, ray / fine));
                    let square = 1.0 - x * x - y * y;
                    if square > horizon * horizon {
                        sum += sample(view.project(&Vec3::new(x, y, square.sqrt())));
                        count += 1;
                    }
                }
                values.push(if count > 0 { sum / count as f32 } else { 0.0 });
            }
        }
        Self {
            values,
            side,
            horizon,
        }
    }

    /// The face of these values. `center_sigma` is the standard deviation of the outline's center over the radius.
    pub fn to_face(&self, center_sigma: f64) -> Face {
        let step = |value: &f32| (f64::from(*value) / STEP).round().clamp(-127.0, 127.0) as i8;
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
        let mut samples = FaceSamples::take(sample, view.circle().radius / grid.side, view);
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
        let in_sight = |p: &&Vec3| depth(p, horizon) > READ;
        let (sum, count) = self
            .places
            .iter()
            .filter(in_sight)
            .fold((0.0, 0.0), |(sum, count), p| {
                (sum + bilinear(values, side, p.x, p.y), count + 1.0)
            });
        let dark = (DARK * sum / f64::max(count, 1.0)).max(1e-3) as f32;
        values.iter_mut().for_each(|v| *v = (*v + dark).ln());
        let read: Vec<Option<f64>> = self
            .places
            .iter()
            .map(|p| in_sight(&p).then(|| bilinear(values, side, p.x, p.y)))
            .collect();
        let means: Vec<f32> = self
            .about
            .iter()
            .map(|about| {
                let (sum, count) = about
                    .iter()
                    .filter_map(|k| read[*k as usize])
                    .fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
                (sum / f64::max(count, 1.0)) as f32
            })
            .collect();
        let along = |k: usize| 2.0 * (k as f64 + 0.5) / side as f64 - 1.0;
        for (at, value) in values.iter_mut().enumerate() {
            let (x, y) = (along(at % side), -along(at / side));
            *value -= bilinear(&means, COARSE, x, y) as f32;
        }
    }
}

/// How far a direction faces the camera: 0 at the limb, 1 in the middle.
fn depth(direction: &Vec3, horizon: f64) -> f64 {
    (direction.z - horizon) / (1.0 - horizon)
}

/// The value at x and y of a square of `side` values a row over -1 to 1.
fn bilinear<T: Copy + Into<f32>>(values: &[T], side: usize, x: f64, y: f64) -> f64 {
    let half = 0.5 * side as f64;
    let last = (side - 1) as f64;
    let place = |x: f64| (half * (x + 1.0) - 0.5).clamp(0.0, last);
    let (u, v) = (place(x), place(-y));
    let (i, j) = (u as usize, v as usize);
    let (i1, j1) = ((i + 1).min(side - 1), (j + 1).min(side - 1));
    let (a, b) = ((u - i as f64) as f32, (v - j as f64) as f32);
    let value = |i: usize, j: usize| -> f32 { values[j * side + i].into() };
    let above = value(i, j) + a * (value(i1, j) - value(i, j));
    let below = value(i, j1) + a * (value(i1, j1) - value(i, j1));
    f64::from(above + b * (below - above))
}

impl Face {
    /// How far a direction of the view frame faces the camera: 0 at the limb, 1 in the middle.
    pub fn depth(&self, direction: &Vec3) -> f64 {
        depth(direction, self.horizon)
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
