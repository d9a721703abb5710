//! The ball cut out at one scale and one brightness, whatever the camera: the input of the
//! detectors.
//!
//! The circle's center is mapped to the middle of [`SIZE`] x [`SIZE`] values, its radius is
//! [`RADIUS`] values. Where the image is finer, each value is the mean over its square; where it is
//! coarser, values are interpolated. Values are then shifted and scaled to mean 0 and standard
//! deviation 1 over the ball, and set to 0 from [`RIM`] radii outwards: the background carries no
//! information about dots.

use crate::image::GrayImage;
use crate::vision::optics::camera::{BallCircle, Pixel};

/// Side of a patch.
pub const SIZE: usize = 64;
/// The ball's radius in a patch.
pub const RADIUS: f64 = 28.0;
/// Values farther out, in radii, are 0.
pub const RIM: f64 = 1.1;
/// Samples a side of a value's square, at most: of a ball of 3 584 pixels every one is read.
const MAX_FINE: usize = 64;
/// Capacity for as many beforehand: for balls of up to 448 pixels.
const EXPECTED_FINE: usize = 8;
/// Minimum standard deviation over the ball: a plain ball's noise is not blown up beyond that.
const MIN_SPREAD: f32 = 0.01;

/// Values about the rim of a covering outline that show neither the one nor the other; fewest values of a region with a level of its own.
const EDGE: f64 = 1.5;
const MIN_REGION: usize = 24;

/// How a ball lies in a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Framing {
    /// The ball's radius, values.
    pub radius: f64,
    /// Values farther out, in radii, are 0.
    pub rim: f64,
    /// Mean and standard deviation are taken up to here, in radii.
    pub scaled_by: f64,
    /// Whether values beyond the image are 0 rather than those of its border.
    pub is_blank_outside: bool,
}

impl Framing {
    /// For dots: the ball fills the patch, and what is behind it says nothing.
    pub const DOTS: Self = Self {
        radius: RADIUS,
        rim: RIM,
        scaled_by: 0.97,
        is_blank_outside: false,
    };
    /// For outlines: with what is around the ball.
    pub const OUTLINE: Self = Self {
        radius: 20.0,
        rim: f64::INFINITY,
        scaled_by: f64::INFINITY,
        is_blank_outside: true,
    };
}

/// A ball, cut out.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    values: Vec<f32>,
    circle: BallCircle,
    framing: Framing,
    /// Mean and standard deviation over the ball before the values were scaled.
    levels: [f32; 2],
    columns: PatchSide,
    rows: PatchSide,
    /// Pixels of the image, summed over the rows of one of values.
    summed: Vec<f32>,
}

/// Where a sample lies between two pixels of a row or of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Between {
    /// The first of them.
    at: u32,
    /// How far beyond it.
    beyond: f32,
}

/// The samples of values along a side of a patch.
#[derive(Debug, Clone, PartialEq)]
struct PatchSide {
    places: Vec<Between>,
    /// Samples of a value.
    fine: usize,
    /// Pixels of the image.
    count: usize,
    /// Which of the values have their middle within the image.
    inside: Vec<bool>,
}

impl Default for PatchSide {
    fn default() -> Self {
        Self {
            places: Vec::with_capacity(SIZE * EXPECTED_FINE),
            fine: 1,
            count: 0,
            inside: Vec::with_capacity(SIZE),
        }
    }
}

impl PatchSide {
    /// Of a ball whose center is at `center` in an image of so many pixels along this side.
    fn look(&mut self, center: f64, step: f64, fine: usize, count: usize) {
        (self.fine, self.count) = (fine, count);
        let place = |k: usize| {
            let at = (k as f64 + 0.5) / fine as f64 - 0.5 - MIDDLE;
            // Outside stands the border.
            let at = (center + step * at).clamp(0.0, (count - 1) as f64);
            let first = at as u32;
            let beyond = (at - f64::from(first)) as f32;
            Between { at: first, beyond }
        };
        self.places.clear();
        self.places.extend((0..SIZE * fine).map(place));
        let ends = -0.5..=count as f64 - 0.5;
        let is_inside = |k: usize| ends.contains(&(center + step * (k as f64 - MIDDLE)));
        self.inside.clear();
        self.inside.extend((0..SIZE).map(is_inside));
    }

    /// The samples of a value: the pixels on both sides, and how far each lies beyond the first.
    fn of(&self, value: usize) -> impl Iterator<Item = ([usize; 2], f32)> + '_ {
        let places = &self.places[value * self.fine..][..self.fine];
        places.iter().map(|place| {
            let at = place.at as usize;
            ([at, (at + 1).min(self.count - 1)], place.beyond)
        })
    }

    /// The first pixel that is read, and how many.
    fn range(&self) -> (usize, usize) {
        let ends = [self.places.first(), self.places.last()];
        let [first, last] = ends.map(|place| place.map_or(0, |place| place.at as usize));
        (first, (last + 2).min(self.count) - first)
    }
}

