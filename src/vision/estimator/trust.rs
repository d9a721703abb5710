//! How likely a pose is, beyond what the recognizer's model knows.
//!
//! The recognizer weighs a pose against dots that lie anywhere, independently of each other. Other
//! balls, fruit and clutter do not keep to that: their dots stand apart as dots of a pattern do, or
//! in rows and rings. What sets such poses apart shows beside the model's odds: likely dots without a
//! name, dots of the pattern that should be seen and are not, how many have a name, and how many attempts it
//! took. A logistic map weighs these:
//!
//! ```text
//! ln odds' = w_0 + sum_i w_i f_i
//! ```
//!
//! `bench derive` in `studies/` fits the weights, on images of which every second shows the ball, and begins with
//! the recognizer's own probability; `bench confidence` compares claims with the truth on other images. Claims are therefore those of someone who
//! does not know whether the ball is there: among images that all show it, more of them are correct.

use crate::vision::derived;

/// Number of features.
pub const FEATURES: usize = 7;

/// Bounds of the model's ln odds.
const LN_ODDS: [f64; 2] = [-5.0, 25.0];
/// Bound of the detector's doubt.
const MAX_DOUBT: f64 = 3.0;
/// Bound of the misfit.
const MAX_MISFIT: f64 = 6.0;

/// What speaks for a pose and against it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseEvidence {
    /// The recognizer's probability.
    pub confidence: f64,
    /// Dots that have a name.
    pub named: usize,
    /// Detections that are likelier dots than not, without a name.
    pub unnamed: usize,
    /// The pattern's dots that face the camera and are not named.
    pub missing: usize,
    /// Runs of the recognizer.
    pub attempts: usize,
    /// How much the detector doubts the named dots: the mean of `-ln p`.
    pub doubt: f64,
    /// How far the named dots are off, in standard deviations per axis: the root of the mean square.
    pub misfit: f64,
}

impl PoseEvidence {
    /// The features of the map, beside the constant 1.
    pub fn features(&self) -> [f64; FEATURES] {
        let p = self.confidence;
        let ln_odds = (p / (1.0 - p).max(f64::MIN_POSITIVE)).ln();
        [
            ln_odds.clamp(LN_ODDS[0], LN_ODDS[1]),
            self.named as f64,
            self.unnamed as f64,
            self.missing as f64,
            (self.attempts.max(1) as f64).ln(),
            self.doubt.min(MAX_DOUBT),
            self.misfit.min(MAX_MISFIT),
        ]
    }
}

/// The map from evidence to a probability.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TrustMap {
    /// The constant.
    pub constant: f64,
    /// The weights of [`PoseEvidence::features`].
    pub weights: [f64; FEATURES],
}

impl TrustMap {
    /// The recognizer's own probability.
    pub const IDENTITY: Self = Self {
        constant: 0.0,
        weights: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    };

    /// For dots that may be off by more than the default placement: fitted without the detector's doubt and the
    /// misfit, which a wide placement makes small for any pose.
    pub const WIDE: Self = Self::derived(&derived::TRUST_MAP_WIDE);

    /// Fitted for patterns of 12, 20 and 32 dots (docs/measurements/trust.md).
    pub const DEFAULT: Self = Self::derived(&derived::TRUST_MAP);

    /// Of the constant and the weights.
    const fn derived(&[constant, w0, w1, w2, w3, w4, w5, w6]: &[f64; FEATURES + 1]) -> Self {
        Self {
            constant,
            weights: [w0, w1, w2, w3, w4, w5, w6],
        }
    }

    /// The probability that the pose is correct.
    pub fn probability(&self, evidence: &PoseEvidence) -> f64 {
        if *self == Self::IDENTITY {
            return evidence.confidence;
        }
        let features = evidence.features();
        let terms = self.weights.iter().zip(features).map(|(w, f)| w * f);
        let ln_odds: f64 = self.constant + terms.sum::<f64>();
        1.0 / (1.0 + (-ln_odds).exp())
    }
}

impl Default for TrustMap {
    fn default() -> Self {
        Self::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_identity_keeps_every_probability() {
        for confidence in [0.0, 1e-9, 0.3, 0.999_999, 1.0] {
            let evidence = PoseEvidence {
                confidence,
                named: 7,
                ..PoseEvidence::default()
            };
            let found = TrustMap::IDENTITY.probability(&evidence);
            assert_eq!(found, confidence);
        }
    }

    #[test]
    fn probabilities_stay_within_their_domain() {
        for confidence in [0.0, 0.5, 1.0] {
            let evidence = PoseEvidence {
                confidence,
                unnamed: 1000,
                ..PoseEvidence::default()
            };
            let found = TrustMap::default().probability(&evidence);
            assert!((0.0..=1.0).contains(&found), "{found}");
        }
    }

    #[test]
    fn what_speaks_against_a_pose_makes_it_less_likely() {
        let clear = PoseEvidence {
            confidence: 0.9,
            named: 7,
            attempts: 1,
            ..PoseEvidence::default()
        };
        let map = TrustMap::default();
        let doubts = [
            PoseEvidence { named: 5, ..clear },
            PoseEvidence {
                unnamed: 2,
                ..clear
            },
            PoseEvidence {
                missing: 3,
                ..clear
            },
            PoseEvidence {
                attempts: 4,
                ..clear
            },
        ];
        for doubt in doubts {
            assert!(
                map.probability(&doubt) < map.probability(&clear),
                "{doubt:?}"
            );
        }
    }
}
