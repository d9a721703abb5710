//! A polynomial through values in time, some of which are far off.
//!
//! Least squares, reweighted with Tukey's [`biweight`](super::biweight) of the residuals over so many of their median deviations (P. J. Huber, "Robust
//! Statistics", 1981). Wanted is the value at time 0.

use nalgebra::SVector;

use super::{Sums, biweight};
use crate::stats::median;

/// How a polynomial is fitted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reweighting {
    /// Fits at all.
    pub fits: usize,
    /// Values farther off do not count, in median deviations.
    pub reach: f64,
    /// No median deviation counts for less.
    pub least: f64,
    /// Whether the first fit leaves out what is far from the median of all values.
    pub starts_level: bool,
}

/// A polynomial at time 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ValueAtZero {
    pub value: f64,
    /// The median deviation of the values from the polynomial before, by which they were weighed.
    pub scatter: f64,
    /// Variance of the value over that of one of those that it is fitted to.
    pub variance: f64,
}

impl Reweighting {
    /// The value at time 0 of the polynomial of `N` coefficients through `(t, y)`; `None` where these do not fix it.
    pub fn value_at_zero<const N: usize>(&self, points: &[(f64, f64)]) -> Option<ValueAtZero> {
        if points.len() < N {
            return None;
        }
        let mut by_power = self.starts_level.then(|| {
            let mut values: Vec<f64> = points.iter().map(|p| p.1).collect();
            let mut level = SVector::<f64, N>::zeros();
            level[0] = median(&mut values);
            level
        });
        let mut deviations = Vec::with_capacity(points.len());
        let mut found = None;
        for _ in 0..self.fits {
            let off = |(t, y): &(f64, f64)| {
                let at = |c: &SVector<f64, N>| c.dot(&SVector::from(powers(*t)));
                by_power.as_ref().map_or(0.0, |c| y - at(c))
            };
            deviations.clear();
            deviations.extend(points.iter().map(|p| off(p).abs()));
            let scatter = median(&mut deviations);
            let reach = self.reach * scatter.max(self.least);
            let mut sums = Sums::<N>::default();
            for point in points {
                sums.add(&powers(point.0), point.1, biweight(off(point) / reach));
            }
            let factor = sums.symmetric().cholesky()?;
            let fitted = factor.solve(&SVector::from(sums.gradient));
            found = Some(ValueAtZero {
                value: fitted[0],
                scatter,
                variance: factor.inverse()[(0, 0)],
            });
            by_power = Some(fitted);
        }
        found
    }
}

/// 1, t, t^2, ...
fn powers<const N: usize>(t: f64) -> [f64; N] {
    let mut power = 1.0;
    std::array::from_fn(|_| {
        let this = power;
        power *= t;
        this
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four of eleven values, all at one end, turn the line of least squares; beside the median of all they do not count from the first
    /// fit on.
    #[test]
    fn a_fit_that_starts_level_does_not_follow_what_is_far_off() {
        let points: Vec<(f64, f64)> = (0..11)
            .map(|k| (f64::from(k) - 5.0, if k > 6 { 100.0 } else { 2.0 }))
            .collect();
        let once = |starts_level: bool| {
            let fit = Reweighting {
                fits: 1,
                reach: 7.0,
                least: 0.1,
                starts_level,
            };
            fit.value_at_zero::<2>(&points).expect("a value").value
        };
        assert!((once(true) - 2.0).abs() < 1e-9, "{}", once(true));
        // The mean of all.
        assert!((once(false) - 414.0 / 11.0).abs() < 1e-9, "{}", once(false));
    }

    #[test]
    fn a_value_is_that_of_most_points() {
        let even = Reweighting {
            fits: 6,
            reach: 7.0,
            least: 0.1,
            starts_level: false,
        };
        let points: Vec<(f64, f64)> = (-6..7)
            .filter(|k| *k != 0)
            .map(|k| {
                (
                    f64::from(k),
                    3.0 + 0.5 * f64::from(k * k) + if k == 4 { 40.0 } else { 0.0 },
                )
            })
            .collect();
        let found = even.value_at_zero::<3>(&points).expect("a value");
        assert!((found.value - 3.0).abs() < 1e-9, "{found:?}");
        // A line does not bend, and scatters.
        let line = even.value_at_zero::<2>(&points).expect("a value");
        assert!(line.scatter > 1.0, "{line:?}");
        assert!(even.value_at_zero::<3>(&points[..2]).is_none());
    }
}
