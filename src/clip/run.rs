//! The one way of a clip: its frames of files, folders, videos and memory, each estimated on all cores, then together.
//!
//! ```text
//! table     of several tables of one ball that of the first frames that can say               (choice)
//! alone     each frame by itself: one ball, all balls, the images of flashes, an outline      (Work)
//! times     by names, video, rate or table
//! together  frames in doubt again between their neighbors; missing balls where others lead;
//!           outlines off the path; rolling rows; the spin; numbers of several balls           (second)
//! judgment  do the tables fit, are the images mirrored                                        (Judgment)
//! camera    do the ball's outlines contradict its intrinsics                                  (FocalDoubt)
//! ```
//!
//! Guarantees: frames come in the order of the inputs; each is first estimated independently, so that the
//! number of threads changes nothing; a file that cannot be read is a rejected frame. Memory: two
//! pictures more than there are threads wait, 8 bits a color; of a large one only those parts are
//! converted that are looked at. All estimates are held; the files of frames in doubt are read once more.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::balls::BallEstimate;
use super::batch::{Batch, BatchFrame, BatchObserver, SequenceOutcome};
use super::config::BatchConfig;
use super::focal::FocalDoubt;
use super::judgment::Judgment;
use super::read::{SourceReading, sources_with};
use super::times::set_times;
use super::work::{Work, Worker};
use crate::error::{Error, Result};
use crate::image::{ImageView, Picture, RgbImage};
use crate::source::files::{self, Source, SourceList};
use crate::source::{Frame, SourceEnd};
use crate::vision::estimator::Estimator;
use crate::vision::estimator::propose::VERY_LARGE;
use crate::vision::frame::prior::Prior;

/// Does a work on the frames of files, folders and videos.
///
/// # Errors
/// [`crate::Error::Read`] and [`crate::Error::Input`] of an input or of the table of times; those of
/// the observer.
pub fn run<'a, O: BatchObserver>(
    work: impl Into<Work<'a>>,
    inputs: &[PathBuf],
    config: &BatchConfig,
    observer: &O,
) -> Result<Batch<O::Kept>> {
    run_sources(work, &files::list_sources(inputs)?, config, observer)
}

/// Does a work on the frames of sources, in their order: those of files as [`files::list_sources`] has them, or frames in memory.
///
/// # Errors
/// Those of [`run`].
pub fn run_sources<'a, O: BatchObserver>(
    work: impl Into<Work<'a>>,
    listed: &SourceList,
    config: &BatchConfig,
    observer: &O,
) -> Result<Batch<O::Kept>> {
    let watching = Watching::new(observer);
    let batch = run_watched(work.into(), listed, config, &watching)?;
    let kept = watching.kept(batch.frames.len());
    Ok(batch.keeping(kept))
}

/// The same; what is kept is with the watcher.
pub(super) fn run_watched(
    work: Work<'_>,
    listed: &SourceList,
    config: &BatchConfig,
    watcher: &dyn Watch,
) -> Result<Batch> {
    if let Work::Poses([]) = work {
        return Err(Error::argument("table", "expected at least one"));
    }
    let sources: Vec<&Source> = listed.sources.iter().collect();
    let anew = || SourceReading::new(&sources, config);
    let mut pass = Pass::new(work, config, watcher);
    let mut reading = anew();
    if let Work::Poses([_, _, ..]) = pass.work {
        pass.table = pass.choose_table(&mut reading)?;
        if reading.is_too_much() {
            reading = anew();
        }
    }
    let mut batch = pass.all(reading, listed)?;
    if config.verdict {
        let judgment = Judgment::of_clip(&pass.work, pass.table, config, &mut batch)?;
        if judgment.table != pass.table {
            // Which outlines were tried depends on the table: those of the right one are the answer.
            pass.table = judgment.table;
            batch = pass.all(anew(), listed)?;
        }
        batch.judgment = judgment;
    }
    batch.focal_doubt = FocalDoubt::of_clip(&pass.work, &batch);
    Ok(batch)
}

impl<K: Send + Default> Batch<K> {
    /// The second pass of one ball's frames and its spin anew, after the estimates have changed.
    ///
    /// # Errors
    /// [`crate::Error::Read`] where a file can no longer be read; those of the observer.
    pub fn estimate_again(
        &mut self,
        estimator: &Estimator,
        config: &BatchConfig,
        observer: &impl BatchObserver<Kept = K>,
    ) -> Result<()> {
        let before = self.frames.iter_mut().map(|f| std::mem::take(&mut f.kept));
        let watching = Watching::after(observer, before.collect());
        let frames = std::mem::take(&mut self.frames).into_iter();
        let mut frames: Vec<BatchFrame> = frames.map(|frame| frame.keeping(())).collect();
        let pass = Pass::new(estimator.into(), config, &watching);
        let sequence = pass.as_sequence(&self.sources, &mut frames);
        let kept = watching.kept(frames.len()).into_iter();
        let joined = frames.into_iter().zip(kept);
        self.frames = joined.map(|(frame, kept)| frame.keeping(kept)).collect();
        self.sequence = sequence?;
        Ok(())
    }
}

