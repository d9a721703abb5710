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
//! unnamed  = sum over detections without a name of z min(-ln(1 - p), 3)
//! missing  = sum over dots of the pattern without a name of max(z - 0.5, 0)
//! ```
//!
//! with z towards the camera, 1 in the ball's middle and 0 at its limb. A dice's pip that no dot of the pattern explains, or a dot that should lie
//! where none is, says most in the middle; near the limb dots come and go.
//!
//! Poses that were not found by their detections but by all places where dots may be ([`super::places`]), or by all pixels of a small ball
//! ([`super::pixels`]), have weights of their own, for what those say beside that.
//!
//! `bench derive` in `studies/` fits the weights, on images of which every second shows the ball (small balls for those of their pixels), and
//! begins with the recognizer's own probability; `bench confidence` compares claims with the truth on other images. Claims are therefore those of someone who
//! does not know whether the ball is there: among images that all show it, more of them are correct.

use crate::vision::optics::derived;

/// Number of features.
pub const FEATURES: usize = 6;
/// A constant and the weights of the features.
pub type TrustWeights = [f64; FEATURES + 1];

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
/// A detection is no surer a dot than this says, as `-ln(1 - p)`: 95 %.
const MAX_SURENESS: f64 = 3.0;
/// Dots of the pattern beyond this z are seen in nearly every frame. Fitted by their z alone, in six bins, dots that are not
/// seen weigh nothing below it, and ever more above it (7 372 poses of `bench derive`, of two seeds).
const FACING: f64 = 0.5;

/// What speaks for a pose and against it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseEvidence {
    /// The recognizer's probability; 0 where it has found another pose.
    pub confidence: f64,
    /// Dots that have a name.
    pub named: usize,
    /// How sure detections are that have no name, the more the nearer to the ball's middle: the sum of [`PoseEvidence::unnamed_dot`].
    pub unnamed: f64,
    /// How much the pattern's dots face the camera that have no detection: the sum of [`PoseEvidence::missing_dot`].
    pub missing: f64,
    /// How much the detector doubts the named dots: the mean of `-ln p`.
    pub doubt: f64,
    /// How far the named dots are off, in standard deviations per axis: the root of the mean square.
    pub misfit: f64,
    /// How the pose was found.
    pub source: PoseSource,
}

/// What a pose was found by.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum PoseSource {
    /// Its detections.
    #[default]
    Detections,
    /// All places where dots may be.
    Places(PlacesEvidence),
    /// All pixels of a small ball.
    Pixels(PixelsEvidence),
}

/// What the cells of the detector's map say of a pose (`pose::places`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacesEvidence {
    /// The sum of its terms.
    pub score: f64,
    /// By how much that exceeds the sum of any other orientation.
    pub margin: f64,
}

/// What the pixels of a small ball say of a pose (`pose::pixels`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelsEvidence {
    /// By how much its logarithmic likelihood exceeds that of any other orientation.
    pub margin: f64,
    /// The part of the squares that shading leaves which the dots explain.
    pub explained: f64,
}

impl PoseEvidence {
    /// What a detection of this probability without a name says, at this z of the ball (view frame).
    pub fn unnamed_dot(probability: f64, z: f64) -> f64 {
        z.max(0.0) * (-(-probability).ln_1p()).min(MAX_SURENESS)
    }

    /// What a dot of the pattern without a detection says, at this z of the ball (view frame).
    pub fn missing_dot(z: f64) -> f64 {
        (z - FACING).max(0.0)
    }

    /// What the map weighs, beside the constant 1, in the order of the weights of the pose's source; 0 where there are fewer.
    pub fn features(&self) -> [f64; FEATURES] {
        let (named, unnamed, missing) = (self.named as f64, self.unnamed, self.missing);
        let ln_odds = self.ln_odds();
        match self.source {
            PoseSource::Detections => [
                ln_odds,
                named,
                unnamed,
                missing,
                self.doubt.min(MAX_DOUBT),
                self.misfit.min(MAX_MISFIT),
            ],
            PoseSource::Places(PlacesEvidence { score, margin }) => {
                [ln_odds, unnamed, missing, margin, score, 0.0]
            }
            PoseSource::Pixels(PixelsEvidence { margin, explained }) => [
                ln_odds,
                margin.min(MAX_MARGIN),
                explained,
                unnamed,
                missing,
                0.0,
            ],
        }
    }

