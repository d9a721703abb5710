//! Overlays: frames enlarged, with the estimator's detections and pose, and a sheet of all frames.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::canvas::{self, Area, Drawn, INK, SMALL, px};
use crate::error::Result;
use crate::vision::{Pixel, RgbImage};

/// Side of an enlarged frame, file pixels.
pub const OVERLAY_SIDE: u32 = 560;
/// Space for words above and below it.
const WORDS: u32 = 34;
/// Side of a frame on a sheet, file pixels.
const CELL: u32 = 240;
/// Space for words below a frame on a sheet.
const CELL_WORDS: u32 = 22;
/// Maximum number of frames on one sheet.
pub const SHEET_FRAMES: usize = 80;
/// Colors of the outline, identified dots, others, expected dots and rejections.
const OUTLINE: RGBColor = RGBColor(0, 220, 120);
const NAMED: RGBColor = RGBColor(60, 200, 255);
const UNNAMED: RGBColor = RGBColor(255, 90, 60);
const EXPECTED: RGBColor = RGBColor(255, 230, 40);

/// A detection to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverlayDot {
    /// Where, pixels of the picture.
    pub pixel: Pixel,
    /// The detector's confidence.
    pub confidence: f64,
    /// Whether it is identified.
    pub named: bool,
}

/// A frame to draw. Positions are pixels of `image`.
#[derive(Debug, Clone)]
pub struct OverlayFrame {
    /// The frame's name.
    pub name: String,
    /// Its outcome, in words.
    pub words: String,
    /// Whether it is rejected.
    pub refused: bool,
    /// The picture.
    pub image: RgbImage,
    /// Center and radius of the ball's outline.
    pub outline: Option<(Pixel, f64)>,
    /// The detections.
    pub dots: Vec<OverlayDot>,
    /// The pattern's dots as the orientation has them: number, place, and z on the unit ball.
    pub expected: Vec<(u16, Pixel, f64)>,
}

/// Draws one frame. Circles: the outline green; identified detections blue, others red, with their
/// confidence in percent; crosses with numbers, yellow: where the orientation expects the pattern's
/// dots.
///
/// # Errors
/// [`Error::Write`](crate::Error::Write) where the system refuses.
pub fn frame_overlay(path: &Path, frame: &OverlayFrame) -> Result<()> {
    let size = (OVERLAY_SIDE, OVERLAY_SIDE + 2 * WORDS);
    canvas::picture(path, size, |area| {
        let available = px(f64::from(OVERLAY_SIDE)) - px(12.0);
        let font = canvas::font(SMALL);
        let middle = |y: f64| (px(6.0), px(y));
        let name = canvas::fitted(&frame.name, &font, available);
        canvas::text(area, &name, middle(17.0), HPos::Left, SMALL, INK)?;
        let words = canvas::fitted(&frame.words, &font, available);
        let below = f64::from(OVERLAY_SIDE) + 1.5 * f64::from(WORDS);
        canvas::text(area, &words, middle(below), HPos::Left, SMALL, ink(frame))?;
        let top = px(f64::from(WORDS));
        draw_frame(area, frame, (0, top), px(f64::from(OVERLAY_SIDE)), true)
    })
}

/// A frame's overlay as a small PNG file, without words: for a page.
///
/// # Errors
/// [`Error::Internal`](crate::Error::Internal) where drawing fails.
pub fn frame_thumbnail(frame: &OverlayFrame) -> Result<Vec<u8>> {
    canvas::png_bytes((CELL, CELL), |area| {
        draw_frame(area, frame, (0, 0), px(f64::from(CELL)), false)
    })
}

/// Draws at most [`SHEET_FRAMES`] frames on one sheet, without the numbers' clutter on rejected
/// ones.
///
/// # Errors
/// As [`frame_overlay`].
pub fn contact_sheet(path: &Path, frames: &[OverlayFrame]) -> Result<()> {
    let frames = &frames[..frames.len().min(SHEET_FRAMES)];
    let columns = ((frames.len() as f64).sqrt().ceil() as u32).clamp(1, 8);
    let rows = (frames.len() as u32).div_ceil(columns).max(1);
    let size = (columns * CELL, rows * (CELL + CELL_WORDS));
    canvas::picture(path, size, |area| {
        for (k, frame) in frames.iter().enumerate() {
            let (column, row) = (k as u32 % columns, k as u32 / columns);
            let left = px(f64::from(column * CELL));
            let top = px(f64::from(row * (CELL + CELL_WORDS)));
            let side = px(f64::from(CELL - 4));
            draw_frame(area, frame, (left, top), side, false)?;
            let words = format!("{}  {}", frame.name, frame.words);
            let words = canvas::fitted(&words, &canvas::font(11.0), side);
            let at = (left + px(2.0), top + side + px(12.0));
            canvas::text(area, &words, at, HPos::Left, 11.0, ink(frame))?;
        }
        Ok(())
    })
}

