//! Confusion, worked out: the expected rate at which four seen dots are taken for four others.
//!
//! Four dots `q_i` of the pattern look like four others `q'_i` (in this order) up to
//!
//! ```text
//! d^2 = min_R sum_i |q_i - R q'_i|^2 .
//! ```
//!
//! With Gaussian noise of sigma a tangent axis, the wrong one of the two explanations is the likelier
//! one with probability `Phi(-d / (2 sigma))`: the noise must carry the four dots half the way, in the one
//! direction that tells the two apart. Summed over all `q'` (the union bound, saturated at one) and
//! weighted with the probability that a view gives just these four dots, this is the failure rate of the
//! `sparse` protocol, without a trial being drawn. It is smooth in the dots, and there are no trials in
//! it that could be over-fitted.
//!
//! The weight of four dots is the mean over viewing directions `v` of `s_a s_b s_c s_d / e_4(s)`, with a
//! dot's soft visibility `s_i(v)` and the elementary symmetric polynomial `e_4`, which counts the
//! quadruples in view.
//!
//! What it leaves out: the noise of the protocols is a turn about a random axis, whose projections have
//! heavier tails than a Gaussian (excess kurtosis 2.4 for one dot, some 0.7 for four).
//! [`Confusion::tail_factor`] widens sigma for them.

use nalgebra::Matrix3;

use super::Evaluation;
use super::align::{Alignment, add_gradient, align};
use super::erfc::normal_tail;
use crate::geometry::{Vec3, pair_rotation, spiral_directions};

/// Quadruples farther apart than this many sigma are left out; one in 740 of them is confused.
const REACH: f64 = 6.0;
/// Added to the diagonal of a triangle's Gram matrix: in flat triangles moves across the arcs, of second
/// order, change what those along them cannot.
const FLAT: f64 = 0.1;
/// Slack on squared distances that are right to first order only.
const FIRST_ORDER: f64 = 1.4;
/// Pairs nearer to parallel or opposite than this sine do not fix a rotation.
const MIN_SINE: f64 = 0.25;
/// Width in z over which a dot fades at the visibility limit.
const SOFTNESS: f64 = 0.04;
/// Viewing directions.
const VIEWS: usize = 400;
/// Quadruples less likely in view than this are skipped.
const MIN_PRODUCT: f64 = 1e-6;

/// Most dots for which the quadruples are looked at: their number grows with the eighth power.
pub const MAX_DOTS: usize = 24;

/// What the objective assumes of a view.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Confusion {
    /// Noise of a dot, radians per tangent axis.
    pub sigma_rad: f64,
    /// Factor on sigma for tails heavier than a Gaussian's, without unit.
    pub tail_factor: f64,
    /// Least z of a dot that can be given.
    pub visibility_limit: f64,
}

impl Default for Confusion {
    /// As in the `sparse` protocol: a turn of N(0, 3 deg) about a random axis, dots with z > 1/3.
    fn default() -> Self {
        Self {
            sigma_rad: 3f64.to_radians() / 3f64.sqrt(),
            tail_factor: 1.2,
            visibility_limit: 1.0 / 3.0,
        }
    }
}

/// Four dots of the pattern (ascending indices) that look like four others.
struct Match {
    seen: [usize; 4],
    other: [usize; 4],
    alignment: Alignment,
}

/// Four dots (ascending indices) and the union bound on their confusion.
struct Quadruple {
    dots: [usize; 4],
    union: f64,
}

impl Confusion {
    /// The expected failure rate, a fraction in [0, 1], and its derivative.
    pub fn evaluate(&self, dots: &[Vec3]) -> Evaluation {
        let sigma = self.sigma_rad * self.tail_factor;
        let mut matches = Search::new(dots, REACH * sigma).matches();
        matches.sort_unstable_by_key(|m| (m.seen, m.other));
        let failures: Vec<_> = matches
            .iter()
            .map(|m| failure(m.alignment.distance_squared, sigma))
            .collect();
        let mut quadruples: Vec<Quadruple> = Vec::new();
        for (m, f) in matches.iter().zip(&failures) {
            match quadruples.last_mut() {
                Some(q) if q.dots == m.seen => q.union += f.value,
                _ => quadruples.push(Quadruple {
                    dots: m.seen,
                    union: f.value,
                }),
            }
        }
        let mut gradient = vec![Vec3::zeros(); dots.len()];
        let weights = self.weigh(dots, &quadruples, &mut gradient);
        let value = quadruples
            .iter()
            .zip(&weights)
            .map(|(q, w)| w * (1.0 - (-q.union).exp()))
            .sum();
        let mut at = 0;
        for (m, f) in matches.iter().zip(&failures) {
            while quadruples[at].dots != m.seen {
                at += 1;
            }
            let slope = f.slope * weights[at] * (-quadruples[at].union).exp();
            let rotation = &m.alignment.rotation;
            add_gradient(dots, &m.seen, &m.other, rotation, slope, &mut gradient);
        }
        Evaluation { value, gradient }
    }

