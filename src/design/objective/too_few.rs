//! Expected rate of views that show too few dots, for any number of dots.
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
//! trials (Poisson's binomial distribution). The value is
//!
//! ```text
//! mean_v sum_k P(k | v) c_k,    c_k = 1 for k < min_dots, else logistic(a - b (k - min_dots)),
//! ```
//!
//! where `c_k` is the probability that a view with `k` detected dots fails. Where a number of dots is given
//! (`sparse`), a view of as many fails by what it looks like alone, which is not counted here. Else `a` and `b` are
//! read off the recognizer's answers for random patterns ([`CountFailures::of_view`]), or off a camera's frames
//! (`spindoe::camera`).
//!
//! Guaranteed: `P(k | v)` is exact, and so is the derivative for the value as computed, over directions on a spiral.
//! What the value leaves out: which dots are seen, so also whether others look like them.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::evaluation::Evaluation;
use crate::design::constraints::max_separation;
use crate::error::Result;
use crate::geometry::{Vec3, spiral_directions};
use crate::pattern::crowding::{CROWD, crowds, nearness};
use crate::pattern::random_pattern;
use crate::recognize::ORIENTATION_FAILURE_RAD;
use crate::recognize::robust::RobustRecognizer;
use crate::stats::logistic;
use crate::validate::{TrialResult, Trials};
use crate::view::{Detection, Trial, ViewModel};

/// Minimum number of viewing directions: with fewer a descent places dots for those alone.
const MIN_VIEWS: usize = 256;
/// Directions times the softness of the visibility limit: they lie nearer to each other than it reaches.
const VIEWS_BY_SOFTNESS: f64 = 10.24;
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
/// Width in z over which a dot fades at a protocol's limit, which is sharp; and at the end of a descent, since it
/// overstates the value: twelve dots of a search have 0.17 by it, 0.10 by the narrower one and by trials.
const SOFTNESS: f64 = 0.04;
const SHARP_SOFTNESS: f64 = 0.01;
/// Random patterns whose trials say how often views of `k` dots fail, trials of each, and their seed.
const PATTERNS: u64 = 24;
const TRIALS: u64 = 200;
const SEED: u64 = 15_700_001;
/// A logit of failures that never happen.
const NEVER: f64 = -40.0;
/// What `a` and `b` are without a view that says it, and how many standard deviations away from it one of them is
/// believed: as `image` has them for 20 dots.
const USUAL: [f64; 2] = [-1.7, 1.6];
const USUAL_SPREAD: f64 = 2.0;
/// Newton steps of the fit of `a` and `b`; it settles within eight.
const STEPS: usize = 20;

/// How often a view fails by the number of its detected dots.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CountFailures {
    /// Views with fewer dots fail.
    pub min_dots: usize,
    /// Logit of the failures with as many.
    pub logit: f64,
    /// What each further dot takes from it.
    pub slope: f64,
}

/// A view: how many dots are detected, and whether it is answered wrongly or not at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CountedView {
    /// Detected dots of the pattern.
    pub dots: usize,
    /// Whether it fails.
    pub fails: bool,
}

impl CountFailures {
    /// For a view that is answered whenever it shows so many dots.
    pub fn below(min_dots: usize) -> Self {
        Self {
            min_dots,
            logit: NEVER,
            slope: 0.0,
        }
    }

    /// For these views of patterns of so many dots: where dots are detected one by one, from the robust recognizer's
    /// answers to 4 800 trials of random patterns. The same on every call.
    ///
    /// # Errors
    /// As [`Trials::run`].
    pub fn of_view(view: &ViewModel, dots: usize) -> Result<Self> {
        if let Detection::Given { dots } = view.detection {
            return Ok(Self::below(dots.max(view.min_dots)));
        }
        let mut views = Vec::new();
        for k in 0..PATTERNS {
            let mut rng = ChaCha8Rng::seed_from_u64(SEED);
            rng.set_stream(k);
            let pattern = random_pattern(dots, 0.5 * max_separation(dots), &mut rng)?;
            let trials = Trials::first(&pattern, *view, SEED ^ k, TRIALS);
            let results = trials.run(&RobustRecognizer::new(&pattern, (*view).into())?, &|_| {})?;
            let mut generator = trials.generator();
            let mut trial = Trial::default();
            for (index, result) in (0..).zip(&results) {
                if let TrialResult::Judged { error_rad, .. } = result {
                    generator.generate(index, &mut trial);
                    views.push(CountedView {
                        dots: trial.real_dots(),
                        fails: *error_rad >= ORIENTATION_FAILURE_RAD,
                    });
                }
            }
        }
        Ok(Self::fit(&views))
    }

