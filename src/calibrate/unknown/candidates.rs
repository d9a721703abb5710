//! What may be a dot on a ball.

use super::evidence::MarkEvidence;
use super::map::MapDot;

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
