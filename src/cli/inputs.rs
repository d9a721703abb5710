//! What is said of the inputs themselves: files that are passed over, videos that end early, where the times come from.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::images::{order_warning, unused_warning};
use super::output::Counter;
use crate::clip::{
    BallEstimate, Batch, BatchConfig, BatchFrame, BatchObserver, FocalDoubt, SequenceOutcome,
    TimeSource,
};
use crate::error::{Result, are, counted};
use crate::files::csv::shown;
use crate::image::RgbImage;
use crate::source::files::{self, SkippedFiles, Source};
use crate::source::video::VideoClock;

/// Of more image files none is opened to count its pictures: they are frames of one clip.
const MAX_OPENED: usize = 16;

/// Counts the frames of a clip while they are estimated, and keeps of each what another observer keeps.
pub(super) struct Counting<O> {
    counter: Counter,
    keeper: O,
    /// Which of a ball's dots were identified, where that is to be shown.
    dots: Option<Mutex<Vec<bool>>>,
}

impl<O> Counting<O> {
    /// That of the frames of these inputs.
    pub fn new(inputs: &[PathBuf], keeper: O) -> Self {
        // A video's frames are counted as they are read, and what cannot be read is said by whoever reads it.
        let sources = files::sources(inputs).unwrap_or_default();
        let frames = |source: &Source| match sources.len() > MAX_OPENED {
            true => matches!(source, Source::Image(_)).then_some(1),
            false => files::frame_count(source),
        };
        let total: Option<usize> = sources.iter().map(frames).sum();
        Self {
            counter: Counter::new(total.unwrap_or(0) as u64, "frames"),
            keeper,
            dots: None,
        }
    }

    /// Shows how many of so many dots were identified, too.
    pub fn of_dots(self, count: usize) -> Self {
        Self {
            dots: Some(Mutex::new(vec![false; count])),
            ..self
        }
    }

    /// Notes the dots of a frame.
    fn note_dots(&self, balls: &[BallEstimate]) {
        let Some(dots) = &self.dots else { return };
        let mut dots = dots.lock().unwrap_or_else(PoisonError::into_inner);
        let posed = balls.iter().filter(|ball| ball.frame.pose().is_some());
        for name in posed.flat_map(|ball| ball.frame.assignment.iter().flatten()) {
            if let Some(dot) = dots.get_mut(usize::from(*name)) {
                *dot = true;
            }
        }
        let found = dots.iter().filter(|dot| **dot).count();
        self.counter
            .note(&format!(", {found} of {} dots found", dots.len()));
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

    fn progress(&self, frames: &[BatchFrame]) {
        if let Some(last) = frames.last() {
            self.note_dots(&last.balls);
        }
        self.counter.set(frames.len() as u64);
    }
}

/// Frames a second beyond which names may be in microseconds: few cameras are faster.
const FASTEST_FPS: f64 = 2e4;
/// Skipped files, or clips, that are named.
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

/// Says where times do not increase, and what comes of it: within an input, or from one to the next, which has times of its own.
pub(super) fn say_not_increasing<K>(batch: &Batch<K>, inputs: &[PathBuf], so: &str) {
    if !matches!(batch.sequence, SequenceOutcome::TimesNotIncreasing) {
        return;
    }
    let (frames, files) = (&batch.frames, files_of(batch));
    let mut back = (1..frames.len()).filter(|k| frames[*k].time_s <= frames[k - 1].time_s);
    let within = back.find_map(|k| {
        let [from, to] = [k - 1, k].map(|k| input_of(inputs, &files[k]));
        from.filter(|_| from == to)
    });
    let what = match within {
        Some(input) => format!(
            "the times of {} do not increase from frame to frame",
            input.display()
        ),
        None if are_clips(inputs, &files) => format!(
            "the times do not increase from one of the {} inputs to the next",
            inputs.len()
        ),
        None => "the times do not increase from frame to frame".to_owned(),
    };
    errln!("note: {what}: {so}");
}

/// The file of each frame.
pub(super) fn files_of<K>(batch: &Batch<K>) -> Vec<PathBuf> {
    let of = |(source, count): &(Source, usize)| {
        let path = source.path().unwrap_or(Path::new(""));
        std::iter::repeat_n(path.to_owned(), *count)
    };
    batch.sources.iter().flat_map(of).collect()
}

/// The input that a file is of.
fn input_of<'a>(inputs: &'a [PathBuf], path: &Path) -> Option<&'a PathBuf> {
    inputs.iter().find(|input| path.starts_with(input))
}

/// All inputs as one name.
pub(super) fn named(inputs: &[PathBuf]) -> PathBuf {
    let names: Vec<String> = inputs.iter().map(|i| i.display().to_string()).collect();
    match &names[..] {
        [first, _, _, rest @ ..] if !rest.is_empty() => {
            format!("{first} and {} more", names.len() - 1).into()
        }
        _ => names.join(", ").into(),
    }
}

/// Whether inputs are clips, rather than the frames of one.
fn are_clips(inputs: &[PathBuf], files: &[PathBuf]) -> bool {
    (2..files.len()).contains(&inputs.len())
}

/// The names of all frames, with those of their clips where there are several.
pub(super) fn names<K>(batch: &Batch<K>, inputs: &[PathBuf]) -> Vec<String> {
    let files = files_of(batch);
    let are_clips = are_clips(inputs, &files);
    let named = batch.frames.iter().zip(&files).map(|(frame, file)| {
        let input = input_of(inputs, file).filter(|_| are_clips);
        let of = input.map_or(String::new(), |input| format!(" of {}", input.display()));
        format!("{}{of}", frame.name)
    });
    named.collect()
}

/// Of several inputs, how many frames of each are what `what` says, as the end of a sentence; nothing of one, and where all are.
pub(super) fn by_input(
    inputs: &[PathBuf],
    files: &[PathBuf],
    what: &str,
    is: impl Fn(usize) -> bool,
) -> String {
    if !are_clips(inputs, files) || (0..files.len()).all(&is) {
        return String::new();
    }
    let count = |input: &PathBuf| {
        let own = (0..files.len()).filter(|k| input_of(inputs, &files[*k]) == Some(input));
        let (are, of) = own.fold((0, 0), |(are, of), k| (are + usize::from(is(k)), of + 1));
        format!("{} {are} of {of}", input.display())
    };
    let each: Vec<String> = inputs.iter().take(MAX_NAMED).map(count).collect();
    let more = if inputs.len() > MAX_NAMED {
        ", ..."
    } else {
        ""
    };
    format!("; frames {what}: {}{more}", each.join(", "))
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
        TimeSource::Stated => "as stated with the frames".into(),
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
