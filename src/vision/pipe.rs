//! Frames from a pipe, as they come: raw video of one size, or image files one after another.
//!
//! Image files end where their format says: PNG after the chunk `IEND`, JPEG after the marker `EOI`,
//! binary PGM and PPM after their pixels (8 or 16 bits). So `ffmpeg -f image2pipe`, a camera's MJPEG
//! stream and `cat *.png` all serve. Raw video has no header; its size and channels are given.
//!
//! Guarantees: a frame is handed out as soon as its last byte has arrived; memory does not grow with
//! the number of frames; a stream that ends within a frame is an error. Not guaranteed: to find the
//! next frame after bytes that are no image.

use std::io::{BufRead, Read};
use std::path::PathBuf;
use std::time::Instant;

use super::estimator::FrameImage;
use super::image::{GrayImage, RgbImage, luma};
use super::picture::DEFAULT_MAX_PIXELS;
use super::raw::RawImage;
pub use super::raw::RawPixel;
use crate::error::{Error, Result, require};

/// The largest image file that is read, bytes.
const MAX_BYTES: usize = 1 << 30;
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// What comes through the pipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PipeFormat {
    /// Image files, each of any size.
    Images,
    /// Raw video, row after row from the top.
    Raw {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// The bytes of a pixel.
        pixel: RawPixel,
    },
}

/// Reads frames from a pipe.
#[derive(Debug)]
pub struct PipeReader<R> {
    input: R,
    /// The input's name in messages.
    name: PathBuf,
    format: PipeFormat,
    frames: usize,
    frame: FrameBuffer,
}

/// A frame that owns its memory, which is reused.
#[derive(Debug)]
pub struct FrameBuffer {
    held: Held,
    bytes: Vec<u8>,
    gray: GrayImage,
    color: RgbImage,
    arrived: Instant,
}

/// What a buffer holds.
#[derive(Debug, Clone, Copy)]
enum Held {
    Nothing,
    Gray,
    Color,
    Raw {
        width: usize,
        height: usize,
        pixel: RawPixel,
    },
}

impl Default for FrameBuffer {
    fn default() -> Self {
        Self {
            held: Held::Nothing,
            bytes: Vec::new(),
            gray: GrayImage::default(),
            color: RgbImage::default(),
            arrived: Instant::now(),
        }
    }
}

impl FrameBuffer {
    /// When the last byte of the frame had arrived.
    pub fn arrived(&self) -> Instant {
        self.arrived
    }

    /// The frame.
    ///
    /// # Errors
    /// [`Error::Argument`] where no frame was read into the buffer.
    pub fn image(&self) -> Result<FrameImage<'_>> {
        match self.held {
            Held::Nothing => Err(Error::argument("frame", "expected one, found none")),
            Held::Gray => Ok(FrameImage::Gray(&self.gray)),
            Held::Color => Ok(FrameImage::Color(&self.color)),
            Held::Raw {
                width,
                height,
                pixel,
            } => RawImage::new(width, height, pixel, &self.bytes).map(FrameImage::Raw),
        }
    }
}

impl<R: BufRead> PipeReader<R> {
    /// A reader of `input`; `name` is for messages.
    ///
    /// # Errors
    /// [`Error::Argument`] for raw frames without pixels, or with too many.
    pub fn new(input: R, name: impl Into<PathBuf>, format: PipeFormat) -> Result<Self> {
        if let PipeFormat::Raw { width, height, .. } = format {
            let pixels = (width as u64).saturating_mul(height as u64);
            let expected = format!("1 to {DEFAULT_MAX_PIXELS} pixels");
            let found = format_args!("{width} x {height}");
            require(
                (1..=DEFAULT_MAX_PIXELS).contains(&pixels),
                "raw",
                &expected,
                found,
            )?;
        }
        Ok(Self {
            input,
            name: name.into(),
            format,
            frames: 0,
            frame: FrameBuffer::default(),
        })
    }

