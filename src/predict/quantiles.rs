//! An empirical distribution in a few numbers.
//!
//! Quantile `k` of `n` is that of the probability `(1 - cos(pi k / (n - 1))) / 2`: close together at both
//! ends. Equally spaced ones would spread the outermost share evenly from there to the largest value of all,
//! and one outlier among many values would pass for a fortieth of them.

use std::f64::consts::PI;

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::stats::quantile;

/// Number of quantiles: the outermost part holds a share of 0.0006.
const COUNT: usize = 65;

/// Quantiles of a sample, from the least value to the greatest; see the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Quantiles(Vec<f64>);

impl Quantiles {
    /// Of these values, which are sorted; zeros for none.
    pub fn of(values: &mut [f64]) -> Self {
        values.sort_unstable_by(f64::total_cmp);
        let level = |k: usize| 0.5 * (1.0 - (PI * k as f64 / (COUNT - 1) as f64).cos());
        Self((0..COUNT).map(|k| quantile(values, level(k))).collect())
    }

    /// Whether there are any, and all finite.
    pub fn is_complete(&self) -> bool {
        !self.0.is_empty() && self.0.iter().all(|q| q.is_finite())
    }

    /// A number from the distribution.
    pub fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        self.at(rng.random())
    }

    /// The quantile of a probability.
    pub fn at(&self, probability: f64) -> f64 {
        quantile(&self.0, (1.0 - 2.0 * probability).acos() / PI)
    }

    /// The probability of which a value is the quantile: the inverse of [`Quantiles::at`], 0 and 1 beyond
    /// the outermost.
    pub fn level(&self, value: f64) -> f64 {
        let above = self.0.partition_point(|q| *q <= value);
        let parts = (self.0.len() - 1) as f64;
        let share = match (above, self.0.len()) {
            (0, _) => 0.0,
            (above, n) if above == n => 1.0,
            (above, _) => {
                let (low, high) = (self.0[above - 1], self.0[above]);
                ((above - 1) as f64 + (value - low) / (high - low)) / parts
            }
        };
        0.5 * (1.0 - (PI * share).cos())
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::Quantiles;

    /// A normal sample with one outlier in ten thousand: mean, variance and the share beyond three standard
    /// deviations are those of the sample.
    #[test]
    fn tails_are_kept_and_outliers_stay_rare() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut values: Vec<f64> = (0..20_000)
            .map(|_| StandardNormal.sample(&mut rng))
            .collect();
        values[..2].fill(30.0);
        let quantiles = Quantiles::of(&mut values);
        assert!(quantiles.is_complete());
        let drawn: Vec<f64> = (0..200_000).map(|_| quantiles.draw(&mut rng)).collect();
        let of = |values: &[f64], power: i32| {
            let kept = values.iter().filter(|v| v.abs() < 6.0);
            kept.map(|v| v.powi(power)).sum::<f64>() / values.len() as f64
        };
        let beyond = |values: &[f64], limit: f64| {
            values.iter().filter(|v| v.abs() > limit).count() as f64 / values.len() as f64
        };
        assert!((of(&drawn, 1) - of(&values, 1)).abs() < 0.01);
        assert!((of(&drawn, 2) - of(&values, 2)).abs() < 0.02);
        assert!((beyond(&drawn, 3.0) - beyond(&values, 3.0)).abs() < 0.001);
        assert!(beyond(&drawn, 5.0) < 0.0006);
    }

    #[test]
    fn the_level_of_a_quantile_is_its_probability() {
        let quantiles =
            Quantiles::of(&mut (0..500).map(|k| f64::from(k).sqrt()).collect::<Vec<_>>());
        for k in 1..50 {
            let p = f64::from(k) / 50.0;
            assert!((quantiles.level(quantiles.at(p)) - p).abs() < 1e-9);
        }
        assert_eq!([quantiles.level(-1.0), quantiles.level(99.0)], [0.0, 1.0]);
    }
}