/// What sees the pictures of a pass: an observer without the type of what it keeps, so that the passes are compiled once.
pub(super) trait Watch: Sync {
    /// Sees the picture of a frame by its number, and the balls that were found in it.
    fn see(&self, frame: usize, image: &RgbImage, balls: &[BallEstimate]) -> Result<()>;

    /// See [`BatchObserver::wants_images`].
    fn wants_images(&self) -> bool;

    /// See [`BatchObserver::progress`].
    fn progress(&self, frames: &[BatchFrame]);
}

/// Holds what an observer keeps, by the frames' numbers.
pub(super) struct Watching<'a, O: BatchObserver> {
    observer: &'a O,
    kept: Mutex<Vec<O::Kept>>,
}

impl<'a, O: BatchObserver> Watching<'a, O> {
    /// Nothing is kept yet.
    pub(super) fn new(observer: &'a O) -> Self {
        Self::after(observer, Vec::new())
    }

    /// This was kept before.
    fn after(observer: &'a O, kept: Vec<O::Kept>) -> Self {
        let kept = Mutex::new(kept);
        Self { observer, kept }
    }

    /// What is kept of so many frames.
    pub(super) fn kept(self, frames: usize) -> Vec<O::Kept> {
        let mut kept = self
            .kept
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        kept.resize_with(frames, O::Kept::default);
        kept
    }
}

impl<O: BatchObserver> Watch for Watching<'_, O> {
    fn see(&self, frame: usize, image: &RgbImage, balls: &[BallEstimate]) -> Result<()> {
        let seen = self.observer.keep(image, balls)?;
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() <= frame {
            kept.resize_with(frame + 1, O::Kept::default);
        }
        kept[frame] = seen;
        Ok(())
    }

    fn wants_images(&self) -> bool {
        self.observer.wants_images()
    }

    fn progress(&self, frames: &[BatchFrame]) {
        self.observer.progress(frames);
    }
}

/// What a pass over the frames needs.
pub(super) struct Pass<'a> {
    pub work: Work<'a>,
    /// Of several tables of one ball that in use.
    pub table: usize,
    pub config: &'a BatchConfig,
    watcher: &'a dyn Watch,
    /// Held by the one thread that works on the colors of a large picture.
    large: Mutex<()>,
}

/// Works on a frame's picture by the frame's number; `None` where nothing comes of it.
pub(super) type PictureWork<'a> =
    dyn Fn(usize, ImageView<'_>, &mut Worker<'_>) -> Option<Vec<BallEstimate>> + Sync + 'a;

/// A frame and the error by which it is unreadable.
type Estimated = Result<(BatchFrame, Option<Error>)>;

impl<'a> Pass<'a> {
    pub(super) fn new(work: Work<'a>, config: &'a BatchConfig, watcher: &'a dyn Watch) -> Self {
        Self {
            work,
            table: 0,
            config,
            watcher,
            large: Mutex::new(()),
        }
    }

    /// All frames, each alone and then together.
    fn all(&self, reading: SourceReading<'_>, listed: &SourceList) -> Result<Batch> {
        let (mut frames, mut first_error) = (Vec::new(), None);
        let alone = |k, frame, worker: &mut Worker<'_>| self.alone(k, frame, worker);
        let read = self.each(reading, alone, |(frame, error)| {
            frames.push(frame);
            first_error = first_error.take().or(error);
            self.watcher.progress(&frames);
        })?;
        // A file that is no image is a rejected frame among others, and an error alone.
        let is_hopeless = frames.iter().all(|f| f.unreadable.is_some());
        if let Some(error) = first_error.filter(|_| is_hopeless) {
            return Err(error);
        }
        let (mut clock, mut cut_short) = (None, Vec::new());
        let is_stated = !read.is_empty() && read.iter().all(|(_, end)| end.is_stated);
        let mut first = 0;
        for (source, (count, end)) in listed.sources.iter().zip(&read) {
            let scale = end.clock.map_or(1.0, |clock| clock.time_scale());
            let timed = frames[first..][..*count].iter_mut();
            timed
                .flat_map(|f: &mut BatchFrame| &mut f.time_s)
                .for_each(|time_s| *time_s *= scale);
            first += count;
            clock = end.clock.or(clock);
            if let (Source::Video(path), Some(why)) = (source, &end.cut_short) {
                cut_short.push((path.clone(), why.clone()));
            }
        }
        let counts = read.into_iter().map(|(count, _)| count);
        let mut batch = Batch {
            times: set_times(&self.config.clock, (clock, is_stated), &mut frames)?,
            frames,
            sequence: SequenceOutcome::Apart,
            judgment: Judgment::default(),
            focal_doubt: None,
            skipped: listed.skipped.clone(),
            cut_short,
            sources: listed.sources.iter().cloned().zip(counts).collect(),
        };
        batch.sequence = self.together(&batch.sources, &batch.times, &mut batch.frames)?;
        Ok(batch)
    }

