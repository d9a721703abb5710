//! The parts that all plots share: a picture in memory, text, marks, legends, axes, and writing the
//! file.
//!
//! Pictures are drawn at [`SCALE`] times their size and averaged down, which smooths the edges of
//! everything alike. Lengths in this module and its users are in drawn pixels: [`px`] converts.

use std::path::Path;
use std::sync::OnceLock;

use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axis::Axis;
use super::backend::{Backend, svg_file};
use crate::error::{Error, Result};
use crate::files;
use crate::stencil::BOLD_FONT;

/// Drawn pixels per pixel of the file, along either axis.
pub(super) const SCALE: u32 = 2;
/// The name under which the built-in font is registered.
pub(super) const FONT: &str = "spindoe-sans";
/// The built-in font, so that a machine without fonts draws the same.
static REGULAR_FONT: &[u8] = include_bytes!("../fonts/DejaVuSans.ttf");
/// Fonts that an SVG names, like the built-in one first.
const SVG_FONTS: &str = "DejaVu Sans, Verdana, sans-serif";
/// Size of a title, in file pixels.
const TITLE: f64 = 22.0;
/// Size of axis labels and legends, in file pixels.
pub(super) const LABEL: f64 = 17.0;
/// Size of tick labels and notes, in file pixels.
pub(super) const SMALL: f64 = 15.0;
/// Color of text and axes.
pub(super) const INK: RGBColor = RGBColor(38, 38, 38);
/// Color of grid lines.
pub(super) const GRID: RGBColor = RGBColor(226, 226, 226);

/// The Okabe-Ito colors (without yellow, too pale on white): distinguishable by color-blind readers
/// too.
const PALETTE: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(90, 90, 90),
];

/// Part of a picture, in drawn pixels.
pub(super) type Area<'a> = DrawingArea<Backend<'a>, Shift>;
/// A chart with axes, in the axes' positions.
pub(super) type Chart<'a> = ChartContext<'a, Backend<'a>, Cartesian2d<Axis, Axis>>;
/// The outcome of drawing. Data are checked beforehand, so that no input should make it fail.
pub(super) type Drawn<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

/// File pixels in drawn pixels.
pub(super) fn px(length: f64) -> i32 {
    (length * f64::from(SCALE)).round() as i32
}

/// The color of the `i`-th series.
pub(super) fn color(i: usize) -> RGBColor {
    PALETTE[i % PALETTE.len()]
}

/// Registers the built-in font, once for all threads.
fn register_font() -> Result<()> {
    static REGISTERED: OnceLock<bool> = OnceLock::new();
    let registered = *REGISTERED.get_or_init(|| {
        [
            (FontStyle::Normal, REGULAR_FONT),
            // The cut that engraves the stencil's numbers, too.
            (FontStyle::Bold, BOLD_FONT),
        ]
        .into_iter()
        .all(|(style, bytes)| plotters::style::register_font(FONT, style, bytes).is_ok())
    });
    if registered {
        Ok(())
    } else {
        Err(Error::Internal("the built-in font is unreadable".into()))
    }
}

/// Draws a picture of `size` (width, height; file pixels) and writes it to `path`: as SVG where that
/// is the name's ending, else as PNG.
///
/// # Errors
/// [`Error::Write`] where the system refuses, [`Error::Internal`] where drawing fails.
pub(super) fn picture(
    path: &Path,
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<()> {
    let bytes = if path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("svg"))
    {
        svg_bytes(size, draw)?
    } else {
        png_bytes(size, draw)?
    };
    files::write_bytes(path, &bytes)
}

/// Runs `draw` on a backend.
fn drawn_on(backend: Backend<'_>, draw: impl FnOnce(&Area<'_>) -> Drawn) -> Result<()> {
    let area = backend.into_drawing_area();
    draw(&area).map_err(|e| Error::Internal(format!("plot: {e}")))?;
    area.present()
        .map_err(|e| Error::Internal(format!("plot: {e}")))
}

