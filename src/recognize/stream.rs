//! Recognition of a stream of frames, on all cores: frames of dots in, answers out.
//!
//! [`identify_frames`] runs any recognizer. [`identify_with_rivals`] runs the robust one, which
//! also lists the other poses that explain a frame. [`identify_learning`] runs it without knowing
//! the noise, the misses and the false dots: the frames tell. Answers leave in the order of the frames, each
//! as soon as it and all answers before it are ready; see [`pipeline`](crate::pipeline) for the
//! guarantees.

use std::num::NonZero;
use std::sync::Arc;

use super::observed::ObservedFrame;
use super::robust::{
    Conditions, ConditionsPosterior, ConditionsPrior, FrameEvidence, RobustConfig,
    RobustRecognizer, RobustWorkspace,
};
use super::{Identification, Outcome, Recognizer};
use crate::concurrency;
use crate::error::{Error, Result};
use crate::pattern::Pattern;
use crate::pipeline::{Sink, map_ordered};

/// A frame and its outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameAnswer {
    /// The frame.
    pub frame: ObservedFrame,
    /// The outcome.
    pub outcome: Outcome,
    /// Other poses that explain the dots, the most probable first; empty where there is no answer.
    pub rivals: Vec<Identification>,
}

impl FrameAnswer {
    /// The identification, where there is one.
    pub fn identification(&self) -> Option<&Identification> {
        match &self.outcome {
            Outcome::Identified(found) => Some(found),
            Outcome::Unidentified(_) => None,
        }
    }
}

/// Which rivals are listed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RivalConfig {
    /// Maximum number of rivals.
    pub max_rivals: usize,
    /// Minimum probability of a rival's pose.
    pub min_pose_confidence: f64,
}

impl Default for RivalConfig {
    /// 60 rivals: as many rotations as the icosahedron has. Poses less probable than 0.001 are of
    /// no use.
    fn default() -> Self {
        Self {
            max_rivals: 60,
            min_pose_confidence: 0.001,
        }
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
    identify(recognizer, |_| Vec::new(), frames, threads, sink)
}

/// As [`identify_frames`], with the rivals of every answer.
///
/// # Errors
/// As [`identify_frames`].
pub fn identify_with_rivals(
    recognizer: &RobustRecognizer,
    rivals: RivalConfig,
    frames: impl Iterator<Item = Result<ObservedFrame>> + Send,
    threads: NonZero<usize>,
    sink: &mut impl Sink<FrameAnswer, Error = Error>,
) -> Result<()> {
    let list = |workspace: &_| list_rivals(recognizer, rivals, workspace);
    identify(recognizer, list, frames, threads, sink)
}

/// The other poses that explain the last view of `workspace`, the most probable first.
fn list_rivals(
    recognizer: &RobustRecognizer,
    config: RivalConfig,
    workspace: &RobustWorkspace,
) -> Vec<Identification> {
    let mut found = Vec::new();
    let mut rival = Identification::default();
    for rank in 1..=config.max_rivals {
        if !recognizer.explanation(rank, workspace, &mut rival)
            || rival.pose_confidence < config.min_pose_confidence
        {
            break;
        }
        found.push(rival.clone());
    }
    found
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
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct LearnedConditions {
    /// The conditions expected.
    #[serde(flatten)]
    pub conditions: Conditions,
    /// Number of frames that had a say.
    pub frames: usize,
}

/// Passes over the first frames; after the first one the conditions are nearly right.
const LEARNING_ROUNDS: usize = 3;

/// As [`identify_with_rivals`], under conditions that the frames themselves tell. `base` holds what
/// [`Conditions`] does not cover.
///
/// # Errors
/// As [`identify_frames`], and [`Error::Argument`] for a parameter outside its domain.
pub fn identify_learning(
    pattern: &Pattern,
    base: &RobustConfig,
    learning: &LearningConfig,
    rivals: RivalConfig,
    frames: impl Iterator<Item = Result<ObservedFrame>> + Send,
    threads: NonZero<usize>,
    sink: &mut impl Sink<FrameAnswer, Error = Error>,
) -> Result<LearnedConditions> {
    let mut frames = frames.fuse();
    let learner = Learner {
        pattern,
        base,
        prior: ConditionsPosterior::new(&learning.prior)?,
    };
    let mut learned = Learned::nothing(&learner);
    match learning.order {
        LearningOrder::InAdvance => {
            let mut first: Vec<ObservedFrame> = Vec::new();
            let mut failed = None;
            while first.len() < learning.max_frames && failed.is_none() {
                match frames.next() {
                    Some(Ok(frame)) => first.push(frame),
                    Some(Err(error)) => failed = Some(error),
                    None => break,
                }
            }
            learned = learner.learn(&first)?;
            if !learned.posterior.is_settled() {
                // No frame confirms itself.
                for (k, frame) in first.drain(..).enumerate() {
                    let recognizer = learner.without(&learned, k)?;
                    let mut workspace = recognizer.workspace();
                    sink.take(answer(&recognizer, rivals, &mut workspace, frame))?;
                }
            }
            let first = first.into_iter().map(Ok).chain(failed.map(Err));
            let recognizer = learner.recognizer(&learned.posterior)?;
            identify_with_rivals(&recognizer, rivals, first.chain(frames), threads, sink)?;
        }
        LearningOrder::AsTheyCome => {
            let mut seen: Vec<ObservedFrame> = Vec::new();
            let mut share = 1;
            while seen.len() < learning.max_frames {
                let before = seen.len();
                let recognizer = learner.recognizer(&learned.posterior)?;
                let frames = frames.by_ref().take(share);
                let mut keeper = Keeper {
                    sink,
                    seen: &mut seen,
                };
                let work = |workspace: &mut RobustWorkspace, frame: ObservedFrame| {
                    answer(&recognizer, rivals, workspace, frame)
                };
                map_ordered(
                    frames,
                    threads,
                    || recognizer.workspace(),
                    work,
                    &mut keeper,
                )?;
                if seen.len() == before {
                    break;
                }
                share = seen.len();
                learned = learner.learn(&seen)?;
            }
            drop(seen);
            let recognizer = learner.recognizer(&learned.posterior)?;
            identify_with_rivals(&recognizer, rivals, frames, threads, sink)?;
        }
    }
    Ok(LearnedConditions {
        conditions: learned.posterior.expected(),
        frames: learned.posterior.frames(),
    })
}

/// What conditions are learned for.
struct Learner<'a> {
    pattern: &'a Pattern,
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
        RobustRecognizer::with_conditions(self.pattern, self.base, posterior)
    }

