//! Analytic confusion rate: the expected rate at which four visible dots are mistaken for four
//! others.
//!
//! Four dots `q_i` of the pattern look like four others `q'_i` (in this order) up to
//!
//! ```text
//! d^2 = min_R sum_i |q_i - R q'_i|^2 .
//! ```
//!
//! With Gaussian noise of sigma per tangent axis, the wrong one of the two explanations is more
//! likely with probability `Phi(-d / (2 sigma))`: the noise must carry the four dots half the
//! distance, in the one direction that separates the two. Summed over all `q'` (the union bound,
//! saturated at one) and weighted with the probability that a view shows exactly these four dots,
//! this is the failure rate of the `sparse` protocol. No trial is drawn, so no trial can be
//! over-fitted. The value is smooth in the dots.
//!
//! The weight of four dots is the mean over viewing directions `v` of `s_a s_b s_c s_d / e_4(s)`,
//! with a dot's soft visibility `s_i(v)` and the elementary symmetric polynomial `e_4`, which
//! counts the quadruples in view.
//!
//! The sum runs over all ordered quadruples but the identity: also over those that keep some of the
//! four dots, and over the orders of the four themselves. The tests compare it with brute force.
//!
//! What it leaves out:
//! - Probabilities fade to zero from `d = 4.5 sigma` to `d = 6 sigma`, where the confusion
//!   probability is one in 740. This omits up to a fifth of the sum over all distances.
//! - The noise of the protocols is a rotation about a random axis, whose projections have heavier
//!   tails than a Gaussian (excess kurtosis 2.4 for one dot, about 0.7 for four).
//!   [`Confusion::tail_factor`] widens sigma for them.

use super::align::add_gradient;
use super::erfc::normal_tail;
use super::evaluation::Evaluation;
use super::lookalikes::lookalikes;
use crate::geometry::{Vec3, spiral_directions};
use crate::view::ViewModel;

/// Quadruples farther apart than this many sigma are left out; one in 740 of them is confused.
const REACH: f64 = 6.0;
/// Width in z over which a dot fades at the visibility limit.
const SOFTNESS: f64 = 0.04;
/// Viewing directions.
const VIEWS: usize = 400;
/// Quadruples less likely in view than this are skipped.
const MIN_PRODUCT: f64 = 1e-6;

/// Maximum number of dots for which it is computed: the number of quadruples grows with the eighth
/// power.
pub const MAX_DOTS: usize = 24;

/// The objective's assumptions about a view.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Confusion {
    /// Noise of a dot, radians per tangent axis.
    pub sigma_rad: f64,
    /// Factor on sigma for tails heavier than a Gaussian's, without unit.
    pub tail_factor: f64,
    /// Minimum z of a dot that can be given.
    pub visibility_limit: f64,
}

impl Default for Confusion {
    /// As in the `sparse` protocol: a rotation of N(0, 3 deg) about a random axis, dots with z >
    /// 1/3.
    fn default() -> Self {
        Self {
            sigma_rad: 3f64.to_radians() / 3f64.sqrt(),
            tail_factor: 1.2,
            visibility_limit: 1.0 / 3.0,
        }
    }
}

/// Four dots (ascending indices) and the union bound on their confusion.
struct Quadruple {
    dots: [usize; 4],
    union: f64,
}

impl Confusion {
    /// For these views.
    pub fn of_view(view: &ViewModel) -> Self {
        Self {
            sigma_rad: super::sigma_rad(view),
            visibility_limit: view.visibility_limit,
            ..Self::default()
        }
    }

