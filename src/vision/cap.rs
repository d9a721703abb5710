//! The middle of a drawn dot by the image's own pixels.
//!
//! A dot is a cap of the angular radius `rho` about the direction `m`. The surface about it shines as Lambert's law has it,
//! linear in the direction `d`; the ink takes the share `k` of that; the edge is blurred by the lens, the pixel and the motion
//! together, as by a Gaussian of `s` pixels; the camera stores about the square root of the light:
//!
//! ```text
//! I(p)^2 = (l + g . (d - m)) (1 - k Phi((c - |d - m|) / (w s))),   c = 2 sin(rho / 2),   w = d|d - m| / dp
//! ```
//!
//! with `d = d(p)` the direction that is seen at the pixel `p` and `w` the chord's change along a pixel across the edge. So the
//! middle of the cap is found, not the middle of its image, which lies elsewhere. A dark dot blurred in the light seems smaller
//! once it is stored, and off the middle of the ball nearer to it: without the square by 0.03 px, balls of any size. Eight
//! unknowns: two of `m`, `rho`, `s`, `k`, `l` and two of `g` in the tangent plane; Gauss-Newton with the weights of Student's
//! distribution, so that print and glare beside the dot count little. The covariance is that of the residuals, and of what the
//! model leaves out.

use nalgebra::{Matrix2, Matrix3x2, SMatrix, SVector, Vector2};

use super::camera::{BallView, Pixel};
use crate::geometry::{Vec3, tangent_frame};
use crate::image::GrayImage;
use crate::stats::{normal_cdf, normal_density};

/// Maximum number of steps.
const STEPS: usize = 8;
/// A shorter step of the middle, over the dot's radius, ends the iteration.
const CONVERGED: f64 = 5e-3;
/// Angular radii that the iteration starts from where no dot of the ball is known, radians.
const RADII: [f64; 3] = [0.09, 0.06, 0.13];
/// Angular radii that a dot may have, radians.
const RADIUS: std::ops::RangeInclusive<f64> = 0.025..=0.3;
/// The blur's deviation that the iteration starts from: pixels, or this part of the ball's radius where that is more.
const BLUR: (f64, f64) = (0.7, 0.02);
/// The least blur, pixels: a pixel's own.
const LEAST_BLUR: f64 = 0.25;
/// How far beyond the edge pixels count: deviations of the blur, and pixels.
const MARGIN: (f64, f64) = (2.5, 1.0);
/// Fewer pixels fix no dot.
const MIN_PIXELS: usize = 16;
/// More pixels add nothing but time: of a larger dot every second, third, ... row and column is read.
const MANY_PIXELS: f64 = 1200.0;
/// Degrees of freedom of the pixels' distribution.
const DEGREES: f64 = 5.0;
/// The least light, of full.
const DARKEST: f64 = 1e-4;
/// So many deviations of the blur from the edge is no ink, or nothing else.
const FLAT: f64 = 4.0;
/// The least share of the light that a dot's ink takes.
const MIN_INK: f64 = 0.15;
/// The least ratio of that to the residuals' deviation.
const MIN_CONTRAST: f64 = 4.0;
/// Maximum distance of the middle from where it is expected, dot radii.
const MAX_SHIFT: f64 = 0.7;
/// Standard deviation per tangent axis of what the model leaves out, radians: shading that is not linear, ink that is not
/// even.
const MODEL_ERROR: f64 = 3e-4;

/// Number of unknowns.
const UNKNOWNS: usize = 8;
type Unknowns = SVector<f64, UNKNOWNS>;
type Information = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// A cap's size and sharpness.
#[derive(Debug, Clone, Copy)]
pub(super) struct CapShape {
    /// Angular radius, radians.
    pub radius: f64,
    /// Standard deviation of the edge's blur, pixels.
    pub blur: f64,
}

/// A fitted cap.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cap {
    /// Where its middle is seen.
    pub pixel: Pixel,
    /// Covariance of that (u, v), px^2.
    pub covariance: Matrix2<f64>,
    pub shape: CapShape,
}

/// A pixel.
#[derive(Debug, Clone, Copy)]
struct Sample {
    direction: Vec3,
    /// Change of the direction along a pixel of u and v.
    by_pixel: Matrix3x2<f64>,
    value: f64,
}

/// Fits caps; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct CapFitter {
    samples: Vec<Sample>,
}

/// Where an iteration stands.
struct State {
    middle: Vec3,
    shape: CapShape,
    ink: f64,
    light: f64,
    /// Change of the light along the tangents at the middle the iteration started from.
    slope: Vector2<f64>,
}

/// The weighted normal equations at a state.
struct Equations {
    information: Information,
    gradient: Unknowns,
    /// Weighted mean square of the residuals.
    variance: f64,
}