/// A picture as a PNG file.
///
/// # Errors
/// [`Error::Internal`] where drawing fails.
pub(super) fn png_bytes(
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<Vec<u8>> {
    let pixels = rgb_pixels(size, |_| (), draw)?;
    encode(
        size,
        &pixels,
        png::ColorType::Rgb,
        png::Compression::Balanced,
    )
    .map_err(|e| Error::Internal(format!("plot: {e}")))
}

/// As [`png_bytes`], of a picture that is mostly a photograph: compressing it well takes longer than
/// all the rest and saves little.
#[cfg(feature = "vision")]
pub(super) fn photograph_png(size: (u32, u32), pixels: &[u8]) -> Result<Vec<u8>> {
    encode(size, pixels, png::ColorType::Rgb, png::Compression::Fast)
        .map_err(|e| Error::Internal(format!("plot: {e}")))
}

/// A picture's pixels: red, green, blue, row after row. `fill` paints the drawn pixels before anything
/// is drawn.
///
/// # Errors
/// [`Error::Internal`] where drawing fails.
pub(super) fn rgb_pixels(
    size: (u32, u32),
    fill: impl FnOnce(&mut [u8]),
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<Vec<u8>> {
    register_font()?;
    let (width, height) = (size.0 * SCALE, size.1 * SCALE);
    let mut pixels = vec![255u8; width as usize * height as usize * 3];
    fill(&mut pixels);
    let bitmap = BitMapBackend::with_buffer(&mut pixels, (width, height));
    drawn_on(Backend::Bitmap(bitmap), draw)?;
    Ok(averaged(size, &pixels))
}

/// A picture as an SVG file.
///
/// # Errors
/// [`Error::Internal`] where drawing fails.
fn svg_bytes(size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Drawn) -> Result<Vec<u8>> {
    register_font()?;
    let drawn_size = (size.0 * SCALE, size.1 * SCALE);
    let mut text = String::new();
    let mut pixels = vec![0u8; drawn_size.0 as usize * drawn_size.1 as usize * 4];
    let shapes = SVGBackend::with_string(&mut text, drawn_size);
    drawn_on(Backend::Svg(shapes, &mut pixels), draw)?;
    let rgba = png::ColorType::Rgba;
    let png = pixels
        .iter()
        .any(|p| *p != 0)
        .then(|| encode(drawn_size, &pixels, rgba, png::Compression::Balanced))
        .transpose()
        .map_err(|e| Error::Internal(format!("plot: {e}")))?;
    svg_file(&text, size, FONT, SVG_FONTS, png.as_deref())
        .map(String::into_bytes)
        .ok_or_else(|| Error::Internal("plot: the library's SVG has no view box".into()))
}

/// The drawn pixels averaged down to `size`.
fn averaged(size: (u32, u32), drawn: &[u8]) -> Vec<u8> {
    let scale = SCALE as usize;
    let (width, height) = (size.0 as usize, size.1 as usize);
    let stride = width * scale * 3;
    let mut pixels = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        for x in 0..width {
            for channel in 0..3 {
                let corner = y * scale * stride + x * scale * 3 + channel;
                let sum: usize = (0..scale * scale)
                    .map(|i| usize::from(drawn[corner + i / scale * stride + i % scale * 3]))
                    .sum();
                pixels.push((sum / (scale * scale)) as u8);
            }
        }
    }
    pixels
}

/// Pixels as a PNG file.
fn encode(
    size: (u32, u32),
    pixels: &[u8],
    color: png::ColorType,
    compression: png::Compression,
) -> std::result::Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size.0, size.1);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(compression);
    encoder.set_filter(png::Filter::Adaptive);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}

/// The built-in font at `size` file pixels.
pub(super) fn font(size: f64) -> FontDesc<'static> {
    (FONT, size * f64::from(SCALE)).into_font()
}

/// As [`font`], bold.
pub(super) fn bold(size: f64) -> FontDesc<'static> {
    (FONT, size * f64::from(SCALE), FontStyle::Bold).into_font()
}

/// `text` set in `font`, cut short where it is wider than `available` drawn pixels.
pub(super) fn fitted(text: &str, font: &FontDesc<'_>, available: i32) -> String {
    let width = |t: &str| font.box_size(t).map_or(0, |b| b.0 as i32);
    let mut fitted = text.to_owned();
    while width(&fitted) > available {
        let kept = fitted.trim_end_matches('\u{2026}').chars().count();
        if kept == 0 {
            return String::new();
        }
        fitted = text.chars().take(kept - 1).chain(['\u{2026}']).collect();
    }
    fitted
}

