//! Views of the ball side by side: the observed dots, the true dots and the answer.

use std::f64::consts::FRAC_PI_4;
use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::canvas::{
    Area, Drawn, GRAY, INK, Key, LegendSign, SMALL, color, font, picture, px, stroke, text,
    text_width, titled, with_legend, wrapped,
};
use super::places::LabelPlaces;
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3};
use crate::pattern::Pattern;

/// Width and height of one view in [`recognition_views`]'s picture, pixels.
pub const RECOGNITION_VIEW_SIZE: (u32, u32) = (430, 640);

/// Radius of a drawn ball, file pixels.
const RADIUS: f64 = 175.0;
/// Height of the ball's center beneath title and legend, file pixels.
const CENTER_Y: f64 = 205.0;
/// Height of a line of the caption, file pixels.
const LINE: f64 = 21.0;
/// Series whose colors stand for what was seen, for the truth and for the answer.
const OBSERVED: usize = 6;
const TRUTH: usize = 2;
const ANSWER: usize = 1;

/// One view of a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct RecognitionView {
    /// Its caption, set in several lines.
    pub caption: String,
    /// Minimum z at which a dot was seen.
    pub visibility_limit: f64,
    /// Observed directions, camera frame.
    pub observed: Vec<Vec3>,
    /// The true orientation, pattern to camera.
    pub truth: Rotation,
    /// The orientation that was answered, if any.
    pub answer: Option<Rotation>,
}

/// Draws views of the ball as the camera has them (x right, y up), each with the observed dots and
/// with the pattern's visible dots under the true and under the answered orientation.
///
/// # Errors
/// [`Error::Argument`] for no views; [`Error::Write`] where the file cannot be written.
pub fn recognition_views(
    path: &Path,
    title: &str,
    pattern: &Pattern,
    views: &[RecognitionView],
) -> Result<()> {
    if views.is_empty() {
        return Err(Error::argument("views", "expected at least one"));
    }
    let (width, height) = RECOGNITION_VIEW_SIZE;
    picture(path, (width * views.len() as u32, height), |root| {
        let area = titled(root, title)?;
        let key = |name: &str, sign| Key {
            name: name.into(),
            sign,
        };
        let keys = [
            key("observed (discs)", LegendSign::Box(OBSERVED)),
            key("true (rings)", LegendSign::Box(TRUTH)),
            key("answered (crosses)", LegendSign::Box(ANSWER)),
        ];
        let area = with_legend(&area, &keys)?;
        for (panel, view) in area.split_evenly((1, views.len())).iter().zip(views) {
            draw_view(panel, pattern, view)?;
        }
        Ok(())
    })
}

fn draw_view(area: &Area<'_>, pattern: &Pattern, view: &RecognitionView) -> Drawn {
    let center = (area.dim_in_pixel().0 as i32 / 2, px(CENTER_Y));
    let place = |d: &Vec3| {
        let at = |c: f64| (c * f64::from(px(RADIUS))).round() as i32;
        (center.0 + at(d.x), center.1 - at(d.y))
    };
    area.draw(&Circle::new(center, px(RADIUS), stroke(GRAY, 1.5)))?;
    let limit = (1.0 - view.visibility_limit.powi(2)).max(0.0).sqrt();
    if view.visibility_limit > 0.0 {
        let rim = stroke(GRAY, 0.6);
        area.draw(&Circle::new(center, px(RADIUS * limit), rim))?;
    }
    for d in &view.observed {
        area.draw(&Circle::new(place(d), px(5.0), color(OBSERVED).filled()))?;
    }
    let limit = view.visibility_limit;
    let seen = |rotation: Rotation| {
        let turned = pattern.dots().iter().map(move |dot| rotation * dot);
        let shown = turned.enumerate();
        shown.filter(move |(_, q)| q.z > limit)
    };
    let truth: Vec<_> = seen(view.truth).map(|(j, q)| (j, place(&q))).collect();
    let answer = view.answer.into_iter().flat_map(seen);
    let answer: Vec<_> = answer.map(|(j, q)| (j, place(&q))).collect();
    let mut places = LabelPlaces::default();
    for d in &view.observed {
        places.keep(place(d), px(5.0));
    }
    for (_, at) in truth.iter().chain(&answer) {
        places.keep(*at, px(9.0));
    }
    for (_, at) in &truth {
        let line = stroke(color(TRUTH), 2.0);
        area.draw(&Circle::new(*at, px(9.0), line))?;
    }
    for (_, (x, y)) in &answer {
        let (line, d) = (stroke(color(ANSWER), 2.0), px(7.0));
        for s in [-1, 1] {
            let ends = vec![(x - d, y - s * d), (x + d, y + s * d)];
            area.draw(&PathElement::new(ends, line))?;
        }
    }
    // Numbers of rings to their upper right, of crosses to their lower left, where that is free.
    for (dots, series, preferred) in [
        (&truth, TRUTH, -FRAC_PI_4),
        (&answer, ANSWER, 3.0 * FRAC_PI_4),
    ] {
        for (j, at) in dots {
            let number = j.to_string();
            let size = (text_width(&number, SMALL), px(0.75 * SMALL));
            if let Some(at) = places.beside(*at, px(9.0), size, preferred) {
                text(area, &number, at, HPos::Center, SMALL, color(series))?;
            }
        }
    }
    draw_caption(area, &view.caption)
}

/// Sets the caption beneath the ball, broken between words.
fn draw_caption(area: &Area<'_>, caption: &str) -> Drawn {
    let available = area.dim_in_pixel().0 as i32 - px(36.0);
    for (k, line) in wrapped(caption, SMALL, available).iter().enumerate() {
        let at = (px(18.0), px(CENTER_Y + RADIUS + 34.0 + LINE * k as f64));
        super::canvas::styled_text(area, line, at, HPos::Left, font(SMALL), INK)?;
    }
    Ok(())
}
