//! Which steady places look like dots: print and stains stay at one place of the ball as dots do, and the
//! detector doubts them more.

use crate::stats::{SIGMA_PER_MAD, median};

/// What looks unlike dots lies this many standard deviations of the others below their middle.
const DEVIATIONS: f64 = 4.0;

/// The probability of a dot, mean over a place's views, below which a place looks unlike the others:
/// `share` of the middle place's at most, and less where the probabilities spread.
pub(super) fn unlike_limit(probabilities: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut probabilities: Vec<f64> = probabilities.collect();
    let middle = median(&mut probabilities);
    let mut off: Vec<f64> = probabilities.iter().map(|p| (p - middle).abs()).collect();
    let spread = SIGMA_PER_MAD * median(&mut off);
    (share * middle).min(middle - DEVIATIONS * spread)
}
