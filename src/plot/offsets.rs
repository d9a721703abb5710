//! Plot of a calibrated ball: where each dot should be, and where it is.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::ball::{VIEWS_SIZE, ViewSide};
use super::canvas::{
    self, Area, Drawn, INK, LABEL, SMALL, color, picture, px, stroke, text, titled,
};
use crate::error::Result;
use crate::geometry::Vec3;

/// Radius of a drawn ball, file pixels.
const RADIUS: f64 = 255.0;
/// Height of its center beneath the title, file pixels.
const CENTER_Y: f64 = 300.0;
/// Radius of a drawn dot, file pixels.
const DOT: f64 = 11.0;
/// Offsets are drawn this many times longer.
pub const OFFSET_SCALE: f64 = 5.0;

/// What is drawn for a dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OffsetMark {
    /// A dot drawn at this direction.
    Drawn(Vec3),
    /// A dot that is not there.
    Missing,
    /// A dot that was not seen.
    Unseen,
}

/// A dot of the nominal pattern, or a mark beside it.
#[derive(Debug, Clone, PartialEq)]
pub struct OffsetDot {
    /// Its nominal direction.
    pub nominal: Vec3,
    /// What was found.
    pub mark: OffsetMark,
    /// Its number, or the name of a mark.
    pub label: String,
}

/// Draws the ball from both sides: each dot's nominal place as a ring, and from its middle a line along
/// its offset, drawn [`OFFSET_SCALE`] times as long; a cross where a dot is missing, a question mark where
/// it was not seen.
///
/// # Errors
/// [`crate::Error::Write`] where the file cannot be written.
pub fn offset_views(path: &Path, dots: &[OffsetDot], title: &str) -> Result<()> {
    picture(path, VIEWS_SIZE, |root| {
        let area = titled(root, title)?;
        for (half, side) in area.split_evenly((1, 2)).iter().zip(ViewSide::both()) {
            draw_side(half, &side, dots)?;
        }
        let (width, height) = area.dim_in_pixel();
        let at = (width as i32 / 2, height as i32 - px(20.0));
        let ring_deg = (DOT / RADIUS / OFFSET_SCALE).to_degrees();
        let note = format!(
            "ring: nominal place; line: offset, {OFFSET_SCALE} times as long (the ring's radius: \
             {ring_deg:.1} deg); cross: missing; ?: not seen"
        );
        text(&area, &note, at, HPos::Center, SMALL, INK)
    })
}

fn draw_side(area: &Area<'_>, side: &ViewSide, dots: &[OffsetDot]) -> Drawn {
    let (cx, cy) = (area.dim_in_pixel().0 as i32 / 2, px(CENTER_Y));
    let radius = px(RADIUS);
    area.draw(&Circle::new((cx, cy), radius, stroke(canvas::GRAY, 1.0)))?;
    let at = |v: &Vec3| {
        let seen = side.view(v) * f64::from(radius);
        (cx + seen.x.round() as i32, cy - seen.y.round() as i32)
    };
    for dot in dots {
        if side.view(&dot.nominal).z <= 0.0 {
            continue;
        }
        let middle = at(&dot.nominal);
        let ring = px(DOT);
        // The label stands where the offset does not point.
        let mut points_right = false;
        match dot.mark {
            OffsetMark::Drawn(direction) => {
                area.draw(&Circle::new(middle, ring, stroke(INK, 1.2)))?;
                let end = at(&(dot.nominal + (direction - dot.nominal) * OFFSET_SCALE));
                points_right = end.0 > middle.0;
                area.draw(&PathElement::new(vec![middle, end], stroke(color(1), 2.4)))?;
                area.draw(&Circle::new(end, px(3.5), color(1).filled()))?;
            }
            OffsetMark::Missing => {
                let line = stroke(color(1), 2.4);
                for (x, y) in [(ring, ring), (ring, -ring)] {
                    let ends = [(-x, -y), (x, y)].map(|(u, v)| (middle.0 + u, middle.1 + v));
                    area.draw(&PathElement::new(ends.to_vec(), line))?;
                }
            }
            OffsetMark::Unseen => {
                area.draw(&Circle::new(middle, ring, stroke(canvas::GRAY, 1.2)))?;
                text(area, "?", middle, HPos::Center, SMALL, canvas::GRAY)?;
            }
        }
        let (aside, anchor) = match points_right {
            true => (-px(DOT + 4.0), HPos::Right),
            false => (px(DOT + 4.0), HPos::Left),
        };
        let beside = (middle.0 + aside, middle.1 - px(DOT));
        text(area, &dot.label, beside, anchor, SMALL, INK)?;
    }
    let at = (cx, px(CENTER_Y + RADIUS + 40.0));
    text(area, side.caption, at, HPos::Center, LABEL + 2.0, INK)
}