    /// The expected failure rate, a fraction in [0, 1], and its derivative.
    pub fn evaluate(&self, dots: &[Vec3]) -> Evaluation {
        let sigma = self.sigma_rad * self.tail_factor;
        let mut matches = lookalikes(dots, REACH * sigma);
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
        let places = RankedPlaces::new(n, quadruples);
        let mut weights = vec![0.0; quadruples.len()];
        let mut seen = vec![0.0; n];
        let mut by_dot = vec![0.0; n];
        let mut in_view = Vec::with_capacity(n);
        for v in spiral_directions(VIEWS) {
            for (s, d) in seen.iter_mut().zip(dots) {
                *s = 1.0 / (1.0 + (-(d.dot(&v) - self.visibility_limit) / SOFTNESS).exp());
            }
            let count = VisibleFours::new(&seen);
            in_view.clear();
            in_view.extend((0..n).filter(|&i| seen[i] >= MIN_PRODUCT));
            by_dot.fill(0.0);
            let mut total = 0.0;
            let of_product = 1.0 / (count.value * VIEWS as f64);
            for_each_quadruple(&in_view, &seen, |quadruple, number, product| {
                let Some(at) = places.of(number) else {
                    return;
                };
                let share = product * of_product;
                weights[at] += share;
                let failing = failures[at] * share;
                total += failing;
                for i in quadruple {
                    by_dot[i] += failing;
                }
            });
            for &i in &in_view {
                // A product's derivative by one of its factors, times that factor, is the product.
                let by_count = total * count.derivatives[i] / count.value * seen[i];
                let by_z = (by_dot[i] - by_count) * (1.0 - seen[i]) / SOFTNESS;
                gradient[i] += by_z * v;
            }
        }
        weights
    }
}

/// Calls `visit` with each four of these dots (ascending), their [`number`] and the product of their visibilities,
/// unless it is below [`MIN_PRODUCT`]. A view shows a third of the dots, and so one in a hundred quadruples.
fn for_each_quadruple(dots: &[usize], seen: &[f64], mut visit: impl FnMut([usize; 4], usize, f64)) {
    for (w, &d) in dots.iter().enumerate() {
        let number_of_d = choose(d, 4);
        for (z, &c) in dots[..w].iter().enumerate() {
            let two = seen[d] * seen[c];
            if two < MIN_PRODUCT {
                continue;
            }
            let number_of_cd = number_of_d + choose(c, 3);
            for (y, &b) in dots[..z].iter().enumerate() {
                let three = two * seen[b];
                if three < MIN_PRODUCT {
                    continue;
                }
                let number_of_bcd = number_of_cd + choose(b, 2);
                for &a in &dots[..y] {
                    let product = three * seen[a];
                    if product >= MIN_PRODUCT {
                        visit([a, b, c, d], number_of_bcd + a, product);
                    }
                }
            }
        }
    }
}

/// Where each four dots stand among the quadruples that look like others.
struct RankedPlaces {
    /// By the quadruple's number among all of them; [`RankedPlaces::NONE`] where none looks like it.
    of_number: Vec<u32>,
}

impl RankedPlaces {
    const NONE: u32 = u32::MAX;

    fn new(dots: usize, quadruples: &[Quadruple]) -> Self {
        let mut of_number = vec![Self::NONE; choose(dots, 4)];
        for (at, quadruple) in (0..).zip(quadruples) {
            of_number[number(quadruple.dots)] = at;
        }
        Self { of_number }
    }

    /// Of the four dots of this [`number`].
    fn of(&self, number: usize) -> Option<usize> {
        let at = self.of_number[number];
        (at != Self::NONE).then_some(at as usize)
    }
}

/// The number of four ascending dots among all of them (the combinatorial number system).
fn number([a, b, c, d]: [usize; 4]) -> usize {
    a + choose(b, 2) + choose(c, 3) + choose(d, 4)
}

/// The binomial coefficient for `k` up to 4.
fn choose(n: usize, k: usize) -> usize {
    let product: usize = (0..k).map(|i| n.saturating_sub(i)).product();
    product / [1, 1, 2, 6, 24][k]
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
struct VisibleFours {
    value: f64,
    derivatives: Vec<f64>,
}

impl VisibleFours {
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
