//! How likely a pose is, beyond what the recognizer's model knows.
//!
//! The recognizer weighs a pose against dots that lie anywhere, independently of each other. Other
//! balls, fruit and clutter do not keep to that: their dots stand apart as dots of a pattern do, or
//! in rows and rings. What sets such poses apart shows beside the model's odds: likely dots without a
//! name, dots of the pattern that should be seen and are not, and how many have a name. (The
//! recognizer's own probability is already divided by the number of attempts.) A logistic map weighs these:
//!
//! ```text
//! ln odds' = w_0 + sum_i w_i f_i
//! ```
//!
//! Poses that were not found by their detections but by all places where dots may be ([`super::dense`]) have weights of
//! their own, for what those places say beside that.
//!
//! `bench derive` in `studies/` fits the weights, on images of which every second shows the ball, and begins with
//! the recognizer's own probability; `bench confidence` compares claims with the truth on other images. Claims are therefore those of someone who
//! does not know whether the ball is there: among images that all show it, more of them are correct.

use crate::vision::optics::derived;

/// Number of features.
pub const FEATURES: usize = 6;
/// Number of features of poses that were found by all places where dots may be.
pub const DENSE_FEATURES: usize = 5;

/// Number of features of poses that were found by all pixels of a small ball.
pub const WHOLE_FEATURES: usize = 5;
/// Constant and weights of [`PoseEvidence::whole_features`]: `bench small --fit 1800 --seed 9100`. Of 49 poses of other images that
/// it claims 0.85 or more of, half of whose images show no such ball, 48 were right.
const WHOLE: [f64; WHOLE_FEATURES + 1] = [-1.0548, 0.4948, 0.1130, 5.4169, -0.0722, -0.8381];
/// A larger margin is no surer: what the model leaves out does not shrink with it.
const MAX_MARGIN: f64 = 25.0;
/// So many dots of anything fit some pose: it is no likelier than not, unless a motion expects it. Of 300 frames of
/// `dots12` in all conditions that the map alone answers by three dots 3 were right and 3 wrong, by four or more 158 and 2
/// (`synth dots12 --as images --preset all --frames 300 --seed 91277`); of 900 of `dots20` none was answered by three.
const ANY_DOTS: usize = 3;
const EVEN: f64 = 0.5;
/// Bounds of the model's ln odds.
const LN_ODDS: [f64; 2] = [-5.0, 25.0];
/// Bound of the detector's doubt.
const MAX_DOUBT: f64 = 3.0;
/// Bound of the misfit.
const MAX_MISFIT: f64 = 6.0;

/// What speaks for a pose and against it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseEvidence {
    /// The recognizer's probability; 0 where it has found another pose.
    pub confidence: f64,
    /// Dots that have a name.
    pub named: usize,
    /// Detections that are likelier dots than not, without a name.
    pub unnamed: usize,
    /// The pattern's dots that face the camera and are not named.
    pub missing: usize,
    /// How much the detector doubts the named dots: the mean of `-ln p`.
    pub doubt: f64,
    /// Where the pose was found by all places where dots may be: what these say.
    pub dense: Option<DenseEvidence>,
    /// Where the pose was found by all pixels of a small ball (`src/vision/whole`): by how much its logarithmic likelihood
    /// exceeds that of any other.
    pub whole: Option<WholeEvidence>,
    /// How far the named dots are off, in standard deviations per axis: the root of the mean square.
    pub misfit: f64,
}

/// What the cells of the detector's map say of a pose (`pose::dense`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DenseEvidence {
    /// The sum of its terms.
    pub score: f64,
    /// By how much that exceeds the sum of any other orientation.
    pub margin: f64,
}

/// What the pixels of a small ball say of a pose (`src/vision/whole`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WholeEvidence {
    /// By how much its logarithmic likelihood exceeds that of any other orientation.
    pub margin: f64,
    /// The part of the squares that shading leaves which the dots explain.
    pub explained: f64,
}

impl PoseEvidence {
    /// The features of a pose that its detections gave, beside the constant 1.
    pub fn features(&self) -> [f64; FEATURES] {
        [
            self.ln_odds(),
            self.named as f64,
            self.unnamed as f64,
            self.missing as f64,
            self.doubt.min(MAX_DOUBT),
            self.misfit.min(MAX_MISFIT),
        ]
    }

