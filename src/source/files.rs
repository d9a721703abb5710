//! The files that hold frames: images, folders of them and videos, in the order in which they were taken.
//!
//! Folders are read for files with the extension of an image; hidden files are none. Names are sorted by number and not by
//! letter: runs of digits compare as numbers, so that "3333333" comes before "103333323". Images
//! and videos whose metadata says that the camera was rotated are rotated upright. Times: a file's
//! stem as an integer is nanoseconds (SpinDOE's convention); a video's frames have the container's
//! own time stamps, even or not; the pages of a TIFF file and the pictures of an animation have none; [`frame_table`](crate::clip::frame_table) reads others from a table.
//! [`video`](super::video) reads the frames of videos.

use std::cmp::Ordering;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::held::HeldFrames;
use super::video::VideoSource;
use super::{Frame, FrameSource, stack, stem};
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::image::animation::{self, Animation};

/// Endings of image files, lower case.
const IMAGES: [&str; 12] = [
    "png", "jpg", "jpeg", "bmp", "tif", "tiff", "pgm", "ppm", "pnm", "pbm", "gif", "webp",
];
/// Endings of video files, lower case.
const VIDEOS: [&str; 36] = [
    "mp4", "avi", "mov", "mkv", "webm", "m4v", "mpg", "mpeg", "wmv", "ts", "mts", "m2ts", "3gp",
    "3g2", "flv", "ogv", "mxf", "nut", "ivf", "y4m", "asf", "vob", "mj2", "qt", "f4v", "h264",
    "264", "h265", "265", "hevc", "mjpeg", "mjpg", "m1v", "m2v", "obu", "av1",
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

/// The first of these names that is a number, though no plain whole one: with a point, an exponent or a
/// sign, or hexadecimal, also after a word. Such names have an order of their own, which the natural one is
/// not.
pub fn unusual_number<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Option<&'a str> {
    let is_plain = |name: &str| digits(name) == name.len();
    let is_number = |name: &str| {
        let hexadecimal = name.strip_prefix("0x").or(name.strip_prefix("0X"));
        let number = || name.parse::<f64>().is_ok_and(f64::is_finite);
        hexadecimal.is_some_and(is_hexadecimal) || number()
    };
    // Without a prefix, letters that stay the same are a name: a1, a2.
    let letters =
        |name: &str| -> String { name.chars().filter(char::is_ascii_alphabetic).collect() };
    let mut all = names.clone();
    let is_bare = names.clone().all(is_hexadecimal)
        && all
            .next()
            .is_some_and(|first| all.any(|other| letters(other) != letters(first)));
    // What follows a word has no sign: frame-1, frame-2.
    let after_word = |name: &'a str| match name.starts_with(|c: char| c.is_alphabetic()) {
        true => name.trim_start_matches(|c: char| !c.is_ascii_digit()),
        false => name,
    };
    let mut names = names;
    names.find(|name| {
        let number = after_word(name);
        !is_plain(number) && (is_number(number) || is_bare && number.len() == name.len())
    })
}

fn is_hexadecimal(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_hexdigit())
}

/// The time of a file whose stem is an integer number of nanoseconds, seconds.
pub fn time_of_stem(stem: &str) -> Option<f64> {
    crate::files::nanoseconds(stem).map(|ns| ns as f64 / 1e9)
}

/// What frames are read from.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// One image.
    Image(PathBuf),
    /// A video.
    Video(PathBuf),
    /// Frames in memory.
    Held(HeldFrames),
}

impl Source {
    /// The file, where it is one.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::Image(path) | Self::Video(path) => Some(path),
            Self::Held(_) => None,
        }
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
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SourceList {
    /// The sources, in order.
    pub sources: Vec<Source>,
    /// What is passed over.
    pub skipped: Vec<SkippedFiles>,
}

