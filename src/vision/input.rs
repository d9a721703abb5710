//! Images as people have them: files, folders, videos, in the order in which they were taken.
//!
//! Folders are read for files with the ending of an image. Everything is sorted by number and not by letter: runs of digits
//! compare as numbers, so that "3333333" comes before "103333323". Times: a file's stem as an integer is nanoseconds
//! (SpinDOE's convention); a video's frames have their own. Videos are decoded by `ffmpeg`, which must be installed.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::image::{MAX_PIXELS, RgbImage};
use crate::error::{Error, Result};
use crate::files;

/// Endings of image files, lower case.
const IMAGES: [&str; 10] = [
    "png", "jpg", "jpeg", "bmp", "tif", "tiff", "pgm", "ppm", "pnm", "pbm",
];
/// Endings of video files, lower case.
const VIDEOS: [&str; 9] = [
    "mp4", "avi", "mov", "mkv", "webm", "m4v", "mpg", "mpeg", "wmv",
];

/// Compares names as people do: runs of digits as numbers, the rest by letter. Names that differ in leading
/// zeros alone are told apart by these.
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
    /// Seconds, where the name says it.
    pub time_s: Option<f64>,
    /// The picture.
    pub image: RgbImage,
}

/// The sources behind files and folders, in order. A file that is named is taken whatever its ending.
///
/// # Errors
/// [`Error::Read`] where a path cannot be read, [`Error::Input`] for a folder without images.
pub fn sources(paths: &[PathBuf]) -> Result<Vec<Source>> {
    let mut found = Vec::new();
    for path in paths {
        let kind = std::fs::metadata(path).map_err(|e| Error::read(path, e))?;
        if !kind.is_dir() {
            found.push(path.clone());
            continue;
        }
        let before = found.len();
        for entry in std::fs::read_dir(path).map_err(|e| Error::read(path, e))? {
            let file = entry.map_err(|e| Error::read(path, e))?.path();
            if has_ending(&file, &IMAGES) && file.is_file() {
                found.push(file);
            }
        }
        if found.len() == before {
            let problem = format!("expected images ({}), found none", IMAGES.join(", "));
            return Err(Error::input(path, "folder", problem));
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
    Ok(found.into_iter().map(source).collect())
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    ending.is_some_and(|e| endings.contains(&e.as_str()))
}

fn stem(path: &Path) -> String {
    path.file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

/// Hands over the frames of a source one by one. A video's times are known at its end only: they are returned, one a
/// frame, empty for an image.
///
/// # Errors
/// Those of reading and decoding, and of `visit`.
pub fn read_frames(
    source: &Source,
    visit: &mut dyn FnMut(InputFrame) -> Result<()>,
) -> Result<Vec<Option<f64>>> {
    match source {
        Source::Image(path) => {
            let name = stem(path);
            visit(InputFrame {
                time_s: time_of_stem(&name),
                name,
                image: RgbImage::read(path)?,
            })?;
            Ok(Vec::new())
        }
        Source::Video(path) => read_video(path, visit),
    }
}

fn read_video(
    path: &Path,
    visit: &mut dyn FnMut(InputFrame) -> Result<()>,
) -> Result<Vec<Option<f64>>> {
    let mut child = Command::new("ffmpeg")
        .args(["-nostdin", "-hide_banner", "-i"])
        .arg(path)
        .args(["-map", "0:v:0", "-vf", "showinfo", "-fps_mode", "passthrough"])
        .args(["-f", "image2pipe", "-c:v", "ppm", "-"])
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
            match next_picture(path, &mut out) {
                Ok(None) => break Ok(()),
                Ok(Some(image)) => {
                    count += 1;
                    let name = format!("{name}_{count:06}");
                    let time_s = None;
                    if let Err(e) = visit(InputFrame {
                        name,
                        time_s,
                        image,
                    }) {
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
    if count == 0 || !status.success() {
        let problem = format!("ffmpeg finds no video in it: {}", log.last);
        return Err(Error::input(path, "video", problem));
    }
    let mut times = log.times;
    times.resize(count, None);
    Ok(times)
}

/// What ffmpeg says.
#[derive(Debug, Default)]
struct Log {
    times: Vec<Option<f64>>,
    last: String,
}

impl Log {
    fn read(from: impl Read) -> Self {
        let mut log = Self::default();
        for line in BufReader::new(from).lines().map_while(std::io::Result::ok) {
            if let Some((_, rest)) = line.split_once("pts_time:") {
                let time = rest.split_whitespace().next();
                log.times.push(time.and_then(|t| t.parse().ok()));
            } else if !line.trim().is_empty() {
                log.last = line;
            }
        }
        log
    }
}

/// The next picture of a stream of binary PPM files; `None` at its end.
fn next_picture(path: &Path, from: &mut impl BufRead) -> Result<Option<RgbImage>> {
    let broken =
        |what: &str| Error::input(path, "video", format!("ffmpeg's output breaks off: {what}"));
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
    let [width, height, most] = header;
    if most != 255 || (width as u64).saturating_mul(height as u64) > MAX_PIXELS {
        return Err(broken("a size or depth that is not expected"));
    }
    let mut bytes = vec![0u8; width * height * 3];
    from.read_exact(&mut bytes)
        .map_err(|_| broken("half a picture"))?;
    let value = |b: u8| f32::from(b) / 255.0;
    let colors = bytes
        .chunks_exact(3)
        .map(|c| [value(c[0]), value(c[1]), value(c[2])])
        .collect();
    RgbImage::new(width, height, colors).map(Some)
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

/// Reads a table of times: CSV with the header `frame,time_s`, `frame` a file's name with or without ending.
///
/// # Errors
/// [`Error::Read`], or [`Error::Input`] naming the line.
pub fn read_times(path: &Path) -> Result<HashMap<String, f64>> {
    let bytes = files::read_bytes(path)?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(bytes.as_slice());
    let header = reader
        .headers()
        .map_err(|e| Error::input(path, "line 1", e.to_string()))?;
    let column = |name: &str| header.iter().position(|h| h == name);
    let (Some(frame), Some(time)) = (column("frame"), column("time_s")) else {
        return Err(Error::input(
            path,
            "line 1",
            "expected a header with frame,time_s",
        ));
    };
    let mut times = HashMap::new();
    for (i, record) in reader.records().enumerate() {
        let record = record.map_err(|e| {
            let line = files::line_of(&bytes, e.position(), i as u64 + 2);
            Error::input(path, format!("line {line}"), e.to_string())
        })?;
        let line = files::line_of(&bytes, record.position(), i as u64 + 2);
        let text = record.get(time).unwrap_or_default();
        match text.parse::<f64>() {
            Ok(t) if t.is_finite() => {
                let name = record.get(frame).unwrap_or_default();
                times.insert(name.to_owned(), t);
                times.entry(stem(Path::new(name))).or_insert(t);
            }
            _ => {
                let problem = format!("time_s: expected seconds, found \"{text}\"");
                return Err(Error::input(path, format!("line {line}"), problem));
            }
        }
    }
    Ok(times)
}
