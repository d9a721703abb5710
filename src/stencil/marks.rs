//! What is engraved: the dots' numbers beside their holes, the half's name with the ball's diameter, the
//! pattern's id, and arrows to zones without a window.
//!
//! Numbers are outlines of a real font, upright when the dome is up, engraved to the same depth
//! below the sphere everywhere. A number keeps clear of holes, rims, hinge, tab and other numbers,
//! and lies nearer to its own hole than to any other: at most three quarters as far, where there is
//! such a place. Where there is none it is set smaller, then nearer to another, with a line that leads to
//! its hole; a dot around which nothing fits stays without. Labels take what space is left.

use crate::error::Result;
use crate::geometry::{Vec3, angle_between, spiral_directions, tangent_frame};

use super::glyphs::Words;
use super::joint::Joint;
use super::mesh::Mesh;
use super::solid::Solid;
use super::{StencilConfig, shapes};

/// Height of a number as a fraction of the ball's diameter, and its bounds, mm.
const HEIGHT: (f64, f64, f64) = (0.08, 2.8, 8.0);
/// Sizes that are tried, as parts of that height, with how far a number may be from its own hole,
/// as a part of its distance from any other.
const TRIES: [(f64, f64); 4] = [(1.0, CLEARLY), (0.8, CLEARLY), (1.0, 0.95), (0.8, 0.95)];
/// A number this much nearer to its own hole than to any other needs no line to it.
const CLEARLY: f64 = 0.75;
/// Width of a leader line, mm, and the gap beyond which one is drawn.
const LEADER_MM: f64 = 0.5;
const LEADER_GAP_MM: f64 = 1.0;
/// Sizes of labels that are tried, as parts of a number's full height, and their bound, mm.
const LABEL_SIZES: [f64; 3] = [1.0, 0.9, 0.8];
const MIN_LABEL_MM: f64 = 2.4;
/// Half of the longest label as a part of the dome's radius: longer ones leave the sphere at their ends.
const MAX_HALF_WIDTH: f64 = 0.7;
/// Directions tried for a label, over the whole sphere.
const LABEL_PLACES: usize = 1200;
/// Height of an arrow as a part of a number's full height.
const ARROW: f64 = 1.6;
/// Characters of the pattern's SHA-256 that its label shows.
pub(super) const ID_DIGITS: usize = 6;
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

/// A label on a half.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Label {
    /// What it says.
    pub text: String,
    /// Direction of its middle from the ball's center, in the half's own frame (dome up).
    pub direction: Vec3,
    /// Height of its capitals, mm.
    pub height_mm: f64,
}

/// A place on the dome for a number: a rectangle touching the sphere in its middle.
#[derive(Clone, Copy)]
struct NumberPlace {
    center: Vec3,
    right: Vec3,
    up: Vec3,
    half_width: f64,
    half_height: f64,
}

impl NumberPlace {
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

    /// A rectangle about `center` whose upper side points to the direction `target`.
    fn towards(center: Vec3, target: &Vec3, words: &Words) -> Option<Self> {
        let up = (target - target.dot(&center) * center).try_normalize(1e-6)?;
        Some(Self {
            right: up.cross(&center),
            center,
            up,
            half_width: words.half_width,
            half_height: words.half_height,
        })
    }

    /// Whether it keeps clear of rims, holes and obstacles.
    fn is_clear(
        &self,
        around: &NumberSurroundings<'_>,
        config: &StencilConfig,
        joint: &Joint,
    ) -> bool {
        self.is_clear_but(None, around, config, joint)
    }

    /// As [`NumberPlace::is_clear`], but for one hole.
    fn is_clear_but(
        &self,
        own: Option<&Vec3>,
        around: &NumberSurroundings<'_>,
        config: &StencilConfig,
        joint: &Joint,
    ) -> bool {
        let radius = config.outer_radius_mm();
        let hole = config.opening_radius_mm();
        let lowest = joint.lip_mm + joint.ledge_gap_mm + CLEAR_MM;
        self.outline(radius).all(|c| c.z > lowest)
            && around
                .holes
                .iter()
                .filter(|h| Some(*h) != own)
                .all(|h| self.distance(&(radius * h)) > hole + CLEAR_MM)
            && around.obstacles.iter().all(|p| self.distance(p) > CLEAR_MM)
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

    /// Whether two rectangles are so many mm apart.
    fn is_apart(&self, other: &Self, gap: f64, radius: f64) -> bool {
        let apart = |a: &Self, b: &Self| {
            let mut points = b.outline(radius);
            points.all(|p| a.distance(&p) > gap)
        };
        apart(self, other) && apart(other, self)
    }
}

/// What is engraved in one half, in its own frame (dome up).
#[derive(Default)]
pub(super) struct Marks {
    /// What cuts them.
    pub tools: Vec<Mesh>,
    /// Where they are.
    pub numbers: Vec<DotNumber>,
    /// Dots for whose number there was no place.
    pub left_out: Vec<usize>,
    /// Labels that found a place.
    pub labels: Vec<Label>,
    /// Rectangles that are taken.
    taken: Vec<NumberPlace>,
    /// Lines from numbers to their holes.
    lines: Vec<NumberPlace>,
}

/// What numbers keep clear of.
pub(super) struct NumberSurroundings<'a> {
    /// Directions of all holes that cut the half.
    pub holes: &'a [Vec3],
    /// Points on hinge and tab.
    pub obstacles: &'a [Vec3],
}

