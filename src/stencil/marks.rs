//! The dots' numbers, engraved beside their holes.
//!
//! Numbers are outlines of a real font, upright when the dome is up, engraved to the same depth
//! below the sphere everywhere. A number keeps clear of holes, rims, hinge, tab and other numbers,
//! and lies nearer to its own hole than to any other: at most three quarters as far, where there is
//! such a place. Where there is none it is set smaller, then nearer to another; a dot around which
//! nothing fits stays without.

use crate::error::Result;
use crate::geometry::{Vec3, tangent_frame};

use super::glyphs::Words;
use super::joint::Joint;
use super::mesh::Mesh;
use super::solid::Solid;
use super::{StencilConfig, shapes};

/// Height of a number as a fraction of the ball's diameter, and its bounds, mm.
const HEIGHT: (f64, f64, f64) = (0.08, 2.8, 8.0);
/// Sizes that are tried, as parts of that height, with how far a number may be from its own hole,
/// as a part of its distance from any other.
const TRIES: [(f64, f64); 4] = [(1.0, 0.75), (0.8, 0.75), (1.0, 0.95), (0.8, 0.95)];
/// Depth of the engraving as a fraction of the wall, and its bound, mm.
const DEPTH: (f64, f64) = (0.2, 0.5);
/// Minimum distance of a number from anything else, and from other numbers, mm.
const CLEAR_MM: f64 = 0.5;
const NUMBERS_APART_MM: f64 = 1.6;
/// Directions tried around a hole.
const DIRECTIONS: usize = 48;
/// Distances tried beyond the nearest, mm.
const STEPS_MM: [f64; 6] = [0.25, 0.75, 1.25, 2.0, 3.0, 4.0];

/// Where a dot's number stands.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct DotNumber {
    /// The dot.
    pub dot: usize,
    /// Direction of the number's middle from the ball's center, in the half's own frame (dome up).
    pub direction: Vec3,
    /// Height of its digits, mm.
    pub height_mm: f64,
}

/// A place on the dome for a number: a rectangle touching the sphere in its middle.
#[derive(Clone, Copy)]
struct Place {
    center: Vec3,
    right: Vec3,
    up: Vec3,
    half_width: f64,
    half_height: f64,
}

impl Place {
    /// A rectangle about the direction `center`, upright when the dome is up.
    fn new(center: Vec3, words: &Words) -> Self {
        let up = (Vec3::z() - center.z * center).try_normalize(0.05);
        let up = up.unwrap_or_else(|| tangent_frame(&center)[0]);
        Self {
            right: up.cross(&center),
            center,
            up,
            half_width: words.half_width,
            half_height: words.half_height,
        }
    }

    /// Distance of a point from the rectangle in its plane, mm; infinite on the far side of the
    /// ball.
    fn distance(&self, p: &Vec3) -> f64 {
        if p.dot(&self.center) <= 0.0 {
            return f64::INFINITY;
        }
        let x = (p.dot(&self.right).abs() - self.half_width).max(0.0);
        let y = (p.dot(&self.up).abs() - self.half_height).max(0.0);
        x.hypot(y)
    }

    /// Points of its outline on the tangent plane, corners among them, mm.
    fn outline(&self, radius: f64) -> impl Iterator<Item = Vec3> {
        let place = *self;
        (-2..=2)
            .flat_map(move |i| (-2..=2).map(move |j| (f64::from(i) / 2.0, f64::from(j) / 2.0)))
            .filter(|(a, b)| a.abs() == 1.0 || b.abs() == 1.0)
            .map(move |(a, b)| {
                radius * place.center
                    + a * place.half_width * place.right
                    + b * place.half_height * place.up
            })
    }

    /// Whether two rectangles keep clear of each other.
    fn is_apart(&self, other: &Self, radius: f64) -> bool {
        let apart = |a: &Self, b: &Self| {
            let mut points = b.outline(radius);
            points.all(|p| a.distance(&p) > NUMBERS_APART_MM)
        };
        apart(self, other) && apart(other, self)
    }
}

/// Numbers for the dots of one half, in its own frame (dome up).
pub(super) struct Marks {
    /// What cuts them.
    pub tools: Vec<Mesh>,
    /// Where they are.
    pub numbers: Vec<DotNumber>,
    /// Dots for whose number there was no place.
    pub left_out: Vec<usize>,
}

/// What numbers keep clear of.
pub(super) struct Surroundings<'a> {
    /// Directions of all holes that cut the half.
    pub holes: &'a [Vec3],
    /// Points on hinge and tab.
    pub obstacles: &'a [Vec3],
}

