//! The overlays of `spindoe estimate`: every frame with its detections, as pictures or a video.

use std::path::Path;

use super::painted::SeenPaint;
use super::video::VideoWriter;
use super::{Picture, output};
use crate::clip::{BatchFrame, TimeSource};
use crate::concurrency;
use crate::error::Result;
use crate::files::Replacement;
use crate::geometry::Vec3;
use crate::image::RgbImage;
use crate::plot::{self, OverlayFrame, OverlayMarks, OverlayOutline};
use crate::surface::{PaintedPose, PaintedRejection};
use crate::vision::optics::camera::BallCircle;
use crate::vision::{Estimator, FrameEstimate, Pixel};

/// Maximum side of a frame that is drawn whole, pixels; larger frames are cropped around the ball.
const WHOLE: usize = 320;
/// The first sheet of all frames.
const SHEET: &str = "contact_sheet.png";
/// Half the side of the crop around a ball, in radii.
const AROUND: f64 = 1.4;

/// The drawn part of a frame with these balls, and the corner at which it was cropped.
pub(super) fn picture(
    image: &RgbImage,
    balls: impl Iterator<Item = BallCircle> + Clone,
) -> Result<(RgbImage, usize, usize)> {
    let whole = image.width().max(image.height()) <= WHOLE;
    if whole || balls.clone().next().is_none() {
        return Ok((image.clone(), 0, 0));
    }
    let span = |of: fn(&BallCircle) -> f64, size: usize| {
        let low = balls.clone().map(|b| of(&b) - AROUND * b.radius);
        let high = balls.clone().map(|b| of(&b) + AROUND * b.radius);
        let low = low.fold(f64::INFINITY, f64::min).max(0.0) as usize;
        let high = high.fold(0.0, f64::max).ceil() as usize + 1;
        let low = low.min(size - 1);
        (low, high.clamp(low + 1, size) - low)
    };
    let (left, width) = span(|b| b.center.u, image.width());
    let (top, height) = span(|b| b.center.v, image.height());
    Ok((image.part(left, top, width, height)?, left, top))
}

/// A ball that is drawn: its estimate, by which estimator, and its number where there are several.
pub(super) type DrawnBall<'a> = (&'a FrameEstimate, &'a Estimator, Option<usize>);

