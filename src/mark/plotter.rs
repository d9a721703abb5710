//! Files for machines that turn the ball under a pen.
//!
//! Both kinds take longitude and latitude. EggBot and its kin read an SVG as wide as a turn of the
//! ball has motor steps, `x = steps lambda / 2 pi`, `y = steps (pi/2 - phi) / 2 pi`: a circle on
//! the ball is wide there where its latitude is high, so dots are drawn counter-distorted. Sphere
//! plotters read G-code for GRBL (`G0`, `G1`, `G4`, `M3 S`), X the longitude and Y the latitude in
//! degrees; longitudes go on beyond a full turn where a dot does.
//!
//! A dot is one line without lifting the pen: rings from its edge inwards, a pen's width or less
//! apart, so that ink covers all of it. The pen's middle stays half its width inside the edge.
//!
//! The poles, where the machine holds the ball, are laid where no dot is, and longitude 0 where the
//! fewest dots are.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt::Write as _;

use serde_json::json;

use crate::error::{Result, require};
use crate::geometry::{Rotation, Vec3};
use crate::pattern::Pattern;

use super::axis::free_axis;
use super::drawing::{Drawing, Item, Layer, Page, Point, Shape};
use super::outline::{circle_on_ball, facets};
use super::{MarkConfig, TurnedDirections, longitude_latitude};

/// Distance of neighboring rings as a part of the pen's width.
const OVERLAP: f64 = 0.8;
/// A narrower ring is a touch of the pen.
const MIN_RING_MM: f64 = 0.005;
/// Turns about the poles that are tried.
const TURNS: usize = 360;
/// Longest comment in G-code, characters: senders cut longer lines.
const COMMENT: usize = 60;

/// How a plotter draws.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotterConfig {
    /// Width of the pen's line on the ball, mm. Default 0.6.
    pub pen_diameter_mm: f64,
    /// Motor steps of a turn, the width of the SVG. Default 3200, EggBot's.
    pub steps_per_turn: f64,
    /// Speed of the pen on the ball, mm/min. Default 600.
    pub feed_mm_per_min: f64,
    /// G-code that lifts the pen. Default `M3 S40`.
    pub pen_up: String,
    /// G-code that lowers it. Default `M3 S90`.
    pub pen_down: String,
    /// Time that the pen takes to move, s. Default 0.3.
    pub pen_delay_s: f64,
}

impl Default for PlotterConfig {
    fn default() -> Self {
        Self {
            pen_diameter_mm: 0.6,
            steps_per_turn: 3200.0,
            feed_mm_per_min: 600.0,
            pen_up: "M3 S40".to_owned(),
            pen_down: "M3 S90".to_owned(),
            pen_delay_s: 0.3,
        }
    }
}

impl PlotterConfig {
    fn validate(&self, config: &MarkConfig) -> Result<()> {
        let pen = self.pen_diameter_mm;
        let max_pen = config.dot_diameter_mm;
        let inside = (0.05..=max_pen).contains(&pen);
        let expected = format!("0.05 to {max_pen} mm, the dot's diameter");
        require(inside, "pen_diameter_mm", &expected, pen)?;
        let steps = self.steps_per_turn;
        let inside = (100.0..=1e6).contains(&steps);
        require(inside, "steps_per_turn", "100 to 1000000", steps)?;
        let feed = self.feed_mm_per_min;
        let inside = (1.0..=1e5).contains(&feed);
        require(inside, "feed_mm_per_min", "1 to 100000 mm/min", feed)?;
        let delay = self.pen_delay_s;
        require(
            (0.0..=10.0).contains(&delay),
            "pen_delay_s",
            "0 to 10 s",
            delay,
        )?;
        for (name, words) in [("pen_up", &self.pen_up), ("pen_down", &self.pen_down)] {
            let plain = !words.trim().is_empty() && words.chars().all(|c| (' '..='~').contains(&c));
            require(plain, name, "one line of G-code", format!("{words:?}"))?;
        }
        Ok(())
    }
}

/// The pen's path over one dot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotterPath {
    /// The dot.
    pub dot: usize,
    /// Longitudes, radians, without jumps.
    pub longitudes: Vec<f64>,
    /// Latitudes, radians.
    pub latitudes: Vec<f64>,
}

