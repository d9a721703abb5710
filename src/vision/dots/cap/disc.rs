//! A cap in the image: where its edge lies, and the light of pixels about it, four at a time.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f64x4};
use nalgebra::{Matrix3x2, SVector, Vector2};

use super::tone::{CapShape, Tone};
use super::{SHAPE, UNKNOWNS};
use crate::fit::{FourPixels, LANES, normal_cdf_and_density};
use crate::geometry::Vec3;
use crate::vision::optics::camera::BallView;

/// The least blur, pixels: a pixel's own.
const LEAST_BLUR: f64 = 0.25;
/// The least light, of full.
pub(crate) const DARKEST: f64 = 1e-4;
/// The blur's least variance across a stretched dot, of that of a round one.
const THINNEST: f64 = 0.02;

/// Four pixels: where their rays meet the sphere, and their values.
pub(crate) type CapPixels = FourPixels<4>;

/// A pixel's numbers.
pub(super) fn cap_pixel(direction: &Vec3, value: f64) -> [f64; 4] {
    [direction.x, direction.y, direction.z, value]
}

impl CapPixels {
    /// The values, and 1 for each.
    #[inline(always)]
    pub fn values<S: Simd>(&self, simd: S) -> [f64x4<S>; 2] {
        [self.numbers[3], self.counts].map(|lanes| f64x4::simd_from(simd, lanes))
    }

    #[inline(always)]
    fn direction<S: Simd>(&self, simd: S) -> Lanes3<S> {
        let [x, y, z, _] = self.numbers;
        Lanes3([x, y, z].map(|axis| f64x4::simd_from(simd, axis)))
    }
}

/// A vector in each lane.
#[derive(Clone, Copy)]
struct Lanes3<S: Simd>([f64x4<S>; 3]);

impl<S: Simd> Lanes3<S> {
    #[inline(always)]
    fn dot(&self, by: &[f64; 3]) -> f64x4<S> {
        self.0[0] * by[0] + self.0[1] * by[1] + self.0[2] * by[2]
    }

    #[inline(always)]
    fn dot_each(&self, other: &Self) -> f64x4<S> {
        self.0[0] * other.0[0] + self.0[1] * other.0[1] + self.0[2] * other.0[2]
    }

    #[inline(always)]
    fn norm(&self) -> f64x4<S> {
        self.dot_each(self).sqrt()
    }
}

/// Where an iteration stands.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DiscState {
    pub middle: Vec3,
    pub radius: f64,
    pub blur: f64,
    /// What the blur's covariance has beside `blur^2` on its diagonal: `[[p, q], [q, -p]]`, px^2.
    pub stretch: Vector2<f64>,
    /// The tone curve's bend.
    pub bend: f64,
    pub ink: f64,
    pub light: f64,
    /// Change of the light along the tangents at the middle the iteration started from.
    pub slope: Vector2<f64>,
}

/// The disc that a cap cuts off.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Disc {
    pub(super) middle: [f64; 3],
    pub(super) tangents: [[f64; 3]; 2],
    pub(super) sin: f64,
    pub(super) cos: f64,
    pub(super) blur: f64,
    pub(super) stretch: [f64; 2],
    /// Ball radii over the camera's distance.
    pub(super) horizon: f64,
    /// Change in its plane along a pixel of u and v, and the sums of its squares that the blur's covariance weighs.
    pub(super) by_pixel: [[f64; 3]; 2],
    pub(super) spread: [f64; 3],
}

/// The squares of a pair, as the blur's covariance `s^2 I + [[p, q], [q, -p]]` weighs them.
struct Squares<S: Simd> {
    /// Their sum: weighed by `s^2`.
    sum: f64x4<S>,
    /// Their difference and twice the product: weighed by `p` and `q`.
    stretched: [f64x4<S>; 2],
}

/// Where pixels lie by the disc's edge.
struct EdgeDistance<S: Simd> {
    /// From the edge inwards, deviations of the blur.
    inside: f64x4<S>,
    /// Its derivative by the middle, the radius and the blur.
    by: [f64x4<S>; 4],
    by_stretch: [f64x4<S>; 2],
}

impl Disc {
    pub fn new(view: &BallView, state: &DiscState, tangents: &[Vec3; 2]) -> Option<Self> {
        let (sin, cos) = state.radius.sin_cos();
        let by_pixel: Matrix3x2<f64> = view.by_pixel(&state.middle)?;
        let [u, v] = [by_pixel.column(0), by_pixel.column(1)];
        Some(Self {
            middle: state.middle.into(),
            tangents: tangents.map(Into::into),
            sin,
            cos,
            blur: state.blur,
            stretch: state.stretch.into(),
            horizon: view.horizon(),
            spread: [
                u.norm_squared() + v.norm_squared(),
                u.norm_squared() - v.norm_squared(),
                2.0 * u.dot(&v),
            ],
            by_pixel: by_pixel.data.0,
        })
    }

    /// Where the rays of pixels meet the plane, from the disc's middle on; and their slope there. Rays lead from the camera
    /// at (0, 0, 1 / horizon): they are of any length.
    #[inline(always)]
    fn meet<S: Simd>(&self, direction: &Lanes3<S>) -> (Lanes3<S>, f64x4<S>) {
        let mut ray = Lanes3(direction.0.map(|x| x * self.horizon));
        ray.0[2] -= 1.0;
        let facing = ray.dot(&self.middle);
        let along = (-direction.dot(&self.middle) + self.cos) / facing;
        let away = Lanes3(std::array::from_fn(|k| {
            direction.0[k] + ray.0[k] * along - self.middle[k] * self.cos
        }));
        (away, away.dot_each(&ray) / facing)
    }

