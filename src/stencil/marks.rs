//! The dots' numbers, engraved beside their holes.
//!
//! Digits are made of straight strokes, one nozzle pass or more wide, upright when the dome is up. A
//! number goes where it keeps clear of holes, rims, hinge, tab and other numbers; a dot around which
//! there is no such place stays without. Strokes of different directions end at different depths, so
//! that no two of their faces coincide. Beneath every stroke half of the wall, and at least the nozzle's
//! width, stays whole.

use crate::geometry::{Vec3, tangent_frame};

use super::joint::Joint;
use super::mesh::Mesh;
use super::{StencilConfig, shapes};

/// Height of a digit as a fraction of the ball's diameter, and its bounds, mm.
const HEIGHT: (f64, f64, f64) = (0.08, 2.8, 8.0);
/// Width of a digit, and of the gap between digits, as fractions of its height.
const WIDTH: f64 = 0.55;
const GAP: f64 = 0.4;
/// Width of a stroke as a fraction of the digit's height.
const STROKE: f64 = 0.2;
/// Depth of the engraving as a fraction of the wall, and its bound, mm.
const DEPTH: (f64, f64) = (0.2, 0.5);
/// The part of the wall that stays whole beneath the deepest stroke.
const UNCUT: f64 = 0.5;
/// A number that cannot be engraved as deep as this is left out, mm.
const MIN_DEPTH_MM: f64 = 0.1;
/// Minimum distance of a number from anything else, mm.
const CLEAR_MM: f64 = 0.5;
/// Distance of a number from holes that are not its own, if possible, mm: about twice that from its own.
const APART_MM: f64 = 1.6;
/// Directions tried around a hole.
const DIRECTIONS: usize = 24;

/// Left and right strokes: none, upper half, lower half, all of the height.
#[derive(Clone, Copy)]
enum Side {
    No,
    Up,
    Low,
    All,
}

/// A digit: left and right strokes; top, middle and bottom strokes.
type Glyph = (Side, Side, [bool; 3]);

const GLYPHS: [Glyph; 10] = [
    (Side::All, Side::All, [true, false, true]),
    (Side::No, Side::All, [false, false, false]),
    (Side::Low, Side::Up, [true, true, true]),
    (Side::No, Side::All, [true, true, true]),
    (Side::Up, Side::All, [false, true, false]),
    (Side::Up, Side::Low, [true, true, true]),
    (Side::All, Side::Low, [true, true, true]),
    (Side::No, Side::All, [true, false, false]),
    (Side::All, Side::All, [true, true, true]),
    (Side::Up, Side::All, [true, true, true]),
];

/// A place on the dome for a number: a rectangle touching the sphere in its middle.
struct Place {
    center: Vec3,
    right: Vec3,
    up: Vec3,
    half_width: f64,
    half_height: f64,
}

impl Place {
    /// A rectangle about the direction `center`, upright when the dome is up.
    fn new(center: Vec3, half_width: f64, half_height: f64) -> Self {
        let up = (Vec3::z() - center.z * center).try_normalize(0.05);
        let up = up.unwrap_or_else(|| tangent_frame(&center)[0]);
        Self {
            right: up.cross(&center),
            center,
            up,
            half_width,
            half_height,
        }
    }

    /// Distance of a point from the rectangle in its plane, mm; infinite on the far side of the ball.
    fn distance(&self, p: &Vec3) -> f64 {
        if p.dot(&self.center) <= 0.0 {
            return f64::INFINITY;
        }
        let x = (p.dot(&self.right).abs() - self.half_width).max(0.0);
        let y = (p.dot(&self.up).abs() - self.half_height).max(0.0);
        x.hypot(y)
    }

    /// Its corners on the tangent plane, mm.
    fn corners(&self, radius: f64) -> [Vec3; 4] {
        [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(a, b)| {
            radius * self.center + a * self.half_width * self.right + b * self.half_height * self.up
        })
    }
}

/// Numbers for the dots of one half, in its own frame (dome up).
pub(super) struct Marks {
    /// Cutting tools.
    pub tools: Vec<Mesh>,
    /// Dots for whose number there was no place.
    pub left_out: Vec<usize>,
}

/// Engraves the numbers `numbered` (index and direction, the half's own frame). `holes` are the directions
/// of all holes that cut the half, `obstacles` points on hinge and tab.
pub(super) fn numbers(
    numbered: &[(usize, Vec3)],
    holes: &[Vec3],
    obstacles: &[Vec3],
    config: &StencilConfig,
    joint: &Joint,
) -> Marks {
    let radius = config.outer_radius_mm();
    let height = (HEIGHT.0 * config.ball_diameter_mm).clamp(HEIGHT.1, HEIGHT.2);
    let stroke = (STROKE * height).max(config.nozzle_mm);
    let lowest = joint.lip_mm + joint.ledge_gap_mm + CLEAR_MM;
    let mut taken: Vec<Place> = Vec::new();
    let mut marks = Marks {
        tools: Vec::new(),
        left_out: Vec::new(),
    };
    for (index, dot) in numbered {
        let digits = digits(*index);
        let (half_width, half_height) = half_extents(digits.len(), height, stroke);
        let Some(ends) = Ends::new(half_width, config) else {
            marks.left_out.push(*index);
            continue;
        };
        let free = |place: &Place, from_others: f64| {
            let corners = place.corners(radius);
            corners.iter().all(|c| c.z > lowest)
                && holes.iter().all(|h| {
                    let clear = if h == dot { CLEAR_MM } else { from_others };
                    place.distance(&(radius * h)) > config.opening_radius_mm() + clear
                })
                && obstacles.iter().all(|p| place.distance(p) > CLEAR_MM)
                && taken.iter().all(|t| {
                    let reach = t.half_width.hypot(t.half_height) + half_width.hypot(half_height);
                    radius * (t.center - place.center).norm() > reach + CLEAR_MM
                })
        };
        // Clearly nearer to its own hole than to another, if there is such a place.
        let found = [APART_MM, CLEAR_MM].into_iter().find_map(|from_others| {
            places(dot, half_width, half_height, config).find(|p| free(p, from_others))
        });
        match found {
            Some(place) => {
                let size = (height, stroke);
                marks.tools.extend(engraving(&place, &digits, size, &ends));
                taken.push(place);
            }
            None => marks.left_out.push(*index),
        }
    }
    marks
}

