//! The ball as a grid of rays: what each ray meets, how it is lit, and the paint on it.
//!
//! The grid covers the ball's box in the image only, so that the cost grows with the ball's area.
//! What a ray meets and how it is lit does not change while the ball turns; the paint does.
//! Under a rolling shutter the rows of the grid are painted one image row at a time.

use std::ops::Range;

use super::color::Color;
use super::dimples::Dimples;
use super::pen::Spot;
use super::scene::Scene;
use super::surface::{HalvesSeam, LogoPrint};
use super::view::View;
use crate::geometry::{Rotation, Vec3};
use crate::vision::optics::camera::Pixel;

/// Balls of a smaller radius, pixels, have three rays along a pixel; others have two.
const SMALL_PX: f64 = 25.0;

/// The rays that may meet the ball, `fine` x `fine` a pixel.
pub(super) struct Canvas {
    fine: usize,
    /// The box's first column and row, pixels; it may begin outside the image.
    corner: [isize; 2],
    columns: usize,
    rows: usize,
    /// Pixels a radian, at most, on the ball's near side.
    reach_px: f64,
    towards: Vec3,
    horizon: f64,
    /// Normals where a ray meets the ball, camera frame; 0 elsewhere.
    normals: Vec<[f32; 3]>,
    hit: Vec<bool>,
    /// Factor on the albedo, and highlight.
    shade: Vec<[Color; 2]>,
    albedo: Vec<Color>,
}

/// Light and coverage of the ball on the image's pixels, summed over rays.
pub(super) struct Exposure {
    pub light: Vec<Color>,
    pub covered: Vec<f32>,
}

impl Canvas {
    /// The rays to a scene's ball; none where it lies outside the image all through the exposure.
    pub fn new(scene: &Scene, view: &View) -> Self {
        let fine = if scene.circle.radius < SMALL_PX { 3 } else { 2 };
        let outline = view.outline();
        let half = outline.half_axes_px[0];
        let [start, end]: [[isize; 2]; 2] = {
            let Pixel { u, v } = outline.center;
            let range = |x: f64, side: usize, shift: f64| {
                let beyond = 0.5 * shift.abs() + 1.0;
                let low = (x - half - 1.0).max(-beyond).floor();
                let high = (x + half + 2.0).min(side as f64 + beyond).ceil();
                [low as isize, high.max(low) as isize]
            };
            // What moves during the exposure, and from the ball's first row to its last.
            let moved = [0, 1].map(|k| {
                let by_row = scene.velocity_px_s[k].abs() * scene.row_s;
                scene.shift_px[k].abs() + by_row * (2.0 * half + 2.0)
            });
            let us = range(u, scene.size[0], moved[0]);
            let vs = range(v, scene.size[1], moved[1]);
            [[us[0], vs[0]], [us[1], vs[1]]]
        };
        let columns = (end[0] - start[0]) as usize * fine;
        let rows = (end[1] - start[1]) as usize * fine;
        let distance = view.distance();
        let near = distance.map_or(1.0, |d| ((d + 1.0) / (d - 1.0)).sqrt());
        let mut canvas = Self {
            fine,
            corner: start,
            columns,
            rows,
            reach_px: 1.1 * near * half,
            towards: view.towards(),
            horizon: distance.map_or(0.0, |d| 1.0 / d),
            normals: vec![[0.0; 3]; columns * rows],
            hit: vec![false; columns * rows],
            shade: vec![[[0.0; 3]; 2]; columns * rows],
            albedo: vec![[0.0; 3]; columns * rows],
        };
        for row in 0..rows {
            for column in 0..columns {
                let pixel = Pixel {
                    u: canvas.position(column, 0),
                    v: canvas.position(row, 1),
                };
                if let Some(n) = view.normal(pixel) {
                    let at = row * columns + column;
                    canvas.hit[at] = true;
                    canvas.normals[at] = [n.x as f32, n.y as f32, n.z as f32];
                    canvas.shade[at] = scene.light.at(&n, view.facing(&n), &canvas.towards);
                }
            }
        }
        canvas
    }

    /// Position of a ray's column (axis 0) or row (1) in the image.
    fn position(&self, ray: usize, axis: usize) -> f64 {
        (ray as f64 + 0.5) / self.fine as f64 - 0.5 + self.corner[axis] as f64
    }