/// Where a number goes: its height, mm, its place and the line that leads to its hole, if it needs one.
type PlacedNumber = (f64, NumberPlace, Option<(NumberPlace, Words)>);

impl Marks {
    /// The first free one of these places (height, how clearly it is the hole's, place). A number that needs a line stands where one can lead
    /// to its hole, if there is such a place.
    fn chosen(
        &self,
        found: &[(f64, f64, NumberPlace)],
        hole: &Vec3,
        around: &NumberSurroundings<'_>,
        config: &StencilConfig,
        joint: &Joint,
    ) -> Option<PlacedNumber> {
        let radius = config.outer_radius_mm();
        let free = found.iter().filter(|(_, _, p)| self.is_free(p, radius));
        let leads = |nearer: f64, place: &NumberPlace| {
            let line = (nearer > CLEARLY)
                .then(|| leader(place, hole, config))
                .flatten();
            let is_possible = line.as_ref().is_none_or(|(line, _)| {
                line.is_clear_but(Some(hole), around, config, joint) && self.can_lead(line, radius)
            });
            is_possible.then_some(line)
        };
        let mut led = free
            .clone()
            .filter_map(|(height, nearer, place)| Some((*height, *place, leads(*nearer, place)?)));
        let other = || {
            let mut unled = free.map(|(height, _, place)| (*height, *place, None));
            unled.next()
        };
        led.next().or_else(other)
    }

    fn engrave(&mut self, dot: usize, number: PlacedNumber, config: &StencilConfig) -> Result<()> {
        let (height_mm, place, line) = number;
        let words = Words::number(dot, height_mm)?;
        self.tools.push(tool(&place, &words, config)?);
        self.numbers.push(DotNumber {
            dot,
            direction: place.center,
            height_mm,
        });
        self.taken.push(place);
        if let Some((line, bar)) = line {
            self.tools.push(tool(&line, &bar, config)?);
            self.lines.push(line);
        }
        Ok(())
    }
}

/// Engraves the numbers `numbered` (index and direction, the half's own frame).
///
/// # Errors
/// [`crate::Error::Internal`] where the font or the boolean engine fails.
pub(super) fn numbers(
    numbered: &[(usize, Vec3)],
    around: &NumberSurroundings<'_>,
    config: &StencilConfig,
    joint: &Joint,
) -> Result<Marks> {
    let full = full_height(config);
    let mut marks = Marks::default();
    // Dots with the fewest places choose first.
    let mut waiting = Vec::new();
    for (dot, direction) in numbered {
        let mut found = Vec::new();
        for (size, nearer) in TRIES {
            let height = size * full;
            let words = Words::number(*dot, height)?;
            let places = places(direction, &words, nearer, around, config, joint);
            found.extend(places.into_iter().map(|place| (height, nearer, place)));
        }
        waiting.push((*dot, direction, found));
    }
    waiting.sort_by_key(|(_, _, found)| found.len());
    for (dot, hole, found) in waiting {
        match marks.chosen(&found, hole, around, config, joint) {
            Some(number) => marks.engrave(dot, number, config)?,
            None => marks.left_out.push(dot),
        }
    }
    marks.numbers.sort_by_key(|number| number.dot);
    marks.left_out.sort_unstable();
    Ok(marks)
}

/// The line from a number to its hole, where the gap between them asks for one.
fn leader(
    number: &NumberPlace,
    hole: &Vec3,
    config: &StencilConfig,
) -> Option<(NumberPlace, Words)> {
    let radius = config.outer_radius_mm();
    let towards = (hole - hole.dot(&number.center) * number.center).try_normalize(1e-6)?;
    let extent = number.half_width * towards.dot(&number.right).abs()
        + number.half_height * towards.dot(&number.up).abs();
    let from = (extent + 0.5 * CLEAR_MM) / radius;
    let to = angle_between(&number.center, hole)
        - (config.opening_radius_mm() + 0.5 * CLEAR_MM) / radius;
    let length = (to - from) * radius;
    if length < LEADER_GAP_MM {
        return None;
    }
    let angle = 0.5 * (from + to);
    let middle = angle.cos() * number.center + angle.sin() * towards;
    let bar = Words::bar(LEADER_MM, length);
    Some((NumberPlace::towards(middle, hole, &bar)?, bar))
}