/// A frame with what is drawn on it; without a picture where none was kept.
pub(super) fn drawn(
    name: &str,
    words: String,
    kept: &Picture,
    balls: &[DrawnBall<'_>],
) -> OverlayFrame {
    let mut drawn = OverlayFrame {
        words,
        refused: balls.iter().all(|(frame, ..)| frame.pose().is_none()),
        ..OverlayFrame::without_picture(name)
    };
    let Some((image, left, top)) = kept else {
        return drawn;
    };
    let place = |p: Pixel| Pixel {
        u: p.u - *left as f64,
        v: p.v - *top as f64,
    };
    drawn.image = image.clone();
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    for (frame, estimator, number) in balls {
        let outline = frame.circle.map(|c| outline(c, *number, place));
        drawn.outlines.extend(outline);
        let dots = frame.dots.iter().zip(&frame.assignment);
        found.extend(dots.map(|(dot, name)| plot::OverlayDot {
            pixel: place(dot.pixel),
            probability: dot.probability,
            named: name.is_some(),
        }));
        let dots = estimator.expected_dots(frame).into_iter();
        expected.extend(dots.map(|(number, pixel, z)| (number, place(pixel), z)));
    }
    drawn.marks = OverlayMarks::Dots { found, expected };
    drawn
}

/// An outline where `place` has its center.
fn outline(
    circle: BallCircle,
    number: Option<usize>,
    place: impl Fn(Pixel) -> Pixel,
) -> OverlayOutline {
    OverlayOutline {
        circle: BallCircle {
            center: place(circle.center),
            ..circle
        },
        number,
    }
}

/// A frame of a painted ball: its outline, of a frame with a pose as the whole clip has it, and the borders of the surface's marks by
/// the pose.
pub(super) fn painted(
    frame: &BatchFrame<SeenPaint>,
    pose: &std::result::Result<PaintedPose, PaintedRejection>,
    borders: &[[Vec3; 2]],
) -> OverlayFrame {
    let words = match (&frame.unreadable, pose) {
        (Some(why), _) => why.clone(),
        (None, Ok(pose)) => format!("agreement {:.2}", pose.agreement),
        (None, Err(rejection)) => rejection.to_string(),
    };
    let drawn = OverlayFrame {
        words,
        refused: pose.is_err(),
        ..OverlayFrame::without_picture(&frame.name)
    };
    let Some((image, left, top)) = &frame.kept.picture else {
        return drawn;
    };
    let place = |p: Pixel| Pixel {
        u: p.u - *left as f64,
        v: p.v - *top as f64,
    };
    let pose = pose.as_ref().ok();
    let found = frame.estimate().circle;
    let circle = pose.map(|pose| *pose.view.circle()).or(found);
    let seen = |pose: &PaintedPose| {
        let piece = |[from, to]: &[Vec3; 2]| {
            let (from, to) = (pose.project(from)?, pose.project(to)?);
            Some([place(from), place(to)])
        };
        borders.iter().filter_map(piece).collect()
    };
    OverlayFrame {
        image: image.clone(),
        outlines: circle
            .map(|c| outline(c, None, place))
            .into_iter()
            .collect(),
        marks: OverlayMarks::Paint(pose.map(seen).unwrap_or_default()),
        ..drawn
    }
}

/// A frame of one ball.
pub(super) fn one_ball(estimator: &Estimator, shown: &BatchFrame<Picture>) -> OverlayFrame {
    let frame = shown.estimate();
    let words = output::words(frame);
    drawn(&shown.name, words, &shown.kept, &[(frame, estimator, None)])
}

/// Where overlays go.
pub(super) enum OverlayTarget {
    /// Every frame and a contact sheet, into a folder.
    Folder(Replacement),
    /// One video.
    Video(VideoWriter),
}

impl OverlayTarget {
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

    /// Draws so many frames, whose times are from `times`.
    pub fn draw(
        self,
        times: &TimeSource,
        count: usize,
        frame: impl Fn(usize) -> OverlayFrame + Sync,
    ) -> Result<()> {
        match self {
            Self::Folder(set) => {
                draw(set.path(), count, &frame)?;
                set.publish(&[], SHEET)
            }
            Self::Video(writer) => write_video(writer, times, count, &frame),
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
    times: &TimeSource,
    count: usize,
    frame: &(impl Fn(usize) -> OverlayFrame + Sync),
) -> Result<()> {
    let rate = match times {
        TimeSource::Names { fps } => *fps,
        TimeSource::Rate { fps } => Some(*fps),
        TimeSource::Video(clock) => Some(clock.stored_fps),
        _ => None,
    };
    let fps = rate.map_or(VIDEO_DEFAULT_FPS, |fps| fps.min(VIDEO_FPS));
    let empty = plot::OverlayFrame::without_picture("");
    let size = plot::overlay_pixels(&empty, VIDEO_SIDE)?.size;
    let mut video = writer.begin(size, fps)?;
    for begin in (0..count).step_by(VIDEO_CHUNK) {
        // A frame that cannot be read keeps its time in the video.
        let one = |k: u64| plot::overlay_pixels(&frame(k as usize), VIDEO_SIDE);
        let chunk = begin as u64..(begin + VIDEO_CHUNK).min(count) as u64;
        for frame in concurrency::map_range(chunk, one) {
            video.write(&frame?.values)?;
        }
    }
    video.finish()
}

/// Draws all frames that have a picture, and the sheets.
fn draw(dir: &Path, count: usize, frame: &(impl Fn(usize) -> OverlayFrame + Sync)) -> Result<()> {
    let one = |k: u64| {
        let drawn = frame(k as usize);
        if drawn.image.values().is_empty() {
            return Ok(None);
        }
        plot::frame_overlay(&dir.join(file_name(k as usize, &drawn.name)), &drawn)?;
        Ok(Some(drawn))
    };
    let drawn = concurrency::map_range(0..count as u64, one);
    let drawn: Result<Vec<_>> = drawn.into_iter().collect();
    let frames: Vec<OverlayFrame> = drawn?.into_iter().flatten().collect();
    let sheets: Vec<_> = frames.chunks(plot::SHEET_FRAMES).enumerate().collect();
    let sheet = |(k, sheet): &(usize, &[OverlayFrame])| {
        let name = match k {
            0 => SHEET.to_owned(),
            k => format!("contact_sheet_{}.png", k + 1),
        };
        plot::contact_sheet(&dir.join(name), sheet)
    };
    concurrency::map(&sheets, sheet).into_iter().collect()
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
