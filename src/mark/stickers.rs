//! Single dots to cut out and stick on, and where each goes.
//!
//! The first sheets hold the dots, each with its number. Two maps follow, seen from above either
//! pole, in azimuthal equidistant projection (J. P. Snyder, "Map projections: a working manual",
//! USGS 1395, 1987, section 25): with latitude `phi` and longitude `lambda`, a point of the
//! northern map lies at
//!
//! `x = s R (pi/2 - phi) cos(lambda)`, `y = s R (pi/2 - phi) sin(lambda)`,
//!
//! and one of the southern map at `(s R (pi/2 + phi) cos(lambda), -s R (pi/2 + phi) sin(lambda))`,
//! both seen from outside; `s` is the map's scale. Last comes a table: latitude, longitude, and the
//! straight distances from each dot to three others, which a pair of dividers or a caliper lays
//! off ([`super::caliper`]).

use std::f64::consts::{FRAC_PI_2, TAU};

use serde_json::json;

use crate::error::{Error, Result, require};
use crate::geometry::Vec3;
use crate::pattern::Pattern;

use super::axis::free_axis;
use super::caliper::{Caliper, references};
use super::drawing::{Anchor, Drawing, Item, Layer, Page, PageSize, Point, Shape, text_width};
use super::labels::{LabeledDot, Labels, Rectangle};
use super::outline::{circle, circle_on_ball, facets};
use super::{MarkConfig, TurnedDirections, longitude_latitude};

/// Height of numbers and words, mm.
const TEXT_MM: f64 = 2.4;
/// Space around a sticker for its number, mm.
const STICKER_GAP_MM: f64 = 7.0;
/// Distance of a table's lines, and of its columns, mm: in a wide font too its headings stay apart.
const ROW_MM: f64 = 3.7;
const COLUMN_MM: f64 = 30.0;
/// Space above and below a map, and between its rim and the dots that reach over it and its labels, mm.
const MAP_GAP_MM: (f64, f64) = (3.0, 1.0);
/// The widest label of a map, and the height of labels, mm.
const MAP_LABEL: (&str, f64) = ("330°", 2.0);
/// Width of a sheet without bounds, mm.
const SHEET_MM: f64 = 180.0;
/// Width of lines, mm.
const LINE_MM: f64 = 0.1;

/// How the stickers are made.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StickerConfig {
    /// How far a dot's color goes on beyond its cut, mm. Default 0.
    pub bleed_mm: f64,
    /// Sheets. Default one as large as it takes.
    pub page: PageSize,
}

/// A sheet of the dots of `pattern`, and maps of where they go.
///
/// # Errors
/// [`Error::Argument`] where a parameter is outside its domain.
pub fn stickers(
    pattern: &Pattern,
    config: &MarkConfig,
    stickers: &StickerConfig,
) -> Result<Drawing> {
    config.validate(pattern)?;
    let inside = (0.0..=5.0).contains(&stickers.bleed_mm);
    require(inside, "bleed_mm", "0 to 5 mm", stickers.bleed_mm)?;
    let rotation = free_axis(pattern.dots()).rotation(0.0);
    let turned = TurnedDirections::new(pattern, config, rotation);
    let mut sheets = Sheets::new(stickers.page);
    dots(pattern, config, stickers, &mut sheets)?;
    let maps = maps(&turned, config, &mut sheets)?;
    let caliper = table(&turned, config, &mut sheets);
    let mut note = turned.note("stickers", pattern, config);
    note.insert("projection".into(), json!("azimuthal equidistant"));
    note.insert("maps".into(), maps);
    note.insert("caliper".into(), json!(caliper));
    let title = "Stickers";
    let mut pages = sheets.finish();
    config
        .title_block(title, pattern)
        .onto(stickers.page, &mut pages);
    Ok(Drawing {
        title: config.title(title, pattern),
        note,
        pages,
        line_mm: LINE_MM,
        is_in_steps: false,
    })
}

/// Blocks stacked from top to bottom, page by page. While they are stacked, y counts down from 0.
struct Sheets {
    size: PageSize,
    width: f64,
    height: f64,
    pages: Vec<Vec<Item>>,
    /// How far the last page is filled, mm.
    used: f64,
    /// The same for each page before.
    filled: Vec<f64>,
}

impl Sheets {
    fn new(size: PageSize) -> Self {
        let [width, height] = size.usable_mm();
        Self {
            size,
            width: width.min(SHEET_MM),
            height,
            pages: vec![Vec::new()],
            used: 0.0,
            filled: Vec::new(),
        }
    }

