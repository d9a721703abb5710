//! The paper's objective and its gradient: the mean distance from each hash feature to its nearest
//! neighbor in hash space.
//!
//! For the basis `B = [d, d', d x d']` of unit vectors with cosine `c = d . d'` and `s2 = 1 - c^2`,
//! the feature `h = B^-1 x` has the closed form
//!
//! ```text
//! h1 = (d . x - c d' . x) / s2,   h2 = (d' . x - c d . x) / s2,   h3 = (d x d') . x / s2
//! ```
//!
//! so its derivatives are polynomials over `s2`. The mean distance is differentiable wherever no
//! feature has two nearest neighbors at the same distance. Elsewhere the gradient of one of them is
//! used (a generalized gradient of a locally Lipschitz function), which a line search must
//! tolerate.
//!
//! Nearly singular bases raise the raw distance without benefit: `|h|` grows like `1 / s2` without
//! making a feature any easier to distinguish. Only bases whose angle lies within
//! [`MeanNearestNeighbor::min_pair_angle_rad`] of neither 0 nor pi enter; each ordered pair's
//! weight falls smoothly from 1 to 0 across the last few degrees, so that a pair that crosses the
//! bound makes no jump.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Vector3;
use std::num::NonZero;

use super::evaluation::Evaluation;
use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Width of the smooth edge of the pair rule, in `s2 = sin^2`.
const EDGE: f64 = 0.05;
/// Distances below this have no usable direction.
const TINY: f64 = 1e-12;
/// A feature and its nearest neighbor.
const TWO: NonZero<usize> = NonZero::new(2).unwrap();

/// The objective's parameters.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MeanNearestNeighbor {
    /// A pair of dots nearer than this to parallel or opposite is no basis, radians.
    pub min_pair_angle_rad: f64,
}

impl Default for MeanNearestNeighbor {
    /// 20 degrees: there `1 / sin^2`, the growth of noise in a feature, has reached about 9.
    fn default() -> Self {
        Self {
            min_pair_angle_rad: 20f64.to_radians(),
        }
    }
}

/// One feature on the tape: which dots made it, and its basis' weight.
struct FeatureEntry {
    first: usize,
    second: usize,
    third: usize,
    weight: f64,
}

impl MeanNearestNeighbor {
    /// The weighted mean nearest-neighbor distance of unit vectors, without unit, and its gradient.
    ///
    /// # Errors
    /// [`Error::Argument`] for coordinates from which no search tree can be built (not finite).
    pub fn evaluate(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let (entries, features) = self.features(dots);
        let mut gradient = vec![Vec3::zeros(); dots.len()];
        let value = mean_and_adjoints(&entries, &features, dots, &mut gradient)?;
        Ok(Evaluation { value, gradient })
    }

    fn features(&self, dots: &[Vec3]) -> (Vec<FeatureEntry>, Vec<[f64; 3]>) {
        let n = dots.len();
        let min_squared_sine = self.min_pair_angle_rad.sin().powi(2);
        let mut entries = Vec::with_capacity(n * n * n);
        let mut features = Vec::with_capacity(n * n * n);
        for first in 0..n {
            for second in 0..n {
                if first == second {
                    continue;
                }
                let (a, b) = (&dots[first], &dots[second]);
                let weight = edge((a.cross(b).norm_squared() - min_squared_sine) / EDGE);
                if weight == 0.0 {
                    continue;
                }
                for third in (0..n).filter(|&k| k != first && k != second) {
                    features.push(feature(a, b, &dots[third]).into());
                    entries.push(FeatureEntry {
                        first,
                        second,
                        third,
                        weight,
                    });
                }
            }
        }
        (entries, features)
    }
}

/// `B^-1 x` in closed form.
fn feature(a: &Vec3, b: &Vec3, x: &Vec3) -> Vec3 {
    let c = a.dot(b);
    let s2 = 1.0 - c * c;
    let (ax, bx) = (a.dot(x), b.dot(x));
    Vec3::new(ax - c * bx, bx - c * ax, a.cross(b).dot(x)) / s2
}

