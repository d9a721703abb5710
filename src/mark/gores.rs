//! Lobes: flat pieces that cover the ball side by side, from pole to pole.
//!
//! Projection: Cassini's (J. P. Snyder, "Map projections: a working manual", USGS 1395, 1987,
//! section 13), the one that a strip laid along a meridian follows by itself. With `(a, b, c)` the
//! direction turned about the poles so that the lobe's middle lies at longitude 0,
//!
//! `x = R asin(b)`, `y = R atan2(c, a)`,
//!
//! and back `(a, b, c) = (cos(x/R) cos(y/R), sin(x/R), cos(x/R) sin(y/R))`. Distances are true
//! along the middle and square to it.
//!
//! The ball is turned so that no dot lies at a pole and as few as possible lie on a meridian of a cut;
//! the cut goes around one that does ([`super::cuts`]), so that every dot lies whole in one lobe. Each
//! lobe carries its letter and an arrow to the north, pale, where no dot is. Where a page is shorter than
//! a lobe, lobes are cut across, between dots.

use std::f64::consts::{PI, TAU};

use serde_json::{Value, json};

use crate::error::{Error, Result, require};
use crate::geometry::{Rotation, Vec3, angle_between};
use crate::pattern::{KeepOut, Pattern};

use super::axis::free_axis;
use super::cuts::Cuts;
use super::drawing::{Anchor, Drawing, Item, Layer, PageSize, Point, Shape};
use super::labels::{LabeledDot, Rectangle};
use super::outline::{band, circle_on_ball, facets, holds, lines_inside};
use super::{MarkConfig, TurnedDirections};

/// Turns about the poles that are tried.
const TURNS: usize = 120;
/// Facets of a keep-out's outline.
const KEEP_OUT_FACETS: usize = 1440;
/// Height of numbers, mm.
const NUMBER_MM: f64 = 2.2;
/// Distance of numbers from the cut, mm.
const NUMBER_GAP_MM: f64 = 0.8;
/// Space between lobes, mm: numbers of two digits stand on both sides of it.
const LOBE_GAP_MM: f64 = 11.0;
/// Space above and below a lobe, mm.
const LOBE_END_MM: f64 = 5.0;
/// Width of lines, mm.
const LINE_MM: f64 = 0.1;
/// Height of a lobe's letter as a part of the lobe's width, its bounds, mm, and the sizes that are
/// tried.
const NAME: (f64, f64, f64) = (0.2, 1.2, 6.0);
const NAME_SIZES: [f64; 3] = [1.0, 0.75, 0.5];
/// Distance of a lobe's letter from dots and cuts, mm.
const NAME_GAP_MM: f64 = 0.5;
/// Step in which a place for a letter, or a cut across, is looked for, mm.
const SEARCH_MM: f64 = 0.5;
/// Further parts into which a lobe is cut where no cut across passes between its dots.
const MORE_PARTS: usize = 3;

/// How the lobes are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoreConfig {
    /// Number of lobes, 12 to 24. Default 12.
    pub lobes: usize,
    /// Whether the dots' numbers stand beside the lobes. Default true.
    pub numbers: bool,
    /// Sheets. Default one as large as it takes.
    pub page: PageSize,
}

impl Default for GoreConfig {
    fn default() -> Self {
        Self {
            lobes: 12,
            numbers: true,
            page: PageSize::default(),
        }
    }
}

/// Lobes that cover the ball of `config` with the dots of `pattern`.
///
/// # Errors
/// [`Error::Argument`] where a parameter is outside its domain, a lobe is wider than the page, or no
/// cut across a lobe passes between its dots.
pub fn gores(pattern: &Pattern, config: &MarkConfig, gores: &GoreConfig) -> Result<Drawing> {
    config.validate(pattern)?;
    let inside = (12..=24).contains(&gores.lobes);
    require(inside, "lobes", "12 to 24", gores.lobes)?;
    let (rotation, cuts) = best_cuts(pattern, config, gores.lobes)?;
    let turned = TurnedDirections::new(pattern, config, rotation);
    let work = GoreWork {
        config,
        gores,
        turned: &turned,
        cuts: &cuts,
        radius: config.radius_mm(),
        step: TAU / gores.lobes as f64,
    };
    let (mut pages, pieces) = work.pages()?;
    let mut note = turned.note("gores", pattern, config);
    note.insert("lobes".into(), json!(gores.lobes));
    note.insert("projection".into(), json!("cassini"));
    note.insert("pieces".into(), pieces);
    let title = format!("{} lobes", gores.lobes);
    let block = format!("{title}, lettered from west to east");
    config
        .title_block(&block, pattern)
        .onto(gores.page, &mut pages);
    Ok(Drawing {
        title: config.title(&title, pattern),
        note,
        pages,
        line_mm: LINE_MM,
        is_in_steps: false,
    })
}

