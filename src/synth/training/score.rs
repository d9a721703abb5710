//! Evaluation of a net on frames that it was not trained on, and calibration of its outputs.
//!
//! A peak is correct where a dot lies within [`MATCH`] of it. A dot is matched with one peak, the
//! hottest. The probability of a peak is fitted as a logistic function of its heat by maximum
//! likelihood (J. Platt, 1999). The covariances are scaled by one factor, so that the median
//! squared Mahalanobis length of the errors is that of two Gaussian dimensions, `2 ln 2`.

use crate::vision::dots::net::{Peak, find_peaks};
use crate::vision::net::weights::OutputCalibration;

use super::dots::DotSample;

/// Maximum distance of a peak to its dot, in the patch's pixels.
pub const MATCH: f64 = 3.0;
/// Peaks less probable than this do not enter the calibration.
const MIN_PROBABILITY: f64 = 0.01;
/// Newton steps of the logistic fit; it has converged after ten.
const NEWTON_STEPS: usize = 30;

/// A peak, and whether a dot is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchedPeak {
    /// The peak.
    pub peak: Peak,
    /// Its dot's position minus its own (columns, rows), where there is one.
    pub error: Option<[f64; 2]>,
}

/// The result of a net on a set of frames.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct DotScore {
    /// Frames.
    pub frames: usize,
    /// Dots to be found.
    pub dots: usize,
    /// Of them, found.
    pub found: usize,
    /// Peaks without a dot.
    pub false_peaks: usize,
    /// Median distance of the found ones, in the patch's pixels.
    pub median_error: f64,
}

impl DotScore {
    /// Share of the dots found.
    pub fn recall(&self) -> f64 {
        self.found as f64 / self.dots.max(1) as f64
    }

    /// Share of the peaks that are dots.
    pub fn precision(&self) -> f64 {
        self.found as f64 / (self.found + self.false_peaks).max(1) as f64
    }

    /// Harmonic mean of both.
    pub fn f1(&self) -> f64 {
        let (r, p) = (self.recall(), self.precision());
        2.0 * r * p / (r + p).max(f64::MIN_POSITIVE)
    }
}

/// Matches all peaks of one sample's cells with its dots, and appends them to `matched`. Peaks at
/// undecidable dots are left out.
pub fn match_peaks(
    cells: &[f32],
    sample: &DotSample,
    calibration: &OutputCalibration,
    matched: &mut Vec<MatchedPeak>,
) {
    let mut peaks = Vec::new();
    find_peaks(cells, calibration, 0.0, &mut peaks);
    let mut claimed = vec![false; sample.dots.len()];
    for peak in peaks {
        let distance =
            |i: usize| (sample.dots[i].at.u - peak.column).hypot(sample.dots[i].at.v - peak.row);
        let nearest = (0..sample.dots.len())
            .filter(|&i| !claimed[i] && distance(i) < MATCH)
            .min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        let error = match nearest {
            Some(i) => {
                claimed[i] = true;
                let dot = sample.dots[i];
                if !dot.certain {
                    continue;
                }
                Some([dot.at.u - peak.column, dot.at.v - peak.row])
            }
            None => None,
        };
        matched.push(MatchedPeak { peak, error });
    }
}

/// The score of peaks with at least the given probability.
pub fn score(matched: &[MatchedPeak], samples: &[DotSample], min_probability: f64) -> DotScore {
    let shown = || {
        matched
            .iter()
            .filter(|j| j.peak.probability >= min_probability)
    };
    let mut errors: Vec<f64> = shown()
        .filter_map(|j| j.error.map(|[u, v]| u.hypot(v)))
        .collect();
    errors.sort_unstable_by(f64::total_cmp);
    DotScore {
        frames: samples.len(),
        dots: samples
            .iter()
            .map(|s| s.dots.iter().filter(|d| d.certain).count())
            .sum(),
        found: errors.len(),
        false_peaks: shown().filter(|j| j.error.is_none()).count(),
        median_error: errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN),
    }
}

/// Fits the calibration to peaks that were read with the default one.
pub fn calibrate(matched: &[MatchedPeak]) -> OutputCalibration {
    let seen: Vec<&MatchedPeak> = matched
        .iter()
        .filter(|j| j.peak.probability > MIN_PROBABILITY)
        .collect();
    let (mut slope, mut offset) = (1.0, 0.0);
    for _ in 0..NEWTON_STEPS {
        // Gradient and Hessian of the negative log likelihood, with a little ridge about (1, 0).
        let (mut g, mut h) = ([slope - 1.0, offset], [1.0, 0.0, 1.0]);
        for j in &seen {
            let x = j.peak.heat;
            let p = 1.0 / (1.0 + (-slope * x - offset).exp());
            let (d, w) = (p - f64::from(u8::from(j.error.is_some())), p * (1.0 - p));
            g[0] += d * x;
            g[1] += d;
            h[0] += w * x * x;
            h[1] += w * x;
            h[2] += w;
        }
        let det = h[0] * h[2] - h[1] * h[1];
        slope -= (h[2] * g[0] - h[1] * g[1]) / det;
        offset -= (h[0] * g[1] - h[1] * g[0]) / det;
    }
    let mut lengths: Vec<f64> = seen
        .iter()
        .filter_map(|j| {
            let [u, v] = j.error?;
            let e = nalgebra::Vector2::new(u, v);
            Some(e.dot(&(j.peak.covariance.try_inverse()? * e)))
        })
        .collect();
    lengths.sort_unstable_by(f64::total_cmp);
    let median = lengths.get(lengths.len() / 2).copied();
    OutputCalibration {
        slope,
        offset,
        covariance_factor: median.map_or(1.0, |m| m / (2.0 * std::f64::consts::LN_2)),
    }
}
