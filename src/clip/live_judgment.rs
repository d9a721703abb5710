//! The [judgment](super::judgment) on a stream: do its last frames show a ball of the table, and in a mirror?
//!
//! A stream has no end at which it could be judged as a whole. So its last [`WINDOW`] frames that say anything are weighed: the first
//! [`EACH`] of them one by one, then one in [`STRIDE`], so that a frame costs little more. The mirrored ball is
//! looked for in frames without a pose, as long as the poses of the last [`EACH`] leave a doubt.
//!
//! Guarantees: no more than [`WINDOW`] scores are kept, and before [`EACH`] frames have said something there is no verdict. A verdict lasts
//! as long as the window speaks for it: another ball, shown later, is judged by its own frames.

use std::sync::Arc;

use super::judgment::{Judgment, SURE};
use super::verdict::{BallHypothesis, FrameScore, Scorer, Verdict, decide, mirrored};
use crate::error::Result;
use crate::vision::estimator::Estimator;
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};

/// Frames that have a say.
const WINDOW: usize = 32;
/// So many are weighed one by one, before these there is no verdict, and the last so many say whether a mirror is looked for.
const EACH: usize = 16;
/// Of later ones one in so many.
const STRIDE: usize = 4;

/// What the last frames of a stream of one ball say together.
#[derive(Debug)]
pub(super) struct LiveJudgment {
    direct: Scorer<Arc<Estimator>>,
    /// Made when frames ask for it.
    mirrored: Option<Scorer<Arc<Estimator>>>,
    /// Directly, and in a mirror.
    judgment: Judgment,
    /// Frames that said anything.
    seen: usize,
}

impl LiveJudgment {
    /// For a ball's estimator.
    ///
    /// # Errors
    /// As [`Scorer::new`].
    pub fn new(estimator: Arc<Estimator>) -> Result<Self> {
        let unseen = |is_mirrored| BallHypothesis {
            frames: Vec::with_capacity(WINDOW),
            ..BallHypothesis::unseen(0, is_mirrored)
        };
        Ok(Self {
            direct: Scorer::new(estimator)?,
            mirrored: None,
            judgment: Judgment {
                hypotheses: vec![unseen(false), unseen(true)],
                ..Judgment::default()
            },
            seen: 0,
        })
    }

    /// Nothing was seen yet.
    pub fn reset(&mut self) {
        self.judgment.verdict = Verdict::Open;
        let hypotheses = self.judgment.hypotheses.iter_mut();
        hypotheses.for_each(|h| h.frames.clear());
        self.seen = 0;
    }

    /// The judgment on what was seen so far.
    pub fn judgment(&self) -> &Judgment {
        &self.judgment
    }

    /// Takes the next frame as the estimator has it; why it keeps no pose, where it does not.
    ///
    /// # Errors
    /// As [`Scorer::new`], where the mirrored ball is looked for the first time.
    pub fn push(&mut self, frame: &FrameEstimate) -> Result<Option<FrameRejection>> {
        let score = self.direct.score(frame);
        if score.says_anything() {
            self.seen += 1;
            if self.seen <= EACH || self.seen.is_multiple_of(STRIDE) {
                self.weigh(frame, score)?;
            }
        }
        Ok(self.judgment.rejection())
    }

    fn weigh(&mut self, frame: &FrameEstimate, score: FrameScore) -> Result<()> {
        let direct = &self.judgment.hypotheses[0];
        let is_clear = score.ln_evidence.is_some() || direct.ln_evidence_of_last(EACH) >= SURE;
        let in_a_mirror = match is_clear {
            true => FrameScore {
                ln_evidence: None,
                ..score
            },
            false => self.score_in_a_mirror(frame)?,
        };
        let hypotheses = self.judgment.hypotheses.iter_mut();
        for (hypothesis, score) in hypotheses.zip([score, in_a_mirror]) {
            if hypothesis.frames.len() == WINDOW {
                hypothesis.frames.remove(0);
            }
            hypothesis.frames.push(score);
        }
        if self.seen >= EACH {
            self.judgment.verdict = decide(&self.judgment.hypotheses);
        }
        Ok(())
    }

    fn score_in_a_mirror(&mut self, frame: &FrameEstimate) -> Result<FrameScore> {
        let scorer = match &mut self.mirrored {
            Some(scorer) => scorer,
            none => {
                let mirrored = mirrored(self.direct.estimator())?;
                none.insert(Scorer::new(Arc::new(mirrored))?)
            }
        };
        Ok(scorer.identify(&mut frame.clone()))
    }
}
