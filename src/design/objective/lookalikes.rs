//! Search for similar quadruples of dots: all of them within a distance, each once.
//!
//! Four dots `s_i` look like four others `o_i` (in this order) up to
//! `d^2 = min_R sum |s_i - R o_i|^2`. The distance does not change when either set rotates: with
//! `M = sum s_i o_i^T`, `d^2 = 2 (k - l)` for `k` dots and the largest root `l` of
//!
//! ```text
//! l^4 - 2 t l^2 - 8 det(M) l + 2 u - t^2,      t = tr(M^T M),   u = tr((M^T M)^2)
//! ```
//!
//! (D. L. Theobald, "Rapid calculation of RMSDs using a quaternion-based characteristic
//! polynomial", Acta Cryst. A61, 2005), and all three follow from the cosines and determinants of
//! the two sets. All roots are real, so Newton's iteration from `l = k` falls to the root without
//! passing it: the value after any step is a lower bound of `d^2`.
//!
//! The search prunes by such bounds alone, so it loses nothing:
//! - any part of the dots lies no farther from its image than all of them,
//! - two dots alone: `8 sin^2(gap / 4)`, where `gap` is the difference of the two angles,
//! - two triangles that share a pair count that pair twice: half their sum,
//! - the three pairs of a triangle count each dot twice: half their sum,
//! - a displacement `r` of three unit vectors changes their determinant by at most `sqrt(3) |r|`.

use nalgebra::{Matrix3, Matrix4, SMatrix};

use super::align::{Alignment, align};
use crate::geometry::{Vec3, kabsch, pair_rotation};

/// Newton steps; a root apart from the others takes three or four.
const STEPS: usize = 8;
/// A Newton step shorter than this ends the iteration.
const SETTLED: f64 = 1e-13;
/// Added to the squared reach where a candidate is pruned, against rounding.
const ROUNDING: f64 = 1e-12;

/// Four dots of the pattern (ascending indices) that look like four others.
pub(super) struct LookalikeFour {
    pub seen: [usize; 4],
    pub other: [usize; 4],
    pub alignment: Alignment,
}

impl LookalikeFour {
    fn new(seen: [usize; 4], other: [usize; 4], alignment: Alignment) -> Self {
        let mut order = [0, 1, 2, 3];
        order.sort_unstable_by_key(|&x| seen[x]);
        Self {
            seen: order.map(|x| seen[x]),
            other: order.map(|x| other[x]),
            alignment,
        }
    }

    /// The others, which look like these.
    fn reversed(&self) -> Self {
        let Alignment {
            rotation,
            distance_squared,
        } = self.alignment;
        let alignment = Alignment {
            rotation: rotation.transpose(),
            distance_squared,
        };
        Self::new(self.other, self.seen, alignment)
    }
}

/// All pairs of quadruples no farther apart than `reach`, but the identities.
pub(super) fn lookalikes(dots: &[Vec3], reach: f64) -> Vec<LookalikeFour> {
    LookalikeSearch::new(dots, reach).run()
}

/// `min_R sum |s_i - R o_i|^2` of K unit vectors given by their cosines and the determinant of
/// `sum s_i o_i^T`; `None` where it exceeds `limit`. The result may be a little low, never high.
fn distance_squared<const K: usize>(
    seen: &SMatrix<f64, K, K>,
    other: &SMatrix<f64, K, K>,
    determinant: f64,
    limit: f64,
) -> Option<f64> {
    let product = seen * other;
    let t = product.trace();
    let u = product.dot(&product.transpose());
    let count = K as f64;
    let (mut root, min_root) = (count, count - 0.5 * limit);
    for _ in 0..STEPS {
        let square = root * root;
        let value = square * (square - 2.0 * t) - 8.0 * determinant * root + 2.0 * u - t * t;
        let slope = 4.0 * (root * (square - t) - 2.0 * determinant);
        // At a double root, where both vanish, the iteration has arrived.
        if value <= 0.0 || slope <= 0.0 {
            break;
        }
        let step = value / slope;
        root -= step;
        if root < min_root {
            return None;
        }
        if step < SETTLED {
            break;
        }
    }
    Some(2.0 * (count - root))
}

/// A third dot that resembles another, given a pair, and the distance of the three.
struct LookalikeLink {
    seen: usize,
    other: usize,
    distance_squared: f64,
}

