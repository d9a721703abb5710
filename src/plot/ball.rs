//! Plot of a pattern: the ball from both sides, with its dots and their numbers.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::canvas::{
    self, Area, Drawn, INK, LABEL, SMALL, picture, px, stroke, styled_text, text, titled,
};
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::pattern::Pattern;

/// Width and height of [`pattern_views`]'s picture, pixels.
pub const VIEWS_SIZE: (u32, u32) = (1280, 760);

/// Radius of a drawn ball, file pixels.
const RADIUS: f64 = 265.0;
/// Height of the ball's center beneath the title, file pixels.
const CENTER_Y: f64 = 318.0;
/// Inner radius of the ring of a dot that is to be drawn, as part of the dot's.
const RING: f64 = 0.72;
/// Size of the dots' numbers, file pixels.
const NUMBER: f64 = 17.0;
/// Dots lower than this (z of the unit vector) have their numbers outside the ball.
const LIMB: f64 = 0.3;

/// What [`pattern_views`] draws besides the pattern.
#[derive(Debug, Clone, PartialEq)]
pub struct BallDrawing {
    /// Title of the plot.
    pub title: String,
    /// Diameter of the ball, millimeters.
    pub ball_diameter_mm: f64,
    /// Diameter of a dot (of the stencil's hole), millimeters; less than the ball's.
    pub dot_diameter_mm: f64,
    /// So many dots, the last ones, are not on the ball yet: they are drawn as rings.
    pub to_draw: usize,
}

impl BallDrawing {
    /// Angle between a dot's center and its rim, radians.
    fn dot_radius(&self) -> Result<f64> {
        for (name, value) in [
            ("ball diameter", self.ball_diameter_mm),
            ("dot diameter", self.dot_diameter_mm),
        ] {
            if !(value.is_finite() && value > 0.0) {
                let problem = format!("expected a positive number of millimeters, found {value}");
                return Err(Error::argument(name, problem));
            }
        }
        let ratio = self.dot_diameter_mm / self.ball_diameter_mm;
        if ratio >= 1.0 {
            let problem = "expected less than the ball's diameter";
            return Err(Error::argument("dot diameter", problem));
        }
        Ok(ratio.asin())
    }
}

/// A side from which the ball is seen, orthographically, with +y up.
pub(super) struct ViewSide {
    pub caption: &'static str,
    /// Direction that points right in the picture.
    right: Vec3,
    /// Direction towards the viewer.
    towards: Vec3,
    /// Whether +z points at the viewer.
    z_towards: bool,
}

impl ViewSide {
    /// Front, then back. The back is what is seen after half a turn of the ball about y.
    pub fn both() -> [Self; 2] {
        [
            Self {
                caption: "front (seen from +z)",
                right: Vec3::x(),
                towards: Vec3::z(),
                z_towards: true,
            },
            Self {
                caption: "back (seen from \u{2212}z)",
                right: -Vec3::x(),
                towards: -Vec3::z(),
                z_towards: false,
            },
        ]
    }

    /// Whether it is the front.
    #[cfg(feature = "vision")]
    pub fn is_front(&self) -> bool {
        self.z_towards
    }

    /// Coordinates of `v` in this view: right, up, towards the viewer.
    pub fn view(&self, v: &Vec3) -> Vec3 {
        Vec3::new(v.dot(&self.right), v.y, v.dot(&self.towards))
    }
}

