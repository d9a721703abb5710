//! Shaded pictures of solids: an orthographic z-buffer renderer for a few ten thousand triangles.
//!
//! Each pixel keeps the nearest surface's depth, normal and color; lines are then drawn where depth
//! or normal jump, so that rims and engravings stay readable in print.

use std::num::NonZeroU32;
use std::ops::{Range, RangeInclusive};

use plotters::prelude::*;

use crate::concurrency;
use crate::geometry::Vec3;
use crate::stencil::Mesh;

use super::canvas::{Area, Drawn};

/// Direction towards the light, in the view's frame (right, up, towards the viewer).
const LIGHT: [f64; 3] = [-0.45, 0.55, 0.71];
/// Brightness of a surface that faces away from the light.
const AMBIENT: f64 = 0.42;
/// Neighbors whose normals differ by more than this cosine are parted by a line.
const CREASE_COS: f64 = 0.80;
/// Brightness of pixels on such lines.
const LINE: f64 = 0.55;

/// Brightness of an engraving's floor.
const ENGRAVED: f64 = 0.45;
/// Facets whose normals are nearer to the radius than this cosine belong to a sphere.
const SPHERE_COS: f64 = 0.97;

/// Red, green, blue in [0, 255].
pub(super) type Rgb = [f64; 3];

/// How a solid is colored.
#[derive(Debug, Clone)]
pub(super) enum SolidPaint {
    /// A shell between two spheres: smooth on them, and dark where it is engraved.
    Shell {
        /// Its color.
        color: Rgb,
        /// Its center, mm.
        center: Vec3,
        /// Radii of the inner and the outer sphere, and of the engraving's floor, mm.
        radii: [f64; 3],
        /// Facets leave the spheres by at most this, mm.
        chord: f64,
    },
    /// A ball with round dots and zones without any.
    Ball {
        /// Color of the ball, of its dots, and of its zones.
        colors: [Rgb; 3],
        /// The zones: directions, and cosines of their half angles.
        zones: Vec<(Vec3, f64)>,
        /// Its center, mm.
        center: Vec3,
        /// The dots' directions from there.
        dots: Vec<Vec3>,
        /// Cosine of the angle between a dot's middle and its edge.
        edge_cos: f64,
    },
}

impl SolidPaint {
    /// The surface's normal at a point, mm, and its color there. The normal is the facet's, or that of the sphere which it stands for.
    fn look(&self, p: &Vec3, facet: &Vec3) -> (Vec3, Rgb) {
        let from_center = match self {
            Self::Shell { center, .. } | Self::Ball { center, .. } => p - center,
        };
        let r = from_center.norm();
        let outwards = from_center / r;
        let (on_sphere, color) = match self {
            Self::Shell {
                color,
                radii,
                chord,
                ..
            } => {
                let on_sphere = radii.iter().any(|s| (r - s).abs() < 1.5 * chord);
                let floor = (r - radii[2]).abs() < 2.0 * chord;
                (
                    on_sphere,
                    color.map(|c| if floor { ENGRAVED * c } else { c }),
                )
            }
            Self::Ball {
                colors: [ball, dark, zone],
                zones,
                dots,
                edge_cos,
                ..
            } => {
                let is_dot = |dot: &Vec3| dot.dot(&outwards) >= *edge_cos;
                let is_zone = |(axis, cos): &(Vec3, f64)| axis.dot(&outwards) >= *cos;
                let color = if dots.iter().any(is_dot) {
                    dark
                } else if zones.iter().any(is_zone) {
                    zone
                } else {
                    ball
                };
                (true, *color)
            }
        };
        let cos = outwards.dot(facet);
        // A sphere's facet is nearly square to the radius; a hole's wall that crosses it is not.
        let normal = match on_sphere && cos.abs() > SPHERE_COS {
            true => cos.signum() * outwards,
            false => *facet,
        };
        (normal, color)
    }
}