impl CapFitter {
    /// Fits the dot that is seen near a pixel of an image whose first pixel is `origin` of the view's; `None` where there is none
    /// to be seen. `shape` is that of the ball's other dots.
    pub fn fit(
        &mut self,
        image: &GrayImage,
        origin: Pixel,
        view: &BallView,
        near: Pixel,
        shape: Option<CapShape>,
    ) -> Option<Cap> {
        let expected = view.direction(near)?;
        let radius = view.circle().radius;
        let blur = BLUR.0.max(BLUR.1 * radius);
        let fresh = RADII.map(|radius| CapShape { radius, blur });
        let known = shape.and_then(|shape| self.fit_from(image, origin, view, &expected, shape));
        let mut tried = fresh.into_iter();
        known.or_else(|| tried.find_map(|s| self.fit_from(image, origin, view, &expected, s)))
    }

    fn fit_from(
        &mut self,
        image: &GrayImage,
        origin: Pixel,
        view: &BallView,
        expected: &Vec3,
        shape: CapShape,
    ) -> Option<Cap> {
        self.sample(image, origin, view, expected, shape)?;
        let tangents = tangent_frame(expected);
        let mut state = self.start(expected, shape);
        let mut variance = None;
        for _ in 0..STEPS {
            let Equations {
                information,
                gradient,
                variance: now,
            } = self.equations(&state, &tangents, variance)?;
            let step = information.cholesky()?.solve(&gradient);
            let moved = tangents[0] * step[0] + tangents[1] * step[1];
            state.middle = (state.middle + moved).normalize();
            let change = |now: f64, by: f64| (now + by).clamp(0.5 * now, 2.0 * now);
            state.shape.radius = change(state.shape.radius, step[2]);
            state.shape.blur = change(state.shape.blur, step[3]).max(LEAST_BLUR);
            state.ink += step[4];
            state.light += step[5];
            state.slope += step.fixed_rows::<2>(6);
            let is_done = variance.is_some() && moved.norm() < CONVERGED * state.shape.radius;
            variance = Some(now);
            let shift = (state.middle - expected).norm();
            if !(RADIUS.contains(&state.shape.radius) && shift < MAX_SHIFT * state.shape.radius) {
                return None;
            }
            if is_done {
                return judged(view, &state, &tangents, &information, now);
            }
        }
        None
    }

    /// Reads the pixels about a dot.
    fn sample(
        &mut self,
        image: &GrayImage,
        origin: Pixel,
        view: &BallView,
        expected: &Vec3,
        shape: CapShape,
    ) -> Option<()> {
        let CapShape { radius, blur } = shape;
        // Within so many pixels of the rim its blur is seen.
        let rim = (2.0 * (MARGIN.0 * blur + 0.5) / view.circle().radius).sqrt();
        let angle = (expected.z - view.horizon()).clamp(-1.0, 1.0).acos() + radius;
        if angle.cos() < rim {
            return None;
        }
        let by_direction = view.jacobian(expected);
        let margin = MARGIN.0 * blur + MARGIN.1;
        let at = view.project(expected);
        let sides = [0, 1].map(|row| by_direction.row(row).norm() * 1.3 * radius + margin);
        let range = |middle: f64, side: f64, count: usize| {
            let from = (middle - side).ceil().max(1.0);
            let to = (middle + side).floor().min(count as f64 - 2.0);
            (from <= to).then_some((from as usize, to as usize))
        };
        let (left, right) = range(at.u - origin.u, sides[0], image.width())?;
        let (top, bottom) = range(at.v - origin.v, sides[1], image.height())?;
        let pixels = ((right - left + 1) * (bottom - top + 1)) as f64;
        let stride = (pixels / MANY_PIXELS).sqrt().ceil().max(1.0) as usize;
        self.samples.clear();
        for v in (top..=bottom).step_by(stride) {
            let row = image.row(v, 0, image.width());
            for u in (left..=right).step_by(stride) {
                let place = Pixel {
                    u: u as f64 + origin.u,
                    v: v as f64 + origin.v,
                };
                let Some(direction) = view.direction(place) else {
                    continue;
                };
                if direction.z - view.horizon() < rim {
                    continue;
                }
                let by_pixel = view.by_pixel(&direction)?;
                let chord = direction - expected;
                let length = chord.norm();
                let across = (by_pixel.transpose() * chord).norm() / length.max(1e-9);
                if length - 1.3 * radius > margin * across {
                    continue;
                }
                self.samples.push(Sample {
                    direction,
                    by_pixel,
                    value: f64::from(row[u]),
                });
            }
        }
        (self.samples.len() >= MIN_PIXELS).then_some(())
    }

