//! Recognition of a stream of frames, on all cores: frames of dots in, answers out.
//!
//! [`identify_frames`] runs any recognizer. [`identify_learning`] runs the robust one without knowing
//! the noise, the misses and the false dots: it learns them from the frames. Answers leave in the order of the frames, each
//! as soon as it and all answers before it are ready; see [`pipeline`](crate::pipeline) for the
//! guarantees.

use std::num::NonZero;
use std::sync::Arc;

use super::learn::{ConditionsPosterior, ConditionsPrior, FrameEvidence};
use super::observed::ObservedFrame;
use super::robust::{RobustConfig, RobustRecognizer};
use super::{Explanations, Identification, Recognizer, RecognizerRejection};
use crate::ball::Ball;
use crate::concurrency;
use crate::error::{Error, Result};
use crate::pipeline::{Sink, map_ordered};
use crate::view::ViewModel;

/// A frame and its outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameAnswer {
    /// The frame.
    pub frame: ObservedFrame,
    /// Its explanations, or why there are none.
    pub outcome: std::result::Result<Explanations, RecognizerRejection>,
}

impl FrameAnswer {
    /// Identifies a frame.
    fn new<R: Recognizer>(recognizer: &R, ws: &mut R::Workspace, frame: ObservedFrame) -> Self {
        Self {
            outcome: recognizer.explain(&frame.dots, None, ws).cloned(),
            frame,
        }
    }

    /// The best explanation, where there is one.
    pub fn identification(&self) -> Option<&Identification> {
        self.outcome.as_ref().ok().map(Explanations::best)
    }

    /// Other poses that explain the dots; none where there is no answer.
    pub fn rivals(&self) -> &[Identification] {
        self.outcome.as_ref().map_or(&[], Explanations::rivals)
    }
}

/// Identifies frames on `threads` threads and passes the answers on in order.
///
/// # Errors
/// The first error of `frames`, after the answers before it; or that of the sink.
pub fn identify_frames<R: Recognizer>(
    recognizer: &R,
    frames: impl Iterator<Item = Result<ObservedFrame>> + Send,
    threads: NonZero<usize>,
    sink: &mut impl Sink<FrameAnswer, Error = Error>,
) -> Result<()> {
    let answer = |ws: &mut R::Workspace, frame| FrameAnswer::new(recognizer, ws, frame);
    map_ordered(frames, threads, || recognizer.workspace(), answer, sink)
}

/// How noise, misses and false dots are learned from the frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearningConfig {
    /// What is known before.
    pub prior: ConditionsPrior,
    /// Number of frames that have a say, the first ones.
    pub max_frames: usize,
    /// When the answers may depend on later frames.
    pub order: LearningOrder,
}

/// Which frames an answer may depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LearningOrder {
    /// The first frames are read and learned from; then all are answered.
    InAdvance,
    /// Every frame is answered as it comes, by what the frames before it say: those before the
    /// last power of two.
    AsTheyCome,
}

impl Default for LearningConfig {
    /// 256 frames in advance, under the weak prior.
    fn default() -> Self {
        Self {
            prior: ConditionsPrior::default(),
            max_frames: 256,
            order: LearningOrder::InAdvance,
        }
    }
}

/// What was learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedView {
    /// The view expected.
    pub view: ViewModel,
    /// Number of frames that had a say.
    pub frames: usize,
}

/// Passes over the first frames; after the first one the conditions are nearly right.
const LEARNING_ROUNDS: usize = 3;

/// As [`identify_frames`], with a view model that is learned from the frames. `base` holds what is not
/// learned.
///
/// # Errors
/// As [`identify_frames`], and [`Error::Argument`] for a parameter outside its domain.
pub fn identify_learning(
    ball: &Ball,
    base: &RobustConfig,
    learning: &LearningConfig,
    frames: impl Iterator<Item = Result<ObservedFrame>> + Send,
    threads: NonZero<usize>,
    sink: &mut impl Sink<FrameAnswer, Error = Error>,
) -> Result<LearnedView> {
    let frames = frames.fuse();
    let learner = Learner {
        ball,
        base,
        prior: ConditionsPosterior::new(&learning.prior)?,
    };
    let learned = match learning.order {
        LearningOrder::InAdvance => {
            learner.in_advance(learning.max_frames, frames, threads, sink)?
        }
        LearningOrder::AsTheyCome => {
            learner.as_they_come(learning.max_frames, frames, threads, sink)?
        }
    };
    Ok(LearnedView {
        view: learned.posterior.expected(&base.view),
        frames: learned.posterior.frames(),
    })
}

/// What conditions are learned for.
struct Learner<'a> {
    ball: &'a Ball,
    base: &'a RobustConfig,
    /// Nothing is seen yet.
    prior: ConditionsPosterior,
}

/// What is learned of some frames.
struct Learned {
    evidence: Vec<FrameEvidence>,
    posterior: Arc<ConditionsPosterior>,
}

impl Learned {
    fn nothing(learner: &Learner<'_>) -> Self {
        Self {
            evidence: Vec::new(),
            posterior: Arc::new(learner.prior.clone()),
        }
    }
}