/// A solid with its colors.
pub(super) struct Body<'a> {
    /// Its surface.
    pub mesh: &'a Mesh,
    /// Its colors.
    pub paint: &'a SolidPaint,
}

/// Where the viewer stands: orthonormal directions of the picture, right-handed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Viewpoint {
    right: Vec3,
    up: Vec3,
    towards: Vec3,
}

impl Viewpoint {
    /// Seen from `azimuth_deg` (from +x towards +y) and `height_deg` above the plane z = 0, z
    /// upwards.
    pub fn from(azimuth_deg: f64, height_deg: f64) -> Self {
        let (sa, ca) = azimuth_deg.to_radians().sin_cos();
        let (sh, ch) = height_deg.to_radians().sin_cos();
        Self {
            right: Vec3::new(-sa, ca, 0.0),
            up: Vec3::new(-sh * ca, -sh * sa, ch),
            towards: Vec3::new(ch * ca, ch * sa, sh),
        }
    }

    /// A point in the view's frame.
    pub fn apply(&self, p: &Vec3) -> Vec3 {
        Vec3::new(self.right.dot(p), self.up.dot(p), self.towards.dot(p))
    }
}

/// The nearest surface in one pixel.
#[derive(Clone, Copy)]
struct NearestSurface {
    depth: f64,
    /// The number of its triangle among all; none where nothing is seen.
    face: Option<NonZeroU32>,
}

/// What is seen in one pixel.
#[derive(Clone, Copy)]
struct SeenPixel {
    depth: f64,
    normal: Vec3,
    color: Rgb,
}

/// Rows of a picture that are rendered at once, by one thread.
const BAND_ROWS: usize = 64;

/// A scene's place in a picture: `scale` drawn pixels per millimeter, the view's origin at
/// `center`.
#[derive(Debug, Clone, Copy)]
pub(super) struct SolidFrame {
    /// Viewer.
    pub view: Viewpoint,
    /// Drawn pixels per millimeter.
    pub scale: f64,
    /// The point of the scene that is drawn in the middle, in the view's frame, mm.
    pub middle: (f64, f64),
    /// Drawn pixel of the middle.
    pub center: (i32, i32),
}

impl SolidFrame {
    /// A frame that shows all of `bodies` within `available` (width, height; drawn pixels) about
    /// `center`.
    pub fn fitted(
        view: Viewpoint,
        bodies: &[Body<'_>],
        available: (f64, f64),
        center: (i32, i32),
    ) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for v in bodies.iter().flat_map(|b| &b.mesh.vertices) {
            let p = view.apply(v);
            for i in 0..2 {
                low[i] = low[i].min(p[i]);
                high[i] = high[i].max(p[i]);
            }
        }
        let size = |i: usize| (high[i] - low[i]).max(1e-6);
        Self {
            view,
            scale: (available.0 / size(0)).min(available.1 / size(1)),
            middle: (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])),
            center,
        }
    }

    /// The drawn pixel of a point, and its depth towards the viewer, mm.
    pub fn place(&self, p: &Vec3) -> (f64, f64, f64) {
        let q = self.view.apply(p);
        (
            f64::from(self.center.0) + (q.x - self.middle.0) * self.scale,
            f64::from(self.center.1) - (q.y - self.middle.1) * self.scale,
            q.z,
        )
    }
}

/// Renders `bodies` into `area`.
pub(super) fn render(area: &Area<'_>, frame: &SolidFrame, bodies: &[Body<'_>]) -> Drawn {
    let (width, height) = area.dim_in_pixel();
    let (width, height) = (width as usize, height as usize);
    let faces: Vec<Face<'_>> = bodies.iter().flat_map(|b| faces(frame, b)).collect();
    let bands = concurrency::map_range(0..height.div_ceil(BAND_ROWS) as u64, |band| {
        let start = band as usize * BAND_ROWS;
        let rows = start..(start + BAND_ROWS).min(height);
        colors(frame, &faces, width, rows, height)
    });
    for (y, row) in bands.iter().flat_map(|b| b.chunks(width)).enumerate() {
        for (x, color) in row.iter().enumerate() {
            if let Some(color) = color {
                area.draw_pixel((x as i32, y as i32), color)?;
            }
        }
    }
    Ok(())
}