    /// Works on frames on all cores; what comes of it is taken in their order.
    fn each<T: Send>(
        &self,
        reading: SourceReading<'_>,
        work: impl Fn(usize, Frame, &mut Worker<'_>) -> Result<T> + Sync,
        take: impl FnMut(T),
    ) -> Result<Vec<(usize, SourceEnd)>> {
        // What forbids a worker is known here; one of each thread is made there.
        let new_worker = || Worker::new(self.work, self.table);
        drop(new_worker()?);
        let work = |number, frame, worker: &mut Result<Worker<'_>>| match worker {
            Ok(worker) => work(number, frame, worker),
            Err(error) => Err(Error::Internal(error.to_string())),
        };
        reading.each(new_worker, work, take)
    }

    /// A frame by itself.
    fn alone(&self, number: usize, frame: Frame, worker: &mut Worker<'_>) -> Estimated {
        let mut done = BatchFrame {
            name: frame.name,
            path: frame.path,
            time_s: frame.time_s,
            first_row_s: None,
            balls: self.work.unreadable(),
            size: None,
            unreadable: None,
            kept: (),
        };
        let picture = match frame.picture {
            Ok(picture) => picture,
            Err(error) => {
                done.unreadable = Some(error.to_string());
                return Ok((done, Some(error)));
            }
        };
        let picture = self.prepared(picture)?;
        let image = picture.view()?;
        done.size = Some([image.width(), image.height()]);
        let prior = match self.prior(&done.path, &image)? {
            Ok(prior) => prior,
            Err(error) => {
                done.unreadable = Some(format!("{}: {error}", done.path.display()));
                return Ok((done, Some(error)));
            }
        };
        done.balls = worker.alone(image, &prior, &self.config.budget);
        self.watch(number, &picture, &done.balls)?;
        Ok((done, None))
    }

    /// What is known of a frame, or that its picture lacks the part in which the ball is looked for, which others may have.
    pub fn prior(&self, path: &Path, image: &ImageView<'_>) -> Result<Result<Prior>> {
        let circles = self.config.circles.as_ref();
        let outline = circles.map(|circles| circles.of_frame(path)).transpose()?;
        let outline = outline.flatten().or(self.config.outline);
        let roi = self.config.roi.filter(|_| outline.is_none());
        let region = roi.map(|roi| roi.within(image.width(), image.height()));
        Ok(region.transpose().map(|region| Prior {
            region,
            outline,
            ..Prior::default()
        }))
    }

    /// Works on the pictures of these frames; what comes of it. Their files are read once more: pictures are not kept.
    pub fn on_pictures(
        &self,
        sources: &[(Source, usize)],
        wanted: &[usize],
        work: &PictureWork<'_>,
    ) -> Result<Vec<(usize, Vec<BallEstimate>)>> {
        if wanted.is_empty() {
            return Ok(Vec::new());
        }
        let (read, numbers) = sources_with(sources, wanted);
        let again = |at: usize, frame: Frame, worker: &mut Worker<'_>| {
            let number = numbers.get(at).copied();
            let number = number.filter(|k| wanted.binary_search(k).is_ok());
            let (Some(k), Ok(picture)) = (number, frame.picture) else {
                return Ok(None);
            };
            let picture = self.prepared(picture)?;
            let Some(found) = work(k, picture.view()?, worker) else {
                return Ok(None);
            };
            self.watch(k, &picture, &found)?;
            Ok(Some((k, found)))
        };
        let mut changed = Vec::new();
        let reading = SourceReading::new(&read, self.config);
        self.each(reading, again, |done| changed.extend(done))?;
        Ok(changed)
    }

    /// A picture as it is estimated: without a mirror, its dots darker than the ball.
    pub fn prepared(&self, mut picture: Picture) -> Result<Picture> {
        if self.config.mirrored {
            picture = picture.mirrored()?;
        }
        if self.config.bright_dots {
            picture = picture.negative()?;
        }
        Ok(picture)
    }

    fn watch(&self, number: usize, picture: &Picture, balls: &[BallEstimate]) -> Result<()> {
        if !self.watcher.wants_images() {
            return Ok(());
        }
        let image = picture.view()?;
        let is_large = image.width() * image.height() > VERY_LARGE;
        let alone = || self.large.lock().unwrap_or_else(PoisonError::into_inner);
        let _alone = is_large.then(alone);
        self.watcher.see(number, &*picture.to_rgb()?, balls)
    }
}