/// The rotation with free poles whose lobes are the narrowest, to two degrees, and of these the one
/// with the fewest dots on the meridians of cuts; with the cuts.
fn best_cuts(pattern: &Pattern, config: &MarkConfig, lobes: usize) -> Result<(Rotation, Cuts)> {
    let axis = free_axis(pattern.dots());
    let edge = config.dot_angle_rad();
    let step = TAU / lobes as f64;
    let mut best: Option<((u64, usize), Rotation, Cuts)> = None;
    for i in 0..TURNS {
        let rotation = axis.rotation(step * i as f64 / TURNS as f64);
        let dots: Vec<Vec3> = pattern.dots().iter().map(|d| rotation * d).collect();
        let Some(cuts) = Cuts::new(&dots, edge, lobes) else {
            continue;
        };
        let on_cut = dots.iter().filter(|d| {
            let off = d.y.atan2(d.x).rem_euclid(step);
            let to_cut = off.min(step - off);
            (d.xy().norm() * to_cut.sin()).asin() < edge
        });
        let value = (
            (0.5 * cuts.widest_rad().to_degrees()).ceil() as u64,
            on_cut.count(),
        );
        if best.as_ref().is_none_or(|(least, ..)| value < *least) {
            best = Some((value, rotation, cuts));
        }
    }
    best.map(|(_, rotation, cuts)| (rotation, cuts))
        .ok_or_else(|| config.no_free_axis(&axis))
}

/// What one lobe needs.
struct GoreWork<'a> {
    config: &'a MarkConfig,
    gores: &'a GoreConfig,
    turned: &'a TurnedDirections,
    cuts: &'a Cuts,
    /// Radius of the ball, mm.
    radius: f64,
    /// Angle between lobes, radians.
    step: f64,
}

/// A part of a lobe on a page, in the lobe's plane, mm.
struct LobePart {
    lobe: usize,
    /// Its letter, with its number from the south where the lobe is cut across.
    name: String,
    outline: Vec<Point>,
    /// Its dots.
    dots: Vec<(usize, LabeledDot)>,
    /// Lowest and highest x and y.
    x: [f64; 2],
    y: [f64; 2],
}

impl LobePart {
    /// How far the piece reaches to a side (-1 or 1) between two heights, mm.
    fn reach(&self, sign: f64, [low, high]: [f64; 2]) -> f64 {
        let n = self.outline.len();
        let edges = (0..n).map(|k| (&self.outline[k], &self.outline[(k + 1) % n]));
        let met = edges.filter(|(a, b)| a.y.min(b.y) <= high && a.y.max(b.y) >= low);
        met.map(|(a, b)| (sign * a.x).max(sign * b.x))
            .fold(0.0, f64::max)
    }
}

/// The least and the greatest of some numbers.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| {
        [low.min(v), high.max(v)]
    })
}

