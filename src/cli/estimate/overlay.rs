//! The overlays of `spindoe estimate`: every frame with its detections, as pictures or a video.

use std::path::Path;

use rayon::prelude::*;

use super::video::VideoWriter;
use super::{Picture, output};
use crate::error::Result;
use crate::files::Replacement;
use crate::image::RgbImage;
use crate::plot::{self, OverlayFrame};
use crate::vision::estimator::{Batch, BatchFrame, TimeSource};
use crate::vision::{Estimator, FrameEstimate, NamedDetector, Pixel};

/// Maximum side of a frame that is drawn whole, pixels; larger frames are cropped around the ball.
const WHOLE: usize = 320;
/// The first sheet of all frames.
const SHEET: &str = "contact_sheet.png";
/// Half the side of the crop around a ball, in radii.
const AROUND: f64 = 1.4;

/// The drawn part of a frame, and the corner at which it was cropped.
pub(super) fn picture(
    image: &RgbImage,
    estimate: &FrameEstimate,
) -> Result<(RgbImage, usize, usize)> {
    let whole = image.width().max(image.height()) <= WHOLE;
    match estimate.circle {
        Some(circle) if !whole => {
            let corner = |x: f64| (x - AROUND * circle.radius).max(0.0) as usize;
            let side = (2.0 * AROUND * circle.radius).ceil() as usize + 1;
            let left = corner(circle.center.u).min(image.width() - 1);
            let top = corner(circle.center.v).min(image.height() - 1);
            Ok((image.part(left, top, side, side)?, left, top))
        }
        _ => Ok((image.clone(), 0, 0)),
    }
}

/// A frame with what is drawn on it; `None` where no picture was kept.
pub(super) fn drawn(
    estimator: &Estimator<NamedDetector>,
    shown: &BatchFrame<Picture>,
) -> Option<OverlayFrame> {
    let frame = &shown.estimate;
    let (image, left, top) = shown.kept.as_ref()?;
    let place = |p: Pixel| Pixel {
        u: p.u - *left as f64,
        v: p.v - *top as f64,
    };
    Some(OverlayFrame {
        name: shown.name.clone(),
        words: output::words(frame),
        refused: frame.pose().is_none(),
        image: image.clone(),
        outline: frame.circle.map(|c| (place(c.center), c.radius)),
        dots: (frame.dots.iter().zip(&frame.assignment))
            .map(|(dot, name)| plot::OverlayDot {
                pixel: place(dot.pixel),
                probability: dot.probability,
                named: name.is_some(),
            })
            .collect(),
        expected: (estimator.expected_dots(frame).into_iter())
            .map(|(number, pixel, z)| (number, place(pixel), z))
            .collect(),
    })
}

/// Where overlays go.
pub(super) enum Target {
    /// Every frame and a contact sheet, into a folder.
    Folder(Replacement),
    /// One video.
    Video(VideoWriter),
}

impl Target {
    /// By the path's ending; checked before the work.
    pub fn new(path: &Path) -> Result<Self> {
        if path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("mp4"))
        {
            return VideoWriter::new(path).map(Self::Video);
        }
        Replacement::begin(path).map(Self::Folder)
    }

    /// Draws all frames.
    pub fn draw(self, estimator: &Estimator<NamedDetector>, batch: &Batch<Picture>) -> Result<()> {
        match self {
            Self::Folder(set) => {
                draw(set.path(), estimator, batch)?;
                set.publish(&[], &[], SHEET)
            }
            Self::Video(writer) => write_video(writer, estimator, batch),
        }
    }
}

/// Side of a video's frames, pixels.
const VIDEO_SIDE: u32 = 480;
/// Frames a second at most, and where the frames have no rate: faster ones play in slow motion.
const VIDEO_FPS: f64 = 30.0;
const VIDEO_DEFAULT_FPS: f64 = 10.0;
/// Frames drawn at once.
const VIDEO_CHUNK: usize = 16;

fn write_video(
    writer: VideoWriter,
    estimator: &Estimator<NamedDetector>,
    batch: &Batch<Picture>,
) -> Result<()> {
    let rate = match &batch.times {
        TimeSource::Names { fps } => *fps,
        TimeSource::Rate { fps } => Some(*fps),
        TimeSource::Video(clock) => Some(clock.stored_fps),
        _ => None,
    };
    let fps = rate.map_or(VIDEO_DEFAULT_FPS, |fps| fps.min(VIDEO_FPS));
    let empty = plot::OverlayFrame::without_picture("");
    let size = plot::overlay_pixels(&empty, VIDEO_SIDE)?.size;
    let mut video = writer.begin(size, fps)?;
    for frames in batch.frames.chunks(VIDEO_CHUNK) {
        let one = |shown: &BatchFrame<Picture>| {
            // A frame that cannot be read keeps its time in the video.
            let drawn = drawn(estimator, shown);
            let drawn = drawn.unwrap_or_else(|| OverlayFrame {
                words: output::words(&shown.estimate),
                ..OverlayFrame::without_picture(&shown.name)
            });
            plot::overlay_pixels(&drawn, VIDEO_SIDE)
        };
        let pixels: Result<Vec<_>> = frames.par_iter().map(one).collect();
        for frame in pixels? {
            video.write(&frame.values)?;
        }
    }
    video.finish()
}

/// Draws all frames, and the sheets.
fn draw(dir: &Path, estimator: &Estimator<NamedDetector>, batch: &Batch<Picture>) -> Result<()> {
    let one = |(k, shown): (usize, &BatchFrame<Picture>)| {
        let Some(drawn) = drawn(estimator, shown) else {
            return Ok(None);
        };
        plot::frame_overlay(&dir.join(file_name(k, &drawn.name)), &drawn)?;
        Ok(Some(drawn))
    };
    let drawn: Result<Vec<_>> = batch.frames.par_iter().enumerate().map(one).collect();
    let frames: Vec<OverlayFrame> = drawn?.into_iter().flatten().collect();
    let sheet = |(k, sheet): (usize, &[OverlayFrame])| {
        let name = match k {
            0 => SHEET.to_owned(),
            k => format!("contact_sheet_{}.png", k + 1),
        };
        plot::contact_sheet(&dir.join(name), sheet)
    };
    let sheets = frames.par_chunks(plot::SHEET_FRAMES).enumerate();
    sheets.map(sheet).collect()
}

/// A file name in the frames' order, for any characters in a frame's name.
fn file_name(index: usize, name: &str) -> String {
    let safe: String = name
        .chars()
        .take(80)
        .map(|c| match c {
            c if c.is_alphanumeric() || "-_.".contains(c) => c,
            _ => '_',
        })
        .collect();
    format!("{index:05}_{safe}.png")
}
