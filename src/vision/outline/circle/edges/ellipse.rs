//! The ellipse through the edges: a ball off the optical axis.
//!
//! At the angle `a` an ellipse with the half axes `A`, `B` has the radius `r / sqrt(1 + p cos 2a + q sin 2a)`, with
//! `sqrt(p^2 + q^2) = (A^2 - B^2) / (A^2 + B^2)`. The residual of an edge is taken along the radius.

use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use super::{CORRELATED, Edge, LAST_REACH, RAYS, TUKEY, Unrolled};
use crate::image::GrayImage;
use crate::vision::outline::circle::{BallFit, Polarity};

/// Reach of Tukey's biweight in the successive fits, in radii.
const REACH: [f64; 3] = [0.16, 0.08, 0.05];
/// Edges are looked for up to this part of the radius within and outside the circle.
const WIDE: f64 = 0.3;
/// Steps of a fit.
const STEPS: usize = 4;
/// Error of an edge that a whole side of the outline shares (shading, blur), pixels.
const SYSTEMATIC: f64 = 0.1;
/// Deviations by which the outline differs from a circle: less may be chance.
const SIGNIFICANT: f64 = 3.5;
/// A ball's ellipse has the center of the circle that fits it, up to this part of the radius.
const MAX_SHIFT: f64 = 0.2;
/// Shortest half axis over the longest: a ball at 45 degrees off the axis has 0.7.
const MIN_SHAPE: f64 = 0.65;
/// Minimum share of rays with an edge on the ellipse: a terminator or a hand leaves less.
const MIN_SUPPORT: f64 = 0.6;

/// Center u and v, `r`, `p` and `q`; `p` and `q` of a circle are 0.
pub(crate) type Parameters = SVector<f64, 5>;
type Information = SMatrix<f64, 5, 5>;

impl Unrolled {
    /// Fits an ellipse near a circle (u, v, r); `None` where the edges do not show one beyond doubt. The eccentricity points
    /// to either side.
    pub fn fit_ellipse(
        &mut self,
        image: &GrayImage,
        start: Vector3<f64>,
        polarity: Polarity,
    ) -> Option<BallFit> {
        let sign = polarity.sign();
        let range = ((1.0 - WIDE) * start.z, (1.0 + WIDE) * start.z);
        self.find_edges(image, &start, range, sign);
        let mut ellipse = Parameters::new(start.x, start.y, start.z, 0.0, 0.0);
        for reach in REACH {
            for _ in 0..STEPS {
                ellipse = self
                    .ellipse_step(&ellipse, (reach * start.z).max(LAST_REACH))?
                    .0;
            }
        }
        let scatter = self.ellipse_step(&ellipse, LAST_REACH)?.1;
        let reach = (TUKEY * scatter).clamp(0.8, LAST_REACH);
        for _ in 0..STEPS {
            ellipse = self.ellipse_step(&ellipse, reach)?.0;
        }
        let (_, scatter, information, support) = self.ellipse_step(&ellipse, reach)?;
        let shift = (ellipse.fixed_rows::<2>(0) - start.xy()).norm();
        let (radius, shape) = (ellipse[2], Vector2::new(ellipse[3], ellipse[4]));
        let stretch = shape.norm();
        let ratio = ((1.0 - stretch) / (1.0 + stretch)).sqrt();
        if !(support >= MIN_SUPPORT && shift < MAX_SHIFT * start.z && ratio > MIN_SHAPE) {
            return None;
        }
        let variance = CORRELATED * scatter * scatter;
        let covariance = information.try_inverse()? * variance;
        let along = Parameters::new(0.0, 0.0, 0.0, shape.x, shape.y) / stretch;
        let sigma = along.dot(&(covariance * along)).sqrt();
        let systematic = 2.0 * SYSTEMATIC + self.excess_width(image, &ellipse, sign);
        if stretch < SIGNIFICANT * sigma.hypot(systematic / radius) {
            return None;
        }
        let covariance = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        self.judge(image, &ellipse, covariance, polarity)
    }