/// Cutting tools of a number `height` high at the direction `center`; `None` where the wall is too thin.
pub(super) fn digits_at(
    center: &Vec3,
    height: f64,
    number: usize,
    config: &StencilConfig,
) -> Option<Vec<Mesh>> {
    let digits = digits(number);
    let stroke = (STROKE * height).max(config.nozzle_mm);
    let (half_width, half_height) = half_extents(digits.len(), height, stroke);
    let place = Place::new(*center, half_width, half_height);
    let ends = Ends::new(half_width, config)?;
    Some(engraving(&place, &digits, (height, stroke), &ends))
}

/// How deep strokes go: distances from the ball's center along the middle of the number, mm.
struct Ends {
    /// Where the tools begin, outside the shell.
    top_mm: f64,
    /// The shell's surface at the number's ends, which curve away from its middle.
    surface_mm: f64,
    /// Depth below it.
    depth_mm: f64,
}

impl Ends {
    /// For a number of this width; `None` where the wall is too thin for it.
    fn new(half_width: f64, config: &StencilConfig) -> Option<Self> {
        let radius = config.outer_radius_mm();
        let sag = half_width.powi(2) / (2.0 * radius);
        // In the middle the flat bottom lies deeper by the sag.
        let limit = config.wall_mm - (UNCUT * config.wall_mm).max(config.nozzle_mm) - sag;
        let depth_mm = (DEPTH.0 * config.wall_mm).min(DEPTH.1).min(limit);
        (depth_mm >= MIN_DEPTH_MM).then_some(Self {
            top_mm: radius + CLEAR_MM,
            surface_mm: radius - sag,
            depth_mm,
        })
    }
}

/// The decimal digits of a number.
fn digits(number: usize) -> Vec<usize> {
    let text = number.to_string();
    text.bytes().map(|b| usize::from(b - b'0')).collect()
}

/// Half the width and height that `n` digits take.
fn half_extents(n: usize, height: f64, stroke: f64) -> (f64, f64) {
    let n = n as f64;
    let width = height * (n * WIDTH + (n - 1.0) * GAP);
    (0.5 * (width + stroke), 0.5 * (height + stroke))
}

/// Places around the hole of `dot`, sideways ones first.
fn places(
    dot: &Vec3,
    half_width: f64,
    half_height: f64,
    config: &StencilConfig,
) -> impl Iterator<Item = Place> {
    let here = Place::new(*dot, half_width, half_height);
    let radius = config.outer_radius_mm();
    let hole = config.opening_radius_mm();
    (0..DIRECTIONS).map(move |i| {
        // 0, then alternately to either side of the direction to the right.
        let step = if i % 2 == 0 {
            i / 2
        } else {
            DIRECTIONS - i.div_ceil(2)
        };
        let (sin, cos) = (std::f64::consts::TAU * step as f64 / DIRECTIONS as f64).sin_cos();
        let towards = cos * here.right + sin * here.up;
        let extent = half_width * cos.abs() + half_height * sin.abs();
        let angle = (hole + 1.5 * CLEAR_MM + extent) / radius;
        Place::new(
            angle.cos() * dot + angle.sin() * towards,
            half_width,
            half_height,
        )
    })
}

/// The strokes of `digits` in `place` as cutting tools.
fn engraving(
    place: &Place,
    digits: &[usize],
    (height, stroke): (f64, f64),
    ends: &Ends,
) -> Vec<Mesh> {
    let (half, width) = (0.5 * stroke, WIDTH * height);
    let mut tools = Vec::new();
    let mut cut = |x: (f64, f64), y: (f64, f64), depth: f64| {
        let corners = [(x.0, y.0), (x.1, y.0), (x.1, y.1), (x.0, y.1)];
        let middle = (0.5 * (x.0 + x.1), 0.5 * (y.0 + y.1));
        let axes = [&place.right, &place.up];
        let ends = [ends.surface_mm - depth, ends.top_mm];
        tools.push(shapes::prism(&Vec3::zeros(), axes, &corners, middle, ends));
    };
    for (k, &digit) in digits.iter().enumerate() {
        let left = -place.half_width + half + k as f64 * height * (WIDTH + GAP);
        let (first, second, level) = GLYPHS[digit % 10];
        for (side, x) in [(first, left), (second, left + width)] {
            let top = 0.5 * height + half;
            let y = match side {
                Side::No => continue,
                Side::Up => (-half, top),
                Side::Low => (-top, half),
                Side::All => (-top, top),
            };
            cut((x - half, x + half), y, ends.depth_mm);
        }
        // Slightly narrower and shallower than the upright strokes that they run into.
        let (slim, shallow) = (0.9 * half, 0.9 * ends.depth_mm);
        for (on, y) in level.into_iter().zip([0.5 * height, 0.0, -0.5 * height]) {
            if on {
                cut((left, left + width), (y - slim, y + slim), shallow);
            }
        }
    }
    tools
}