/// Draws the ball from the front (+z) and from the back (-z), with every dot's outline and number.
///
/// Dots are drawn as the caps that they are, so that they narrow to ellipses towards the limb. A
/// dot that is cut by the limb is numbered on both sides. Numbers count from 0, as the dots of a
/// pattern do.
///
/// # Errors
/// [`Error::Argument`] for diameters that are not positive or a dot as large as the ball;
/// [`Error::Write`] where the file cannot be written.
pub fn pattern_views(path: &Path, pattern: &Pattern, view: &BallDrawing) -> Result<()> {
    let dot_radius = view.dot_radius()?;
    picture(path, VIEWS_SIZE, |root| {
        let area = titled(root, &view.title)?;
        let halves = area.split_evenly((1, 2));
        for (half, side) in halves.iter().zip(ViewSide::both()) {
            let dots: Vec<Vec3> = pattern.dots().iter().map(|d| side.view(d)).collect();
            let zones: Vec<(Vec3, f64)> = pattern
                .keep_out()
                .iter()
                .map(|zone| (side.view(&zone.axis), zone.half_angle_rad))
                .collect();
            let drawn = dots.len().saturating_sub(view.to_draw);
            draw_ball(half, &dots, drawn, dot_radius, &zones)?;
            draw_numbers(half, &dots, drawn, dot_radius)?;
            let at = (center(half).0, px(CENTER_Y + RADIUS + 52.0));
            text(half, side.caption, at, HPos::Center, LABEL + 2.0, INK)?;
            draw_axes(half, &side)?;
        }
        let zones = match pattern.keep_out().len() {
            0 => "",
            1 => "; hatched: a zone that stays free",
            _ => "; hatched: zones that stay free",
        };
        let rings = match view.to_draw {
            0 => "",
            _ => "; rings: to be drawn",
        };
        let note = format!(
            "{} dots of {} mm on a ball of {} mm{rings}{zones}",
            pattern.len(),
            view.dot_diameter_mm,
            view.ball_diameter_mm
        );
        let (width, height) = area.dim_in_pixel();
        let at = (width as i32 / 2, height as i32 - px(20.0));
        text(&area, &note, at, HPos::Center, SMALL, INK)
    })
}

/// The drawn ball's center.
fn center(area: &Area<'_>) -> (i32, i32) {
    (area.dim_in_pixel().0 as i32 / 2, px(CENTER_Y))
}

/// Shades the ball and its dots pixel by pixel: what a pixel shows follows from its point on the
/// sphere. The dots from number `drawn` on are rings.
fn draw_ball(
    area: &Area<'_>,
    dots: &[Vec3],
    drawn: usize,
    dot_radius: f64,
    zones: &[(Vec3, f64)],
) -> Drawn {
    let (cx, cy) = center(area);
    let radius = px(RADIUS);
    let light = Vec3::new(-0.35, 0.45, 0.82).normalize();
    let [min_cos, ring_cos] = [1.0, RING].map(|part| (part * dot_radius).cos());
    let (dots, rings) = dots.split_at(drawn);
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            let x = f64::from(dx) / f64::from(radius);
            let y = -f64::from(dy) / f64::from(radius);
            let rest = 1.0 - x * x - y * y;
            if rest < 0.0 {
                continue;
            }
            let point = Vec3::new(x, y, rest.sqrt());
            let lit = 0.72 + 0.28 * point.dot(&light).max(0.0);
            let dark = dots.iter().any(|d| d.dot(&point) >= min_cos);
            let in_ring = |d: &Vec3| (min_cos..ring_cos).contains(&d.dot(&point));
            let base: [f64; 3] = if dark {
                [46.0, 52.0, 64.0]
            } else if rings.iter().any(in_ring) {
                let RGBColor(r, g, b) = canvas::color(1);
                [r, g, b].map(f64::from)
            } else {
                zone_color(&point, zones).unwrap_or([255.0, 246.0, 232.0])
            };
            let [r, g, b] = base.map(|c| (c * lit) as u8);
            area.draw_pixel((cx + dx, cy + dy), &RGBColor(r, g, b))?;
        }
    }
    area.draw(&Circle::new((cx, cy), radius, stroke(canvas::GRAY, 1.0)))?;
    Ok(())
}