    /// By how much wider the edges at the ends of the longer axis are than those of the shorter one, pixels: a moving ball's
    /// outline is drawn out where it is blurred.
    fn excess_width(&self, image: &GrayImage, ellipse: &Parameters, sign: f64) -> f64 {
        let (mut falls, mut slopes) = ([0.0; 2], [0.0; 2]);
        for ray in 0..RAYS {
            let Some((edge, (residual, j))) = self.nearest(ray, ellipse) else {
                continue;
            };
            if residual.abs() > LAST_REACH {
                continue;
            }
            let is_short =
                ellipse[3] * (j[0] * j[0] - j[1] * j[1]) + ellipse[4] * 2.0 * j[0] * j[1] > 0.0;
            let k = usize::from(is_short);
            falls[k] += self.fall(image, ellipse, ray, sign);
            slopes[k] += f64::from(edge.slope);
        }
        let width = |k: usize| falls[k].max(0.0) / f64::max(slopes[k], 1e-9);
        (width(0) - width(1)).max(0.0)
    }

    /// One reweighted step: the new ellipse, the residuals' standard deviation, the sum of `w J^T J` with the weights' mean
    /// 1, and the share of the rays within the image that have an edge on it.
    fn ellipse_step(
        &self,
        ellipse: &Parameters,
        reach: f64,
    ) -> Option<(Parameters, f64, Information, f64)> {
        let (sums, tukey, edges) = self.sums::<5>(ellipse, reach);
        if tukey < 8.0 {
            return None;
        }
        let information = sums.symmetric();
        let next = ellipse
            + information
                .cholesky()?
                .solve(&Parameters::from(sums.gradient));
        let is_ellipse = next[3].hypot(next[4]) < 0.6 && next[2] > 2.0;
        let reaches = self.reaches[..RAYS].iter();
        let seen = reaches.filter(|reach| **reach > ellipse[2]).count();
        is_ellipse.then_some((
            next,
            sums.scatter(),
            information * (tukey / sums.weights),
            edges as f64 / seen as f64,
        ))
    }

    /// The edge of a ray that lies best on the ellipse, how far outside it is, and the derivatives of the radius there.
    pub(super) fn nearest(
        &self,
        ray: usize,
        ellipse: &Parameters,
    ) -> Option<(&Edge, (f64, Parameters))> {
        let edges = self.edges[ray].iter().take_while(|e| e.slope > 0.0);
        let all = edges.filter_map(|e| Some((e, self.place(ray, e, ellipse)?)));
        let (edge, place) = all.min_by(|a, b| a.1.outside.abs().total_cmp(&b.1.outside.abs()))?;
        Some((edge, (place.outside, place.derivatives(ellipse))))
    }

    /// Where an edge lies by the ellipse.
    fn place(&self, ray: usize, edge: &Edge, ellipse: &Parameters) -> Option<RimPlace> {
        let [cos, sin] = self.directions[ray];
        let x = self.origin.x + cos * edge.radius - ellipse[0];
        let y = self.origin.y + sin * edge.radius - ellipse[1];
        let distance = (x * x + y * y).sqrt();
        if distance < 1e-6 {
            return None;
        }
        let mut place = RimPlace {
            outside: distance - ellipse[2],
            cos: x / distance,
            sin: y / distance,
            form: 1.0,
        };
        if ellipse[3] != 0.0 || ellipse[4] != 0.0 {
            let [c2, s2] = place.twice();
            place.form = 1.0 + ellipse[3] * c2 + ellipse[4] * s2;
            if place.form <= 0.0 {
                return None;
            }
            place.outside = distance - ellipse[2] / place.form.sqrt();
        }
        Some(place)
    }
}

/// Where an edge lies by an ellipse.
struct RimPlace {
    /// Pixels beyond it.
    outside: f64,
    cos: f64,
    sin: f64,
    /// `1 + p cos 2a + q sin 2a`.
    form: f64,
}

impl RimPlace {
    /// Cosine and sine of twice the angle.
    fn twice(&self) -> [f64; 2] {
        let (c, s) = (self.cos, self.sin);
        [c * c - s * s, 2.0 * c * s]
    }

    /// Of the ellipse's radius there, by its parameters.
    fn derivatives(&self, ellipse: &Parameters) -> Parameters {
        let by_radius = 1.0 / self.form.sqrt();
        let by_shape = -0.5 * ellipse[2] * by_radius / self.form;
        let [c2, s2] = self.twice();
        Parameters::new(self.cos, self.sin, by_radius, by_shape * c2, by_shape * s2)
    }
}
