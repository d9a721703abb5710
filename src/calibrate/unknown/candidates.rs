//! What may be a dot on a ball.

use super::evidence::MarkEvidence;
use super::map::MapDot;
use crate::pattern::Pattern;

/// A mark that is more likely is a dot, one that is less likely none. Of 99 hand-drawn balls without print (`bench calibration-unknown`, seeds 36510001
/// and, with --guided, 36510002) 70 have all marks right, 29 some in doubt or turned away, none a wrong one; of 26 whose print is not found as such
/// (36510003) 14, 8 and 4. With 0.8 and 0.95 for the first limit it is 73, 26, 0 and 61, 38, 0, with twice the second 70, 27, 2.
pub(super) const A_DOT: f64 = 0.9;
pub(super) const NO_DOT: f64 = 0.05;

/// What a mark of a ball is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A dot.
    Dot,
    /// A dot or print.
    Doubtful,
    /// It may be a dot, and hardly any view faces it.
    TurnedAway,
    /// Print, a stain or the shadow of a finger.
    Other,
}

impl Kind {
    /// The name in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Dot => "dot",
            Self::Doubtful => "doubtful",
            Self::TurnedAway => "turned_away",
            Self::Other => "other",
        }
    }
}

/// What may be a dot.
#[derive(Debug, Clone, Copy)]
pub(super) struct MarkCandidate {
    pub dot: MapDot,
    /// Its angular radius, radians.
    pub radius: f64,
    pub kind: Kind,
    /// How likely it is a dot; of what nothing but the detector sees, what that takes it for over the middle dot.
    pub probability: f64,
    /// What the witnesses say; `None` where nothing but the detector sees it.
    pub evidence: Option<MarkEvidence>,
}

impl MarkCandidate {
    /// The probability that it is a dot; where nothing but the detector sees it, by what it is taken for.
    pub fn is_dot(&self) -> f64 {
        match (self.evidence, self.kind) {
            (Some(_), _) => self.probability,
            (None, Kind::Dot) => A_DOT,
            (None, Kind::Other) => NO_DOT,
            (None, Kind::Doubtful | Kind::TurnedAway) => 0.5,
        }
    }
}

/// What may be a dot on a ball.
#[derive(Debug)]
pub(super) struct Candidates {
    /// The likeliest first, what is none last.
    pub dots: Vec<MarkCandidate>,
    /// Share of the surface that no view shows.
    pub blind: f64,
    /// Radius, radians, and darkness of the middle dot.
    pub radius: f64,
    pub darkness: f64,
    /// Whether there is print beside the dots.
    pub is_printed: bool,
}

impl Candidates {
    /// Those of a kind.
    pub fn of(&self, kind: Kind) -> impl Iterator<Item = &MarkCandidate> {
        self.dots.iter().filter(move |c| c.kind == kind)
    }

    /// The pattern of the marks that are dots, whatever is known of their number; `None` where they make none.
    pub fn likely(&self) -> Option<Pattern> {
        Pattern::new(self.of(Kind::Dot).map(|c| c.dot.direction).collect()).ok()
    }
}
