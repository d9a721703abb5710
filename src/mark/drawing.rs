//! Flat drawings, before they become SVG, PDF or DXF.
//!
//! Coordinates are millimeters from the page's lower left corner, x to the right, y up.

use serde_json::{Map, Value};

use crate::pattern::reads_upside_down;

/// A point of a page, mm.
pub type Point = nalgebra::Point2<f64>;

/// What a shape is for; files keep layers apart, so that a cutter follows the chosen lines only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// Lines to cut.
    Cut,
    /// The dots.
    Dots,
    /// Letters and arrows that come onto the ball with a lobe, pale.
    Names,
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
        Self::Guides,
        Self::KeepOut,
        Self::Dots,
        Self::Names,
        Self::Cut,
        Self::Notes,
    ];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cut => "cut",
            Self::Dots => "dots",
            Self::Names => "names",
            Self::KeepOut => "keep-out",
            Self::Notes => "notes",
            Self::Guides => "guides",
        }
    }

    /// Red, green and blue in [0, 255].
    pub(super) fn color(self) -> [u8; 3] {
        match self {
            Self::Cut => [214, 40, 40],
            Self::Dots => [0, 0, 0],
            Self::Names => [190, 190, 190],
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

    /// A dot's number, with a line beneath where it would read as another upside down.
    pub(super) fn number(dot: usize, at: Point, anchor: Anchor, height_mm: f64) -> Vec<Self> {
        let words = Self {
            dot: Some(dot),
            ..Self::words(at, anchor, height_mm, dot.to_string())
        };
        if !reads_upside_down(dot) {
            return vec![words];
        }
        let width = text_width(&dot.to_string(), height_mm);
        let left = match anchor {
            Anchor::Start => at.x,
            Anchor::Middle => at.x - 0.5 * width,
            Anchor::End => at.x - width,
        };
        let y = at.y - UNDERLINE * height_mm;
        let line = Shape::Line(vec![Point::new(left, y), Point::new(left + width, y)]);
        vec![words, Self::of_dot(Layer::Notes, dot, line)]
    }
}

/// Depth of the line under a number, as a part of its height.
const UNDERLINE: f64 = 0.22;
/// Height of capitals and digits as a part of the font's size (Adobe's metrics of Helvetica).
pub(super) const CAPITAL: f64 = 0.718;

/// Width of words with capitals `height_mm` high, mm.
pub(super) fn text_width(words: &str, height_mm: f64) -> f64 {
    height_mm / CAPITAL * words.chars().map(advance).sum::<f64>()
}

/// Width of a character as a part of the font's size: digits and stops exactly (Adobe's metrics of
/// Helvetica), letters about.
fn advance(c: char) -> f64 {
    match c {
        ' ' | '.' | ',' | ':' | 'i' | 'l' | 't' | 'f' => 0.278,
        '-' => 0.333,
        '°' => 0.4,
        'm' | 'M' => 0.833,
        _ => 0.556,
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
    /// Whether lengths are a motor's steps instead: an SVG of them has no unit.
    pub is_in_steps: bool,
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
/// Height of the title block at the foot of every sheet, mm.
const BLOCK_MM: f64 = 14.0;
/// Heights of the title block's words, mm: title, all else.
const BLOCK_WORDS_MM: (f64, f64) = (3.0, 2.4);
/// Length of the check line, and distance of its ticks, mm.
const CHECK_MM: (f64, f64) = (200.0, 10.0);
/// Length of the title block's scale bar, and distance of its ticks, mm.
const BAR_MM: (f64, f64) = (50.0, 10.0);

impl PageSize {
    /// Width and height, mm; `None` for a sheet without bounds.
    pub fn size_mm(self) -> Option<[f64; 2]> {
        match self {
            Self::Sheet => None,
            Self::A4 => Some([210.0, 297.0]),
            Self::Letter => Some([215.9, 279.4]),
        }
    }

    /// Distance of what can be drawn on from the sheet's left edge, mm.
    fn left(self) -> f64 {
        match self {
            Self::Sheet => MARGINS_MM.1,
            _ => MARGINS_MM.0,
        }
    }

    /// Lower left corner of what can be drawn on, above the title block, mm.
    pub(super) fn origin(self) -> [f64; 2] {
        [self.left(), MARGINS_MM.1 + BLOCK_MM]
    }

    /// Distance of what can be drawn on from the sheet's upper edge, mm.
    pub(super) fn top_mm(self) -> f64 {
        MARGINS_MM.1
    }

    /// Width and height of what can be drawn on, mm.
    pub(super) fn usable_mm(self) -> [f64; 2] {
        self.size_mm().map_or([f64::INFINITY; 2], |[w, h]| {
            [
                w - MARGINS_MM.0 - MARGINS_MM.1,
                h - 2.0 * MARGINS_MM.1 - BLOCK_MM,
            ]
        })
    }

    /// A page for `items`, which reach to `extent` (a corner, mm), with the check line where it has
    /// bounds.
    pub(super) fn page(self, mut items: Vec<Item>, extent: [f64; 2]) -> Page {
        let [width_mm, height_mm] = self
            .size_mm()
            .unwrap_or_else(|| extent.map(|e| e + MARGINS_MM.1));
        if self.size_mm().is_some() {
            let x = 0.5 * MARGINS_MM.0;
            let low = Point::new(x, 0.5 * (height_mm - CHECK_MM.0));
            items.extend(ruler(low, nalgebra::Vector2::y(), CHECK_MM));
        }
        Page {
            width_mm,
            height_mm,
            items,
        }
    }
}

/// What the foot of every sheet says.
pub(super) struct TitleBlock<'a> {
    /// What the sheets are.
    pub title: &'a str,
    /// Pattern and sizes.
    pub facts: String,
    /// The date, as it is to be written; `None` leaves it out.
    pub date: Option<&'a str>,
    /// What a color means, beside the title.
    pub legend: Option<&'a str>,
}

impl TitleBlock<'_> {
    /// Draws the block at the foot of each of `pages`, with a bar of 50 mm.
    pub fn onto(&self, size: PageSize, pages: &mut [Page]) {
        let count = pages.len();
        for (index, page) in pages.iter_mut().enumerate() {
            let (x, foot) = (size.left(), 0.5 * MARGINS_MM.1);
            let mut facts = self.facts.clone();
            if let Some(date) = self.date {
                facts += &format!("; {date}");
            }
            facts += &format!("; sheet {} of {count}", index + 1);
            let (title_mm, words_mm) = BLOCK_WORDS_MM;
            let mut say = |x: f64, y: f64, height: f64, words: String| {
                let at = Point::new(x, foot + y);
                page.items
                    .push(Item::words(at, Anchor::Start, height, words));
            };
            say(x, 11.0, title_mm, self.title.to_owned());
            if let Some(legend) = self.legend {
                let beside = x + text_width(self.title, title_mm) + 5.0;
                say(beside, 11.0, words_mm, legend.to_owned());
            }
            say(x, 6.0, words_mm, facts);
            let mut beside = format!("{} mm if printed at 100 %", BAR_MM.0);
            if size.size_mm().is_some() {
                beside += &format!("; the line on the left is {} mm", CHECK_MM.0);
            }
            let at = Point::new(x + BAR_MM.0 + 3.0, foot);
            page.items
                .push(Item::words(at, Anchor::Start, words_mm, beside));
            let low = Point::new(x, foot + 0.5 * words_mm);
            page.items
                .extend(ruler(low, nalgebra::Vector2::x(), BAR_MM));
        }
    }
}

/// A line from `low` along `way` with ticks, to be measured on the print: its length and the ticks'
/// distance, mm.
fn ruler(low: Point, way: nalgebra::Vector2<f64>, (length, tick): (f64, f64)) -> Vec<Item> {
    let across = nalgebra::Vector2::new(way.y, way.x);
    let line = |a: Point, b: Point| Item::new(Layer::Guides, Shape::Line(vec![a, b]));
    let mut items = vec![line(low, low + length * way)];
    for i in 0..=(length / tick) as u32 {
        let at = low + tick * f64::from(i) * way;
        let half = if i % 5 == 0 { 2.0 } else { 1.0 };
        items.push(line(at - half * across, at + half * across));
    }
    items
}
