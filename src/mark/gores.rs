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
//! The ball is turned so that no dot lies at a pole and as few as possible lie on a cut; a dot that
//! does is drawn in parts, one in each lobe. Where a page is shorter than a lobe, lobes are cut
//! across.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use serde_json::{Value, json};

use crate::error::{Error, Result, require};
use crate::geometry::{Rotation, Vec3};
use crate::pattern::Pattern;

use super::axis::free_axis;
use super::drawing::{Anchor, Drawing, Item, Layer, PageSize, Point, Shape};
use super::outline::{circle_on_ball, clipped, facets, grown, lines_inside};
use super::{MarkConfig, Turned, longitude_latitude};

/// Facets of each side of a lobe.
const SIDE_FACETS: usize = 180;
/// Turns about the poles that are tried.
const TURNS: usize = 120;
/// Facets of a keep-out's outline.
const KEEP_OUT_FACETS: usize = 1440;
/// Height of numbers, mm.
const NUMBER_MM: f64 = 2.2;
/// Distance of numbers from the cut, mm.
const NUMBER_GAP_MM: f64 = 0.8;
/// Space between lobes, where the numbers stand, mm.
const LOBE_GAP_MM: f64 = 10.0;
/// Space above and below a lobe, mm.
const LOBE_END_MM: f64 = 5.0;
/// Width of lines, mm.
const LINE_MM: f64 = 0.1;

/// How the lobes are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoreConfig {
    /// Number of lobes, 12 to 24. Default 12.
    pub lobes: usize,
    /// How far dots go on beyond a cut, mm. Default 0.
    pub bleed_mm: f64,
    /// Whether the dots' numbers stand beside the lobes. Default true.
    pub numbers: bool,
    /// Sheets. Default one as large as it takes.
    pub page: PageSize,
}

impl Default for GoreConfig {
    fn default() -> Self {
        Self {
            lobes: 12,
            bleed_mm: 0.0,
            numbers: true,
            page: PageSize::default(),
        }
    }
}

/// Lobes that cover the ball of `config` with the dots of `pattern`.
///
/// # Errors
/// [`Error::Argument`] where a parameter is outside its domain, or a lobe is wider than the page.
pub fn gores(pattern: &Pattern, config: &MarkConfig, gores: &GoreConfig) -> Result<Drawing> {
    config.validate(pattern)?;
    let inside = (12..=24).contains(&gores.lobes);
    require(inside, "lobes", "12 to 24", gores.lobes)?;
    let inside = (0.0..=5.0).contains(&gores.bleed_mm);
    require(inside, "bleed_mm", "0 to 5 mm", gores.bleed_mm)?;
    let turned = Turned::new(pattern, config, best_rotation(pattern, config, gores.lobes));
    let work = Work {
        config,
        gores,
        turned: &turned,
        radius: config.radius_mm(),
        step: TAU / gores.lobes as f64,
    };
    let (pages, pieces) = work.pages()?;
    let mut note = turned.note("gores", pattern, config);
    note.insert("lobes".into(), json!(gores.lobes));
    note.insert("bleed_mm".into(), json!(gores.bleed_mm));
    note.insert("projection".into(), json!("cassini"));
    note.insert("pieces".into(), pieces);
    Ok(Drawing {
        title: format!(
            "{} lobes of pattern {:.8} for a ball of {} mm",
            gores.lobes,
            pattern.sha256(),
            config.ball_diameter_mm
        ),
        note,
        pages,
        line_mm: LINE_MM,
    })
}

/// The rotation with free poles that leaves the fewest dots on cuts; of equals, the one whose dots
/// are farthest from them.
fn best_rotation(pattern: &Pattern, config: &MarkConfig, lobes: usize) -> Rotation {
    let axis = free_axis(pattern.dots());
    let edge = config.dot_angle_rad();
    let step = TAU / lobes as f64;
    let upright: Vec<Vec3> = {
        let rotation = axis.rotation(0.0);
        pattern.dots().iter().map(|d| rotation * d).collect()
    };
    let mut best = (usize::MAX, f64::NEG_INFINITY, 0.0);
    for i in 0..TURNS {
        let turn = step * i as f64 / TURNS as f64;
        // Angles between the dots' centers and the nearest cut.
        let angles = upright.iter().map(|d| {
            let (longitude, latitude) = longitude_latitude(d);
            let off = (longitude + turn).rem_euclid(step) - 0.5 * step;
            let to_cut = 0.5 * step - off.abs();
            (latitude.cos() * to_cut.sin()).asin()
        });
        let cut = angles.clone().filter(|&a| a < edge).count();
        let margin = angles
            .map(|a| (a - edge).abs())
            .fold(f64::INFINITY, f64::min);
        if cut < best.0 || (cut == best.0 && margin > best.1) {
            best = (cut, margin, turn);
        }
    }
    axis.rotation(best.2)
}

