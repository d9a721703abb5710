//! Small statistics that several stages share: rates with intervals, differences of paired rates,
//! quantiles.
//!
//! - [`Proportion`]: Wilson's score interval (E. B. Wilson, "Probable inference, the law of
//!   succession, and statistical inference", J. Am. Stat. Assoc. 22, 1927),
//! - [`PairedDifference`]: Newcombe's score interval for paired proportions (R. G. Newcombe,
//!   "Improved confidence intervals for the difference between binomial proportions based on paired
//!   data", Statistics in Medicine 17, 1998, method 10), which keeps its width where hardly any
//!   trial differs,
//! - [`median`] and [`quantile`] of a sample,
//! - [`sign_test`], whether one of two passes more of the trials that only one passes,
//! - [`normal_cdf`], the distribution function of the standard normal distribution.
//!
//! Intervals have their nominal coverage for independent trials only.
//!
//! ```
//! use spindoe::stats::Proportion;
//!
//! let rate = Proportion::new(8, 10);
//! assert!(rate.low < 0.8 && 0.8 < rate.high);
//! ```

use serde::Deserialize as _;

/// Reads a number that JSON does not have: what is no number is written as null.
pub(crate) fn or_nan<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Option::<f64>::deserialize(from).map(|number| number.unwrap_or(f64::NAN))
}

/// Reads a number that may be infinite, which JSON writes as null.
pub(crate) fn or_infinite<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Option::<f64>::deserialize(from).map(|number| number.unwrap_or(f64::INFINITY))
}

/// The two-sided 95 % quantile of the standard normal distribution.
pub(crate) const Z95: f64 = 1.959_963_984_540_054;

/// Successes of independent trials, with the Wilson 95 % interval of the rate.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Proportion {
    /// Successful trials.
    pub successes: u64,
    /// All trials.
    pub trials: u64,
    /// `successes / trials`; 0 for no trials.
    pub rate: f64,
    /// Lower end of the 95 % interval.
    pub low: f64,
    /// Upper end of the 95 % interval.
    pub high: f64,
}

impl Proportion {
    /// Rate and interval of `successes` out of `trials`. No trials give the interval [0, 1].
    pub fn new(successes: u64, trials: u64) -> Self {
        if trials == 0 {
            return Self {
                successes,
                trials,
                rate: 0.0,
                low: 0.0,
                high: 1.0,
            };
        }
        let n = trials as f64;
        let p = successes as f64 / n;
        let z2 = Z95 * Z95;
        let center = (p + z2 / (2.0 * n)) / (1.0 + z2 / n);
        let half = Z95 / (1.0 + z2 / n) * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
        Self {
            successes,
            trials,
            rate: p,
            low: if successes == 0 { 0.0 } else { center - half },
            high: if successes == trials {
                1.0
            } else {
                center + half
            },
        }
    }
}

impl std::fmt::Display for Proportion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{:.2} % [{:.2}, {:.2}]",
            100.0 * self.rate,
            100.0 * self.low,
            100.0 * self.high
        )
    }
}

/// A difference of two rates over the same trials, with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PairedDifference {
    /// Trials evaluated for both.
    pub trials: u64,
    /// The rate less that of the first pattern.
    pub difference: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

/// Trials evaluated for two patterns, by which of them passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pairs {
    /// Both passed.
    pub both: u64,
    /// Only the one passed.
    pub gained: u64,
    /// Only the other, the reference, passed.
    pub lost: u64,
    /// Neither passed.
    pub neither: u64,
}

