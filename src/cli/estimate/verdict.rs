//! The verdict over all frames of `spindoe estimate`: which table fits, and whether the images are
//! mirrored.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Value, json};

use super::Picture;
use crate::clip::batch::{Batch, BatchConfig, BatchFrame};
use crate::clip::verdict::{BallHypothesis, FrameScore, Scorer, Verdict, decide, mirrored_pattern};
use crate::error::Result;
use crate::recognize::RecognizerRejection;
use crate::spin::Measurement;
use crate::spin::robust::RobustEstimator;
use crate::vision::{Estimator, FrameEstimate, FrameRejection};

/// Frames that have a say, spread over the clip.
const MAX_FRAMES: usize = 64;
/// Frames that one task scores.
const CHUNK: usize = 4;

/// What all frames together say.
pub(super) struct Judgment {
    verdict: Verdict,
    hypotheses: Vec<BallHypothesis>,
    tables: Vec<PathBuf>,
    /// The table in use.
    table: usize,
}

impl Judgment {
    /// No verdict was wanted.
    pub fn none() -> Self {
        Self {
            verdict: Verdict::Open,
            hypotheses: Vec::new(),
            tables: Vec::new(),
            table: 0,
        }
    }

    /// Judges a batch that was estimated with the first of `estimators`. Where none fits, or the images are mirrored, no frame
    /// keeps its pose.
    pub fn of(
        estimators: &[Estimator],
        tables: &[PathBuf],
        config: &BatchConfig,
        batch: &mut Batch<Picture>,
    ) -> Result<Self> {
        let mut hypotheses = Vec::new();
        for (table, estimator) in estimators.iter().enumerate() {
            hypotheses.push(hypothesis(estimator, table, false, config, batch)?);
            let mirrored = estimator.for_pattern(&mirrored_pattern(estimator.pattern())?)?;
            hypotheses.push(hypothesis(&mirrored, table, true, config, batch)?);
        }
        let mut this = Self {
            verdict: decide(&hypotheses),
            hypotheses,
            tables: tables.to_vec(),
            table: 0,
        };
        match this.verdict {
            // Too little to tell the tables apart: the first one stands.
            Verdict::Open => {}
            Verdict::None { .. } => reject(batch, FrameRejection::Foreign),
            Verdict::Fits { hypothesis, .. } if this.hypotheses[hypothesis].is_mirrored => {
                let mirrored = RecognizerRejection::Mirrored;
                reject(batch, FrameRejection::Recognizer(mirrored));
            }
            Verdict::Fits { hypothesis, .. } => this.table = this.hypotheses[hypothesis].table,
            Verdict::Tied { hypotheses, .. } => {
                let [a, b] = hypotheses.map(|h| this.hypotheses[h].table);
                match a == b {
                    // The pattern is its own mirror image: directly is what people do.
                    true => this.table = a,
                    false => reject(batch, FrameRejection::Foreign),
                }
            }
        }
        Ok(this)
    }

    /// The number of the table in use.
    #[cfg_attr(not(feature = "plot"), allow(dead_code))]
    pub fn table(&self) -> usize {
        self.table
    }

    fn table_name(&self, table: usize) -> String {
        let path = self.tables.get(table).map(PathBuf::as_path);
        path.unwrap_or(Path::new("the table")).display().to_string()
    }

    /// Why all poses are rejected, where they are.
    pub fn rejection(&self) -> Option<String> {
        match self.verdict {
            Verdict::None { best, .. } => {
                let best = &self.hypotheses[best];
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
            Verdict::Fits {
                hypothesis,
                ln_lead,
                ..
            } if self.hypotheses[hypothesis].is_mirrored => Some(format!(
                "the images are mirrored (odds {} to 1): --mirrored reads them",
                odds(ln_lead)
            )),
            Verdict::Tied { hypotheses, .. } => {
                let [a, b] = hypotheses.map(|h| self.hypotheses[h].table);
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
        match self.verdict {
            Verdict::Fits { ln_lead, .. } if is_choice && self.rejection().is_none() => {
                Some(format!(
                    "{} fits, odds {} to 1 against the next best",
                    self.table_name(self.table),
                    odds(ln_lead)
                ))
            }
            Verdict::Open if is_choice => Some(format!(
                "too few frames with enough dots to choose among the tables: {} is taken",
                self.table_name(self.table)
            )),
            _ => None,
        }
    }

    /// The evidence for all hypotheses.
    pub fn to_json(&self) -> Value {
        let name = match self.verdict {
            _ if self.hypotheses.is_empty() => return Value::Null,
            Verdict::Open => "open",
            Verdict::None { .. } => "none",
            Verdict::Tied { .. } => "tied",
            Verdict::Fits { hypothesis, .. } if self.hypotheses[hypothesis].is_mirrored => {
                "mirrored"
            }
            Verdict::Fits { .. } => "fits",
        };
        let ln_odds = match self.verdict {
            Verdict::Fits { ln_lead, .. } | Verdict::Tied { ln_lead, .. } => Some(ln_lead),
            _ => None,
        };
        let hypotheses = self.hypotheses.iter().map(|h| {
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
            "verdict": name,
            "table": self.table_name(self.table),
            "ln_odds": ln_odds.filter(|l| l.is_finite()),
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

fn reject(batch: &mut Batch<Picture>, why: FrameRejection) {
    for frame in &mut batch.frames {
        if frame.estimate.pose().is_some() {
            frame.estimate.outcome = Err(why);
            frame.estimate.assignment.fill(None);
        }
    }
}

/// A frame's score, and its orientation where it has one and a time.
type Scored = (FrameScore, Option<Measurement>);

/// What the frames say of a pattern.
fn hypothesis(
    estimator: &Estimator,
    table: usize,
    is_mirrored: bool,
    config: &BatchConfig,
    batch: &Batch<Picture>,
) -> Result<BallHypothesis> {
    let stride = batch.frames.len().div_ceil(MAX_FRAMES).max(1);
    let chosen: Vec<_> = batch.frames.iter().step_by(stride).collect();
    let scored: Result<Vec<Vec<Scored>>> = chosen
        .par_chunks(CHUNK)
        .map(|frames| {
            let mut scorer = Scorer::new(estimator)?;
            let one = |frame: &&BatchFrame<Picture>| {
                let mut estimate: FrameEstimate = frame.estimate.clone();
                let score = scorer.identify(&mut estimate);
                let measured =
                    frame
                        .time_s
                        .zip(estimate.pose())
                        .map(|(time_s, pose)| Measurement {
                            confidence: pose.confidence,
                            ..Measurement::new(time_s, pose.rotation)
                        });
                (score, measured)
            };
            Ok(frames.iter().map(one).collect())
        })
        .collect();
    let (frames, measured): (Vec<_>, Vec<_>) = scored?.into_iter().flatten().unzip();
    let measured: Vec<Measurement> = measured.into_iter().flatten().collect();
    let fit = RobustEstimator::new(config.sequence.spin).fit(&measured);
    Ok(BallHypothesis {
        table,
        is_mirrored,
        frames,
        has_common_motion: fit.is_ok_and(|f| 2 * f.inliers > measured.len()),
    })
}