    /// Whether a block of this height would begin a new page.
    fn is_full(&self, height: f64) -> bool {
        self.used + height > self.height && self.used > 0.0
    }

    /// Space for a block of this height: the distance of its upper edge from the page's, mm.
    fn block(&mut self, height: f64) -> f64 {
        if self.is_full(height) {
            self.filled.push(self.used);
            self.pages.push(Vec::new());
            self.used = 0.0;
        }
        let top = self.used;
        self.used += height;
        top
    }

    /// Adds an item whose y counts from the page's upper edge, downwards negative.
    fn add(&mut self, item: Item) {
        if let Some(page) = self.pages.last_mut() {
            page.push(item);
        }
    }

    fn words(&mut self, x: f64, y: f64, anchor: Anchor, words: String) {
        self.add(Item::words(Point::new(x, y), anchor, TEXT_MM, words));
    }

    /// Index of the page that is being filled.
    fn page(&self) -> usize {
        self.pages.len() - 1
    }

    /// Height of the drawable part of a page of which `used` is filled, mm.
    fn drawable(&self, used: f64) -> f64 {
        if self.height.is_finite() {
            self.height
        } else {
            used
        }
    }

    /// The pages, with y counted up from their lower edges.
    fn finish(mut self) -> Vec<Page> {
        self.filled.push(self.used);
        let [left, bottom] = self.size.origin();
        let pages = std::mem::take(&mut self.pages).into_iter();
        pages
            .zip(&self.filled)
            .map(|(items, &used)| {
                let height = self.drawable(used);
                let shift = nalgebra::Vector2::new(left, bottom + height);
                let items = items.into_iter().map(|item| moved(item, &shift)).collect();
                self.size.page(items, [left + self.width, bottom + height])
            })
            .collect()
    }
}

/// An item moved by `shift`.
fn moved(item: Item, shift: &nalgebra::Vector2<f64>) -> Item {
    let all = |points: Vec<Point>| points.into_iter().map(|p| p + shift).collect();
    let shape = match item.shape {
        Shape::Area(points) => Shape::Area(all(points)),
        Shape::Loop(points) => Shape::Loop(all(points)),
        Shape::Line(points) => Shape::Line(all(points)),
        Shape::Text {
            at,
            anchor,
            height_mm,
            words,
        } => Shape::Text {
            at: at + shift,
            anchor,
            height_mm,
            words,
        },
    };
    Item { shape, ..item }
}

/// Rows of dots with their numbers beneath.
fn dots(
    pattern: &Pattern,
    config: &MarkConfig,
    stickers: &StickerConfig,
    sheets: &mut Sheets,
) -> Result<()> {
    let size = config.dot_diameter_mm + 2.0 * stickers.bleed_mm;
    let pitch = size + STICKER_GAP_MM;
    let in_a_row = (sheets.width / pitch) as usize;
    if in_a_row == 0 || pitch > sheets.height {
        let fits = sheets.width.min(sheets.height) - STICKER_GAP_MM - 2.0 * stickers.bleed_mm;
        let problem = format!("expected at most {fits:.0} mm on this page, found {size}");
        return Err(Error::argument("dot_diameter_mm", problem));
    }
    let all: Vec<usize> = (0..pattern.len()).collect();
    for row in all.chunks(in_a_row) {
        let top = sheets.block(pitch);
        for (column, &dot) in row.iter().enumerate() {
            let center = Point::new((column as f64 + 0.5) * pitch, -top - 0.5 * size);
            let color = circle(center, 0.5 * size);
            let cut = circle(center, 0.5 * config.dot_diameter_mm);
            sheets.add(Item::of_dot(Layer::Dots, dot, Shape::Area(color)));
            sheets.add(Item::of_dot(Layer::Cut, dot, Shape::Loop(cut)));
            let at = Point::new(center.x, -top - size - 1.4 * TEXT_MM);
            for item in Item::number(dot, at, Anchor::Middle, TEXT_MM) {
                sheets.add(item);
            }
        }
    }
    Ok(())
}