/// The pen's paths over all dots, by growing longitude, with the rotation from the pattern's frame.
///
/// # Errors
/// [`crate::Error::Argument`] where a parameter is outside its domain, or a dot lies over both ends of
/// every axis.
pub fn plotter_paths(
    pattern: &Pattern,
    config: &MarkConfig,
    plotter: &PlotterConfig,
) -> Result<(Rotation, Vec<PlotterPath>)> {
    config.validate(pattern)?;
    plotter.validate(config)?;
    let axis = free_axis(pattern.dots());
    if axis.clearance_rad <= config.dot_angle_rad() {
        return Err(config.no_free_axis(&axis));
    }
    let rotation = axis.rotation(best_turn(&axis.rotation(0.0), pattern, config));
    let dots = pattern.dots().iter().map(|d| rotation * d).enumerate();
    let mut paths: Vec<PlotterPath> = dots
        .map(|(dot, center)| path(dot, &center, config, plotter))
        .collect();
    paths.sort_by(|a, b| a.longitudes[0].total_cmp(&b.longitudes[0]));
    Ok((rotation, paths))
}

/// The turn about the poles after which longitude 0 meets the fewest dots; of equals, keeps
/// farthest.
fn best_turn(upright: &Rotation, pattern: &Pattern, config: &MarkConfig) -> f64 {
    let dots: Vec<_> = pattern
        .dots()
        .iter()
        .map(|d| longitude_latitude(&(upright * d)))
        .collect();
    let mut best = (usize::MAX, f64::NEG_INFINITY, 0.0);
    for i in 0..TURNS {
        let turn = TAU * i as f64 / TURNS as f64;
        let margins = dots.iter().map(|(longitude, latitude)| {
            // Half the dot's extent in longitude.
            let half = (config.dot_angle_rad().sin() / latitude.cos())
                .min(1.0)
                .asin();
            let off = (longitude + turn + PI).rem_euclid(TAU) - PI;
            off.abs() - half
        });
        let met = margins.clone().filter(|&m| m < 0.0).count();
        let margin = margins.fold(f64::INFINITY, f64::min);
        if met < best.0 || (met == best.0 && margin > best.1) {
            best = (met, margin, turn);
        }
    }
    best.2
}

/// Rings over a dot, from the outermost inwards, one after the other.
fn path(dot: usize, center: &Vec3, config: &MarkConfig, plotter: &PlotterConfig) -> PlotterPath {
    let pen = plotter.pen_diameter_mm;
    let ball = config.radius_mm();
    let mut path = PlotterPath {
        dot,
        longitudes: Vec::new(),
        latitudes: Vec::new(),
    };
    let mut last = longitude_latitude(center).0.rem_euclid(TAU);
    let mut add = |v: &Vec3| {
        let (longitude, latitude) = longitude_latitude(v);
        // The turn nearest to the point before.
        let longitude = longitude + TAU * ((last - longitude) / TAU).round();
        last = longitude;
        path.longitudes.push(longitude);
        path.latitudes.push(latitude);
    };
    let edge = 0.5 * (config.dot_diameter_mm - pen);
    let mut radius = edge;
    // Within a ring narrower than this the pen covers everything. The first is the dot's edge, however narrow.
    while radius > 0.25 * pen || (radius == edge && edge > MIN_RING_MM) {
        let n = facets(radius);
        let angle = (radius / ball).asin();
        // Closed: the first point comes again.
        for v in circle_on_ball(center, angle, n) {
            add(&v);
        }
        if let Some(v) = circle_on_ball(center, angle, n).next() {
            add(&v);
        }
        radius -= OVERLAP * pen;
    }
    add(center);
    path
}

/// The SVG for EggBot-like machines, as a drawing whose millimeters are motor steps.
///
/// # Errors
/// As [`plotter_paths`].
pub fn plotter_drawing(
    pattern: &Pattern,
    config: &MarkConfig,
    plotter: &PlotterConfig,
) -> Result<Drawing> {
    let (rotation, paths) = plotter_paths(pattern, config, plotter)?;
    let steps = plotter.steps_per_turn;
    let per_radian = steps / TAU;
    let mut items = Vec::new();
    for path in &paths {
        let points = path.longitudes.iter().zip(&path.latitudes);
        let points: Vec<Point> = points
            .map(|(l, p)| Point::new(per_radian * l, per_radian * (p + FRAC_PI_2)))
            .collect();
        for line in wrapped(&points, steps) {
            items.push(Item::of_dot(Layer::Dots, path.dot, Shape::Line(line)));
        }
    }
    let turned = TurnedDirections::new(pattern, config, rotation);
    let mut note = turned.note("plotter", pattern, config);
    note.insert("projection".into(), json!("equirectangular"));
    note.insert("steps_per_turn".into(), json!(steps));
    note.insert("pen_diameter_mm".into(), json!(plotter.pen_diameter_mm));
    Ok(Drawing {
        title: format!("Plotter's paths of pattern {:.8}", pattern.sha256()),
        note,
        pages: vec![Page {
            width_mm: steps,
            height_mm: 0.5 * steps,
            items,
        }],
        line_mm: plotter.pen_diameter_mm / (TAU * config.radius_mm()) * steps,
        is_in_steps: true,
    })
}

