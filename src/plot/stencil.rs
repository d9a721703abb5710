//! The stencil in pictures: both halves as they are printed, open around the ball, and closed.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::canvas::{self, Area, Drawn, INK, LABEL, SMALL, picture, px, styled_text, text, titled};
use super::solid::{Body, Colour, Frame, View, render};
use crate::error::Result;
use crate::geometry::{Rotation, Vec3};
use crate::stencil::{Stencil, shapes};

/// Width and height of [`stencil_views`]'s picture, pixels.
pub const STENCIL_SIZE: (u32, u32) = (1500, 1080);

/// Colours of half A, half B, the ball and its dots.
const HALF_A: [f64; 3] = [236.0, 112.0, 70.0];
const HALF_B: [f64; 3] = [94.0, 158.0, 214.0];
const BALL: [f64; 3] = [252.0, 246.0, 226.0];
const DOT: [f64; 3] = [44.0, 48.0, 58.0];
/// How far the stencil is drawn open, degrees.
const OPEN_DEG: f64 = 100.0;
/// Facets of the drawn ball leave it by this fraction of its radius.
const BALL_CHORD: f64 = 5e-4;
/// Heights of a panel's caption and of its second line, file pixels.
const CAPTION: f64 = 52.0;

/// One panel: caption, note, viewer, bodies, and the dots that are numbered in it (their places).
struct Panel<'a> {
    caption: &'a str,
    note: String,
    view: View,
    bodies: Vec<Body<'a>>,
    labels: Vec<(usize, Vec3)>,
}

/// Draws both halves as printed, the stencil open around the ball, and the closed stencil from the side
/// and from both domes, where the dots seen through their holes are numbered from 0 as in the pattern.
///
/// # Errors
/// [`crate::Error::Write`] where the file cannot be written.
pub fn stencil_views(path: &Path, stencil: &Stencil, title: &str) -> Result<()> {
    let opening = OPEN_DEG.to_radians();
    let halves = [0, 1].map(|i| &stencil.halves()[i].mesh);
    let closed = [0, 1].map(|i| stencil.placed_half(i, 0.0));
    let open = stencil.placed_half(1, opening);
    let radius = 0.5 * stencil.config().ball_diameter_mm;
    let ball = shapes::sphere(radius, BALL_CHORD * radius);
    // The ball stays in half B.
    let hinge = Vec3::new(stencil.joint().axis_mm, 0.0, 0.0);
    let turn = Rotation::from_axis_angle(&Vec3::y_axis(), -opening);
    let moved_ball = ball.mapped(|v| turn * (v - hinge) + hinge);
    let least = (0.5 * stencil.config().hole_diameter_mm / radius)
        .asin()
        .cos();
    let ball_colour = |p: &Vec3| {
        let dark = stencil.dots().iter().any(|d| d.dot(p) >= least * radius);
        if dark { DOT } else { BALL }
    };
    let moved_colour = |p: &Vec3| ball_colour(&(turn.inverse() * (p - hinge) + hinge));
    let (a, b) = (|_: &Vec3| HALF_A, |_: &Vec3| HALF_B);
    let (a, b): (&Colour<'_>, &Colour<'_>) = (&a, &b);
    let body = |mesh, colour| Body { mesh, colour };
    let whole = || {
        vec![
            body(&closed[0], a),
            body(&closed[1], b),
            Body {
                mesh: &ball,
                colour: &ball_colour,
            },
        ]
    };
    let size = |i: usize| {
        let bounds = stencil.halves()[i].mesh.bounding_box();
        let extent = |k: usize| bounds.max_mm[k] - bounds.min_mm[k];
        format!("{:.1} x {:.1} x {:.1} mm", extent(0), extent(1), extent(2))
    };
    let holes = |up: f64| -> Vec<(usize, Vec3)> {
        let dots = stencil.dots().iter().enumerate();
        dots.filter(|(_, d)| d.z * up > 0.35)
            .map(|(i, d)| (i, stencil.config().outer_radius_mm() * d))
            .collect()
    };
    let count = |up: f64| {
        let n = stencil.dots().iter().filter(|d| d.z * up > 0.0).count();
        format!("{n} dots")
    };
    let panels = [
        Panel {
            caption: "Half A, as printed",
            note: size(0),
            view: View::from(-125.0, 35.0),
            bodies: vec![body(halves[0], a)],
            labels: Vec::new(),
        },
        Panel {
            caption: "Half B, as printed",
            note: size(1),
            view: View::from(-40.0, 35.0),
            bodies: vec![body(halves[1], b)],
            labels: Vec::new(),
        },
        Panel {
            caption: "Open",
            note: format!("by {OPEN_DEG:.0} degrees, the ball in half B"),
            view: View::from(-125.0, 12.0),
            bodies: vec![
                body(&closed[0], a),
                body(&open, b),
                Body {
                    mesh: &moved_ball,
                    colour: &moved_colour,
                },
            ],
            labels: Vec::new(),
        },
        Panel {
            caption: "Closed, from the side",
            note: format!("ball of {} mm", stencil.config().ball_diameter_mm),
            view: View::from(-75.0, 8.0),
            bodies: whole(),
            labels: Vec::new(),
        },
        Panel {
            caption: "Closed, onto half A",
            note: count(1.0),
            view: View::from(-90.0, 90.0),
            bodies: whole(),
            labels: holes(1.0),
        },
        Panel {
            caption: "Closed, onto half B",
            note: count(-1.0),
            view: View::from(-90.0, -90.0),
            bodies: whole(),
            labels: holes(-1.0),
        },
    ];
    picture(path, STENCIL_SIZE, |root| {
        let area = titled(root, title)?;
        for (cell, panel) in area.split_evenly((2, 3)).iter().zip(&panels) {
            draw_panel(cell, panel)?;
        }
        Ok(())
    })
}

/// Draws one panel.
fn draw_panel(area: &Area<'_>, panel: &Panel<'_>) -> Drawn {
    let (width, height) = area.dim_in_pixel();
    let (width, height) = (f64::from(width), f64::from(height));
    let room = (0.9 * width, height - f64::from(px(CAPTION + 16.0)));
    let centre = ((0.5 * width) as i32, (0.5 * room.1) as i32 + px(8.0));
    let frame = Frame::fitted(panel.view, &panel.bodies, room, centre);
    render(area, &frame, &panel.bodies)?;
    for (number, place) in &panel.labels {
        let (x, y, _) = frame.place(place);
        let at = (x.round() as i32, y.round() as i32);
        styled_text(
            area,
            &number.to_string(),
            at,
            HPos::Center,
            canvas::bold(SMALL),
            WHITE,
        )?;
    }
    let middle = centre.0;
    let y = height as i32 - px(CAPTION - 14.0);
    text(area, panel.caption, (middle, y), HPos::Center, LABEL, INK)?;
    text(
        area,
        &panel.note,
        (middle, y + px(22.0)),
        HPos::Center,
        SMALL,
        canvas::GREY,
    )
}