/// Both maps, and where they lie.
fn maps(
    turned: &TurnedDirections,
    config: &MarkConfig,
    sheets: &mut Sheets,
) -> Result<serde_json::Value> {
    let (map, divisor) = largest_map(config, sheets.width);
    let scale = 1.0 / divisor;
    let beside = map.beyond + MAP_LABEL.1 + MAP_GAP_MM.0;
    let height = 2.0 * (map.rim() + beside) + 3.0 * ROW_MM;
    if height > sheets.height {
        return Err(Error::Internal("a map is higher than its page".to_owned()));
    }
    let top = sheets.block(height);
    let legend = format!("Maps, seen from above the poles, scale 1:{divisor}");
    sheets.words(0.0, -top - ROW_MM, Anchor::Start, legend);
    // A line between the maps: their labels stand at the same heights.
    let middle = 0.5 * sheets.width;
    let ends = [top + 1.5 * ROW_MM, top + height - MAP_GAP_MM.0].map(|y| Point::new(middle, -y));
    sheets.add(Item::new(Layer::Guides, Shape::Line(ends.to_vec())));
    let mut places = Vec::new();
    for (index, (sign, name)) in [(1.0, "north"), (-1.0, "south")].into_iter().enumerate() {
        let center = Point::new(
            (index as f64 + 0.5) * 0.5 * sheets.width,
            -top - 3.0 * ROW_MM - beside - map.rim(),
        );
        let above = -top - 2.3 * ROW_MM;
        sheets.words(center.x, above, Anchor::Middle, format!("{name}ern half"));
        Map {
            center,
            sign,
            ..map
        }
        .draw(turned, config, sheets);
        places.push((name, center));
    }
    // Where the page's lower edge lies is known once it is full: places count from its upper edge.
    let page = sheets.page();
    let ([left, _], top) = (sheets.size.origin(), sheets.size.top_mm());
    let places = places.into_iter().map(|(pole, center)| {
        json!({
            "page": page,
            "pole": pole,
            "scale": scale,
            "x_mm": left + center.x,
            "from_top_mm": -center.y + top,
        })
    });
    Ok(places.collect())
}

/// The map at the greatest of the scales 1:1, 1:2, ... at which two stand side by side with their labels on a page of this width, and what its scale
/// divides by.
fn largest_map(config: &MarkConfig, width: f64) -> (Map, f64) {
    let radius = config.radius_mm();
    let label = text_width(MAP_LABEL.0, MAP_LABEL.1) + MAP_GAP_MM.1;
    let at_scale = |divisor: f64| Map {
        center: Point::origin(),
        sign: 1.0,
        radius: radius / divisor,
        beyond: FRAC_PI_2 * radius / divisor * config.dot_angle_rad() + MAP_GAP_MM.1,
    };
    let half_width = |map: &Map| map.rim() + map.beyond + label;
    let mut divisor = 1.0;
    while half_width(&at_scale(divisor)) > 0.25 * width {
        divisor += 1.0;
    }
    (at_scale(divisor), divisor)
}

/// One hemisphere.
#[derive(Clone, Copy)]
struct Map {
    center: Point,
    /// 1 for the northern one, -1 for the southern.
    sign: f64,
    /// Radius of the ball in the map, mm.
    radius: f64,
    /// Distance of labels from the rim, farther than dots reach over it, mm.
    beyond: f64,
}

impl Map {
    /// Radius of the map's rim, the equator, mm.
    fn rim(&self) -> f64 {
        FRAC_PI_2 * self.radius
    }

    fn place(&self, v: &Vec3) -> Point {
        let (longitude, latitude) = longitude_latitude(v);
        let r = self.radius * (FRAC_PI_2 - self.sign * latitude);
        let (sin, cos) = longitude.sin_cos();
        Point::new(self.center.x + r * cos, self.center.y + self.sign * r * sin)
    }

    fn draw(&self, turned: &TurnedDirections, config: &MarkConfig, sheets: &mut Sheets) {
        let mut labels = Labels {
            spots: Vec::new(),
            taken: Vec::new(),
        };
        self.draw_grid(&mut labels, sheets);
        let belongs = |v: &Vec3| self.sign * v.z >= 0.0;
        for zone in &turned.keep_out {
            let points: Vec<Vec3> = circle_on_ball(&zone.axis, zone.half_angle_rad, 720).collect();
            for pair in points.windows(2).filter(|p| p.iter().all(belongs)) {
                let line = pair.iter().map(|v| self.place(v)).collect();
                sheets.add(Item::new(Layer::KeepOut, Shape::Line(line)));
            }
        }
        let own = turned.dots.iter().enumerate().filter(|(_, v)| belongs(v));
        self.draw_dots(own, config, labels, sheets);
    }

