//! Drawings as DXF, for cutters and CAD.
//!
//! Format: DXF release 12 in ASCII (Autodesk, "DXF reference", group codes), the one that every
//! program reads: POLYLINE and TEXT entities on named layers, coordinates in millimeters. Outlines
//! are not filled: cutters follow them. The format is written here because the available crate has
//! forty dependencies and puts the time of day into its files.

use std::fmt::{Display, Write as _};

use super::drawing::{Anchor, Drawing, Item, Layer, Point, Shape};

/// Longest comment, characters: release 12 allows 255.
const COMMENT: usize = 200;
/// Space between pages, which lie side by side in a file without pages, mm.
const PAGE_GAP_MM: f64 = 10.0;

/// A drawing as the text of a DXF file; its pages side by side.
pub fn dxf_text(drawing: &Drawing) -> String {
    let mut out = Groups(String::new());
    // Comments: the title, then the note in pieces, each begun with its number.
    out.group(999, &drawing.title);
    let note = drawing.note_json();
    for (k, piece) in note.as_bytes().chunks(COMMENT).enumerate() {
        out.group(
            999,
            format_args!("note {k} {}", String::from_utf8_lossy(piece)),
        );
    }
    out.section("HEADER", |out| {
        out.group(9, "$ACADVER");
        out.group(1, "AC1009");
        out.group(9, "$MEASUREMENT");
        out.group(70, 1);
    });
    out.section("TABLES", |out| {
        out.group(0, "TABLE");
        out.group(2, "LAYER");
        out.group(70, Layer::ALL.len());
        for layer in Layer::ALL {
            out.group(0, "LAYER");
            out.group(2, layer.name().to_uppercase());
            out.group(70, 0);
            out.group(62, color_index(layer));
            out.group(6, "CONTINUOUS");
        }
        out.group(0, "ENDTAB");
    });
    out.section("ENTITIES", |out| {
        let mut left = 0.0;
        for page in &drawing.pages {
            for item in &page.items {
                entity(out, item, left);
            }
            left += page.width_mm + PAGE_GAP_MM;
        }
    });
    out.group(0, "EOF");
    out.0
}

/// AutoCAD's color number of a layer.
fn color_index(layer: Layer) -> u8 {
    match layer {
        Layer::Cut => 1,
        Layer::KeepOut => 30,
        Layer::Dots => 7,
        Layer::Notes => 8,
        Layer::Names => 254,
        Layer::Guides => 9,
    }
}

fn entity(out: &mut Groups, item: &Item, left: f64) {
    let layer = item.layer.name().to_uppercase();
    let (points, closed) = match &item.shape {
        Shape::Area(points) | Shape::Loop(points) => (points, true),
        Shape::Line(points) => (points, false),
        Shape::Text {
            at,
            anchor,
            height_mm,
            words,
        } => {
            out.group(0, "TEXT");
            out.group(8, layer);
            out.point(10, at, left);
            out.group(40, height_mm);
            // Release 12 is ASCII and has a code for the sign.
            out.group(1, words.replace('°', "%%d"));
            let anchor = match anchor {
                Anchor::Start => 0,
                Anchor::Middle => 1,
                Anchor::End => 2,
            };
            out.group(72, anchor);
            // Where text is not set from its left end, the second point counts.
            out.point(11, at, left);
            return;
        }
    };
    out.group(0, "POLYLINE");
    out.group(8, &layer);
    out.group(66, 1);
    out.group(70, u8::from(closed));
    for p in points {
        out.group(0, "VERTEX");
        out.group(8, &layer);
        out.point(10, p, left);
    }
    out.group(0, "SEQEND");
    out.group(8, &layer);
}

/// Pairs of group code and value, a line each.
struct Groups(String);

impl Groups {
    fn group(&mut self, code: u16, value: impl Display) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.0, "{code:>3}\n{value}");
    }

    fn section(&mut self, name: &str, fill: impl FnOnce(&mut Self)) {
        self.group(0, "SECTION");
        self.group(2, name);
        fill(self);
        self.group(0, "ENDSEC");
    }

    /// A point, moved right by `left`; its codes are `code`, `code + 10` and `code + 20`.
    fn point(&mut self, code: u16, p: &Point, left: f64) {
        self.group(code, format_args!("{:.4}", p.x + left));
        self.group(code + 10, format_args!("{:.4}", p.y));
        self.group(code + 20, "0.0");
    }
}
