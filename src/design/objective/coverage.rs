//! Expected rate of views that show too few dots, for any number of dots: how well a pattern covers
//! the ball for a camera that detects dots one by one.
//!
//! In a view from the direction `v` dot `i` is detected with the probability
//!
//! ```text
//! s_i(v) = p logistic((p_i . v - limit) / softness - crowding N_i),
//! N_i = sum_j exp(-|p_i - p_j|^2 / (2 0.3^2)),
//! ```
//!
//! a curve of its z whose limit differs from view to view (normally distributed), and less where other
//! dots are near. The number `k` of detected dots has the distribution `P(k | v)` of independent
//! trials. The value is
//!
//! ```text
//! mean_v sum_k P(k | v) c_k,    c_k = 1 for k < 3, else min(1, exp((0.29 - k / m) / 0.19)),
//! ```
//!
//! where `c_k` is the probability that `k` dots are too few to be sure of any pose, with `m` the number
//! of dots that a view of so many detects on average. Its two numbers are read off the recognizer's
//! answers for 20 and 48 dots before a small ball.
//!
//! Guaranteed: `P(k | v)` is exact, and so is the derivative for the value as computed, over 256
//! directions on a spiral. What the value leaves out: which dots are seen, so also whether others look
//! like them, noise and false dots. It is an order of patterns, not a rate. docs/objectives.md says for
//! what cameras it orders them well.

use super::evaluation::Evaluation;
use crate::geometry::{Vec3, spiral_directions};
use crate::pattern::crowding::{CROWD, crowds, nearness};

/// Viewing directions: with fewer a descent places dots for those alone.
const VIEWS: usize = 256;
/// Gauss and Hermite's nodes and weights for the mean over a normal distribution.
pub(crate) const LEVELS: [[f64; 2]; 5] = [
    [-2.856_970_013_872_806, 0.011_257_411_327_720_69],
    [-1.355_626_179_974_266, 0.222_075_922_005_612_6],
    [0.0, 0.533_333_333_333_333_3],
    [1.355_626_179_974_266, 0.222_075_922_005_612_6],
    [2.856_970_013_872_806, 0.011_257_411_327_720_69],
];
/// The one level of a limit that does not vary.
const ONE_LEVEL: [[f64; 2]; 1] = [[0.0, 1.0]];
/// Fewer dots than this determine no pose.
const MIN_COUNT: usize = 3;
/// Share of the dots detected on average at which a view begins to have enough, and by how much
/// more of it the probability of too few falls by `e`.
const ENOUGH: f64 = 0.29;
const SCARCITY: f64 = 0.19;
/// Points of z over which the average view is worked out.
const HEIGHTS: usize = 200;

/// The objective's assumptions about a view.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Coverage {
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
}

impl Default for Coverage {
    /// What `spindoe::camera::coverage` finds for 20 dots on a ball of 26 pixels.
    fn default() -> Self {
        Self {
            visibility_limit: 0.31,
            softness: 0.14,
            limit_spread: 0.15,
            detection_probability: 0.98,
            crowding: 0.5,
        }
    }
}

impl Coverage {
    /// The expected rate of views with too few dots, a fraction in [0, 1], and its derivative.
    pub fn evaluate(&self, dots: &[Vec3]) -> Evaluation {
        let n = dots.len();
        let crowds = crowds(dots);
        let too_few = self.too_few(n);
        let mut count = Count::new(n);
        let mut chances = vec![0.0; n];
        let mut value = 0.0;
        let mut gradient = vec![Vec3::zeros(); n];
        let mut by_crowd = vec![0.0; n];
        for direction in spiral_directions(VIEWS) {
            for [level, weight] in self.levels() {
                let limit = self.visibility_limit + self.limit_spread * level;
                for ((s, d), crowd) in chances.iter_mut().zip(dots).zip(&crowds) {
                    let logit = (d.dot(&direction) - limit) / self.softness - self.crowding * crowd;
                    *s = self.detection_probability * logistic(logit);
                }
                let share = weight / VIEWS as f64;
                value += share * count.expectation(&chances, &too_few);
                for (i, (s, slope)) in chances.iter().zip(&count.slopes).enumerate() {
                    let by_logit = share * slope * s * (1.0 - s / self.detection_probability);
                    gradient[i] += by_logit / self.softness * direction;
                    by_crowd[i] -= by_logit * self.crowding;
                }
            }
        }
        for i in 0..n {
            for j in 0..i {
                let by_nearness = by_crowd[i] + by_crowd[j];
                let slope = by_nearness * nearness(&dots[i], &dots[j]) / (CROWD * CROWD);
                let apart = dots[i] - dots[j];
                gradient[i] -= slope * apart;
                gradient[j] += slope * apart;
            }
        }
        Evaluation { value, gradient }
    }

