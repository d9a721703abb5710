//! The noise-whitened nearest-neighbor distance: distances between features in units of the dots'
//! noise.
//!
//! A feature holds the properties of three dots (d, d', d'') that do not change when the ball
//! rotates. The distance of two features is how far the dots must move to turn one into the other,
//! which is
//!
//! ```text
//! d(T, T') = min_R sqrt( sum_i |t_i - R t'_i|^2 ) .
//! ```
//!
//! To first order this is the Mahalanobis distance of the two hash values under the covariance that
//! noise of unit variance in all dots gives them. Unlike the plain distance it cannot be raised by
//! nearly singular bases, and all six orders of three dots give the same value. The value is the
//! mean over all triples of the distance to the nearest other triple, in units of sigma.
//!
//! Nearest neighbors are sought among the closest in pairwise angles (`|difference|^2 / 4 <= d^2`), each triple's in
//! ascending order: of all orders of two triples that one has the smallest difference. They are then aligned exactly, as
//! is the triple with itself, its dots exchanged in a circle;
//! where the nearest switches, one of the two gradients is used. For more than 32 dots the mean is over as many triples
//! as 32 have, each among all.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::align::{add_gradient, align};
use super::evaluation::Evaluation;
use crate::error::{Error, Result};
use crate::geometry::{Vec3, angle_between, pair_rotation};

/// Candidates that are aligned for each triple: itself, and those of nearest angles. Of mirror
/// images, which have the same angles, half of them are expected to be unlike.
const CANDIDATES: NonZero<usize> = NonZero::new(12).unwrap();
/// Triples whose nearest is sought: all of 32 dots, of more dots as many in equal steps. The cost of a descent then
/// hardly grows beyond.
const MAX_TRIPLES: usize = 4_960;
/// Below this no direction of a distance is usable.
const TINY: f64 = 1e-9;

/// The objective's parameters.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct WhitenedNearestNeighbor {
    /// Noise of a dot, radians per tangent axis: the unit of the value.
    pub sigma_rad: f64,
}

impl Default for WhitenedNearestNeighbor {
    /// A rotation of N(0, 3 deg) about a random axis.
    fn default() -> Self {
        Self {
            sigma_rad: 3f64.to_radians() / 3f64.sqrt(),
        }
    }
}

/// Three dots in the order of the angles between them.
struct Triple {
    /// The first two are nearest to each other, the last two farthest apart.
    dots: [usize; 3],
    /// The three angles, ascending, radians.
    angles: [f64; 3],
}

impl Triple {
    fn all(dots: &[Vec3]) -> Vec<Self> {
        let n = dots.len();
        let angle: Vec<f64> = (0..n * n)
            .map(|k| angle_between(&dots[k / n], &dots[k % n]))
            .collect();
        let mut all = Vec::with_capacity(n * n * n / 6);
        for i in 0..n {
            for j in 0..i {
                for k in 0..j {
                    // Each side with the dot opposite to it.
                    let mut sides = [
                        (angle[j * n + k], i),
                        (angle[i * n + k], j),
                        (angle[i * n + j], k),
                    ];
                    sides.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
                    let [(a, opposite_a), (b, opposite_b), (c, opposite_c)] = sides;
                    all.push(Self {
                        dots: [opposite_c, opposite_b, opposite_a],
                        angles: [a, b, c],
                    });
                }
            }
        }
        all
    }
}

impl WhitenedNearestNeighbor {
    /// The mean distance from each triple to the most similar other one, in units of sigma, and its
    /// gradient.
    ///
    /// # Errors
    /// [`Error::Argument`] for coordinates that are not finite.
    pub fn evaluate(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let n = dots.len();
        let all = Triple::all(dots);
        let angles: Vec<[f64; 3]> = all.iter().map(|triple| triple.angles).collect();
        let tree: ImmutableKdTree<f64, 3> =
            ImmutableKdTree::new_from_slice(&angles).map_err(|e| {
                Error::argument("pattern", format!("no search tree over its triples: {e}"))
            })?;
        let mut gradient = vec![Vec3::zeros(); n];
        let (mut sum, mut count) = (0.0, 0.0);
        for at in (0..all.len()).step_by(all.len().div_ceil(MAX_TRIPLES).max(1)) {
            let triple = &all[at].dots;
            let near = tree
                .query(&angles[at])
                .nearest_n::<SquaredEuclidean<f64>>(CANDIDATES)
                .execute();
            let others = near.iter().map(|item| item.item as usize);
            let others = others.filter(|&other| other != at).map(|k| all[k].dots);
            let [i, j, k] = *triple;
            let nearest = others
                .chain([[j, k, i], [k, i, j]])
                .filter_map(|other| {
                    let [i, j, _] = *triple;
                    let [k, l, _] = other;
                    let start = pair_rotation([&dots[k], &dots[l]], [&dots[i], &dots[j]])?;
                    Some((other, align(dots, triple, &other, &start)?))
                })
                .min_by(|(_, a), (_, b)| a.distance_squared.total_cmp(&b.distance_squared));
            count += 1.0;
            let Some((other, alignment)) = nearest else {
                continue;
            };
            let distance = alignment.distance_squared.sqrt();
            sum += distance;
            if distance > TINY {
                let slope = 0.5 / distance;
                let rotation = &alignment.rotation;
                add_gradient(dots, triple, &other, rotation, slope, &mut gradient);
            }
        }
        let scale = 1.0 / (self.sigma_rad * f64::max(count, 1.0));
        gradient.iter_mut().for_each(|g| *g *= scale);
        Ok(Evaluation {
            value: sum * scale,
            gradient,
        })
    }
}
