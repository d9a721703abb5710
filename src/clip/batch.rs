//! Many images at once: the frames of files, folders and videos, estimated on all cores, and then again as a sequence
//! where all of them have a time.
//!
//! Guarantees: frames come in the order of the inputs; each is estimated independently, so that the
//! number of threads changes nothing; a file that cannot be read is a rejected frame. Memory: two
//! pictures more than there are threads wait, 8 bits a color; of a large one only those parts are
//! converted that are looked at. All estimates are held; the files of frames in doubt are read once more.

use std::num::NonZero;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use super::frame_table::{FrameCircles, FrameTimes};
use super::outlines;
use super::rolling::seen_times;
use super::sequence::{SequenceConfig, SequenceSummary, estimate_spin, second_pass};
use crate::concurrency::StopFlag;
use crate::error::{Error, Result, require};
use crate::image::{DEFAULT_MAX_PIXELS, ImageView, Picture, RgbImage, Roi};
use crate::pipeline::{Sink, map_ordered_within};
use crate::source::files::{self, SkippedFiles, Source};
use crate::source::video::VideoClock;
use crate::source::{Frame, FrameSource, SourceEnd};
use crate::spin::robust::TimeOrigin;
use crate::spin::{Fit, SpinRejection};
use crate::vision::estimator::propose::MAX_THOROUGH;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};
use crate::vision::frame::prior::{Budget, OutlinePrior, Prior};
use crate::vision::outline::find::{OutlineFinder, OutlineSearch};

/// Pictures that wait, beyond one a thread.
const WAITING: usize = 2;

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
    /// From a list, in the frames' order, seconds, with the file that has it.
    Ordered(PathBuf, Vec<f64>),
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
    /// What may be spent on a frame in the first pass.
    pub budget: Budget,
    /// Rolling shutter: time from the exposure of a picture's first row to that of its last, seconds; 0 for a global shutter. A frame's
    /// time is then that at which the ball is seen.
    pub readout_s: f64,
    /// Whether left and right are exchanged before anything else.
    pub mirrored: bool,
    /// Maximum number of pixels of a picture.
    pub max_pixels: u64,
}

impl BatchConfig {
    /// Time from row to row of the pictures, seconds; 0 for a global shutter.
    pub fn row_s<K>(&self, frames: &[BatchFrame<K>]) -> f64 {
        let rows = frames
            .iter()
            .filter_map(|f| f.size)
            .map(|[_, rows]| rows)
            .max();
        self.readout_s / rows.map_or(1, |rows| rows.max(2) - 1) as f64
    }

    /// Rejects a readout that is longer than the frames are apart.
    fn check_readout(&self, times_s: &[f64]) -> Result<()> {
        if let [first, .., last] = times_s {
            let apart_s = (last - first) / (times_s.len() - 1) as f64;
            let expected = format!("at most {apart_s:.6}, the mean time between two frames");
            require(
                self.readout_s <= apart_s,
                "readout_s",
                &expected,
                self.readout_s,
            )?;
        }
        Ok(())
    }
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
            budget: Budget::default(),
            readout_s: 0.0,
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
    /// The names are numbers, but so near to each other that they count frames or a longer unit: they
    /// are no times.
    FrameNumbers {
        /// The median step of the names, taken as nanoseconds, in seconds.
        step_s: f64,
    },
    /// The names are one and the same number: they are no times.
    SameNumber,
    /// The names of the files, in nanoseconds.
    Names {
        /// Mean frames per second; none of a single frame.
        fps: Option<f64>,
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

impl TimeSource {
    /// What the clock of a spin makes of it.
    pub fn origin(&self) -> TimeOrigin {
        match self {
            Self::Video(_) => TimeOrigin::Video,
            _ => TimeOrigin::Stated,
        }
    }

    /// Why the numbers in the frames' names are no times, where they are none.
    pub fn problem(&self) -> Option<&'static str> {
        match self {
            Self::FrameNumbers { .. } => {
                Some("the names are frame numbers, not times in nanoseconds")
            }
            Self::SameNumber => Some("the names are one and the same number, and no times"),
            _ => None,
        }
    }
}

/// Sees every frame while its image is there; see [`estimate_inputs`]. `E` is what is estimated of a frame.
pub trait BatchObserver<E: ?Sized = FrameEstimate>: Sync {
    /// What is kept of an image; the default where there is none, since the file cannot be read or
    /// [`BatchObserver::wants_images`] says no.
    type Kept: Send + Default;

