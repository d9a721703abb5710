//! Polygons in the plane: circles on the ball, and clipping.

use std::f64::consts::TAU;

use crate::geometry::{Vec3, tangent_frame};

use super::drawing::Point;

/// Maximum distance of a facet from the curve that it stands for, mm.
pub(super) const CHORD_MM: f64 = 0.005;

/// Number of facets of a circle of `radius_mm`; a multiple of 4.
pub(super) fn facets(radius_mm: f64) -> usize {
    let half = (1.0 - (CHORD_MM / radius_mm).min(0.5)).acos();
    let n = (std::f64::consts::PI / half).ceil() as usize;
    4 * n.div_ceil(4).max(4)
}

/// `n` directions around the circle at the angle `angle_rad` from `center`, counter-clockwise seen
/// from outside.
pub(super) fn circle_on_ball(
    center: &Vec3,
    angle_rad: f64,
    n: usize,
) -> impl Iterator<Item = Vec3> {
    let [u, v] = tangent_frame(center);
    let (sin, cos) = angle_rad.sin_cos();
    let center = *center;
    (0..n).map(move |i| {
        let (s, c) = (TAU * i as f64 / n as f64).sin_cos();
        cos * center + sin * (c * u + s * v)
    })
}

/// A circle in the plane.
pub(super) fn circle(center: Point, radius: f64) -> Vec<Point> {
    let n = facets(radius);
    (0..n)
        .map(|i| {
            let (s, c) = (TAU * i as f64 / n as f64).sin_cos();
            Point::new(center.x + radius * c, center.y + radius * s)
        })
        .collect()
}

/// Twice the signed area of the triangle `a`, `b`, `c`: positive where it turns counter-clockwise.
fn turn(a: &Point, b: &Point, c: &Point) -> f64 {
    (b - a).perp(&(c - a))
}

/// The part of `polygon` inside the convex polygon `window`, which turns counter-clockwise (I.
/// Sutherland, G. Hodgman, "Reentrant polygon clipping", 1974). Empty where they do not meet.
pub(super) fn clipped(polygon: &[Point], window: &[Point]) -> Vec<Point> {
    let mut kept = polygon.to_vec();
    for (i, a) in window.iter().enumerate() {
        let b = &window[(i + 1) % window.len()];
        let input = std::mem::take(&mut kept);
        for (k, p) in input.iter().enumerate() {
            let q = &input[(k + 1) % input.len()];
            let (tp, tq) = (turn(a, b, p), turn(a, b, q));
            if tp >= 0.0 {
                kept.push(*p);
            }
            if (tp > 0.0 && tq < 0.0) || (tp < 0.0 && tq > 0.0) {
                kept.push(p + (q - p) * (tp / (tp - tq)));
            }
        }
    }
    kept
}

/// The part of the closed line `outline` inside a convex window, as open lines.
pub(super) fn lines_inside(outline: &[Point], window: &[Point]) -> Vec<Vec<Point>> {
    let inside = |p: &Point| {
        let n = window.len();
        (0..n).all(|i| turn(&window[i], &window[(i + 1) % n], p) >= 0.0)
    };
    let n = outline.len();
    let states: Vec<bool> = outline.iter().map(inside).collect();
    let Some(outside) = states.iter().position(|s| !s) else {
        // All of it: a closed line.
        return vec![outline.iter().chain(outline.first()).copied().collect()];
    };
    let mut lines: Vec<Vec<Point>> = Vec::new();
    let mut open = false;
    for k in 1..=n {
        let i = (outside + k) % n;
        if states[i] {
            if !open {
                lines.push(Vec::new());
            }
            if let Some(line) = lines.last_mut() {
                line.push(outline[i]);
            }
        }
        open = states[i];
    }
    lines.retain(|line| line.len() > 1);
    lines
}

/// The convex polygon `outline` (counter-clockwise) grown by `by` on all sides, corners rounded.
pub(super) fn grown(outline: &[Point], by: f64) -> Vec<Point> {
    if by <= 0.0 {
        return outline.to_vec();
    }
    let n = outline.len();
    let normal = |i: usize| {
        let edge = outline[(i + 1) % n] - outline[i % n];
        nalgebra::Vector2::new(edge.y, -edge.x).normalize()
    };
    let mut grown = Vec::new();
    for (i, corner) in outline.iter().enumerate() {
        let (before, after) = (normal(i + n - 1), normal(i));
        let sweep = before.perp(&after).atan2(before.dot(&after));
        let steps = (sweep.abs() / 0.2).ceil().max(1.0) as usize;
        for s in 0..=steps {
            let turn = nalgebra::Rotation2::new(sweep * s as f64 / steps as f64);
            grown.push(corner + by * (turn * before));
        }
    }
    grown
}