/// `text` broken between words into lines of at most `available` drawn pixels.
pub(super) fn wrapped(text: &str, size: f64, available: i32) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), size) <= available => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Width of `text` in drawn pixels.
pub(super) fn text_width(text: &str, size: f64) -> i32 {
    font(size).box_size(text).map_or(0, |b| b.0 as i32)
}

/// Writes `text` vertically centered on `at`, with its left end, middle or right end there.
pub(super) fn text(
    area: &Area<'_>,
    text: &str,
    at: (i32, i32),
    anchor: HPos,
    size: f64,
    color: RGBColor,
) -> Drawn {
    styled_text(area, text, at, anchor, font(size), color)
}

/// As [`text`], in any font.
pub(super) fn styled_text(
    area: &Area<'_>,
    text: &str,
    at: (i32, i32),
    anchor: HPos,
    font: FontDesc<'_>,
    color: RGBColor,
) -> Drawn {
    // The library sets the baseline half a font size below the anchor's top, whatever the box it
    // reports; capitals of this font are 0.626 sizes high: their middle is 0.187 sizes below it.
    let top = at.1 - (font.get_size() * 0.187).round() as i32;
    let style = font.color(&color).pos(Pos::new(anchor, VPos::Top));
    area.draw_text(text, &style, (at.0, top))?;
    Ok(())
}

/// Writes the title on top of `area` and returns what is left beneath.
pub(super) fn titled<'a>(area: &Area<'a>, title: &str) -> Drawn<Area<'a>> {
    let (width, _) = area.dim_in_pixel();
    let mut size = TITLE;
    // An SVG is shown in the reader's own font, which is a tenth wider.
    let available = 9 * (width as i32 - px(30.0)) / 10;
    while size > LABEL && bold(size).box_size(title)?.0 as i32 > available {
        size -= 1.0;
    }
    let font = bold(size);
    let title = fitted(title, &font, available);
    let at = (width as i32 / 2, px(24.0));
    styled_text(area, &title, at, HPos::Center, font, INK)?;
    Ok(area.split_vertically(px(44.0)).1)
}

/// One entry of a legend.
pub(super) struct Key {
    /// What it explains.
    pub name: String,
    /// How it is drawn.
    pub sign: LegendSign,
}

/// The sign in a legend.
pub(super) enum LegendSign {
    /// A line with the marks of series `i`.
    Series(usize),
    /// A plain line in the color of series `i`.
    Line(usize),
    /// A filled box in the color of series `i`.
    Box(usize),
    /// A dashed gray line.
    Dashes,
}

/// A legend's line: the width used, and its entries with their offsets (drawn pixels).
type LegendLine<'a> = (i32, Vec<(i32, &'a LegendSign, String)>);

/// Writes a legend on top of `area`, in as many lines as it needs, and returns what is left
/// beneath.
pub(super) fn with_legend<'a>(area: &Area<'a>, keys: &[Key]) -> Drawn<Area<'a>> {
    let available = area.dim_in_pixel().0 as i32 - px(40.0);
    let mut lines: Vec<LegendLine<'_>> = Vec::new();
    for key in keys.iter().filter(|k| !k.name.is_empty()) {
        let name = fitted(&key.name, &font(LABEL), available - px(68.0));
        let width = px(42.0) + text_width(&name, LABEL) + px(26.0);
        match lines.last_mut() {
            Some((used, line)) if *used + width <= available => {
                line.push((*used, &key.sign, name));
                *used += width;
            }
            _ => lines.push((width, vec![(0, &key.sign, name)])),
        }
    }
    for (row, (used, line)) in lines.iter().enumerate() {
        let left = px(20.0) + (available - used).max(0) / 2;
        let y = px(10.0 + 26.0 * row as f64);
        for (x, sign, name) in line {
            draw_sign(area, sign, (left + x, y))?;
            let at = (left + x + px(42.0), y);
            text(area, name, at, HPos::Left, LABEL, INK)?;
        }
    }
    Ok(area.split_vertically(px(6.0 + 26.0 * lines.len() as f64)).1)
}