    /// Chooses what is kept of an image. Called from several threads.
    ///
    /// # Errors
    /// Those of the observer; they end the batch.
    fn keep(&self, image: &RgbImage, estimate: &E) -> Result<Self::Kept>;

    /// Whether [`BatchObserver::keep`] is to be called: colors take memory.
    fn wants_images(&self) -> bool {
        true
    }

    /// Hears how many frames are estimated.
    fn progress(&self, _frames: usize) {}
}

/// Keeps nothing, says nothing.
impl<E: ?Sized> BatchObserver<E> for () {
    type Kept = ();

    fn keep(&self, _: &RgbImage, _: &E) -> Result<()> {
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
    /// Seconds, where a time is known: of a rolling shutter that at which the ball is seen.
    pub time_s: Option<f64>,
    /// That of the picture's first row, where it is another one.
    pub first_row_s: Option<f64>,
    /// What was estimated.
    pub estimate: FrameEstimate,
    /// Columns and rows of its picture; none where the file cannot be read.
    pub size: Option<[usize; 2]>,
    /// Why the file cannot be read, where it cannot: one line that names it.
    pub unreadable: Option<String>,
    /// What the observer kept.
    pub kept: K,
}

/// What became of the frames as a sequence.
// One a batch: two hundred bytes are less trouble than a box.
#[allow(clippy::large_enum_variant)]
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
    /// The files, and how many frames each gave.
    pub sources: Vec<(Source, usize)>,
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

    /// The second pass and the spin anew, after the estimates have changed.
    ///
    /// # Errors
    /// [`crate::Error::Read`] where a file can no longer be read; those of the observer.
    pub fn estimate_again<O>(
        &mut self,
        estimator: &Estimator,
        config: &BatchConfig,
        observer: &O,
    ) -> Result<()>
    where
        O: BatchObserver<Kept = K>,
        K: Send,
    {
        let job = FrameJob {
            work: Work::Poses(estimator),
            config,
            observer,
            large: &Mutex::new(()),
        };
        self.sequence = job.as_sequence(&self.sources, &mut self.frames)?;
        Ok(())
    }
}

/// What is found in each frame of a clip.
#[derive(Debug, Clone, Copy)]
pub enum Work<'a> {
    /// The ball's pose, by its dots.
    Poses(&'a Estimator),
    /// Its outline, where the dots are not known.
    Outlines(&'a OutlineFinder),
}

impl<'a> From<&'a Estimator> for Work<'a> {
    fn from(estimator: &'a Estimator) -> Self {
        Self::Poses(estimator)
    }
}

impl<'a> From<&'a OutlineFinder> for Work<'a> {
    fn from(finder: &'a OutlineFinder) -> Self {
        Self::Outlines(finder)
    }
}

/// Working memory of a [`Work`], one a thread.
// One a thread: a box is not worth its trouble.
#[allow(clippy::large_enum_variant)]
enum WorkMemory {
    Poses(EstimatorWorkspace),
    Outlines(OutlineSearch),
}

impl Work<'_> {
    fn memory(&self) -> WorkMemory {
        match self {
            Self::Poses(estimator) => WorkMemory::Poses(estimator.workspace()),
            Self::Outlines(finder) => WorkMemory::Outlines(finder.workspace()),
        }
    }

    /// What a frame shows by itself. The memory is that of this work.
    fn alone(
        &self,
        image: ImageView<'_>,
        prior: &Prior,
        budget: &Budget,
        memory: &mut WorkMemory,
        out: &mut FrameEstimate,
    ) {
        match (self, memory) {
            (Self::Poses(estimator), WorkMemory::Poses(ws)) => {
                estimator.estimate(image, prior, budget, ws, out);
            }
            (Self::Outlines(finder), WorkMemory::Outlines(ws)) => {
                finder.find(image, prior, ws, out);
            }
            _ => {}
        }
    }
}

