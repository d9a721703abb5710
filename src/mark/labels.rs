//! Places for numbers on a sheet, beside what is drawn there.

use super::drawing::{Anchor, Item, Layer, Point, Shape, text_width};

/// Space between a label and anything else, mm.
const GAP_MM: f64 = 0.5;
/// Directions that are tried around a dot, and the step outwards, mm.
const DIRECTIONS: usize = 24;
const STEP_MM: f64 = 0.7;
/// Steps that are tried.
const STEPS: usize = 60;
/// A label farther from its dot than this has a line that leads there, mm.
const LEADER_MM: f64 = 1.5;

/// An upright rectangle, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rectangle {
    pub center: Point,
    /// Half its width and height.
    pub half: [f64; 2],
}

impl Rectangle {
    /// Distance of a point from it, mm; 0 within.
    pub fn distance(&self, p: &Point) -> f64 {
        let x = ((p.x - self.center.x).abs() - self.half[0]).max(0.0);
        let y = ((p.y - self.center.y).abs() - self.half[1]).max(0.0);
        x.hypot(y)
    }

    /// Whether another one is so far away, mm, to either side or above or below.
    pub fn is_apart(&self, other: &Self, gap: f64) -> bool {
        (self.center.x - other.center.x).abs() >= self.half[0] + other.half[0] + gap
            || (self.center.y - other.center.y).abs() >= self.half[1] + other.half[1] + gap
    }

    /// That of words with capitals `height` high.
    pub fn of_words(at: Point, anchor: Anchor, height: f64, words: &str) -> Self {
        let width = text_width(words, height);
        let x = match anchor {
            Anchor::Start => at.x + 0.5 * width,
            Anchor::Middle => at.x,
            Anchor::End => at.x - 0.5 * width,
        };
        Self {
            center: Point::new(x, at.y + 0.5 * height),
            half: [0.5 * width, 0.5 * height],
        }
    }
}

/// A dot on a sheet: its middle, and how far it reaches.
#[derive(Debug, Clone, Copy)]
pub(super) struct LabeledDot {
    pub center: Point,
    pub radius: f64,
}

/// What labels keep clear of, and those that are set.
pub(super) struct Labels {
    pub spots: Vec<LabeledDot>,
    pub taken: Vec<Rectangle>,
}

impl Labels {
    /// The number of a dot beside its spot, to the right where there is space, else as near as there
    /// is, with a line to it where that is far.
    pub fn number(&mut self, dot: usize, spot: &LabeledDot, height: f64) -> Vec<Item> {
        let half = [0.5 * text_width(&dot.to_string(), height), 0.5 * height];
        let found = (0..STEPS).find_map(|step| {
            (0..DIRECTIONS).find_map(|k| {
                // 0, then alternately to either side.
                let turn = if k % 2 == 0 {
                    k / 2
                } else {
                    DIRECTIONS - k.div_ceil(2)
                };
                let angle = std::f64::consts::TAU * turn as f64 / DIRECTIONS as f64;
                let (sin, cos) = angle.sin_cos();
                let away = spot.radius + GAP_MM + STEP_MM * step as f64;
                let reach = half[0] * cos.abs() + half[1] * sin.abs();
                let way = nalgebra::Vector2::new(cos, sin);
                let place = Rectangle {
                    center: spot.center + (away + reach) * way,
                    half,
                };
                let line = [spot.center + spot.radius * way, spot.center + away * way];
                let far = STEP_MM * step as f64 > LEADER_MM;
                let free = self.is_free(&place) && (!far || self.can_lead(&line, spot));
                free.then_some((place, far.then_some(line)))
            })
        });
        // So many steps lead out of any sheet: the first place is as good as none.
        let (place, line) = found.unwrap_or_else(|| {
            let right = spot.radius + GAP_MM + half[0];
            let center = spot.center + nalgebra::Vector2::new(right, 0.0);
            (Rectangle { center, half }, None)
        });
        self.taken.push(place);
        let at = Point::new(place.center.x, place.center.y - half[1]);
        let mut items = Item::number(dot, at, Anchor::Middle, height);
        if let Some(line) = line {
            items.push(Item::of_dot(Layer::Notes, dot, Shape::Line(line.to_vec())));
        }
        items
    }

    fn is_free(&self, place: &Rectangle) -> bool {
        // Below a number there may be a line.
        let apart = |other: &Rectangle| other.is_apart(place, GAP_MM);
        let off = |spot: &LabeledDot| place.distance(&spot.center) >= spot.radius + 0.8 * GAP_MM;
        self.taken.iter().all(apart) && self.spots.iter().all(off)
    }

    /// Whether a line meets no other dot and no number.
    fn can_lead(&self, [from, to]: &[Point; 2], own: &LabeledDot) -> bool {
        (0..=10).all(|k| {
            let p = from + 0.1 * f64::from(k) * (to - from);
            let off = |spot: &LabeledDot| {
                spot.center == own.center || (p - spot.center).norm() >= spot.radius + 0.3
            };
            self.spots.iter().all(off) && self.taken.iter().all(|r| r.distance(&p) >= 0.3)
        })
    }
}
