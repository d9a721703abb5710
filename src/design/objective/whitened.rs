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
//! ascending order: of all orders of two triples that one has the smallest difference. They, and the triple itself, are
//! then aligned exactly, in every order that the angles leave possible; where the nearest switches, one of the two
//! gradients is used. For more than 32 dots the mean is over as many triples as 32 have, each among all.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::align::{Alignment, add_gradient, align};
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

/// The orders of three dots.
const ORDERS: [[usize; 3]; 6] = [
    [0, 1, 2],
    [0, 2, 1],
    [1, 0, 2],
    [1, 2, 0],
    [2, 0, 1],
    [2, 1, 0],
];

/// Three dots in the order of the angles between them.
struct Triple {
    /// The first two are nearest to each other, the last two farthest apart.
    dots: [usize; 3],
    /// The three angles, ascending, radians.
    angles: [f64; 3],
}

impl Triple {
    /// No alignment with a triple of these angles is nearer, with the dots in this order.
    fn gap_squared(&self, angles: &[f64; 3], order: [usize; 3]) -> f64 {
        let [a, b, c] = self.angles;
        // Between the first two dots, the first and the last, the last two.
        let between = [[0.0, a, b], [a, 0.0, c], [b, c, 0.0]];
        let [i, j, k] = order;
        let mine = [between[i][j], between[i][k], between[j][k]];
        let gaps = mine.iter().zip(angles).map(|(x, y)| (x - y) * (x - y));
        0.25 * gaps.sum::<f64>()
    }

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
            let mut nearest: Option<([usize; 3], Alignment)> = None;
            for other in near.iter().map(|item| &all[item.item as usize]) {
                for order in ORDERS {
                    let least = nearest
                        .as_ref()
                        .map_or(f64::INFINITY, |n| n.1.distance_squared);
                    let dots_of = order.map(|k| other.dots[k]);
                    if dots_of == *triple || other.gap_squared(&angles[at], order) >= least {
                        continue;
                    }
                    let ([i, j, _], [k, l, _]) = (*triple, dots_of);
                    let start = pair_rotation([&dots[k], &dots[l]], [&dots[i], &dots[j]]);
                    let aligned = start.and_then(|start| align(dots, triple, &dots_of, &start));
                    if let Some(aligned) = aligned.filter(|a| a.distance_squared < least) {
                        nearest = Some((dots_of, aligned));
                    }
                }
            }
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