/// What one lobe needs.
struct Work<'a> {
    config: &'a MarkConfig,
    gores: &'a GoreConfig,
    turned: &'a Turned,
    /// Radius of the ball, mm.
    radius: f64,
    /// Angle between lobes, radians.
    step: f64,
}

/// A part of a lobe on a page.
struct Piece {
    lobe: usize,
    /// Its window in the lobe's plane, mm.
    outline: Vec<Point>,
    /// Lowest and highest y, mm.
    range: [f64; 2],
    /// Whether it holds the lobe's lower end.
    is_lowest: bool,
}

impl Work<'_> {
    /// Longitude of a lobe's middle, radians. Cuts lie at multiples of the step.
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

    /// A lobe's outline, counter-clockwise from its lower end, mm.
    fn outline(&self) -> Vec<Point> {
        let half = 0.5 * self.step;
        let side = |sign: f64| {
            move |i: usize| {
                let latitude = PI * (i as f64 / SIDE_FACETS as f64 - 0.5);
                let (sl, cl) = latitude.sin_cos();
                let x = (cl * half.sin()).asin();
                let y = sl.atan2(cl * half.cos());
                Point::new(sign * self.radius * x, self.radius * y)
            }
        };
        let up = (0..SIDE_FACETS).map(side(1.0));
        let down = (1..=SIDE_FACETS).rev().map(side(-1.0));
        up.chain(down).collect()
    }

    /// All pieces: whole lobes, or parts that fit the page.
    fn pieces(&self) -> Vec<Piece> {
        let outline = self.outline();
        let half_height = FRAC_PI_2 * self.radius;
        let available = self.gores.page.usable_mm()[1] - 2.0 * (LOBE_END_MM + self.gores.bleed_mm);
        let parts = (2.0 * half_height / available).ceil().max(1.0) as usize;
        let wide = 2.0 * self.radius;
        let mut pieces = Vec::new();
        for lobe in 0..self.gores.lobes {
            for part in 0..parts {
                let y = |k: usize| half_height * (2.0 * k as f64 / parts as f64 - 1.0);
                let range = [y(part), y(part + 1)];
                let window = [
                    Point::new(-wide, range[0]),
                    Point::new(wide, range[0]),
                    Point::new(wide, range[1]),
                    Point::new(-wide, range[1]),
                ];
                pieces.push(Piece {
                    lobe,
                    outline: match parts {
                        1 => outline.clone(),
                        _ => clipped(&outline, &window),
                    },
                    range,
                    is_lowest: part == 0,
                });
            }
        }
        pieces
    }

    /// Lays the pieces out in rows, page by page, and says where each lies.
    fn pages(&self) -> Result<(Vec<super::Page>, Value)> {
        let page = self.gores.page;
        let [usable_width, usable_height] = page.usable_mm();
        let width = self.step * self.radius + LOBE_GAP_MM + 2.0 * self.gores.bleed_mm;
        if width > usable_width {
            let problem = format!(
                "{} lobes of a ball of {} mm are {width:.1} mm wide with their numbers, the page takes \
                 {usable_width:.1} mm: take more lobes or another page",
                self.gores.lobes, self.config.ball_diameter_mm
            );
            return Err(Error::argument("lobes", problem));
        }
        let in_a_row = ((usable_width / width) as usize).min(self.gores.lobes);
        let [left, bottom] = page.origin();
        let mut pages = Vec::new();
        let mut places = Vec::new();
        let (mut items, mut extent) = (Vec::new(), [0.0f64; 2]);
        let (mut column, mut y) = (0, 0.0);
        for piece in self.pieces() {
            let height =
                piece.range[1] - piece.range[0] + 2.0 * (LOBE_END_MM + self.gores.bleed_mm);
            if column == in_a_row {
                (column, y) = (0, y + height);
            }
            if y + height > usable_height {
                pages.push(page.page(std::mem::take(&mut items), extent));
                (column, y, extent) = (0, 0.0, [0.0; 2]);
            }
            let origin = Point::new(
                left + (column as f64 + 0.5) * width,
                bottom + y + LOBE_END_MM + self.gores.bleed_mm - piece.range[0],
            );
            column += 1;
            self.draw(&piece, origin, &mut items);
            extent[0] = extent[0].max(left + column as f64 * width);
            extent[1] = extent[1].max(bottom + y + height);
            places.push(json!({
                "page": pages.len(),
                "lobe": piece.lobe,
                "longitude_deg": self.longitude(piece.lobe).to_degrees(),
                "x_mm": origin.x,
                "y_mm": origin.y,
                "from_mm": piece.range[0],
                "to_mm": piece.range[1],
            }));
        }
        pages.push(page.page(items, extent));
        Ok((pages, Value::Array(places)))
    }

    /// Draws a piece whose plane has its origin at `origin` of the page.
    fn draw(&self, piece: &Piece, origin: Point, items: &mut Vec<Item>) {
        let placed =
            |points: &[Point]| -> Vec<Point> { points.iter().map(|p| origin + p.coords).collect() };
        let bleed = grown(&piece.outline, self.gores.bleed_mm);
        if self.gores.bleed_mm > 0.0 {
            items.push(Item::new(Layer::Bleed, Shape::Loop(placed(&bleed))));
        }
        for zone in &self.turned.keep_out {
            let circle = circle_on_ball(&zone.axis, zone.half_angle_rad, KEEP_OUT_FACETS);
            let points: Vec<Point> = circle
                .filter_map(|v| self.project(&v, piece.lobe))
                .collect();
            for line in lines_inside(&points, &piece.outline) {
                items.push(Item::new(Layer::KeepOut, Shape::Line(placed(&line))));
            }
        }
        let angle = self.config.dot_angle_rad();
        let facets = facets(0.5 * self.config.dot_diameter_mm);
        let mut numbers = Vec::new();
        for (dot, center) in self.turned.dots.iter().enumerate() {
            let circle = circle_on_ball(center, angle, facets);
            let points: Option<Vec<Point>> = circle.map(|v| self.project(&v, piece.lobe)).collect();
            let Some(points) = points else { continue };
            let seen = clipped(&points, &bleed);
            if seen.len() < 3 {
                continue;
            }
            items.push(Item::of_dot(Layer::Dots, dot, Shape::Area(placed(&seen))));
            if let Some(at) = self.project(center, piece.lobe)
                && self.owns(center, piece, &at)
            {
                numbers.push((dot, at));
            }
        }
        items.push(Item::new(Layer::Cut, Shape::Loop(placed(&piece.outline))));
        if self.gores.numbers {
            self.number(piece, origin, &numbers, items);
        }
    }

    /// Whether a piece holds a dot's center, at `at` in its plane.
    fn owns(&self, center: &Vec3, piece: &Piece, at: &Point) -> bool {
        let (longitude, _) = longitude_latitude(center);
        let lobe = (longitude.rem_euclid(TAU) / self.step) as usize % self.gores.lobes;
        lobe == piece.lobe && (piece.range[0]..piece.range[1]).contains(&at.y)
    }

    /// Writes numbers beside the lobe, each at the height of its dot and on the nearer side, and
    /// moves them up where they would meet; a thin line leads from a number to the cut beside its
    /// dot.
    fn number(&self, piece: &Piece, origin: Point, dots: &[(usize, Point)], items: &mut Vec<Item>) {
        let side_at = |y: f64| {
            let near = |p: &&Point| (p.y - y).abs();
            let side = piece.outline.iter().filter(|p| p.x >= 0.0);
            side.min_by(|a, b| near(a).total_cmp(&near(b)))
                .map_or(0.0, |p| p.x)
        };
        for sign in [-1.0, 1.0] {
            let mut here: Vec<_> = dots.iter().filter(|(_, p)| sign * p.x >= 0.0).collect();
            // A dot in the very middle belongs to the right side only.
            here.retain(|(_, p)| sign > 0.0 || p.x < 0.0);
            here.sort_by(|a, b| a.1.y.total_cmp(&b.1.y));
            let mut free = f64::NEG_INFINITY;
            for (dot, p) in here {
                let y = (p.y - 0.5 * NUMBER_MM).max(free);
                free = y + 1.4 * NUMBER_MM;
                let edge = side_at(p.y) + self.gores.bleed_mm;
                let from = Point::new(sign * (edge + 0.1), p.y);
                let to = Point::new(sign * (edge + NUMBER_GAP_MM), y + 0.5 * NUMBER_MM);
                let leader = Shape::Line(vec![origin + from.coords, origin + to.coords]);
                items.push(Item::of_dot(Layer::Notes, *dot, leader));
                let at = Point::new(sign * (edge + NUMBER_GAP_MM + 0.3), y);
                let anchor = if sign > 0.0 {
                    Anchor::Start
                } else {
                    Anchor::End
                };
                let words = Item::words(origin + at.coords, anchor, NUMBER_MM, dot.to_string());
                items.push(Item {
                    dot: Some(*dot),
                    ..words
                });
            }
        }
        if piece.is_lowest {
            let y = piece.range[0] - self.gores.bleed_mm - 1.2 * NUMBER_MM;
            let at = origin + nalgebra::Vector2::new(0.0, y);
            let letter = char::from(b'A' + (piece.lobe % 26) as u8).to_string();
            items.push(Item::words(at, Anchor::Middle, NUMBER_MM, letter));
        }
    }
}
