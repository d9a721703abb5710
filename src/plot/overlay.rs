//! Overlays: frames enlarged, with the estimator's detections and pose, and a sheet of all frames.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::canvas::{self, Area, Drawn, INK, SCALE, SMALL, px};
use super::places::LabelPlaces;
use crate::error::Result;
use crate::image::RgbImage;
use crate::vision::Pixel;
use crate::vision::optics::camera::BallCircle;

/// About the side of a small frame's overlay, file pixels.
pub const OVERLAY_SIDE: u32 = 360;
/// Bounds of any frame's: words and legend must fit, and balls of any size.
const MIN_SIDE: u32 = 300;
const MAX_SIDE: u32 = 800;
/// Space for words above and below it.
const WORDS: u32 = 34;
/// Space for the legend below all.
const LEGEND: u32 = 24;
/// Size of its words, and of numbers beside marks, file pixels.
const LEGEND_TEXT: f64 = 11.0;
const LABEL_TEXT: f64 = 11.0;
/// Side of a frame on a sheet, file pixels.
const CELL: u32 = 240;
/// Space for words below a frame on a sheet: its name and two lines of its outcome. Their size, and the
/// lines' distance, file pixels.
const CELL_WORDS: u32 = 48;
const CELL_TEXT: f64 = 11.0;
const CELL_LINE: f64 = 14.0;
/// Maximum number of frames on one sheet.
pub const SHEET_FRAMES: usize = 80;
/// Colors of the outline, identified dots, others, expected dots and rejections.
const OUTLINE: RGBColor = RGBColor(0, 220, 120);
const NAMED: RGBColor = RGBColor(60, 200, 255);
const UNNAMED: RGBColor = RGBColor(255, 90, 60);
const EXPECTED: RGBColor = RGBColor(255, 230, 40);

/// How a color of the legend is drawn.
#[derive(Debug, Clone, Copy)]
enum Sign {
    Ring,
    Cross,
    Line,
}
const DOTS_LEGEND: &[(&str, RGBColor, Sign)] = &[
    ("outline", OUTLINE, Sign::Ring),
    ("identified", NAMED, Sign::Ring),
    ("not identified", UNNAMED, Sign::Ring),
    ("expected", EXPECTED, Sign::Cross),
];
const PAINT_LEGEND: &[(&str, RGBColor, Sign)] = &[
    ("outline", OUTLINE, Sign::Ring),
    ("borders of the paint, as expected", EXPECTED, Sign::Line),
];

/// A detection to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverlayDot {
    /// Where, pixels of the picture.
    pub pixel: Pixel,
    /// The probability of a dot.
    pub probability: f64,
    /// Whether it is identified.
    pub named: bool,
}

/// A ball's outline to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverlayOutline {
    /// Pixels of the picture.
    pub circle: BallCircle,
    /// The ball's number, where there are several.
    pub number: Option<usize>,
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
    /// The balls' outlines.
    pub outlines: Vec<OverlayOutline>,
    /// What is drawn on the balls.
    pub marks: OverlayMarks,
}

/// What is drawn on the balls of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum OverlayMarks {
    /// Balls with dots.
    Dots {
        /// The detections.
        found: Vec<OverlayDot>,
        /// The pattern's dots as the orientation has them: number, place, and z on the unit ball.
        expected: Vec<(u16, Pixel, f64)>,
    },
    /// A painted ball: the borders of its marks as the orientation has them, in pieces.
    Paint(Vec<[Pixel; 2]>),
}

impl Default for OverlayMarks {
    fn default() -> Self {
        Self::Dots {
            found: Vec::new(),
            expected: Vec::new(),
        }
    }
}

impl OverlayMarks {
    fn legend(&self) -> &'static [(&'static str, RGBColor, Sign)] {
        match self {
            Self::Dots { .. } => DOTS_LEGEND,
            Self::Paint(_) => PAINT_LEGEND,
        }
    }
}

impl OverlayFrame {
    /// A frame of which there is no picture.
    pub fn without_picture(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            words: String::new(),
            refused: true,
            image: RgbImage::default(),
            outlines: Vec::new(),
            marks: OverlayMarks::default(),
        }
    }
}

/// A drawn frame in memory.
#[derive(Debug, Clone)]
pub struct OverlayPixels {
    /// Columns and rows.
    pub size: (u32, u32),
    /// Red, green, blue, row after row.
    pub values: Vec<u8>,
}

