//! The views that a design is for: those of one protocol, or several in equal parts.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::view::ProtocolName;

/// What `mixed` consists of: four dots alone, and what detectors give of a ball in the dark and in clutter.
const MIXED: [ProtocolName; 3] = [
    ProtocolName::Sparse,
    ProtocolName::Image,
    ProtocolName::Clutter,
];

/// Names the views that candidates are made for and tried on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DesignViews {
    /// `sparse`, `image` and `clutter` in equal parts: what one of them asks for alone may cost the others much.
    #[default]
    Mixed,
    /// [`ProtocolName::Paper`].
    Paper,
    /// [`ProtocolName::Sparse`].
    Sparse,
    /// [`ProtocolName::Clutter`].
    Clutter,
    /// [`ProtocolName::Image`].
    Image,
}

impl DesignViews {
    /// All names.
    pub const ALL: [Self; 5] = [
        Self::Mixed,
        Self::Paper,
        Self::Sparse,
        Self::Clutter,
        Self::Image,
    ];

    /// The protocols, in equal parts.
    pub fn protocols(self) -> &'static [ProtocolName] {
        match self {
            Self::Mixed => &MIXED,
            Self::Paper => &[ProtocolName::Paper],
            Self::Sparse => &[ProtocolName::Sparse],
            Self::Clutter => &[ProtocolName::Clutter],
            Self::Image => &[ProtocolName::Image],
        }
    }

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Mixed => "mixed",
            one => one.protocols()[0].as_str(),
        }
    }

    /// Whether views of this protocol are among them.
    pub fn include(self, protocol: ProtocolName) -> bool {
        self.protocols().contains(&protocol)
    }
}

impl std::str::FromStr for DesignViews {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "protocol", name)
    }
}

impl std::fmt::Display for DesignViews {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}
