//! The overlays of `spindoe estimate`: every frame with its detections.

use std::path::Path;

use rayon::prelude::*;

use super::{Picture, output};
use crate::error::Result;
use crate::plot::{self, OverlayFrame};
use crate::vision::estimator::{Batch, BatchFrame};
use crate::vision::{Estimator, FrameEstimate, NamedDetector, Pixel, RgbImage};

/// Maximum side of a frame that is drawn whole, pixels; larger frames are cropped around the ball.
const WHOLE: usize = 320;
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
                confidence: dot.confidence,
                named: name.is_some(),
            })
            .collect(),
        expected: (estimator.expected_dots(frame).into_iter())
            .map(|(number, pixel, z)| (number, place(pixel), z))
            .collect(),
    })
}

/// Draws all frames, and the sheets.
pub(super) fn draw(
    dir: &Path,
    estimator: &Estimator<NamedDetector>,
    batch: &Batch<Picture>,
) -> Result<()> {
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
            0 => "contact_sheet.png".to_owned(),
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
