//! Measurements of equal times: one orientation that was measured more than once, as several cameras do.
//!
//! Those of one time that agree within their noise become one, their mean weighted by `1 / sigma^2`,
//!
//! ```text
//! R = argmin sum_i |log(R R_i^-1)|^2 / s_i^2,   1 / s^2 = sum_i 1 / s_i^2
//! ```
//!
//! Those that do not agree with the surest cannot be right with it: they are left out, and its confidence is what remains of it
//! ([`consensus`]). So there is at most one measurement a time, and everything after that may divide by intervals.
//!
//! Guarantees: a sequence without equal times is as it was, and no memory is taken for it. Not guaranteed: which of two that disagree is
//! right, where their confidences are equal; the first is taken, at less than even odds.

use std::borrow::Cow;
use std::ops::Range;

use super::Measurement;
use crate::geometry::{ROTATIONS, toward_mean};
use crate::stats::{SUREST, consensus};

/// The quantile of chi-square with three degrees of freedom that two measurements of one orientation exceed once in a thousand times.
const APART: f64 = 16.266;
/// Steps of the mean: each leaves the square of the angle.
const STEPS: usize = 4;

/// A sequence with one measurement a time.
#[derive(Debug, Clone)]
pub(super) struct Merged<'a> {
    /// In order of time.
    pub measurements: Cow<'a, [Measurement]>,
    /// The first of those given that each is made of; none where no time repeats.
    first: Vec<usize>,
    given: usize,
}

impl<'a> Merged<'a> {
    /// That of measurements in order of time, with this noise of an orientation about an axis, radians.
    pub fn of(given: &'a [Measurement], sigma_rad: f64) -> Self {
        let is_repeated = given.windows(2).any(|w| w[0].time_s == w[1].time_s);
        if !is_repeated {
            return Self {
                measurements: Cow::Borrowed(given),
                first: Vec::new(),
                given: given.len(),
            };
        }
        let (mut measurements, mut first) = (Vec::new(), Vec::new());
        let mut from = 0;
        while from < given.len() {
            let same = given[from..]
                .iter()
                .take_while(|m| m.time_s == given[from].time_s);
            let count = same.count().max(1);
            measurements.push(merged(&given[from..from + count], sigma_rad));
            first.push(from);
            from += count;
        }
        Self {
            measurements: Cow::Owned(measurements),
            first,
            given: given.len(),
        }
    }

    /// Whether a time repeats.
    pub fn is_changed(&self) -> bool {
        !self.first.is_empty()
    }

    /// Those given that the measurements of a range are made of.
    pub fn given(&self, range: &Range<usize>) -> Range<usize> {
        let bound = |k: usize| match self.is_changed() {
            true => self.first.get(k).copied().unwrap_or(self.given),
            false => k,
        };
        bound(range.start)..bound(range.end)
    }

    /// For each of those given what is known of the measurement that it became a part of.
    pub fn spread<T: Copy>(&self, of_merged: &[T]) -> Vec<T> {
        let parts = of_merged.iter().enumerate();
        parts
            .flat_map(|(k, value)| std::iter::repeat_n(*value, self.given(&(k..k + 1)).len()))
            .collect()
    }
}