    /// What the frames tell: they are identified, tell the conditions, and are identified again.
    fn learn(&self, frames: &[ObservedFrame]) -> Result<Learned> {
        let mut learned = Learned::nothing(self);
        for _ in 0..LEARNING_ROUNDS {
            let recognizer = self.recognizer(&learned.posterior)?;
            learned.evidence = evidence(&recognizer, &learned.posterior, frames);
            Arc::make_mut(&mut learned.posterior).learn(&learned.evidence);
        }
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
        let mut found = Identification::default();
        let one = |frame: &ObservedFrame| {
            let mut evidence = FrameEvidence::default();
            // A rejected view may still have explanations.
            let _ = recognizer.identify_into(&frame.dots, &mut workspace, &mut found);
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
struct Keeper<'a, S> {
    sink: &'a mut S,
    seen: &'a mut Vec<ObservedFrame>,
}

impl<S: Sink<FrameAnswer, Error = Error>> Sink<FrameAnswer> for Keeper<'_, S> {
    type Error = Error;

    fn take(&mut self, answer: FrameAnswer) -> Result<()> {
        self.seen.push(answer.frame.clone());
        self.sink.take(answer)
    }

    fn idle(&mut self) -> Result<()> {
        self.sink.idle()
    }
}

/// A frame's answer with its rivals.
fn answer(
    recognizer: &RobustRecognizer,
    rivals: RivalConfig,
    workspace: &mut RobustWorkspace,
    frame: ObservedFrame,
) -> FrameAnswer {
    let outcome = recognizer.identify(&frame.dots, workspace);
    let rivals = match &outcome {
        Outcome::Identified(_) => list_rivals(recognizer, rivals, workspace),
        Outcome::Unidentified(_) => Vec::new(),
    };
    FrameAnswer {
        frame,
        outcome,
        rivals,
    }
}

fn identify<R: Recognizer>(
    recognizer: &R,
    rivals: impl Fn(&R::Workspace) -> Vec<Identification> + Sync,
    frames: impl Iterator<Item = Result<ObservedFrame>> + Send,
    threads: NonZero<usize>,
    sink: &mut impl Sink<FrameAnswer, Error = Error>,
) -> Result<()> {
    let answer = |workspace: &mut R::Workspace, frame: ObservedFrame| {
        let outcome = recognizer.identify(&frame.dots, workspace);
        FrameAnswer {
            rivals: match &outcome {
                Outcome::Identified(_) => rivals(workspace),
                Outcome::Unidentified(_) => Vec::new(),
            },
            outcome,
            frame,
        }
    };
    map_ordered(frames, threads, || recognizer.workspace(), answer, sink)
}