/// What is done with a picture of the clip that is read again, by its number; `None` where that changes nothing.
type Again<'a> = dyn Fn(usize, ImageView<'_>, &mut WorkMemory) -> Option<FrameEstimate> + Sync + 'a;

/// Estimates the frames of files, folders and videos.
///
/// # Errors
/// [`crate::Error::Read`] and [`crate::Error::Input`] of an input or of the table of times; those of
/// the observer.
pub fn estimate_inputs<'a, O>(
    work: impl Into<Work<'a>>,
    inputs: &[PathBuf],
    config: &BatchConfig,
    observer: &O,
) -> Result<Batch<O::Kept>>
where
    O: BatchObserver,
{
    let listed = files::list_sources(inputs)?;
    let job = FrameJob {
        work: work.into(),
        config,
        observer,
        large: &Mutex::new(()),
    };
    let sources: Vec<&Source> = listed.sources.iter().collect();
    let mut collected = Collected {
        frames: Vec::new(),
        first_error: None,
        observer,
    };
    let work = |_, frame, memory: &mut WorkMemory| job.run(frame, memory);
    let read = job.read_all(&sources, work, &mut collected)?;
    let Collected {
        mut frames,
        first_error,
        ..
    } = collected;
    // A file that is no image is a rejected frame among others, and an error alone.
    let is_hopeless = frames.iter().all(|f| f.unreadable.is_some());
    if let Some(error) = first_error.filter(|_| is_hopeless) {
        return Err(error);
    }
    let (mut clocks, mut cut_short) = (Vec::new(), Vec::new());
    let mut first = 0;
    for (source, (count, end)) in sources.iter().zip(&read) {
        let scale = end.clock.map_or(1.0, |clock| clock.time_scale());
        for time in frames[first..][..*count]
            .iter_mut()
            .flat_map(|f| &mut f.time_s)
        {
            *time *= scale;
        }
        first += count;
        clocks.extend(end.clock);
        if let (Source::Video(path), Some(why)) = (source, &end.cut_short) {
            cut_short.push((path.clone(), why.clone()));
        }
    }
    let times = set_times(&config.clock, clocks.last().copied(), &mut frames)?;
    let counts = read.into_iter().map(|(count, _)| count);
    let sources: Vec<(Source, usize)> = listed.sources.into_iter().zip(counts).collect();
    if let (Work::Outlines(finder), false) = (job.work, config.independent) {
        job.settle_outlines(finder, &sources, &mut frames)?;
    }
    Ok(Batch {
        sequence: job.as_sequence(&sources, &mut frames)?,
        frames,
        times,
        skipped: listed.skipped,
        cut_short,
        sources,
    })
}

/// What a thread needs to estimate a frame.
struct FrameJob<'a, O> {
    work: Work<'a>,
    config: &'a BatchConfig,
    observer: &'a O,
    /// Held by the one thread that works on the colors of a large picture.
    large: &'a Mutex<()>,
}

/// A frame and the error by which it is unreadable.
type Estimated<K> = Result<(BatchFrame<K>, Option<Error>)>;

