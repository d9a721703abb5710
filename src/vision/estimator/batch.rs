//! Many images at once: the frames of files, folders and videos, estimated on all cores, and then
//! together as a sequence where all of them have a time.
//!
//! Guarantees: frames come in the order of the inputs; each is estimated independently, so that the
//! number of threads changes nothing; a file that cannot be read is a rejected frame. Memory: two
//! pictures more than there are threads wait, 8 bits a color; of a large one only those parts are
//! converted that are looked at. All estimates are held.

use std::num::NonZero;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError, mpsc};

use super::shrunk::MAX_THOROUGH;
use super::{
    Budget, Estimator, EstimatorWorkspace, FrameEstimate, FrameImage, FrameRejection, OutlinePrior,
    Prior, SequenceConfig, SequenceSummary, estimate_spin, frames_in_doubt, track_sequence,
};
use crate::error::{Error, Result};
use crate::pipeline::{Sink, map_ordered_within};
use crate::spin::{Fit, SpinRejection};
use crate::vision::detect::DotDetector;
use crate::vision::frame_table::{FrameCircles, FrameTimes};
use crate::vision::image::RgbImage;
use crate::vision::input::{self, InputFrame, SkippedFiles, VideoClock};
use crate::vision::picture::{DEFAULT_MAX_PIXELS, Picture};
use crate::vision::roi::Roi;

/// Pictures that wait, beyond one a thread.
const WAITING: usize = 2;
/// Minimum time between frames, seconds: a million a second. Names that count frames are closer.
const MIN_STEP_S: f64 = 1e-6;

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
#[derive(Debug, Clone)]
pub struct BatchConfig {
    /// The ball's outline in all frames; by default it is found in each.
    pub outline: Option<OutlinePrior>,
    /// The outlines of single frames; it is found in those that have no row.
    pub circles: Option<FrameCircles>,
    /// The part of every frame in which the ball is looked for; by default all of it.
    pub roi: Option<Roi>,
    /// Where the times come from.
    pub clock: FrameClock,
    /// How the frames of a sequence inform each other.
    pub sequence: SequenceConfig,
    /// Whether frames stay independent of each other.
    pub independent: bool,
    /// Whether left and right are exchanged before anything else.
    pub mirrored: bool,
    /// Maximum number of pixels of a picture.
    pub max_pixels: u64,
}

impl Default for BatchConfig {
    /// Outlines found, times from the inputs, frames as they are, up to 64 million pixels each.
    fn default() -> Self {
        Self {
            outline: None,
            circles: None,
            roi: None,
            clock: FrameClock::default(),
            sequence: SequenceConfig::default(),
            independent: false,
            mirrored: false,
            max_pixels: DEFAULT_MAX_PIXELS,
        }
    }
}

/// Where the times of a batch came from.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case", tag = "source")]
pub enum TimeSource {
    /// No frame has a time.
    None,
    /// Some frames have a time by their names, others not.
    Partial {
        /// How many have one.
        timed: usize,
    },
    /// The names are numbers, but so near to each other that they count frames: they are no times.
    FrameNumbers {
        /// The smallest step of the names, taken as nanoseconds, in seconds.
        step_s: f64,
    },
    /// The names of the files, in nanoseconds.
    Names {
        /// Mean frames per second.
        fps: f64,
    },
    /// A rate that was given.
    Rate {
        /// Frames per second.
        fps: f64,
    },
    /// A table.
    Table,
    /// The time stamps of a video.
    Video(VideoClock),
}

/// Sees every frame while its image is there; see [`estimate_inputs`].
pub trait BatchObserver: Sync {
    /// What is kept of an image; the default where there is none, since the file cannot be read or
    /// [`BatchObserver::wants_images`] says no.
    type Kept: Send + Default;

    /// Chooses what is kept of an image. Called from several threads.
    ///
    /// # Errors
    /// Those of the observer; they end the batch.
    fn keep(&self, image: &RgbImage, estimate: &FrameEstimate) -> Result<Self::Kept>;