impl Learner<'_> {
    fn recognizer(&self, posterior: &Arc<ConditionsPosterior>) -> Result<RobustRecognizer> {
        RobustRecognizer::with_conditions(self.ball, self.base, posterior)
    }

    /// What the frames show: they are identified, show the conditions, and are identified again.
    fn learn(&self, frames: &[ObservedFrame]) -> Result<Learned> {
        let mut learned = Learned::nothing(self);
        for _ in 0..LEARNING_ROUNDS {
            let recognizer = self.recognizer(&learned.posterior)?;
            learned.evidence = evidence(&recognizer, &learned.posterior, frames);
            Arc::make_mut(&mut learned.posterior).learn(&learned.evidence);
        }
        Ok(learned)
    }

    /// Learns from the first frames, then answers all.
    fn in_advance(
        &self,
        max_frames: usize,
        mut frames: impl Iterator<Item = Result<ObservedFrame>> + Send,
        threads: NonZero<usize>,
        sink: &mut impl Sink<FrameAnswer, Error = Error>,
    ) -> Result<Learned> {
        let mut first: Vec<ObservedFrame> = Vec::new();
        let mut failed = None;
        while first.len() < max_frames && failed.is_none() {
            match frames.next() {
                Some(Ok(frame)) => first.push(frame),
                Some(Err(error)) => failed = Some(error),
                None => break,
            }
        }
        let learned = self.learn(&first)?;
        if !learned.posterior.is_settled() {
            // No frame confirms itself.
            for (k, frame) in first.drain(..).enumerate() {
                let recognizer = self.without(&learned, k)?;
                let mut workspace = recognizer.workspace();
                sink.take(FrameAnswer::new(&recognizer, &mut workspace, frame))?;
            }
        }
        let first = first.into_iter().map(Ok).chain(failed.map(Err));
        let recognizer = self.recognizer(&learned.posterior)?;
        identify_frames(&recognizer, first.chain(frames), threads, sink)?;
        Ok(learned)
    }

    /// Answers each frame by what those before it say, and learns from it.
    fn as_they_come(
        &self,
        max_frames: usize,
        mut frames: impl Iterator<Item = Result<ObservedFrame>> + Send,
        threads: NonZero<usize>,
        sink: &mut impl Sink<FrameAnswer, Error = Error>,
    ) -> Result<Learned> {
        let mut learned = Learned::nothing(self);
        let mut seen: Vec<ObservedFrame> = Vec::new();
        let mut share = 1;
        while seen.len() < max_frames {
            let before = seen.len();
            let recognizer = self.recognizer(&learned.posterior)?;
            let frames = frames.by_ref().take(share);
            let mut keeper = FrameKeeper {
                sink,
                seen: &mut seen,
            };
            identify_frames(&recognizer, frames, threads, &mut keeper)?;
            if seen.len() == before {
                break;
            }
            share = seen.len();
            learned = self.learn(&seen)?;
        }
        drop(seen);
        let recognizer = self.recognizer(&learned.posterior)?;
        identify_frames(&recognizer, frames, threads, sink)?;
        Ok(learned)
    }

    /// The recognizer that knows what all frames but one have learned.
    fn without(&self, learned: &Learned, frame: usize) -> Result<RobustRecognizer> {
        let mut others = learned.evidence.clone();
        others.remove(frame);
        let mut posterior = self.prior.clone();
        posterior.learn(&others);
        self.recognizer(&Arc::new(posterior))
    }
}

/// What each frame says of the conditions.
fn evidence(
    recognizer: &RobustRecognizer,
    posterior: &ConditionsPosterior,
    frames: &[ObservedFrame],
) -> Vec<FrameEvidence> {
    let chunks = frames.len().div_ceil(LEARNING_CHUNK);
    let learned = concurrency::map_range(0..chunks as u64, |chunk| {
        let from = chunk as usize * LEARNING_CHUNK;
        let to = (from + LEARNING_CHUNK).min(frames.len());
        let mut workspace = recognizer.workspace();
        let one = |frame: &ObservedFrame| {
            let mut evidence = FrameEvidence::default();
            // A rejected view may still have explanations.
            let _ = recognizer.explain(&frame.dots, None, &mut workspace);
            recognizer.conditions_evidence(posterior, &workspace, &mut evidence);
            evidence
        };
        frames[from..to].iter().map(one).collect::<Vec<_>>()
    });
    learned.into_iter().flatten().collect()
}

/// Frames that one task learns from; small enough to balance.
const LEARNING_CHUNK: usize = 16;

/// Passes answers on, and keeps their frames.
struct FrameKeeper<'a, S> {
    sink: &'a mut S,
    seen: &'a mut Vec<ObservedFrame>,
}

impl<S: Sink<FrameAnswer, Error = Error>> Sink<FrameAnswer> for FrameKeeper<'_, S> {
    type Error = Error;

    fn take(&mut self, answer: FrameAnswer) -> Result<()> {
        self.seen.push(answer.frame.clone());
        self.sink.take(answer)
    }

    fn idle(&mut self) -> Result<()> {
        self.sink.idle()
    }
}