impl<O: BatchObserver> FrameJob<'_, O> {
    fn read_all<T: Send>(
        &self,
        sources: &[&Source],
        work: impl Fn(usize, Frame, &mut WorkMemory) -> Result<T> + Sync,
        sink: &mut impl Sink<Result<T>, Error = Error>,
    ) -> Result<Vec<(usize, SourceEnd)>> {
        let new_workspace = || self.work.memory();
        let reading = (self.config.max_pixels, self.config.budget.stop);
        read_all(sources, reading, new_workspace, work, sink)
    }

    fn run(&self, frame: Frame, memory: &mut WorkMemory) -> Estimated<O::Kept> {
        let mut done = BatchFrame {
            name: frame.name,
            path: frame.path,
            time_s: frame.time_s,
            first_row_s: None,
            estimate: FrameEstimate::default(),
            size: None,
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
        let picture = self.upright(picture)?;
        let image = picture.view()?;
        done.size = Some([image.width(), image.height()]);
        let outline = match &self.config.circles {
            Some(circles) => circles.of_frame(&done.path)?,
            None => None,
        };
        let outline = outline.or(self.config.outline);
        // A part that one picture lacks, others may have.
        let region = match &self.config.roi {
            Some(roi) if outline.is_none() => roi.within(image.width(), image.height()).map(Some),
            _ => Ok(None),
        };
        let region = match region {
            Ok(region) => region,
            Err(error) => {
                done.estimate.outcome = Err(FrameRejection::Unreadable);
                done.unreadable = Some(format!("{}: {error}", done.path.display()));
                return Ok((done, Some(error)));
            }
        };
        let prior = Prior {
            region,
            outline,
            ..Prior::default()
        };
        let estimate = &mut done.estimate;
        self.work
            .alone(image, &prior, &self.config.budget, memory, estimate);
        done.kept = self.keep(&picture, estimate)?;
        Ok((done, None))
    }

    /// The second pass over frames that were each estimated alone, and their spin.
    fn as_sequence(
        &self,
        sources: &[(Source, usize)],
        frames: &mut [BatchFrame<O::Kept>],
    ) -> Result<SequenceOutcome> {
        let times = frames.iter().map(|f| f.first_row_s.or(f.time_s));
        let times: Option<Vec<f64>> = times.collect();
        let Some(times) = times.filter(|t| t.len() > 1) else {
            return Ok(SequenceOutcome::NoTimes);
        };
        if !times.windows(2).all(|w| w[0] < w[1]) {
            return Ok(SequenceOutcome::TimesNotIncreasing);
        }
        let estimates = frames.iter_mut().map(|f| std::mem::take(&mut f.estimate));
        let mut estimates: Vec<FrameEstimate> = estimates.collect();
        self.config.check_readout(&times)?;
        let config = &SequenceConfig {
            row_s: self.config.row_s(frames),
            ..self.config.sequence
        };
        let passed = match self.work {
            Work::Poses(estimator) if !self.config.independent => {
                second_pass(estimator, config, &times, &mut estimates, |wanted, work| {
                    let again =
                        |k: usize, image: ImageView<'_>, memory: &mut WorkMemory| match memory {
                            WorkMemory::Poses(ws) => work(k, image, ws),
                            WorkMemory::Outlines(_) => None,
                        };
                    self.on_pictures(sources, wanted, &again, frames)
                })
            }
            _ => Ok(SequenceSummary::default()),
        };
        let seen_s = seen_times(config.row_s, &times, &estimates);
        let spin = estimate_spin(config, &seen_s, &estimates);
        for (frame, estimate) in frames.iter_mut().zip(estimates) {
            frame.estimate = estimate;
        }
        if config.row_s > 0.0 {
            for (frame, (first_row_s, seen_s)) in frames.iter_mut().zip(times.iter().zip(seen_s)) {
                (frame.first_row_s, frame.time_s) = (Some(*first_row_s), Some(seen_s));
            }
        }
        Ok(SequenceOutcome::Estimated {
            summary: passed?,
            spin,
        })
    }

    /// Looks again for outlines that lie off the path of the others.
    fn settle_outlines(
        &self,
        finder: &OutlineFinder,
        sources: &[(Source, usize)],
        frames: &mut [BatchFrame<O::Kept>],
    ) -> Result<()> {
        let times: Option<Vec<f64>> = frames.iter().map(|f| f.time_s).collect();
        let ascend = |times: &Vec<f64>| times.windows(2).all(|w| w[0] < w[1]);
        let numbers = || (0..frames.len()).map(|k| k as f64).collect();
        let times = times.filter(ascend).unwrap_or_else(numbers);
        for _ in 0..outlines::ROUNDS {
            let estimates = frames.iter_mut().map(|f| std::mem::take(&mut f.estimate));
            let estimates: Vec<FrameEstimate> = estimates.collect();
            let is_given = |k: usize| estimates[k].outline.is_some_and(|o| o.is_given());
            let doubts = outlines::off_the_path(&times, &estimates);
            let doubts: Vec<_> = doubts.into_iter().filter(|d| !is_given(d.0)).collect();
            for (frame, estimate) in frames.iter_mut().zip(estimates) {
                frame.estimate = estimate;
            }
            let wanted: Vec<usize> = doubts.iter().map(|d| d.0).collect();
            let again = |k: usize, image: ImageView<'_>, memory: &mut WorkMemory| {
                let expected = &doubts[wanted.binary_search(&k).ok()?].1;
                let WorkMemory::Outlines(ws) = memory else {
                    return None;
                };
                let mut found = FrameEstimate::default();
                finder.find(image, &outlines::near(expected), ws, &mut found);
                outlines::is_settled(&mut found, expected).then_some(found)
            };
            let settled = self.on_pictures(sources, &wanted, &again, frames)?;
            if settled.is_empty() {
                break;
            }
            for (k, found) in settled {
                frames[k].estimate = found;
            }
        }
        Ok(())
    }

    /// Works on the pictures of these frames; what comes of it. Their files are read once more: pictures are not kept.
    fn on_pictures(
        &self,
        sources: &[(Source, usize)],
        wanted: &[usize],
        work: &Again<'_>,
        frames: &mut [BatchFrame<O::Kept>],
    ) -> Result<Vec<(usize, FrameEstimate)>> {
        let (read, numbers) = sources_with(sources, wanted);
        let again = |at: usize, frame: Frame, memory: &mut WorkMemory| {
            let number = numbers.get(at).copied();
            let number = number.filter(|k| wanted.binary_search(k).is_ok());
            let (Some(k), Ok(picture)) = (number, frame.picture) else {
                return Ok(None);
            };
            let picture = self.upright(picture)?;
            let Some(found) = work(k, picture.view()?, memory) else {
                return Ok(None);
            };
            let kept = self.keep(&picture, &found)?;
            Ok(Some((k, found, kept)))
        };
        let mut changed = Changed(Vec::new());
        self.read_all(&read, again, &mut changed)?;
        let done = changed.0.into_iter().flatten();
        Ok(done
            .map(|(k, found, kept)| {
                frames[k].kept = kept;
                (k, found)
            })
            .collect())
    }

    /// A picture as the camera would show it without a mirror.
    fn upright(&self, picture: Picture) -> Result<Picture> {
        match self.config.mirrored {
            true => picture.mirrored(),
            false => Ok(picture),
        }
    }

    fn keep(&self, picture: &Picture, estimate: &FrameEstimate) -> Result<O::Kept> {
        if !self.observer.wants_images() {
            return Ok(O::Kept::default());
        }
        let image = picture.view()?;
        let is_large = image.width() * image.height() > MAX_THOROUGH;
        let alone = || self.large.lock().unwrap_or_else(PoisonError::into_inner);
        let _alone = is_large.then(alone);
        self.observer.keep(&*picture.to_rgb()?, estimate)
    }
}

