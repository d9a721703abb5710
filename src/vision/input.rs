//! Images from files, folders and videos, in the order in which they were taken.
//!
//! Folders are read for files with the extension of an image. Names are sorted by number and not by
//! letter: runs of digits compare as numbers, so that "3333333" comes before "103333323". Images
//! and videos whose metadata says that the camera was rotated are rotated upright. Times: a file's
//! stem as an integer is nanoseconds (SpinDOE's convention); a video's frames have the container's
//! own time stamps, even or not; [`frame_table`](super::frame_table) reads others from a table. Videos are decoded by
//! `ffmpeg`, which must be installed, to 8 bits a color.
//!
//! # Slow motion
//! A phone may store 240 frames a second so that they play at 30. Where the container says at which
//! rate they were taken (`com.android.capture.fps`), the time stamps are scaled by it
//! ([`VideoClock`]); where it does not, nothing in the file tells slow motion from an ordinary
//! video.

use std::cmp::Ordering;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::picture::{Picture, RgbBytes};
use crate::error::{Error, Result};

/// Endings of image files, lower case.
const IMAGES: [&str; 10] = [
    "png", "jpg", "jpeg", "bmp", "tif", "tiff", "pgm", "ppm", "pnm", "pbm",
];
/// Endings of video files, lower case.
const VIDEOS: [&str; 9] = [
    "mp4", "avi", "mov", "mkv", "webm", "m4v", "mpg", "mpeg", "wmv",
];

/// Compares names in natural order: runs of digits as numbers, the rest by letter. Names that
/// differ only in leading zeros are ordered by these.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    loop {
        let (x, y) = (digits(left), digits(right));
        if x > 0 && y > 0 {
            let number = |s: &str| s.trim_start_matches('0').to_owned();
            let (m, n) = (number(&left[..x]), number(&right[..y]));
            let by_number = m.len().cmp(&n.len()).then_with(|| m.cmp(&n));
            if by_number != Ordering::Equal {
                return by_number;
            }
            (left, right) = (&left[x..], &right[y..]);
            continue;
        }
        match (left.chars().next(), right.chars().next()) {
            (None, None) => return a.cmp(b),
            (Some(c), Some(d)) if c == d => {
                (left, right) = (&left[c.len_utf8()..], &right[d.len_utf8()..]);
            }
            (c, d) => return c.cmp(&d),
        }
    }
}

/// Number of digits at the start, which are bytes.
fn digits(text: &str) -> usize {
    text.bytes().take_while(u8::is_ascii_digit).count()
}

/// The time of a file whose stem is an integer number of nanoseconds, seconds.
pub fn time_of_stem(stem: &str) -> Option<f64> {
    stem.parse::<u64>().ok().map(|ns| ns as f64 / 1e9)
}

/// A file to read frames from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// One image.
    Image(PathBuf),
    /// A video.
    Video(PathBuf),
}

/// A frame as read.
#[derive(Debug)]
pub struct InputFrame {
    /// The file's stem, or the video's with the frame's number.
    pub name: String,
    /// The file; a video's frame is named as if it were a file beside the video.
    pub path: PathBuf,
    /// Seconds, where the name says it.
    pub time_s: Option<f64>,
    /// The picture, or why the file is none.
    pub picture: Result<Picture>,
}

/// The times of a source's frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SourceTimes {
    /// One a frame, seconds; empty for an image.
    pub times_s: Vec<Option<f64>>,
    /// The clock of a video.
    pub clock: Option<VideoClock>,
    /// Why a video ends early, where it does.
    pub cut_short: Option<String>,
}

/// What a container says of its frames' times.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct VideoClock {
    /// Mean frames per second by the time stamps as stored.
    pub stored_fps: f64,
    /// Whether the intervals differ by more than the rounding of time stamps.
    pub is_variable: bool,
    /// Frames per second at which the camera took them, where the container says that they are
    /// stored for slow motion; the times are scaled by it.
    pub capture_fps: Option<f64>,
}

impl VideoClock {
    /// The clock behind these stored times.
    fn new(stored_s: &[Option<f64>], capture_fps: Option<f64>) -> Option<Self> {
        let times: Vec<f64> = stored_s.iter().copied().collect::<Option<_>>()?;
        let duration = times.last()? - times.first()?;
        let intervals = times.windows(2).map(|w| w[1] - w[0]);
        let (low, high) = intervals.fold((f64::INFINITY, 0f64), |(low, high), t| {
            (low.min(t), high.max(t))
        });
        if duration.is_nan() || duration <= 0.0 {
            return None;
        }
        let stored_fps = (times.len() - 1) as f64 / duration;
        Some(Self {
            stored_fps,
            // Containers round to a millisecond at the coarsest.
            is_variable: high - low > TIME_ROUNDING_S,
            capture_fps: capture_fps.filter(|c| *c > SLOW_MOTION * stored_fps),
        })
    }

