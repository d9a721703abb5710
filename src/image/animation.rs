//! Files that hold several pictures, shown one after another: animated GIF, PNG and WebP files.
//!
//! Each picture comes whole, as it is shown. How long it is shown is for the eye, in hundredths of a second, and no time stamp.

use std::io::Cursor;
use std::path::Path;
use std::sync::mpsc::{Receiver, sync_channel};

use image::codecs::gif::GifDecoder;
use image::codecs::png::PngDecoder;
use image::codecs::webp::WebPDecoder;
use image::{AnimationDecoder as _, DynamicImage, Frames, ImageDecoder, ImageFormat, ImageResult};

use super::Picture;
use super::picture::{broken, check_pixels};
use crate::error::{Error, Result};

/// Bytes of a file's start that say whether it is an animation; of a GIF file all are needed.
pub(crate) const START: u64 = 1 << 16;

/// Whether a file that begins so may be an animation: of a GIF file only all of it says ([`is_animation`]).
pub(crate) fn may_be(start: &[u8]) -> bool {
    start.starts_with(b"GIF8") || is_animation(start)
}

/// Whether a file holds several pictures: its bytes, or of a PNG or a WebP file those at its start.
pub(crate) fn is_animation(bytes: &[u8]) -> bool {
    let is_several = |pictures: Option<usize>| pictures.is_some_and(|n| n > 1);
    is_several(png_pictures(bytes)) || is_webp(bytes) || is_several(gif_pictures(bytes, 2))
}

/// How many pictures an animation has, as far as its bytes say.
pub(crate) fn pictures(bytes: &[u8]) -> Option<usize> {
    let webp = || is_webp(bytes).then(|| webp_pictures(bytes)).flatten();
    let gif = || gif_pictures(bytes, usize::MAX);
    png_pictures(bytes).or_else(webp).or_else(gif)
}

/// The chunk `acTL` before the picture says how many there are (W3C, "PNG Specification, Third Edition", 11.3.6.1).
fn png_pictures(bytes: &[u8]) -> Option<usize> {
    let mut rest = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n")?;
    loop {
        let (length, after) = rest.split_first_chunk()?;
        let (kind, after) = after.split_first_chunk::<4>()?;
        match kind {
            b"acTL" => return Some(u32::from_be_bytes(*after.first_chunk()?) as usize),
            b"IDAT" => return Some(1),
            // And its checksum.
            _ => rest = after.get((u32::from_be_bytes(*length) as usize).checked_add(4)?..)?,
        }
    }
}

/// A bit of the chunk `VP8X` says so (RFC 9649, 2.7).
fn is_webp(bytes: &[u8]) -> bool {
    let is_extended = bytes.starts_with(b"RIFF") && bytes.get(8..16) == Some(b"WEBPVP8X");
    is_extended && bytes.get(20).is_some_and(|flags| flags & 2 != 0)
}

/// The chunks `ANMF` of a file (RFC 9649, 2.7.1.1).
fn webp_pictures(bytes: &[u8]) -> Option<usize> {
    let (mut rest, mut pictures) = (bytes.get(12..)?, 0);
    while let Some((kind, after)) = rest.split_first_chunk::<4>() {
        let (length, after) = after.split_first_chunk()?;
        pictures += usize::from(kind == b"ANMF");
        // Chunks begin at even places.
        rest = after.get((u32::from_le_bytes(*length) as usize).checked_next_multiple_of(2)?..)?;
    }
    Some(pictures)
}

/// The image descriptors among the blocks, up to `most` (CompuServe, "GIF89a", appendix A).
fn gif_pictures(bytes: &[u8], most: usize) -> Option<usize> {
    let colors = |flags: u8| match flags & 0x80 {
        0 => 0,
        _ => 3 << ((flags & 7) + 1),
    };
    // Data in blocks of up to 255 bytes, each with its length before it; an empty one ends them.
    let after_blocks = |mut at: usize| {
        loop {
            match *bytes.get(at)? {
                0 => return Some(at + 1),
                length => at += 1 + usize::from(length),
            }
        }
    };
    if !bytes.starts_with(b"GIF8") {
        return None;
    }
    let mut at = 13 + colors(*bytes.get(10)?);
    let mut pictures = 0;
    while pictures < most {
        at = match *bytes.get(at)? {
            0x2c => {
                pictures += 1;
                after_blocks(at + 11 + colors(*bytes.get(at + 9)?))?
            }
            0x21 => after_blocks(at + 2)?,
            _ => break,
        };
    }
    Some(pictures)
}

