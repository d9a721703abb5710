//! All balls of the frames of files, folders and videos.
//!
//! Frames are estimated independently on all cores, in the order of the inputs; [`number_balls`](super::number_balls) then gives each
//! ball its number. A file that cannot be read is a frame without balls and with the reason.

use std::path::PathBuf;

use super::batch::set_times;
use super::{
    BallEstimate, BallsEstimator, BatchConfig, BatchFrame, BatchObserver, FrameEstimate,
    FrameRejection, Strobe, TimeSource,
};
use crate::concurrency;
use crate::error::{Error, Result};
use crate::source::files::{self, SkippedFiles, Source};
use crate::source::{Frame, FrameSource};
use crate::vision::detect::DotDetector;

/// Frames that one thread estimates after each other in the same memory.
const CHUNK: usize = 8;

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
/// pictures' size hold; with `strobe` each frame is an exposure of one ball.
///
/// # Errors
/// [`Error::Read`] and [`Error::Input`] for inputs without a frame that can be read, or times that the frames lack.
pub fn estimate_ball_inputs<D: DotDetector + Sync, O: BatchObserver<[BallEstimate]>>(
    estimator: &BallsEstimator<D>,
    inputs: &[PathBuf],
    config: &BatchConfig,
    strobe: Option<&Strobe>,
    observer: &O,
) -> Result<BallsBatch<O::Kept>> {
    let listed = files::list_sources(inputs)?;
    let (mut frames, mut clock, mut first_error) = (Vec::new(), None, None);
    let mut cut_short = Vec::new();
    let at_once = CHUNK * concurrency::threads();
    for source in &listed.sources {
        let mut open = files::open(source, config.max_pixels)?;
        let begun = frames.len();
        loop {
            let mut read = Vec::with_capacity(at_once);
            while read.len() < at_once {
                let mut frame = Frame::default();
                if !open.next_frame(&mut frame)? {
                    break;
                }
                read.push(frame);
            }
            let is_last = read.len() < at_once;
            let chunks: Vec<&[Frame]> = read.chunks(CHUNK).collect();
            let done = concurrency::map(&chunks, |chunk| {
                work(estimator, config, strobe, observer, chunk)
            });
            for one in done
                .into_iter()
                .collect::<Result<Vec<_>>>()?
                .into_iter()
                .flatten()
            {
                first_error = first_error.or_else(|| one.frame.unreadable.clone());
                frames.push(one);
            }
            observer.progress(frames.len());
            if is_last {
                break;
            }
        }
        let end = open.end();
        if let (Source::Video(path), Some(why)) = (source, &end.cut_short) {
            cut_short.push((path.clone(), why.clone()));
        }
        let scale = end.clock.map_or(1.0, |clock| clock.time_scale());
        let timed = frames[begun..].iter_mut();
        for time_s in timed.filter_map(|f: &mut BallsFrame<_>| f.frame.time_s.as_mut()) {
            *time_s *= scale;
        }
        clock = end.clock.or(clock);
    }
    let is_hopeless = frames.iter().all(|f| f.frame.unreadable.is_some());
    if let (true, Some(words), Some(first)) = (is_hopeless, first_error, frames.first()) {
        return Err(Error::input(&first.frame.path, "image", words));
    }
    let (mut timed, balls): (Vec<_>, Vec<_>) =
        frames.into_iter().map(|f| (f.frame, f.balls)).unzip();
    let times = set_times(&config.clock, clock, &mut timed)?;
    let together = timed.into_iter().zip(balls);
    Ok(BallsBatch {
        frames: together
            .map(|(frame, balls)| BallsFrame { frame, balls })
            .collect(),
        times,
        skipped: listed.skipped,
        cut_short,
    })
}

fn work<D: DotDetector, O: BatchObserver<[BallEstimate]>>(
    estimator: &BallsEstimator<D>,
    config: &BatchConfig,
    strobe: Option<&Strobe>,
    observer: &O,
    frames: &[Frame],
) -> Result<Vec<BallsFrame<O::Kept>>> {
    let mut ws = estimator.workspace()?;
    let one = |frame: &Frame| {
        let mut done = BatchFrame {
            name: frame.name.clone(),
            path: frame.path.clone(),
            time_s: frame.time_s,
            first_row_s: None,
            estimate: FrameEstimate::default(),
            size: None,
            unreadable: None,
            kept: O::Kept::default(),
        };
        let picture = match &frame.picture {
            Ok(picture) => picture,
            Err(error) => {
                done.estimate.outcome = Err(FrameRejection::Unreadable);
                done.unreadable = Some(error.to_string());
                return Ok(BallsFrame {
                    frame: done,
                    balls: Vec::new(),
                });
            }
        };
        let image = picture.view()?;
        done.size = Some([image.width(), image.height()]);
        let region = match &config.roi {
            Some(roi) => Some(roi.within(image.width(), image.height())?),
            None => None,
        };
        let budget = &config.budget;
        let balls = match strobe {
            Some(strobe) => estimator.estimate_strobed(image, region, strobe, budget, &mut ws),
            None => estimator.estimate(image, region, &[], budget, &mut ws),
        };
        if observer.wants_images() {
            done.kept = observer.keep(&*picture.to_rgb()?, &balls)?;
        }
        Ok(BallsFrame { frame: done, balls })
    };
    frames.iter().map(one).collect()
}
