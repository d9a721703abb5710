//! Where frames come from: image files ([`files`]), videos ([`video`]), memory ([`held`]), pipes ([`pipe`]), and cameras that do
//! not wait ([`grab`]).
//!
//! All of them are a [`FrameSource`]: a [`Frame`] has its pixels and, where the source knows it, its time. Who reads
//! frames hands in the memory that they are read into.
//!
//! Guarantees: frames come in the order in which they were taken, each once; memory does not grow with their number.

pub mod files;
pub mod grab;
pub mod held;
pub mod pipe;
mod stack;
pub mod video;

use std::path::Path;
use std::path::PathBuf;
use std::time::Instant;

use crate::error::Result;
use crate::image::Picture;
use video::VideoClock;

/// A frame, and the memory that it is read into.
#[derive(Debug)]
pub struct Frame {
    /// Its number among those of the source, from 0; those that were dropped count.
    pub number: u64,
    /// The file's stem, or the video's with the frame's number; nothing for a frame of a pipe.
    pub name: String,
    /// The file; a video's frame is named as if it were a file beside the video.
    pub path: PathBuf,
    /// Seconds, where the source knows it: as a file's name says, as a video states (see [`VideoClock::time_scale`]),
    /// or since the first frame of a pipe had arrived.
    pub time_s: Option<f64>,
    /// When its last byte had arrived.
    pub arrived: Instant,
    /// The picture, or why a file of the source is none; others may follow it.
    pub picture: Result<Picture>,
}

impl Default for Frame {
    /// Memory for a frame.
    fn default() -> Self {
        Self {
            number: 0,
            name: String::new(),
            path: PathBuf::new(),
            time_s: None,
            arrived: Instant::now(),
            picture: Ok(Picture::default()),
        }
    }
}

impl Frame {
    /// Puts what `how` makes of the picture in its place, where there is one.
    pub fn convert(&mut self, how: impl FnOnce(Picture) -> Result<Picture>) {
        let picture = std::mem::replace(&mut self.picture, Ok(Picture::default()));
        self.picture = picture.and_then(how);
    }
}

/// What a source knows after its last frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SourceEnd {
    /// The clock of a video.
    pub clock: Option<VideoClock>,
    /// Why a video ends early, where it does.
    pub cut_short: Option<String>,
    /// Whether the frames' times were stated with them, as those of frames in memory are.
    pub is_stated: bool,
}

/// Hands out frames one by one.
pub trait FrameSource {
    /// Reads the next frame into `frame`, once it is there; false at the end.
    ///
    /// # Errors
    /// Those of the source, after the frames that came before; nothing follows them.
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool>;

    /// What is known after the last frame, and nothing before.
    fn end(&self) -> SourceEnd {
        SourceEnd::default()
    }

    /// The frames that are left, each in memory of its own.
    fn frames(&mut self) -> Frames<'_, Self>
    where
        Self: Sized,
    {
        Frames(self)
    }
}

impl<S: FrameSource + ?Sized> FrameSource for Box<S> {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool> {
        (**self).next_frame(frame)
    }

    fn end(&self) -> SourceEnd {
        (**self).end()
    }
}

/// The frames of a source, up to its end or an error.
#[derive(Debug)]
pub struct Frames<'a, S>(&'a mut S);

impl<S: FrameSource> Iterator for Frames<'_, S> {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut frame = Frame::default();
        let read = self.0.next_frame(&mut frame);
        read.map(|read| read.then_some(frame)).transpose()
    }
}

/// A file's name without its ending.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}
