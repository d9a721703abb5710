//! Which dots are there: how often each is found where it should be, and what that says.
//!
//! The detector's rate by depth `z` is learned from the clip itself: from the dots that are found more
//! often than not. A dot that should have been found in `n` views at the rates `p_i` and was found in
//! none has the likelihood `prod (1 - p_i)`; one that is not there is "found" at the rate `q` of false
//! detections. The log-ratio of both is the evidence. Views that follow each other are not
//! independent (a reflection stays where it is), so that a dot found in more than a few of the
//! expected views is never called missing, whatever the ratio says.
//!
//! Print and stains are taken for dots that they hide, and for missing ones. The detector doubts them more
//! than dots, and they lie anywhere: what looks unlike the other dots is doubtful, and where it is seldom found
//! besides, or lies farther off than dots are drawn, there is no dot.

use super::fitted::{FittedFrame, FittedFrames};
use crate::geometry::Vec3;
use crate::stats::{SIGMA_PER_MAD, median};

/// Depths of the bins' edges.
const EDGES: [f64; 8] = [0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.88, 1.01];
/// Rate at which something else lies where a missing dot should be.
const FALSE_RATE: f64 = 0.05;
/// Log-evidence from which on a dot is missing: odds of a thousand to one.
const MISSING: f64 = -6.9;
/// A dot found in more than this share of the views expected is there.
const SOMETIMES: f64 = 0.15;
/// One whose detections are less likely a dot's than this share of the other dots' (a decision, as are the next two: they weigh
/// a dot that is doubted against print that is taken for one; `bench calibration` counts both) ...
const UNLIKELY: f64 = 0.6;
/// ... must be found in more than this share of them.
const UNLIKELY_SOMETIMES: f64 = 0.5;
/// Detections less likely a dot's than this share of the other dots' are doubtful, unless those spread.
const DOUBTFUL: f64 = 0.85;
/// It lies so many standard deviations of the others below their middle, too.
const DEVIATIONS: f64 = 4.0;
/// A dot may be drawn off by so many standard deviations of the others' offsets: 1 in 500 lies farther.
pub(super) const FAR_OFF: f64 = 3.5;
/// A dot that is expected in fewer frames hardly faces the camera: nothing is said of it.
pub const MIN_EXPECTED_VIEWS: f64 = 3.0;

/// How often a dot was found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct FindRecord {
    /// Views in which it faced the camera well.
    pub views: usize,
    /// Expected number of finds in them.
    pub expected: f64,
    /// Finds in them.
    pub found: usize,
    /// Log-likelihood ratio of a dot over none.
    pub evidence: f64,
}

/// What is taken for a dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Looks {
    /// Whether anything is.
    pub is_found: bool,
    /// Mean probability of a dot over that of the ball's middle dot.
    pub likeness: f64,
    /// The likeness from which on it looks like the other dots: see [`doubtful_limit`].
    pub limit: f64,
    /// Angle from the nominal place in standard deviations of the other dots' offsets.
    pub offset: f64,
    /// Expected finds if the dot were at its nominal place.
    pub expected_nominal: f64,
}

/// What the clip says of a dot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DotPresence {
    /// It is there.
    There,
    /// Something is there that may be print or a stain, or is seen at the limb only.
    Doubtful,
    /// What is taken for it is farther off than dots are drawn, and its own place was never in view.
    Hidden,
    /// There is no such dot.
    Missing,
}