/// A line parted where it leaves `[0, width]`, its parts moved back in.
fn wrapped(points: &[Point], width: f64) -> Vec<Vec<Point>> {
    let mut lines: Vec<Vec<Point>> = Vec::new();
    let mut turn = None;
    let mut last: Option<Point> = None;
    for p in points {
        let here = (p.x / width).floor();
        match (turn, last, lines.last_mut()) {
            (Some(t), Some(q), Some(line)) if t != here => {
                // The edge between the two turns.
                let edge = width * f64::max(t, here);
                let y = q.y + (p.y - q.y) * (edge - q.x) / (p.x - q.x);
                line.push(Point::new(edge - width * t, y));
                let start = Point::new(edge - width * here, y);
                lines.push(vec![start, Point::new(p.x - width * here, p.y)]);
            }
            (Some(t), _, Some(line)) => line.push(Point::new(p.x - width * t, p.y)),
            _ => lines.push(vec![Point::new(p.x - width * here, p.y)]),
        }
        (turn, last) = (Some(here), Some(*p));
    }
    lines
}

/// G-code for sphere plotters under GRBL.
///
/// # Errors
/// As [`plotter_paths`].
pub fn plotter_program(
    pattern: &Pattern,
    config: &MarkConfig,
    plotter: &PlotterConfig,
) -> Result<String> {
    let (rotation, paths) = plotter_paths(pattern, config, plotter)?;
    let turned = TurnedDirections::new(pattern, config, rotation);
    let mut note = turned.note("plotter", pattern, config);
    note.insert("pen_diameter_mm".into(), json!(plotter.pen_diameter_mm));
    let note = serde_json::Value::Object(note).to_string();
    let mut out = TextLines(String::new());
    out.line("; X longitude, Y latitude, degrees; begin with the pen");
    out.line("; at longitude 0 on the equator");
    for (k, piece) in note.as_bytes().chunks(COMMENT).enumerate() {
        out.line(format_args!(
            "; note {k} {}",
            String::from_utf8_lossy(piece)
        ));
    }
    for word in ["G21", "G90", "G94"] {
        out.line(word);
    }
    let delay = plotter.pen_delay_s;
    let up = format!("{}\nG4 P{delay}", plotter.pen_up.trim());
    let down = format!("{}\nG4 P{delay}", plotter.pen_down.trim());
    out.line(&up);
    for path in &paths {
        out.line(format_args!("; dot {}", path.dot));
        let (mut longitude, mut latitude) = (path.longitudes[0], path.latitudes[0]);
        out.line(format_args!("G0 {}", at(longitude, latitude)));
        out.line(&down);
        let mut feed = None;
        let rest = path.longitudes.iter().zip(&path.latitudes).skip(1);
        for (&next_longitude, &next_latitude) in rest {
            let turned = next_longitude - longitude;
            let raised = next_latitude - latitude;
            // Degrees on the axes for each millimeter on the ball.
            let middle = 0.5 * (latitude + next_latitude);
            let on_ball = config.radius_mm() * (turned * middle.cos()).hypot(raised);
            let degrees = turned.hypot(raised).to_degrees();
            let wanted = (plotter.feed_mm_per_min * degrees / on_ball.max(1e-9)).round();
            let words = at(next_longitude, next_latitude);
            if feed == Some(wanted) {
                out.line(format_args!("G1 {words}"));
            } else {
                out.line(format_args!("G1 {words} F{wanted}"));
                feed = Some(wanted);
            }
            (longitude, latitude) = (next_longitude, next_latitude);
        }
        out.line(&up);
    }
    out.line("G0 X0 Y0");
    out.line("M2");
    Ok(out.0)
}

/// A position in degrees, to a ten-thousandth.
fn at(longitude: f64, latitude: f64) -> String {
    format!(
        "X{:.4} Y{:.4}",
        longitude.to_degrees(),
        latitude.to_degrees()
    )
}

/// Lines of text.
struct TextLines(String);

impl TextLines {
    fn line(&mut self, words: impl std::fmt::Display) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.0, "{words}");
    }
}