/// Draws one frame, at its own scale or enlarged by a whole number where it is small. Circles: the
/// outline green; identified detections blue, others red, with their probability in percent; crosses
/// with numbers, yellow: where the orientation expects the pattern's dots; lines, yellow: where it expects the borders of paint. A
/// legend stands beneath.
///
/// # Errors
/// [`Error::Write`](crate::Error::Write) where the system refuses.
pub fn frame_overlay(path: &Path, frame: &OverlayFrame) -> Result<()> {
    let OverlayPixels { size, values } = overlay_pixels(frame, side_of(frame))?;
    crate::files::write_bytes(path, &canvas::photograph_png(size, &values)?)
}

/// As [`frame_overlay`], with a frame of `side` pixels, in memory.
///
/// # Errors
/// [`Error::Internal`](crate::Error::Internal) where drawing fails.
pub fn overlay_pixels(frame: &OverlayFrame, side: u32) -> Result<OverlayPixels> {
    let size = (side, side + 2 * WORDS + LEGEND);
    let top = px(f64::from(WORDS));
    let fill = |pixels: &mut [u8]| paint(pixels, size.0, &frame.image, (0, top), px(side.into()));
    let values = canvas::rgb_pixels(size, fill, |area| {
        let available = px(f64::from(side)) - px(12.0);
        let font = canvas::font(SMALL);
        let middle = |y: f64| (px(6.0), px(y));
        let name = canvas::fitted(&frame.name, &font, available);
        canvas::text(area, &name, middle(17.0), HPos::Left, SMALL, INK)?;
        let words = canvas::fitted(&frame.words, &font, available);
        let below = f64::from(side) + 1.5 * f64::from(WORDS);
        canvas::text(area, &words, middle(below), HPos::Left, SMALL, ink(frame))?;
        draw_legend(area, px(f64::from(side + 2 * WORDS)), &frame.marks)?;
        draw_marks(area, frame, (0, top), px(f64::from(side)), true)
    })?;
    Ok(OverlayPixels { size, values })
}

/// Side of a frame's overlay: its own, or enlarged by a whole number to about [`OVERLAY_SIDE`].
fn side_of(frame: &OverlayFrame) -> u32 {
    let own = frame.image.width().max(frame.image.height()).max(1) as u32;
    let zoom = (f64::from(OVERLAY_SIDE) / f64::from(own)).round().max(1.0);
    (own * zoom as u32).clamp(MIN_SIDE, MAX_SIDE)
}

/// A frame's overlay as a small PNG file, without words: for a page.
///
/// # Errors
/// [`Error::Internal`](crate::Error::Internal) where drawing fails.
pub fn frame_thumbnail(frame: &OverlayFrame) -> Result<Vec<u8>> {
    let (size, side) = ((CELL, CELL), px(f64::from(CELL)));
    let fill = |pixels: &mut [u8]| paint(pixels, CELL, &frame.image, (0, 0), side);
    let values = canvas::rgb_pixels(size, fill, |area| {
        draw_marks(area, frame, (0, 0), side, false)
    })?;
    canvas::photograph_png(size, &values)
}

/// Draws at most [`SHEET_FRAMES`] frames on one sheet, without the numbers' clutter on rejected
/// ones, and a legend.
///
/// # Errors
/// As [`frame_overlay`].
pub fn contact_sheet(path: &Path, frames: &[OverlayFrame]) -> Result<()> {
    let frames = &frames[..frames.len().min(SHEET_FRAMES)];
    let columns = ((frames.len() as f64).sqrt().ceil() as u32).clamp(2, 8);
    let rows = (frames.len() as u32).div_ceil(columns).max(1);
    let size = (columns * CELL, rows * (CELL + CELL_WORDS) + LEGEND);
    let side = px(f64::from(CELL - 4));
    let corner = |k: usize| {
        let (column, row) = (k as u32 % columns, k as u32 / columns);
        let at = |cells: u32, size: u32| px(f64::from(cells * size));
        (at(column, CELL), at(row, CELL + CELL_WORDS))
    };
    let fill = |pixels: &mut [u8]| {
        for (k, frame) in frames.iter().enumerate() {
            paint(pixels, size.0, &frame.image, corner(k), side);
        }
    };
    let values = canvas::rgb_pixels(size, fill, |area| {
        for (k, frame) in frames.iter().enumerate() {
            let (left, top) = corner(k);
            draw_marks(area, frame, (left, top), side, false)?;
            let lines = canvas::wrapped(&frame.words, CELL_TEXT, side);
            let words = std::iter::once(&frame.name).chain(&lines).take(3);
            for (line, words) in (0..).zip(words) {
                let words = canvas::fitted(words, &canvas::font(CELL_TEXT), side);
                let down = px(10.0 + CELL_LINE * f64::from(line));
                let at = (left + px(2.0), top + side + down);
                canvas::text(area, &words, at, HPos::Left, CELL_TEXT, ink(frame))?;
            }
        }
        let marks = frames.first().map(|frame| &frame.marks);
        let top = px(f64::from(size.1 - LEGEND));
        draw_legend(area, top, marks.unwrap_or(&OverlayMarks::default()))
    })?;
    crate::files::write_bytes(path, &canvas::photograph_png(size, &values)?)
}