/// Draws a legend's sign rightwards from `at`.
fn draw_sign(area: &Area<'_>, sign: &LegendSign, (x, y): (i32, i32)) -> Drawn {
    let ends = |from: f64, to: f64| vec![(x + px(from), y), (x + px(to), y)];
    match sign {
        LegendSign::Series(i) => {
            area.draw(&PathElement::new(ends(0.0, 34.0), stroke(color(*i), 2.0)))?;
            mark(area, *i, (x + px(17.0), y))?;
        }
        LegendSign::Line(i) => {
            area.draw(&PathElement::new(ends(0.0, 34.0), stroke(color(*i), 2.5)))?;
        }
        LegendSign::Box(i) => {
            let corners = [(x + px(10.0), y - px(8.0)), (x + px(32.0), y + px(8.0))];
            area.draw(&Rectangle::new(corners, color(*i).filled()))?;
        }
        LegendSign::Dashes => {
            for from in [0.0, 13.0, 26.0] {
                area.draw(&PathElement::new(ends(from, from + 8.0), stroke(GRAY, 2.0)))?;
            }
        }
    }
    Ok(())
}

/// Color of reference lines.
pub(super) const GRAY: RGBColor = RGBColor(120, 120, 120);

/// A line style, `width` in file pixels.
pub(super) fn stroke(color: RGBColor, width: f64) -> ShapeStyle {
    color.stroke_width(px(width).max(1) as u32)
}

/// The mark of series `i` at `at`: shapes differ too, for readers without color.
pub(super) fn mark(area: &Area<'_>, i: usize, at: (i32, i32)) -> Drawn {
    let style = color(i).filled();
    let r = px(4.5);
    let polygon = |offsets: &[(i32, i32)]| {
        Polygon::new(
            offsets
                .iter()
                .map(|(dx, dy)| (at.0 + dx, at.1 + dy))
                .collect::<Vec<_>>(),
            style,
        )
    };
    match i % 4 {
        0 => area.draw(&Circle::new(at, r, style))?,
        1 => {
            let s = r - px(0.5);
            area.draw(&Rectangle::new(
                [(at.0 - s, at.1 - s), (at.0 + s, at.1 + s)],
                style,
            ))?;
        }
        2 => area.draw(&polygon(&[
            (0, -r * 5 / 4),
            (r * 5 / 4, r),
            (-r * 5 / 4, r),
        ]))?,
        _ => {
            let s = r * 5 / 4;
            area.draw(&polygon(&[(0, -s), (s, 0), (0, s), (-s, 0)]))?;
        }
    }
    Ok(())
}

/// Draws axes, grid, ticks and axis labels into `area`.
pub(super) fn chart<'a>(
    area: &Area<'a>,
    (x, x_label): (&Axis, &str),
    (y, y_label): (&Axis, &str),
    with_grid: (bool, bool),
) -> Drawn<Chart<'a>> {
    let widest = y
        .ticks
        .iter()
        .map(|t| text_width(&y.label(*t), SMALL))
        .max()
        .unwrap_or(0);
    let mut chart = ChartBuilder::on(area)
        .margin_top(px(12.0))
        .margin_right(px(26.0))
        .margin_bottom(px(6.0))
        .margin_left(px(14.0))
        .x_label_area_size(px(56.0))
        .y_label_area_size(widest + px(44.0))
        .build_cartesian_2d(x.clone(), y.clone())?;
    let x_text = |v: &f64| x.label(*v);
    let y_text = |v: &f64| y.label(*v);
    let (width, height) = chart.plotting_area().dim_in_pixel();
    let x_label = fitted(x_label, &font(LABEL), width as i32);
    let y_label = fitted(y_label, &font(LABEL), height as i32);
    let mut mesh = chart.configure_mesh();
    if !with_grid.0 {
        mesh.disable_x_mesh();
    }
    if !with_grid.1 {
        mesh.disable_y_mesh();
    }
    mesh.x_desc(x_label)
        .y_desc(y_label)
        .x_label_formatter(&x_text)
        .y_label_formatter(&y_text)
        .axis_style(stroke(INK, 1.0))
        .bold_line_style(stroke(GRID, 1.0))
        .light_line_style(TRANSPARENT)
        // The library centers a box that the text does not fill: see `styled_text`.
        .y_label_offset(px(2.5))
        .label_style(font(SMALL).color(&INK))
        .axis_desc_style(font(LABEL).color(&INK))
        .set_all_tick_mark_size(px(5.0))
        .draw()?;
    Ok(chart)
}
