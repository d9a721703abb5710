//! Plot of a ball's surface as a clip shows it, with its marks and their numbers.
//!
//! Each half is drawn so that equal areas stay equal (Lambert's azimuthal projection): a place `t` radians from the middle lies `sqrt(2) sin(t / 2)` radii
//! from it, and marks at the rim are as large as those in the middle.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::ball::{VIEWS_SIZE, ViewSide};
use super::canvas::{
    self, Area, Drawn, INK, LABEL, SMALL, picture, px, stroke, styled_text, text, titled,
};
use super::places::LabelPlaces;
use crate::calibrate::{MarkKind, MarkedSurface, SurfacePlace};
use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Width and height of [`surface_views`]'s picture, pixels.
pub const SURFACE_SIZE: (u32, u32) = VIEWS_SIZE;

/// Radius of a drawn half, and height of its middle beneath the title, file pixels.
const RADIUS: f64 = 290.0;
const CENTER_Y: f64 = 316.0;
/// The number of drawn pixels on a side that share a color.
const BLOCK: i32 = canvas::SCALE as i32;
/// A ring is drawn at so many radii of its mark, and so many file pixels more.
const RING: [f64; 2] = [1.1, 2.0];
/// Places so far behind the rim, as the cosine of their angle to the viewer, are drawn beyond it.
const BEHIND: f64 = -0.3;
/// A mark is drawn on the half that shows so much of its radius.
const CUT: f64 = 0.5;
/// Size of the marks' numbers, file pixels.
const NUMBER: f64 = 15.0;
/// The bare ball, and what no frame shows, hatched.
const BARE: f32 = 244.0;
const UNSEEN: [RGBColor; 2] = [RGBColor(176, 208, 236), RGBColor(206, 226, 244)];

/// Draws both halves of a ball's surface, dark as the clip shows it, with a ring about every mark that may be a dot and its number, counted from 0.
///
/// # Errors
/// [`Error::Argument`] for a surface without places; [`Error::Write`] where the file cannot be written.
pub fn surface_views(path: &Path, surface: &MarkedSurface) -> Result<()> {
    if surface.places.is_empty() {
        return Err(Error::argument("surface", "expected places, found none"));
    }
    picture(path, SURFACE_SIZE, |root| {
        let area = titled(root, "The ball as the clip shows it")?;
        for (half, side) in area.split_evenly((1, 2)).iter().zip(ViewSide::both()) {
            draw_half(half, &side, &surface.places)?;
            draw_marks(half, &side, surface)?;
            let at = (center(half).0, px(CENTER_Y + RADIUS + 34.0));
            let caption = if side.is_front() {
                "one half"
            } else {
                "the other half"
            };
            text(half, caption, at, HPos::Center, LABEL + 2.0, INK)?;
        }
        let note = "blue: looks like a dot; orange: a dot or print; gray: neither; hatched: shown by no frame";
        let (width, height) = area.dim_in_pixel();
        let at = (width as i32 / 2, height as i32 - px(20.0));
        text(&area, note, at, HPos::Center, SMALL, INK)
    })
}

fn center(area: &Area<'_>) -> (i32, i32) {
    (area.dim_in_pixel().0 as i32 / 2, px(CENTER_Y))
}

/// Where a direction of a view is drawn, radii from the middle of its half, right and up.
fn flat(at: &Vec3) -> [f64; 2] {
    let scale = 1.0 / (1.0 + at.z).sqrt();
    [scale * at.x, scale * at.y]
}

/// Paints the surface: every point as the place that is drawn nearest to it.
fn draw_half(area: &Area<'_>, side: &ViewSide, places: &[SurfacePlace]) -> Drawn {
    let (cx, cy) = center(area);
    let radius = px(RADIUS);
    let steps = radius / BLOCK;
    let width = 2 * steps + 1;
    let mut nearest: Vec<(f64, Option<&SurfacePlace>)> =
        vec![(f64::INFINITY, None); (width * width) as usize];
    // Both halves together are as large as all places.
    let spacing = f64::from(steps) * (std::f64::consts::TAU / places.len() as f64).sqrt();
    let reach = (1.5 * spacing).ceil() as i32;
    for place in places {
        let at = side.view(&place.direction);
        if at.z < BEHIND {
            continue;
        }
        let [x, y] = flat(&at).map(|c| c * f64::from(steps));
        let (left, top) = (x.round() as i32, -y.round() as i32);
        for j in (top - reach).max(-steps)..=(top + reach).min(steps) {
            for i in (left - reach).max(-steps)..=(left + reach).min(steps) {
                let off = (f64::from(i) - x).powi(2) + (f64::from(j) + y).powi(2);
                let best = &mut nearest[((j + steps) * width + i + steps) as usize];
                if off < best.0 {
                    *best = (off, Some(place));
                }
            }
        }
    }
    for (j, i) in (-steps..=steps).flat_map(|j| (-steps..=steps).map(move |i| (j, i))) {
        if i * i + j * j > steps * steps {
            continue;
        }
        let place = nearest[((j + steps) * width + i + steps) as usize].1;
        let painted = match place.filter(|p| p.is_shown()) {
            Some(place) => {
                let gray = (BARE * (1.0 - place.darkness)).clamp(0.0, 255.0) as u8;
                RGBColor(gray, gray, gray)
            }
            None => UNSEEN[usize::from((i + j).rem_euclid(px(12.0)) < px(6.0))],
        };
        for (dy, dx) in (0..BLOCK).flat_map(|dy| (0..BLOCK).map(move |dx| (dy, dx))) {
            area.draw_pixel((cx + BLOCK * i + dx, cy + BLOCK * j + dy), &painted)?;
        }
    }
    area.draw(&Circle::new((cx, cy), radius, stroke(canvas::GRAY, 1.0)))?;
    Ok(())
}

/// Draws the rings about the marks of a half, and their numbers beside them.
fn draw_marks(area: &Area<'_>, side: &ViewSide, surface: &MarkedSurface) -> Drawn {
    let (cx, cy) = center(area);
    let mut places = LabelPlaces::default();
    let mut shown = Vec::new();
    for (number, mark) in surface.worth_a_look().enumerate() {
        let at = side.view(&mark.direction);
        // What the rim cuts through is drawn on both halves.
        if at.z < -CUT * mark.radius_rad.sin() {
            continue;
        }
        let [x, y] = flat(&at).map(|c| (c * f64::from(px(RADIUS))).round() as i32);
        let middle = (cx + x, cy - y);
        // A small angle is drawn `1 / sqrt(2)` of it long, in radii.
        let long = f64::from(px(RADIUS)) * mark.radius_rad / std::f64::consts::SQRT_2;
        let ring = (RING[0] * long).round() as i32 + px(RING[1]);
        places.keep(middle, ring);
        shown.push((number, mark.kind, middle, ring));
    }
    for (number, kind, middle, ring) in shown {
        let color = match kind {
            MarkKind::Dot => canvas::color(0),
            MarkKind::Doubtful | MarkKind::TurnedAway => canvas::color(1),
            MarkKind::Other => canvas::color(6),
        };
        area.draw(&Circle::new(middle, ring, stroke(color, 1.5)))?;
        let label = number.to_string();
        let size = (canvas::text_width(&label, NUMBER), px(NUMBER * 0.72));
        // Where all is taken, a number over something is better than none.
        let at = places.beside(middle, ring, size, 0.0).unwrap_or(middle);
        styled_text(area, &label, at, HPos::Center, canvas::bold(NUMBER), color)?;
    }
    Ok(())
}