/// The colors of some rows of a picture.
fn colors(
    frame: &SolidFrame,
    faces: &[Face<'_>],
    width: usize,
    rows: Range<usize>,
    height: usize,
) -> Vec<Option<RGBColor>> {
    let light = Vec3::from(LIGHT).normalize();
    // A row more on either side: lines depend on neighbors.
    let mut band = Band::new(
        width,
        rows.start.saturating_sub(1)..(rows.end + 1).min(height),
    );
    for (k, face) in (1..).zip(faces) {
        band.fill(face, NonZeroU32::new(k));
    }
    let [mut above, mut here, mut below] = [const { Vec::new() }; 3];
    if let Some(y) = rows.start.checked_sub(1) {
        band.look(frame, faces, y, &mut above);
    }
    band.look(frame, faces, rows.start, &mut here);
    let mut colors = Vec::with_capacity(width * rows.len());
    for y in rows {
        band.look(frame, faces, y + 1, &mut below);
        colors.extend((0..width).map(|x| {
            let pixel = here[x]?;
            let lit = AMBIENT + (1.0 - AMBIENT) * pixel.normal.dot(&light).max(0.0);
            let line = match on_line([&above, &here, &below], x, frame) {
                true => LINE,
                false => 1.0,
            };
            let lit = lit * line;
            let [r, g, b] = pixel.color.map(|c| (c * lit).clamp(0.0, 255.0) as u8);
            Some(RGBColor(r, g, b))
        }));
        (above, here, below) = (here, below, above);
    }
    colors
}

/// Whether the surface jumps or folds between a pixel of the middle row and one of its neighbors.
fn on_line(rows: [&[Option<SeenPixel>]; 3], x: usize, frame: &SolidFrame) -> bool {
    let [above, row, below] = rows;
    let Some(here) = row[x] else {
        return false;
    };
    let parts = |there: &Option<SeenPixel>| match there {
        None => true,
        Some(there) => {
            // A jump towards the viewer is drawn on the farther side only.
            let steep = 1.0 / here.normal.z.max(0.1);
            there.depth - here.depth > (2.0 + 2.0 * steep) / frame.scale + 0.3
                || here.normal.dot(&there.normal) < CREASE_COS
        }
    };
    let left = x.checked_sub(1).and_then(|x| row.get(x));
    let neighbors = [row.get(x + 1), below.get(x), left, above.get(x)];
    neighbors.into_iter().flatten().any(parts)
}

/// A triangle that faces the viewer.
struct Face<'a> {
    /// Drawn pixels, and depths, mm.
    placed: [(f64, f64, f64); 3],
    /// Twice its area, square pixels.
    area: f64,
    /// Where it is, mm.
    corners: [Vec3; 3],
    normal: Vec3,
    paint: &'a SolidPaint,
}

/// The triangles of a body that face the viewer.
fn faces<'a>(frame: &SolidFrame, body: &Body<'a>) -> Vec<Face<'a>> {
    let Body { mesh, paint } = *body;
    let placed: Vec<_> = mesh.vertices.iter().map(|v| frame.place(v)).collect();
    let face = |triangle: &[u32; 3]| {
        let placed = triangle.map(|v| placed[v as usize]);
        let corners = triangle.map(|v| mesh.vertices[v as usize]);
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        // In pixels y points down: front faces turn clockwise.
        let area = -cross(placed[0], placed[1], placed[2].0, placed[2].1);
        (area > 0.0).then_some(Face {
            placed,
            area,
            corners,
            normal: normal.try_normalize(1e-30)?,
            paint,
        })
    };
    mesh.triangles.iter().filter_map(face).collect()
}