impl FindRecord {
    /// Whether there is such a dot, and whether it is that which is taken for it.
    pub fn presence(&self, looks: &Looks) -> DotPresence {
        let found = self.found as f64;
        let is_never_found = found < SOMETIMES * self.expected && self.evidence < MISSING;
        let is_other = looks.likeness < UNLIKELY && found < UNLIKELY_SOMETIMES * self.expected;
        let is_far = looks.offset > FAR_OFF;
        let is_unlike = looks.likeness < looks.limit;
        let is_in_view = looks.expected_nominal >= MIN_EXPECTED_VIEWS;
        let faces_camera = self.expected >= MIN_EXPECTED_VIEWS;
        if faces_camera && (is_never_found || is_other) {
            DotPresence::Missing
        } else if is_far && !is_in_view {
            DotPresence::Hidden
        } else if is_far && is_unlike {
            DotPresence::Missing
        } else if looks.is_found && (is_unlike || !faces_camera) {
            DotPresence::Doubtful
        } else {
            DotPresence::There
        }
    }
}

/// The likeness below which what is found may be no dot: [`DOUBTFUL`] of the middle one at most, and less where they spread. Of 4,715 dots on rendered balls 127 are
/// doubtful, and 72 of them are measured worse than to 0.5 deg; of the others 3 % are.
pub(super) fn doubtful_limit(likenesses: impl Iterator<Item = f64>) -> f64 {
    let mut likenesses: Vec<f64> = likenesses.collect();
    let middle = median(&mut likenesses);
    let mut off: Vec<f64> = likenesses.iter().map(|p| (p - middle).abs()).collect();
    let spread = SIGMA_PER_MAD * median(&mut off);
    (DOUBTFUL * middle).min(middle - DEVIATIONS * spread)
}

/// The detector's rate by depth.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DetectionRate {
    rates: [f64; EDGES.len() - 1],
}

impl DetectionRate {
    /// The mean over all depths.
    pub fn mean(&self) -> f64 {
        self.rates.iter().sum::<f64>() / self.rates.len() as f64
    }

    /// Expected number of finds of a dot in this direction (pattern frame).
    pub fn expected(&self, frames: &FittedFrames, direction: &Vec3) -> f64 {
        let of = |f: &FittedFrame| bin(f.depth(direction)).map(|b| self.rates[b]);
        frames.iter().filter_map(of).sum()
    }
}

fn bin(z: f64) -> Option<usize> {
    let above = EDGES.iter().take_while(|e| **e <= z).count();
    above.checked_sub(1).filter(|b| *b + 1 < EDGES.len())
}

/// How often every direction (pattern frame) was found, and the detector's rate. `finds[k]` holds the
/// directions found in frame `k`.
pub(super) fn find_records(
    frames: &FittedFrames,
    directions: &[Vec3],
    finds: &[Vec<usize>],
) -> (Vec<FindRecord>, DetectionRate) {
    let mut hits = vec![[0usize; EDGES.len() - 1]; directions.len()];
    let mut views = hits.clone();
    for (frame, finds) in frames.iter().zip(finds) {
        for (j, direction) in directions.iter().enumerate() {
            if let Some(b) = bin(frame.depth(direction)) {
                views[j][b] += 1;
                hits[j][b] += usize::from(finds.contains(&j));
            }
        }
    }
    let mut all = [[0usize; 2]; EDGES.len() - 1];
    for (hits, views) in hits.iter().zip(&views) {
        let found: usize = hits.iter().sum();
        if 2 * found > views.iter().sum() {
            for (b, sums) in all.iter_mut().enumerate() {
                sums[0] += hits[b];
                sums[1] += views[b];
            }
        }
    }
    // Rule of succession: a bin with few views says little, and none is certain.
    let rates = all.map(|[hits, views]| (hits + 1) as f64 / (views + 2) as f64);
    let rate = DetectionRate { rates };
    let find_records = hits.iter().zip(&views).map(|(hits, views)| {
        let mut record = FindRecord::default();
        for b in 0..rates.len() {
            let (p, missed) = (rates[b], views[b] - hits[b]);
            record.views += views[b];
            record.found += hits[b];
            record.expected += p * views[b] as f64;
            record.evidence += hits[b] as f64 * (p / FALSE_RATE).ln()
                + missed as f64 * ((1.0 - p) / (1.0 - FALSE_RATE)).ln();
        }
        record
    });
    (find_records.collect(), rate)
}
