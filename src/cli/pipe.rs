//! Frames of a pipe, which `live` and `calibrate --live` read as they come.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::image::RawPixel;
use crate::source::grab::{Grabber, WhenFull};
use crate::source::pipe::{PipeFormat, PipeReader};
use crate::source::{Frame, FrameSource};

/// Frames of standard input or of a file.
pub(super) struct Pipe {
    /// What it is called.
    pub name: PathBuf,
    grabber: Grabber,
    fps: Option<f64>,
}

impl Pipe {
    /// The one input of `paths`, as `flag` asks for it. Without `fps` frames have the times of their arrival, and the oldest are dropped
    /// where they come too fast.
    pub fn open(
        flag: &'static str,
        paths: &[PathBuf],
        raw: Option<PipeFormat>,
        fps: Option<f64>,
        max_pixels: u64,
    ) -> Result<Self> {
        let [path] = paths else {
            let problem = "expected one input, a file or - for standard input";
            return Err(Error::argument(flag, problem));
        };
        let input = super::open_input(path)?;
        let format = raw.unwrap_or(PipeFormat::Images);
        if fps.is_none() && is_file(path) {
            let problem = "expected for a file: its frames do not arrive at their times";
            return Err(Error::argument("--fps", problem));
        }
        let reader = PipeReader::new(input.reader, &input.name, format, max_pixels)?;
        let when_full = fps.map_or(WhenFull::DropOldest, |_| WhenFull::Wait);
        Ok(Self {
            name: input.name,
            grabber: Grabber::start(reader, when_full)?,
            fps,
        })
    }

    /// The next frame, and its time in seconds; `None` at the end.
    pub fn next_frame(&mut self, frame: &mut Frame) -> Result<Option<f64>> {
        if !self.grabber.next_frame(frame)? {
            return Ok(None);
        }
        let by_rate = self.fps.map(|rate| frame.number as f64 / rate);
        Ok(Some(by_rate.or(frame.time_s).unwrap_or_default()))
    }

    /// How many frames were dropped.
    pub fn dropped(&self) -> u64 {
        self.grabber.dropped()
    }

    /// Says how many frames were dropped beside these.
    pub fn say_dropped(&self, taken: u64) {
        let dropped = self.dropped();
        if dropped > 0 {
            errln!(
                "{}: warning: {dropped} of {} frames came faster than they can be processed, and were dropped",
                self.name.display(),
                taken + dropped
            );
        }
    }
}

/// Parses `WxH,PIXEL`.
pub(super) fn pipe_format(text: &str) -> std::result::Result<PipeFormat, String> {
    let expected = "expected columns, rows and channels as in 640x480,gray (or rgb, bgr)";
    let (size, pixel) = text.split_once(',').ok_or(expected)?;
    let (width, height) = size.split_once('x').ok_or(expected)?;
    Ok(PipeFormat::Raw {
        width: width.trim().parse().map_err(|_| expected)?,
        height: height.trim().parse().map_err(|_| expected)?,
        pixel: pixel.trim().parse::<RawPixel>().map_err(|_| expected)?,
    })
}

/// Whether an input is a file rather than a pipe.
fn is_file(path: &Path) -> bool {
    let path = if path == Path::new("-") {
        Path::new("/dev/stdin")
    } else {
        path
    };
    std::fs::metadata(path).is_ok_and(|meta| meta.is_file())
}
