//! Drawings as PDF, true to size.
//!
//! One point is 1/72 inch; every coordinate is scaled by 72 / 25.4, and the content streams are not
//! compressed, so that any tool reads them. Words are set in Helvetica, which every reader has. The
//! note lies in the document's keywords.

use pdf_writer::types::LineJoinStyle;
use pdf_writer::{Content, Name, Pdf, Rect, Ref, Str, TextStr};

use super::drawing::{Anchor, CAPITAL, Drawing, Item, Layer, Page, Point, Shape, text_width};

/// Points in a millimeter.
const POINTS: f64 = 72.0 / 25.4;
/// The font's name in the pages' resources.
const FONT: Name<'_> = Name(b"F1");

/// A drawing as a PDF file's bytes.
pub fn pdf_bytes(drawing: &Drawing) -> Vec<u8> {
    let count = drawing.pages.len() as i32;
    let (catalog, tree, font, info) = (Ref::new(1), Ref::new(2), Ref::new(3), Ref::new(4));
    let page_id = |i: i32| Ref::new(5 + 2 * i);
    let content_id = |i: i32| Ref::new(6 + 2 * i);
    let mut pdf = Pdf::new();
    pdf.catalog(catalog).pages(tree);
    pdf.pages(tree).kids((0..count).map(page_id)).count(count);
    pdf.type1_font(font)
        .base_font(Name(b"Helvetica"))
        .encoding_predefined(Name(b"WinAnsiEncoding"));
    pdf.document_info(info)
        .title(TextStr(&drawing.title))
        .keywords(TextStr(&drawing.note_json()))
        .producer(TextStr(concat!("spindoe ", env!("CARGO_PKG_VERSION"))));
    for (i, page) in (0..count).zip(&drawing.pages) {
        let size = [page.width_mm, page.height_mm].map(|mm| (mm * POINTS) as f32);
        let mut written = pdf.page(page_id(i));
        written
            .parent(tree)
            .media_box(Rect::new(0.0, 0.0, size[0], size[1]))
            .contents(content_id(i));
        written.resources().fonts().pair(FONT, font);
        drop(written);
        pdf.stream(content_id(i), &content(drawing, page));
    }
    pdf.finish()
}

/// What a page draws.
fn content(drawing: &Drawing, page: &Page) -> Vec<u8> {
    let mut content = Content::new();
    content.set_line_width((drawing.line_mm * POINTS) as f32);
    content.set_line_join(LineJoinStyle::RoundJoin);
    for layer in Layer::ALL {
        let [r, g, b] = layer.color().map(|c| f32::from(c) / 255.0);
        content.set_stroke_rgb(r, g, b);
        content.set_fill_rgb(r, g, b);
        for item in page.items.iter().filter(|i| i.layer == layer) {
            draw(&mut content, item);
        }
    }
    content.finish().into_vec()
}

fn draw(content: &mut Content, item: &Item) {
    match &item.shape {
        Shape::Area(points) => {
            path(content, points);
            content.close_path().fill_nonzero();
        }
        Shape::Loop(points) => {
            path(content, points);
            content.close_path().stroke();
        }
        Shape::Line(points) => {
            path(content, points);
            content.stroke();
        }
        Shape::Text {
            at,
            anchor,
            height_mm,
            words,
        } => {
            let size = height_mm / CAPITAL;
            let width = text_width(words, *height_mm);
            let shift = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => 0.5 * width,
                Anchor::End => width,
            };
            content
                .begin_text()
                .set_font(FONT, (size * POINTS) as f32)
                .next_line(((at.x - shift) * POINTS) as f32, (at.y * POINTS) as f32)
                .show(Str(&encoded(words)))
                .end_text();
        }
    }
}

/// Words in the font's encoding, which is Latin-1 where that has printed characters.
fn encoded(words: &str) -> Vec<u8> {
    let byte = |c: char| u8::try_from(u32::from(c)).unwrap_or(b'?');
    words.chars().map(byte).collect()
}

fn path(content: &mut Content, points: &[Point]) {
    for (i, p) in points.iter().enumerate() {
        let (x, y) = ((p.x * POINTS) as f32, (p.y * POINTS) as f32);
        match i {
            0 => content.move_to(x, y),
            _ => content.line_to(x, y),
        };
    }
}