/// The color of a point within a zone without dots: hatched, with a darker rim.
fn zone_color(point: &Vec3, zones: &[(Vec3, f64)]) -> Option<[f64; 3]> {
    const RIM: [f64; 3] = [14.0, 143.0, 110.0];
    const HATCH: [[f64; 3]; 2] = [[150.0, 205.0, 182.0], [186.0, 221.0, 205.0]];
    zones.iter().find_map(|(axis, half_angle)| {
        let inside = half_angle - axis.dot(point).clamp(-1.0, 1.0).acos();
        let stripe = (9.0 * (point.x + point.y)).rem_euclid(1.0) < 0.5;
        match inside {
            i if i < 0.0 => None,
            i if i < 0.02 => Some(RIM),
            _ => Some(HATCH[usize::from(stripe)]),
        }
    })
}

/// A rectangle in drawn pixels.
#[derive(Clone, Copy)]
struct Extent {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Extent {
    fn around((x, y): (f64, f64), half_width: f64, half_height: f64) -> Self {
        Self {
            left: x - half_width,
            top: y - half_height,
            right: x + half_width,
            bottom: y + half_height,
        }
    }

    fn overlap(&self, other: &Self) -> f64 {
        let w = self.right.min(other.right) - self.left.max(other.left);
        let h = self.bottom.min(other.bottom) - self.top.max(other.top);
        w.max(0.0) * h.max(0.0)
    }
}

/// Numbers the dots of which something is seen from this side: inside a dot that is large enough,
/// outside the ball with a line to the dot at the limb, else beside the dot. Those from number `drawn` on are rings.
fn draw_numbers(area: &Area<'_>, dots: &[Vec3], drawn: usize, dot_radius: f64) -> Drawn {
    let (cx, cy) = center(area);
    let (cx, cy, radius) = (f64::from(cx), f64::from(cy), f64::from(px(RADIUS)));
    let long = radius * dot_radius.sin();
    let shown: Vec<(usize, &Vec3)> = dots
        .iter()
        .enumerate()
        .filter(|(_, d)| d.z > -dot_radius.sin())
        .collect();
    let place = |d: &Vec3| {
        let r = radius * dot_radius.cos();
        (cx + r * d.x, cy - r * d.y)
    };
    let mut taken: Vec<Extent> = shown
        .iter()
        .map(|(_, d)| {
            // The rim is an ellipse of semi-axes `long` and, along the radius, `long * z`.
            let across = |c: f64| long * (1.0 - c * c).max(0.0).sqrt();
            Extent::around(place(d), across(d.x), across(d.y))
        })
        .collect();
    for (k, (number, d)) in shown.iter().enumerate() {
        let label = number.to_string();
        let half = (
            f64::from(canvas::text_width(&label, NUMBER)) / 2.0,
            f64::from(px(NUMBER)) * 0.36,
        );
        let (at, color) = if (half.0 / long).hypot(half.1 / long) < 0.85 * d.z {
            (place(d), if *number < drawn { WHITE } else { INK })
        } else if d.z < LIMB {
            let (from, knee, at) = outside((cx, cy), radius, d, half, &taken);
            let line = [from, knee].map(|p| (p.0.round() as i32, p.1.round() as i32));
            area.draw(&PathElement::new(line.to_vec(), stroke(INK, 1.0)))?;
            taken.push(Extent::around(at, half.0, half.1));
            (at, INK)
        } else {
            let at = beside(taken[k], half, &taken);
            taken.push(Extent::around(at, half.0, half.1));
            (at, INK)
        };
        let at = (at.0.round() as i32, at.1.round() as i32);
        styled_text(area, &label, at, HPos::Center, canvas::bold(NUMBER), color)?;
    }
    Ok(())
}

/// A place outside the ball for the number of the dot `d` at the limb: where the line to it starts
/// and ends, and the number's middle. Numbers evade each other along the limb.
fn outside(
    (cx, cy): (f64, f64),
    radius: f64,
    d: &Vec3,
    half: (f64, f64),
    taken: &[Extent],
) -> ((f64, f64), (f64, f64), (f64, f64)) {
    let azimuth = d.y.atan2(d.x);
    let at = |r: f64, angle: f64| (cx + r * angle.cos(), cy - r * angle.sin());
    let from = at(radius * d.x.hypot(d.y), azimuth);
    let mut best = (f64::INFINITY, from, from);
    for degrees in [0.0, 2.5, -2.5, 5.0, -5.0, 7.5, -7.5f64] {
        let angle = azimuth + degrees.to_radians();
        let knee = at(radius + f64::from(px(9.0)), angle);
        // As far out as the number's box reaches in this direction.
        let reach = (half.0 * angle.cos()).hypot(half.1 * angle.sin()) + f64::from(px(13.0));
        let place = at(radius + reach, angle);
        let gap = f64::from(px(2.0));
        let label = Extent::around(place, half.0 + gap, half.1 + gap);
        let covered: f64 = taken.iter().map(|t| t.overlap(&label)).sum();
        if covered < best.0 {
            best = (covered, knee, place);
        }
    }
    (from, best.1, best.2)
}

/// The place around `dot` where a label of the given size covers the least area of what is `taken`.
fn beside(dot: Extent, (half_width, half_height): (f64, f64), taken: &[Extent]) -> (f64, f64) {
    let gap = f64::from(px(4.0));
    let middle = ((dot.left + dot.right) / 2.0, (dot.top + dot.bottom) / 2.0);
    let reach_x = (dot.right - dot.left) / 2.0 + half_width + gap;
    let reach_y = (dot.bottom - dot.top) / 2.0 + half_height + gap;
    let mut best = (f64::INFINITY, middle);
    for (dx, dy) in [
        (1.0, 0.0),
        (-1.0, 0.0),
        (0.0, -1.0),
        (0.0, 1.0),
        (0.85, -0.85),
        (-0.85, -0.85),
        (0.85, 0.85),
        (-0.85, 0.85),
    ] {
        let at = (middle.0 + dx * reach_x, middle.1 + dy * reach_y);
        let label = Extent::around(at, half_width + gap / 2.0, half_height + gap / 2.0);
        let covered: f64 = taken.iter().map(|t| t.overlap(&label)).sum();
        if covered < best.0 {
            best = (covered, at);
        }
    }
    best.1
}

/// The axes' directions in the view's lower left corner: x and y as arrows, z as a tip or tail.
fn draw_axes(area: &Area<'_>, side: &ViewSide) -> Drawn {
    let length = px(44.0);
    let forwards = if side.z_towards { 1 } else { -1 };
    let x = px(if side.z_towards { 46.0 } else { 90.0 });
    let y = px(CENTER_Y + RADIUS + 64.0);
    let line = stroke(INK, 1.6);
    let head = px(5.0);
    let tip = (x + forwards * length, y);
    area.draw(&PathElement::new(vec![(x, y), tip], line))?;
    let back = tip.0 - forwards * head * 2;
    let triangle = vec![tip, (back, y - head), (back, y + head)];
    area.draw(&Polygon::new(triangle, INK.filled()))?;
    let tip = (x, y - length);
    area.draw(&PathElement::new(vec![(x, y), tip], line))?;
    let triangle = vec![
        tip,
        (x - head, tip.1 + head * 2),
        (x + head, tip.1 + head * 2),
    ];
    area.draw(&Polygon::new(triangle, INK.filled()))?;
    area.draw(&Circle::new((x, y), px(6.0), WHITE.filled()))?;
    area.draw(&Circle::new((x, y), px(6.0), line))?;
    if side.z_towards {
        area.draw(&Circle::new((x, y), px(2.0), INK.filled()))?;
    } else {
        let d = px(4.0);
        area.draw(&PathElement::new(
            vec![(x - d, y - d), (x + d, y + d)],
            line,
        ))?;
        area.draw(&PathElement::new(
            vec![(x - d, y + d), (x + d, y - d)],
            line,
        ))?;
    }
    let at = (x + forwards * (length + px(11.0)), y);
    text(area, "x", at, HPos::Center, SMALL, INK)?;
    text(
        area,
        "y",
        (x, y - length - px(11.0)),
        HPos::Center,
        SMALL,
        INK,
    )?;
    let at = (x - forwards * px(15.0), y + px(10.0));
    text(area, "z", at, HPos::Center, SMALL, INK)?;
    Ok(())
}
