//! The middle of a drawn dot by the image's own pixels.
//!
//! A dot is a cap of the angular radius `rho` about the direction `m`: a disc in the plane `x . m = cos rho`. A pixel's ray meets the
//! sphere in `d` and that plane in `x`. The surface about the dot shines as Lambert's law has it, linear in the direction; the ink
//! takes the share `k` of that; lens, pixel and motion blur the image as by a Gaussian of `s` pixels, which in the plane is one of
//! the deviations `a` along `y = x - m cos rho` and `b` across it:
//!
//! ```text
//! light(p) = (l + g . (d - m)) (1 - k Phi((sin rho - sqrt(|y|^2 + b^2)) / a)),   light = (1 - q) I + q I^2
//! ```
//!
//! with `I` the stored value: the tone curve is a line for `q = 0` and about sRGB's for `q = 1`. So the middle of the cap is found,
//! not the middle of its image, which lies elsewhere. The projection from the image to the plane is that of a plane: blur is the
//! same all over the dot, where on the sphere it grows towards the limb and shifts the dot. A dark dot blurred in the light seems smaller
//! once it is stored, and off the middle of the ball nearer to it by 0.03 px. All dots of an image share the tone curve, so that
//! each is fitted with what those before say of it. Nine unknowns: two of `m`, `rho`, `s`, `k`, `l`, two of `g` in the
//! tangent plane, and `q`; Gauss-Newton with the weights of Student's distribution, so that print and glare beside the dot count
//! little. The covariance is that of the residuals, and of what the model leaves out.

mod disc;
#[cfg(test)]
mod tests;
mod tone;

use fearless_simd::{Level, Simd, dispatch};
use nalgebra::{Matrix2, Matrix3, Matrix3x2, SMatrix, SVector, Vector3};

use self::disc::{CapPixels, DARKEST, Disc, DiscState, cap_pixel};
pub(crate) use self::tone::{CapShape, Tone};
use crate::fit::{LANES, LanePixels, LaneSums, Student, Sums};
use crate::geometry::{Vec3, tangent_frame};
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallView, Pixel};

/// Maximum number of steps.
const STEPS: usize = 8;
/// A shorter step of the middle, over the dot's radius, ends the iteration: the next would be a tenth of it.
const CONVERGED: f64 = 1e-2;
/// Maximum number of steps of the blur's iteration: a long smear is far from the round blur it starts from.
const BLUR_STEPS: usize = 24;
/// The part of a step that is gone: whole ones go to and fro where a smear is long.
const BLUR_STEP: f64 = 0.6;
/// A smaller change of the blur's variance, over that, ends its iteration.
const BLUR_CONVERGED: f64 = 0.02;
/// Angular radii that the iteration starts from where no dot of the ball is known, radians.
const RADII: [f64; 3] = [0.09, 0.06, 0.13];
/// Angular radii that a dot may have, radians.
const RADIUS: std::ops::RangeInclusive<f64> = 0.012..=0.3;
/// Pixels count up to so many dot radii, and beyond by so many deviations of the blur and so many pixels.
const MARGIN: (f64, f64, f64) = (1.2, 2.5, 1.0);
/// Fewer pixels fix no dot.
const MIN_PIXELS: usize = 16;
/// More pixels add nothing but time: of a larger dot, away from its edge, every second, third, ... row and column is read.
const MANY_PIXELS: f64 = 150.0;
/// Capacity for the pixels of a dot beforehand.
const EXPECTED_PIXELS: usize = 4096;
/// The pixels' loss.
const LOSS: Student = Student::new(5, 1);
/// The least share of the light that a dot's ink takes.
const MIN_INK: f64 = 0.15;
/// The least ratio of that to the residuals' deviation.
const MIN_CONTRAST: f64 = 4.0;
/// Maximum distance of the middle from where it is expected, dot radii.
const MAX_SHIFT: f64 = 0.7;
/// Standard deviation per axis of what the model leaves out, radians and pixels: shading that is not linear and ink that is not
/// even; what lies between pixels.
const MODEL_ERROR: (f64, f64) = (2e-4, 0.015);
/// And of the blur's deviation for a dot that faces the camera: a smear that is no Gaussian, what lies beside the dot, mosaics and compression.
/// The median of the squared distances is that of their distribution with 0.04, 0.055 and 0.08 at 0.9, 0.6 and 0.4 of facing (dots of 1 200 images
/// of 40 to 200 px in all conditions, seeds 641040 to 6410200; half of that with path-traced pictures).
const BLUR_ERROR: f64 = 0.036;
/// It grows towards the limb by this power of the facing; not beyond the least facing.
const LIMB_POWER: f64 = 0.75;
const LEAST_FACING: f64 = 0.2;
/// Within so many deviations of the blur and so many pixels of the rim, what is behind the ball is seen.
const RIM: (f64, f64) = (2.0, 0.5);
/// Variance of the values that the first step supposes.
const FIRST_VARIANCE: f64 = 1e-3;
/// The least variance: what is exact to the last digit of a byte is not more exact than that.
const LEAST_VARIANCE: f64 = 1e-8;