impl From<HeldFrames> for SourceList {
    fn from(frames: HeldFrames) -> Self {
        Self {
            sources: vec![Source::Held(frames)],
            skipped: Vec::new(),
        }
    }
}

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
        let path = &frames_of(path);
        for entry in std::fs::read_dir(path).map_err(|e| Error::read(path, e))? {
            let file = entry.map_err(|e| Error::read(path, e))?.path();
            let name = file.file_name().unwrap_or_default();
            if name.as_encoded_bytes().starts_with(b".") {
                // What a system keeps for itself, such as macOS beside each file of a copied folder.
                continue;
            }
            if has_ending(&file, &IMAGES) && file.is_file() {
                found.push(file);
            } else {
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

/// Where a folder has its frames: in `images` where [`synth`](crate::synth) wrote it, with a sheet of some of them
/// beside.
fn frames_of(folder: &Path) -> PathBuf {
    let images = folder.join("images");
    match images.is_dir() && folder.join("index.csv").is_file() {
        true => images,
        false => folder.to_path_buf(),
    }
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

/// The frames of a source, pictures of up to `max_pixels` pixels. A file that is no image comes as a frame with the
/// reason.
///
/// # Errors
/// [`Error::Input`] where a video cannot be decoded since `ffmpeg` is not there.
pub fn open(source: &Source, max_pixels: u64) -> Result<Box<dyn FrameSource + Send>> {
    Ok(match source {
        Source::Image(path) => Box::new(ImageFile {
            path: path.clone(),
            max_pixels,
            read: 0,
            several: None,
        }),
        Source::Video(path) => Box::new(VideoSource::open(path, max_pixels)?),
        Source::Held(frames) => Box::new(frames.open()),
    })
}

/// How many frames a source has, as far as that can be known without decoding them.
pub fn frame_count(source: &Source) -> Option<usize> {
    let path = match source {
        Source::Image(path) => path,
        Source::Video(_) => return None,
        Source::Held(frames) => return Some(frames.count()),
    };
    // Others hold one picture.
    if !has_ending(path, &["png", "gif", "webp", "tif", "tiff"]) {
        return Some(1);
    }
    let mut start = Vec::new();
    let file = std::fs::File::open(path).ok()?;
    if file.metadata().ok()?.len() > MAX_COUNTED {
        return None;
    }
    file.take(animation::START).read_to_end(&mut start).ok()?;
    let is_tiff = stack::is_tiff(&start);
    if !is_tiff && !animation::may_be(&start) {
        return Some(1);
    }
    let bytes = crate::files::read_at_most(path, MAX_COUNTED).ok()?;
    match is_tiff {
        true => Some(stack::pages(&bytes).len()),
        false => animation::pictures(&bytes),
    }
}

/// An image file: one picture, the pages of a TIFF file, or the pictures of an animation.
struct ImageFile {
    path: PathBuf,
    max_pixels: u64,
    read: usize,
    several: Option<Several>,
}

/// What a file of several pictures holds.
enum Several {
    Pages { bytes: Vec<u8>, pages: Vec<u64> },
    Animation(Animation),
}

/// Bytes of the largest file whose pictures are counted beforehand.
const MAX_COUNTED: u64 = 64 << 20;
/// Bytes of the largest file of several pictures.
const MAX_SEVERAL: u64 = 4 << 30;

impl ImageFile {
    /// What the file holds; none for a file of one picture, and for one that is neither.
    fn several(&self) -> Result<Option<Several>> {
        let is_file = std::fs::metadata(&self.path).is_ok_and(|m| m.is_file());
        let start = || {
            let mut start = Vec::new();
            let file = std::fs::File::open(&self.path).ok()?;
            file.take(animation::START).read_to_end(&mut start).ok()?;
            Some(start)
        };
        // What cannot be read is said when its picture is.
        let Some(start) = is_file.then(start).flatten() else {
            return Ok(None);
        };
        let (is_tiff, may_be_animation) = (stack::is_tiff(&start), animation::may_be(&start));
        if !is_tiff && !may_be_animation {
            return Ok(None);
        }
        let bytes = crate::files::read_at_most(&self.path, MAX_SEVERAL)?;
        if is_tiff {
            let pages = stack::pages(&bytes);
            return Ok((pages.len() > 1).then_some(Several::Pages { bytes, pages }));
        }
        let all = animation::is_animation(&bytes)
            .then(|| Animation::new(&self.path, bytes, self.max_pixels));
        Ok(all.transpose()?.map(Several::Animation))
    }
}

impl FrameSource for ImageFile {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool> {
        let name = stem(&self.path);
        let k = self.read;
        self.read += 1;
        let mut failed = None;
        if k == 0 {
            match self.several() {
                Ok(several) => self.several = several,
                Err(error) => failed = Some(error),
            }
        }
        let picture = match &mut self.several {
            None => None,
            Some(Several::Pages { bytes, pages }) => {
                let page = pages.get(k);
                Some(page.map(|page| stack::read_page(&self.path, bytes, *page, self.max_pixels)))
            }
            Some(Several::Animation(all)) => Some(all.next_picture()),
        };
        if let Some(picture) = picture {
            let Some(picture) = picture else {
                return Ok(false);
            };
            let name = format!("{name}_{:06}", self.read);
            *frame = Frame {
                path: self.path.with_file_name(&name),
                name,
                picture,
                ..Frame::default()
            };
            return Ok(true);
        }
        if k > 0 {
            return Ok(false);
        }
        *frame = Frame {
            time_s: time_of_stem(&name),
            name,
            path: self.path.clone(),
            picture: match failed {
                Some(error) => Err(error),
                None => Picture::read(&self.path, self.max_pixels),
            },
            ..Frame::default()
        };
        Ok(true)
    }
}
