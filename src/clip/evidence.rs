//! What the frames of a sequence say of its spin beside their orientations.

use super::rolling::SequenceRows;
use super::smears::SequenceSmears;
use crate::spin::alias::{SpinEvidence, Together};

/// The smears of dots, and the rows of a rolling shutter, where they are known.
#[derive(Default)]
pub struct SequenceEvidence<'a> {
    /// The smears.
    pub smears: Option<&'a SequenceSmears>,
    /// The rows.
    pub rows: Option<&'a SequenceRows<'a>>,
}

impl SequenceEvidence<'_> {
    /// All of it; `None` without any.
    pub fn together(&self) -> Option<Together<'_>> {
        let smears = self.smears.map(|smears| smears as &dyn SpinEvidence);
        let rows = self.rows.map(|rows| rows as &dyn SpinEvidence);
        let all: Vec<_> = smears.into_iter().chain(rows).collect();
        (!all.is_empty()).then_some(Together(all))
    }
}
