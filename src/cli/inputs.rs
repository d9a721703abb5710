//! What is said of the inputs themselves: files that are passed over, videos that end early, where the times come from.

use std::path::PathBuf;

use super::images::{order_warning, unused_warning};
use super::output::Counter;
use crate::clip::{BallEstimate, Batch, BatchConfig, BatchObserver, FocalDoubt, TimeSource};
use crate::error::{Result, are, counted};
use crate::files::csv::shown;
use crate::image::RgbImage;
use crate::source::files::{self, SkippedFiles, Source};
use crate::source::video::VideoClock;

/// Counts the frames of a clip while they are estimated, and keeps of each what another observer keeps.
pub(super) struct Counting<O> {
    counter: Counter,
    keeper: O,
}

impl<O> Counting<O> {
    /// That of the frames of these inputs.
    pub fn new(inputs: &[PathBuf], keeper: O) -> Self {
        // A video's frames are counted as they are read, and what cannot be read is said by whoever reads it.
        let sources = files::sources(inputs).unwrap_or_default();
        let is_image = |source: &Source| matches!(source, Source::Image(_));
        let total = match sources.iter().all(is_image) {
            true => sources.len(),
            false => 0,
        };
        Self {
            counter: Counter::new(total as u64, "frames"),
            keeper,
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.counter.finish();
    }
}

impl<O: BatchObserver> BatchObserver for Counting<O> {
    type Kept = O::Kept;

    fn keep(&self, image: &RgbImage, balls: &[BallEstimate]) -> Result<O::Kept> {
        self.keeper.keep(image, balls)
    }

    fn wants_images(&self) -> bool {
        self.keeper.wants_images()
    }

    fn progress(&self, frames: usize) {
        self.counter.set(frames as u64);
    }
}

/// Frames a second beyond which names may be in microseconds: few cameras are faster.
const FASTEST_FPS: f64 = 2e4;
/// Skipped files that are named.
const MAX_NAMED: usize = 5;

/// What is to be said of the inputs.
pub(super) fn say<K>(batch: &Batch<K>, config: &BatchConfig) -> Result<()> {
    say_names(batch, config)?;
    say_skipped(&batch.skipped);
    say_cut_short(&batch.cut_short);
    say_camera(batch.focal_doubt.as_ref());
    Ok(())
}

/// Says where the ball's outlines contradict the camera.
pub(super) fn say_camera(doubt: Option<&FocalDoubt>) {
    if let Some(doubt) = doubt {
        errln!("note: --intrinsics: {doubt}");
    }
}

/// What is to be said of the frames' names: their order, and rows of outlines that name none.
pub(super) fn say_names<K>(batch: &Batch<K>, config: &BatchConfig) -> Result<()> {
    if let Some(warning) = order_warning(batch.frames.iter().map(|f| f.name.as_str())) {
        errln!("note: {warning}");
    }
    let paths: Vec<PathBuf> = batch.frames.iter().map(|f| f.path.clone()).collect();
    if let Some(warning) = unused_warning(config.circles.as_ref(), &paths)? {
        errln!("note: {warning}");
    }
    Ok(())
}

/// Names the files of folders that are no images.
pub(super) fn say_skipped(all: &[SkippedFiles]) {
    for skipped in all {
        let folder = skipped.folder.display();
        let (count, names) = (skipped.names.len(), &skipped.names);
        let listed = names
            .iter()
            .take(MAX_NAMED)
            .map(|n| shown(n))
            .collect::<Vec<_>>();
        let more = if count > MAX_NAMED { ", ..." } else { "" };
        errln!(
            "{folder}: skipped {}, which {} no image{}: {}{more}",
            counted(count, "file"),
            are(count),
            if count == 1 { "" } else { "s" },
            listed.join(", ")
        );
    }
}

/// Names the videos of which only a part can be read.
pub(super) fn say_cut_short(videos: &[(PathBuf, String)]) {
    for (path, why) in videos {
        errln!(
            "{}: damaged, what can be read is used: {}",
            path.display(),
            shown(why)
        );
    }
}

/// Says that the frames are no sequence in spite of their times.
pub(super) fn say_not_increasing() {
    errln!(
        "note: the times do not increase from frame to frame, as those of two clips do not: every frame is estimated independently"
    );
}

/// Where the times came from, and what is to be done where they are missing or doubtful.
pub(super) fn times_words(times: &TimeSource, count: usize) -> Option<String> {
    let words = match *times {
        TimeSource::None => {
            return (count > 1)
                .then(|| "no times, so no spin: --fps or --times gives them".to_owned());
        }
        TimeSource::Partial { timed } => format!(
            "{timed} of {count} names are times in nanoseconds, so no spin: --fps or --times gives all"
        ),
        TimeSource::FrameNumbers { step_s } => {
            // What the rate is if a step of 50 or more is a number of microseconds.
            let guess = match 1e9 * step_s >= 50.0 {
                true => microseconds(1.0 / step_s),
                false => String::new(),
            };
            format!("{}, so no spin: give --fps{guess}", times.problem()?)
        }
        TimeSource::SameNumber => format!("{}, so no spin: give --fps", times.problem()?),
        TimeSource::Names { fps } => {
            let fps = fps?;
            let or = match fps > FASTEST_FPS {
                true => format!("; --fps{}", microseconds(fps)),
                false => String::new(),
            };
            format!("from the names, in nanoseconds: {fps:.2} fps on average{or}")
        }
        TimeSource::Rate { fps } => format!("{fps} fps as given by --fps"),
        TimeSource::Table => "from the table".into(),
        TimeSource::Video(clock) => video_words(&clock),
    };
    Some(words)
}

/// The rate of frames whose names, taken as nanoseconds, have this one.
fn microseconds(fps: f64) -> String {
    format!(" ({:.2} if they are microseconds)", 1e-3 * fps)
}

/// The rate of a video, and what the file leaves open.
fn video_words(clock: &VideoClock) -> String {
    let stored = clock.stored_fps;
    let rate = match clock.is_variable {
        true => format!("{stored:.2} fps on average, each frame at its own time stamp"),
        false => format!("{stored:.2} fps"),
    };
    match clock.capture_fps {
        Some(capture) => format!(
            "slow motion: taken at {capture:.2} fps as the file says, stored at {rate} (--fps overrides)"
        ),
        None => format!("{rate} as the file says; phone slow motion? give --fps"),
    }
}
