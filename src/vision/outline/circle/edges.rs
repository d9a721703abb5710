//! The image unrolled around a center, its edges, and the circle through them.
//!
//! On the ray at the angle `a` the edge at the radius `e(a)` leaves the circle `(u, v, r)` the residual
//! `|c + e (cos a, sin a) - (u, v)| - r`, whose derivatives are `-cos a, -sin a, -1` to first order.

mod ellipse;
mod unroll;

use std::ops::RangeInclusive;

use nalgebra::{Matrix3, Vector2, Vector3};

use self::ellipse::Parameters;
pub(crate) use self::unroll::Unrolled;
use self::unroll::{EDGES, Edge, RAYS, SMOOTHING};
use super::vote::Center;
use super::{BallCircle, BallFit, GrayImage, Pixel, Polarity};
use crate::fit::{Sums, biweight};

/// Reach of Tukey's biweight in the successive fits, in radii; then in pixels, for the last.
const REACH: [f64; 4] = [0.2, 0.12, 0.08, 0.05];
const LAST_REACH: f64 = 1.5;
/// An edge off the outline by less than this, in radii, supports it.
const TOLERANCE: f64 = 0.04;
/// Minimum share of rays with an edge at a rough radius; what has less is not fitted.
const WORTHWHILE: f64 = 0.3;
/// Where less than this of the rays, each by Tukey's weight, is near the circle after the second of the fits, it is not fitted further. Of 36 000 fits to
/// edges of whole pictures that ended with a support of 0.45 or more 0.2 % had less then, and 40 % of the others.
const HOPELESS: (usize, f64) = (1, 0.4);
/// The reach is at least this many standard deviations of the residuals.
const TUKEY: f64 = 4.7;
/// Edges on neighboring rays share their pixels: so many rays are worth one.
const CORRELATED: f64 = 2.0;
/// The systematic error of an outline (shading, blur), pixels, added to the scatter's.
const SYSTEMATIC: f64 = 0.05;

impl Unrolled {
    /// The radius around a center, of those voted for, at which most rays have an edge of this sign, and a measure of how
    /// many: about the share of the rays.
    pub fn radius(
        &mut self,
        image: &GrayImage,
        center: &Center,
        voted: RangeInclusive<usize>,
        sign: f64,
    ) -> Option<(f64, f64)> {
        let (from, to) = (0.8 * *voted.start() as f64, 1.2 * *voted.end() as f64);
        let start = Vector3::new(center.u, center.v, 0.0);
        // Rays must reach beyond the largest trial, or none would count there.
        self.find_edges(image, &start, (from, to + 2.0), sign);
        let (mut best, mut most) = (None, WORTHWHILE);
        let mut trial = from;
        while trial <= to {
            let ray = |edges: &[Edge; EDGES]| {
                let near = |e: &Edge| (1.0 - ((e.radius - trial) / 2.0).powi(2)).max(0.0);
                edges.iter().map(near).fold(0.0, f64::max)
            };
            let seen = self.reaches.iter().filter(|r| **r > trial + 1.0).count();
            let sum: f64 = self.edges.iter().map(ray).sum();
            // Rays that the border cuts cannot have an edge: what is left counts for them, in part.
            let worth = 1.3 * sum / (seen as f64 + 0.3 * RAYS as f64);
            if worth > most {
                (best, most) = (Some((trial, worth)), worth);
            }
            trial += 0.5;
        }
        best
    }

    /// Fits the circle from `start` (u, v, r).
    pub fn fit(
        &mut self,
        image: &GrayImage,
        start: Vector3<f64>,
        polarity: Polarity,
    ) -> Option<BallFit> {
        let sign = polarity.sign();
        let mut circle = start;
        for (round, reach) in REACH.into_iter().enumerate() {
            let wide = if round == 0 { 0.3 } else { 0.2 };
            let range = ((1.0 - wide) * circle.z, (1.0 + wide) * circle.z);
            self.find_edges(image, &circle, range, sign);
            let reach = (reach * circle.z).max(LAST_REACH);
            for _ in 0..3 {
                circle = self.step(&circle, reach)?.0;
            }
            let inside = circle.x > 0.0
                && circle.y > 0.0
                && circle.x < image.width() as f64
                && circle.y < image.height() as f64
                && circle.z > 2.0;
            let sane = inside
                && (circle.z / start.z).ln().abs() < 0.5
                && (circle.xy() - start.xy()).norm() < 0.6 * start.z;
            if !sane || (round == HOPELESS.0 && self.is_hopeless(&circle, reach)) {
                return None;
            }
        }
        let scatter = self.step(&circle, LAST_REACH)?.1;
        let reach = (TUKEY * scatter).clamp(0.8, LAST_REACH);
        for _ in 0..3 {
            circle = self.step(&circle, reach)?.0;
        }
        let (_, scatter, information) = self.step(&circle, reach)?;
        let variance = CORRELATED * scatter * scatter + SYSTEMATIC * SYSTEMATIC;
        let covariance = information.try_inverse()? * variance;
        self.judge(image, &circle_parameters(&circle), covariance, polarity)
    }

    /// Whether too few rays have an edge near a circle.
    fn is_hopeless(&self, circle: &Vector3<f64>, reach: f64) -> bool {
        let near: f64 = self.sums::<3>(&circle_parameters(circle), reach).1;
        let seen = self.reaches.iter().filter(|r| **r > circle.z).count();
        near < HOPELESS.1 * seen as f64
    }