impl Default for Patch {
    /// An empty patch for dots, to be filled by [`Patch::cut_into`].
    fn default() -> Self {
        Self::new(Framing::DOTS)
    }
}

impl Patch {
    /// An empty patch, to be filled by [`Patch::cut_into`].
    pub fn new(framing: Framing) -> Self {
        Self {
            values: vec![0.0; SIZE * SIZE],
            circle: BallCircle::new(Pixel::default(), framing.radius),
            framing,
            levels: [0.0, 1.0],
            columns: PatchSide::default(),
            rows: PatchSide::default(),
            summed: Vec::with_capacity(SIZE * EXPECTED_FINE),
        }
    }

    /// Cuts the ball out of an image, framed for dots.
    pub fn cut(image: &GrayImage, circle: &BallCircle) -> Self {
        let mut patch = Self::default();
        patch.cut_into(image, circle);
        patch
    }

    /// As [`Patch::cut`], into existing memory.
    pub fn cut_into(&mut self, image: &GrayImage, circle: &BallCircle) {
        self.circle = *circle;
        let Framing {
            radius,
            rim,
            scaled_by,
            is_blank_outside,
        } = self.framing;
        let step = self.step();
        // Samples a side of a value's square, so that none of the image's pixels is passed over.
        let fine = (step.ceil() as usize).clamp(1, MAX_FINE);
        self.columns
            .look(circle.center.u, step, fine, image.width());
        self.rows.look(circle.center.v, step, fine, image.height());
        let (columns, rows) = (&self.columns, &self.rows);
        let (first, width) = columns.range();
        let weight = 1.0 / (fine * fine) as f32;
        let (mut sum, mut squares, mut count) = (0f64, 0f64, 0f64);
        for (row, values) in self.values.chunks_exact_mut(SIZE).enumerate() {
            self.summed.clear();
            self.summed.resize(width, 0.0);
            for (at, beyond) in rows.of(row) {
                let [above, below] = at.map(|v| image.row(v, first, width));
                for ((sum, a), b) in self.summed.iter_mut().zip(above).zip(below) {
                    *sum += a + beyond * (b - a);
                }
            }
            for (column, value) in values.iter_mut().enumerate() {
                let out2 = squared_out(column, row);
                let is_outside = !(columns.inside[column] && rows.inside[row]);
                if out2 > (rim * radius).powi(2) || (is_blank_outside && is_outside) {
                    *value = f32::NAN;
                    continue;
                }
                let sampled = columns.of(column).map(|(at, beyond)| {
                    let [a, b] = at.map(|u| self.summed[u - first]);
                    a + beyond * (b - a)
                });
                *value = sampled.sum::<f32>() * weight;
                if out2 < (scaled_by * radius).powi(2) {
                    sum += f64::from(*value);
                    squares += f64::from(*value) * f64::from(*value);
                    count += 1.0;
                }
            }
        }
        let count = count.max(1.0);
        let mean = sum / count;
        let spread = ((squares / count - mean * mean).max(0.0).sqrt() as f32).max(MIN_SPREAD);
        self.levels = [mean as f32, spread];
        for value in &mut self.values {
            *value = if value.is_nan() {
                0.0
            } else {
                (*value - mean as f32) / spread
            };
        }
    }

    /// Takes out what other balls' outlines cover: light that they add, which leaves the ball's dots as deep as they are, or all that is
    /// seen there. `seen_at` leads from the pixels that the patch was cut from to those of the outlines.
    pub(crate) fn uncover(
        &mut self,
        covers: &[BallCircle],
        is_added: bool,
        seen_at: impl Fn(Pixel) -> Pixel,
    ) {
        let own = (self.framing.scaled_by * self.framing.radius).powi(2);
        let keys = self.covered(covers, seen_at);
        let is_inside = |at: usize| squared_out(at % SIZE, at / SIZE) < own;
        let mean = |key: usize| -> Option<f32> {
            let within = |at: &usize| keys[*at].is_some_and(|k| k.0 == key) && is_inside(*at);
            let of_key: Vec<f32> = (0..SIZE * SIZE)
                .filter(within)
                .map(|at| self.values[at])
                .collect();
            (of_key.len() >= MIN_REGION).then(|| of_key.iter().sum::<f32>() / of_key.len() as f32)
        };
        let Some(bare) = mean(0) else {
            return;
        };
        let regions = 1usize << covers.len();
        let offsets: Vec<Option<f32>> = (0..regions).map(|k| mean(k).map(|m| m - bare)).collect();
        for (value, key) in self.values.iter_mut().zip(&keys) {
            match key {
                None | Some((0, _)) => {}
                Some((key, is_edge)) => match offsets[*key].filter(|_| is_added && !is_edge) {
                    Some(offset) => *value -= offset,
                    None => *value = bare,
                },
            }
        }
        let inside = || (0..SIZE * SIZE).filter(|at| is_inside(*at));
        let count = inside().count() as f32;
        let middle = inside().map(|at| self.values[at]).sum::<f32>() / count;
        let squares = inside()
            .map(|at| (self.values[at] - middle).powi(2))
            .sum::<f32>();
        let spread = (squares / count).sqrt().max(MIN_SPREAD / self.levels[1]);
        for (value, key) in self.values.iter_mut().zip(&keys) {
            if key.is_some() {
                *value = (*value - middle) / spread;
            }
        }
        self.levels = [
            self.levels[0] + middle * self.levels[1],
            spread * self.levels[1],
        ];
    }