/// Measurements of one time as one.
fn merged(same: &[Measurement], sigma_rad: f64) -> Measurement {
    let surest = same.iter().reduce(|best, m| {
        let is_surer = m.confidence > best.confidence
            || m.confidence == best.confidence && m.sigma_scale < best.sigma_scale;
        if is_surer { m } else { best }
    });
    let Some(surest) = surest.filter(|_| same.len() > 1) else {
        return same[0];
    };
    let agrees = |m: &&Measurement| {
        let angle = surest.orientation.angle_to(&m.orientation);
        let scales = surest.sigma_scale.powi(2) + m.sigma_scale.powi(2);
        std::ptr::eq(*m, surest) || angle * angle <= APART * sigma_rad * sigma_rad * scales
    };
    let (agreeing, others): (Vec<&Measurement>, Vec<&Measurement>) = same.iter().partition(agrees);
    let weight = |m: &Measurement| m.sigma_scale.powi(-2);
    let total: f64 = agreeing.iter().map(|m| weight(m)).sum();
    let mut orientation = surest.orientation;
    for _ in 0..STEPS {
        let weighted = agreeing.iter().map(|m| (m.orientation, weight(m)));
        orientation = toward_mean(&orientation, weighted);
    }
    let confidences = |of: &[&Measurement]| of.iter().map(|m| m.confidence).collect::<Vec<f64>>();
    let reach = (2.0 * APART).sqrt() * sigma_rad * surest.sigma_scale;
    let chance = (4.0 / 3.0 * std::f64::consts::PI * reach.powi(3) / ROTATIONS).min(1.0);
    let sure = consensus(&confidences(&agreeing), &confidences(&others), chance);
    Measurement {
        time_s: surest.time_s,
        orientation,
        confidence: sure.min(SUREST.max(surest.confidence)),
        sigma_scale: total.powf(-0.5).max(1e-6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Rotation, Vec3};

    fn at(time_s: f64, angle: f64, confidence: f64) -> Measurement {
        Measurement {
            confidence,
            ..Measurement::new(time_s, Rotation::from_scaled_axis(Vec3::x() * angle))
        }
    }

    #[test]
    fn measurements_of_one_time_become_their_mean() {
        let given = [
            at(0.0, 0.0, 0.9),
            at(1.0, 0.1, 0.9),
            at(1.0, 0.12, 0.9),
            at(2.0, 0.2, 0.9),
        ];
        let merged = Merged::of(&given, 0.01);
        let both = merged.measurements[1];
        assert_eq!(merged.measurements.len(), 3);
        assert!((both.orientation.scaled_axis().x - 0.11).abs() < 1e-12);
        assert!((both.sigma_scale - 0.5f64.sqrt()).abs() < 1e-12);
        assert!(both.confidence > 0.99, "{}", both.confidence);
        assert_eq!(merged.given(&(1..2)), 1..3);
        assert_eq!(merged.spread(&[7, 8, 9]), [7, 8, 8, 9]);
    }

    /// Each by the inverse of its variance.
    #[test]
    fn of_two_that_agree_the_more_exact_counts_more() {
        let exact = Measurement {
            sigma_scale: 0.5,
            ..at(1.0, 0.115, 0.9)
        };
        let given = [at(1.0, 0.1, 0.9), exact];
        let merged = Merged::of(&given, 0.01);
        let both = merged.measurements[0];
        let angle = both.orientation.scaled_axis().x;
        assert!((angle - 0.112).abs() < 1e-12, "{angle}");
        assert!((both.sigma_scale - 5f64.powf(-0.5)).abs() < 1e-12);
    }

    #[test]
    fn of_two_that_disagree_the_surer_remains_at_its_odds() {
        let given = [at(1.0, 0.1, 0.6), at(1.0, 2.0, 0.9)];
        let merged = Merged::of(&given, 0.01);
        let one = merged.measurements[0];
        assert_eq!(one.orientation, given[1].orientation);
        // 0.9 x 0.4 right, 0.6 x 0.1 the other, 0.4 x 0.1 neither.
        assert!(
            (one.confidence - 0.36 / 0.46).abs() < 1e-12,
            "{}",
            one.confidence
        );
    }

    #[test]
    fn other_sequences_stay_as_they_are() {
        let given = [at(0.0, 0.0, 0.9), at(1.0, 0.1, 0.9)];
        let merged = Merged::of(&given, 0.01);
        assert!(matches!(merged.measurements, Cow::Borrowed(_)) && !merged.is_changed());
        assert_eq!(merged.given(&(0..2)), 0..2);
    }
}
