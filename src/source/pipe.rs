//! Frames from a pipe, as they come: raw video of one size, or image files one after another.
//!
//! Image files end where their format says: PNG after the chunk `IEND`, JPEG after the marker `EOI`,
//! binary PGM and PPM after their pixels (8 or 16 bits). So `ffmpeg -f image2pipe`, a camera's MJPEG
//! stream and `cat *.png` all serve. Raw video has no header; its size and channels are given.
//!
//! Guarantees: a frame is handed out as soon as its last byte has arrived; memory does not grow with
//! the number of frames, and is reused for raw video and for pictures of 8 bits that are not compressed;
//! a stream that ends within a frame is an error. Not guaranteed: to find the next frame after bytes
//! that are no image.

use std::io::{BufRead, Read};
use std::path::PathBuf;
use std::time::Instant;

use super::{Frame, FrameSource};
use crate::error::{Error, Result, require};
use crate::image::picture::{MAX_HEAD, max_bytes};
use crate::image::{GrayImage, Picture, RawPixel, RgbImage, luma};

/// Maximum number of bytes of a PGM's or PPM's header.
const MAX_PNM_HEADER: usize = 1 << 12;
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
    max_pixels: u64,
    frames: u64,
    /// When the first frame had arrived.
    begun: Option<Instant>,
    /// The bytes of the frame that is read, and their maximum number as far as it says its size.
    bytes: Vec<u8>,
    max_bytes: usize,
}

impl<R: BufRead> PipeReader<R> {
    /// A reader of `input`, of frames of up to `max_pixels` pixels; `name` is for messages.
    ///
    /// # Errors
    /// [`Error::Argument`] for raw frames without pixels, or with too many.
    pub fn new(
        input: R,
        name: impl Into<PathBuf>,
        format: PipeFormat,
        max_pixels: u64,
    ) -> Result<Self> {
        if let PipeFormat::Raw { width, height, .. } = format {
            let pixels = (width as u64).saturating_mul(height as u64);
            let expected = format!("1 to {max_pixels} pixels");
            let found = format_args!("{width} x {height}");
            require((1..=max_pixels).contains(&pixels), "raw", &expected, found)?;
        }
        Ok(Self {
            input,
            name: name.into(),
            format,
            max_pixels,
            frames: 0,
            begun: None,
            bytes: Vec::new(),
            max_bytes: 0,
        })
    }

    fn error(&self, problem: impl Into<String>) -> Error {
        Error::input(&self.name, format!("frame {}", self.frames), problem)
    }

    /// Reads so many more bytes.
    fn take(&mut self, count: usize) -> Result<()> {
        let held = self.bytes.len();
        if held.saturating_add(count) > self.max_bytes {
            let problem = format!(
                "expected its end or its size within {} bytes",
                self.max_bytes
            );
            return Err(self.error(problem));
        }
        // No more memory than has arrived: a header may lie.
        let read = (&mut self.input)
            .take(count as u64)
            .read_to_end(&mut self.bytes);
        match read {
            Ok(read) if read == count => Ok(()),
            Ok(_) => Err(self.error("the input ends within it")),
            Err(e) => Err(Error::read(&self.name, e)),
        }
    }

    /// The image says its size, from which follows how long it may be.
    fn sized(&mut self, width: u64, height: u64) -> Result<()> {
        let pixels = width.saturating_mul(height);
        let max_pixels = self.max_pixels;
        if !(1..=max_pixels).contains(&pixels) {
            return Err(self.error(format!(
                "expected 1 to {max_pixels} pixels, found {width} x {height} (--config max_pixels=N allows more)"
            )));
        }
        self.max_bytes = max_bytes(pixels).try_into().unwrap_or(usize::MAX);
        Ok(())
    }

    /// Reads one image file.
    fn next_image(&mut self, frame: &mut Frame) -> Result<()> {
        self.max_bytes = MAX_HEAD as usize;
        self.take(2)?;
        match self.bytes[..2] {
            [b'P', b'5'] => self.next_pnm(RawPixel::Gray, frame),
            [b'P', b'6'] => self.next_pnm(RawPixel::Rgb, frame),
            [0x89, b'P'] => {
                self.rest_of_png()?;
                self.decode(frame)
            }
            [0xff, 0xd8] => {
                self.rest_of_jpeg()?;
                self.decode(frame)
            }
            _ => Err(self.error(
                "expected a PNG, JPEG, PGM or PPM image, found none of them (raw video needs its size)",
            )),
        }
    }

    fn rest_of_png(&mut self) -> Result<()> {
        self.take(PNG.len() - 2)?;
        if self.bytes != PNG {
            return Err(self.error("expected a PNG image, found half its signature"));
        }
        loop {
            // Length, type, data, checksum.
            self.take(8)?;
            let start = self.bytes.len();
            let [length, kind] = [start - 8, start - 4].map(|at| self.word(at));
            self.take(length as usize + 4)?;
            match &kind.to_be_bytes() {
                b"IEND" => return Ok(()),
                b"IHDR" if length >= 8 => {
                    let [width, height] = [start, start + 4].map(|at| self.word(at));
                    self.sized(width.into(), height.into())?;
                }
                kind if kind.iter().all(u8::is_ascii_alphabetic) => {}
                _ => return Err(self.error("expected a PNG chunk, found other data")),
            }
        }
    }

    /// The four bytes from `at` on, which were read, as a number.
    fn word(&self, at: usize) -> u32 {
        let bytes = &self.bytes[at..at + 4];
        u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
    }

