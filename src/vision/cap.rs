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

use nalgebra::{Matrix2, Matrix3x2, SMatrix, SVector, Vector2};

use super::camera::{BallView, Pixel};
use crate::geometry::{Vec3, tangent_frame};
use crate::image::GrayImage;
use crate::stats::normal_cdf_and_density;

/// Maximum number of steps.
const STEPS: usize = 8;
/// A shorter step of the middle, over the dot's radius, ends the iteration: the next would be a tenth of it.
const CONVERGED: f64 = 1e-2;
/// Angular radii that the iteration starts from where no dot of the ball is known, radians.
const RADII: [f64; 3] = [0.09, 0.06, 0.13];
/// Angular radii that a dot may have, radians.
const RADIUS: std::ops::RangeInclusive<f64> = 0.025..=0.3;
/// The blur's deviation that the iteration starts from: pixels, or this part of the ball's radius where that is more.
const BLUR: (f64, f64) = (0.7, 0.02);
/// The least blur, pixels: a pixel's own.
const LEAST_BLUR: f64 = 0.25;
/// Pixels count up to so many dot radii, and beyond by so many deviations of the blur and so many pixels.
const MARGIN: (f64, f64, f64) = (1.2, 2.5, 1.0);
/// Fewer pixels fix no dot.
const MIN_PIXELS: usize = 16;
/// More pixels add nothing but time: of a larger dot, away from its edge, every second, third, ... row and column is read.
const MANY_PIXELS: f64 = 150.0;
/// Capacity for the pixels of a dot beforehand.
const EXPECTED_PIXELS: usize = 4096;
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
/// Standard deviation per axis of what the model leaves out, radians and pixels: shading that is not linear and ink that is not
/// even; what lies between pixels.
const MODEL_ERROR: (f64, f64) = (2e-4, 0.015);
/// Within so many deviations of the blur and so many pixels of the rim, what is behind the ball is seen.
const RIM: (f64, f64) = (2.0, 0.5);
/// Standard deviations of radius and blur, of these: of the first dot, and of one on a ball whose other dots are known.
const SPREAD: [[f64; 2]; 2] = [[1.0, 1.0], [0.15, 0.25]];
/// Variance of the values that the first step supposes.
const FIRST_VARIANCE: f64 = 1e-3;
/// The least variance: what is exact to the last digit of a byte is not more exact than that.
const LEAST_VARIANCE: f64 = 1e-8;
/// Variance of the tone curve's bend from dot to dot: what else makes an edge uneven.
const TONE_DRIFT: f64 = 1e-3;

/// Number of unknowns.
const UNKNOWNS: usize = 9;
/// The places of radius, blur and the tone curve's bend among them.
const SHAPE: [usize; 3] = [2, 3, 8];
type Unknowns = SVector<f64, UNKNOWNS>;
type Information = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// What is known of the tone curve: the bend `q`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tone {
    bend: f64,
    variance: f64,
}

impl Default for Tone {
    /// Anything between a line and sRGB's.
    fn default() -> Self {
        Self {
            bend: 0.6,
            variance: 0.25,
        }
    }
}

impl Tone {
    /// The square root of the light.
    #[cfg(test)]
    pub fn of_root() -> Self {
        Self {
            bend: 1.0,
            variance: 0.01,
        }
    }

    /// The light that is stored as `value`.
    fn light(bend: f64, value: f64) -> f64 {
        (1.0 - bend + bend * value) * value
    }

    /// The light that is stored as `value`, and its slope there.
    pub fn light_and_slope(&self, value: f64) -> (f64, f64) {
        let slope = 1.0 - self.bend + 2.0 * self.bend * value;
        (Self::light(self.bend, value), slope)
    }

    /// How light is stored, and the curve's slope there.
    fn shown(bend: f64, light: f64) -> (f64, f64) {
        let straight = 1.0 - bend;
        let root = (straight * straight + 4.0 * bend * light).sqrt();
        (2.0 * light / (straight + root), 1.0 / root)
    }
}

/// A cap's size and sharpness, and the tone curve.
#[derive(Debug, Clone, Copy)]
pub(super) struct CapShape {
    /// Angular radius, radians.
    pub radius: f64,
    /// Standard deviation of the edge's blur, pixels.
    pub blur: f64,
    pub tone: Tone,
    /// Whether a dot of the ball had it.
    pub is_known: bool,
}