    /// The features of a pose that was found by all places where dots may be; `None` for others.
    pub fn dense_features(&self) -> Option<[f64; DENSE_FEATURES]> {
        let DenseEvidence { score, margin } = self.dense?;
        Some([
            self.ln_odds(),
            self.unnamed as f64,
            self.missing as f64,
            margin,
            score,
        ])
    }

    /// The features of a pose that was found by all pixels of a small ball; `None` for others.
    pub fn whole_features(&self) -> Option<[f64; WHOLE_FEATURES]> {
        let WholeEvidence { margin, explained } = self.whole?;
        Some([
            self.ln_odds(),
            margin.min(MAX_MARGIN),
            explained,
            self.unnamed as f64,
            self.missing as f64,
        ])
    }

    /// Whether the pose is that of its detections.
    pub fn is_of_detections(&self) -> bool {
        self.dense.is_none() && self.whole.is_none()
    }

    fn ln_odds(&self) -> f64 {
        let p = self.confidence;
        let ln_odds = (p / (1.0 - p).max(f64::MIN_POSITIVE)).ln();
        ln_odds.clamp(LN_ODDS[0], LN_ODDS[1])
    }
}

/// The map from evidence to a probability.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TrustMap {
    /// The constant.
    pub constant: f64,
    /// The weights of [`PoseEvidence::features`].
    pub weights: [f64; FEATURES],
    /// Constant and weights of [`PoseEvidence::dense_features`], for poses that have these.
    pub dense: [f64; DENSE_FEATURES + 1],
}

impl TrustMap {
    /// The recognizer's own probability.
    pub const IDENTITY: Self = Self {
        constant: 0.0,
        weights: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        dense: [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    };

    /// For dots that may be off by more than the default placement: fitted without the detector's doubt and the
    /// misfit, which a wide placement makes small for any pose.
    pub const WIDE: Self = Self::derived(&derived::TRUST_MAP_WIDE);

    /// Fitted for patterns of 12, 20 and 32 dots (docs/measurements/trust.md).
    pub const DEFAULT: Self = Self::derived(&derived::TRUST_MAP);

    /// Of the constant and the weights.
    const fn derived(&[constant, w0, w1, w2, w3, w4, w5]: &[f64; FEATURES + 1]) -> Self {
        Self {
            constant,
            weights: [w0, w1, w2, w3, w4, w5],
            dense: derived::DENSE_MAP,
        }
    }

    /// The probability that the pose is correct.
    pub fn probability(&self, evidence: &PoseEvidence) -> f64 {
        if *self == Self::IDENTITY {
            return evidence.confidence;
        }
        let sum = |constant: f64, weights: &[f64], features: &[f64]| {
            let terms = weights.iter().zip(features).map(|(w, f)| w * f);
            constant + terms.sum::<f64>()
        };
        let ln_odds = match (evidence.whole_features(), evidence.dense_features()) {
            (Some(features), _) => sum(WHOLE[0], &WHOLE[1..], &features),
            (None, Some(features)) => sum(self.dense[0], &self.dense[1..], &features),
            (None, None) => sum(self.constant, &self.weights, &evidence.features()),
        };
        let probability = 1.0 / (1.0 + (-ln_odds).exp());
        let is_any = evidence.is_of_detections() && evidence.named <= ANY_DOTS;
        if is_any && probability > EVEN {
            EVEN
        } else {
            probability
        }
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
    fn three_dots_alone_are_no_answer() {
        let sure = PoseEvidence {
            confidence: 1.0 - 1e-9,
            named: 3,
            ..PoseEvidence::default()
        };
        let map = TrustMap::default();
        assert!(map.probability(&sure) <= EVEN);
        assert!(map.probability(&PoseEvidence { named: 4, ..sure }) > EVEN);
        // What all places or all pixels show is more than the dots with a name.
        let whole = WholeEvidence {
            margin: MAX_MARGIN,
            explained: 0.8,
        };
        let by_pixels = PoseEvidence {
            whole: Some(whole),
            ..sure
        };
        assert!(map.probability(&by_pixels) > EVEN);
    }

    #[test]
    fn what_speaks_against_a_pose_makes_it_less_likely() {
        let clear = PoseEvidence {
            confidence: 0.9,
            named: 7,
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
        ];
        for doubt in doubts {
            assert!(
                map.probability(&doubt) < map.probability(&clear),
                "{doubt:?}"
            );
        }
    }
}