/// Engraves the numbers `numbered` (index and direction, the half's own frame).
///
/// # Errors
/// [`crate::Error::Internal`] where the font or the boolean engine fails.
pub(super) fn numbers(
    numbered: &[(usize, Vec3)],
    around: &Surroundings<'_>,
    config: &StencilConfig,
    joint: &Joint,
) -> Result<Marks> {
    let radius = config.outer_radius_mm();
    let full = (HEIGHT.0 * config.ball_diameter_mm).clamp(HEIGHT.1, HEIGHT.2);
    let mut marks = Marks {
        tools: Vec::new(),
        numbers: Vec::new(),
        left_out: Vec::new(),
    };
    // Dots with the fewest places choose first.
    let mut waiting = Vec::new();
    for (dot, direction) in numbered {
        let mut found = Vec::new();
        for (size, nearer) in TRIES {
            let height = size * full;
            let words = Words::new(&dot.to_string(), height)?;
            let places = places(direction, &words, nearer, around, config, joint);
            found.extend(places.into_iter().map(|place| (height, place)));
        }
        waiting.push((*dot, found));
    }
    waiting.sort_by_key(|(_, found)| found.len());
    let mut taken: Vec<Place> = Vec::new();
    for (dot, found) in waiting {
        let free = |place: &Place| taken.iter().all(|t| t.is_apart(place, radius));
        let Some((height_mm, place)) = found.into_iter().find(|(_, place)| free(place)) else {
            marks.left_out.push(dot);
            continue;
        };
        let words = Words::new(&dot.to_string(), height_mm)?;
        marks.tools.push(tool(&place, &words, config)?);
        marks.numbers.push(DotNumber {
            dot,
            direction: place.center,
            height_mm,
        });
        taken.push(place);
    }
    marks.numbers.sort_by_key(|number| number.dot);
    marks.left_out.sort_unstable();
    Ok(marks)
}

/// What cuts `text`, `height` high, at the direction `center`.
///
/// # Errors
/// As [`numbers`].
pub(super) fn words_at(
    center: &Vec3,
    height: f64,
    text: &str,
    config: &StencilConfig,
) -> Result<Mesh> {
    let words = Words::new(text, height)?;
    tool(&Place::new(*center, &words), &words, config)
}

/// Depth of the engraving, mm: four fifths of the wall remain, which is more than a nozzle's width.
fn depth_mm(config: &StencilConfig) -> f64 {
    (DEPTH.0 * config.wall_mm).min(DEPTH.1)
}

/// What the engraving leaves: the sphere of its bottom.
pub(super) fn floor(config: &StencilConfig) -> Mesh {
    let radius = config.outer_radius_mm() - depth_mm(config);
    shapes::sphere(radius, config.chord_error_mm)
}

/// Places around the hole of `dot` that keep clear of everything but other numbers, nearest first,
/// sideways ones before others.
fn places(
    dot: &Vec3,
    words: &Words,
    nearer: f64,
    around: &Surroundings<'_>,
    config: &StencilConfig,
    joint: &Joint,
) -> Vec<Place> {
    let radius = config.outer_radius_mm();
    let hole = config.opening_radius_mm();
    let lowest = joint.lip_mm + joint.ledge_gap_mm + CLEAR_MM;
    let here = Place::new(*dot, words);
    let mut found = Vec::new();
    for step in STEPS_MM {
        for i in 0..DIRECTIONS {
            // 0, then alternately to either side of the direction to the right.
            let turn = if i % 2 == 0 {
                i / 2
            } else {
                DIRECTIONS - i.div_ceil(2)
            };
            let (sin, cos) = (std::f64::consts::TAU * turn as f64 / DIRECTIONS as f64).sin_cos();
            let towards = cos * here.right + sin * here.up;
            let extent = words.half_width * cos.abs() + words.half_height * sin.abs();
            let angle = (hole + CLEAR_MM + step + extent) / radius;
            let place = Place::new(angle.cos() * dot + angle.sin() * towards, words);
            let own = (place.center - dot).norm();
            let clear = place.outline(radius).all(|c| c.z > lowest)
                && around.holes.iter().all(|h| {
                    let is_clear = place.distance(&(radius * h)) > hole + CLEAR_MM;
                    is_clear && (h == dot || own < nearer * (place.center - h).norm())
                })
                && around
                    .obstacles
                    .iter()
                    .all(|p| place.distance(p) > CLEAR_MM);
            if clear {
                found.push(place);
            }
        }
    }
    found
}

/// The prism over `words` in `place`, from below the engraving's bottom to above the shell.
fn tool(place: &Place, words: &Words, config: &StencilConfig) -> Result<Mesh> {
    let radius = config.outer_radius_mm();
    let floor = radius - depth_mm(config);
    let reach = words.half_width.hypot(words.half_height).min(0.9 * floor);
    let bottom = (floor * floor - reach * reach).sqrt() - CLEAR_MM;
    let prism = Solid::extruded(&words.outlines, radius + CLEAR_MM - bottom)?.mesh();
    Ok(prism.mapped(|p| p.x * place.right + p.y * place.up + (bottom + p.z) * place.center))
}