impl CapShape {
    /// Its unknowns and their variances.
    fn expected(&self) -> [(f64, f64); 3] {
        let [of_radius, of_blur] = SPREAD[usize::from(self.is_known)];
        [
            (self.radius, (of_radius * self.radius).powi(2)),
            (self.blur, (of_blur * self.blur).powi(2)),
            (self.tone.bend, self.tone.variance),
        ]
    }
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
    /// Where its ray meets the sphere.
    direction: Vec3,
    /// Along the ray, away from the camera; of any length.
    ray: Vec3,
    value: f64,
}

/// Fits caps; keeps its memory.
#[derive(Debug)]
pub(super) struct CapFitter {
    samples: Vec<Sample>,
}

impl Default for CapFitter {
    fn default() -> Self {
        Self {
            samples: Vec::with_capacity(EXPECTED_PIXELS),
        }
    }
}

/// Where an iteration stands.
#[derive(Debug, Clone, Copy)]
struct State {
    middle: Vec3,
    radius: f64,
    blur: f64,
    /// The tone curve's bend.
    bend: f64,
    ink: f64,
    light: f64,
    /// Change of the light along the tangents at the middle the iteration started from.
    slope: Vector2<f64>,
}

/// The disc that a cap cuts off.
struct Disc {
    middle: Vec3,
    tangents: [Vec3; 2],
    sin: f64,
    cos: f64,
    blur: f64,
    /// Change in its plane along a pixel of u and v, and the sum of its squares.
    by_pixel: Matrix3x2<f64>,
    spread: f64,
}

/// Where a pixel lies by the disc's edge.
struct Edge {
    /// From the edge inwards, deviations of the blur.
    inside: f64,
    /// Its derivative by the middle, the radius and the blur.
    by: [f64; 4],
}

impl Disc {
    fn new(view: &BallView, state: &State, tangents: &[Vec3; 2]) -> Option<Self> {
        let (sin, cos) = state.radius.sin_cos();
        let by_pixel = view.by_pixel(&state.middle)?;
        Some(Self {
            middle: state.middle,
            tangents: *tangents,
            sin,
            cos,
            blur: state.blur,
            by_pixel,
            spread: by_pixel.norm_squared(),
        })
    }

    /// Where the ray of a pixel meets the plane, from the disc's middle on; and its slope there.
    fn meet(&self, sample: &Sample) -> (Vec3, f64) {
        let facing = sample.ray.dot(&self.middle);
        let along = (self.cos - sample.direction.dot(&self.middle)) / facing;
        let away = sample.direction + sample.ray * along - self.middle * self.cos;
        (away, away.dot(&sample.ray) / facing)
    }

    /// Squared change along a pixel that leads away from the middle.
    fn outwards(&self, away: &Vec3, length: f64) -> f64 {
        let [u, v] = [0, 1].map(|k| self.by_pixel.column(k).dot(away));
        (u * u + v * v) / (length * length)
    }

    /// The blur's width changes little with the middle: that is left out of the derivatives.
    fn edge(&self, sample: &Sample) -> Edge {
        let (away, slope) = self.meet(sample);
        let length = away.norm().max(1e-9);
        let outwards = self.outwards(&away, length);
        let across = (self.spread - outwards).max(0.0);
        let width = self.blur * outwards.max(1e-18).sqrt();
        let reached = (length * length + self.blur * self.blur * across).sqrt();
        let inside = (self.sin - reached) / width;
        let by_middle = (slope + self.cos) / (reached * width);
        Edge {
            inside,
            by: [
                by_middle * self.tangents[0].dot(&away),
                by_middle * self.tangents[1].dot(&away),
                (self.cos + slope * self.sin / reached) / width,
                -inside / self.blur - self.blur * across / (reached * width),
            ],
        }
    }

    /// Pixels from the edge outwards, and from that of a disc that many times as large.
    fn beyond(&self, sample: &Sample, scale: f64) -> [f64; 2] {
        let (away, _) = self.meet(sample);
        let length = away.norm().max(1e-9);
        let pixels = self.outwards(&away, length).max(1e-18).sqrt().recip();
        [1.0, scale].map(|scale| (length - scale * self.sin) * pixels)
    }
}