    /// An exposure of nothing.
    pub fn blank([width, height]: [usize; 2]) -> Exposure {
        Exposure {
            light: vec![[0.0; 3]; width * height],
            covered: vec![0.0; width * height],
        }
    }

    /// All rows of rays.
    pub fn all_rows(&self) -> Range<usize> {
        0..self.rows
    }

    /// The rows of rays that an image's row shows of a ball that is moved by `shift_v` pixels.
    pub fn rows_of(&self, image_row: usize, shift_v: f64) -> Range<usize> {
        let fine = self.fine as isize;
        let moved = (shift_v * self.fine as f64).round() as isize;
        let first = (image_row as isize - self.corner[1]) * fine - moved;
        let within = |row: isize| row.clamp(0, self.rows as isize) as usize;
        within(first)..within(first + fine)
    }

    /// Adds rows of the painted ball, moved by `shift` pixels, with the given weight.
    pub fn add(
        &self,
        rows: Range<usize>,
        shift: [f64; 2],
        weight: f32,
        [width, height]: [usize; 2],
        sum: &mut Exposure,
    ) {
        let weight = weight / (self.fine * self.fine) as f32;
        // The shift in whole rays, and the pixel of each ray.
        let place = |ray: usize, axis: usize, side: usize| {
            let moved = (shift[axis] * self.fine as f64).round() as isize;
            let pixel = self.corner[axis] + (ray as isize + moved).div_euclid(self.fine as isize);
            usize::try_from(pixel).ok().filter(|p| *p < side)
        };
        let us: Vec<_> = (0..self.columns).map(|ray| place(ray, 0, width)).collect();
        for row in rows {
            let Some(v) = place(row, 1, height) else {
                continue;
            };
            for (column, u) in us.iter().enumerate() {
                let at = row * self.columns + column;
                let (true, Some(u)) = (self.hit[at], u) else {
                    continue;
                };
                let [factor, gloss] = self.shade[at];
                let to = v * width + u;
                sum.covered[to] += weight;
                for (k, total) in sum.light[to].iter_mut().enumerate() {
                    *total += weight * (self.albedo[at][k] * factor[k] + gloss[k]);
                }
            }
        }
    }

    /// Paints the surface, turned, over rows of rays.
    pub fn paint(&mut self, rows: Range<usize>, scene: &Scene, view: &View, rotation: &Rotation) {
        let surface = &scene.surface;
        let rays = rows.start * self.columns..rows.end * self.columns;
        self.albedo[rays.clone()].fill(surface.ball);
        for seam in &surface.seams {
            self.paint_seam(rays.clone(), seam, rotation);
        }
        for mark in &surface.marks {
            self.paint_mark(&rows, mark, view, rotation);
        }
        for stain in &surface.stains {
            self.paint_spot(&rows, stain, surface.stain_color, view, rotation);
        }
        for spot in surface.dots.iter().flatten().chain(&surface.strangers) {
            self.paint_spot(&rows, spot, surface.ink, view, rotation);
        }
        if let Some(dimples) = &surface.dimples {
            self.press(rays, dimples, scene, view, rotation);
        }
    }

    /// Lights the surface anew where hollows change its normal.
    fn press(
        &mut self,
        rays: Range<usize>,
        dimples: &Dimples,
        scene: &Scene,
        view: &View,
        rotation: &Rotation,
    ) {
        let back = rotation.inverse();
        for ray in rays.filter(|ray| self.hit[*ray]) {
            let n = Vec3::from(self.normals[ray].map(f64::from)).normalize();
            let normal = rotation * dimples.normal(&(back * n));
            self.shade[ray] = scene.light.at(&normal, view.facing(&n), &self.towards);
        }
    }

    fn paint_seam(&mut self, rays: Range<usize>, seam: &HalvesSeam, rotation: &Rotation) {
        let axis = single(&(rotation * seam.axis));
        let half_width = seam.half_width as f32;
        let normals = &self.normals[rays.clone()];
        for (albedo, n) in self.albedo[rays].iter_mut().zip(normals) {
            let off = part(n, &axis).abs();
            // The edge fades over a third of the width.
            let covered = seam.strength * (3.0 * (1.0 - off / half_width)).clamp(0.0, 1.0);
            if covered > 0.0 {
                cover(albedo, seam.color, covered);
            }
        }
    }