/// Finds each two quadruples from that pair of dots of both that is nearest to a right angle. That pair is aligned with
/// every pair of no higher rank; a third dot must then match a third, and a fourth a fourth. What looks like another is
/// looked like by it, so each two are found once and listed twice.
struct LookalikeSearch<'a> {
    dots: &'a [Vec3],
    n: usize,
    reach_squared: f64,
    /// Pairs whose angles differ by more lie farther apart than the reach.
    max_gap: f64,
    /// So do triangles whose determinants differ by more.
    max_turned: f64,
    /// The place of each pair in the order of their sines, ties by their numbers: no two are equal.
    ranks: Vec<usize>,
    cosines: Vec<f64>,
    angles: Vec<f64>,
    determinants: Vec<f64>,
    /// For each dot the others by their angle from it, `n - 1` in a row.
    nearest: Vec<LookalikeNeighbor>,
}

/// A dot as seen from another.
#[derive(Clone, Copy)]
struct LookalikeNeighbor {
    dot: usize,
    angle: f64,
}

impl<'a> LookalikeSearch<'a> {
    fn new(dots: &'a [Vec3], reach: f64) -> Self {
        let n = dots.len();
        let table = |f: &dyn Fn(&Vec3, &Vec3) -> f64| -> Vec<f64> {
            (0..n * n).map(|k| f(&dots[k / n], &dots[k % n])).collect()
        };
        let determinants = (0..n * n * n)
            .map(|k| {
                let normal = dots[k / (n * n)].cross(&dots[k / n % n]);
                normal.dot(&dots[k % n])
            })
            .collect();
        let sines = table(&|a, b| a.cross(b).norm());
        let mut pairs: Vec<usize> = (0..n * n).filter(|k| k / n > k % n).collect();
        pairs.sort_unstable_by(|&a, &b| sines[a].total_cmp(&sines[b]).then(a.cmp(&b)));
        let mut ranks = vec![0; n * n];
        for (rank, &pair) in pairs.iter().enumerate() {
            ranks[pair] = rank;
            ranks[pair % n * n + pair / n] = rank;
        }
        let angles = table(&|a, b| a.cross(b).norm().atan2(a.dot(b)));
        let mut nearest = Vec::with_capacity(n * n);
        for from in 0..n {
            let begin = nearest.len();
            let others = (0..n).filter(|&dot| dot != from);
            nearest.extend(others.map(|dot| LookalikeNeighbor {
                dot,
                angle: angles[from * n + dot],
            }));
            nearest[begin..].sort_unstable_by(|a, b| a.angle.total_cmp(&b.angle));
        }
        Self {
            dots,
            n,
            reach_squared: reach * reach + ROUNDING,
            max_gap: 4.0 * (reach / 8f64.sqrt()).min(1.0).asin() + ROUNDING,
            max_turned: 3f64.sqrt() * reach + ROUNDING,
            ranks,
            cosines: table(&|a, b| a.dot(b)),
            angles,
            determinants,
            nearest,
        }
    }

    fn rank(&self, i: usize, j: usize) -> usize {
        self.ranks[i * self.n + j]
    }

    fn determinant(&self, i: usize, j: usize, k: usize) -> f64 {
        self.determinants[(i * self.n + j) * self.n + k]
    }

    /// By how much the angles of two pairs differ.
    fn gap(&self, [i, j]: [usize; 2], [k, l]: [usize; 2]) -> f64 {
        self.angles[i * self.n + j] - self.angles[k * self.n + l]
    }

    /// The dots about as far from `from` as `angle` says.
    fn at_angle(&self, from: usize, angle: f64) -> impl Iterator<Item = usize> {
        let row = &self.nearest[from * (self.n - 1)..][..self.n - 1];
        let first = row.partition_point(|neighbor| neighbor.angle < angle - self.max_gap);
        let last = angle + self.max_gap;
        let near = row[first..].iter();
        near.take_while(move |n| n.angle <= last).map(|n| n.dot)
    }

    fn run(&self) -> Vec<LookalikeFour> {
        let (mut found, mut links, mut thirds) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..self.n {
            for j in 0..i {
                let rank = self.rank(i, j);
                thirds.clear();
                thirds.extend((0..self.n).filter(|&a| {
                    a != i && a != j && self.rank(i, a) < rank && self.rank(j, a) < rank
                }));
                for k in 0..self.n {
                    for l in (0..self.n).filter(|&l| l != k && self.rank(k, l) <= rank) {
                        if self.gap([i, j], [k, l]).abs() < self.max_gap {
                            self.link([i, j], [k, l], &thirds, &mut links);
                            self.extend([i, j], [k, l], &links, &mut found);
                        }
                    }
                }
            }
        }
        found
    }