impl State {
    /// The value of a pixel, and its derivatives.
    fn shown(&self, disc: &Disc, sample: &Sample) -> (f64, [f64; UNKNOWNS]) {
        let away = sample.direction - self.middle;
        let along = [0, 1].map(|k| disc.tangents[k].dot(&away));
        let edge = disc.edge(sample);
        let (covered, density) = match edge.inside.abs() < FLAT {
            true => normal_cdf_and_density(edge.inside),
            false => (f64::from(edge.inside > 0.0), 0.0),
        };
        let lit = self.light + self.slope[0] * along[0] + self.slope[1] * along[1];
        let left = 1.0 - self.ink * covered;
        let (shown, rate) = Tone::shown(self.bend, (lit * left).max(DARKEST));
        let by_edge = -rate * lit * self.ink * density;
        let left = rate * left;
        let by = [
            by_edge * edge.by[0] - left * self.slope[0],
            by_edge * edge.by[1] - left * self.slope[1],
            by_edge * edge.by[2],
            by_edge * edge.by[3],
            -rate * lit * covered,
            left,
            left * along[0],
            left * along[1],
            shown * (1.0 - shown) * rate,
        ];
        (shown, by)
    }

    /// The state after a step.
    fn moved(&self, step: &Unknowns, tangents: &[Vec3; 2]) -> Self {
        let moved = self.middle + tangents[0] * step[0] + tangents[1] * step[1];
        let change = |now: f64, by: f64| (now + by).clamp(0.5 * now, 2.0 * now);
        Self {
            middle: moved.normalize(),
            radius: change(self.radius, step[SHAPE[0]]),
            blur: change(self.blur, step[SHAPE[1]]).max(LEAST_BLUR),
            bend: (self.bend + step[SHAPE[2]]).clamp(0.0, 1.0),
            ink: self.ink + step[4],
            light: self.light + step[5],
            slope: self.slope + step.fixed_rows::<2>(6),
        }
    }
}

/// The weighted normal equations at a state.
struct Equations {
    information: Information,
    gradient: Unknowns,
    /// Weighted mean square of the residuals.
    variance: f64,
}

/// Weighted sums over pixels, of derivatives by `N` unknowns; of the information the lower triangle.
pub(super) struct Sums<const N: usize> {
    pub information: [[f64; N]; N],
    pub gradient: [f64; N],
    pub squares: f64,
    pub weights: f64,
}

impl<const N: usize> Default for Sums<N> {
    fn default() -> Self {
        Self {
            information: [[0.0; N]; N],
            gradient: [0.0; N],
            squares: 0.0,
            weights: 0.0,
        }
    }
}

