//! The number of false dots in a view.

use crate::error::{Result, require};

/// Mean number of false dots where there are usually none.
const MIN_MEAN: f64 = 0.02;
/// Share of views whose number of false dots is not the usual one.
const UNUSUAL: f64 = 0.02;

/// Distribution of the number of false dots in a view.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "kind", content = "value", rename_all = "snake_case")]
pub enum FalseDots {
    /// The same number in nearly every view: a mark on the ball, a protocol with a fixed number. One view in
    /// fifty is taken to differ (Poisson with the same mean), so that no view is impossible.
    Usual(u16),
    /// It varies (Poisson) with this mean.
    Poisson(f64),
}

impl FalseDots {
    /// Mean number, positive.
    pub fn mean(self) -> f64 {
        match self {
            Self::Usual(number) => f64::from(number).max(MIN_MEAN),
            Self::Poisson(mean) => mean,
        }
    }

    /// The usual number, where there is one.
    pub fn usual(self) -> Option<u16> {
        match self {
            Self::Usual(number) => Some(number),
            Self::Poisson(_) => None,
        }
    }

    /// Checks the mean.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for `expected_false_dots`.
    pub fn check(self) -> Result<()> {
        let mean = self.mean();
        let inside = mean > 0.0 && mean.is_finite();
        require(inside, "expected_false_dots", "a positive number", mean)
    }

    /// ln of the probability of `count` false dots times the number of their orders, `count!`.
    pub(crate) fn ln_orders(self, count: usize) -> f64 {
        let mean = self.mean();
        let ln_poisson = count as f64 * mean.ln() - mean;
        match self {
            Self::Poisson(_) => ln_poisson,
            Self::Usual(usual) if usize::from(usual) != count => UNUSUAL.ln() + ln_poisson,
            Self::Usual(_) => {
                let orders: f64 = (1..=count).map(|k| k as f64).product();
                (UNUSUAL * ln_poisson.exp() + (1.0 - UNUSUAL) * orders).ln()
            }
        }
    }

    /// ln of the probability of 0, 1, ... false dots over that of Poisson's distribution of the same
    /// mean; the last value holds for all larger numbers.
    pub(crate) fn over_poisson(self) -> Vec<f64> {
        let Self::Usual(usual) = self else {
            return vec![0.0];
        };
        let mean = self.mean();
        let ln_poisson = |count: usize| count as f64 * mean.ln() - mean;
        let numbers = 0..=usize::from(usual) + 1;
        numbers.map(|k| self.ln_orders(k) - ln_poisson(k)).collect()
    }
}