/// Whether a second picture stands right behind the first one, as in a stream: a JPEG, PNG, BMP or binary PNM file. What a phone's camera keeps
/// with a picture (CIPA DC-007, "Multi-Picture Format") is none.
pub(crate) fn is_stream(bytes: &[u8]) -> bool {
    let follows = |end: Option<usize>, begins: fn(&[u8]) -> bool| {
        end.and_then(|end| bytes.get(end..)).is_some_and(begins)
    };
    match bytes {
        [0xff, 0xd8, ..] => follows(jpeg_end(bytes), |rest| rest.starts_with(b"\xff\xd8\xff")),
        [0x89, b'P', ..] => follows(png_end(bytes), |rest| rest.starts_with(b"\x89PNG")),
        [b'P', b'4'..=b'6', ..] => follows(pnm_end(bytes), |rest| {
            let next = rest.trim_ascii_start();
            next.first() == Some(&b'P') && next.get(1).is_some_and(u8::is_ascii_digit)
        }),
        [b'P', b'7', ..] => follows(pam_end(bytes), |rest| rest.starts_with(b"P7\n")),
        // Its header says its length.
        [b'B', b'M', a, b, c, d, ..] => {
            let length = u32::from_le_bytes([*a, *b, *c, *d]) as usize;
            length > 0 && follows(Some(length), |rest| rest.starts_with(b"BM"))
        }
        _ => false,
    }
}

/// What a phone's portrait says of the depth or brightness pictures behind it (Google's "Dynamic Depth", "Ultra HDR").
const CONTAINER: &[u8] = b"Container:Directory";

/// Behind the marker that ends a picture (ITU-T T.81, annex B); `None` for one with others of its own.
fn jpeg_end(bytes: &[u8]) -> Option<usize> {
    let mut at = 2;
    loop {
        // Data of a scan come before its next marker.
        let marker = bytes
            .get(at..)?
            .windows(2)
            .position(|two| two[0] == 0xff && !matches!(two[1], 0 | 1 | 0xd0..=0xd7 | 0xff))?;
        at += marker + 2;
        if bytes[at - 1] == 0xd9 {
            return Some(at);
        }
        let length = u16::from_be_bytes(*bytes.get(at..)?.first_chunk()?);
        let segment = bytes.get(at + 2..at + usize::from(length).max(2))?;
        let has_others = match bytes[at - 1] {
            0xe1 => segment
                .windows(CONTAINER.len())
                .any(|part| part == CONTAINER),
            0xe2 => segment.starts_with(b"MPF\0"),
            _ => false,
        };
        if has_others {
            return None;
        }
        at += usize::from(length);
    }
}

fn png_end(bytes: &[u8]) -> Option<usize> {
    let mut at = 8;
    loop {
        let (length, kind) = bytes.get(at..at + 8)?.split_first_chunk::<4>()?;
        // And its checksum.
        at = (u32::from_be_bytes(*length) as usize).checked_add(at + 12)?;
        if kind == b"IEND" {
            return Some(at);
        }
    }
}

/// By columns, rows and, but for bits, the greatest value, with comments between them.
fn pnm_end(bytes: &[u8]) -> Option<usize> {
    let (kind, mut at) = (*bytes.get(1)?, 2);
    let mut next = || {
        loop {
            match bytes.get(at)? {
                b'#' => at += bytes.get(at..)?.iter().position(|b| *b == b'\n')?,
                space if space.is_ascii_whitespace() => at += 1,
                _ => break,
            }
        }
        let digits = bytes.get(at..)?;
        let digits = &digits[..digits.iter().position(|b| !b.is_ascii_digit())?];
        at += digits.len();
        Some((
            std::str::from_utf8(digits).ok()?.parse::<usize>().ok()?,
            at + 1,
        ))
    };
    let (columns, rows) = (next()?.0, next()?);
    let (row, start) = match kind {
        b'4' => (columns.div_ceil(8), rows.1),
        _ => {
            let (greatest, start) = next()?;
            let bytes = if greatest > 255 { 2 } else { 1 };
            let channels = if kind == b'6' { 3 } else { 1 };
            (columns.checked_mul(bytes * channels)?, start)
        }
    };
    row.checked_mul(rows.0)?.checked_add(start)
}