    /// Seconds of the ball's motion in a second of the video.
    pub fn time_scale(&self) -> f64 {
        self.capture_fps.map_or(1.0, |c| self.stored_fps / c)
    }
}

/// Files in a folder that are no images, which are passed over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SkippedFiles {
    /// The folder.
    pub folder: PathBuf,
    /// The names, in natural order.
    pub names: Vec<String>,
}

/// What files and folders hold.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SourceList {
    /// The sources, in order.
    pub sources: Vec<Source>,
    /// What is passed over.
    pub skipped: Vec<SkippedFiles>,
}

/// Rounding of a container's time stamps, seconds, twice.
const TIME_ROUNDING_S: f64 = 2.1e-3;
/// Ratio of the rate of capture to the rate as stored from which on a video is slow motion.
const SLOW_MOTION: f64 = 1.2;

/// The sources behind files and folders, in order, and what the folders hold beside. A file that is
/// named is taken whatever its ending.
///
/// # Errors
/// [`Error::Read`] where a path cannot be read, [`Error::Input`] for a folder without images.
pub fn list_sources(paths: &[PathBuf]) -> Result<SourceList> {
    let mut found = Vec::new();
    let mut all_skipped = Vec::new();
    for path in paths {
        let kind = std::fs::metadata(path).map_err(|e| Error::read(path, e))?;
        if !kind.is_dir() {
            found.push(path.clone());
            continue;
        }
        let before = found.len();
        let mut skipped = Vec::new();
        for entry in std::fs::read_dir(path).map_err(|e| Error::read(path, e))? {
            let file = entry.map_err(|e| Error::read(path, e))?.path();
            if has_ending(&file, &IMAGES) && file.is_file() {
                found.push(file);
            } else {
                let name = file.file_name().unwrap_or_default();
                skipped.push(name.to_string_lossy().into_owned());
            }
        }
        if found.len() == before {
            let problem = format!("expected images ({}), found none", IMAGES.join(", "));
            return Err(Error::input(path, "folder", problem));
        }
        if !skipped.is_empty() {
            skipped.sort_by(|a, b| natural_order(a, b));
            all_skipped.push(SkippedFiles {
                folder: path.clone(),
                names: skipped,
            });
        }
    }
    found.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    found.dedup();
    let source = |path: PathBuf| {
        if has_ending(&path, &VIDEOS) {
            Source::Video(path)
        } else {
            Source::Image(path)
        }
    };
    Ok(SourceList {
        sources: found.into_iter().map(source).collect(),
        skipped: all_skipped,
    })
}

/// The sources of [`list_sources`] alone.
///
/// # Errors
/// Those of [`list_sources`].
pub fn sources(paths: &[PathBuf]) -> Result<Vec<Source>> {
    Ok(list_sources(paths)?.sources)
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    ending.is_some_and(|e| endings.contains(&e.as_str()))
}

