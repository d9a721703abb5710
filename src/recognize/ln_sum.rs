//! Logarithms of sums of exponentials, over the largest one so that none overflows.

/// ln of the sum of the exponentials.
pub(super) fn ln_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let max = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if max == f64::NEG_INFINITY {
        return max;
    }
    max + terms.map(|t| (t - max).exp()).sum::<f64>().ln()
}

/// A sum of exponentials, one after another.
#[derive(Debug, Clone, Copy)]
pub(super) struct LnSum {
    max: f64,
    /// Over the exponential of `max`.
    sum: f64,
}

impl Default for LnSum {
    fn default() -> Self {
        Self {
            max: f64::NEG_INFINITY,
            sum: 0.0,
        }
    }
}

impl LnSum {
    /// Adds the exponential of `ln`.
    pub fn add(&mut self, ln: f64) {
        if ln > self.max {
            self.sum = 1.0 + self.sum * (self.max - ln).exp();
            self.max = ln;
        } else {
            self.sum += (ln - self.max).exp();
        }
    }

    /// Its logarithm.
    pub fn ln(&self) -> f64 {
        self.max + self.sum.ln()
    }
}