    /// The two numbers that these views of at least three dots make likeliest: a logistic regression with a weak prior.
    pub fn fit(views: &[CountedView]) -> Self {
        let [mut a, mut b] = USUAL;
        let precision = USUAL_SPREAD.powi(-2);
        for _ in 0..STEPS {
            let (mut by_a, mut by_b) = (-precision * (a - USUAL[0]), -precision * (b - USUAL[1]));
            let (mut aa, mut ab, mut bb) = (precision, 0.0, precision);
            for view in views.iter().filter(|view| view.dots >= MIN_COUNT) {
                let more = (view.dots - MIN_COUNT) as f64;
                let p = logistic(a - b * more);
                let (off, weight) = (f64::from(view.fails) - p, p * (1.0 - p));
                by_a += off;
                by_b -= off * more;
                aa += weight;
                ab -= weight * more;
                bb += weight * more * more;
            }
            let determinant = aa * bb - ab * ab;
            a += (bb * by_a - ab * by_b) / determinant;
            // More dots never fail more often.
            b = (b + (aa * by_b - ab * by_a) / determinant).max(0.0);
        }
        Self {
            min_dots: MIN_COUNT,
            logit: a,
            slope: b,
        }
    }

    fn of(&self, dots: usize) -> f64 {
        match dots.checked_sub(self.min_dots) {
            None => 1.0,
            Some(more) => logistic(self.logit - self.slope * more as f64),
        }
    }
}

/// The assumptions about a view.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TooFewDots {
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
    /// How often a view fails by the number of its detected dots.
    pub failures: CountFailures,
}

impl Default for TooFewDots {
    /// As in the `sparse` protocol: four dots with z > 1/3, each of which is detected.
    fn default() -> Self {
        Self {
            visibility_limit: 1.0 / 3.0,
            softness: SOFTNESS,
            limit_spread: 0.0,
            detection_probability: 1.0,
            crowding: 0.0,
            failures: CountFailures::below(4),
        }
    }
}

impl TooFewDots {
    /// For these views of patterns of so many dots.
    ///
    /// # Errors
    /// As [`CountFailures::of_view`].
    pub fn of_view(view: &ViewModel, dots: usize) -> Result<Self> {
        Ok(Self {
            visibility_limit: view.visibility_limit,
            detection_probability: match view.detection {
                Detection::Each { probability } => probability,
                Detection::Given { .. } => 1.0,
            },
            failures: CountFailures::of_view(view, dots)?,
            ..Self::default()
        })
    }

    /// With a limit as sharp as that of a protocol nearly is: for the end of a descent.
    #[must_use]
    pub fn sharpened(self) -> Self {
        Self {
            softness: match self.softness == SOFTNESS {
                true => SHARP_SOFTNESS,
                false => self.softness,
            },
            ..self
        }
    }

    /// The expected rate of views with too few dots, a fraction in [0, 1], and its derivative.
    pub fn evaluate(&self, dots: &[Vec3]) -> Evaluation {
        let n = dots.len();
        let crowds = crowds(dots);
        let of_count: Vec<f64> = (0..=n).map(|k| self.failures.of(k)).collect();
        let views = MIN_VIEWS.max((VIEWS_BY_SOFTNESS / self.softness).ceil() as usize);
        let mut count = DetectedCount::new(n);
        let mut chances = vec![0.0; n];
        let mut value = 0.0;
        let mut gradient = vec![Vec3::zeros(); n];
        let mut by_crowd = vec![0.0; n];
        for direction in spiral_directions(views) {
            for [level, weight] in self.levels() {
                let limit = self.visibility_limit + self.limit_spread * level;
                for ((s, d), crowd) in chances.iter_mut().zip(dots).zip(&crowds) {
                    let logit = (d.dot(&direction) - limit) / self.softness - self.crowding * crowd;
                    *s = self.detection_probability * logistic(logit);
                }
                let share = weight / views as f64;
                value += share * count.expectation(&chances, &of_count);
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
}

/// The number of dots that are detected, each by itself with its own probability.
struct DetectedCount {
    /// The distribution after the first `i` dots, by the number detected: row `i`.
    states: Vec<f64>,
    /// Derivatives of the last expectation by each dot's probability.
    slopes: Vec<f64>,
}

impl DetectedCount {
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
        let mut count = DetectedCount::new(chances.len());
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
    fn the_fit_finds_the_numbers_that_views_were_drawn_from() {
        use rand::RngExt;
        let truth = CountFailures {
            min_dots: 3,
            logit: -0.8,
            slope: 0.9,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let views: Vec<CountedView> = (0..20_000)
            .map(|_| {
                let dots = rng.random_range(3..9);
                CountedView {
                    dots,
                    fails: rng.random::<f64>() < truth.of(dots),
                }
            })
            .collect();
        let found = CountFailures::fit(&views);
        assert!((found.logit - truth.logit).abs() < 0.1, "{found:?}");
        assert!((found.slope - truth.slope).abs() < 0.08, "{found:?}");
        // Without a view it is the usual one, and none ever fails more often with more dots.
        assert_eq!(CountFailures::fit(&[]).logit, USUAL[0]);
        let odd = [3, 4, 5, 6].map(|dots| CountedView {
            dots,
            fails: dots > 4,
        });
        assert!(CountFailures::fit(&odd.repeat(50)).slope >= 0.0);
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