    fn paint_spot(
        &mut self,
        rows: &Range<usize>,
        spot: &Spot,
        ink: Color,
        view: &View,
        rotation: &Rotation,
    ) {
        let middle = rotation * spot.middle;
        let Some([us, vs]) = self.window(rows, &middle, spot.reach(), view) else {
            return;
        };
        let m = single(&middle);
        let [long, short] = spot.axes.map(|a| single(&(rotation * a)));
        let low = (spot.radius + spot.softness).cos() as f32;
        let inner = (spot.radius - spot.softness).max(0.0).cos() as f32;
        let scale = 1.0 / (inner - low).max(1e-6);
        let is_round = spot.elongation == 0.0 && spot.streaks.depth == 0.0;
        let bound = spot.reach().cos() as f32;
        let streaks = spot.streaks;
        let frequency = streaks.frequency / spot.radius.max(1e-6) as f32;
        for row in vs {
            for column in us.clone() {
                let at = row * self.columns + column;
                let n = &self.normals[at];
                let cos = part(n, &m);
                if cos <= bound {
                    continue;
                }
                let mut covered = spot.darkness;
                if is_round {
                    covered *= ((cos - low) * scale).clamp(0.0, 1.0);
                } else {
                    let (a, b) = (part(n, &long), part(n, &short));
                    let square = (a * a + b * b).max(1e-12);
                    // To second order, 1 - cos is half the angle's square: a stretched radius
                    // divides it.
                    let stretch = 1.0 + spot.elongation * (a * a - b * b) / square;
                    let cos = 1.0 - (1.0 - cos) / (stretch * stretch);
                    let streak = 0.5 + 0.5 * (frequency * b + streaks.phase).sin();
                    covered *= ((cos - low) * scale).clamp(0.0, 1.0);
                    covered *= 1.0 - streaks.depth * streak;
                }
                cover(&mut self.albedo[at], ink, covered);
            }
        }
    }

    fn paint_mark(
        &mut self,
        rows: &Range<usize>,
        mark: &LogoPrint,
        view: &View,
        rotation: &Rotation,
    ) {
        let middle = rotation * mark.middle;
        // The corners of the square in which it is drawn.
        let reach = std::f64::consts::SQRT_2 * mark.radius;
        let Some([us, vs]) = self.window(rows, &middle, reach, view) else {
            return;
        };
        let m = single(&middle);
        let axes = mark.axes.map(|a| single(&(rotation * a)));
        let low = reach.min(3.0).cos() as f32;
        for row in vs {
            for column in us.clone() {
                let at = row * self.columns + column;
                let n = &self.normals[at];
                let along = part(n, &m);
                if along > low && self.hit[at] {
                    let covered = mark.ink_at(along, axes.map(|a| part(n, &a)));
                    cover(&mut self.albedo[at], mark.color, covered);
                }
            }
        }
    }

    /// Columns and rows of rays, within `rows`, that may meet the cap of the given angular radius; `None`
    /// where the cap is out of sight.
    fn window(
        &self,
        rows: &Range<usize>,
        middle: &Vec3,
        angle: f64,
        view: &View,
    ) -> Option<[Range<usize>; 2]> {
        // The cosine falls by no more than the angle.
        if middle.dot(&self.towards) < self.horizon - angle {
            return None;
        }
        let at = view.project(middle);
        let reach = self.reach_px * angle.min(2.0) + 1.0;
        let range = |x: f64, axis: usize, within: &Range<usize>| {
            let ray = |x: f64| (x + 0.5 - self.corner[axis] as f64) * self.fine as f64;
            let low = (ray(x - reach).max(0.0) as usize).max(within.start);
            let high = (ray(x + reach).max(0.0) as usize + 1).min(within.end);
            low.min(high)..high
        };
        Some([range(at.u, 0, &(0..self.columns)), range(at.v, 1, rows)])
    }
}

fn cover(albedo: &mut Color, ink: Color, share: f32) {
    for (a, ink) in albedo.iter_mut().zip(ink) {
        *a += share * (ink - *a);
    }
}

fn single(v: &Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn part(n: &[f32; 3], v: &[f32; 3]) -> f32 {
    n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
}
