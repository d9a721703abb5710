//! A cap in the image: where its edge lies, and the light of a pixel about it.

use nalgebra::{Matrix3x2, Vector2};

use super::tone::Tone;
use super::{SHAPE, UNKNOWNS, Unknowns};
use crate::geometry::Vec3;
use crate::stats::normal_cdf_and_density;
use crate::vision::camera::BallView;

/// The least blur, pixels: a pixel's own.
const LEAST_BLUR: f64 = 0.25;
/// The least light, of full.
pub(super) const DARKEST: f64 = 1e-4;
/// So many deviations of the blur from the edge is no ink, or nothing else.
const FLAT: f64 = 4.0;

/// A pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Where its ray meets the sphere.
    pub direction: Vec3,
    /// Along the ray, away from the camera; of any length.
    pub ray: Vec3,
    pub value: f64,
}

/// Where an iteration stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct State {
    pub middle: Vec3,
    pub radius: f64,
    pub blur: f64,
    /// The tone curve's bend.
    pub bend: f64,
    pub ink: f64,
    pub light: f64,
    /// Change of the light along the tangents at the middle the iteration started from.
    pub slope: Vector2<f64>,
}

/// The disc that a cap cuts off.
pub(super) struct Disc {
    pub middle: Vec3,
    pub tangents: [Vec3; 2],
    pub sin: f64,
    pub cos: f64,
    pub blur: f64,
    /// Change in its plane along a pixel of u and v, and the sum of its squares.
    pub by_pixel: Matrix3x2<f64>,
    pub spread: f64,
}

/// Where a pixel lies by the disc's edge.
struct Edge {
    /// From the edge inwards, deviations of the blur.
    inside: f64,
    /// Its derivative by the middle, the radius and the blur.
    by: [f64; 4],
}

impl Disc {
    pub fn new(view: &BallView, state: &State, tangents: &[Vec3; 2]) -> Option<Self> {
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
    pub fn beyond(&self, sample: &Sample, scale: f64) -> [f64; 2] {
        let (away, _) = self.meet(sample);
        let length = away.norm().max(1e-9);
        let pixels = self.outwards(&away, length).max(1e-18).sqrt().recip();
        [1.0, scale].map(|scale| (length - scale * self.sin) * pixels)
    }
}

impl State {
    /// The value of a pixel, and its derivatives.
    pub fn shown(&self, disc: &Disc, sample: &Sample) -> (f64, [f64; UNKNOWNS]) {
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
    pub fn moved(&self, step: &Unknowns, tangents: &[Vec3; 2]) -> Self {
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