/// Hands the frames of the sources, by their number over all of them, to `work` on all cores, while others are read; for
/// each source, how many frames it has and what it knows at its end.
pub(crate) fn read_all<W, T: Send>(
    sources: &[&Source],
    (max_pixels, stop): (u64, Option<StopFlag>),
    new_workspace: impl Fn() -> W + Sync,
    work: impl Fn(usize, Frame, &mut W) -> Result<T> + Sync,
    sink: &mut impl Sink<Result<T>, Error = Error>,
) -> Result<Vec<(usize, SourceEnd)>> {
    let threads = NonZero::new(rayon::current_num_threads()).unwrap_or(NonZero::<usize>::MIN);
    let limit = NonZero::new(threads.get() + WAITING).unwrap_or(threads);
    let mut sources = Sources {
        left: sources.iter(),
        open: None,
        max_pixels,
        ends: Vec::new(),
        stop,
    };
    let frames = sources.frames().enumerate();
    map_ordered_within(
        limit,
        frames.map(|(number, frame)| frame.map(|frame| (number, frame))),
        threads,
        new_workspace,
        |workspace, (number, frame)| work(number, frame, workspace),
        sink,
    )?;
    Ok(sources.ends)
}

/// The sources with one of these frames, whose numbers ascend, and the numbers of all frames of theirs.
pub(crate) fn sources_with<'a>(
    sources: &'a [(Source, usize)],
    wanted: &[usize],
) -> (Vec<&'a Source>, Vec<usize>) {
    let (mut read, mut numbers) = (Vec::new(), Vec::new());
    let mut first = 0;
    for (source, count) in sources {
        let range = first..first + count;
        first = range.end;
        if wanted.iter().any(|k| range.contains(k)) {
            read.push(source);
            numbers.extend(range);
        }
    }
    (read, numbers)
}