    /// Whether [`BatchObserver::keep`] is to be called: colors take memory.
    fn wants_images(&self) -> bool {
        true
    }

    /// Hears how many frames are estimated.
    fn progress(&self, _frames: usize) {}
}

/// Keeps nothing, says nothing.
impl BatchObserver for () {
    type Kept = ();

    fn keep(&self, _: &RgbImage, _: &FrameEstimate) -> Result<()> {
        Ok(())
    }

    fn wants_images(&self) -> bool {
        false
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
    /// Why the file cannot be read, where it cannot: one line that names it.
    pub unreadable: Option<String>,
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
    /// Where the times came from.
    pub times: TimeSource,
    /// Files of the folders that are no images.
    pub skipped: Vec<SkippedFiles>,
    /// Videos that end early, with the reason.
    pub cut_short: Vec<(PathBuf, String)>,
}

impl<K> Batch<K> {
    /// Number of frames with an orientation.
    pub fn identified(&self) -> usize {
        let posed = self.frames.iter().filter(|f| f.estimate.pose().is_some());
        posed.count()
    }

    /// The frames' times, seconds, where they are a sequence.
    pub fn times_s(&self) -> Option<Vec<f64>> {
        match self.sequence {
            SequenceOutcome::Estimated { .. } => self.frames.iter().map(|f| f.time_s).collect(),
            _ => None,
        }
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
    let listed = input::list_sources(inputs)?;
    let threads = NonZero::new(rayon::current_num_threads()).unwrap_or(NonZero::<usize>::MIN);
    let large = Mutex::new(());
    let job = FrameJob {
        estimator,
        config,
        observer,
        large: &large,
    };
    let mut frames: Vec<BatchFrame<O::Kept>> = Vec::new();
    let mut clocks = Vec::new();
    let mut cut_short = Vec::new();
    let mut first_error = None;
    // The reader decodes while the threads estimate; it waits where they do not keep up.
    let (sender, receiver) = mpsc::sync_channel::<Result<InputFrame>>(0);
    let sources = &listed.sources;
    let read = std::thread::scope(|scope| {
        let reader = scope.spawn(move || {
            let mut all = Vec::new();
            for source in sources {
                let mut count = 0;
                let read = input::read_frames(source, config.max_pixels, &mut |frame| {
                    count += 1;
                    // Nobody listens after an error.
                    let gone = |_| Error::Internal("the estimation has ended".into());
                    sender.send(Ok(frame)).map_err(gone)
                });
                match read {
                    Ok(times) => all.push((source, count, times)),
                    Err(error) => {
                        let _ = sender.send(Err(error));
                        return all;
                    }
                }
            }
            all
        });
        let mut sink = Collected {
            frames: &mut frames,
            first_error: &mut first_error,
            observer,
        };
        let limit = NonZero::new(threads.get() + WAITING).unwrap_or(threads);
        let outcome = map_ordered_within(
            limit,
            receiver.into_iter(),
            threads,
            || estimator.workspace(),
            |workspace, frame| job.run(frame, workspace),
            &mut sink,
        );
        let read = reader.join().unwrap_or_default();
        outcome.map(|()| read)
    })?;
    // A file that is no image is a rejected frame among others, and an error alone.
    let is_hopeless = frames.iter().all(|f| f.unreadable.is_some());
    if let Some(error) = first_error.filter(|_| is_hopeless) {
        return Err(error);
    }
    let mut first = 0;
    for (source, count, times) in &read {
        for (frame, time) in frames[first..].iter_mut().zip(&times.times_s) {
            frame.time_s = *time;
        }
        first += count;
        clocks.extend(times.clock);
        if let (input::Source::Video(path), Some(why)) = (source, &times.cut_short) {
            cut_short.push(((*path).clone(), why.clone()));
        }
    }
    let times = set_times(&config.clock, clocks.last().copied(), &mut frames)?;
    let mut sequence = as_sequence(estimator, config, &mut frames);
    let mut first = 0;
    let ranges = read.iter().map(|(source, count, _)| {
        first += count;
        (*source, first - count..first)
    });
    let ranges: Vec<_> = ranges.collect();
    if job.settle(&ranges, &sequence, &mut frames)? {
        sequence = as_sequence(estimator, config, &mut frames);
    }
    Ok(Batch {
        frames,
        sequence,
        times,
        skipped: listed.skipped,
        cut_short,
    })
}

/// What a thread needs to estimate a frame.
struct FrameJob<'a, D, O> {
    estimator: &'a Estimator<D>,
    config: &'a BatchConfig,
    observer: &'a O,
    /// Held by the one thread that works on the colors of a large picture.
    large: &'a Mutex<()>,
}

/// A frame and the error by which it is unreadable.
type Estimated<K> = Result<(BatchFrame<K>, Option<Error>)>;

impl<D: DotDetector, O: BatchObserver> FrameJob<'_, D, O> {
    fn run(
        &self,
        frame: InputFrame,
        workspace: &mut EstimatorWorkspace<D::Workspace>,
    ) -> Estimated<O::Kept> {
        let mut done = BatchFrame {
            name: frame.name,
            path: frame.path,
            time_s: frame.time_s,
            estimate: FrameEstimate::default(),
            unreadable: None,
            kept: O::Kept::default(),
        };
        let picture = match frame.picture {
            Ok(picture) => picture,
            Err(error) => {
                done.estimate.outcome = Err(FrameRejection::Unreadable);
                done.unreadable = Some(error.to_string());
                return Ok((done, Some(error)));
            }
        };
        let picture = match self.config.mirrored {
            true => picture.mirrored()?,
            false => picture,
        };
        let outline = match &self.config.circles {
            Some(circles) => circles.of_frame(&done.path)?,
            None => None,
        };
        let outline = outline.or(self.config.outline);
        done.kept = self.estimate(&picture, outline, workspace, &mut done.estimate)?;
        Ok((done, None))
    }

