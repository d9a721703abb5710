//! The outcomes of single frames: answered correctly, wrongly, not at all, and how far off the
//! orientation is.
//!
//! Patterns are ordered by the *effective error* `E` of an orientation. The error of a spin that is
//! fitted to many frames grows with it: a frame without an answer gives nothing, and a wrong answer
//! takes up, on average, what two right ones give. With `S`, `R` and `W` the sum of the squared
//! errors of the right answers, their number and that of the wrong ones, of `n` frames,
//!
//! ```text
//! E^2 = S / R * n / (R - 2 W),
//! ln E^2 changes with frame i by  s_i / S - r_i / R - (r_i - 2 w_i) / (R - 2 W) + 1 / n
//! ```
//!
//! to first order (the infinitesimal jackknife: B. Efron, "Nonparametric estimates of standard error",
//! Biometrika 68, 1981); the sum of the squared changes is the variance of `ln E^2`. With fewer than 10
//! right answers, or a share `(R - 2 W) / n` under 1 %, the first order says nothing.

use serde::{Deserialize, Serialize};

use crate::geometry::Rotation;
use crate::stats::{PairedDifference, Pairs, Proportion, Z95, median_or_nan, normal_reach, or_nan};
use crate::validate::ORIENTATION_FAILURE_RAD;
use crate::vision::FrameEstimate;

/// Right answers that a wrong one takes up.
const COST_OF_WRONG: f64 = 2.0;
/// Least share of frames that the effective error divides by.
const MIN_SHARE: f64 = 0.01;

/// Right answers from which on the first order holds.
const MIN_RIGHT: u64 = 10;

/// The outcome of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameOutcome {
    /// No answer.
    Unanswered,
    /// An answer, off by this angle, radians.
    Answered {
        /// Orientation error, radians.
        error_rad: f64,
    },
}

impl FrameOutcome {
    /// The outcome of a pose against the truth, both pattern to view frame.
    pub fn of(frame: &FrameEstimate, truth: &Rotation) -> Self {
        frame
            .pose()
            .map_or(Self::Unanswered, |pose| Self::Answered {
                error_rad: pose.rotation.angle_to(truth),
            })
    }

    /// Whether it is an answer off by less than 20 degrees.
    pub fn is_right(self) -> bool {
        matches!(self, Self::Answered { error_rad } if error_rad < ORIENTATION_FAILURE_RAD)
    }

    /// Whether it is an answer off by 20 degrees or more.
    pub fn is_wrong(self) -> bool {
        matches!(self, Self::Answered { error_rad } if error_rad >= ORIENTATION_FAILURE_RAD)
    }
}

/// How single frames of a pattern are answered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameRates {
    /// Orientation error under 20 degrees.
    pub right: Proportion,
    /// An answer that is off by more.
    pub wrong: Proportion,
    /// No answer.
    pub unanswered: Proportion,
    /// Mean orientation error of the right answers, degrees; this and the next three are NaN without any,
    /// which JSON has as null.
    #[serde(deserialize_with = "or_nan")]
    pub mean_error_deg: f64,
    /// Its median.
    #[serde(deserialize_with = "or_nan")]
    pub median_error_deg: f64,
    /// Its root mean square.
    #[serde(deserialize_with = "or_nan")]
    pub rms_error_deg: f64,
    /// The effective error (see the module), degrees.
    #[serde(deserialize_with = "or_nan")]
    pub effective_error_deg: f64,
    /// Its 95 % interval, degrees; none where the first order says nothing.
    pub effective_error_interval_deg: Option<[f64; 2]>,
    /// Seed of the frames.
    pub seed: u64,
}

impl FrameRates {
    /// The rates of these outcomes of frames of this seed.
    pub fn of(outcomes: &[FrameOutcome], seed: u64) -> Self {
        let n = outcomes.len() as u64;
        let mut errors: Vec<f64> = outcomes
            .iter()
            .filter_map(|o| match o {
                FrameOutcome::Answered { error_rad } if o.is_right() => {
                    Some(error_rad.to_degrees())
                }
                _ => None,
            })
            .collect();
        errors.sort_unstable_by(f64::total_cmp);
        let wrong = outcomes.iter().filter(|o| o.is_wrong()).count() as u64;
        let right = errors.len() as u64;
        // 0 / 0 is not a number, and there is none.
        let count = errors.len() as f64;
        let rms_error_deg = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
        let share = (right as f64 - COST_OF_WRONG * wrong as f64) / n.max(1) as f64;
        let effective_error_deg = rms_error_deg / share.max(MIN_SHARE).sqrt();
        let deviation = ln_squared_error(outcomes)
            .map(|(_, changes)| 0.5 * changes.iter().map(|c| c * c).sum::<f64>().sqrt());
        Self {
            right: Proportion::new(right, n),
            wrong: Proportion::new(wrong, n),
            unanswered: Proportion::new(n - right - wrong, n),
            mean_error_deg: errors.iter().sum::<f64>() / count,
            median_error_deg: median_or_nan(&errors),
            rms_error_deg,
            effective_error_deg,
            effective_error_interval_deg: deviation
                .map(|d| [-d, d].map(|d| effective_error_deg * (Z95 * d).exp())),
            seed,
        }
    }
}