    /// For each value the outlines that cover it, and whether the rim of one crosses it; none beyond the ball.
    fn covered(
        &self,
        covers: &[BallCircle],
        seen_at: impl Fn(Pixel) -> Pixel,
    ) -> Vec<Option<(usize, bool)>> {
        let rim = (self.framing.rim * self.framing.radius).powi(2);
        let step = self.step();
        let of = |at: usize| {
            let (column, row) = (at % SIZE, at / SIZE);
            if squared_out(column, row) > rim {
                return None;
            }
            let Pixel { u, v } = seen_at(self.to_image(column as f64, row as f64));
            let out = |c: &BallCircle| ((u - c.center.u).hypot(v - c.center.v) - c.radius) / step;
            let covering = covers.iter().map(out).enumerate();
            let key = covering
                .clone()
                .filter(|(_, out)| *out < EDGE)
                .fold(0, |key, (k, _)| key | 1 << k);
            let is_edge = covering.into_iter().any(|(_, out)| out.abs() < EDGE);
            Some((key, is_edge))
        };
        (0..SIZE * SIZE).map(of).collect()
    }

    /// The values, row after row from the top.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The brightness of a value 0, and that of a difference of 1.
    pub fn levels(&self) -> [f32; 2] {
        self.levels
    }

    /// The circle that was cut out.
    pub fn circle(&self) -> &BallCircle {
        &self.circle
    }

    /// Pixels of the image per value of the patch.
    pub fn step(&self) -> f64 {
        self.circle.radius / self.framing.radius
    }

    /// Where a position in the patch (column, row) lies in the image.
    pub fn to_image(&self, column: f64, row: f64) -> Pixel {
        Pixel {
            u: self.circle.center.u + self.step() * (column - MIDDLE),
            v: self.circle.center.v + self.step() * (row - MIDDLE),
        }
    }

    /// Where a position in the image lies in the patch: (column as u, row as v).
    pub fn from_image(&self, pixel: Pixel) -> Pixel {
        in_patch(&self.circle, self.step(), pixel)
    }
}

/// The patch's middle, in columns and rows.
pub const MIDDLE: f64 = 0.5 * (SIZE as f64 - 1.0);

/// Where a position in the image lies in the patch of a ball, `step` pixels a value.
fn in_patch(circle: &BallCircle, step: f64, pixel: Pixel) -> Pixel {
    Pixel {
        u: MIDDLE + (pixel.u - circle.center.u) / step,
        v: MIDDLE + (pixel.v - circle.center.v) / step,
    }
}

fn squared_out(column: usize, row: usize) -> f64 {
    (column as f64 - MIDDLE).powi(2) + (row as f64 - MIDDLE).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each value is the mean over its square of what stands between pixels, wherever the ball lies and however large it is.
    #[test]
    fn a_value_is_the_mean_of_its_square() {
        let image =
            GrayImage::from_fn(90, 70, |u, v| ((7 * u + 13 * v + u * v) % 31) as f32 / 31.0);
        for (u, v, radius) in [(40.3, 35.8, 11.0), (44.0, 30.2, 60.0), (3.1, 66.4, 29.0)] {
            let circle = BallCircle::new(Pixel { u, v }, radius);
            let patch = Patch::cut(&image, &circle);
            let (step, [mean, spread]) = (patch.step(), patch.levels());
            let fine = step.ceil() as usize;
            for (row, column) in [(32, 31), (10, 25), (40, 50), (55, 20)] {
                let mut sum = 0.0;
                for k in 0..fine * fine {
                    let at = |value: usize, k: usize| {
                        value as f64 + (k as f64 + 0.5) / fine as f64 - 0.5
                    };
                    let Pixel { u, v } = patch.to_image(at(column, k % fine), at(row, k / fine));
                    sum += image.sample(u, v);
                }
                let expected = (sum / (fine * fine) as f32 - mean) / spread;
                let found = patch.values()[row * SIZE + column];
                assert!((found - expected).abs() < 1e-4, "{found} for {expected}");
            }
        }
    }
}