    fn estimate(
        &self,
        picture: &Picture,
        outline: Option<OutlinePrior>,
        workspace: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> Result<O::Kept> {
        let is_large = picture.width() * picture.height() > MAX_THOROUGH;
        if let Some(bytes) = picture.bytes().filter(|_| is_large) {
            self.answer(bytes.into(), outline, workspace, out)?;
            if !self.observer.wants_images() {
                return Ok(O::Kept::default());
            }
            let _alone = self.large.lock().unwrap_or_else(PoisonError::into_inner);
            return self.keep(&*picture.to_rgb()?, out);
        }
        let rgb = picture.to_rgb()?;
        self.answer((&*rgb).into(), outline, workspace, out)?;
        self.keep(&rgb, out)
    }

    fn answer(
        &self,
        image: FrameImage<'_>,
        outline: Option<OutlinePrior>,
        workspace: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> Result<()> {
        let region = match &self.config.roi {
            Some(roi) if outline.is_none() => Some(roi.within(image.width(), image.height())?),
            _ => None,
        };
        let prior = Prior {
            region,
            outline,
            ..Prior::default()
        };
        let budget = Budget::default();
        self.estimator
            .estimate(image, &prior, &budget, workspace, out);
        Ok(())
    }

    /// Looks again at the frames of a sequence that are in doubt, where their neighbors expect the ball; whether that
    /// changed any. Their files are read once more: pictures are not kept.
    fn settle(
        &self,
        sources: &[(&input::Source, Range<usize>)],
        sequence: &SequenceOutcome,
        frames: &mut [BatchFrame<O::Kept>],
    ) -> Result<bool> {
        let is_sequence = matches!(sequence, SequenceOutcome::Estimated { .. });
        if !is_sequence || self.config.independent {
            return Ok(false);
        }
        let times_s: Vec<f64> = frames.iter().filter_map(|f| f.time_s).collect();
        let mut estimates: Vec<FrameEstimate> = frames
            .iter_mut()
            .map(|f| std::mem::take(&mut f.estimate))
            .collect();
        let doubts = frames_in_doubt(&self.config.sequence, &times_s, &estimates);
        for (frame, estimate) in frames.iter_mut().zip(&mut estimates) {
            frame.estimate = std::mem::take(estimate);
        }
        let mut workspace = self.estimator.workspace();
        let mut is_changed = false;
        for (source, range) in sources {
            let mut doubts = doubts
                .iter()
                .filter(|d| range.contains(&d.frame))
                .peekable();
            if doubts.peek().is_none() {
                continue;
            }
            let mut number = range.start;
            let read = input::read_frames(source, self.config.max_pixels, &mut |read| {
                let doubt = doubts.next_if(|d| d.frame == number);
                number += 1;
                let (Some(doubt), Ok(picture)) = (doubt, read.picture) else {
                    return Ok(());
                };
                let picture = match self.config.mirrored {
                    true => picture.mirrored()?,
                    false => picture,
                };
                let rgb = picture.to_rgb()?;
                let frame = &mut frames[doubt.frame];
                let (ws, estimate) = (&mut workspace, &mut frame.estimate);
                let image = &*rgb;
                if self
                    .estimator
                    .estimate_again(image, &doubt.expected, ws, estimate)
                {
                    is_changed = true;
                    frame.kept = self.keep(&rgb, &frame.estimate)?;
                }
                Ok(())
            });
            read?;
        }
        Ok(is_changed)
    }

    fn keep(&self, image: &RgbImage, estimate: &FrameEstimate) -> Result<O::Kept> {
        match self.observer.wants_images() {
            true => self.observer.keep(image, estimate),
            false => Ok(O::Kept::default()),
        }
    }
}

/// Collects the frames in order.
struct Collected<'a, O: BatchObserver> {
    frames: &'a mut Vec<BatchFrame<O::Kept>>,
    first_error: &'a mut Option<Error>,
    observer: &'a O,
}

impl<O: BatchObserver> Sink<Estimated<O::Kept>> for Collected<'_, O> {
    type Error = Error;