impl<const N: usize> Sums<N> {
    /// Both triangles.
    pub fn symmetric(&self) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|row, column| self.information[row.max(column)][row.min(column)])
    }

    pub fn add(&mut self, by: &[f64; N], residual: f64, weight: f64) {
        for (k, row) in self.information.iter_mut().enumerate() {
            let weighted = weight * by[k];
            for (cell, other) in row[..=k].iter_mut().zip(by) {
                *cell += weighted * other;
            }
            self.gradient[k] += weighted * residual;
        }
        self.squares += weight * residual * residual;
        self.weights += weight;
    }
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
        if let Some(shape) = shape {
            return self.fit_from(image, origin, view, &expected, shape);
        }
        let blur = BLUR.0.max(BLUR.1 * view.circle().radius);
        let tone = Tone::default();
        RADII.into_iter().find_map(|radius| {
            let shape = CapShape {
                radius,
                blur,
                tone,
                is_known: false,
            };
            self.fit_from(image, origin, view, &expected, shape)
        })
    }

    fn fit_from(
        &mut self,
        image: &GrayImage,
        origin: Pixel,
        view: &BallView,
        expected: &Vec3,
        shape: CapShape,
    ) -> Option<Cap> {
        let tangents = tangent_frame(expected);
        self.sample(image, origin, view, expected, shape)?;
        let mut state = self.start(expected, shape);
        let mut variance = None;
        for _ in 0..STEPS {
            let disc = Disc::new(view, &state, &tangents)?;
            let now = self.equations(&disc, &state, &shape, variance)?;
            let step = now.information.cholesky()?.solve(&now.gradient);
            let moved = step.fixed_rows::<2>(0).norm();
            state = state.moved(&step, &tangents);
            let shift = (state.middle - expected).norm();
            let radius = state.radius;
            if !(RADIUS.contains(&radius) && shift < MAX_SHIFT * radius) {
                return None;
            }
            if variance.is_some() && moved < CONVERGED * radius {
                return judged(view, &state, &tangents, &now);
            }
            variance = Some(now.variance);
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
        let CapShape { radius, blur, .. } = shape;
        let horizon = view.horizon();
        // Within so many pixels of the rim its blur is seen.
        let rim = (2.0 * (RIM.0 * blur + RIM.1) / view.circle().radius).sqrt();
        if expected.z - horizon < rim {
            return None;
        }
        let margin = MARGIN.1 * blur + MARGIN.2;
        let [(left, right), (top, bottom)] =
            bounds(image, origin, view, expected, MARGIN.0 * radius, margin)?;
        let pixels = ((right - left + 1) * (bottom - top + 1)) as f64;
        let stride = (pixels / MANY_PIXELS).sqrt().ceil().max(1.0) as usize;
        let start = self.start(expected, shape);
        let disc = Disc::new(view, &start, &tangent_frame(expected))?;
        self.samples.clear();
        for v in top..=bottom {
            let row = image.row(v, 0, image.width());
            for (u, value) in row.iter().enumerate().take(right + 1).skip(left) {
                let place = Pixel {
                    u: u as f64 + origin.u,
                    v: v as f64 + origin.v,
                };
                let Some(direction) = view.direction(place).filter(|d| d.z - horizon >= rim) else {
                    continue;
                };
                let sample = Sample {
                    direction,
                    // The camera is at (0, 0, 1 / horizon).
                    ray: direction * horizon - Vec3::z(),
                    value: f64::from(*value),
                };
                let is_even = u % stride == 0 && v % stride == 0;
                let [of_edge, of_surroundings] = disc.beyond(&sample, MARGIN.0);
                let is_read = is_even || of_edge.abs() <= margin;
                if is_read && of_surroundings <= margin {
                    self.samples.push(sample);
                }
            }
        }
        (self.samples.len() >= MIN_PIXELS).then_some(())
    }

    /// Light and ink by the pixels within and without.
    fn start(&self, expected: &Vec3, shape: CapShape) -> State {
        let bend = shape.tone.bend;
        let (mut inside, mut outside) = ([0.0, 0.0], [0.0, 0.0]);
        for sample in &self.samples {
            let length = (sample.direction - expected).norm() / shape.radius;
            let sum = match length {
                l if l < 0.7 => &mut inside,
                l if l > 1.1 => &mut outside,
                _ => continue,
            };
            sum[0] += Tone::light(bend, sample.value);
            sum[1] += 1.0;
        }
        let mean = |[sum, count]: [f64; 2]| if count > 0.0 { sum / count } else { 0.5 };
        let light = mean(outside).max(1e-3);
        State {
            middle: *expected,
            radius: shape.radius,
            blur: shape.blur,
            bend,
            ink: 1.0 - mean(inside) / light,
            light,
            slope: Vector2::zeros(),
        }
    }

    fn equations(
        &self,
        disc: &Disc,
        state: &State,
        shape: &CapShape,
        variance: Option<f64>,
    ) -> Option<Equations> {
        let mut sums = Sums::<UNKNOWNS>::default();
        for sample in &self.samples {
            let (shown, by) = state.shown(disc, sample);
            let residual = sample.value - shown;
            let weight = variance.map_or(1.0, |v| {
                (DEGREES + 1.0) / (DEGREES + residual * residual / v)
            });
            sums.add(&by, residual, weight);
        }
        let now = [state.radius, state.blur, state.bend];
        for ((k, now), (expected, spread)) in SHAPE.into_iter().zip(now).zip(shape.expected()) {
            let known = variance.unwrap_or(FIRST_VARIANCE) / spread;
            sums.information[k][k] += known;
            sums.gradient[k] += known * (expected - now);
        }
        let free = self.samples.len().saturating_sub(UNKNOWNS);
        let share = free as f64 / self.samples.len() as f64;
        let variance = sums.squares / (sums.weights * share);
        (variance.is_finite() && free > 0).then(|| Equations {
            information: sums.symmetric(),
            gradient: Unknowns::from(sums.gradient),
            variance: variance.max(LEAST_VARIANCE),
        })
    }
}