/// Number of unknowns of a cap.
const UNKNOWNS: usize = 9;
/// And with how its blur is stretched.
const STRETCHED: usize = UNKNOWNS + 2;
/// The places of radius, blur and the tone curve's bend among them.
const SHAPE: [usize; 3] = [2, 3, 8];

/// A fitted cap.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cap {
    /// Where its middle is seen.
    pub pixel: Pixel,
    /// Covariance of that (u, v), px^2.
    pub covariance: Matrix2<f64>,
    pub shape: CapShape,
}

/// The covariance of a dot's blur in the image, px^2: `s I + [[p, q], [q, -p]]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DotBlur {
    /// The dot's middle, view frame.
    pub middle: Vec3,
    /// Its angular radius, radians.
    pub radius: f64,
    /// `s, p, q`, px^2.
    pub blur: Vector3<f64>,
    /// Covariance of these, px^4.
    pub covariance: Matrix3<f64>,
}

/// Fits caps; keeps its memory.
#[derive(Debug)]
pub(crate) struct CapFitter {
    level: Level,
    /// The pixels of the dot.
    pixels: LanePixels<4>,
    /// Where the last fit ended that found a cap.
    converged: Option<Converged>,
}

/// A cap that was found, and what it was found by.
#[derive(Debug, Clone, Copy)]
struct Converged {
    state: DiscState,
    tangents: [Vec3; 2],
    shape: CapShape,
    variance: f64,
}

impl Default for CapFitter {
    fn default() -> Self {
        Self {
            level: Level::new(),
            pixels: LanePixels::with_capacity(EXPECTED_PIXELS),
            converged: None,
        }
    }
}

/// The weighted normal equations at a state.
struct CapEquations<const N: usize> {
    information: SMatrix<f64, N, N>,
    gradient: SVector<f64, N>,
    /// Weighted mean square of the residuals.
    variance: f64,
}

impl<const N: usize> CapEquations<N> {
    /// The covariance of the unknowns.
    fn covariance(&self) -> Option<SMatrix<f64, N, N>> {
        let spread = self.variance / LOSS.information();
        Some(self.information.try_inverse()? * spread)
    }
}

impl CapFitter {
    /// Fits the dot that is seen near a pixel of an image; `None` where there is none
    /// to be seen. `shape` is that of the ball's other dots.
    pub fn fit(
        &mut self,
        pixels: &BallPixels<'_>,
        near: Pixel,
        shape: Option<CapShape>,
    ) -> Option<Cap> {
        self.converged = None;
        let expected = pixels.view.direction(near)?;
        if let Some(shape) = shape {
            return self.fit_from(pixels, &expected, shape);
        }
        RADII.into_iter().find_map(|radius| {
            self.fit_from(pixels, &expected, CapShape::first(radius, pixels.view))
        })
    }

    fn fit_from(
        &mut self,
        pixels: &BallPixels<'_>,
        expected: &Vec3,
        shape: CapShape,
    ) -> Option<Cap> {
        let tangents = tangent_frame(expected);
        self.read(pixels, expected, shape)?;
        let mut state = self.start(expected, shape);
        let mut variance = None;
        for _ in 0..STEPS {
            let disc = Disc::new(pixels.view, &state, &tangents)?;
            let now = self.equations::<UNKNOWNS>(&disc, &state, &shape.expected(), variance)?;
            let step = now.information.cholesky()?.solve(&now.gradient);
            let moved = step.fixed_rows::<2>(0).norm();
            state = state.moved(&step, &tangents);
            let shift = (state.middle - expected).norm();
            let radius = state.radius;
            if !(RADIUS.contains(&radius) && shift < MAX_SHIFT * radius) {
                return None;
            }
            if variance.is_some() && moved < CONVERGED * radius {
                self.converged = Some(Converged {
                    state,
                    tangents,
                    shape,
                    variance: now.variance,
                });
                return judged(pixels.view, &state, &tangents, &now, &shape);
            }
            variance = Some(now.variance);
        }
        None
    }

