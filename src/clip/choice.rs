//! Which of several tables a ball carries, by the first frames of its clip that can say.
//!
//! A frame is searched for a short while by each table, until one finds a pose that its dots make evident; that ball's dots are then weighed
//! by all tables, directly and in a mirror, as in the [verdict](super::verdict). Frames are looked at [`CHUNK`] at a time, until one
//! hypothesis leads all others by [`SURE`]. Where frames say nothing, they are passed over in ever longer steps.
//!
//! Guarantees: neither the number of threads nor, where a hypothesis leads, the order of the tables changes the choice. It is not the answer: the
//! verdict on all frames judges it. Frames that were looked at are held, and not decoded twice, up to 64 MiB.

use super::judgment::TableCandidate;
use super::read::SourceReading;
use super::run::Pass;
use super::verdict::{BallHypothesis, Verdict, decide};
use crate::concurrency;
use crate::error::Result;
use crate::source::Frame;
use crate::vision::estimator::Estimator;
use crate::vision::estimator::search::is_evident;
use crate::vision::frame::estimate::{FrameEstimate, is_mirrored};
use std::borrow::Cow;

/// Frames that are looked at together.
const CHUNK: usize = 4;
/// Frames that are looked at, at most.
const MAX_LOOKED: usize = 64;
/// Frames that say nothing, one after the other, after which the steps between frames are twice as long.
const MUTE: usize = 8;
/// Lead over all others, ln of the odds, from which on no further frame is looked at.
const SURE: f64 = 10.0;

impl Pass<'_> {
    /// The table of a clip of one ball.
    pub(super) fn choose_table(&self, reading: &mut SourceReading<'_>) -> Result<usize> {
        let tables = self.work.tables();
        let candidates = TableCandidate::of_tables(tables)?;
        let mut hypotheses: Vec<BallHypothesis> = candidates.iter().map(|c| c.unseen()).collect();
        let (mut looked, mut mute, mut step) = (0, 0, 1);
        let mut verdict = Verdict::Open;
        while looked < MAX_LOOKED {
            let numbers = reading.ahead(CHUNK, step)?;
            let frames: Vec<&Frame> = numbers.iter().filter_map(|k| reading.held(*k)).collect();
            let seen = concurrency::map(&frames, |frame| self.look(tables, frame));
            let seen = seen.into_iter().collect::<Result<Vec<_>>>()?;
            for (candidate, hypothesis) in candidates.iter().zip(&mut hypotheses) {
                candidate.learn(hypothesis, &seen)?;
            }
            looked += seen.len();
            verdict = decide(&hypotheses);
            let is_sure = matches!(verdict, Verdict::Fits { ln_lead, .. } if ln_lead >= SURE);
            if is_sure || seen.len() < CHUNK {
                break;
            }
            let says = |k: usize| hypotheses.iter().any(|h| h.frames[k].weight() != 0.0);
            mute = match (looked - CHUNK..looked).any(says) {
                true => 0,
                false => mute + CHUNK,
            };
            if mute >= MUTE {
                (mute, step) = (0, 2 * step);
            }
        }
        let evidence = |h: &&BallHypothesis| h.ln_evidence();
        let first = &hypotheses[0];
        let best = hypotheses.iter().skip(1).fold(first, |best, next| {
            if evidence(&next) > evidence(&best) {
                next
            } else {
                best
            }
        });
        Ok(match verdict {
            Verdict::Fits { hypothesis, .. } => hypotheses[hypothesis].table,
            Verdict::Tied {
                hypotheses: both, ..
            } => hypotheses[both[0]].table,
            Verdict::None { best, .. } => hypotheses[best].table,
            Verdict::Open => best.table,
        })
    }

    /// What a short search by the tables finds in a frame.
    fn look(&self, tables: &[Estimator], frame: &Frame) -> Result<FrameEstimate> {
        let mut best = FrameEstimate::default();
        let Ok(picture) = &frame.picture else {
            return Ok(best);
        };
        let picture = match self.config.mirrored || self.config.bright_dots {
            true => Cow::Owned(self.prepared(picture.clone())?),
            false => Cow::Borrowed(picture),
        };
        let image = picture.view()?;
        let Ok(prior) = self.prior(&frame.path, &image)? else {
            return Ok(best);
        };
        let budget = self.config.budget.short();
        let mut found = FrameEstimate::default();
        for (table, estimator) in tables.iter().enumerate() {
            let mut ws = estimator.workspace();
            estimator.estimate(image, &prior, &budget, &mut ws, &mut found);
            let is_clear = is_evident(&found) || is_mirrored(&found);
            if table == 0 || is_clear || found.promise() > best.promise() {
                std::mem::swap(&mut best, &mut found);
            }
            if is_clear {
                break;
            }
        }
        Ok(best)
    }
}
