//! Flat drawings, before they become SVG, PDF or DXF.
//!
//! Coordinates are millimeters from the page's lower left corner, x to the right, y up.

use serde_json::{Map, Value};

/// A point of a page, mm.
pub type Point = nalgebra::Point2<f64>;

/// What a shape is for; files keep layers apart, so that a cutter follows the chosen lines only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// Lines to cut.
    Cut,
    /// Where color may run to beyond the cut.
    Bleed,
    /// The dots.
    Dots,
    /// Outlines of zones that stay free.
    KeepOut,
    /// Numbers and other words, outside what goes on the ball.
    Notes,
    /// Lines that help: the check line, meridians of a map.
    Guides,
}

impl Layer {
    /// All layers, from the lowest to the topmost.
    pub const ALL: [Self; 6] = [
        Self::Bleed,
        Self::Guides,
        Self::KeepOut,
        Self::Dots,
        Self::Cut,
        Self::Notes,
    ];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cut => "cut",
            Self::Bleed => "bleed",
            Self::Dots => "dots",
            Self::KeepOut => "keep-out",
            Self::Notes => "notes",
            Self::Guides => "guides",
        }
    }

    /// Red, green and blue in [0, 255].
    pub(super) fn color(self) -> [u8; 3] {
        match self {
            Self::Cut => [214, 40, 40],
            Self::Bleed => [120, 180, 230],
            Self::Dots => [0, 0, 0],
            Self::KeepOut => [230, 140, 20],
            Self::Notes => [70, 70, 70],
            Self::Guides => [150, 150, 150],
        }
    }
}

/// Which point of a text its position is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// The left end of the baseline.
    Start,
    /// The middle of the baseline.
    Middle,
    /// The right end of the baseline.
    End,
}

/// A shape.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A closed outline, filled.
    Area(Vec<Point>),
    /// A closed outline.
    Loop(Vec<Point>),
    /// An open line.
    Line(Vec<Point>),
    /// Words.
    Text {
        /// Where.
        at: Point,
        /// Which point of the words that is.
        anchor: Anchor,
        /// Height of capitals and digits, mm.
        height_mm: f64,
        /// What they say.
        words: String,
    },
}

/// A shape in its layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// What it is for.
    pub layer: Layer,
    /// The dot that it belongs to.
    pub dot: Option<usize>,
    /// The shape.
    pub shape: Shape,
}

impl Item {
    pub(super) fn new(layer: Layer, shape: Shape) -> Self {
        Self {
            layer,
            dot: None,
            shape,
        }
    }

    pub(super) fn of_dot(layer: Layer, dot: usize, shape: Shape) -> Self {
        Self {
            layer,
            dot: Some(dot),
            shape,
        }
    }

    pub(super) fn words(at: Point, anchor: Anchor, height_mm: f64, words: String) -> Self {
        Self::new(
            Layer::Notes,
            Shape::Text {
                at,
                anchor,
                height_mm,
                words,
            },
        )
    }
}

/// One sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    /// Width, mm.
    pub width_mm: f64,
    /// Height, mm.
    pub height_mm: f64,
    /// What is drawn.
    pub items: Vec<Item>,
}

/// What a file is written from.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// What it is.
    pub title: String,
    /// How its coordinates lie on the ball; goes into the file as one JSON object.
    pub note: Map<String, Value>,
    /// Its sheets.
    pub pages: Vec<Page>,
    /// Width of lines, mm.
    pub line_mm: f64,
}

impl Drawing {
    /// The note as JSON on one line of ASCII.
    pub(super) fn note_json(&self) -> String {
        Value::Object(self.note.clone()).to_string()
    }
}

/// How a drawing is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PageSize {
    /// One sheet as large as it takes.
    #[default]
    Sheet,
    /// ISO A4, 210 x 297 mm.
    A4,
    /// US Letter, 8.5 x 11 inches.
    Letter,
}

/// Margins of a page: left, where the check line stands, and the others, mm.
const MARGINS_MM: (f64, f64) = (20.0, 10.0);
/// Length of the check line, and distance of its ticks, mm.
const CHECK_MM: (f64, f64) = (200.0, 10.0);

impl PageSize {
    /// Width and height, mm; `None` for a sheet without bounds.
    pub fn size_mm(self) -> Option<[f64; 2]> {
        match self {
            Self::Sheet => None,
            Self::A4 => Some([210.0, 297.0]),
            Self::Letter => Some([215.9, 279.4]),
        }
    }

    /// Lower left corner of what can be drawn on, mm.
    pub(super) fn origin(self) -> [f64; 2] {
        match self {
            Self::Sheet => [MARGINS_MM.1; 2],
            _ => [MARGINS_MM.0, MARGINS_MM.1],
        }
    }

    /// Width and height of what can be drawn on, mm.
    pub(super) fn usable_mm(self) -> [f64; 2] {
        self.size_mm().map_or([f64::INFINITY; 2], |[w, h]| {
            [w - MARGINS_MM.0 - MARGINS_MM.1, h - 2.0 * MARGINS_MM.1]
        })
    }

    /// A page for `items`, which reach to `extent` (a corner, mm), with the check line where it has
    /// bounds.
    pub(super) fn page(self, mut items: Vec<Item>, extent: [f64; 2]) -> Page {
        let [width_mm, height_mm] = self
            .size_mm()
            .unwrap_or_else(|| extent.map(|e| e + MARGINS_MM.1));
        if self.size_mm().is_some() {
            items.extend(check_line(height_mm));
        }
        Page {
            width_mm,
            height_mm,
            items,
        }
    }
}

/// A vertical line of 200 mm, to be measured on the print.
fn check_line(page_height_mm: f64) -> Vec<Item> {
    let (length, tick) = CHECK_MM;
    let x = 0.5 * MARGINS_MM.0;
    let y = 0.5 * (page_height_mm - length);
    let line = |a: [f64; 2], b: [f64; 2]| {
        let shape = Shape::Line(vec![Point::from(a), Point::from(b)]);
        Item::new(Layer::Guides, shape)
    };
    let mut items = vec![line([x, y], [x, y + length])];
    for i in 0..=(length / tick) as u32 {
        let at = y + tick * f64::from(i);
        let half = if i % 5 == 0 { 2.0 } else { 1.0 };
        items.push(line([x - half, at], [x + half, at]));
    }
    items.push(Item::words(
        Point::new(MARGINS_MM.0, 0.4 * MARGINS_MM.1),
        Anchor::Start,
        2.5,
        format!("The line on the left is {length:.0} mm long if printed at 100 %"),
    ));
    items
}