    /// One reweighted step; the new circle, the residuals' standard deviation, and the sum of `w J^T J` with the weights'
    /// mean 1.
    fn step(&self, circle: &Vector3<f64>, reach: f64) -> Option<(Vector3<f64>, f64, Matrix3<f64>)> {
        let (sums, tukey, _) = self.sums::<3>(&circle_parameters(circle), reach);
        if tukey < 4.0 {
            return None;
        }
        // A breath of a prior: short arcs leave the radius open.
        let (information, total) = (sums.symmetric(), sums.weights);
        let hold = Matrix3::from_diagonal_element(1e-3 * total);
        let step = (information + hold)
            .cholesky()?
            .solve(&Vector3::from(sums.gradient));
        Some((circle + step, sums.scatter(), information * (tukey / total)))
    }

    /// The sums over the edges within reach of an outline, for a fit of its first `N` parameters; the sum of Tukey's weights
    /// without the slopes', and the number of the edges.
    fn sums<const N: usize>(&self, outline: &Parameters, reach: f64) -> (Sums<N>, f64, usize) {
        let (mut sums, mut total, mut count) = (Sums::default(), 0.0, 0);
        for ray in 0..RAYS {
            let Some((edge, (residual, j))) = self.nearest(ray, outline) else {
                continue;
            };
            let t = residual / reach;
            if t.abs() >= 1.0 {
                continue;
            }
            let tukey = biweight(t);
            let by = std::array::from_fn(|k| j[k]);
            sums.add(&by, residual, tukey * f64::from(edge.slope.sqrt()));
            total += tukey;
            count += 1;
        }
        (sums, total, count)
    }

    /// How much the brightness falls across the outline on a ray, a tenth of the radius to either side; of either sign for
    /// `sign` 0.
    fn fall(&self, image: &GrayImage, outline: &Parameters, ray: usize, sign: f64) -> f64 {
        let [cos, sin] = self.directions[ray];
        let radius = radius_at(outline, cos, sin);
        let at = |out: f64| f64::from(image.sample(outline[0] + out * cos, outline[1] + out * sin));
        let fall = at(0.9 * radius) - at(1.1 * radius);
        if sign == 0.0 { fall.abs() } else { fall }
    }

    /// What the fitted outline is worth; `covariance` is that of center and radius by the scatter of the edges.
    fn judge(
        &self,
        image: &GrayImage,
        outline: &Parameters,
        covariance: Matrix3<f64>,
        polarity: Polarity,
    ) -> Option<BallFit> {
        let sign = polarity.sign();
        let (mut seen, mut supported) = (0.0, 0.0);
        let (mut contrast, mut slope) = (0.0, 0.0);
        let tolerance = (TOLERANCE * outline[2]).max(0.6);
        let (right, bottom) = ((image.width() - 1) as f64, (image.height() - 1) as f64);
        for ray in 0..RAYS {
            let [cos, sin] = self.directions[ray];
            let out = radius_at(outline, cos, sin) + SMOOTHING * 2.5;
            let (u, v) = (outline[0] + out * cos, outline[1] + out * sin);
            if !(u >= -0.5 && v >= -0.5 && u <= right + 0.5 && v <= bottom + 0.5) {
                continue;
            }
            seen += 1.0;
            let Some((edge, _)) = self
                .nearest(ray, outline)
                .filter(|(_, r)| r.0.abs() <= tolerance)
            else {
                continue;
            };
            supported += 1.0;
            contrast += self.fall(image, outline, ray, sign);
            slope += f64::from(edge.slope);
        }
        if supported < 4.0 {
            return None;
        }
        let contrast = contrast / supported;
        // The size of the step that the edges show; of the wrong sign, none.
        let step = if sign == 0.0 {
            contrast
        } else {
            (sign * contrast).max(0.0)
        };
        Some(BallFit {
            circle: ball_circle(outline),
            covariance: covariance + Matrix3::from_diagonal_element(SYSTEMATIC * SYSTEMATIC),
            support: supported / seen,
            visible: seen / RAYS as f64,
            polarity,
            // Of a ball that is no brighter than what is behind it, nothing is left.
            contrast: if sign < 0.0 { -step } else { step },
            edge_width: step * supported / slope,
            rivals: 0,
        })
    }
}

fn circle_parameters(circle: &Vector3<f64>) -> Parameters {
    Parameters::new(circle.x, circle.y, circle.z, 0.0, 0.0)
}

/// The outline's radius in a direction.
fn radius_at(outline: &Parameters, cos: f64, sin: f64) -> f64 {
    let form = outline[3] * (cos * cos - sin * sin) + outline[4] * 2.0 * sin * cos;
    outline[2] / (1.0 + form).max(1e-3).sqrt()
}

fn ball_circle(outline: &Parameters) -> BallCircle {
    let center = Pixel {
        u: outline[0],
        v: outline[1],
    };
    let (p, q) = (outline[3], outline[4]);
    let stretch = p.hypot(q);
    if stretch == 0.0 {
        return BallCircle::new(center, outline[2]);
    }
    // The radius is largest where the cosine of twice the angle to (p, q) is -1.
    let angle = 0.5 * (-q).atan2(-p);
    let length = (2.0 * stretch / (1.0 + stretch)).sqrt();
    BallCircle {
        center,
        radius: outline[2] / (1.0 + stretch).sqrt(),
        eccentricity: Vector2::new(angle.cos(), angle.sin()) * length,
    }
}
