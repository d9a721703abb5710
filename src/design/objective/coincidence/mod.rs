//! Expected rate at which the dots that a camera detects are too few, or coincide with those of a
//! false pose: for any number of dots.
//!
//! In a view from the direction `v` dot `i` is detected with the probability `s_i(v)`, a logistic curve
//! of its z whose limit differs from view to view, less where other dots are near it. The number `k`
//! of detected dots then has the distribution `P(k | v)` of independent trials. Under a false pose,
//! the rotation `R` (some 20 degrees or more from the true one), dot `i` lies `delta_ij` from `R p_j`.
//! With Gaussian noise of sigma per tangent axis the evidence of `k` dots for the false pose overtakes
//! that for the true one with a probability of at most `1/2 prod exp(-delta^2 / 8 sigma^2)` (A.
//! Bhattacharyya, Bull. Calcutta Math. Soc. 35, 1943). Averaged over which `k` dots are detected, and
//! summed over all false poses, that is half of
//!
//! ```text
//! S_k(v) = int e_k(s g) / e_k(s) dR / V_k,
//! g_i(R) = 1 - prod_j (1 - exp(-delta_ij^2 / 8 sigma^2)),
//! V_k = (8 pi sigma^2)^(3/2) (2 k / 3)^(-3/2),
//! ```
//!
//! with the elementary symmetric polynomials `e_k`, and with `V_k` as the part of the rotations that a
//! pose of `k` dots takes. The value is
//!
//! ```text
//! mean_v sum_k P(k | v) (1 - (1 - c_k) exp(-S_k(v) / 2)),
//! ```
//!
//! where `c_k` is the probability that `k` dots are too few to be sure of any pose: 1 for fewer than
//! three, then `exp((0.29 - k / m) / 0.19)`, with `m` the number of dots that a view detects on
//! average. These two numbers are read off the recognizer's answers for 20 and 48 dots before a small
//! ball. `S_k` falls with `k`: from 12 on its value there bounds the rest.
//!
//! The integral needs no search for look-alikes of `k` dots. Let `w_i w_j sin^2` weigh a pair of
//! coinciding dots, and `N(R)` be the sum over all such pairs: then `1 = sum_pairs (w_i w_j sin^2) / N`,
//! and the integral is a sum over pairs of dots laid on pairs of dots. Each is taken at the rotation
//! that lays midpoint on midpoint. Pairs are found by their angles in a sorted list, what else
//! coincides by an index over directions. Where there are many dots the seen pairs are a sample in
//! which every dot occurs alike: over all samples the mean of the scaled sum is the whole sum. The
//! sample goes by the dots' numbers, so that it depends on their order.
//!
//! Guaranteed: the derivative is exact for the value as computed. What the value leaves out:
//! coincidences beyond 6 sigma (the kernel is lowered to reach zero there; it changes by at most 0.033),
//! the shape of the pairs' weights in their integrals (tests compare with random rotations: right but
//! for some tenths), false dots, dots that the false pose shows and nobody detects, noise other than
//! Gaussian. It is an order of patterns, not a rate.

mod cells;
mod gradient;
mod polynomials;
mod rivals;
mod views;
mod weight;

use self::gradient::Backward;
use self::polynomials::Polynomials;
use self::rivals::rivals;
use self::views::Views;
use self::weight::Weight;
use super::Evaluation;
use crate::geometry::Vec3;

/// Dots farther apart than this many sigma do not coincide.
const REACH: f64 = 6.0;
/// Pairs are laid on others where dots come this near, in sigma.
const PAIR_REACH: f64 = 2.828_427_124_746_190_3;
/// Rotations by less than the first angle are the true pose; by more than the second, false ones.
const WINDOW_RAD: [f64; 2] = [0.26, 0.44];
/// Viewing directions.
const VIEWS: usize = 64;
/// Least and largest number of detected dots that is counted; all larger ones count as it.
const MIN_COUNT: usize = 3;
const MAX_COUNT: usize = 12;
/// Numbers of detected dots.
const COUNTS: usize = MAX_COUNT - MIN_COUNT + 1;
/// About how many false poses are evaluated, for so many dots.
const RIVALS: [(usize, usize); 3] = [(20, 5_000), (32, 9_000), (64, 24_000)];

/// From this noise on fewer are: more coincide under each, radians.
const DENSE_SIGMA: f64 = 0.018;

/// The objective's assumptions about a view.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Coincidence {
    /// Noise of a dot, radians per tangent axis.
    pub sigma_rad: f64,
    /// Where a dot is detected half as often as one in the middle: its z.
    pub visibility_limit: f64,
    /// Width in z over which detection fades there: of a logistic curve.
    pub softness: f64,
    /// Standard deviation of the limit from view to view.
    pub limit_spread: f64,
    /// Probability that a dot in the middle is detected.
    pub detection_probability: f64,
    /// What a dot right beside another loses of the logit of its probability of detection.
    pub crowding: f64,
    /// So many dots are given, of those detected; `None` where it is all.
    pub given: Option<usize>,
}

impl Default for Coincidence {
    /// What `spindoe::predict::coincidence` finds for 20 dots on a ball of 26 pixels.
    fn default() -> Self {
        Self {
            sigma_rad: 0.0153,
            visibility_limit: 0.31,
            softness: 0.14,
            limit_spread: 0.15,
            detection_probability: 0.98,
            crowding: 0.5,
            given: None,
        }
    }
}