/// By the lines `WIDTH n`, `HEIGHT n`, `DEPTH n` and `MAXVAL n` before `ENDHDR` (Netpbm's manual, pam(5)).
fn pam_end(bytes: &[u8]) -> Option<usize> {
    let end = bytes.windows(7).position(|w| w == b"ENDHDR\n")?;
    let header = std::str::from_utf8(bytes.get(..end)?).ok()?;
    let stated = |key: &str| {
        let mut lines = header.lines().map(|line| line.split_ascii_whitespace());
        let mut line = lines.find(|line| line.clone().next() == Some(key))?;
        line.nth(1)?.parse::<usize>().ok()
    };
    let bytes = if stated("MAXVAL")? > 255 { 2 } else { 1 };
    let row = stated("WIDTH")?.checked_mul(stated("DEPTH")?.checked_mul(bytes)?)?;
    row.checked_mul(stated("HEIGHT")?)?.checked_add(end + 7)
}

/// The pictures of an animation, one by one: a thread of its own decodes them, which may not change threads meanwhile, one in advance.
pub(crate) struct Animation(Receiver<Result<Picture>>);

impl Animation {
    /// Begins with a file's bytes; `path` is for messages. Pictures of more than `max_pixels` pixels are errors.
    ///
    /// # Errors
    /// [`Error::Read`] where the system grants no thread.
    pub fn new(path: &Path, bytes: Vec<u8>, max_pixels: u64) -> Result<Self> {
        let (sender, pictures) = sync_channel(1);
        let path = path.to_path_buf();
        let named = path.clone();
        let decode = move || {
            let decoded = |frame: ImageResult<image::Frame>| {
                let frame = frame.map_err(|e| broken(&path, &e))?;
                Picture::of_decoded(&path, DynamicImage::ImageRgba8(frame.into_buffer()))
            };
            match frames(&path, bytes, max_pixels) {
                // Who reads may have had enough.
                Err(error) => drop(sender.send(Err(error))),
                Ok(mut all) => {
                    let _ = all.try_for_each(|frame| {
                        let picture = decoded(frame);
                        let is_broken = picture.is_err();
                        sender.send(picture).ok().filter(|()| !is_broken)
                    });
                }
            }
        };
        let thread = std::thread::Builder::new().spawn(decode);
        thread.map_err(|e| Error::read(&named, e))?;
        Ok(Self(pictures))
    }

    /// The next picture; `None` at the end.
    pub fn next_picture(&mut self) -> Option<Result<Picture>> {
        self.0.recv().ok()
    }
}

fn frames(path: &Path, bytes: Vec<u8>, max_pixels: u64) -> Result<Frames<'static>> {
    let format = image::guess_format(&bytes).map_err(|e| broken(path, &e))?;
    let bytes = Cursor::new(bytes);
    match format {
        ImageFormat::Gif => of(path, GifDecoder::new(bytes), max_pixels, |d| {
            Ok(d.into_frames())
        }),
        ImageFormat::Png => of(path, PngDecoder::new(bytes), max_pixels, |d| {
            Ok(d.apng()?.into_frames())
        }),
        ImageFormat::WebP => of(path, WebPDecoder::new(bytes), max_pixels, |d| {
            Ok(d.into_frames())
        }),
        _ => Err(Error::input(path, "image", "expected an animation")),
    }
}

fn of<D: ImageDecoder>(
    path: &Path,
    decoder: ImageResult<D>,
    max_pixels: u64,
    frames: impl FnOnce(D) -> ImageResult<Frames<'static>>,
) -> Result<Frames<'static>> {
    let decoder = decoder.map_err(|e| broken(path, &e))?;
    check_pixels(path, decoder.dimensions(), max_pixels)?;
    frames(decoder).map_err(|e| broken(path, &e))
}