impl GoreWork<'_> {
    /// Longitude of a lobe's middle, radians.
    fn longitude(&self, lobe: usize) -> f64 {
        (lobe as f64 + 0.5) * self.step
    }

    /// A direction in the plane of `lobe`, mm; `None` on the far side of the ball.
    fn project(&self, v: &Vec3, lobe: usize) -> Option<Point> {
        let (sin, cos) = self.longitude(lobe).sin_cos();
        let (a, b) = (cos * v.x + sin * v.y, cos * v.y - sin * v.x);
        // Over the poles the plane goes on; far from the lobe it has no place for the point.
        let y = v.z.atan2(a);
        let far = b.abs() > 0.98 || y.abs() > 0.9 * PI;
        let p = || Point::new(self.radius * b.clamp(-1.0, 1.0).asin(), self.radius * y);
        (!far).then(p)
    }

    /// The direction of a point of the plane of `lobe`.
    fn direction(&self, p: &Point, lobe: usize) -> Vec3 {
        let (u, v) = (p.x / self.radius, p.y / self.radius);
        let (sin, cos) = self.longitude(lobe).sin_cos();
        let (a, b) = (u.cos() * v.cos(), u.sin());
        Vec3::new(cos * a - sin * b, sin * a + cos * b, u.cos() * v.sin())
    }

    /// A dot's outline in the plane of `lobe`, mm.
    fn dot(&self, dot: usize, lobe: usize) -> Option<Vec<Point>> {
        let facets = facets(0.5 * self.config.dot_diameter_mm);
        let circle = circle_on_ball(&self.turned.dots[dot], self.config.dot_angle_rad(), facets);
        circle.map(|v| self.project(&v, lobe)).collect()
    }

    /// All pieces: whole lobes, or parts that fit the page.
    fn pieces(&self) -> Result<Vec<LobePart>> {
        let mut pieces = Vec::new();
        for lobe in 0..self.gores.lobes {
            let outline: Vec<Point> = self
                .cuts
                .outline(lobe)
                .into_iter()
                .filter_map(|(longitude, latitude)| {
                    let (sin, cos) = longitude.sin_cos();
                    let v = Vec3::new(latitude.cos() * cos, latitude.cos() * sin, latitude.sin());
                    self.project(&v, lobe)
                })
                .collect();
            let mut dots = Vec::new();
            for (dot, v) in self.turned.dots.iter().enumerate() {
                if self.cuts.lobe_of(v) == lobe
                    && let (Some(center), Some(rim)) = (self.project(v, lobe), self.dot(dot, lobe))
                {
                    let far = rim.iter().map(|p| (p - center).norm());
                    let radius = far.fold(0.0, f64::max);
                    dots.push((dot, LabeledDot { center, radius }));
                }
            }
            let cuts = self.cuts_across(lobe, &outline)?;
            let letter = char::from(b'A' + (lobe % 26) as u8);
            for (part, ends) in cuts.windows(2).enumerate() {
                let y = [ends[0], ends[1]];
                let (outline, name) = match cuts.len() {
                    2 => (outline.clone(), letter.to_string()),
                    _ => (band(&outline, y), format!("{letter}{}", part + 1)),
                };
                let held = dots
                    .iter()
                    .filter(|(_, s)| (y[0]..y[1]).contains(&s.center.y));
                pieces.push(LobePart {
                    lobe,
                    name,
                    x: range(outline.iter().map(|p| p.x)),
                    y,
                    dots: held.copied().collect(),
                    outline,
                });
            }
        }
        Ok(pieces)
    }

    /// The heights at which a lobe ends and is cut across: as few as fit the page, between dots.
    fn cuts_across(&self, lobe: usize, outline: &[Point]) -> Result<Vec<f64>> {
        let [low, high] = range(outline.iter().map(|p| p.y));
        let longest = self.gores.page.usable_mm()[1] - 2.0 * LOBE_END_MM;
        if high - low <= longest {
            return Ok(vec![low, high]);
        }
        // Dots of this lobe, and those of others that its cuts go around.
        let around = self.radius * (self.step + self.config.dot_angle_rad());
        let blocked: Vec<[f64; 2]> = (0..self.turned.dots.len())
            .filter_map(|dot| self.dot(dot, lobe))
            .filter(|rim| rim.iter().any(|p| p.x.abs() < around))
            .map(|rim| range(rim.iter().map(|p| p.y)))
            .collect();
        let margin = 0.1 * self.config.dot_diameter_mm;
        let free = |y: f64| {
            blocked
                .iter()
                .all(|[a, b]| !(a - margin..b + margin).contains(&y))
        };
        let fewest = ((high - low) / longest).ceil() as usize;
        for parts in fewest..=fewest + MORE_PARTS {
            let mut ends = vec![low];
            for part in 1..parts {
                let last = ends[part - 1];
                // Neither this part nor the rest may be too long.
                let least = (high - longest * (parts - part) as f64).max(last);
                let most = last + longest;
                let even = last + (high - last) / (parts + 1 - part) as f64;
                let steps = ((most - least) / SEARCH_MM).max(0.0) as usize;
                let tried = (0..=steps).map(|k| least + SEARCH_MM * k as f64);
                let near = |y: &f64| (y - even).abs();
                let best = tried
                    .filter(|y| free(*y))
                    .min_by(|a, b| near(a).total_cmp(&near(b)));
                ends.extend(best);
                if ends.len() == part {
                    break;
                }
            }
            if ends.len() == parts {
                ends.push(high);
                return Ok(ends);
            }
        }
        let problem = format!(
            "no cut across lobe {} passes between its dots: take smaller dots, more lobes, or an SVG or DXF",
            lobe + 1
        );
        Err(Error::argument("dot_diameter_mm", problem))
    }

    /// Lays the pieces out in rows, page by page, and says where each lies.
    fn pages(&self) -> Result<(Vec<super::Page>, Value)> {
        let page = self.gores.page;
        let [usable_width, usable_height] = page.usable_mm();
        let [left, bottom] = page.origin();
        let mut pages = Vec::new();
        let mut places = Vec::new();
        let (mut items, mut extent) = (Vec::new(), [0.0f64; 2]);
        // Where the row begins, how far it is filled, and how high it is.
        let (mut y, mut x, mut row) = (0.0, 0.0, 0.0f64);
        for piece in self.pieces()? {
            let width = piece.x[1] - piece.x[0] + LOBE_GAP_MM;
            let height = piece.y[1] - piece.y[0] + 2.0 * LOBE_END_MM;
            if width > usable_width {
                let problem = format!(
                    "{} lobes of a ball of {} mm are up to {width:.1} mm wide with their numbers, the page \
                     takes {usable_width:.1} mm: take more lobes or another page",
                    self.gores.lobes, self.config.ball_diameter_mm
                );
                return Err(Error::argument("lobes", problem));
            }
            if x + width > usable_width {
                (x, y, row) = (0.0, y + row, 0.0);
            }
            if y + height > usable_height {
                pages.push(page.page(std::mem::take(&mut items), extent));
                (x, y, row, extent) = (0.0, 0.0, 0.0, [0.0; 2]);
            }
            let origin = Point::new(
                left + x + 0.5 * LOBE_GAP_MM - piece.x[0],
                bottom + y + LOBE_END_MM - piece.y[0],
            );
            (x, row) = (x + width, row.max(height));
            self.draw(&piece, origin, &mut items);
            extent[0] = extent[0].max(left + x);
            extent[1] = extent[1].max(bottom + y + height);
            places.push(json!({
                "page": pages.len(),
                "lobe": piece.lobe,
                "name": piece.name,
                "longitude_deg": self.longitude(piece.lobe).to_degrees(),
                "x_mm": origin.x,
                "y_mm": origin.y,
                "from_mm": piece.y[0],
                "to_mm": piece.y[1],
                "dots": piece.dots.iter().map(|(dot, _)| *dot).collect::<Vec<_>>(),
            }));
        }
        pages.push(page.page(items, extent));
        Ok((pages, Value::Array(places)))
    }

    /// Draws a piece whose plane has its origin at `origin` of the page.
    fn draw(&self, piece: &LobePart, origin: Point, items: &mut Vec<Item>) {
        let placed =
            |points: &[Point]| -> Vec<Point> { points.iter().map(|p| origin + p.coords).collect() };
        for zone in &self.turned.keep_out {
            let circle = circle_on_ball(&zone.axis, zone.half_angle_rad, KEEP_OUT_FACETS);
            let points: Vec<Point> = circle
                .filter_map(|v| self.project(&v, piece.lobe))
                .collect();
            for line in lines_inside(&points, &piece.outline) {
                items.push(Item::new(Layer::KeepOut, Shape::Line(placed(&line))));
            }
        }
        for (dot, _) in &piece.dots {
            if let Some(rim) = self.dot(*dot, piece.lobe) {
                items.push(Item::of_dot(Layer::Dots, *dot, Shape::Area(placed(&rim))));
            }
        }
        items.push(Item::new(Layer::Cut, Shape::Loop(placed(&piece.outline))));
        self.name(piece, origin, items);
        if self.gores.numbers {
            number(piece, origin, items);
        }
    }

    /// Writes a piece's name into it with an arrow to the north above, as far south as there is space.
    /// Where there is none, they stand below the piece.
    fn name(&self, piece: &LobePart, origin: Point, items: &mut Vec<Item>) {
        let full = (NAME.0 * self.step * self.radius).clamp(NAME.1, NAME.2);
        let place = NAME_SIZES.iter().find_map(|size| {
            let height = size * full;
            let half = [
                0.5 * height * (piece.name.len() as f64).max(1.0),
                1.2 * height,
            ];
            let rows = ((piece.y[1] - piece.y[0]) / SEARCH_MM) as usize;
            let columns = (piece.x[1].max(-piece.x[0]) / SEARCH_MM) as i32;
            let mut tried = (0..rows).flat_map(|row| {
                // The middle first, then to either side.
                (0..=2 * columns).map(move |k| (row, if k % 2 == 0 { k / 2 } else { -(k + 1) / 2 }))
            });
            tried.find_map(|(row, column)| {
                let x = SEARCH_MM * f64::from(column);
                let center = Point::new(x, piece.y[0] + SEARCH_MM * row as f64);
                let place = Rectangle { center, half };
                self.has_room(piece, &place).then_some((place, height))
            })
        });
        let (place, height) = place.unwrap_or_else(|| {
            let height = NUMBER_MM.min(LOBE_END_MM / 3.0);
            let half = [0.5 * height, 1.2 * height];
            let center = Point::new(0.0, piece.y[0] - 0.5 * LOBE_END_MM);
            (Rectangle { center, half }, height)
        });
        let at =
            |x: f64, y: f64| origin + place.center.coords + nalgebra::Vector2::new(x, y) * height;
        items.push(Item::new(
            Layer::Names,
            Shape::Text {
                at: at(0.0, -1.2),
                anchor: Anchor::Middle,
                height_mm: height,
                words: piece.name.clone(),
            },
        ));
        for arrow in [
            vec![at(0.0, 0.05), at(0.0, 1.15)],
            vec![at(-0.3, 0.75), at(0.0, 1.15), at(0.3, 0.75)],
        ] {
            items.push(Item::new(Layer::Names, Shape::Line(arrow)));
        }
    }

    /// Whether a rectangle lies within a piece, off its dots and the zones without dots.
    fn has_room(&self, piece: &LobePart, place: &Rectangle) -> bool {
        let off = |spot: &LabeledDot| place.distance(&spot.center) >= spot.radius + NAME_GAP_MM;
        let [w, h] = place.half.map(|half| half + NAME_GAP_MM);
        let outside = |zone: &KeepOut| {
            let center = self.direction(&place.center, piece.lobe);
            let apart = angle_between(&center, &zone.axis);
            apart >= zone.half_angle_rad + w.hypot(h) / self.radius
        };
        let corners = [(-w, -h), (w, -h), (w, h), (-w, h)];
        let corners = corners.map(|(x, y)| place.center + nalgebra::Vector2::new(x, y));
        piece.dots.iter().all(|(_, spot)| off(spot))
            && self.turned.keep_out.iter().all(outside)
            && corners.iter().all(|p| holds(&piece.outline, p))
            && piece
                .outline
                .iter()
                .all(|p| place.distance(p) >= NAME_GAP_MM)
    }
}