    /// How the dot of the last fit is blurred, by the same pixels; `None` where they do not say.
    pub fn blur(&self, view: &BallView) -> Option<DotBlur> {
        let Converged {
            mut state,
            tangents,
            shape,
            mut variance,
        } = self.converged?;
        // Other dots move otherwise.
        let mut expected = shape.expected();
        expected[1].1 = state.blur * state.blur;
        for _ in 0..BLUR_STEPS {
            let disc = Disc::new(view, &state, &tangents)?;
            let now = self.equations::<STRETCHED>(&disc, &state, &expected, Some(variance))?;
            let step = now.information.cholesky()?.solve(&now.gradient) * BLUR_STEP;
            let before = state.blur;
            state = state.moved(&step, &tangents);
            variance = now.variance;
            if !RADIUS.contains(&state.radius) {
                return None;
            }
            let change =
                2.0 * before * (state.blur - before).abs() + step.fixed_rows::<2>(UNKNOWNS).norm();
            if change < BLUR_CONVERGED * before * before {
                let covariance = now.covariance()?;
                let at = [SHAPE[1], UNKNOWNS, UNKNOWNS + 1];
                // From the deviation to the variance.
                let by = [2.0 * state.blur, 1.0, 1.0];
                return Some(DotBlur {
                    middle: state.middle,
                    radius: state.radius,
                    blur: Vector3::new(state.blur * state.blur, state.stretch.x, state.stretch.y),
                    covariance: Matrix3::from_fn(|i, j| by[i] * covariance[(at[i], at[j])] * by[j]),
                });
            }
        }
        None
    }

    /// Reads the pixels about a dot.
    fn read(&mut self, pixels: &BallPixels<'_>, expected: &Vec3, shape: CapShape) -> Option<()> {
        let CapShape { radius, blur, .. } = shape;
        let BallPixels { gray, view, .. } = pixels;
        let horizon = view.horizon();
        // Within so many pixels of the rim its blur is seen.
        let rim = (2.0 * (RIM.0 * blur + RIM.1) / view.circle().radius).sqrt();
        if expected.z - horizon < rim {
            return None;
        }
        let margin = MARGIN.1 * blur + MARGIN.2;
        let [(left, right), (top, bottom)] = bounds(pixels, expected, MARGIN.0 * radius, margin)?;
        let count = ((right - left + 1) * (bottom - top + 1)) as f64;
        let stride = (count / MANY_PIXELS).sqrt().ceil().max(1.0) as usize;
        let disc = Disc::new(
            view,
            &DiscState::unlit(expected, shape),
            &tangent_frame(expected),
        )?;
        self.pixels.clear();
        let level = self.level;
        for v in top..=bottom {
            let row = gray.row(v, 0, gray.width());
            for from in (left..=right).step_by(LANES) {
                let columns = from..(from + LANES).min(right + 1);
                let directions: [Option<Vec3>; LANES] = std::array::from_fn(|lane| {
                    let u = from + lane;
                    let direction = columns
                        .contains(&u)
                        .then(|| view.direction(pixels.place(u, v)))??;
                    (direction.z - horizon >= rim).then_some(direction)
                });
                let Some(any) = directions.iter().flatten().next() else {
                    continue;
                };
                let mut four = CapPixels::one(&cap_pixel(any, 0.0));
                for (lane, direction) in directions.iter().enumerate() {
                    four.set(lane, &cap_pixel(direction.as_ref().unwrap_or(any), 0.0));
                }
                let [of_edge, of_surroundings] =
                    dispatch!(level, simd => disc.beyond(simd, &four, MARGIN.0));
                for (lane, direction) in directions.iter().enumerate() {
                    let Some(direction) = direction else {
                        continue;
                    };
                    let u = from + lane;
                    let is_even = u % stride == 0 && v % stride == 0;
                    let is_read = is_even || of_edge[lane].abs() <= margin;
                    if is_read && of_surroundings[lane] <= margin {
                        self.pixels.push(&cap_pixel(direction, f64::from(row[u])));
                    }
                }
            }
        }
        (self.pixels.len() >= MIN_PIXELS).then_some(())
    }

