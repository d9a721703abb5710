//! Many images at once: the frames of files, folders and videos, estimated on all cores, and then
//! together as a sequence where all of them have a time.
//!
//! Guarantees: frames come in the order of the inputs; each is estimated independently, so that the
//! number of threads changes nothing. Not guaranteed: little memory; a few dozen images are held at
//! a time, and all estimates.

use std::path::PathBuf;

use rayon::prelude::*;

use super::{
    Estimator, FrameEstimate, SequenceConfig, SequenceSummary, estimate_spin, track_sequence,
};
use crate::error::Result;
use crate::spin::{Fit, SpinRejection};
use crate::vision::camera::BallCircle;
use crate::vision::detect::DotDetector;
use crate::vision::image::RgbImage;
use crate::vision::input::{self, FrameTimes, InputFrame};

/// Frames that are held and estimated at once.
const FRAMES_AT_ONCE: usize = 64;

/// Where the times of the frames come from.
#[derive(Debug, Clone, Default)]
pub enum FrameClock {
    /// From the names of the files, or the video.
    #[default]
    Inputs,
    /// The frames follow each other evenly, at so many a second.
    FramesPerSecond(f64),
    /// From a table.
    Table(FrameTimes),
}

/// What is estimated, and how.
#[derive(Debug, Clone, Default)]
pub struct BatchConfig {
    /// The ball's outline in all frames; by default it is found in each.
    pub circle: Option<BallCircle>,
    /// Where the times come from.
    pub clock: FrameClock,
    /// How the frames of a sequence inform each other.
    pub sequence: SequenceConfig,
    /// Whether frames stay independent of each other.
    pub independent: bool,
}

/// Sees every frame while its image is there; see [`estimate_inputs`].
pub trait BatchObserver: Sync {
    /// What is kept of an image.
    type Kept: Send;

    /// Chooses what is kept of an image. Called from several threads.
    ///
    /// # Errors
    /// Those of the observer; they end the batch.
    fn keep(&self, image: &RgbImage, estimate: &FrameEstimate) -> Result<Self::Kept>;

    /// Hears how many frames are estimated.
    fn progress(&self, _frames: usize) {}
}

/// Keeps nothing, says nothing.
impl BatchObserver for () {
    type Kept = ();

    fn keep(&self, _: &RgbImage, _: &FrameEstimate) -> Result<()> {
        Ok(())
    }
}

/// A frame of a batch.
#[derive(Debug, Clone)]
pub struct BatchFrame<K> {
    /// The file's stem, or the video's with the frame's number.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// Seconds, where a time is known.
    pub time_s: Option<f64>,
    /// What was estimated.
    pub estimate: FrameEstimate,
    /// What the observer kept.
    pub kept: K,
}

/// What became of the frames as a sequence.
#[derive(Debug, Clone)]
pub enum SequenceOutcome {
    /// Some frame has no time, or there is only one.
    NoTimes,
    /// The times do not increase from frame to frame.
    TimesNotIncreasing,
    /// The frames are a sequence.
    Estimated {
        /// What tracking changed.
        summary: SequenceSummary,
        /// The spin, or why there is none.
        spin: std::result::Result<Fit, SpinRejection>,
    },
}

/// All frames, and what became of them as a sequence.
#[derive(Debug, Clone)]
pub struct Batch<K> {
    /// In the order of the inputs.
    pub frames: Vec<BatchFrame<K>>,
    /// See [`SequenceOutcome`].
    pub sequence: SequenceOutcome,
}

impl<K> Batch<K> {
    /// Number of frames with an orientation.
    pub fn identified(&self) -> usize {
        let posed = self.frames.iter().filter(|f| f.estimate.pose().is_some());
        posed.count()
    }

    /// Lets the frames inform each other anew, after their estimates have changed.
    pub fn track<D: DotDetector>(&mut self, estimator: &Estimator<D>, config: &BatchConfig) {
        self.sequence = as_sequence(estimator, config, &mut self.frames);
    }
}

