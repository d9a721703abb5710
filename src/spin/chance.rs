//! The number of spins on which frames would agree by chance alone.
//!
//! Every pair of frames allows a handful of spins, so that a sequence has `sum over pairs (2 f T +
//! 1)` hypotheses (`f` the largest spin in revolutions per second, `T` the pair's interval). A
//! frame with a random orientation agrees with one of them with the probability that a uniform
//! rotation is within the angle r of a given one, `q = (r - sin r) / pi`, where r is the largest
//! error that the mixture attributes to noise; between the frames of the pair the prediction adds
//! up to the frame's own variance. The expected number of hypotheses on which m of n frames agree
//! by chance is thus about
//!
//! ```text
//! hypotheses * P(Binomial(n - 2, q) >= m - 2)
//! ```
//!
//! (a number of false alarms, as in A. Desolneux, L. Moisan, J.-M. Morel, "Meaningful alignments",
//! Int. J. Comput. Vision 40, 2000).

use super::Measurement;
use super::mixture::peak_gain;

/// Radians; half of all rotations are within 2.31.
const LARGEST_RADIUS: f64 = 2.31;

/// Expected number of spins up to `max_rps` on which `agreeing` of the orientations agree by
/// chance, with noise `sigma_rad` per axis.
pub(super) fn expected_by_chance(
    measurements: &[Measurement],
    agreeing: usize,
    sigma_rad: f64,
    max_rps: f64,
) -> f64 {
    let n = measurements.len();
    if agreeing < 2 || n < 2 {
        return f64::INFINITY;
    }
    // Time i is the later one of i pairs and the earlier one of n - 1 - i.
    let order = |i: usize| 2.0 * i as f64 - (n - 1) as f64;
    let origin = measurements[0].time_s;
    let intervals: f64 = measurements
        .iter()
        .enumerate()
        .map(|(i, m)| order(i) * (m.time_s - origin))
        .sum();
    let pairs = 0.5 * (n * (n - 1)) as f64;
    let hypotheses = pairs + 2.0 * max_rps * intervals;
    let near: f64 = measurements
        .iter()
        .map(|m| near_by_chance(m, sigma_rad))
        .sum();
    hypotheses * binomial_tail(n - 2, agreeing - 2, near / n as f64)
}

/// Probability that a uniform rotation counts as an inlier of this frame.
fn near_by_chance(m: &Measurement, sigma_rad: f64) -> f64 {
    let variance = 2.0 * (sigma_rad * m.sigma_scale).powi(2);
    let r = (2.0 * variance * peak_gain(m.confidence, variance).max(0.0)).sqrt();
    // Where half of all rotations count as inliers, agreement carries no information.
    let r = r.min(LARGEST_RADIUS);
    (r - r.sin()) / std::f64::consts::PI
}

/// P(Binomial(n, q) >= k), for q below 1.
fn binomial_tail(n: usize, k: usize, q: f64) -> f64 {
    let log_odds = (q / (1.0 - q)).ln();
    let mut log_term = n as f64 * (-q).ln_1p();
    let mut tail = 0.0;
    for i in 0..=n {
        if i >= k {
            let term = log_term.exp();
            tail += term;
            // Beyond the peak the terms fall faster than geometrically.
            if term < 1e-12 * tail {
                break;
            }
        }
        log_term += log_odds + ((n - i) as f64 / (i + 1) as f64).ln();
    }
    tail
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binomial_tails_are_exact() {
        // 1 - 0.9^5 - 5 * 0.1 * 0.9^4, and a fair coin's heads.
        assert!((binomial_tail(5, 2, 0.1) - 0.081_46).abs() < 1e-12);
        assert!((binomial_tail(4, 2, 0.5) - 11.0 / 16.0).abs() < 1e-12);
        assert!((binomial_tail(3000, 0, 0.4) - 1.0).abs() < 1e-9);
    }
}
