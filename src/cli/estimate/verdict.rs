//! The verdict over all frames of `spindoe estimate`, in words: which table fits, and whether the images are
//! mirrored.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::clip::Judgment;
use crate::clip::verdict::Verdict;

/// What all frames together say, of tables with these names.
#[derive(Clone, Copy)]
pub(in crate::cli) struct VerdictWords<'a> {
    judgment: &'a Judgment,
    tables: &'a [PathBuf],
}

impl<'a> VerdictWords<'a> {
    pub fn new(judgment: &'a Judgment, tables: &'a [PathBuf]) -> Self {
        Self { judgment, tables }
    }

    fn table_name(&self, table: usize) -> String {
        let path = self.tables.get(table).map(PathBuf::as_path);
        path.unwrap_or(Path::new("the table")).display().to_string()
    }

    /// Why all poses are rejected, where they are.
    pub fn rejection(&self) -> Option<String> {
        match self.judgment.verdict {
            Verdict::None { best, .. } => {
                let best = &self.judgment.hypotheses[best];
                let (which, right) = match self.tables.len() {
                    1 => ("this table does not fit", "is it the right one?"),
                    _ => ("none of the tables fits", "is the right one among them?"),
                };
                let motion = if best.has_common_motion {
                    "one motion"
                } else {
                    "no common motion"
                };
                Some(format!(
                    "{which} these images ({} of {} frames, {motion}): {right}",
                    best.answered(),
                    best.frames.len(),
                ))
            }
            Verdict::Fits { ln_lead, .. } if self.judgment.is_mirrored() => Some(format!(
                "the images are mirrored (odds {} to 1): --mirrored reads them",
                odds(ln_lead)
            )),
            Verdict::Tied { hypotheses, .. } => {
                let [a, b] = hypotheses.map(|h| self.judgment.hypotheses[h].table);
                (a != b).then(|| {
                    format!(
                        "{} and {} fit these images about as well: give the right one",
                        self.table_name(a),
                        self.table_name(b)
                    )
                })
            }
            _ => None,
        }
    }

    /// The choice among several tables, in words.
    pub fn words(&self) -> Option<String> {
        let is_choice = self.tables.len() > 1;
        match self.judgment.verdict {
            Verdict::Fits { ln_lead, .. } if is_choice && self.rejection().is_none() => {
                Some(format!(
                    "{} fits, odds {} to 1 against the next best",
                    self.table_name(self.judgment.table),
                    odds(ln_lead)
                ))
            }
            Verdict::Open if is_choice => Some(format!(
                "too few frames with enough dots to choose among the tables: {} is taken",
                self.table_name(self.judgment.table)
            )),
            _ => None,
        }
    }

    /// The evidence for all hypotheses.
    pub fn to_json(self) -> Value {
        if self.judgment.hypotheses.is_empty() {
            return Value::Null;
        }
        let hypotheses = self.judgment.hypotheses.iter().map(|h| {
            json!({
                "table": self.table_name(h.table),
                "mirrored": h.is_mirrored,
                "frames": h.frames.len(),
                "answered": h.answered(),
                "common_motion": h.has_common_motion,
                "ln_evidence": h.ln_evidence(),
            })
        });
        json!({
            "verdict": self.judgment.as_str(),
            "table": self.table_name(self.judgment.table),
            "ln_odds": self.judgment.ln_odds(),
            "hypotheses": hypotheses.collect::<Vec<_>>(),
        })
    }
}

/// Odds as people read them.
fn odds(ln_lead: f64) -> String {
    match ln_lead.exp() {
        odds if odds > 1e6 => "more than a million".into(),
        odds => format!("{odds:.0}"),
    }
}