pub(super) fn stem(path: &Path) -> String {
    path.file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

/// Passes the frames of a source on one by one, pictures of up to `max_pixels` pixels. A file that
/// is no image comes as a frame with the reason. A video's times are known at its end only: they
/// are returned.
///
/// # Errors
/// Those of reading a video, and of `visit`.
pub fn read_frames(
    source: &Source,
    max_pixels: u64,
    visit: &mut dyn FnMut(InputFrame) -> Result<()>,
) -> Result<SourceTimes> {
    match source {
        Source::Image(path) => {
            let name = stem(path);
            visit(InputFrame {
                time_s: time_of_stem(&name),
                name,
                path: path.clone(),
                picture: Picture::read(path, max_pixels),
            })?;
            Ok(SourceTimes::default())
        }
        Source::Video(path) => read_video(path, max_pixels, visit),
    }
}

fn read_video(
    path: &Path,
    max_pixels: u64,
    visit: &mut dyn FnMut(InputFrame) -> Result<()>,
) -> Result<SourceTimes> {
    // A name with a colon would be taken for a protocol.
    let mut file = OsString::from("file:");
    file.push(path);
    // Deeper video would come as 16-bit pictures.
    let mut child = Command::new("ffmpeg")
        .args(["-nostdin", "-hide_banner", "-i"])
        .arg(file)
        .args(["-map", "0:v:0", "-vf", "showinfo", "-fps_mode", "passthrough"])
        .args(["-f", "image2pipe", "-c:v", "ppm", "-pix_fmt", "rgb24", "-"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| {
            let problem = format!(
                "a video is read through ffmpeg, which cannot be started ({e}): install it (https://ffmpeg.org), or give a folder of images"
            );
            Error::input(path, "video", problem)
        })?;
    // Both outputs must be read at once: a full pipe would stop the other.
    let log = child.stderr.take();
    let log = std::thread::spawn(move || log.map_or_else(Log::default, Log::read));
    let name = stem(path);
    let mut count = 0usize;
    let mut done = Ok(());
    if let Some(out) = child.stdout.take() {
        let mut out = BufReader::new(out);
        done = loop {
            match next_picture(path, max_pixels, &mut out) {
                Ok(None) => break Ok(()),
                Ok(Some(picture)) => {
                    count += 1;
                    let name = format!("{name}_{count:06}");
                    let frame = InputFrame {
                        path: path.with_file_name(&name),
                        name,
                        time_s: None,
                        picture: Ok(picture),
                    };
                    if let Err(e) = visit(frame) {
                        break Err(e);
                    }
                }
                Err(e) => break Err(e),
            }
        };
    }
    if done.is_err() {
        // The reader has given up, so that the decoder has nobody to write to.
        let _ = child.kill();
    }
    let status = child.wait().map_err(|e| Error::read(path, e))?;
    let log = log.join().unwrap_or_default();
    done?;
    if count == 0 {
        let problem = format!("ffmpeg finds no video in it: {}", log.last);
        return Err(Error::input(path, "video", problem));
    }
    let mut times_s = log.times;
    times_s.resize(count, None);
    let clock = VideoClock::new(&times_s, log.capture_fps);
    if let Some(scale) = clock.map(|c| c.time_scale()) {
        let times = times_s.iter_mut().flatten();
        times.for_each(|t| *t *= scale);
    }
    Ok(SourceTimes {
        times_s,
        clock,
        cut_short: (!status.success()).then_some(log.last),
    })
}

/// What ffmpeg says.
#[derive(Debug, Default)]
struct Log {
    times: Vec<Option<f64>>,
    /// The rate of capture by the container's metadata.
    capture_fps: Option<f64>,
    last: String,
}

impl Log {
    fn read(from: impl Read) -> Self {
        let mut log = Self::default();
        for line in BufReader::new(from).lines().map_while(std::io::Result::ok) {
            if let Some((_, rest)) = line.split_once("pts_time:") {
                let time = rest.split_whitespace().next();
                log.times.push(time.and_then(|t| t.parse().ok()));
            } else if let Some((_, rest)) = line.split_once("com.android.capture.fps") {
                let rate = rest.trim_start_matches([' ', ':']).trim().parse().ok();
                log.capture_fps = rate.filter(|r: &f64| *r > 0.0 && r.is_finite());
            } else if !line.trim().is_empty() {
                log.last = line;
            }
        }
        log
    }
}

/// The next picture of a stream of binary PPM files; `None` at its end.
fn next_picture(path: &Path, max_pixels: u64, from: &mut impl BufRead) -> Result<Option<Picture>> {
    let broken =
        |what: &str| Error::input(path, "video", format!("ffmpeg's output ends early: {what}"));
    let mut header = [0usize; 3];
    match token(from).as_deref() {
        None => return Ok(None),
        Some("P6") => {}
        Some(_) => return Err(broken("no picture")),
    }
    for number in &mut header {
        let text = token(from).ok_or_else(|| broken("no size"))?;
        *number = text.parse().map_err(|_| broken("no size"))?;
    }
    let [width, height, max_value] = header;
    if (width as u64).saturating_mul(height as u64) > max_pixels {
        let problem = format!(
            "expected at most {max_pixels} pixels, found {width} x {height} (--max-pixels allows more)"
        );
        return Err(Error::input(path, "video", problem));
    }
    if max_value != 255 {
        return Err(broken("a depth that is not expected"));
    }
    let mut bytes = vec![0u8; width * height * 3];
    from.read_exact(&mut bytes)
        .map_err(|_| broken("half a picture"))?;
    RgbBytes::new(width, height, bytes).map(|bytes| Some(Picture::Bytes(bytes)))
}

/// A word of a PPM header and the white space after it.
fn token(from: &mut impl Read) -> Option<String> {
    let mut word = String::new();
    let mut byte = [0u8];
    while from.read_exact(&mut byte).is_ok() {
        if byte[0].is_ascii_whitespace() {
            if !word.is_empty() {
                break;
            }
        } else if word.len() < 20 {
            word.push(char::from(byte[0]));
        }
    }
    (!word.is_empty()).then_some(word)
}
