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

/// The part of `polygon` between two heights; where the polygon is not convex, parts of it may hang
/// together along these.
pub(super) fn band(polygon: &[Point], [low, high]: [f64; 2]) -> Vec<Point> {
    let above = half(polygon, |p| p.y - low);
    half(&above, |p| high - p.y)
}

/// The part of `polygon` where `height` is not negative (I. Sutherland, G. Hodgman, "Reentrant polygon
/// clipping", 1974).
fn half(polygon: &[Point], height: impl Fn(&Point) -> f64) -> Vec<Point> {
    let mut kept = Vec::new();
    for (k, p) in polygon.iter().enumerate() {
        let q = &polygon[(k + 1) % polygon.len()];
        let (hp, hq) = (height(p), height(q));
        if hp >= 0.0 {
            kept.push(*p);
        }
        if (hp > 0.0 && hq < 0.0) || (hp < 0.0 && hq > 0.0) {
            kept.push(p + (q - p) * (hp / (hp - hq)));
        }
    }
    kept
}

/// Whether a polygon holds a point: a ray to the right crosses its outline an odd number of times.
pub(super) fn holds(polygon: &[Point], p: &Point) -> bool {
    let crossings = (0..polygon.len()).filter(|&k| {
        let (a, b) = (&polygon[k], &polygon[(k + 1) % polygon.len()]);
        (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossings.count() % 2 == 1
}

/// The part of the closed line `outline` inside the polygon `window`, as open lines.
pub(super) fn lines_inside(outline: &[Point], window: &[Point]) -> Vec<Vec<Point>> {
    let n = outline.len();
    let states: Vec<bool> = outline.iter().map(|p| holds(window, p)).collect();
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