/// Columns and rows, first and last, of the pixels about a dot.
fn bounds(
    image: &GrayImage,
    origin: Pixel,
    view: &BallView,
    middle: &Vec3,
    radius: f64,
    margin: f64,
) -> Option<[(usize, usize); 2]> {
    let (at, by_direction) = (view.project(middle), view.jacobian(middle));
    let range = |middle: f64, row: usize, count: usize| {
        let side = by_direction.row(row).norm() * radius + margin;
        let from = (middle - side).ceil().max(1.0);
        let to = (middle + side).floor().min(count as f64 - 2.0);
        (from <= to).then_some((from as usize, to as usize))
    };
    Some([
        range(at.u - origin.u, 0, image.width())?,
        range(at.v - origin.v, 1, image.height())?,
    ])
}

/// The cap, where it is a dot.
fn judged(view: &BallView, state: &State, tangents: &[Vec3; 2], fit: &Equations) -> Option<Cap> {
    let stored = |light: f64| Tone::shown(state.bend, light.max(DARKEST)).0;
    let contrast = stored(state.light) - stored(state.light * (1.0 - state.ink));
    if state.ink < MIN_INK || contrast < MIN_CONTRAST * fit.variance.sqrt() {
        return None;
    }
    // The information of Student's distribution is less than its weights' by this.
    let spread = fit.variance * (DEGREES + 3.0) / (DEGREES + 1.0);
    let covariance = fit.information.try_inverse()? * spread;
    let of_middle = covariance.fixed_view::<2, 2>(0, 0)
        + Matrix2::from_diagonal_element(MODEL_ERROR.0 * MODEL_ERROR.0);
    let to_pixel = view.jacobian(&state.middle) * Matrix3x2::from_columns(tangents);
    let of_pixel = to_pixel * of_middle * to_pixel.transpose()
        + Matrix2::from_diagonal_element(MODEL_ERROR.1 * MODEL_ERROR.1);
    let tone = Tone {
        bend: state.bend,
        variance: covariance[(SHAPE[2], SHAPE[2])] + TONE_DRIFT,
    };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::{BallCircle, Camera};

    const SIDE: usize = 70;

    fn view() -> BallView {
        let camera = Camera::Near {
            inverse_distance: 0.1,
        };
        let center = Pixel { u: 34.3, v: 35.1 };
        BallView::new(&camera, BallCircle::new(center, 30.0)).expect("a value")
    }

    /// A ball with one dot as sRGB, 8 x 8 rays a pixel, blurred by `blur` pixels.
    fn drawn(view: &BallView, middle: &Vec3, radius: f64, blur: f64) -> GrayImage {
        const FINE: usize = 8;
        let side = SIDE * FINE;
        let lamp = Vec3::new(0.5, 0.3, 0.8).normalize();
        let light = GrayImage::from_fn(side, side, |u, v| {
            let place = |x: usize| (x as f64 + 0.5) / FINE as f64 - 0.5;
            let at = Pixel {
                u: place(u),
                v: place(v),
            };
            let Some(direction) = view.direction(at).filter(|d| d.z > view.horizon()) else {
                return 0.05;
            };
            let ink = if direction.dot(middle) > radius.cos() {
                0.1
            } else {
                1.0
            };
            ink * (0.3 + 0.5 * direction.dot(&lamp).max(0.0)) as f32
        });
        let reach = (3.5 * blur * FINE as f64).ceil() as isize;
        let weights: Vec<f32> = (-reach..=reach)
            .map(|k| (-0.5 * (k as f64 / (blur * FINE as f64)).powi(2)).exp() as f32)
            .collect();
        let total: f32 = weights.iter().sum();
        let along = |image: &GrayImage, step: [isize; 2]| {
            GrayImage::from_fn(side, side, |u, v| {
                let near = weights.iter().zip(-reach..).map(|(weight, k)| {
                    weight * image.at(u as isize + k * step[0], v as isize + k * step[1])
                });
                near.sum::<f32>() / total
            })
        };
        let blurred = along(&along(&light, [1, 0]), [0, 1]);
        GrayImage::from_fn(SIDE, SIDE, |u, v| {
            let fine = (0..FINE * FINE).map(|k| {
                blurred.at(
                    (FINE * u + k % FINE) as isize,
                    (FINE * v + k / FINE) as isize,
                )
            });
            let light = fine.sum::<f32>() / (FINE * FINE) as f32;
            1.055 * light.powf(1.0 / 2.4) - 0.055
        })
    }

    /// To a twentieth: how the blur's width changes around the dot is left out, which moves no fit without residuals.
    #[test]
    fn derivatives_are_those_of_finite_differences() {
        let (view, step) = (view(), 1e-6);
        let middle = Vec3::new(0.45, -0.2, 0.87).normalize();
        let tangents = tangent_frame(&middle);
        let state = State {
            middle,
            radius: 0.09,
            blur: 0.8,
            bend: 0.8,
            ink: 0.7,
            light: 0.6,
            slope: Vector2::new(0.3, -0.2),
        };
        let mut disc = Disc::new(&view, &state, &tangents).expect("a value");
        let at = view.project(&middle);
        for (du, dv) in [(2.0, 0.5), (-1.5, 2.0), (0.3, -2.6), (4.0, 4.0), (0.2, 0.1)] {
            let place = Pixel {
                u: at.u + du,
                v: at.v + dv,
            };
            let direction = view.direction(place).expect("a value");
            let sample = Sample {
                direction,
                ray: direction * view.horizon() - Vec3::z(),
                value: 0.0,
            };
            let (shown, by) = state.shown(&disc, &sample);
            for (k, by) in by.into_iter().enumerate() {
                let mut change = Unknowns::zeros();
                change[k] = step;
                let moved = state.moved(&change, &tangents);
                let before = disc.by_pixel;
                // The blur's width in the plane is held.
                disc = Disc {
                    by_pixel: before,
                    spread: before.norm_squared(),
                    ..Disc::new(&view, &moved, &tangents).expect("a value")
                };
                let difference = (moved.shown(&disc, &sample).0 - shown) / step;
                assert!(
                    (difference - by).abs() < 0.05 * (1.0 + by.abs()),
                    "{k}: {difference} {by}"
                );
                disc = Disc {
                    by_pixel: before,
                    spread: before.norm_squared(),
                    ..Disc::new(&view, &state, &tangents).expect("a value")
                };
            }
        }
    }

    #[test]
    fn a_drawn_cap_is_found_to_a_fiftieth_of_a_pixel() {
        let view = view();
        for (x, y) in [(0.02, 0.1), (0.4, -0.3), (-0.6, 0.35), (0.1, 0.75)] {
            let middle = Vec3::new(x, y, f64::sqrt(1.0 - x * x - y * y));
            let image = drawn(&view, &middle, 0.1, 0.8);
            let at = view.project(&middle);
            let near = Pixel {
                u: at.u + 0.3,
                v: at.v - 0.2,
            };
            let found = CapFitter::default()
                .fit(&image, Pixel::default(), &view, near, None)
                .expect("a value");
            let off = (found.pixel.u - at.u).hypot(found.pixel.v - at.v);
            assert!(off < 0.02, "{off} px at {middle:?}");
            assert!((found.shape.radius - 0.1).abs() < 0.01, "{:?}", found.shape);
        }
    }

    #[test]
    fn where_no_dot_is_there_is_none() {
        let view = view();
        let elsewhere = Vec3::new(-0.6, -0.5, 0.6).normalize();
        let image = drawn(&view, &elsewhere, 0.1, 0.8);
        let near = view.project(&Vec3::new(0.3, 0.2, 0.9).normalize());
        let found = CapFitter::default().fit(&image, Pixel::default(), &view, near, None);
        assert!(found.is_none(), "{found:?}");
    }
}
