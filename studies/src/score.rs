//! Scoring: shares, rates of frames, bins, claims against the truth, ratios.

use spindoe::camera::{FrameOutcome, FrameRates};
use spindoe::stats::Proportion;

use crate::table::{Cell, figure};

/// The share of what is so.
pub fn share<T>(all: &[T], is: impl Fn(&T) -> bool) -> Proportion {
    let count = all.iter().filter(|x| is(x)).count();
    Proportion::new(count as u64, all.len() as u64)
}

/// The mean of some values; NaN for none.
pub fn mean<T>(all: &[T], value: impl Fn(&T) -> f64) -> f64 {
    all.iter().map(value).sum::<f64>() / all.len() as f64
}

/// The median of some values, of which those that are not finite do not count; NaN for none.
pub fn median<T>(all: &[T], value: impl Fn(&T) -> f64) -> f64 {
    let values = all.iter().map(value).filter(|x| x.is_finite());
    let mut values: Vec<f64> = values.collect();
    match values.as_slice() {
        [] => f64::NAN,
        _ => spindoe::stats::median(&mut values),
    }
}

/// The headings of [`rates`].
pub const RATES: [&str; 5] = ["right", "wrong", "unanswered", "mean error", "median"];

/// The shares of right, wrong and no answers, and the mean and the median error of the right ones.
pub fn rates(outcomes: &[FrameOutcome]) -> [Cell; 5] {
    // The rates name a seed, which is no part of them.
    let rates = FrameRates::of(outcomes, 0);
    let error = |deg: f64| (rates.right.successes > 0).then(|| figure(deg, 2, "deg"));
    [
        rates.right.into(),
        rates.wrong.into(),
        rates.unanswered.into(),
        error(rates.mean_error_deg).into(),
        error(rates.median_error_deg).into(),
    ]
}

/// Values from one edge up to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// The least value.
    pub from: f64,
    /// What the values stay below.
    pub to: f64,
}

/// The bins between these edges, the last of them without an end.
pub fn bins(edges: &[f64]) -> impl Iterator<Item = Bin> {
    let ends = edges.iter().skip(1).copied().chain([f64::INFINITY]);
    let pairs = edges.iter().copied().zip(ends);
    pairs.map(|(from, to)| Bin { from, to })
}

impl Bin {
    /// Whether a value is one of these.
    pub fn holds(&self, value: f64) -> bool {
        (self.from..self.to).contains(&value)
    }

    /// In words, with a unit or without.
    pub fn named(&self, unit: &str) -> String {
        let (Self { from, to }, space) = (self, if unit.is_empty() { "" } else { " " });
        match to.is_finite() {
            true => format!("{from} to {to}{space}{unit}"),
            false => format!("{from}{space}{unit} or more"),
        }
    }

    /// In words where the values are counts.
    pub fn counts(&self, unit: &str) -> String {
        let last = self.to - 1.0;
        let space = if unit.is_empty() { "" } else { " " };
        match last == self.from {
            true => format!("{last}{space}{unit}"),
            false => Self { to: last, ..*self }.named(unit),
        }
    }
}

/// A claim, and whether it was right.
#[derive(Debug, Clone, Copy)]
pub struct Claim {
    /// The probability that was claimed.
    pub confidence: f64,
    /// Whether it was so.
    pub is_right: bool,
}

/// Of the claims within a bin the mean, NaN for none, and the share that was right.
pub fn claimed(claims: &[Claim], bin: Bin) -> (f64, Proportion) {
    let within = claims.iter().filter(|c| bin.holds(c.confidence));
    let within: Vec<Claim> = within.copied().collect();
    (
        mean(&within, |c| c.confidence),
        share(&within, |c| c.is_right),
    )
}

/// The ratio of the sums of pairs, with its 95 % interval by linear propagation: the pairs are the sample.
pub fn ratio(pairs: &[[f64; 2]]) -> (f64, [f64; 2]) {
    let [above, below] = [0, 1].map(|k: usize| pairs.iter().map(|p| p[k]).sum::<f64>());
    let ratio = above / below;
    let squares = pairs.iter().map(|p| (p[0] - ratio * p[1]).powi(2));
    let half = 1.96 * squares.sum::<f64>().sqrt() / below;
    (ratio, [ratio - half, ratio + half])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_name_their_values() {
        let named = |edges: &[f64], unit| -> Vec<String> {
            bins(edges).map(|bin| bin.counts(unit)).collect()
        };
        assert_eq!(
            named(&[0.0, 3.0, 4.0], "px"),
            ["0 to 2 px", "3 px", "4 px or more"]
        );
        let bin = Bin { from: 0.5, to: 0.7 };
        assert_eq!(bin.named(""), "0.5 to 0.7");
        assert!(bin.holds(0.5) && !bin.holds(0.7));
    }

    #[test]
    fn no_answers_have_no_error() {
        let cells = rates(&[FrameOutcome::Unanswered; 2]).map(|c| c.to_string());
        assert_eq!(cells[2], "100.00 % [34.24, 100.00]");
        assert_eq!(cells[3], "-");
        assert_eq!(rates(&[]).map(|c| c.to_string()), ["-"; 5]);
    }

    #[test]
    fn a_constant_ratio_is_certain() {
        let (value, [low, high]) = ratio(&[[1.0, 2.0], [2.0, 4.0]]);
        assert_eq!([value, low, high], [0.5; 3]);
    }
}
