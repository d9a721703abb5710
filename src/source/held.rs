//! Frames in memory: a source like files, read one by one and, where a clip's pass asks for it, again.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use super::{Frame, FrameSource, SourceEnd};
use crate::error::{Error, Result};
use crate::image::Picture;

/// Pictures that someone has in memory.
pub trait HeldPictures: Send + Sync {
    /// How many there are.
    fn count(&self) -> usize;

    /// A copy of the picture with this number, less than [`HeldPictures::count`]. It may be asked for more than once, from any thread.
    ///
    /// # Errors
    /// Those of whoever has it: the frame is then one that cannot be read.
    fn picture(&self, number: usize) -> Result<Picture>;
}

impl HeldPictures for Vec<Picture> {
    fn count(&self) -> usize {
        self.len()
    }

    fn picture(&self, number: usize) -> Result<Picture> {
        Ok(self.get(number).cloned().unwrap_or_default())
    }
}

/// Frames in memory, and where they are stated their times. They are named by their numbers.
#[derive(Clone)]
pub struct HeldFrames {
    pictures: Arc<dyn HeldPictures>,
    times_s: Option<Arc<[f64]>>,
}

impl HeldFrames {
    /// Frames without times.
    pub fn new(pictures: impl HeldPictures + 'static) -> Self {
        Self {
            pictures: Arc::new(pictures),
            times_s: None,
        }
    }

    /// The same at these times, seconds.
    ///
    /// # Errors
    /// [`Error::Argument`] where there is not one for each frame.
    pub fn at(self, times_s: &[f64]) -> Result<Self> {
        let count = self.pictures.count();
        if times_s.len() != count {
            let problem = format!(
                "expected one for each of {count} frames, found {}",
                times_s.len()
            );
            return Err(Error::argument("times_s", problem));
        }
        Ok(Self {
            times_s: Some(times_s.into()),
            ..self
        })
    }

    /// Number of frames.
    pub fn count(&self) -> usize {
        self.pictures.count()
    }

    /// The frames from the first on.
    pub(super) fn open(&self) -> HeldSource {
        HeldSource {
            frames: self.clone(),
            next: 0,
        }
    }
}

impl fmt::Debug for HeldFrames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("HeldFrames")
            .field("count", &self.count())
            .field("times_s", &self.times_s)
            .finish()
    }
}

/// Whether they are the same frames, not whether these look alike.
impl PartialEq for HeldFrames {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.pictures, &other.pictures) && self.times_s == other.times_s
    }
}

/// Reads them.
pub(super) struct HeldSource {
    frames: HeldFrames,
    next: usize,
}

impl FrameSource for HeldSource {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool> {
        let number = self.next;
        if number >= self.frames.count() {
            return Ok(false);
        }
        self.next += 1;
        let name = number.to_string();
        let times_s = self.frames.times_s.as_ref();
        *frame = Frame {
            number: number as u64,
            path: PathBuf::from(&name),
            name,
            time_s: times_s.and_then(|times| times.get(number).copied()),
            picture: self.frames.pictures.picture(number),
            ..Frame::default()
        };
        Ok(true)
    }

    fn end(&self) -> SourceEnd {
        SourceEnd {
            is_stated: self.frames.times_s.is_some(),
            ..SourceEnd::default()
        }
    }
}