/// What the marks mean, on a dark strip from `top` to the bottom.
fn draw_legend(area: &Area<'_>, top: i32, marks: &OverlayMarks) -> Drawn {
    let (width, height) = area.dim_in_pixel();
    let strip = [(0, top), (width as i32, height as i32)];
    area.draw(&Rectangle::new(strip, INK.filled()))?;
    let (y, r) = (top + px(0.5 * f64::from(LEGEND)), px(5.0));
    let mut x = px(6.0) + r;
    for (words, color, sign) in marks.legend() {
        let (color, stroke) = (*color, canvas::stroke(*color, 1.5));
        match sign {
            Sign::Ring => area.draw(&Circle::new((x, y), r, stroke))?,
            Sign::Cross => draw_cross(area, (x, y), r, color)?,
            Sign::Line => draw_line(area, [(x - r, y), (x + r, y)], stroke)?,
        }
        x += r + px(5.0);
        canvas::text(area, words, (x, y), HPos::Left, LEGEND_TEXT, WHITE)?;
        x += canvas::text_width(words, LEGEND_TEXT) + px(10.0) + r;
    }
    Ok(())
}

fn draw_line(area: &Area<'_>, ends: [(i32, i32); 2], style: ShapeStyle) -> Drawn {
    area.draw(&PathElement::new(ends.to_vec(), style))?;
    Ok(())
}

fn draw_cross(area: &Area<'_>, (x, y): (i32, i32), arm: i32, color: RGBColor) -> Drawn {
    for ends in [[(x - arm, y), (x + arm, y)], [(x, y - arm), (x, y + arm)]] {
        draw_line(area, ends, canvas::stroke(color, 1.0))?;
    }
    Ok(())
}

fn ink(frame: &OverlayFrame) -> RGBColor {
    if frame.refused {
        RGBColor(190, 30, 30)
    } else {
        INK
    }
}

/// Draws a frame's marks into a square of `side` drawn pixels.
fn draw_marks(
    area: &Area<'_>,
    frame: &OverlayFrame,
    (left, top): (i32, i32),
    side: i32,
    in_full: bool,
) -> Drawn {
    let (width, height) = (frame.image.width() as f64, frame.image.height() as f64);
    let zoom = f64::from(side) / width.max(height);
    // A pixel's center is half a pixel from its corner.
    let place = |p: &Pixel| {
        let at = |x: f64, from: i32| from + (zoom * (x + 0.5)).round() as i32;
        (at(p.u, left), at(p.v, top))
    };
    let inside = |p: &Pixel| p.u > -0.5 && p.v > -0.5 && p.u < width - 0.5 && p.v < height - 0.5;
    let thin = canvas::stroke(OUTLINE, 1.0);
    for outline in &frame.outlines {
        let points = (0..=180).map(|k| outline.circle.rim(f64::from(k) * 2f64.to_radians()));
        // Drawn in pieces, where it lies within the picture.
        let points: Vec<Pixel> = points.collect();
        for pair in points.windows(2).filter(|w| w.iter().all(inside)) {
            draw_line(area, [place(&pair[0]), place(&pair[1])], thin)?;
        }
    }
    let labels = match &frame.marks {
        OverlayMarks::Dots { found, expected } => {
            let found = found.iter().filter(|dot| inside(&dot.pixel));
            let expected = expected.iter().filter(|(_, at, _)| inside(at));
            draw_dots(area, found, expected, place, in_full)?
        }
        OverlayMarks::Paint(pieces) => {
            for piece in pieces.iter().filter(|ends| ends.iter().all(inside)) {
                let ends = [place(&piece[0]), place(&piece[1])];
                draw_line(area, ends, canvas::stroke(EXPECTED, 1.0))?;
            }
            DotLabels::default()
        }
    };
    // Inside, below the top: no other place is within the picture whenever the ball is.
    for outline in &frame.outlines {
        let below_top = Pixel {
            u: outline.circle.center.u,
            v: outline.circle.center.v - 0.85 * outline.circle.radius,
        };
        if let Some(number) = outline.number.filter(|_| inside(&below_top)) {
            tag(area, &number.to_string(), place(&below_top), SMALL, OUTLINE)?;
        }
    }
    match in_full {
        true => labels.draw(area),
        false => Ok(()),
    }
}