/// Writes a piece's numbers beside it, each at the height of its dot and on the nearer side, and
/// moves them up where they would meet; a thin line leads from a number to the cut beside its dot.
fn number(piece: &LobePart, origin: Point, items: &mut Vec<Item>) {
    for sign in [-1.0, 1.0] {
        // A dot in the very middle belongs to the right side only.
        let mut here: Vec<_> = piece.dots.iter().collect();
        here.retain(|(_, s)| {
            if sign > 0.0 {
                s.center.x >= 0.0
            } else {
                s.center.x < 0.0
            }
        });
        here.sort_by(|a, b| a.1.center.y.total_cmp(&b.1.center.y));
        let mut free = f64::NEG_INFINITY;
        for (dot, spot) in here {
            let beside = spot.center.y;
            let y = (beside - 0.5 * NUMBER_MM).max(free);
            // The line beneath some numbers needs space as well.
            free = y + 1.6 * NUMBER_MM;
            let middle = y + 0.5 * NUMBER_MM;
            let edge = piece.reach(sign, [beside.min(y) - 0.5, free]);
            let from = Point::new(sign * (piece.reach(sign, [beside; 2]) + 0.1), beside);
            let to = Point::new(sign * (edge + NUMBER_GAP_MM), middle);
            let bend = Point::new(sign * (edge + 0.3), beside);
            let leader = [from, bend, to].map(|p| origin + p.coords);
            items.push(Item::of_dot(
                Layer::Notes,
                *dot,
                Shape::Line(leader.to_vec()),
            ));
            let at = Point::new(sign * (edge + NUMBER_GAP_MM + 0.3), y);
            let anchor = if sign > 0.0 {
                Anchor::Start
            } else {
                Anchor::End
            };
            items.extend(Item::number(*dot, origin + at.coords, anchor, NUMBER_MM));
        }
    }
}
