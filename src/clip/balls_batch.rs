//! All balls of the frames of files, folders and videos.
//!
//! Frames are estimated independently on all cores, in the order of the inputs; balls that are missing amid a sequence are looked for
//! once more, and [`number_balls`](super::ball_tracks::number_balls) then gives each ball its number. A file that cannot be read is a frame without balls and with the reason.

use std::path::PathBuf;

use super::ball_tracks::missing_balls;
use super::balls::{BallEstimate, BallsEstimator, BallsWorkspace};
use super::batch::{
    BatchConfig, BatchFrame, BatchObserver, TimeSource, read_all, set_times, sources_with,
};
use super::strobe::Strobe;
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};

use crate::error::{Error, Result};
use crate::image::Picture;
use crate::pipeline::Sink;
use crate::source::files::{self, SkippedFiles, Source};
use crate::source::{Frame, SourceEnd};
use crate::vision::optics::camera::BallCircle;

/// A frame and its balls.
#[derive(Debug)]
pub struct BallsFrame<K> {
    /// The frame; its own estimate is not processed.
    pub frame: BatchFrame<K>,
    /// Its balls, those with a pose first.
    pub balls: Vec<BallEstimate>,
}

/// The frames of some inputs.
#[derive(Debug)]
pub struct BallsBatch<K> {
    /// In the order of the inputs.
    pub frames: Vec<BallsFrame<K>>,
    /// Where the times came from.
    pub times: TimeSource,
    /// Files of the folders that are no images.
    pub skipped: Vec<SkippedFiles>,
    /// Videos of which only a part can be read, with the reason.
    pub cut_short: Vec<(PathBuf, String)>,
}

impl<K> BallsBatch<K> {
    /// Whether all of several frames have a time, but these do not increase.
    pub fn is_disordered(&self) -> bool {
        let all_timed = self.frames.iter().all(|f| f.frame.time_s.is_some());
        self.frames.len() > 1 && all_timed && self.times_s().is_none()
    }

    /// The times of the frames, seconds, where all have one and they increase.
    pub fn times_s(&self) -> Option<Vec<f64>> {
        let times: Option<Vec<f64>> = self.frames.iter().map(|f| f.frame.time_s).collect();
        times.filter(|t| t.len() > 1 && t.windows(2).all(|w| w[0] < w[1]))
    }
}

/// Estimates all balls of the frames of files, folders and videos. Of the settings the region, the clock, the budget and the
/// pictures' size hold; with `strobe` each frame is an exposure of one ball. Where the frames have times and are a sequence, balls that
/// are missing are looked for where the frames about them lead.
///
/// # Errors
/// [`Error::Read`] and [`Error::Input`] for inputs without a frame that can be read, or times that the frames lack.
pub fn estimate_ball_inputs<O: BatchObserver<[BallEstimate]>>(
    estimator: &BallsEstimator,
    inputs: &[PathBuf],
    config: &BatchConfig,
    strobe: Option<&Strobe>,
    observer: &O,
) -> Result<BallsBatch<O::Kept>> {
    let pass = Pass {
        estimator,
        config,
        strobe,
        observer,
    };
    let listed = files::list_sources(inputs)?;
    let (mut frames, mut clock, mut first_error) = (Vec::new(), None, None);
    let mut cut_short = Vec::new();
    let sources: Vec<&Source> = listed.sources.iter().collect();
    let read = pass.read(
        &sources,
        |_, frame, ws| pass.alone(frame, ws),
        |(frame, error)| {
            frames.push(frame);
            first_error = first_error.take().or(error);
            observer.progress(frames.len());
        },
    )?;
    let mut first = 0;
    for (source, (count, end)) in sources.iter().zip(&read) {
        if let (Source::Video(path), Some(why)) = (source, &end.cut_short) {
            cut_short.push((path.clone(), why.clone()));
        }
        let scale = end.clock.map_or(1.0, |clock| clock.time_scale());
        let timed = frames[first..][..*count].iter_mut();
        for time_s in timed.filter_map(|f: &mut BallsFrame<_>| f.frame.time_s.as_mut()) {
            *time_s *= scale;
        }
        first += count;
        clock = end.clock.or(clock);
    }
    let is_hopeless = frames.iter().all(|f| f.frame.unreadable.is_some());
    if let Some(error) = first_error.filter(|_| is_hopeless) {
        return Err(error);
    }
    let (mut timed, balls): (Vec<_>, Vec<_>) =
        frames.into_iter().map(|f| (f.frame, f.balls)).unzip();
    let times = set_times(&config.clock, clock, &mut timed)?;
    let together = timed.into_iter().zip(balls);
    let mut batch = BallsBatch {
        frames: together
            .map(|(frame, balls)| BallsFrame { frame, balls })
            .collect(),
        times,
        skipped: listed.skipped,
        cut_short,
    };
    let times_s = batch.times_s().filter(|_| strobe.is_none());
    if let (Some(times_s), false) = (times_s, config.independent) {
        let counts = read.iter().map(|(count, _)| *count);
        let sources: Vec<(Source, usize)> = listed.sources.into_iter().zip(counts).collect();
        pass.second(&sources, &times_s, &mut batch.frames)?;
    }
    Ok(batch)
}

/// What a pass over the frames needs.
struct Pass<'a, O> {
    estimator: &'a BallsEstimator,
    config: &'a BatchConfig,
    strobe: Option<&'a Strobe>,
    observer: &'a O,
}

