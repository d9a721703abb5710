//! A cap in the image: where its edge lies, and the light of a pixel about it.

use nalgebra::{Matrix3x2, SVector, Vector2};

use super::tone::Tone;
use super::{SHAPE, UNKNOWNS};
use crate::geometry::Vec3;
use crate::stats::normal_cdf_and_density;
use crate::vision::optics::camera::BallView;

/// The least blur, pixels: a pixel's own.
const LEAST_BLUR: f64 = 0.25;
/// The least light, of full.
pub(crate) const DARKEST: f64 = 1e-4;
/// The blur's least variance across a stretched dot, of that of a round one.
const THINNEST: f64 = 0.02;
/// So many deviations of the blur from the edge is no ink, or nothing else.
const FLAT: f64 = 4.0;

/// A pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CapSample {
    /// Where its ray meets the sphere.
    pub direction: Vec3,
    /// Along the ray, away from the camera; of any length.
    pub ray: Vec3,
    pub value: f64,
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
pub(crate) struct Disc {
    pub middle: Vec3,
    pub tangents: [Vec3; 2],
    pub sin: f64,
    pub cos: f64,
    pub blur: f64,
    pub stretch: Vector2<f64>,
    /// Change in its plane along a pixel of u and v, and the sums of its squares that the blur's covariance weighs.
    pub by_pixel: Matrix3x2<f64>,
    pub spread: Squares,
}

/// The squares of a pair, as the blur's covariance `s^2 I + [[p, q], [q, -p]]` weighs them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Squares {
    /// Their sum: weighed by `s^2`.
    sum: f64,
    /// Their difference and twice the product: weighed by `p` and `q`.
    stretched: Vector2<f64>,
}

impl Squares {
    fn of(u: f64, v: f64, product: f64) -> Self {
        Self {
            sum: u + v,
            stretched: Vector2::new(u - v, 2.0 * product),
        }
    }

    fn weighed(&self, blur: f64, stretch: &Vector2<f64>) -> f64 {
        blur * blur * self.sum + self.stretched.dot(stretch)
    }
}

/// Where a pixel lies by the disc's edge.
struct EdgeDistance {
    /// From the edge inwards, deviations of the blur.
    inside: f64,
    /// Its derivative by the middle, the radius and the blur.
    by: [f64; 4],
    by_stretch: Vector2<f64>,
}

impl Disc {
    pub fn new(view: &BallView, state: &DiscState, tangents: &[Vec3; 2]) -> Option<Self> {
        let (sin, cos) = state.radius.sin_cos();
        let by_pixel = view.by_pixel(&state.middle)?;
        Some(Self {
            middle: state.middle,
            tangents: *tangents,
            sin,
            cos,
            blur: state.blur,
            stretch: state.stretch,
            spread: Squares::of(
                by_pixel.column(0).norm_squared(),
                by_pixel.column(1).norm_squared(),
                by_pixel.column(0).dot(&by_pixel.column(1)),
            ),
            by_pixel,
        })
    }

    /// Where the ray of a pixel meets the plane, from the disc's middle on; and its slope there.
    fn meet(&self, sample: &CapSample) -> (Vec3, f64) {
        let facing = sample.ray.dot(&self.middle);
        let along = (self.cos - sample.direction.dot(&self.middle)) / facing;
        let away = sample.direction + sample.ray * along - self.middle * self.cos;
        (away, away.dot(&sample.ray) / facing)
    }

    /// Change along a pixel in the direction that leads away from the middle.
    fn outwards(&self, away: &Vec3, length: f64) -> Squares {
        let [u, v] = [0, 1].map(|k| self.by_pixel.column(k).dot(away) / length);
        Squares::of(u * u, v * v, u * v)
    }

    /// The blur's width changes little with the middle: that is left out of the derivatives.
    fn edge(&self, sample: &CapSample) -> EdgeDistance {
        let (away, slope) = self.meet(sample);
        let length = away.norm().max(1e-9);
        let outwards = self.outwards(&away, length);
        let round = self.blur * self.blur * outwards.sum;
        let width2 = outwards.weighed(self.blur, &self.stretch);
        let width2 = width2.max(THINNEST * round).max(1e-18);
        let width = width2.sqrt();
        let across = self.spread.weighed(self.blur, &self.stretch) - width2;
        let reached = (length * length + across.max(0.0)).sqrt();
        let inside = (self.sin - reached) / width;
        let by_middle = (slope + self.cos) / (reached * width);
        let by_width2 = -0.5 * inside / width2;
        let by_across = -0.5 / (reached * width);
        let rest =
            |of_all: f64, of_width: f64| by_width2 * of_width + by_across * (of_all - of_width);
        let [p, q] = [0, 1].map(|k| rest(self.spread.stretched[k], outwards.stretched[k]));
        EdgeDistance {
            inside,
            by: [
                by_middle * self.tangents[0].dot(&away),
                by_middle * self.tangents[1].dot(&away),
                (self.cos + slope * self.sin / reached) / width,
                2.0 * self.blur * rest(self.spread.sum, outwards.sum),
            ],
            by_stretch: Vector2::new(p, q),
        }
    }

    /// Pixels from the edge outwards, and from that of a disc that many times as large.
    pub fn beyond(&self, sample: &CapSample, scale: f64) -> [f64; 2] {
        let (away, _) = self.meet(sample);
        let length = away.norm().max(1e-9);
        let pixels = self.outwards(&away, length).sum.max(1e-18).sqrt().recip();
        [1.0, scale].map(|scale| (length - scale * self.sin) * pixels)
    }
}

impl DiscState {
    /// The value of a pixel, and its derivatives; those by the stretch are the last two of eleven.
    pub fn shown<const N: usize>(&self, disc: &Disc, sample: &CapSample) -> (f64, [f64; N]) {
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
        let all = [
            by_edge * edge.by[0] - left * self.slope[0],
            by_edge * edge.by[1] - left * self.slope[1],
            by_edge * edge.by[2],
            by_edge * edge.by[3],
            -rate * lit * covered,
            left,
            left * along[0],
            left * along[1],
            shown * (1.0 - shown) * rate,
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