/// The difference of the shares of right answers, those of `others` less those of `first`, on the
/// same scenes.
pub fn paired(first: &[FrameOutcome], others: &[FrameOutcome]) -> PairedDifference {
    let mut pairs = Pairs::default();
    for (a, b) in first.iter().zip(others) {
        match (a.is_right(), b.is_right()) {
            (true, true) => pairs.both += 1,
            (false, true) => pairs.gained += 1,
            (true, false) => pairs.lost += 1,
            (false, false) => pairs.neither += 1,
        }
    }
    PairedDifference::new(pairs)
}

/// The effective error of one thing over that of another on the same scenes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorRatio {
    /// The ratio.
    pub ratio: f64,
    /// Lower end of its 95 % interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl ErrorRatio {
    /// That of `others` over that of `first`, frame by frame the same scene. The interval holds all of `count` such
    /// ratios at once in 95 % (C. E. Bonferroni). `None` where the first order says nothing.
    pub fn of(first: &[FrameOutcome], others: &[FrameOutcome], count: usize) -> Option<Self> {
        let (ln, variance) = ln_ratio(first, others)?;
        let reach = normal_reach(0.05 / count.max(1) as f64) * variance.sqrt();
        let [low, ratio, high] = [ln - reach, ln, ln + reach].map(|ln| (0.5 * ln).exp());
        Some(Self { ratio, low, high })
    }

    /// Whether the interval lies below 1.
    pub fn is_smaller(&self) -> bool {
        self.high < 1.0
    }
}

/// `ln E^2` of `others` less that of `first` on the same frames, and the variance of this difference; none where the
/// first order says nothing.
pub(super) fn ln_ratio(first: &[FrameOutcome], others: &[FrameOutcome]) -> Option<(f64, f64)> {
    let (a, a_changes) = ln_squared_error(first)?;
    let (b, b_changes) = ln_squared_error(others)?;
    let changes = a_changes.iter().zip(&b_changes);
    Some((b - a, changes.map(|(a, b)| (a - b) * (a - b)).sum()))
}

/// `ln E^2` and how each frame changes it; none where the first order says nothing.
fn ln_squared_error(outcomes: &[FrameOutcome]) -> Option<(f64, Vec<f64>)> {
    let n = outcomes.len() as f64;
    let squared = |o: &FrameOutcome| match *o {
        FrameOutcome::Answered { error_rad } if o.is_right() => error_rad * error_rad,
        _ => 0.0,
    };
    let worth =
        |o: &FrameOutcome| f64::from(o.is_right()) - COST_OF_WRONG * f64::from(o.is_wrong());
    let right = outcomes.iter().filter(|o| o.is_right()).count() as u64;
    let sum: f64 = outcomes.iter().map(squared).sum();
    let total: f64 = outcomes.iter().map(worth).sum();
    if right < MIN_RIGHT || sum <= 0.0 || total < MIN_SHARE * n {
        return None;
    }
    let changes = outcomes
        .iter()
        .map(|o| {
            squared(o) / sum - f64::from(o.is_right()) / right as f64 - worth(o) / total + 1.0 / n
        })
        .collect();
    Some(((sum / right as f64 * n / total).ln(), changes))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn the_variance_is_that_of_repeated_trials() {
        // The deviation of ln E^2 over many seeds against the first order of each.
        let (seeds, frames) = (400, 500);
        let draw = |seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let outcome = |_| match rng.random::<f64>() {
                u if u < 0.85 => FrameOutcome::Answered {
                    error_rad: 0.01 + 0.02 * rng.random::<f64>(),
                },
                u if u < 0.90 => FrameOutcome::Answered { error_rad: 1.0 },
                _ => FrameOutcome::Unanswered,
            };
            (0..frames).map(outcome).collect::<Vec<_>>()
        };
        let results: Vec<(f64, f64)> = (0..seeds)
            .map(|seed| {
                let (value, changes) = ln_squared_error(&draw(seed)).expect("enough right answers");
                (value, changes.iter().map(|c| c * c).sum())
            })
            .collect();
        let n = seeds as f64;
        let mean = results.iter().map(|r| r.0).sum::<f64>() / n;
        let spread = results.iter().map(|r| (r.0 - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let predicted = results.iter().map(|r| r.1).sum::<f64>() / n;
        let ratio = predicted / spread;
        // The spread of a variance from 400 draws is 7 %.
        assert!((0.8..1.25).contains(&ratio), "{ratio}");
    }
}