    /// All dots that resemble others beside a pair aligned with a pair.
    fn link(
        &self,
        [i, j]: [usize; 2],
        [k, l]: [usize; 2],
        thirds: &[usize],
        links: &mut Vec<LookalikeLink>,
    ) {
        links.clear();
        let rank = self.rank(i, j);
        let pair_gap = self.gap([i, j], [k, l]);
        let max_squared = self.max_gap * self.max_gap;
        let gram = |i: usize, j: usize, a: usize| {
            let [x, y, z] = [i * self.n + j, i * self.n + a, j * self.n + a];
            let [x, y, z] = [x, y, z].map(|at| self.cosines[at]);
            Matrix3::new(1.0, x, y, x, 1.0, z, y, z, 1.0)
        };
        for &a in thirds {
            let determinant = self.determinant(i, j, a);
            let seen = gram(i, j, a);
            for c in self
                .at_angle(k, self.angles[i * self.n + a])
                .filter(|&c| c != l && self.rank(k, c) <= rank && self.rank(l, c) <= rank)
            {
                let gaps = [self.gap([i, a], [k, c]), self.gap([j, a], [l, c])];
                let [x, y] = gaps.map(|g| g * g);
                if x > max_squared
                    || y > max_squared
                    || pair_gap * pair_gap + x + y > 2.0 * max_squared
                {
                    continue;
                }
                let turned = self.determinant(k, l, c);
                if (turned - determinant).abs() > self.max_turned {
                    continue;
                }
                let product = determinant * turned;
                let other = gram(k, l, c);
                if let Some(distance_squared) =
                    distance_squared(&seen, &other, product, self.reach_squared)
                {
                    links.push(LookalikeLink {
                        seen: a,
                        other: c,
                        distance_squared,
                    });
                }
            }
        }
    }

    /// All quadruples that two links make of a pair aligned with a pair.
    fn extend(
        &self,
        [i, j]: [usize; 2],
        [k, l]: [usize; 2],
        links: &[LookalikeLink],
        found: &mut Vec<LookalikeFour>,
    ) {
        let rank = self.rank(i, j);
        for (x, link) in links.iter().enumerate() {
            for before in &links[..x] {
                let (a, c) = (link.seen, link.other);
                let (b, e) = (before.seen, before.other);
                if a == b || c == e || self.rank(a, b) > rank || self.rank(c, e) > rank {
                    continue;
                }
                let apart = 0.5 * (link.distance_squared + before.distance_squared);
                if apart > self.reach_squared || self.gap([a, b], [c, e]).abs() > self.max_gap {
                    continue;
                }
                let (seen, other) = ([i, j, a, b], [k, l, c, e]);
                if seen == other {
                    continue;
                }
                let Some(lookalike) = self.lookalike(seen, other) else {
                    continue;
                };
                // With the same best pair the two are found from either side.
                let has_pair = other.contains(&i) && other.contains(&j);
                if !has_pair {
                    found.push(lookalike.reversed());
                }
                found.push(lookalike);
            }
        }
    }

    /// The two quadruples aligned; `None` where they lie farther apart than the reach.
    fn lookalike(&self, seen: [usize; 4], other: [usize; 4]) -> Option<LookalikeFour> {
        let d = self.dots;
        let gram = |q: &[usize; 4]| {
            Matrix4::from_fn(|r, c| {
                if r == c {
                    1.0
                } else {
                    self.cosines[q[r] * self.n + q[c]]
                }
            })
        };
        // Cauchy and Binet: the determinant of a product is the sum over the triples of both.
        let determinant = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]
            .map(|[x, y, z]| {
                self.determinant(seen[x], seen[y], seen[z])
                    * self.determinant(other[x], other[y], other[z])
            })
            .iter()
            .sum();
        let limit = self.reach_squared;
        distance_squared(&gram(&seen), &gram(&other), determinant, limit)?;
        let [i, j, _, _] = seen.map(|i| &d[i]);
        let [k, l, _, _] = other.map(|i| &d[i]);
        let start = pair_rotation([k, l], [i, j]).or_else(|| {
            // The other pair is all but opposite: all four decide.
            let [from, to] = [other, seen].map(|q| q.map(|i| d[i]));
            Some(*kabsch(&from, &to, None).ok()?.to_rotation_matrix().matrix())
        })?;
        let alignment = align(d, &seen, &other, &start)?;
        Some(LookalikeFour::new(seen, other, alignment))
    }
}