impl PairedDifference {
    /// The difference over these trials, with Newcombe's interval.
    pub fn new(pairs: Pairs) -> Self {
        let Pairs {
            both,
            gained,
            lost,
            neither,
        } = pairs;
        let trials = both + gained + lost + neither;
        let (one, other) = (
            Proportion::new(both + gained, trials),
            Proportion::new(both + lost, trials),
        );
        let [a, b, c, d, n] = [both, gained, lost, neither, trials].map(|k| k as f64);
        let margins = (a + b) * (c + d) * (a + c) * (b + d);
        let product = a * d - b * c;
        // The correlation of the two, corrected for continuity where it is positive.
        let product = if product > 0.0 {
            (product - 0.5 * n).max(0.0)
        } else {
            product
        };
        let phi = if margins > 0.0 {
            product / margins.sqrt()
        } else {
            0.0
        };
        let width = |x: f64, y: f64| (x * x - 2.0 * phi * x * y + y * y).max(0.0).sqrt();
        let difference = one.rate - other.rate;
        Self {
            trials,
            difference,
            low: difference - width(one.rate - one.low, other.high - other.rate),
            high: difference + width(one.high - one.rate, other.rate - other.low),
        }
    }

    /// The difference of a pattern from itself: exactly zero.
    pub fn with_itself(trials: u64) -> Self {
        Self {
            trials,
            difference: 0.0,
            low: 0.0,
            high: 0.0,
        }
    }
}

/// Standard deviation of a normal distribution over its median absolute deviation.
pub const SIGMA_PER_MAD: f64 = 1.4826;

/// The median (mean of the middle two for an even number; 0 for none). Reorders its input.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let mid = values.len() / 2;
    match values {
        [] => 0.0,
        _ if values.len() % 2 == 1 => values[mid],
        _ => 0.5 * (values[mid - 1] + values[mid]),
    }
}

/// No agreement makes an answer surer: what several see may be another thing, for all of them alike.
pub(crate) const SUREST: f64 = 0.9999;

/// The probability of an answer that several have given, independently, each right with its own probability: `agreeing` are those of the
/// ones that gave it, `others` those of the ones that gave another one each, `chance` the probability that a wrong answer agrees with it
/// by accident.
///
/// ```
/// use spindoe::stats::consensus;
///
/// assert!((consensus(&[0.8], &[], 0.0) - 0.8).abs() < 1e-12);
/// assert!(consensus(&[0.8, 0.8], &[], 1e-4) > 0.9999);
/// // 0.8 x 0.2 that the first is right, as much that the second is, 0.2 x 0.2 that neither is.
/// assert!((consensus(&[0.8], &[0.8], 1e-4) - 0.16 / 0.36).abs() < 1e-12);
/// ```
pub fn consensus(agreeing: &[f64], others: &[f64], chance: f64) -> f64 {
    // Certain answers that disagree have odds all the same.
    let doubt = |p: &f64| (1.0 - p).max(1e-12);
    let accident = chance.powi(agreeing.len().saturating_sub(1) as i32);
    let all = agreeing.iter().chain(others);
    let none: f64 = accident * all.map(doubt).product::<f64>();
    let right = agreeing.iter().product::<f64>() * others.iter().map(doubt).product::<f64>();
    let another: f64 = others.iter().map(|p| none * p / doubt(p)).sum();
    right / (right + another + none).max(f64::MIN_POSITIVE)
}

/// The probability that of trials which only one of two passes, where chance alone decides which, the other passes
/// no more than `others` while the one passes `own` (the sign test; of paired rates McNemar's, exact).
pub fn sign_test(own: u64, others: u64) -> f64 {
    let n = (own + others) as f64;
    let ln_choose =
        |k: f64| libm::lgamma(n + 1.0) - libm::lgamma(k + 1.0) - libm::lgamma(n - k + 1.0);
    let terms = (0..=others).map(|k| (ln_choose(k as f64) - n * std::f64::consts::LN_2).exp());
    terms.sum::<f64>().min(1.0)
}

/// `P(N(0, 1) <= x)`.
pub fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}

/// The `z` that a standard normal number exceeds, up or down, with the probability `error`.
#[cfg(feature = "vision")]
pub(crate) fn normal_reach(error: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match 2.0 * normal_cdf(-middle) > error {
            true => low = middle,
            false => high = middle,
        }
    }
    high
}