    /// The probability that a view gives each quadruple; adds the derivative of the weighted sum of
    /// failures through the visibilities.
    fn weigh(&self, dots: &[Vec3], quadruples: &[Quadruple], gradient: &mut [Vec3]) -> Vec<f64> {
        let n = dots.len();
        let failures: Vec<f64> = quadruples.iter().map(|q| 1.0 - (-q.union).exp()).collect();
        let mut weights = vec![0.0; quadruples.len()];
        let mut seen = vec![0.0; n];
        let mut by_seen = vec![0.0; n];
        for v in spiral_directions(VIEWS) {
            for (s, d) in seen.iter_mut().zip(dots) {
                *s = 1.0 / (1.0 + (-(d.dot(&v) - self.visibility_limit) / SOFTNESS).exp());
            }
            let count = Count::new(&seen);
            by_seen.fill(0.0);
            let mut total = 0.0;
            for ((q, failure), weight) in quadruples.iter().zip(&failures).zip(&mut weights) {
                let [a, b, c, d] = q.dots;
                let product = (seen[a] * seen[b]) * (seen[c] * seen[d]);
                if product < MIN_PRODUCT {
                    continue;
                }
                let share = product / (count.value * VIEWS as f64);
                *weight += share;
                total += failure * share;
                for i in q.dots {
                    by_seen[i] += failure * share / seen[i];
                }
            }
            for i in 0..n {
                let by_count = total * count.derivatives[i] / count.value;
                let by_z = (by_seen[i] - by_count) * seen[i] * (1.0 - seen[i]) / SOFTNESS;
                gradient[i] += by_z * v;
            }
        }
        weights
    }
}

/// A probability of confusion and its slope with respect to the squared distance.
struct Failure {
    value: f64,
    slope: f64,
}

/// `Phi(-d / (2 sigma))`, faded out over the last quarter before the reach.
fn failure(distance_squared: f64, sigma: f64) -> Failure {
    let x = 0.5 * distance_squared.max(1e-12).sqrt() / sigma;
    let (tail, density) = normal_tail(x);
    let (begin, end) = (0.375 * REACH, 0.5 * REACH);
    let t = ((x - begin) / (end - begin)).clamp(0.0, 1.0);
    let fade = 1.0 - t * t * (3.0 - 2.0 * t);
    let fade_slope = -6.0 * t * (1.0 - t) / (end - begin);
    Failure {
        value: tail * fade,
        // x^2 = d^2 / (4 sigma^2), hence dx / d(d^2) = 1 / (8 sigma^2 x).
        slope: (tail * fade_slope - density * fade) / (8.0 * sigma * sigma * x),
    }
}

/// The elementary symmetric polynomial of degree 4 of the visibilities, at least 1 (a view of fewer
/// than four dots is no view), and its derivatives.
struct Count {
    value: f64,
    derivatives: Vec<f64>,
}

impl Count {
    fn new(seen: &[f64]) -> Self {
        let mut e = [1.0, 0.0, 0.0, 0.0, 0.0];
        for &s in seen {
            for k in (1..=4).rev() {
                e[k] += s * e[k - 1];
            }
        }
        // Without s the polynomials follow from below: f_k = e_k - s f_(k-1).
        let without = |s: f64| e[1..4].iter().fold(1.0, |f, e| e - s * f);
        let derivatives = if e[4] > 1.0 {
            seen.iter().map(|&s| without(s)).collect()
        } else {
            vec![0.0; seen.len()]
        };
        Self {
            value: e[4].max(1.0),
            derivatives,
        }
    }
}

/// A third dot that looks like another, given a pair, and a bound on the distance of the three.
struct Link {
    seen: usize,
    other: usize,
    distance_squared: f64,
}

/// The three dots that are seen, prepared for comparison with others.
///
/// To first order the dots' displacements `r` change the three angles by `g = A r`, a step of either end
/// along the arc between them; the least `|r|^2` that explains differences `g` is `g^T (A A^T)^-1 g`, where
/// `A A^T` has 2 on its diagonal and the cosines of the triangle's corners beside it.
struct Triangle {
    /// Of the angles ij, ia, ja.
    inverse: Matrix3<f64>,
    /// `det [i j a]`, which tells a triangle from its mirror image.
    determinant: f64,
}

impl Triangle {
    fn new(dots: &[Vec3], [i, j, a]: [usize; 3]) -> Self {
        let corner = |at: usize, b: usize, c: usize| -> f64 {
            let arm = |to: usize| dots[to] - dots[at] * dots[at].dot(&dots[to]);
            let (b, c) = (arm(b), arm(c));
            b.dot(&c) / (b.norm() * c.norm()).max(1e-12)
        };
        let (at_i, at_j, at_a) = (corner(i, j, a), corner(j, i, a), corner(a, i, j));
        #[rustfmt::skip]
        let gram = Matrix3::new(
            2.0 + FLAT, at_i, at_j,
            at_i, 2.0 + FLAT, at_a,
            at_j, at_a, 2.0 + FLAT,
        );
        Self {
            inverse: gram.try_inverse().unwrap_or_else(Matrix3::zeros),
            determinant: dots[i].cross(&dots[j]).dot(&dots[a]),
        }
    }
}