    /// Whether the pose is that of its detections.
    pub fn is_of_detections(&self) -> bool {
        self.source == PoseSource::Detections
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
    /// For poses by their detections.
    pub detections: TrustWeights,
    /// By all places where dots may be.
    pub places: TrustWeights,
    /// By all pixels of a small ball.
    pub pixels: TrustWeights,
}

impl TrustMap {
    /// The recognizer's own probability.
    pub const IDENTITY: Self = {
        let own = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        Self {
            detections: own,
            places: own,
            pixels: own,
        }
    };

    /// Fitted for patterns of 12, 20 and 32 dots (docs/measurements/trust.md).
    pub const DEFAULT: Self = Self {
        detections: derived::TRUST_MAP,
        places: derived::DENSE_MAP,
        pixels: derived::PIXELS_MAP,
    };

    /// For dots that may be off by more than the default placement: fitted without the detector's doubt and the
    /// misfit, which a wide placement makes small for any pose.
    pub const WIDE: Self = Self {
        detections: derived::TRUST_MAP_WIDE,
        ..Self::DEFAULT
    };

    /// The probability that the pose is correct.
    pub fn probability(&self, evidence: &PoseEvidence) -> f64 {
        if *self == Self::IDENTITY {
            return evidence.confidence;
        }
        let weights = match evidence.source {
            PoseSource::Detections => &self.detections,
            PoseSource::Places(_) => &self.places,
            PoseSource::Pixels(_) => &self.pixels,
        };
        let probability = derived::probability(weights, evidence.features());
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

    /// Seven dots with a name, and nothing against them.
    fn clear() -> PoseEvidence {
        PoseEvidence {
            confidence: 0.9,
            named: 7,
            ..PoseEvidence::default()
        }
    }

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
                unnamed: 1000.0,
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
        let pixels = PixelsEvidence {
            margin: MAX_MARGIN,
            explained: 0.8,
        };
        let by_pixels = PoseEvidence {
            source: PoseSource::Pixels(pixels),
            ..sure
        };
        assert!(map.probability(&by_pixels) > EVEN);
    }

    #[test]
    fn what_is_amiss_in_the_middle_says_more_than_at_the_limb() {
        let clear = clear();
        let map = TrustMap::default();
        let with_unnamed = |z: f64| PoseEvidence {
            unnamed: PoseEvidence::unnamed_dot(0.99, z),
            ..clear
        };
        let with_missing = |z: f64| PoseEvidence {
            missing: PoseEvidence::missing_dot(z),
            ..clear
        };
        assert!(map.probability(&with_unnamed(0.9)) < map.probability(&with_unnamed(0.2)));
        assert!(map.probability(&with_missing(0.9)) < map.probability(&with_missing(0.6)));
        // A dot that hardly faces the camera is often not seen.
        assert_eq!(PoseEvidence::missing_dot(0.3), 0.0);
        let [sure, unsure] = [0.99, 0.5].map(|p| PoseEvidence::unnamed_dot(p, 0.7));
        assert!(sure > 2.0 * unsure && PoseEvidence::unnamed_dot(1.0, 1.0).is_finite());
    }

    #[test]
    fn what_speaks_against_a_pose_makes_it_less_likely() {
        let clear = clear();
        let map = TrustMap::default();
        let doubts = [
            PoseEvidence { named: 5, ..clear },
            PoseEvidence {
                unnamed: PoseEvidence::unnamed_dot(0.99, 0.7),
                ..clear
            },
            PoseEvidence {
                missing: PoseEvidence::missing_dot(0.95),
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