    /// Light and ink by the pixels within and without.
    fn start(&self, expected: &Vec3, shape: CapShape) -> State {
        let (mut inside, mut outside) = ([0.0, 0.0], [0.0, 0.0]);
        for sample in &self.samples {
            let length = (sample.direction - expected).norm() / shape.radius;
            let sum = match length {
                l if l < 0.7 => &mut inside,
                l if l > 1.1 => &mut outside,
                _ => continue,
            };
            sum[0] += sample.value.powi(2);
            sum[1] += 1.0;
        }
        let mean = |[sum, count]: [f64; 2]| if count > 0.0 { sum / count } else { 0.5 };
        let light = mean(outside).max(1e-3);
        State {
            middle: *expected,
            shape,
            ink: 1.0 - mean(inside) / light,
            light,
            slope: Vector2::zeros(),
        }
    }

    fn equations(
        &self,
        state: &State,
        tangents: &[Vec3; 2],
        variance: Option<f64>,
    ) -> Option<Equations> {
        let State {
            middle,
            shape,
            ink,
            light,
            slope,
        } = state;
        let edge = 2.0 * (0.5 * shape.radius).sin();
        let mut information = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut gradient = [0.0; UNKNOWNS];
        let (mut squares, mut weights) = (0.0, 0.0);
        for sample in &self.samples {
            let away = sample.direction - middle;
            let length = away.norm().max(1e-9);
            let across = (sample.by_pixel.transpose() * away).norm() / length;
            let width = across.max(1e-9) * shape.blur;
            let z = (edge - length) / width;
            let (covered, density) = match z.abs() < FLAT {
                true => (normal_cdf(z), normal_density(z)),
                false => (f64::from(z > 0.0), 0.0),
            };
            let along = [tangents[0].dot(&away), tangents[1].dot(&away)];
            let lit = light + slope[0] * along[0] + slope[1] * along[1];
            let left = 1.0 - ink * covered;
            let shown = (lit * left).max(DARKEST).sqrt();
            let residual = sample.value - shown;
            // d I / d (I^2), d I / d z, and d z / d m = (d - m) / (|d - m| w s).
            let rate = 0.5 / shown;
            let by_z = -rate * lit * ink * density;
            let by_middle = by_z / (length * width);
            let left = rate * left;
            let j = [
                by_middle * along[0] - left * slope[0],
                by_middle * along[1] - left * slope[1],
                by_z / width,
                -by_z * z / shape.blur,
                -rate * lit * covered,
                left,
                left * along[0],
                left * along[1],
            ];
            let squared = residual * residual;
            let weight = variance.map_or(1.0, |v| (DEGREES + 1.0) / (DEGREES + squared / v));
            for (k, row) in information.iter_mut().enumerate() {
                let weighted = weight * j[k];
                for (cell, other) in row[..=k].iter_mut().zip(&j) {
                    *cell += weighted * other;
                }
                gradient[k] += weighted * residual;
            }
            squares += weight * squared;
            weights += weight;
        }
        let symmetric = |row: usize, column: usize| information[row.max(column)][row.min(column)];
        let free = self.samples.len().saturating_sub(UNKNOWNS);
        let share = free as f64 / self.samples.len() as f64;
        let variance = squares / (weights * share);
        (variance.is_finite() && free > 0).then(|| Equations {
            information: Information::from_fn(symmetric),
            gradient: Unknowns::from(gradient),
            // What is exact to the last digit of a byte is not more exact than that.
            variance: variance.max(1e-8),
        })
    }
}

/// The cap, where it is a dot.
fn judged(
    view: &BallView,
    state: &State,
    tangents: &[Vec3; 2],
    information: &Information,
    variance: f64,
) -> Option<Cap> {
    let contrast = state.light.sqrt() * (1.0 - (1.0 - state.ink).max(0.0).sqrt());
    if state.ink < MIN_INK || contrast < MIN_CONTRAST * variance.sqrt() {
        return None;
    }
    // The information of Student's distribution is less than its weights' by this.
    let spread = variance * (DEGREES + 3.0) / (DEGREES + 1.0);
    let covariance = information.try_inverse()? * spread;
    let of_middle = covariance.fixed_view::<2, 2>(0, 0)
        + Matrix2::from_diagonal_element(MODEL_ERROR * MODEL_ERROR);
    let to_pixel = view.jacobian(&state.middle) * Matrix3x2::from_columns(tangents);
    let covariance = to_pixel * of_middle * to_pixel.transpose();
    Some(Cap {
        pixel: view.project(&state.middle),
        covariance: 0.5 * (covariance + covariance.transpose()),
        shape: state.shape,
    })
}
