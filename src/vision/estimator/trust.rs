//! How likely a pose is, beyond what the recognizer's model knows.
//!
//! The recognizer weighs a pose against dots that lie anywhere, independently of each other. Other
//! balls, fruit and clutter do not keep to that: their dots stand apart as dots of a pattern do, or
//! in rows and rings. What sets such poses apart shows beside the model's odds: likely dots without a
//! name, dots of the pattern that should be seen and are not, how many have a name, how many attempts it
//! took, and how much of an outline the edges show. A logistic map weighs these:
//!
//! ```text
//! ln odds' = w_0 + sum_i w_i f_i
//! ```
//!
//! Its weights are fitted on rendered images of which most show something else (`trust_tables
//! confidence` in `studies/` fits such a map), so that answers are rather too careful where all images
//! show the ball; docs/measurements/trust.md compares claims with the truth on other images.

/// Number of features.
pub const FEATURES: usize = 6;

/// Bounds of the model's ln odds.
const LN_ODDS: [f64; 2] = [-5.0, 25.0];

/// What speaks for a pose and against it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseEvidence {
    /// The recognizer's probability.
    pub pose_confidence: f64,
    /// Dots that have a name.
    pub named: usize,
    /// Detections that are likelier dots than not, without a name.
    pub unnamed: usize,
    /// The pattern's dots that face the camera and are not named.
    pub missing: usize,
    /// Runs of the recognizer.
    pub attempts: usize,
    /// Share of the outline that the edges show; 0 where they show none, 1 where it was given.
    pub support: f64,
}

impl PoseEvidence {
    /// The features of the map, beside the constant 1.
    pub fn features(&self) -> [f64; FEATURES] {
        let p = self.pose_confidence;
        let ln_odds = (p / (1.0 - p).max(f64::MIN_POSITIVE)).ln();
        [
            ln_odds.clamp(LN_ODDS[0], LN_ODDS[1]),
            self.named as f64,
            self.unnamed as f64,
            self.missing as f64,
            (self.attempts.max(1) as f64).ln(),
            self.support,
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
        weights: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    };

    /// The probability that the pose is correct.
    pub fn probability(&self, evidence: &PoseEvidence) -> f64 {
        if *self == Self::IDENTITY {
            return evidence.pose_confidence;
        }
        let features = evidence.features();
        let terms = self.weights.iter().zip(features).map(|(w, f)| w * f);
        let ln_odds: f64 = self.constant + terms.sum::<f64>();
        1.0 / (1.0 + (-ln_odds).exp())
    }
}

impl Default for TrustMap {
    /// Fitted on 600 images of the ball and 1 700 others, half of them in good conditions (seeds 14220001,
    /// 14220011, 14220021, 14220031 and 14220041), less one nat: then at most one in a hundred images of
    /// any other kind is answered.
    fn default() -> Self {
        Self {
            constant: -3.48,
            weights: [0.82, 0.37, -0.65, -0.08, -1.0, 1.45],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_identity_keeps_every_probability() {
        for pose_confidence in [0.0, 1e-9, 0.3, 0.999_999, 1.0] {
            let evidence = PoseEvidence {
                pose_confidence,
                named: 7,
                ..PoseEvidence::default()
            };
            let found = TrustMap::IDENTITY.probability(&evidence);
            assert_eq!(found, pose_confidence);
        }
    }

    #[test]
    fn probabilities_stay_within_their_domain() {
        for pose_confidence in [0.0, 0.5, 1.0] {
            let evidence = PoseEvidence {
                pose_confidence,
                unnamed: 1000,
                ..PoseEvidence::default()
            };
            let found = TrustMap::default().probability(&evidence);
            assert!((0.0..=1.0).contains(&found), "{found}");
        }
    }
}