impl Marks {
    /// Whether a rectangle keeps clear of all numbers, labels and lines.
    fn is_free(&self, place: &NumberPlace, radius: f64) -> bool {
        let apart = |gap: f64| move |t: &NumberPlace| t.is_apart(place, gap, radius);
        self.taken.iter().all(apart(NUMBERS_APART_MM)) && self.lines.iter().all(apart(CLEAR_MM))
    }

    /// Whether a line keeps clear of the numbers and lines that are there.
    fn can_lead(&self, line: &NumberPlace, radius: f64) -> bool {
        let others = self.taken.iter().chain(&self.lines);
        others
            .into_iter()
            .all(|t| t.is_apart(line, CLEAR_MM, radius))
    }

    /// Engraves each of `texts` where there is space, as high on the dome as possible.
    ///
    /// # Errors
    /// As [`numbers`].
    pub fn add_labels(
        &mut self,
        texts: &[String],
        around: &NumberSurroundings<'_>,
        config: &StencilConfig,
        joint: &Joint,
    ) -> Result<()> {
        let radius = config.outer_radius_mm();
        let mut directions: Vec<Vec3> = spiral_directions(LABEL_PLACES)
            .filter(|d| d.z > 0.0)
            .collect();
        directions.sort_by(|a, b| b.z.total_cmp(&a.z));
        for text in texts {
            for size in LABEL_SIZES {
                let height_mm = (size * full_height(config)).max(MIN_LABEL_MM);
                let words = Words::new(text, height_mm)?;
                if words.half_width > MAX_HALF_WIDTH * radius {
                    continue;
                }
                let mut places = directions.iter().map(|d| NumberPlace::new(*d, &words));
                let Some(place) =
                    places.find(|p| p.is_clear(around, config, joint) && self.is_free(p, radius))
                else {
                    continue;
                };
                self.tools.push(tool(&place, &words, config)?);
                self.labels.push(Label {
                    text: text.clone(),
                    direction: place.center,
                    height_mm,
                });
                self.taken.push(place);
                break;
            }
        }
        Ok(())
    }

    /// Engraves an arrow that points to `zone` (the half's own frame) from as near as possible; without
    /// space for one there is none.
    ///
    /// # Errors
    /// As [`numbers`].
    pub fn add_arrow(
        &mut self,
        zone: &Vec3,
        around: &NumberSurroundings<'_>,
        config: &StencilConfig,
        joint: &Joint,
    ) -> Result<()> {
        let radius = config.outer_radius_mm();
        let words = Words::arrow(ARROW * full_height(config));
        let mut directions: Vec<Vec3> = spiral_directions(LABEL_PLACES)
            .filter(|d| d.z > 0.0)
            .collect();
        directions.sort_by(|a, b| b.dot(zone).total_cmp(&a.dot(zone)));
        let mut places = directions
            .iter()
            .filter_map(|d| NumberPlace::towards(*d, zone, &words));
        if let Some(place) =
            places.find(|p| p.is_clear(around, config, joint) && self.is_free(p, radius))
        {
            self.tools.push(tool(&place, &words, config)?);
            self.taken.push(place);
        }
        Ok(())
    }
}

/// Height of a number where it has space, mm.
fn full_height(config: &StencilConfig) -> f64 {
    (HEIGHT.0 * config.ball_diameter_mm).clamp(HEIGHT.1, HEIGHT.2)
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
    tool(&NumberPlace::new(*center, &words), &words, config)
}

/// What the engraving leaves: the sphere of its bottom.
pub(super) fn floor(config: &StencilConfig) -> Mesh {
    shapes::sphere(config.engraving_radius_mm(), config.chord_error_mm)
}

/// Places around the hole of `dot` that keep clear of everything but other numbers, nearest first,
/// sideways ones before others.
fn places(
    dot: &Vec3,
    words: &Words,
    nearer: f64,
    around: &NumberSurroundings<'_>,
    config: &StencilConfig,
    joint: &Joint,
) -> Vec<NumberPlace> {
    let radius = config.outer_radius_mm();
    let hole = config.opening_radius_mm();
    let here = NumberPlace::new(*dot, words);
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
            let place = NumberPlace::new(angle.cos() * dot + angle.sin() * towards, words);
            let own = (place.center - dot).norm();
            let clear = place.is_clear(around, config, joint)
                && around
                    .holes
                    .iter()
                    .all(|h| h == dot || own < nearer * (place.center - h).norm());
            if clear {
                found.push(place);
            }
        }
    }
    found
}

/// The prism over `words` in `place`, from below the engraving's bottom to above the shell.
fn tool(place: &NumberPlace, words: &Words, config: &StencilConfig) -> Result<Mesh> {
    let radius = config.outer_radius_mm();
    let floor = config.engraving_radius_mm();
    let reach = words.half_width.hypot(words.half_height).min(0.9 * floor);
    let bottom = (floor * floor - reach * reach).sqrt() - CLEAR_MM;
    let prism = Solid::extruded(&words.outlines, radius + CLEAR_MM - bottom)?.mesh();
    Ok(prism.mapped(|p| p.x * place.right + p.y * place.up + (bottom + p.z) * place.center))
}