impl<O: BatchObserver<[BallEstimate]>> Pass<'_, O> {
    /// Works on the frames of the sources on all cores; what comes of it is taken in their order.
    fn read<T: Send>(
        &self,
        sources: &[&Source],
        work: impl Fn(usize, Frame, &mut BallsWorkspace<'_>) -> Result<T> + Sync,
        take: impl FnMut(T),
    ) -> Result<Vec<(usize, SourceEnd)>> {
        // What forbids a workspace is known here; one of each thread is made there.
        self.estimator.workspace()?;
        let work = |number, frame, ws: &mut Option<BallsWorkspace<'_>>| match ws {
            Some(ws) => work(number, frame, ws),
            None => Err(Error::Internal("a workspace of balls".into())),
        };
        let new_workspace = || self.estimator.workspace().ok();
        let mut taken = Taken(take);
        read_all(
            sources,
            (self.config.max_pixels, self.config.budget.stop),
            new_workspace,
            work,
            &mut taken,
        )
    }

    /// A frame that is estimated alone, and why it cannot be read.
    fn alone(&self, frame: Frame, ws: &mut BallsWorkspace<'_>) -> Alone<O::Kept> {
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
            Err(error) => return Ok(unread(done, error.to_string(), error)),
        };
        let image = picture.view()?;
        done.size = Some([image.width(), image.height()]);
        let roi = self.config.roi.as_ref();
        let region = roi.map(|roi| roi.within(image.width(), image.height()));
        // A part that one picture lacks, others may have.
        let region = match region.transpose() {
            Ok(region) => region,
            Err(error) => {
                let words = format!("{}: {error}", done.path.display());
                return Ok(unread(done, words, error));
            }
        };
        let budget = &self.config.budget;
        let balls = match self.strobe {
            Some(strobe) => self
                .estimator
                .estimate_strobed(image, region, strobe, budget, ws),
            None => self.estimator.estimate(image, region, &[], budget, ws),
        };
        done.kept = self.keep(&picture, &balls)?;
        Ok((BallsFrame { frame: done, balls }, None))
    }

    fn keep(&self, picture: &Picture, balls: &[BallEstimate]) -> Result<O::Kept> {
        match self.observer.wants_images() {
            true => self.observer.keep(&*picture.to_rgb()?, balls),
            false => Ok(O::Kept::default()),
        }
    }

    /// Looks for balls that are missing amid a sequence. Files are read once more: pictures are not kept.
    fn second(
        &self,
        sources: &[(Source, usize)],
        times_s: &[f64],
        frames: &mut [BallsFrame<O::Kept>],
    ) -> Result<()> {
        let before = frames.iter_mut().map(|f| std::mem::take(&mut f.balls));
        let balls: Vec<Vec<BallEstimate>> = before.collect();
        let missing = missing_balls(self.config.sequence.spin, times_s, &balls);
        let numbered = missing.iter().enumerate();
        let wanted: Vec<usize> = numbered
            .filter(|(_, circles)| !circles.is_empty())
            .map(|(k, _)| k)
            .collect();
        let (read, numbers) = sources_with(sources, &wanted);
        let again = |at: usize, frame: Frame, ws: &mut BallsWorkspace<'_>| {
            let number = numbers.get(at).copied();
            let number = number.filter(|k| wanted.binary_search(k).is_ok());
            let (Some(k), Ok(picture)) = (number, frame.picture) else {
                return Ok(None);
            };
            let (before, budget) = (balls[k].clone(), &self.config.budget);
            let image = picture.view()?;
            let mut expected = missing[k].clone();
            if let Some(roi) = &self.config.roi {
                let Ok(region) = roi.within(image.width(), image.height()) else {
                    return Ok(None);
                };
                let within = |x: f64, from: usize, size: usize| {
                    (from as f64..(from + size) as f64).contains(&x)
                };
                expected.retain(|BallCircle { center, .. }| {
                    within(center.u, region.left, region.width)
                        && within(center.v, region.top, region.height)
                });
            }
            let estimator = self.estimator;
            let found = estimator.look_again(image, before, &expected, budget, ws);
            let kept = self.keep(&picture, &found)?;
            Ok(Some((k, found, kept)))
        };
        let mut changed = Vec::new();
        if !wanted.is_empty() {
            self.read(&read, again, |frame| changed.extend(frame))?;
        }
        for (frame, balls) in frames.iter_mut().zip(balls) {
            frame.balls = balls;
        }
        for (k, balls, kept) in changed {
            (frames[k].balls, frames[k].frame.kept) = (balls, kept);
        }
        Ok(())
    }
}

/// A frame, and why it cannot be read.
type Alone<K> = Result<(BallsFrame<K>, Option<Error>)>;

/// A frame that cannot be read.
fn unread<K>(
    mut frame: BatchFrame<K>,
    words: String,
    why: Error,
) -> (BallsFrame<K>, Option<Error>) {
    frame.estimate.outcome = Err(FrameRejection::Unreadable);
    frame.unreadable = Some(words);
    let balls = Vec::new();
    (BallsFrame { frame, balls }, Some(why))
}

/// Takes results in their order.
struct Taken<F>(F);

impl<T, F: FnMut(T)> Sink<Result<T>> for Taken<F> {
    type Error = Error;

    fn take(&mut self, done: Result<T>) -> Result<()> {
        (self.0)(done?);
        Ok(())
    }
}