/// A label, and the place and radius of the mark that it is of.
type Label = ((i32, i32), i32, String, RGBColor);

/// The words beside the dots of a frame.
#[derive(Default)]
struct DotLabels {
    /// What is taken by the dots.
    places: LabelPlaces,
    numbers: Vec<Label>,
    shares: Vec<Label>,
}

impl DotLabels {
    /// Numbers to the upper right of their crosses, probabilities below their circles; where there is no free place, none.
    fn draw(mut self, area: &Area<'_>) -> Drawn {
        for (labels, preferred) in [(self.numbers, -FRAC_PI_4), (self.shares, FRAC_PI_2)] {
            for (at, radius, words, color) in labels {
                let (w, h) = (canvas::text_width(&words, LABEL_TEXT), px(0.9 * LABEL_TEXT));
                let size = (w + px(2.0), h);
                if let Some((x, y)) = self.places.beside(at, radius, size, preferred) {
                    tag(area, &words, (x, y), LABEL_TEXT, color)?;
                }
            }
        }
        Ok(())
    }
}

/// Draws detections and expected dots; what is to be said of them.
fn draw_dots<'a>(
    area: &Area<'_>,
    found: impl Iterator<Item = &'a OverlayDot>,
    expected: impl Iterator<Item = &'a (u16, Pixel, f64)>,
    place: impl Fn(&Pixel) -> (i32, i32),
    in_full: bool,
) -> Drawn<DotLabels> {
    let r = if in_full { px(9.0) } else { px(5.0) };
    let mut labels = DotLabels::default();
    for dot in found {
        let color = if dot.named { NAMED } else { UNNAMED };
        let at = place(&dot.pixel);
        area.draw(&Circle::new(at, r, canvas::stroke(color, 1.2)))?;
        labels.places.keep(at, r);
        let share = format!("{:.0}", 100.0 * dot.probability);
        labels.shares.push((at, r, share, color));
    }
    for (number, pixel, z) in expected {
        let at = place(pixel);
        // Smaller towards the limb, where dots are hardly seen.
        let arm = px(if in_full { 3.0 } else { 1.5 } + 2.0 * z);
        draw_cross(area, at, arm, EXPECTED)?;
        labels.places.keep(at, arm);
        labels.numbers.push((at, arm, number.to_string(), EXPECTED));
    }
    Ok(labels)
}

/// Words around a place, on a darkened ground, so that they can be read on any ball.
fn tag(area: &Area<'_>, words: &str, (x, y): (i32, i32), size: f64, color: RGBColor) -> Drawn {
    let half = (
        canvas::text_width(words, size) / 2 + px(1.0),
        px(0.9 * size) / 2,
    );
    let ground = [(x - half.0, y - half.1), (x + half.0, y + half.1)];
    area.draw(&Rectangle::new(ground, BLACK.mix(0.6).filled()))?;
    canvas::text(area, words, (x, y), HPos::Center, size, color)
}

/// Paints a picture into a square of `side` drawn pixels, with smooth transitions. `pixels` are those of
/// a picture of `width` file pixels.
fn paint(pixels: &mut [u8], width: u32, image: &RgbImage, (left, top): (i32, i32), side: i32) {
    let stride = 3 * (width * SCALE) as usize;
    let zoom = f64::from(side) / image.width().max(image.height()).max(1) as f64;
    let drawn = |length: usize| (zoom * length as f64).round() as usize;
    let (columns, rows) = (drawn(image.width()), drawn(image.height()));
    let (left, top) = (3 * left.max(0) as usize, top.max(0) as usize);
    if image.values().is_empty() {
        return;
    }
    for (y, row) in pixels
        .chunks_exact_mut(stride)
        .skip(top)
        .take(rows)
        .enumerate()
    {
        let v = (y as f64 + 0.5) / zoom - 0.5;
        for (x, pixel) in row[left..].chunks_exact_mut(3).take(columns).enumerate() {
            let u = (x as f64 + 0.5) / zoom - 0.5;
            pixel.copy_from_slice(&image.sample(u, v).map(|c| (255.0 * c + 0.5) as u8));
        }
    }
}
