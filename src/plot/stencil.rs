//! Pictures of the stencil: both halves as printed, open around the ball, and closed.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::canvas::{self, Area, Drawn, INK, LABEL, SMALL, picture, px, styled_text, text, titled};
use super::solid::{Body, Rgb, SolidFrame, SolidPaint, Viewpoint, render};
use crate::error::Result;
use crate::geometry::{Rotation, Vec3};
use crate::stencil::{HalfName, Mesh, Stencil, shapes};

/// Width and height of [`stencil_views`]'s picture, pixels.
pub const STENCIL_SIZE: (u32, u32) = (1500, 1080);

/// Colors of half A, half B, the ball and its dots.
const HALF_A: Rgb = [236.0, 112.0, 70.0];
const HALF_B: Rgb = [94.0, 158.0, 214.0];
const BALL: Rgb = [252.0, 246.0, 226.0];
const DOT: Rgb = [44.0, 48.0, 58.0];
const ZONE: Rgb = [150.0, 205.0, 182.0];
/// Lengths of a scale bar, mm: the largest below a third of a panel is drawn.
const BARS_MM: [f64; 6] = [5.0, 10.0, 20.0, 50.0, 100.0, 200.0];
/// How far the stencil is drawn open, degrees.
const OPEN_DEG: f64 = 100.0;
/// Facets of the drawn ball leave it by this fraction of its radius.
const BALL_CHORD: f64 = 5e-4;
/// Sine of the latitude above which a dot is numbered: lower ones are seen too much from the side.
const LABELED: f64 = 0.35;
/// Heights of a panel's caption and of its second line, file pixels.
const CAPTION: f64 = 52.0;

/// One panel: caption, note, viewer, bodies, and the dots that are numbered in it (their places).
struct Panel<'a> {
    caption: &'a str,
    note: String,
    view: Viewpoint,
    bodies: Vec<Body<'a>>,
    labels: Vec<(usize, Vec3)>,
}

/// All that is drawn.
struct StencilScene<'a> {
    stencil: &'a Stencil,
    /// Half A, half B, and half B opened.
    placed: [Mesh; 3],
    /// The ball in the closed stencil, and in half B opened.
    balls: [(Mesh, SolidPaint); 2],
    /// Paints of half A and half B as placed, of half B opened, and of both as printed.
    paints: [SolidPaint; 5],
}

impl<'a> StencilScene<'a> {
    fn new(stencil: &'a Stencil) -> Self {
        let opening = OPEN_DEG.to_radians();
        let radius = 0.5 * stencil.config().ball_diameter_mm;
        let ball = shapes::sphere(radius, BALL_CHORD * radius);
        let hinge = Vec3::new(stencil.joint().axis_mm, 0.0, 0.0);
        let turn = Rotation::from_axis_angle(&Vec3::y_axis(), -opening);
        let edge = (0.5 * stencil.config().hole_diameter_mm / radius).asin();
        let paint = |turn: Rotation, center: Vec3| SolidPaint::Ball {
            colors: [BALL, DOT, ZONE],
            zones: stencil
                .zones()
                .iter()
                .map(|z| (turn * z.axis, z.half_angle_rad.cos()))
                .collect(),
            center,
            dots: stencil.dots().iter().map(|d| turn * d).collect(),
            edge_cos: edge.cos(),
        };
        let config = stencil.config();
        let shell = |color: Rgb, center: Vec3| SolidPaint::Shell {
            color,
            center,
            radii: [
                config.inner_radius_mm(),
                config.outer_radius_mm(),
                stencil.engraving_radius_mm(),
            ],
            chord: config.chord_error_mm,
        };
        let up = Vec3::new(0.0, 0.0, stencil.joint().lip_mm);
        let moved = ball.mapped(|v| turn * (v - hinge) + hinge);
        let center = hinge - turn * hinge;
        Self {
            stencil,
            placed: [
                stencil.placed_half(HalfName::A, 0.0),
                stencil.placed_half(HalfName::B, 0.0),
                stencil.placed_half(HalfName::B, opening),
            ],
            balls: [
                (ball, paint(Rotation::identity(), Vec3::zeros())),
                (moved, paint(turn, center)),
            ],
            paints: [
                shell(HALF_A, Vec3::zeros()),
                shell(HALF_B, Vec3::zeros()),
                shell(HALF_B, center),
                shell(HALF_A, up),
                shell(HALF_B, up),
            ],
        }
    }

