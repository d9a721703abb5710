//! Recognition of a stream of frames, on all cores: frames of dots in, answers out.
//!
//! [`identify_frames`] runs any recognizer. [`identify_with_rivals`] runs the robust one, which
//! also lists the other poses that explain a frame. Answers leave in the order of the frames, each
//! as soon as it and all answers before it are ready; see [`pipeline`](crate::pipeline) for the
//! guarantees.

use std::num::NonZero;

use super::observed::ObservedFrame;
use super::robust::RobustRecognizer;
use super::{Identification, Outcome, Recognizer};
use crate::error::{Error, Result};
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
    let list = |workspace: &_| {
        let mut found = Vec::new();
        let mut rival = Identification::default();
        for rank in 1..=rivals.max_rivals {
            if !recognizer.explanation(rank, workspace, &mut rival)
                || rival.pose_confidence < rivals.min_pose_confidence
            {
                break;
            }
            found.push(rival.clone());
        }
        found
    };
    identify(recognizer, list, frames, threads, sink)
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