    /// Change along a pixel in the direction that leads away from the middle.
    #[inline(always)]
    fn outwards<S: Simd>(&self, away: &Lanes3<S>, length: f64x4<S>) -> Squares<S> {
        let [u, v] = self.by_pixel.map(|by| away.dot(&by) / length);
        let (of_u, of_v) = (u * u, v * v);
        Squares {
            sum: of_u + of_v,
            stretched: [of_u - of_v, u * v * 2.0],
        }
    }

    /// The blur's width changes little with the middle: that is left out of the derivatives.
    #[inline(always)]
    fn edge<S: Simd>(&self, direction: &Lanes3<S>) -> EdgeDistance<S> {
        let (away, slope) = self.meet(direction);
        let length = away.norm().max(1e-9);
        let outwards = self.outwards(&away, length);
        let [p, q] = self.stretch;
        let squared = self.blur * self.blur;
        let round = outwards.sum * squared;
        let width2 = round + outwards.stretched[0] * p + outwards.stretched[1] * q;
        let width2 = width2.max(round * THINNEST).max(1e-18);
        let width = width2.sqrt();
        let of_all = squared * self.spread[0] + self.spread[1] * p + self.spread[2] * q;
        let across = -width2 + of_all;
        let reached = (length * length + across.max(0.0)).sqrt();
        let by_reached = f64x4::splat(width.simd, 1.0) / (reached * width);
        let inside = (-reached + self.sin) / width;
        let by_middle = (slope + self.cos) * by_reached;
        let by_width2 = inside * -0.5 / width2;
        let by_across = by_reached * -0.5;
        let rest = |of_all: f64, of_width: f64x4<S>| {
            by_width2 * of_width + by_across * (-of_width + of_all)
        };
        EdgeDistance {
            inside,
            by: [
                by_middle * away.dot(&self.tangents[0]),
                by_middle * away.dot(&self.tangents[1]),
                (slope * self.sin / reached + self.cos) / width,
                rest(self.spread[0], outwards.sum) * (2.0 * self.blur),
            ],
            by_stretch: [0, 1].map(|k| rest(self.spread[1 + k], outwards.stretched[k])),
        }
    }

    /// Pixels from the edge outwards, and from that of a disc that many times as large.
    #[inline(always)]
    pub fn beyond<S: Simd>(&self, simd: S, pixels: &CapPixels, scale: f64) -> [[f64; LANES]; 2] {
        let (away, _) = self.meet(&pixels.direction(simd));
        let length = away.norm().max(1e-9);
        let width = self.outwards(&away, length).sum.max(1e-18).sqrt();
        [1.0, scale].map(|scale| ((length - scale * self.sin) / width).into())
    }
}

impl DiscState {
    /// Of a dot that nothing is known of but where it is expected, and the shape of others.
    pub fn unlit(middle: &Vec3, shape: CapShape) -> Self {
        Self {
            middle: *middle,
            radius: shape.radius,
            blur: shape.blur,
            stretch: Vector2::zeros(),
            bend: shape.tone.bend,
            ink: 0.5,
            light: 0.5,
            slope: Vector2::zeros(),
        }
    }

    /// The values of pixels, and their derivatives; those by the stretch are the last two of eleven.
    #[inline(always)]
    pub fn shown<S: Simd, const N: usize>(
        &self,
        simd: S,
        disc: &Disc,
        pixels: &CapPixels,
    ) -> (f64x4<S>, [f64x4<S>; N]) {
        let direction = pixels.direction(simd);
        // A tangent is perpendicular to where the iteration started, not to the middle.
        let middle = Vec3::from(disc.middle);
        let along = disc
            .tangents
            .map(|t| direction.dot(&t) - Vec3::from(t).dot(&middle));
        let edge = disc.edge(&direction);
        let [covered, density] = normal_cdf_and_density(edge.inside);
        let lit = along[0] * self.slope[0] + along[1] * self.slope[1] + self.light;
        let left = -(covered * self.ink) + 1.0;
        let [shown, rate] = Tone::shown_each(self.bend, (lit * left).max(DARKEST));
        let by_edge = -(rate * lit * density * self.ink);
        let left = rate * left;
        let all = [
            by_edge * edge.by[0] - left * self.slope[0],
            by_edge * edge.by[1] - left * self.slope[1],
            by_edge * edge.by[2],
            by_edge * edge.by[3],
            -(rate * lit * covered),
            left,
            left * along[0],
            left * along[1],
            shown * (-shown + 1.0) * rate,
            by_edge * edge.by_stretch[0],
            by_edge * edge.by_stretch[1],
        ];
        (shown, std::array::from_fn(|k| all[k]))
    }

    /// The state after a step.
    pub fn moved<const N: usize>(&self, step: &SVector<f64, N>, tangents: &[Vec3; 2]) -> Self {
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
            stretch: match N > UNKNOWNS {
                true => self.stretch + step.fixed_rows::<2>(UNKNOWNS),
                false => self.stretch,
            },
        }
    }
}