    fn take(&mut self, estimated: Estimated<O::Kept>) -> Result<()> {
        let (frame, error) = estimated?;
        self.frames.push(frame);
        if self.first_error.is_none() {
            *self.first_error = error;
        }
        self.observer.progress(self.frames.len());
        Ok(())
    }
}

fn set_times<K>(
    clock: &FrameClock,
    video: Option<VideoClock>,
    frames: &mut [BatchFrame<K>],
) -> Result<TimeSource> {
    match clock {
        FrameClock::Inputs => Ok(input_times(video, frames)),
        FrameClock::FramesPerSecond(rate) => {
            for (k, frame) in frames.iter_mut().enumerate() {
                frame.time_s = Some(k as f64 / rate);
            }
            Ok(TimeSource::Rate { fps: *rate })
        }
        FrameClock::Table(table) => {
            let paths: Vec<PathBuf> = frames.iter().map(|f| f.path.clone()).collect();
            for (frame, time) in frames.iter_mut().zip(table.of_frames(&paths)?) {
                frame.time_s = Some(time);
            }
            Ok(TimeSource::Table)
        }
    }
}

/// What the inputs say of the times; names that count frames are no times.
fn input_times<K>(video: Option<VideoClock>, frames: &mut [BatchFrame<K>]) -> TimeSource {
    if let Some(clock) = video {
        return TimeSource::Video(clock);
    }
    let times: Vec<f64> = frames.iter().filter_map(|f| f.time_s).collect();
    let [first, .., last] = times[..] else {
        return match times.len() == frames.len() {
            _ if times.is_empty() => TimeSource::None,
            true => TimeSource::Names { fps: 0.0 },
            false => TimeSource::Partial { timed: 1 },
        };
    };
    if times.len() < frames.len() {
        return TimeSource::Partial { timed: times.len() };
    }
    let steps = times.windows(2).map(|w| w[1] - w[0]);
    let step_s = steps.fold(f64::INFINITY, f64::min);
    if step_s > 0.0 && step_s < MIN_STEP_S {
        frames.iter_mut().for_each(|f| f.time_s = None);
        return TimeSource::FrameNumbers { step_s };
    }
    TimeSource::Names {
        fps: (times.len() - 1) as f64 / (last - first),
    }
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