    /// Light and ink by the pixels within and without.
    fn start(&self, expected: &Vec3, shape: CapShape) -> DiscState {
        let bend = shape.tone.bend;
        let (mut inside, mut outside) = ([0.0, 0.0], [0.0, 0.0]);
        for [x, y, z, value] in self.pixels.each() {
            let length = (Vec3::new(x, y, z) - expected).norm() / shape.radius;
            let sum = match length {
                l if l < 0.7 => &mut inside,
                l if l > 1.1 => &mut outside,
                _ => continue,
            };
            sum[0] += Tone::light(bend, value);
            sum[1] += 1.0;
        }
        let mean = |[sum, count]: [f64; 2]| if count > 0.0 { sum / count } else { 0.5 };
        let light = mean(outside).max(1e-3);
        DiscState {
            ink: 1.0 - mean(inside) / light,
            light,
            ..DiscState::unlit(expected, shape)
        }
    }

    fn equations<const N: usize>(
        &self,
        disc: &Disc,
        state: &DiscState,
        expected: &[(f64, f64); 3],
        variance: Option<f64>,
    ) -> Option<CapEquations<N>> {
        let mut sums =
            dispatch!(self.level, simd => self.sums::<_, N>(simd, disc, state, variance));
        let now = [state.radius, state.blur, state.bend];
        for ((k, now), (expected, spread)) in SHAPE.into_iter().zip(now).zip(expected) {
            let known = variance.unwrap_or(FIRST_VARIANCE) / spread;
            sums.information[k][k] += known;
            sums.gradient[k] += known * (expected - now);
        }
        let free = self.pixels.len().saturating_sub(N);
        let share = free as f64 / self.pixels.len() as f64;
        let variance = sums.squares / (sums.weights * share);
        (variance.is_finite() && free > 0).then(|| CapEquations {
            information: sums.symmetric(),
            gradient: SVector::from(sums.gradient),
            variance: variance.max(LEAST_VARIANCE),
        })
    }

    #[inline(always)]
    fn sums<S: Simd, const N: usize>(
        &self,
        simd: S,
        disc: &Disc,
        state: &DiscState,
        variance: Option<f64>,
    ) -> Sums<N> {
        let mut sums = LaneSums::new(simd);
        for four in self.pixels.fours() {
            let (shown, by) = state.shown(simd, disc, four);
            let [value, counts] = four.values(simd);
            let residual = value - shown;
            let weight = match variance {
                Some(v) => counts * LOSS.weight_each(residual * residual * v.recip()),
                None => counts,
            };
            sums.add(&by, residual, weight);
        }
        sums.total()
    }
}

/// Columns and rows, first and last, of the pixels about a dot.
fn bounds(
    BallPixels { gray, grid, view }: &BallPixels<'_>,
    middle: &Vec3,
    radius: f64,
    margin: f64,
) -> Option<[(usize, usize); 2]> {
    let at = grid.pixel_to_part(view.project(middle));
    let by_direction = view.jacobian(middle);
    let range = |middle: f64, row: usize, count: usize| {
        let side = by_direction.row(row).norm() * radius + margin;
        let from = (middle - side).ceil().max(1.0);
        let to = (middle + side).floor().min(count as f64 - 2.0);
        (from <= to).then_some((from as usize, to as usize))
    };
    Some([
        range(at.u, 0, gray.width())?,
        range(at.v, 1, gray.height())?,
    ])
}

/// The cap, where it is a dot.
fn judged(
    view: &BallView,
    state: &DiscState,
    tangents: &[Vec3; 2],
    fit: &CapEquations<UNKNOWNS>,
    before: &CapShape,
) -> Option<Cap> {
    let stored = |light: f64| Tone::shown(state.bend, light.max(DARKEST)).0;
    let contrast = stored(state.light) - stored(state.light * (1.0 - state.ink));
    if state.ink < MIN_INK || contrast < MIN_CONTRAST * fit.variance.sqrt() {
        return None;
    }
    let covariance = fit.covariance()?;
    let of_middle = covariance.fixed_view::<2, 2>(0, 0)
        + Matrix2::from_diagonal_element(MODEL_ERROR.0 * MODEL_ERROR.0);
    let to_pixel = view.jacobian(&state.middle) * Matrix3x2::from_columns(tangents);
    let facing = state.middle.z.max(LEAST_FACING);
    let of_blur = BLUR_ERROR * state.blur * facing.powf(-LIMB_POWER);
    let of_pixel = to_pixel * of_middle * to_pixel.transpose()
        + Matrix2::from_diagonal_element(MODEL_ERROR.1.powi(2) + of_blur.powi(2));
    let tone = before
        .tone
        .after_dot(state.bend, covariance[(SHAPE[2], SHAPE[2])]);
    Some(Cap {
        pixel: view.project(&state.middle),
        covariance: 0.5 * (of_pixel + of_pixel.transpose()),
        shape: CapShape {
            radius: state.radius,
            blur: state.blur,
            tone,
            is_known: true,
        },
    })
}
