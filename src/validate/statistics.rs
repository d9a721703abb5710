//! Proportions with Wilson's score interval (E. B. Wilson, "Probable inference, the law of succession,
//! and statistical inference", J. Am. Stat. Assoc. 22, 1927).

/// The two-sided 95 % quantile of the standard normal distribution.
const Z95: f64 = 1.959_963_984_540_054;

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
    /// Rate and interval of `successes` out of `trials`. No trials say nothing: [0, 1].
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

/// The median (mean of the middle two for an even number; 0 for none). Reorders its input.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_unstable_by(f64::total_cmp);
    let mid = values.len() / 2;
    if values.len() % 2 == 1 {
        values[mid]
    } else {
        0.5 * (values[mid - 1] + values[mid])
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
}