    /// Number of frames handed out.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The next frame; `None` at the end of the input.
    ///
    /// # Errors
    /// [`Error::Read`] where the input cannot be read, [`Error::Input`] where it holds no image or
    /// ends within one.
    pub fn next_frame(&mut self) -> Result<Option<FrameImage<'_>>> {
        if !self.read()? {
            return Ok(None);
        }
        self.frame.image().map(Some)
    }

    /// Reads the next frame into `buffer`, whose memory is used; false at the end of the input.
    ///
    /// # Errors
    /// As [`PipeReader::next_frame`].
    pub fn next_into(&mut self, buffer: &mut FrameBuffer) -> Result<bool> {
        std::mem::swap(&mut self.frame, buffer);
        let read = self.read();
        std::mem::swap(&mut self.frame, buffer);
        read
    }

    fn read(&mut self) -> Result<bool> {
        let first = self.input.fill_buf();
        let at_end = first.map_err(|e| Error::read(&self.name, e))?.is_empty();
        if at_end {
            return Ok(false);
        }
        self.frame.held = Held::Nothing;
        self.frame.bytes.clear();
        if let PipeFormat::Raw {
            width,
            height,
            pixel,
        } = self.format
        {
            self.take(width * height * pixel.bytes())?;
            self.frame.arrived = Instant::now();
            self.frame.held = Held::Raw {
                width,
                height,
                pixel,
            };
        } else {
            let is_gray = self.next_image()?;
            self.frame.held = if is_gray { Held::Gray } else { Held::Color };
        }
        self.frames += 1;
        Ok(true)
    }

    fn error(&self, problem: impl Into<String>) -> Error {
        Error::input(&self.name, format!("frame {}", self.frames), problem)
    }

    /// Reads so many more bytes.
    fn take(&mut self, count: usize) -> Result<()> {
        let held = self.frame.bytes.len();
        if held.saturating_add(count) > MAX_BYTES {
            return Err(self.error("expected an image of less than a gigabyte"));
        }
        // No more memory than has arrived: a header may lie.
        let read = (&mut self.input)
            .take(count as u64)
            .read_to_end(&mut self.frame.bytes);
        match read {
            Ok(read) if read == count => Ok(()),
            Ok(_) => Err(self.error("the input ends within it")),
            Err(e) => Err(Error::read(&self.name, e)),
        }
    }

    /// Reads one image file; whether it is gray.
    fn next_image(&mut self) -> Result<bool> {
        self.take(2)?;
        match self.frame.bytes[..2] {
            [b'P', b'5'] => self.next_pnm(RawPixel::Gray),
            [b'P', b'6'] => self.next_pnm(RawPixel::Rgb),
            [0x89, b'P'] => self.rest_of_png(),
            [0xff, 0xd8] => self.rest_of_jpeg(),
            _ => Err(self.error(
                "expected a PNG, JPEG, PGM or PPM image, found none of them (raw video needs its size)",
            )),
        }
    }

    fn rest_of_png(&mut self) -> Result<bool> {
        self.take(PNG.len() - 2)?;
        if self.frame.bytes != PNG {
            return Err(self.error("expected a PNG image, found half its signature"));
        }
        loop {
            // Length, type, data, checksum.
            self.take(8)?;
            let chunk = &self.frame.bytes[self.frame.bytes.len() - 8..];
            let length = u32::from_be_bytes([chunk[0], chunk[1], chunk[2], chunk[3]]);
            let is_last = &chunk[4..] == b"IEND";
            self.take(length as usize + 4)?;
            if is_last {
                return self.decode();
            }
        }
    }

    fn rest_of_jpeg(&mut self) -> Result<bool> {
        let mut marker = self.next_marker(false)?;
        loop {
            match marker {
                0xd9 => return self.decode(),
                // Stand-alone markers.
                0x01 | 0xd0..=0xd7 => marker = self.next_marker(false)?,
                _ => {
                    self.take(2)?;
                    let length = &self.frame.bytes[self.frame.bytes.len() - 2..];
                    let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
                    self.take(length.saturating_sub(2))?;
                    // After the start of a scan come its data.
                    marker = self.next_marker(marker == 0xda)?;
                }
            }
        }
    }

    /// The next marker of a JPEG, after a scan's data where there are some.
    fn next_marker(&mut self, after_data: bool) -> Result<u8> {
        loop {
            self.take(1)?;
            if self.frame.bytes.last() != Some(&0xff) {
                if after_data {
                    continue;
                }
                return Err(self.error("expected a JPEG marker, found other data"));
            }
            let mut code = 0xff;
            while code == 0xff {
                self.take(1)?;
                code = self.frame.bytes.last().copied().unwrap_or_default();
            }
            match code {
                // A data byte of 255, or a restart within the data.
                0x00 | 0xd0..=0xd7 if after_data => {}
                0x00 => return Err(self.error("expected a JPEG marker, found a zero")),
                code => return Ok(code),
            }
        }
    }

    fn decode(&mut self) -> Result<bool> {
        self.frame.arrived = Instant::now();
        let name = format!("{}: frame {}", self.name.display(), self.frames);
        self.frame.color = RgbImage::decode(name.as_ref(), &self.frame.bytes)?;
        Ok(false)
    }

    fn next_pnm(&mut self, pixel: RawPixel) -> Result<bool> {
        let mut header = [0usize; 3];
        for number in &mut header {
            *number = self.number()?;
        }
        let [width, height, max_value] = header;
        let pixels = (width as u64).saturating_mul(height as u64);
        if pixels == 0 || pixels > DEFAULT_MAX_PIXELS || !(1..=65_535).contains(&max_value) {
            return Err(self.error(format!(
                "expected 1 to {DEFAULT_MAX_PIXELS} pixels of up to 16 bits, found {width} x {height} of 0 to {max_value}"
            )));
        }
        let depth = if max_value > 255 { 2 } else { 1 };
        self.frame.bytes.clear();
        self.take(width * height * pixel.bytes() * depth)?;
        self.frame.arrived = Instant::now();
        Ok(self.fill(width, height, pixel, max_value, depth))
    }

    /// A number of a header, and the one byte of white space after it.
    fn number(&mut self) -> Result<usize> {
        let mut text = String::new();
        let mut in_comment = false;
        loop {
            self.take(1)?;
            let byte = self.frame.bytes.last().copied().unwrap_or_default();
            match byte {
                b'\n' if in_comment => in_comment = false,
                _ if in_comment => {}
                b'#' => in_comment = true,
                b'0'..=b'9' if text.len() < 9 => text.push(char::from(byte)),
                _ if byte.is_ascii_whitespace() => {
                    if let Ok(number) = text.parse() {
                        return Ok(number);
                    }
                }
                _ => return Err(self.error("expected a number in the image's header")),
            }
        }
    }

    /// Makes an image of the bytes; whether it is gray.
    fn fill(
        &mut self,
        width: usize,
        height: usize,
        pixel: RawPixel,
        max_value: usize,
        depth: usize,
    ) -> bool {
        let scale = max_value as f32;
        let bytes = &self.frame.bytes;
        let value = |i: usize| {
            let sample = match depth {
                2 => u16::from_be_bytes([bytes[2 * i], bytes[2 * i + 1]]),
                _ => u16::from(bytes[i]),
            };
            (f32::from(sample) / scale).min(1.0)
        };
        let color = |order: [usize; 3]| {
            move |u: usize, v: usize| order.map(|c| value(3 * (v * width + u) + c))
        };
        match pixel {
            RawPixel::Gray => self
                .frame
                .gray
                .fill_with(width, height, |u, v| luma([value(v * width + u); 3])),
            RawPixel::Rgb => self.frame.color.fill_with(width, height, color([0, 1, 2])),
            RawPixel::Bgr => self.frame.color.fill_with(width, height, color([2, 1, 0])),
        }
        pixel == RawPixel::Gray
    }
}