    fn rest_of_jpeg(&mut self) -> Result<()> {
        let mut marker = self.next_marker(false)?;
        loop {
            match marker {
                0xd9 => return Ok(()),
                // Stand-alone markers.
                0x01 | 0xd0..=0xd7 => marker = self.next_marker(false)?,
                _ => {
                    self.take(2)?;
                    let length = &self.bytes[self.bytes.len() - 2..];
                    let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
                    let start = self.bytes.len();
                    self.take(length.saturating_sub(2))?;
                    // Of a frame: precision, rows, columns.
                    if matches!(marker, 0xc0..=0xcf)
                        && !matches!(marker, 0xc4 | 0xc8 | 0xcc)
                        && length >= 7
                    {
                        let size = self.word(start + 1);
                        self.sized(u64::from(size & 0xffff), u64::from(size >> 16))?;
                    }
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
            if self.bytes.last() != Some(&0xff) {
                if after_data {
                    continue;
                }
                return Err(self.error("expected a JPEG marker, found other data"));
            }
            let mut code = 0xff;
            while code == 0xff {
                self.take(1)?;
                code = self.bytes.last().copied().unwrap_or_default();
            }
            match code {
                // A data byte of 255, or a restart within the data.
                0x00 | 0xd0..=0xd7 if after_data => {}
                0x00 => return Err(self.error("expected a JPEG marker, found a zero")),
                code => return Ok(code),
            }
        }
    }

    fn decode(&mut self, frame: &mut Frame) -> Result<()> {
        frame.arrived = Instant::now();
        let name = format!("{}: frame {}", self.name.display(), self.frames);
        frame.picture = Ok(Picture::decode(
            name.as_ref(),
            &self.bytes,
            self.max_pixels,
        )?);
        Ok(())
    }

    fn next_pnm(&mut self, pixel: RawPixel, frame: &mut Frame) -> Result<()> {
        self.max_bytes = MAX_PNM_HEADER;
        let mut header = [0usize; 3];
        for number in &mut header {
            *number = self.number()?;
        }
        let [width, height, max_value] = header;
        if !(1..=65_535).contains(&max_value) {
            let problem = format!("expected values of up to 16 bits, found 0 to {max_value}");
            return Err(self.error(problem));
        }
        self.sized(width as u64, height as u64)?;
        let depth = if max_value > 255 { 2 } else { 1 };
        self.bytes.clear();
        self.take(width * height * pixel.channels() * depth)?;
        if max_value == 255 {
            self.hand_out_bytes(width, height, pixel, frame);
            return Ok(());
        }
        frame.arrived = Instant::now();
        let values = self.values(max_value);
        frame.picture = Ok(match pixel {
            RawPixel::Gray => {
                let gray = values.map(|value| luma([value; 3]));
                Picture::Gray(GrayImage::new(width, height, gray.collect())?)
            }
            RawPixel::Rgb | RawPixel::Bgr => {
                let values: Vec<f32> = values.collect();
                let colors = values.chunks_exact(3).map(|c| [c[0], c[1], c[2]]);
                Picture::Color(RgbImage::new(width, height, colors.collect())?)
            }
        });
        Ok(())
    }

    /// The bytes that were read become the picture, whose memory takes the next ones.
    fn hand_out_bytes(&mut self, width: usize, height: usize, pixel: RawPixel, frame: &mut Frame) {
        frame.arrived = Instant::now();
        let bytes = std::mem::take(&mut self.bytes);
        if let Ok(Picture::Bytes { values, .. }) = &mut frame.picture {
            std::mem::swap(&mut self.bytes, values);
        }
        frame.picture = Ok(Picture::Bytes {
            width,
            height,
            pixel,
            values: bytes,
        });
    }

    /// The samples that were read, from 0 to 1.
    fn values(&self, max_value: usize) -> impl Iterator<Item = f32> {
        let depth = if max_value > 255 { 2 } else { 1 };
        let sample = |bytes: &[u8]| bytes.iter().fold(0u16, |sum, b| sum << 8 | u16::from(*b));
        let samples = self.bytes.chunks_exact(depth).map(sample);
        samples.map(move |sample| (f32::from(sample) / max_value as f32).min(1.0))
    }

    /// A number of a header, and the one byte of white space after it.
    fn number(&mut self) -> Result<usize> {
        let mut text = String::new();
        let mut in_comment = false;
        loop {
            self.take(1)?;
            let byte = self.bytes.last().copied().unwrap_or_default();
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
}

impl<R: BufRead> FrameSource for PipeReader<R> {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool> {
        let first = self.input.fill_buf();
        let at_end = first.map_err(|e| Error::read(&self.name, e))?.is_empty();
        if at_end {
            return Ok(false);
        }
        self.bytes.clear();
        match self.format {
            PipeFormat::Images => self.next_image(frame)?,
            PipeFormat::Raw {
                width,
                height,
                pixel,
            } => {
                self.max_bytes = width * height * pixel.channels();
                self.take(self.max_bytes)?;
                self.hand_out_bytes(width, height, pixel, frame);
            }
        }
        let begun = *self.begun.get_or_insert(frame.arrived);
        frame.time_s = Some(frame.arrived.duration_since(begun).as_secs_f64());
        frame.number = self.frames;
        frame.name.clear();
        frame.path.clear();
        self.frames += 1;
        Ok(true)
    }
}
