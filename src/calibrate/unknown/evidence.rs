//! How likely a mark of a ball is a dot.
//!
//! Three witnesses: the surface shows a disc, single frames show it dark, and the detector finds a dot there in the views that face it.
//! Dots are of one pen: of one size and one darkness, within what a hand makes of it. A logistic map weighs what they say:
//!
//! ```text
//! ln odds = w_0 + sum_i w_i f_i
//! ```
//!
//! Print may have discs too. It is darker than the dots, or fainter, or differs in size; what is just like the dots only a person can tell.
//!
//! `bench derive` in `studies/` fits the map, on balls that are drawn and turned by hand, a quarter of them with print; `bench calibration-unknown`
//! judges the tables that are made with it, on other balls.

use crate::vision::optics::derived::{self, MARK_MAP};

/// Number of features.
pub const MARK_FEATURES: usize = 9;

/// Beyond these bounds a feature says no more: ln of a ratio, a contrast, and views.
const MAX_LN: f64 = 1.5;
const MAX_CONTRAST: f64 = 3.0;
const ENOUGH_VIEWS: f64 = 16.0;
/// The likeness from which on a place is a dot to the detector. Chosen on 40 plain balls drawn by hand (`bench calibration-unknown --clips 40 --seed
/// 35100001 --plain`): fingers and shadows had 0.04 at most, dots 0.15 or more but for the smallest.
pub(super) const SUSPECTED: f64 = 0.15;

/// What speaks for a mark being a dot, and against it. The middle dot is the median of the discs that the detector finds too.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkEvidence {
    /// Its radius over the middle dot's.
    pub radius: f64,
    /// Its darkness over the middle dot's.
    pub darkness: f64,
    /// Its area over that of the ellipse of the same moments.
    pub solidity: f64,
    /// Mean darkness around it over its own.
    pub around: f64,
    /// By how much it is darker than what is about it in single frames, over the middle dot: the median.
    pub contrast: f64,
    /// The mean probability of a dot there over the views that it faces, over the middle dot's.
    pub likeness: f64,
    /// Views that it faces well, without a finger there.
    pub views: usize,
}

impl MarkEvidence {
    /// What the map weighs, beside the constant 1.
    pub fn features(&self) -> [f64; MARK_FEATURES] {
        let ln = |ratio: f64| ratio.max(f64::MIN_POSITIVE).ln().clamp(-MAX_LN, MAX_LN);
        let (darkness, contrast) = (ln(self.darkness), self.contrast.max(0.0));
        [
            // Two that run into one are larger, dots of a pen that runs dry less dark; print may be darker.
            ln(self.radius).max(0.0),
            darkness.max(0.0),
            darkness.min(0.0).powi(2),
            (1.0 - self.solidity).clamp(0.0, 1.0),
            self.around.min(1.0),
            contrast.min(1.0),
            contrast.clamp(1.0, MAX_CONTRAST) - 1.0,
            (self.likeness / SUSPECTED).min(1.0),
            (self.views as f64 / ENOUGH_VIEWS).min(1.0),
        ]
    }

    /// The probability that the mark is a dot.
    pub fn probability(&self) -> f64 {
        derived::probability(&MARK_MAP, self.features())
    }
}

/// As the middle dot is.
#[cfg(test)]
pub(super) const DOT: MarkEvidence = MarkEvidence {
    radius: 1.0,
    darkness: 1.0,
    solidity: 0.97,
    around: 0.05,
    contrast: 1.0,
    likeness: 1.0,
    views: 40,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_speaks_against_a_mark_makes_it_less_likely_a_dot() {
        assert!(DOT.probability() > 0.95, "{}", DOT.probability());
        let less = |doubt: MarkEvidence| {
            let probability = doubt.probability();
            assert!(probability < DOT.probability(), "{doubt:?}");
            probability
        };
        // Too large, too faint, or darker than the dots.
        let dark = MarkEvidence {
            darkness: 3.0,
            contrast: 3.0,
            ..DOT
        };
        let large = MarkEvidence { radius: 2.0, ..DOT };
        let faint = MarkEvidence {
            darkness: 0.2,
            contrast: 0.2,
            ..DOT
        };
        for doubt in [dark, large, faint] {
            assert!(less(doubt) < 0.9, "{doubt:?}");
        }
        // What speaks against it alone is not enough.
        let ragged = MarkEvidence {
            solidity: 0.6,
            ..DOT
        };
        let blurred = MarkEvidence { around: 0.4, ..DOT };
        let unseen = MarkEvidence {
            likeness: 0.0,
            ..DOT
        };
        assert!([ragged, blurred, unseen].map(less).iter().all(|p| *p > 0.9));
        // A shadow: seen by no detector, faint, in half of the frames.
        let shadow = MarkEvidence {
            darkness: 0.1,
            contrast: 0.05,
            likeness: 0.0,
            ..DOT
        };
        assert!(shadow.probability() < 0.01, "{}", shadow.probability());
    }

    #[test]
    fn probabilities_stay_within_their_domain() {
        let odd = MarkEvidence {
            radius: 0.0,
            darkness: f64::INFINITY,
            solidity: -3.0,
            likeness: 1e6,
            views: 0,
            ..DOT
        };
        assert!((0.0..=1.0).contains(&odd.probability()));
    }
}