/// The frames of all sources, one after another.
struct Sources<'a> {
    left: std::slice::Iter<'a, &'a Source>,
    /// The source that is read, and how many frames it has handed out.
    open: Option<(Box<dyn FrameSource + Send>, usize)>,
    max_pixels: u64,
    /// How many frames each source had, and what it knew at its end.
    ends: Vec<(usize, SourceEnd)>,
    stop: Option<StopFlag>,
}

impl FrameSource for Sources<'_> {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool> {
        loop {
            if self.stop.is_some_and(StopFlag::is_set) {
                return Err(Error::Stopped);
            }
            if let Some((source, count)) = &mut self.open {
                if source.next_frame(frame)? {
                    *count += 1;
                    return Ok(true);
                }
                self.ends.push((*count, source.end()));
            }
            let next = self.left.next();
            let opened = next.map(|source| files::open(source, self.max_pixels));
            self.open = opened.transpose()?.map(|source| (source, 0));
            if self.open.is_none() {
                return Ok(false);
            }
        }
    }
}

/// Collects the frames in order.
struct Collected<'a, O: BatchObserver> {
    frames: Vec<BatchFrame<O::Kept>>,
    first_error: Option<Error>,
    observer: &'a O,
}

impl<O: BatchObserver> Sink<Estimated<O::Kept>> for Collected<'_, O> {
    type Error = Error;

    fn take(&mut self, estimated: Estimated<O::Kept>) -> Result<()> {
        let (frame, error) = estimated?;
        self.frames.push(frame);
        if self.first_error.is_none() {
            self.first_error = error;
        }
        self.observer.progress(self.frames.len());
        Ok(())
    }
}

/// Collects what the second pass changes.
struct Changed<T>(Vec<T>);

impl<T> Sink<Result<T>> for Changed<T> {
    type Error = Error;

    fn take(&mut self, done: Result<T>) -> Result<()> {
        self.0.push(done?);
        Ok(())
    }
}

pub(crate) fn set_times<K>(
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
        FrameClock::Ordered(path, times_s) => {
            if times_s.len() != frames.len() {
                let problem = format!(
                    "expected the times of {} frames, found {}",
                    frames.len(),
                    times_s.len()
                );
                return Err(Error::input(path, "file", problem));
            }
            for (frame, time) in frames.iter_mut().zip(times_s) {
                frame.time_s = Some(*time);
            }
            Ok(TimeSource::Table)
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

/// What the inputs say of the times; names that count frames, or are all alike, are no times.
fn input_times<K>(video: Option<VideoClock>, frames: &mut [BatchFrame<K>]) -> TimeSource {
    if let Some(clock) = video {
        return TimeSource::Video(clock);
    }
    let times: Vec<f64> = frames.iter().filter_map(|f| f.time_s).collect();
    let timed = times.len();
    match timed {
        0 => return TimeSource::None,
        _ if timed < frames.len() => return TimeSource::Partial { timed },
        1 => return TimeSource::Names { fps: None },
        _ => {}
    }
    let steps = times
        .windows(2)
        .map(|w| (1e9 * (w[1] - w[0]).abs()).round() as u64);
    let first = times.iter().copied().fold(f64::INFINITY, f64::min);
    let last = times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let problem = match crate::files::frame_number_step(steps.collect()) {
        _ if first == last => TimeSource::SameNumber,
        Some(step_ns) => TimeSource::FrameNumbers {
            step_s: 1e-9 * step_ns as f64,
        },
        None => {
            let fps = Some((timed - 1) as f64 / (last - first));
            return TimeSource::Names { fps };
        }
    };
    frames.iter_mut().for_each(|f| f.time_s = None);
    problem
}