/// Finds all quadruples that look alike, each once: from the pair of the four seen dots whose angle is
/// nearest to a right one. That pair is laid on each pair of similar angle; a third dot must then look
/// like a third, and a fourth like a fourth.
struct Search<'a> {
    dots: &'a [Vec3],
    n: usize,
    reach_squared: f64,
    sines: Vec<f64>,
    angles: Vec<f64>,
    determinants: Vec<f64>,
}

impl<'a> Search<'a> {
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
        Self {
            dots,
            n,
            reach_squared: reach * reach,
            sines: table(&|a, b| a.cross(b).norm()),
            angles: table(&|a, b| a.dot(b).clamp(-1.0, 1.0).acos()),
            determinants,
        }
    }

    fn sine(&self, i: usize, j: usize) -> f64 {
        self.sines[i * self.n + j]
    }

    /// By how much the angles of two pairs differ.
    fn gap(&self, i: usize, j: usize, k: usize, l: usize) -> f64 {
        self.angles[i * self.n + j] - self.angles[k * self.n + l]
    }

    fn matches(&self) -> Vec<Match> {
        let mut found = Vec::new();
        let mut links = Vec::new();
        let mut thirds = Vec::new();
        for i in 0..self.n {
            for j in (0..i).filter(|&j| self.sine(i, j) >= MIN_SINE) {
                let least = self.sine(i, j);
                thirds.clear();
                thirds.extend(
                    (0..self.n)
                        .filter(|&a| a != i && a != j)
                        .filter(|&a| self.sine(i, a) <= least && self.sine(j, a) <= least)
                        .map(|a| (a, Triangle::new(self.dots, [i, j, a]))),
                );
                for k in 0..self.n {
                    for l in (0..self.n).filter(|&l| l != k && (k, l) != (i, j)) {
                        // Two dots that differ by the gap lie apart by at least half its square.
                        if 0.5 * self.gap(i, j, k, l).powi(2) < self.reach_squared {
                            self.link([i, j], [k, l], &thirds, &mut links);
                            self.extend([i, j], [k, l], &links, &mut found);
                        }
                    }
                }
            }
        }
        found
    }

    /// All dots that look like others beside a pair laid on a pair.
    fn link(
        &self,
        [i, j]: [usize; 2],
        [k, l]: [usize; 2],
        thirds: &[(usize, Triangle)],
        links: &mut Vec<Link>,
    ) {
        links.clear();
        let most = FIRST_ORDER * self.reach_squared;
        // A displacement r of three unit vectors changes their determinant by at most sqrt(3) |r|.
        let max_turned = (3.0 * most).sqrt();
        let pair_gap = self.gap(i, j, k, l);
        for (a, triangle) in thirds {
            for c in (0..self.n).filter(|&c| c != k && c != l) {
                let determinant = self.determinants[(k * self.n + l) * self.n + c];
                if (determinant - triangle.determinant).abs() > max_turned {
                    continue;
                }
                let gaps = Vec3::new(pair_gap, self.gap(i, *a, k, c), self.gap(j, *a, l, c));
                let distance_squared = gaps.dot(&(triangle.inverse * gaps));
                if distance_squared < most {
                    links.push(Link {
                        seen: *a,
                        other: c,
                        distance_squared,
                    });
                }
            }
        }
    }

    /// All quadruples that two links make of a pair laid on a pair.
    fn extend(
        &self,
        [i, j]: [usize; 2],
        [k, l]: [usize; 2],
        links: &[Link],
        found: &mut Vec<Match>,
    ) {
        if links.len() < 2 {
            return;
        }
        let (d, least) = (self.dots, self.sine(i, j));
        let most = FIRST_ORDER * self.reach_squared;
        let Some(start) = pair_rotation([&d[k], &d[l]], [&d[i], &d[j]]) else {
            return;
        };
        for (x, link) in links.iter().enumerate() {
            for before in &links[..x] {
                let (a, c) = (link.seen, link.other);
                let (b, e) = (before.seen, before.other);
                if a == b || c == e || self.sine(a, b) > least {
                    continue;
                }
                // The pair counts in both triangles, the others once; and the last pair has a gap too.
                let apart = 0.5 * (link.distance_squared + before.distance_squared);
                if apart > most || 0.5 * self.gap(a, b, c, e).powi(2) > most {
                    continue;
                }
                let (seen, other) = ([i, j, a, b], [k, l, c, e]);
                let Some(alignment) = align(d, &seen, &other, &start, self.reach_squared) else {
                    continue;
                };
                if alignment.distance_squared < self.reach_squared {
                    let mut order = [0, 1, 2, 3];
                    order.sort_unstable_by_key(|&x| seen[x]);
                    found.push(Match {
                        seen: order.map(|x| seen[x]),
                        other: order.map(|x| other[x]),
                        alignment,
                    });
                }
            }
        }
    }
}