/// Smooth step from 0 at `t <= 0` to 1 at `t >= 1`.
fn edge(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn edge_slope(t: f64) -> f64 {
    if (0.0..=1.0).contains(&t) {
        6.0 * t * (1.0 - t)
    } else {
        0.0
    }
}

/// The weighted mean of the nearest-neighbor distances; adds its derivatives by dot.
fn mean_and_adjoints(
    entries: &[FeatureEntry],
    features: &[[f64; 3]],
    dots: &[Vec3],
    by_dot: &mut [Vec3],
) -> Result<f64> {
    let total: f64 = entries.iter().map(|e| e.weight).sum();
    if features.len() < 2 || total <= 0.0 {
        return Ok(0.0);
    }
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(features).map_err(|e| {
        Error::argument("pattern", format!("no search tree over its features: {e}"))
    })?;
    let mut adjoints = vec![Vec3::zeros(); features.len()];
    let mut distances = vec![0.0; features.len()];
    let mut value = 0.0;
    for (i, h) in features.iter().enumerate() {
        let found = tree
            .query(h)
            .nearest_n::<SquaredEuclidean<f64>>(TWO)
            .execute();
        let Some(other) = found.iter().find(|n| n.item as usize != i) else {
            continue;
        };
        let j = other.item as usize;
        let delta = Vector3::from(*h) - Vector3::from(features[j]);
        let distance = delta.norm();
        distances[i] = distance;
        value += entries[i].weight * distance;
        if distance > TINY {
            let pull = delta * (entries[i].weight / (distance * total));
            adjoints[i] += pull;
            adjoints[j] -= pull;
        }
    }
    value /= total;
    for (((e, h), g), distance) in entries.iter().zip(features).zip(&adjoints).zip(&distances) {
        let by_weight = (distance - value) / total;
        back_propagate(e, &Vector3::from(*h), g, by_weight, dots, by_dot);
    }
    Ok(value)
}

/// Adds the derivative of `g . h + by_weight * weight` with respect to the feature's three dots.
fn back_propagate(
    e: &FeatureEntry,
    h: &Vec3,
    g: &Vec3,
    by_weight: f64,
    dots: &[Vec3],
    by_dot: &mut [Vec3],
) {
    let (a, b, x) = (&dots[e.first], &dots[e.second], &dots[e.third]);
    let c = a.dot(b);
    let s2 = 1.0 - c * c;
    let (ax, bx) = (a.dot(x), b.dot(x));
    let q = g / s2;
    // Through c: numerators -c b.x and -c a.x, and the common factor 1 / s2 (d(1/s2)/dc = 2c /
    // s2^2).
    let by_c = -q.x * bx - q.y * ax + 2.0 * c * g.dot(h) / s2;
    let by_ax = q.x - c * q.y;
    let by_bx = q.y - c * q.x;
    by_dot[e.first] += b * by_c + x * by_ax + b.cross(x) * q.z;
    by_dot[e.second] += a * by_c + x * by_bx + x.cross(a) * q.z;
    by_dot[e.third] += a * by_ax + b * by_bx + a.cross(b) * q.z;
    // The weight depends on s2 alone; d s2 / dc = -2c. At full weight the slope is zero.
    if e.weight < 1.0 {
        let t = inverse_edge(e.weight);
        let slope = by_weight * edge_slope(t) / EDGE * (-2.0 * c);
        by_dot[e.first] += b * slope;
        by_dot[e.second] += a * slope;
    }
}

/// The `t` in (0, 1) with `edge(t) = w`.
fn inverse_edge(w: f64) -> f64 {
    0.5 - ((1.0 - 2.0 * w).clamp(-1.0, 1.0).asin() / 3.0).sin()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random_direction;
    use rand::SeedableRng;

    #[test]
    fn value_matches_brute_force() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        let dots: Vec<Vec3> = (0..8).map(|_| random_direction(&mut rng)).collect();
        let objective = MeanNearestNeighbor::default();
        let (entries, features) = objective.features(&dots);
        let (mut sum, mut weight) = (0.0, 0.0);
        for (i, h) in features.iter().enumerate() {
            let nearest = (0..features.len())
                .filter(|&j| j != i)
                .map(|j| (Vector3::from(*h) - Vector3::from(features[j])).norm())
                .fold(f64::INFINITY, f64::min);
            sum += entries[i].weight * nearest;
            weight += entries[i].weight;
        }
        let found = objective.evaluate(&dots).expect("finite");
        assert!((found.value - sum / weight).abs() < 1e-9);
    }
}