/// Estimates the frames of files, folders and videos.
///
/// # Errors
/// [`crate::Error::Read`] and [`crate::Error::Input`] of an input or of the table of times; those of
/// the observer.
pub fn estimate_inputs<D, O>(
    estimator: &Estimator<D>,
    inputs: &[PathBuf],
    config: &BatchConfig,
    observer: &O,
) -> Result<Batch<O::Kept>>
where
    D: DotDetector + Sync,
    O: BatchObserver,
{
    let mut frames = Vec::new();
    let mut waiting = Vec::with_capacity(FRAMES_AT_ONCE);
    for source in input::sources(inputs)? {
        let first = frames.len();
        let mut visit = |frame: InputFrame| {
            waiting.push(frame);
            if waiting.len() == FRAMES_AT_ONCE {
                estimate_waiting(estimator, config, observer, &mut waiting, &mut frames)?;
            }
            Ok(())
        };
        let times = input::read_frames(&source, &mut visit)?;
        estimate_waiting(estimator, config, observer, &mut waiting, &mut frames)?;
        for (frame, time) in frames[first..].iter_mut().zip(times) {
            frame.time_s = time;
        }
    }
    set_times(&config.clock, &mut frames)?;
    let sequence = as_sequence(estimator, config, &mut frames);
    Ok(Batch { frames, sequence })
}

/// Estimates the waiting frames on all cores.
fn estimate_waiting<D, O>(
    estimator: &Estimator<D>,
    config: &BatchConfig,
    observer: &O,
    waiting: &mut Vec<InputFrame>,
    frames: &mut Vec<BatchFrame<O::Kept>>,
) -> Result<()>
where
    D: DotDetector + Sync,
    O: BatchObserver,
{
    let circle = config.circle.as_ref();
    let done: Result<Vec<_>> = waiting
        .par_drain(..)
        .map_init(
            || estimator.workspace(),
            |workspace, frame| {
                let mut estimate = FrameEstimate::default();
                estimator.estimate_frame(&frame.image, circle, None, workspace, &mut estimate);
                let kept = observer.keep(&frame.image, &estimate)?;
                Ok(BatchFrame {
                    name: frame.name,
                    path: frame.path,
                    time_s: frame.time_s,
                    estimate,
                    kept,
                })
            },
        )
        .collect();
    frames.append(&mut done?);
    observer.progress(frames.len());
    Ok(())
}

fn set_times<K>(clock: &FrameClock, frames: &mut [BatchFrame<K>]) -> Result<()> {
    match clock {
        FrameClock::Inputs => {}
        FrameClock::FramesPerSecond(rate) => {
            for (k, frame) in frames.iter_mut().enumerate() {
                frame.time_s = Some(k as f64 / rate);
            }
        }
        FrameClock::Table(table) => {
            let paths: Vec<PathBuf> = frames.iter().map(|f| f.path.clone()).collect();
            for (frame, time) in frames.iter_mut().zip(table.of_frames(&paths)?) {
                frame.time_s = Some(time);
            }
        }
    }
    Ok(())
}

/// Lets the frames inform each other, and estimates their spin.
fn as_sequence<D: DotDetector, K>(
    estimator: &Estimator<D>,
    config: &BatchConfig,
    frames: &mut [BatchFrame<K>],
) -> SequenceOutcome {
    let times: Option<Vec<f64>> = frames.iter().map(|f| f.time_s).collect();
    let Some(times) = times.filter(|t| t.len() > 1) else {
        return SequenceOutcome::NoTimes;
    };
    if !times.windows(2).all(|w| w[0] < w[1]) {
        return SequenceOutcome::TimesNotIncreasing;
    }
    let mut estimates: Vec<FrameEstimate> = frames
        .iter_mut()
        .map(|f| std::mem::take(&mut f.estimate))
        .collect();
    let summary = if config.independent {
        SequenceSummary::default()
    } else {
        let mut workspace = estimator.workspace();
        track_sequence(
            estimator,
            &config.sequence,
            &times,
            &mut estimates,
            &mut workspace,
        )
    };
    let spin = estimate_spin(&config.sequence, &times, &estimates);
    for (frame, estimate) in frames.iter_mut().zip(estimates) {
        frame.estimate = estimate;
    }
    SequenceOutcome::Estimated { summary, spin }
}