    /// Latitudes and longitudes, with the words that say which.
    fn draw_grid(&self, labels: &mut Labels, sheets: &mut Sheets) {
        for k in 1..=6 {
            let r = self.radius * FRAC_PI_2 * f64::from(k) / 6.0;
            let shape = Shape::Loop(circle(self.center, r));
            sheets.add(Item::new(Layer::Guides, shape));
        }
        for k in 0..12 {
            let angle = TAU * f64::from(k) / 12.0;
            let towards = |r: f64| {
                let (sin, cos) = angle.sin_cos();
                Point::new(self.center.x + r * cos, self.center.y + self.sign * r * sin)
            };
            let shape = Shape::Line(vec![self.center, towards(self.rim())]);
            sheets.add(Item::new(Layer::Guides, shape));
            let (sin, cos) = angle.sin_cos();
            let anchor = match cos {
                _ if cos.abs() < 0.1 => Anchor::Middle,
                _ if cos > 0.0 => Anchor::Start,
                _ => Anchor::End,
            };
            let at = towards(self.rim() + self.beyond);
            let height = MAP_LABEL.1;
            let below = match self.sign * sin {
                up if up.abs() < 0.1 => 0.5 * height,
                up if up > 0.0 => 0.0,
                _ => height,
            };
            let at = Point::new(at.x, at.y - below);
            let words = format!("{}°", 30 * k);
            let taken = Rectangle::of_words(at, anchor, height, &words);
            labels.taken.push(taken);
            sheets.add(Item::words(at, anchor, height, words));
        }
    }

    /// Dots and their numbers.
    fn draw_dots<'a>(
        &self,
        dots: impl Iterator<Item = (usize, &'a Vec3)>,
        config: &MarkConfig,
        mut labels: Labels,
        sheets: &mut Sheets,
    ) {
        let facets = facets(0.5 * config.dot_diameter_mm);
        let mut shown = Vec::new();
        for (dot, center) in dots {
            let rim = circle_on_ball(center, config.dot_angle_rad(), facets);
            let points: Vec<Point> = rim.map(|v| self.place(&v)).collect();
            let at = self.place(center);
            let far = points.iter().map(|p| (p - at).norm());
            let spot = LabeledDot {
                center: at,
                radius: far.fold(0.0, f64::max),
            };
            labels.spots.push(spot);
            shown.push((dot, spot));
            sheets.add(Item::of_dot(Layer::Dots, dot, Shape::Area(points)));
        }
        for (dot, spot) in shown {
            for item in labels.number(dot, &spot, TEXT_MM) {
                sheets.add(item);
            }
        }
    }
}

/// Latitudes, longitudes and straight distances, and how exact a caliper must be. The table begins a
/// page where it fits one whole, else its heading is repeated.
fn table(turned: &TurnedDirections, config: &MarkConfig, sheets: &mut Sheets) -> Option<Caliper> {
    let from = references(&turned.dots)?;
    let caliper = Caliper::new(&turned.dots, from);
    let to = |i: usize| format!("to dot {}, mm", from[i]);
    let heading = ["dot", "latitude, deg", "longitude, deg"].map(str::to_owned);
    let heading: Vec<String> = heading.into_iter().chain((0..3).map(to)).collect();
    let words = caliper.words(config.dot_diameter_mm);
    let rows = turned.dots.len() as f64 + 2.5 + words.len() as f64;
    let is_whole = ROW_MM * rows <= sheets.height;
    let top = sheets.block(if is_whole {
        ROW_MM * rows
    } else {
        8.0 * ROW_MM
    });
    // The block only chose the page: its lines are added one by one.
    sheets.used = top + ROW_MM;
    for line in words {
        let y = -sheets.block(ROW_MM) - TEXT_MM;
        sheets.words(0.0, y, Anchor::Start, line);
    }
    sheets.block(0.5 * ROW_MM);
    row(&heading, sheets);
    for (dot, d) in turned.dots.iter().enumerate() {
        let (longitude, latitude) = longitude_latitude(d);
        let mut cells = vec![
            dot.to_string(),
            format!("{:.2}", latitude.to_degrees()),
            format!("{:.2}", longitude.rem_euclid(TAU).to_degrees()),
        ];
        let distances = from.map(|i| config.radius_mm() * (d - turned.dots[i]).norm());
        cells.extend(distances.map(|mm| format!("{mm:.2}")));
        if sheets.is_full(ROW_MM) {
            row(&heading, sheets);
        }
        row(&cells, sheets);
    }
    Some(caliper)
}

/// One line of the table.
fn row(cells: &[String], sheets: &mut Sheets) {
    let y = -sheets.block(ROW_MM) - TEXT_MM;
    for (k, cell) in cells.iter().enumerate() {
        let x = 8.0 + COLUMN_MM * k as f64;
        sheets.words(x, y, Anchor::End, cell.clone());
    }
}