fn cross(a: (f64, f64, f64), b: (f64, f64, f64), x: f64, y: f64) -> f64 {
    (b.0 - a.0) * (y - a.1) - (b.1 - a.1) * (x - a.0)
}

impl Face<'_> {
    /// The barycentric weights of a drawn pixel.
    fn weights(&self, x: f64, y: f64) -> [f64; 3] {
        let q = &self.placed;
        [
            -cross(q[1], q[2], x, y) / self.area,
            -cross(q[2], q[0], x, y) / self.area,
            -cross(q[0], q[1], x, y) / self.area,
        ]
    }

    /// The drawn pixels of a row between which it may lie.
    fn columns(&self, width: usize, y: f64) -> Option<RangeInclusive<usize>> {
        let q = &self.placed;
        let mut first = q[0].0.min(q[1].0).min(q[2].0).ceil().max(0.0);
        let mut last = q[0]
            .0
            .max(q[1].0)
            .max(q[2].0)
            .floor()
            .min(width as f64 - 1.0);
        // Where the row enters and leaves it, and a pixel more.
        for (a, b) in [(q[1], q[2]), (q[2], q[0]), (q[0], q[1])] {
            let rise = b.1 - a.1;
            let met = a.0 + (b.0 - a.0) * (y - a.1) / rise;
            if rise > 0.0 {
                first = first.max(met.floor() - 1.0);
            } else if rise < 0.0 {
                last = last.min(met.ceil() + 1.0);
            }
        }
        (first <= last).then_some(first as usize..=last as usize)
    }
}

/// Some rows of a picture.
struct Band {
    width: usize,
    rows: Range<usize>,
    pixels: Vec<NearestSurface>,
}

impl Band {
    fn new(width: usize, rows: Range<usize>) -> Self {
        let nothing = NearestSurface {
            depth: f64::NEG_INFINITY,
            face: None,
        };
        Self {
            width,
            pixels: vec![nothing; width * rows.len()],
            rows,
        }
    }

    /// Draws a triangle where nothing nearer is.
    fn fill(&mut self, face: &Face<'_>, number: Option<NonZeroU32>) {
        let q = &face.placed;
        let top = q[0].1.min(q[1].1).min(q[2].1).ceil().max(0.0) as usize;
        let bottom = q[0].1.max(q[1].1).max(q[2].1).floor().max(0.0) as usize;
        for y in top.max(self.rows.start)..(bottom + 1).min(self.rows.end) {
            let Some(columns) = face.columns(self.width, y as f64) else {
                continue;
            };
            let start = (y - self.rows.start) * self.width;
            for x in columns {
                let weights = face.weights(x as f64, y as f64);
                if weights.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let depth = weights[0] * q[0].2 + weights[1] * q[1].2 + weights[2] * q[2].2;
                let nearest = &mut self.pixels[start + x];
                if depth > nearest.depth {
                    (nearest.depth, nearest.face) = (depth, number);
                }
            }
        }
    }

    /// What is seen in the pixels of a row; of one beyond these rows, none.
    fn look(
        &self,
        frame: &SolidFrame,
        faces: &[Face<'_>],
        y: usize,
        seen: &mut Vec<Option<SeenPixel>>,
    ) {
        seen.clear();
        if !self.rows.contains(&y) {
            return;
        }
        let start = (y - self.rows.start) * self.width;
        let row = self.pixels[start..start + self.width].iter().enumerate();
        seen.extend(row.map(|(x, nearest)| {
            let face = &faces[nearest.face?.get() as usize - 1];
            let [a, b, c] = face.weights(x as f64, y as f64);
            let point = a * face.corners[0] + b * face.corners[1] + c * face.corners[2];
            let (normal, color) = face.paint.look(&point, &face.normal);
            Some(SeenPixel {
                depth: nearest.depth,
                normal: frame.view.apply(&normal),
                color,
            })
        }));
    }
}