fn ink(frame: &OverlayFrame) -> RGBColor {
    if frame.refused {
        RGBColor(190, 30, 30)
    } else {
        INK
    }
}

/// Draws a frame into a square of `side` drawn pixels.
fn draw_frame(
    area: &Area<'_>,
    frame: &OverlayFrame,
    (left, top): (i32, i32),
    side: i32,
    in_full: bool,
) -> Drawn {
    let (width, height) = (frame.image.width() as f64, frame.image.height() as f64);
    let zoom = f64::from(side) / width.max(height);
    draw_image(area, &frame.image, (left, top), zoom)?;
    // A pixel's center is half a pixel from its corner.
    let place = |p: &Pixel| {
        let at = |x: f64, from: i32| from + (zoom * (x + 0.5)).round() as i32;
        (at(p.u, left), at(p.v, top))
    };
    let inside = |p: &Pixel| p.u > -0.5 && p.v > -0.5 && p.u < width - 0.5 && p.v < height - 0.5;
    let thin = canvas::stroke(OUTLINE, 1.0);
    if let Some((center, radius)) = &frame.outline {
        let points = (0..=180).map(|k| {
            let (s, c) = (f64::from(k) * 2f64.to_radians()).sin_cos();
            Pixel {
                u: center.u + radius * c,
                v: center.v + radius * s,
            }
        });
        // Drawn in pieces, where it lies within the picture.
        let points: Vec<Pixel> = points.collect();
        for pair in points.windows(2).filter(|w| w.iter().all(inside)) {
            area.draw(&PathElement::new(
                vec![place(&pair[0]), place(&pair[1])],
                thin,
            ))?;
        }
    }
    for dot in frame.dots.iter().filter(|d| inside(&d.pixel)) {
        let color = if dot.named { NAMED } else { UNNAMED };
        let at = place(&dot.pixel);
        let r = if in_full { px(11.0) } else { px(5.0) };
        area.draw(&Circle::new(at, r, canvas::stroke(color, 1.2)))?;
        if in_full {
            let words = format!("{:.0}", 100.0 * dot.confidence);
            let below = (at.0, at.1 + r + px(8.0));
            canvas::text(area, &words, below, HPos::Center, 11.0, color)?;
        }
    }
    for (number, pixel, z) in frame.expected.iter().filter(|(_, p, _)| inside(p)) {
        let (x, y) = place(pixel);
        // Smaller towards the limb, where dots are hardly seen.
        let arm = px(if in_full { 3.0 } else { 1.5 } + 2.0 * z);
        for ends in [[(x - arm, y), (x + arm, y)], [(x, y - arm), (x, y + arm)]] {
            area.draw(&PathElement::new(
                ends.to_vec(),
                canvas::stroke(EXPECTED, 1.0),
            ))?;
        }
        if in_full {
            let beside = (x + px(13.0), y - px(9.0));
            canvas::text(
                area,
                &number.to_string(),
                beside,
                HPos::Left,
                12.0,
                EXPECTED,
            )?;
        }
    }
    Ok(())
}

/// Draws a picture enlarged, with smooth transitions.
fn draw_image(area: &Area<'_>, image: &RgbImage, (left, top): (i32, i32), zoom: f64) -> Drawn {
    let (width, height) = (image.width(), image.height());
    let (right, bottom) = (zoom * width as f64, zoom * height as f64);
    for y in 0..bottom as i32 {
        for x in 0..right as i32 {
            let u = (f64::from(x) + 0.5) / zoom - 0.5;
            let v = (f64::from(y) + 0.5) / zoom - 0.5;
            let [r, g, b] = image.sample(u, v).map(|c| (255.0 * c + 0.5) as u8);
            area.draw_pixel((left + x, top + y), &RGBColor(r, g, b))?;
        }
    }
    Ok(())
}
