//! What comes of a clip: its frames, what they are as a sequence, and what all of them say together.

use std::path::PathBuf;

use super::ball_tracks::NumberedBalls;
use super::balls::BallEstimate;
use super::focal::FocalDoubt;
use super::judgment::Judgment;
use super::orientations::{NamedFrame, orientations};
use super::sequence::SequenceSummary;
use super::times::TimeSource;
use crate::error::Result;
use crate::geometry::CameraFrame;
use crate::image::RgbImage;
use crate::source::files::{SkippedFiles, Source};
use crate::spin::orientations::Orientations;
use crate::spin::{Fit, SpinRejection};
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};

/// Sees every frame while its image is there; see [`run`](super::run::run).
pub trait BatchObserver: Sync {
    /// What is kept of an image; the default where there is none, since the file cannot be read or
    /// [`BatchObserver::wants_images`] says no.
    type Kept: Send + Default;

    /// Chooses what is kept of an image, by the balls that were found in it. Called from several threads.
    ///
    /// # Errors
    /// Those of the observer; they end the clip.
    fn keep(&self, image: &RgbImage, balls: &[BallEstimate]) -> Result<Self::Kept>;

    /// Whether [`BatchObserver::keep`] is to be called: colors take memory.
    fn wants_images(&self) -> bool {
        true
    }

    /// Sees the frames that are estimated, one more each time; what is kept of them is not there yet.
    fn progress(&self, _frames: &[BatchFrame]) {}
}

/// Keeps nothing, says nothing.
impl BatchObserver for () {
    type Kept = ();

    fn keep(&self, _: &RgbImage, _: &[BallEstimate]) -> Result<()> {
        Ok(())
    }

    fn wants_images(&self) -> bool {
        false
    }
}

/// A frame of a clip.
#[derive(Debug, Clone)]
pub struct BatchFrame<K = ()> {
    /// The file's stem, or the video's with the frame's number.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// Seconds, where a time is known: of a rolling shutter that at which the ball is seen.
    pub time_s: Option<f64>,
    /// That of the picture's first row, where it is another one.
    pub first_row_s: Option<f64>,
    /// What was estimated: exactly one where one ball is looked for, else all that were found, from left to right.
    pub balls: Vec<BallEstimate>,
    /// Columns and rows of its picture; none where the file cannot be read.
    pub size: Option<[usize; 2]>,
    /// Why the file cannot be read, where it cannot: one line that names it.
    pub unreadable: Option<String>,
    /// What the observer kept.
    pub kept: K,
}

/// What is known of a frame without a ball.
static NOTHING: FrameEstimate = FrameEstimate::NOT_PROCESSED;

impl<K> BatchFrame<K> {
    /// The estimate of a frame's one ball.
    pub fn estimate(&self) -> &FrameEstimate {
        self.balls.first().map_or(&NOTHING, |ball| &ball.frame)
    }

    /// Takes that estimate; without a ball it is not processed.
    pub fn take_estimate(&mut self) -> FrameEstimate {
        let first = self.balls.first_mut().map(|ball| &mut ball.frame);
        first.map(std::mem::take).unwrap_or_default()
    }

    /// Sets it.
    pub fn set_estimate(&mut self, estimate: FrameEstimate) {
        match self.balls.first_mut() {
            Some(ball) => ball.frame = estimate,
            None => self.balls.push(BallEstimate::of(estimate, 0)),
        }
    }

    /// The frame with something else kept of it.
    pub(super) fn keeping<L>(self, kept: L) -> BatchFrame<L> {
        BatchFrame {
            name: self.name,
            path: self.path,
            time_s: self.time_s,
            first_row_s: self.first_row_s,
            balls: self.balls,
            size: self.size,
            unreadable: self.unreadable,
            kept,
        }
    }

    /// Takes back the poses of all its balls.
    pub(super) fn reject(&mut self, why: FrameRejection) {
        self.balls.iter_mut().for_each(|ball| ball.reject(why));
    }
}

/// What became of the frames as a sequence.
// One a clip: two hundred bytes are less trouble than a box.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone)]
pub enum SequenceOutcome {
    /// Some frame has no time, or there is only one.
    NoTimes,
    /// The times do not increase from frame to frame.
    TimesNotIncreasing,
    /// Frames of several balls are none: it was asked for, or each is an exposure with several flashes.
    Apart,
    /// The frames are a sequence of one ball.
    Estimated {
        /// What tracking changed.
        summary: SequenceSummary,
        /// The spin, or why there is none.
        spin: std::result::Result<Fit, SpinRejection>,
    },
    /// The frames are a sequence of several balls.
    Numbered(NumberedBalls),
}

/// All frames, and what became of them as a sequence.
#[derive(Debug, Clone)]
pub struct Batch<K = ()> {
    /// In the order of the inputs.
    pub frames: Vec<BatchFrame<K>>,
    /// See [`SequenceOutcome`].
    pub sequence: SequenceOutcome,
    /// What all frames together say; open where it was not asked for.
    pub judgment: Judgment,
    /// Where the ball's outlines contradict the camera's intrinsics by far.
    pub focal_doubt: Option<FocalDoubt>,
    /// Where the times came from.
    pub times: TimeSource,
    /// Files of the folders that are no images.
    pub skipped: Vec<SkippedFiles>,
    /// Videos that end early, with the reason.
    pub cut_short: Vec<(PathBuf, String)>,
    /// The files, and how many frames each gave.
    pub sources: Vec<(Source, usize)>,
}

impl<K> Batch<K> {
    /// The clip with something else kept of each frame.
    pub(super) fn keeping<L>(self, kept: Vec<L>) -> Batch<L> {
        let frames = self.frames.into_iter().zip(kept);
        Batch {
            frames: frames.map(|(frame, kept)| frame.keeping(kept)).collect(),
            sequence: self.sequence,
            judgment: self.judgment,
            focal_doubt: self.focal_doubt,
            times: self.times,
            skipped: self.skipped,
            cut_short: self.cut_short,
            sources: self.sources,
        }
    }

    /// Number of balls with an orientation; of one ball, of frames.
    pub fn identified(&self) -> usize {
        let balls = self.frames.iter().flat_map(|f| &f.balls);
        balls.filter(|b| b.frame.pose().is_some()).count()
    }

    /// Number of frames of one ball that had an orientation before they informed each other; without times all that have one.
    pub fn independent(&self) -> usize {
        match &self.sequence {
            SequenceOutcome::Estimated { summary, .. } => summary.alone,
            _ => self.identified(),
        }
    }

    /// Whether the frames of one ball have times and were estimated as a sequence.
    pub fn is_sequence(&self) -> bool {
        matches!(self.sequence, SequenceOutcome::Estimated { .. })
    }

    /// The orientations of one ball, in these axes.
    pub fn orientations(&self, axes: CameraFrame) -> Orientations {
        orientations(&self.named(), axes, self.is_sequence())
    }

    /// The frames with their names and times.
    pub fn named(&self) -> Vec<NamedFrame<'_>> {
        let named = self.frames.iter().map(|frame| NamedFrame {
            name: &frame.name,
            time_s: frame.time_s,
            estimate: frame.estimate(),
        });
        named.collect()
    }

    /// The frames' times, seconds, where they are a sequence.
    pub fn times_s(&self) -> Option<Vec<f64>> {
        match self.sequence {
            SequenceOutcome::Estimated { .. } | SequenceOutcome::Numbered(_) => {
                self.frames.iter().map(|f| f.time_s).collect()
            }
            _ => None,
        }
    }
}