    /// Places of the limit in its distribution, in standard deviations, and their weights.
    fn levels(&self) -> &'static [[f64; 2]] {
        if self.limit_spread > 0.0 {
            &LEVELS
        } else {
            &ONE_LEVEL
        }
    }

    /// The probability that so many detected dots of `n` are too few, by their number: all but certain
    /// far below the number that a view shows on average, for then other explanations than this
    /// pattern are as likely.
    fn too_few(&self, n: usize) -> Vec<f64> {
        let mean = n as f64 * self.mean_probability();
        (0..=n)
            .map(|k| {
                if k < MIN_COUNT {
                    1.0
                } else {
                    ((ENOUGH - k as f64 / mean) / SCARCITY).exp().min(1.0)
                }
            })
            .collect()
    }

    /// The probability that a lonely dot anywhere on the ball is detected.
    fn mean_probability(&self) -> f64 {
        let height = |h: usize| 2.0 * (h as f64 + 0.5) / HEIGHTS as f64 - 1.0;
        let at = |limit: f64| {
            let all = (0..HEIGHTS).map(|h| logistic((height(h) - limit) / self.softness));
            all.sum::<f64>() / HEIGHTS as f64
        };
        let levels = self.levels().iter();
        let mean: f64 = levels
            .map(|[level, weight]| weight * at(self.visibility_limit + self.limit_spread * level))
            .sum();
        self.detection_probability * mean
    }
}

fn logistic(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

/// The number of dots that are detected, each by itself with its own probability.
struct Count {
    /// The distribution after the first `i` dots, by the number detected: row `i`.
    states: Vec<f64>,
    /// Derivatives of the last expectation by each dot's probability.
    slopes: Vec<f64>,
}

impl Count {
    fn new(dots: usize) -> Self {
        let mut states = vec![0.0; (dots + 1) * (dots + 1)];
        states[0] = 1.0;
        Self {
            states,
            slopes: vec![0.0; dots],
        }
    }

    /// The expectation of what `of_count` says of the number.
    fn expectation(&mut self, chances: &[f64], of_count: &[f64]) -> f64 {
        let width = of_count.len();
        for (i, &s) in chances.iter().enumerate() {
            let (done, next) = self.states.split_at_mut((i + 1) * width);
            let (before, after) = (&done[i * width..], &mut next[..width]);
            after[0] = (1.0 - s) * before[0];
            for k in 1..=i + 1 {
                after[k] = (1.0 - s) * before[k] + s * before[k - 1];
            }
        }
        // From the last dot to the first: what is expected, given the number among those before.
        let mut expected = of_count.to_vec();
        for (i, &s) in chances.iter().enumerate().rev() {
            let mut slope = 0.0;
            for (k, probability) in self.states[i * width..][..=i].iter().enumerate() {
                let step = expected[k + 1] - expected[k];
                slope += probability * step;
                expected[k] += s * step;
            }
            self.slopes[i] = slope;
        }
        expected[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_detected_dots_is_distributed_as_all_subsets_say() {
        let chances = [0.3, 0.9, 0.05, 0.6, 0.5];
        let of_count = [1.0, 0.7, -0.2, 0.1, 3.0, 0.4];
        let brute = |chances: &[f64]| -> f64 {
            let subsets = 0..1u32 << chances.len();
            subsets
                .map(|subset| {
                    let factor = |(i, s): (usize, &f64)| match subset >> i & 1 {
                        1 => *s,
                        _ => 1.0 - s,
                    };
                    let share: f64 = chances.iter().enumerate().map(factor).product();
                    share * of_count[subset.count_ones() as usize]
                })
                .sum()
        };
        let mut count = Count::new(chances.len());
        // Twice: the memory of another distribution is none of this one's.
        count.expectation(&[0.5; 5], &of_count);
        let found = count.expectation(&chances, &of_count);
        assert!((found - brute(&chances)).abs() < 1e-12);
        for (i, slope) in count.slopes.iter().enumerate() {
            let at = |s: f64| {
                let mut chances = chances;
                chances[i] = s;
                brute(&chances)
            };
            // The expectation is linear in each probability.
            assert!((slope - (at(1.0) - at(0.0))).abs() < 1e-12, "{i}");
        }
    }

    #[test]
    fn the_levels_weigh_a_normal_distribution() {
        let moment = |power: i32| -> f64 { LEVELS.iter().map(|[x, w]| w * x.powi(power)).sum() };
        for (power, expected) in [
            (0, 1.0),
            (1, 0.0),
            (2, 1.0),
            (4, 3.0),
            (6, 15.0),
            (8, 105.0),
        ] {
            assert!((moment(power) - expected).abs() < 1e-9, "{power}");
        }
    }
}
