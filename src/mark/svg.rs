//! Drawings as SVG, true to size.
//!
//! One user unit is a millimeter, or a plotter's step; y runs down, from the page's upper edge. Each layer is a group
//! that Inkscape shows as a layer; shapes of a dot carry `data-dot`. The note lies in `<metadata>`.

use svg::Document;
use svg::node::Node as _;
use svg::node::element::path::Data;
use svg::node::element::{Element, Group, Path, Text, Title};

use super::drawing::{Anchor, CAPITAL, Drawing, Item, Layer, Page, Point, Shape};

/// A drawing's pages as SVG documents, one each.
pub fn svg_text(drawing: &Drawing) -> Vec<String> {
    let pages = drawing.pages.iter();
    pages
        .map(|page| document(drawing, page).to_string())
        .collect()
}

fn document(drawing: &Drawing, page: &Page) -> Document {
    let (w, h) = (page.width_mm, page.height_mm);
    // EggBot's driver scales a width in millimeters to pixels of 96 an inch, by 3.78.
    let unit = if drawing.is_in_steps { "" } else { "mm" };
    let mut metadata = Element::new("metadata");
    metadata.append(svg::node::Text::new(drawing.note_json()));
    let mut document = Document::new()
        .set("width", format!("{}{unit}", rounded(w)))
        .set("height", format!("{}{unit}", rounded(h)))
        .set("viewBox", format!("0 0 {} {}", rounded(w), rounded(h)))
        .set(
            "xmlns:inkscape",
            "http://www.inkscape.org/namespaces/inkscape",
        )
        .add(Title::new(drawing.title.clone()))
        .add(metadata);
    for layer in Layer::ALL {
        let items: Vec<_> = page.items.iter().filter(|i| i.layer == layer).collect();
        if items.is_empty() {
            continue;
        }
        let [r, g, b] = layer.color();
        let color = format!("#{r:02x}{g:02x}{b:02x}");
        let mut group = Group::new()
            .set("id", layer.name())
            .set("inkscape:groupmode", "layer")
            .set("inkscape:label", layer.name())
            .set("fill", "none")
            .set("stroke", color.clone())
            .set("stroke-width", drawing.line_mm);
        for item in items {
            group = add(group, item, h, &color);
        }
        document = document.add(group);
    }
    document
}

/// A coordinate to a micrometer.
fn rounded(mm: f64) -> f64 {
    (mm * 1e3).round() / 1e3
}

fn data(points: &[Point], height: f64) -> Data {
    let at = |p: &Point| (rounded(p.x), rounded(height - p.y));
    let mut data = Data::new();
    for (i, p) in points.iter().enumerate() {
        data = match i {
            0 => data.move_to(at(p)),
            _ => data.line_to(at(p)),
        };
    }
    data
}

fn add(group: Group, item: &Item, height: f64, color: &str) -> Group {
    let tagged = |path: Path| match item.dot {
        Some(dot) => path.set("data-dot", dot),
        None => path,
    };
    match &item.shape {
        Shape::Area(points) => {
            let path = Path::new().set("d", data(points, height).close());
            group.add(tagged(path.set("fill", color).set("stroke", "none")))
        }
        Shape::Loop(points) => {
            group.add(tagged(Path::new().set("d", data(points, height).close())))
        }
        Shape::Line(points) => group.add(tagged(Path::new().set("d", data(points, height)))),
        Shape::Text {
            at,
            anchor,
            height_mm,
            words,
        } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let text = Text::new(words.clone())
                .set("x", rounded(at.x))
                .set("y", rounded(height - at.y))
                .set("font-family", "Helvetica, Arial, sans-serif")
                .set("font-size", rounded(height_mm / CAPITAL))
                .set("text-anchor", anchor)
                .set("fill", color)
                .set("stroke", "none");
            group.add(match item.dot {
                Some(dot) => text.set("data-dot", dot),
                None => text,
            })
        }
    }
}