    /// A half as it is printed.
    fn printed(&'a self, i: usize, caption: &'a str, view: Viewpoint) -> Panel<'a> {
        let mesh = &self.stencil.halves()[i].mesh;
        let bounds = mesh.bounding_box();
        let extent = |k: usize| bounds.max_mm[k] - bounds.min_mm[k];
        Panel {
            caption,
            note: format!("{:.1} x {:.1} x {:.1} mm", extent(0), extent(1), extent(2)),
            view,
            bodies: vec![Body {
                mesh,
                paint: &self.paints[3 + i],
            }],
            labels: Vec::new(),
        }
    }

    /// The stencil around the ball, closed or (`open`) opened.
    fn around(&'a self, open: bool, caption: &'a str, note: String, view: Viewpoint) -> Panel<'a> {
        let second = 1 + usize::from(open);
        let (ball, paint) = &self.balls[usize::from(open)];
        let body = |mesh, paint| Body { mesh, paint };
        Panel {
            caption,
            note,
            view,
            bodies: vec![
                body(&self.placed[0], &self.paints[0]),
                body(&self.placed[second], &self.paints[second]),
                body(ball, paint),
            ],
            labels: Vec::new(),
        }
    }

    /// The closed stencil seen onto a dome (`up` is 1 for half A, -1 for half B), its dots
    /// numbered.
    fn onto(&'a self, up: f64, caption: &'a str) -> Panel<'a> {
        let dots = || self.stencil.dots().iter().enumerate();
        let count = dots().filter(|(_, d)| d.z * up > 0.0).count();
        let outer = self.stencil.config().outer_radius_mm();
        let labels = dots().filter(|(_, d)| d.z * up > LABELED);
        let view = Viewpoint::from(-90.0, 90.0 * up);
        Panel {
            labels: labels.map(|(i, d)| (i, outer * d)).collect(),
            ..self.around(false, caption, format!("{count} dots"), view)
        }
    }
}

/// Draws both halves as printed, the stencil open around the ball, and the closed stencil from the
/// side and from both domes, where the dots seen through their holes are numbered from 0 as in the
/// pattern.
///
/// # Errors
/// [`crate::Error::Write`] where the file cannot be written.
pub fn stencil_views(path: &Path, stencil: &Stencil, title: &str) -> Result<()> {
    let scene = StencilScene::new(stencil);
    let opened = format!("by {OPEN_DEG:.0} degrees, the ball in half B");
    let ball = format!("ball of {} mm", stencil.config().ball_diameter_mm);
    let panels = [
        scene.printed(0, "Half A, as printed", Viewpoint::from(-125.0, 35.0)),
        scene.printed(1, "Half B, as printed", Viewpoint::from(-40.0, 35.0)),
        scene.around(true, "Open", opened, Viewpoint::from(-125.0, 12.0)),
        scene.around(
            false,
            "Closed, from the side",
            ball,
            Viewpoint::from(-75.0, 8.0),
        ),
        scene.onto(1.0, "Closed, onto half A"),
        scene.onto(-1.0, "Closed, onto half B"),
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
    let available = (0.9 * width, height - f64::from(px(CAPTION + 16.0)));
    let center = ((0.5 * width) as i32, (0.5 * available.1) as i32 + px(8.0));
    let frame = SolidFrame::fitted(panel.view, &panel.bodies, available, center);
    render(area, &frame, &panel.bodies)?;
    draw_scale(area, &frame, (width, height))?;
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
    let middle = center.0;
    let y = height as i32 - px(CAPTION - 14.0);
    text(area, panel.caption, (middle, y), HPos::Center, LABEL, INK)?;
    text(
        area,
        &panel.note,
        (middle, y + px(22.0)),
        HPos::Center,
        SMALL,
        canvas::GRAY,
    )
}

/// A bar of round length, and the directions of the axes, in the panel's lower corners.
fn draw_scale(area: &Area<'_>, frame: &SolidFrame, (width, height): (f64, f64)) -> Drawn {
    let longest = 0.22 * width / frame.scale;
    let fits = BARS_MM.iter().rev().find(|mm| **mm <= longest);
    let mm = *fits.unwrap_or(&BARS_MM[0]);
    let length = (mm * frame.scale).round() as i32;
    let (left, y) = (px(14.0), height as i32 - px(14.0));
    let line = canvas::stroke(INK, 1.6);
    let tick = px(4.0);
    for ends in [
        [(left, y), (left + length, y)],
        [(left, y - tick), (left, y + tick)],
        [(left + length, y - tick), (left + length, y + tick)],
    ] {
        area.draw(&PathElement::new(ends.to_vec(), line))?;
    }
    let above = (left + length / 2, y - px(12.0));
    text(area, &format!("{mm} mm"), above, HPos::Center, SMALL, INK)?;
    let corner = (width - f64::from(px(44.0)), height - f64::from(px(46.0)));
    for (axis, name) in [Vec3::x(), Vec3::y(), Vec3::z()]
        .iter()
        .zip(["x", "y", "z"])
    {
        let d = frame.view.apply(axis);
        let at = |r: f64| {
            let r = f64::from(px(r));
            ((corner.0 + r * d.x) as i32, (corner.1 - r * d.y) as i32)
        };
        // An axis along the view is a point.
        if d.x.hypot(d.y) < 0.2 {
            continue;
        }
        area.draw(&PathElement::new(vec![at(0.0), at(20.0)], line))?;
        text(area, name, at(30.0), HPos::Center, SMALL, canvas::GRAY)?;
    }
    Ok(())
}