/// How well two dots coincide, by their squared distance.
#[derive(Debug, Clone, Copy)]
struct Kernel {
    /// Largest distance that counts.
    reach: f64,
    /// `8 sigma^2`.
    width: f64,
    /// `(pair reach)^2`.
    pair_reach_squared: f64,
}

impl Kernel {
    fn new(sigma: f64) -> Self {
        Self {
            reach: REACH * sigma,
            width: 8.0 * sigma * sigma,
            pair_reach_squared: (PAIR_REACH * sigma).powi(2),
        }
    }

    /// `exp(-d^2 / 8 sigma^2)`, lowered to reach zero with its slope at the reach.
    fn at(&self, squared: f64) -> (f64, f64) {
        let most = REACH * REACH / 8.0;
        let end = (-most).exp();
        let scale = 1.0 / (1.0 - end * (1.0 + most));
        let u = squared / self.width;
        let value = (-u).exp();
        (
            scale * (value - end * (1.0 + most - u)),
            scale * (end - value) / self.width,
        )
    }

    /// The weight of a dot in a pair: `exp(-d^2 / 4 sigma^2)` with a short reach.
    fn pair_weight(&self, squared: f64) -> (f64, f64) {
        let t = 1.0 - squared / self.pair_reach_squared;
        if t > 0.0 {
            (t * t, -2.0 * t / self.pair_reach_squared)
        } else {
            (0.0, 0.0)
        }
    }
}

impl Coincidence {
    /// The expected failure rate, a fraction in [0, 1], and its derivative.
    pub fn evaluate(&self, dots: &[Vec3]) -> Evaluation {
        let kernel = Kernel::new(self.sigma_rad);
        let sample = Sample::of(dots.len(), self.sigma_rad);
        let found = rivals(dots, &kernel, &sample.pairs);
        let views = Views::new(dots, self);
        let mut sums = Sums::default();
        let mut polynomials = Polynomials::default();
        let weights: Vec<Weight> = found
            .rivals
            .iter()
            .map(|rival| {
                let weight = Weight::new(dots, &found, rival, &kernel);
                if weight.value > 0.0 {
                    polynomials.fill(&found, rival, &views);
                    polynomials.add_to(&mut sums, sample.scale * weight.value, &views);
                }
                weight
            })
            .collect();
        let closed = views.close(&sums);
        let mut back = Backward {
            dots,
            found: &found,
            views: &views,
            kernel: &kernel,
            slopes: &closed.slopes,
            scale: sample.scale,
            by_seen: vec![0.0; dots.len() * VIEWS],
            by_value: Vec::new(),
            gradient: vec![Vec3::zeros(); dots.len()],
        };
        for (rival, weight) in found.rivals.iter().zip(&weights) {
            if weight.value > 0.0 {
                polynomials.fill(&found, rival, &views);
                back.rival(rival, weight, &mut polynomials);
            }
        }
        let Backward {
            mut by_seen,
            mut gradient,
            ..
        } = back;
        views.add_by_subsets(&sums, &closed.slopes, &mut by_seen);
        views.add_gradient(dots, &closed, &by_seen, &mut gradient);
        Evaluation {
            value: closed.value,
            gradient,
        }
    }
}

/// The seen pairs that rivals are made from, and the ratio of all pairs to them.
struct Sample {
    pairs: Vec<[usize; 2]>,
    scale: f64,
}

impl Sample {
    /// Pairs of indices that differ by certain steps, so that every dot is in as many.
    fn of(n: usize, sigma: f64) -> Self {
        let wanted = wanted_rivals(n) as f64 * (DENSE_SIGMA / sigma).min(1.0);
        // Of all pairs of pairs so many have nearly equal angles.
        let share = (2.0 * PAIR_REACH * sigma * 2.0 * 0.75).min(1.0);
        let all = n * (n - 1) / 2;
        let each = share * (n * (n - 1)) as f64;
        let half = n / 2;
        let steps = ((wanted / each / n as f64).ceil() as usize).clamp(1, half);
        let mut pairs = Vec::with_capacity(steps * n);
        for s in 0..steps {
            // Spread over all differences of indices, without a difference twice.
            let step = 1 + s * half / steps;
            for i in 0..n {
                let k = (i + step) % n;
                // Of an even number of dots half the way round is met from both ends.
                if 2 * step != n || i < k {
                    pairs.push([i, k]);
                }
            }
        }
        Self {
            scale: all as f64 / pairs.len() as f64,
            pairs,
        }
    }
}

fn wanted_rivals(n: usize) -> usize {
    let [first, .., last] = RIVALS;
    if n <= first.0 {
        return first.1;
    }
    for ends in RIVALS.windows(2) {
        let [(n0, r0), (n1, r1)] = [ends[0], ends[1]];
        if n <= n1 {
            return r0 + (r1 - r0) * (n - n0) / (n1 - n0);
        }
    }
    last.1
}

/// `(2 k / 3)^(3/2)` for each number of detected dots.
fn volumes() -> [f64; COUNTS] {
    std::array::from_fn(|c| (2.0 * (MIN_COUNT + c) as f64 / 3.0).powf(1.5))
}

/// `S_k(v)` before its volume, by number and direction.
struct Sums {
    of: [[f64; VIEWS]; COUNTS],
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            of: [[0.0; VIEWS]; COUNTS],
        }
    }
}