/// Of the normal distribution's tail, over the density: a polynomial of `1 / (1 + scale |x|)`, highest power first.
pub(crate) const TAIL: [f64; 5] = [
    1.330_274_429,
    -1.821_255_978,
    1.781_477_937,
    -0.356_563_782,
    0.319_381_530,
];
pub(crate) const TAIL_SCALE: f64 = 0.231_641_9;

/// `P(N(0, 1) <= x)` to 1e-7, and the density at `x`, faster than the one alone to the last digit (M. Abramowitz, I. Stegun, "Handbook of
/// mathematical functions", 1964, 26.2.17).
pub fn normal_cdf_and_density(x: f64) -> (f64, f64) {
    let density = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let t = 1.0 / (1.0 + TAIL_SCALE * x.abs());
    let beyond = density * t * TAIL.iter().fold(0.0, |sum, term| sum * t + term);
    (if x < 0.0 { beyond } else { 1.0 - beyond }, density)
}

/// The quantile `q` in [0, 1] of values in ascending order, interpolated between neighbors
/// (definition 7 of R. J. Hyndman, Y. Fan, "Sample quantiles in statistical packages", Am. Stat.
/// 50, 1996, which NumPy uses too); 0 for none.
pub fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return 0.0;
    };
    let at = q.clamp(0.0, 1.0) * last as f64;
    let (below, above) = (at.floor() as usize, at.ceil() as usize);
    sorted[below] + (at - at.floor()) * (sorted[above] - sorted[below])
}

/// The probability of these ln odds.
pub(crate) fn logistic(ln_odds: f64) -> f64 {
    1.0 / (1.0 + (-ln_odds).exp())
}

/// The median of values in ascending order; NaN for none.
#[cfg(feature = "vision")]
pub(crate) fn median_or_nan(sorted: &[f64]) -> f64 {
    match sorted {
        [] => f64::NAN,
        _ => quantile(sorted, 0.5),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_matches_published_values() {
        // statsmodels: proportion_confint(8, 10, method="wilson")
        let p = Proportion::new(8, 10);
        assert!((p.low - 0.490_162_47).abs() < 1e-7, "{p:?}");
        assert!((p.high - 0.943_317_8).abs() < 1e-7, "{p:?}");
        // The rule of three, in Wilson's form: z^2 / (n + z^2).
        let z2 = Z95 * Z95;
        assert!((Proportion::new(0, 100).high - z2 / (100.0 + z2)).abs() < 1e-12);
    }

    #[test]
    fn the_sign_test_counts_coins() {
        // Of 5 coins at most 1 shows heads in 6 of 32 throws; of 10 none in one of 1024.
        assert!((sign_test(4, 1) - 6.0 / 32.0).abs() < 1e-12);
        assert!((sign_test(10, 0) - 1.0 / 1024.0).abs() < 1e-12);
        assert_eq!(sign_test(0, 0), 1.0);
        assert!((sign_test(3, 7) + sign_test(8, 2) - 1.0).abs() < 1e-12);
    }

    #[cfg(feature = "vision")]
    #[test]
    fn the_reach_is_that_of_the_usual_tables() {
        assert!((normal_reach(0.05) - Z95).abs() < 1e-12);
        // scipy.stats.norm.isf(0.05 / 8)
        assert!((normal_reach(0.05 / 4.0) - 2.497_705_474_412_373).abs() < 1e-9);
    }

    #[test]
    fn quantiles_are_those_of_numpy() {
        // numpy.quantile([1, 2, 4, 8], [0.1, 0.5, 0.9])
        let values = [1.0, 2.0, 4.0, 8.0];
        for (q, expected) in [(0.0, 1.0), (0.1, 1.3), (0.5, 3.0), (0.9, 6.8), (1.0, 8.0)] {
            assert!((quantile(&values, q) - expected).abs() < 1e-12, "{q}");
        }
        assert_eq!(quantile(&[], 0.5), 0.0);
        assert_eq!(median(&mut values.clone()), 3.0);
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut []), 0.0);
    }
}
