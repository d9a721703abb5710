//! Shaded pictures of solids: an orthographic z-buffer renderer for a few ten thousand triangles.
//!
//! Each pixel keeps the nearest surface's depth, normal and color; lines are then drawn where depth
//! or normal jump, so that rims and engravings stay readable in print.

use std::ops::Range;

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
    /// The color at a point of the surface, mm.
    fn at(&self, p: &Vec3) -> Rgb {
        match self {
            Self::Shell {
                color,
                center,
                radii,
                chord,
            } => {
                let floor = ((p - center).norm() - radii[2]).abs() < 2.0 * chord;
                color.map(|c| if floor { ENGRAVED * c } else { c })
            }
            Self::Ball {
                colors,
                zones,
                center,
                dots,
                edge_cos,
            } => {
                let d = (p - center).normalize();
                let [ball, dark, zone] = *colors;
                if dots.iter().any(|dot| dot.dot(&d) >= *edge_cos) {
                    dark
                } else if zones.iter().any(|(axis, cos)| axis.dot(&d) >= *cos) {
                    zone
                } else {
                    ball
                }
            }
        }
    }

    /// The surface's normal at a point: the facet's, or that of the sphere which it stands for.
    fn normal(&self, p: &Vec3, facet: &Vec3) -> Vec3 {
        let (center, on_sphere) = match self {
            Self::Shell {
                center,
                radii,
                chord,
                ..
            } => {
                let r = (p - center).norm();
                (center, radii.iter().any(|s| (r - s).abs() < 1.5 * chord))
            }
            Self::Ball { center, .. } => (center, true),
        };
        let outwards = (p - center).normalize();
        let cos = outwards.dot(facet);
        // A sphere's facet is nearly square to the radius; a hole's wall that crosses it is not.
        if on_sphere && cos.abs() > SPHERE_COS {
            cos.signum() * outwards
        } else {
            *facet
        }
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
    body: u32,
    triangle: u32,
    /// Where the pixel meets it: barycentric.
    weights: [f64; 3],
}

/// What is seen in one pixel.
#[derive(Clone, Copy)]
struct SeenPixel {
    depth: f64,
    normal: Vec3,
    color: Rgb,
}

/// Rows of a picture that are rendered at once: a whole picture of pixels with depths takes 66 MB.
const BAND_ROWS: usize = 128;

/// Some rows of a picture.
struct Band<T> {
    width: usize,
    rows: Range<usize>,
    pixels: Vec<Option<T>>,
}

impl<T: Copy> Band<T> {
    fn new(width: usize, rows: Range<usize>) -> Self {
        Self {
            width,
            pixels: vec![None; width * rows.len()],
            rows,
        }
    }

    /// What is in a pixel of the picture that lies in these rows.
    fn at(&self, x: usize, y: usize) -> Option<T> {
        self.pixels[(y - self.rows.start) * self.width + x]
    }

    /// The pixels of a row of the picture that lies in these rows.
    fn row(&mut self, y: usize) -> &mut [Option<T>] {
        let start = (y - self.rows.start) * self.width;
        &mut self.pixels[start..start + self.width]
    }
}

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
    let faces: Vec<Face> = (0..bodies.len())
        .flat_map(|body| faces(frame, bodies, body))
        .collect();
    let bands = concurrency::map_range(0..height.div_ceil(BAND_ROWS) as u64, |band| {
        let start = band as usize * BAND_ROWS;
        let rows = start..(start + BAND_ROWS).min(height);
        colors(width, height, rows, frame, bodies, &faces)
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
    width: usize,
    height: usize,
    rows: Range<usize>,
    frame: &SolidFrame,
    bodies: &[Body<'_>],
    faces: &[Face],
) -> Vec<Option<RGBColor>> {
    // A row more on either side: lines depend on neighbors.
    let about = rows.start.saturating_sub(1)..(rows.end + 1).min(height);
    let mut nearest = Band::new(width, about.clone());
    for face in faces {
        fill(&mut nearest, face);
    }
    let look = |n: Option<NearestSurface>| n.and_then(|n| seen(&n, frame, bodies));
    let seen = Band {
        pixels: nearest.pixels.into_iter().map(look).collect(),
        width,
        rows: about,
    };
    let light = Vec3::from(LIGHT).normalize();
    let at = rows.flat_map(|y| (0..width).map(move |x| (x, y)));
    let color = |(x, y)| {
        let pixel = seen.at(x, y)?;
        let lit = AMBIENT + (1.0 - AMBIENT) * pixel.normal.dot(&light).max(0.0);
        let line = if on_line(&seen, (x, y), frame) {
            LINE
        } else {
            1.0
        };
        let lit = lit * line;
        let [r, g, b] = pixel.color.map(|c| (c * lit).clamp(0.0, 255.0) as u8);
        Some(RGBColor(r, g, b))
    };
    at.map(color).collect()
}

/// The point of a surface and how it looks there.
fn seen(at: &NearestSurface, frame: &SolidFrame, bodies: &[Body<'_>]) -> Option<SeenPixel> {
    let Body { mesh, paint } = bodies[at.body as usize];
    let corners = mesh.corners(at.triangle as usize);
    let normal = facet_normal(&corners)?;
    let [a, b, c] = at.weights;
    let point = a * corners[0] + b * corners[1] + c * corners[2];
    Some(SeenPixel {
        depth: at.depth,
        normal: frame.view.apply(&paint.normal(&point, &normal)),
        color: paint.at(&point),
    })
}

fn facet_normal(corners: &[Vec3; 3]) -> Option<Vec3> {
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    normal.try_normalize(1e-30)
}

/// Whether the surface jumps or folds between a pixel and one of its neighbors.
fn on_line(band: &Band<SeenPixel>, (x, y): (usize, usize), frame: &SolidFrame) -> bool {
    let Some(here) = band.at(x, y) else {
        return false;
    };
    [(1, 0), (0, 1), (-1, 0), (0, -1)]
        .iter()
        .any(|&(dx, dy): &(isize, isize)| {
            let (Some(nx), Some(ny)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else {
                return false;
            };
            if nx >= band.width || !band.rows.contains(&ny) {
                return false;
            }
            match band.at(nx, ny) {
                None => true,
                Some(there) => {
                    // A jump towards the viewer is drawn on the farther side only.
                    let steep = 1.0 / here.normal.z.max(0.1);
                    there.depth - here.depth > (2.0 + 2.0 * steep) / frame.scale + 0.3
                        || here.normal.dot(&there.normal) < CREASE_COS
                }
            }
        })
}

/// A triangle in the picture, which faces the viewer.
struct Face {
    body: u32,
    triangle: u32,
    /// Drawn pixels, and depths, mm.
    corners: [(f64, f64, f64); 3],
    /// Twice its area, square pixels.
    area: f64,
}

/// The triangles of a body that face the viewer.
fn faces(frame: &SolidFrame, bodies: &[Body<'_>], body: usize) -> Vec<Face> {
    let mesh = bodies[body].mesh;
    let placed: Vec<_> = mesh.vertices.iter().map(|v| frame.place(v)).collect();
    let face = |(t, triangle): (usize, &[u32; 3])| {
        let corners = triangle.map(|v| placed[v as usize]);
        // In pixels y points down: front faces turn clockwise.
        let area = -cross(corners[0], corners[1], corners[2].0, corners[2].1);
        (area > 0.0 && facet_normal(&mesh.corners(t)).is_some()).then_some(Face {
            body: body as u32,
            triangle: t as u32,
            corners,
            area,
        })
    };
    mesh.triangles.iter().enumerate().filter_map(face).collect()
}

fn cross(a: (f64, f64, f64), b: (f64, f64, f64), x: f64, y: f64) -> f64 {
    (b.0 - a.0) * (y - a.1) - (b.1 - a.1) * (x - a.0)
}

/// Draws one triangle into the band where nothing nearer is.
fn fill(band: &mut Band<NearestSurface>, face: &Face) {
    let Face {
        corners: q, area, ..
    } = face;
    let bound =
        |f: fn(f64, f64) -> f64, i: fn(&(f64, f64, f64)) -> f64| f(f(i(&q[0]), i(&q[1])), i(&q[2]));
    let columns = [
        bound(f64::min, |p| p.0).ceil().max(0.0),
        bound(f64::max, |p| p.0)
            .floor()
            .min(band.width as f64 - 1.0),
    ];
    let top = bound(f64::min, |p| p.1).ceil().max(0.0) as usize;
    let bottom = bound(f64::max, |p| p.1).floor().max(0.0) as usize;
    let edges = [(q[1], q[2]), (q[2], q[0]), (q[0], q[1])];
    for y in top.max(band.rows.start)..(bottom + 1).min(band.rows.end) {
        let py = y as f64;
        // Where the row enters and leaves the triangle, and a pixel more; the weights decide.
        let [mut first, mut last] = columns;
        for (a, b) in edges {
            let (along, rise) = ((b.0 - a.0) * (py - a.1), b.1 - a.1);
            let met = a.0 + along / rise;
            if rise > 0.0 {
                first = first.max(met.floor() - 1.0);
            } else if rise < 0.0 {
                last = last.min(met.ceil() + 1.0);
            }
        }
        if !(first <= last) {
            continue;
        }
        let (first, last) = (first as usize, last as usize);
        let row = &mut band.row(y)[first..=last];
        for (slot, x) in row.iter_mut().zip(first..) {
            let px = x as f64;
            let weights = edges.map(|(a, b)| -cross(a, b, px, py) / area);
            if weights.iter().any(|&w| w < 0.0) {
                continue;
            }
            let depth = weights[0] * q[0].2 + weights[1] * q[1].2 + weights[2] * q[2].2;
            if slot.is_none_or(|p| depth > p.depth) {
                *slot = Some(NearestSurface {
                    depth,
                    body: face.body,
                    triangle: face.triangle,
                    weights,
                });
            }
        }
    }
}
