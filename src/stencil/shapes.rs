//! Building blocks: spheres, solids of revolution, rings and prisms, as closed meshes.

use std::f64::consts::{FRAC_PI_2, TAU};

use crate::geometry::{Vec3, tangent_frame};

use super::mesh::Mesh;

/// Segments of a circle of `radius_mm` whose chords leave it by at most `chord_mm`; a multiple of
/// 4.
pub fn circle_segments(radius_mm: f64, chord_mm: f64) -> usize {
    let half = (1.0 - (chord_mm / radius_mm).min(0.5)).acos();
    let n = (std::f64::consts::PI / half).ceil() as usize;
    n.div_ceil(4).max(4) * 4
}

/// A sphere about the origin with edges on the three coordinate planes, so that a cut through one
/// of them makes no new triangles. Its facets leave the sphere by at most `chord_mm`.
pub fn sphere(radius_mm: f64, chord_mm: f64) -> Mesh {
    // The largest facets of this subdivision have a circumradius near 0.65 of the edge length.
    let edge = (2.0 * radius_mm * chord_mm).sqrt() / 0.65;
    let n = (FRAC_PI_2 * radius_mm / edge).ceil().max(2.0) as usize;
    let mut mesh = Mesh::default();
    let mut index = std::collections::HashMap::new();
    for octant in 0..8 {
        let sign = |bit: i64| if octant >> bit & 1 == 0 { 1 } else { -1 };
        let s = [sign(0), sign(1), sign(2)];
        let mut vertex = |i: usize, j: usize| {
            let k = n - i - j;
            let key = [i as i64 * s[0], j as i64 * s[1], k as i64 * s[2]];
            *index.entry(key).or_insert_with(|| {
                // The sine spreads the points more evenly than the flat octahedron would.
                let p = key.map(|c| (FRAC_PI_2 * c as f64 / n as f64).sin());
                mesh.vertices
                    .push(radius_mm * Vec3::new(p[0], p[1], p[2]).normalize());
                mesh.vertices.len() as u32 - 1
            })
        };
        let flip = s[0] * s[1] * s[2] < 0;
        let mut triangles = Vec::new();
        for i in 0..n {
            for j in 0..n - i {
                triangles.push([vertex(i, j), vertex(i + 1, j), vertex(i, j + 1)]);
                if i + j + 1 < n {
                    triangles.push([vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)]);
                }
            }
        }
        for [a, b, c] in triangles {
            mesh.triangles
                .push(if flip { [a, c, b] } else { [a, b, c] });
        }
    }
    mesh
}

/// The solid that the closed outline `(distance along axis, radius)` sweeps around `axis` (unit
/// vector). The outline starts and ends on the axis (radius 0) and runs towards growing distances.
pub fn revolve(axis: &Vec3, outline: &[(f64, f64)], segments: usize) -> Mesh {
    let [u, v] = tangent_frame(axis);
    let mut mesh = Mesh::default();
    // Rings of the outline's inner points; the two ends are single vertices.
    let Some(((first, last), rings)) = outline.split_first().and_then(|(f, rest)| {
        let (l, rings) = rest.split_last()?;
        Some(((f, l), rings))
    }) else {
        return mesh;
    };
    mesh.vertices.push(axis * first.0);
    for &(h, r) in rings {
        for s in 0..segments {
            let (sin, cos) = (TAU * s as f64 / segments as f64).sin_cos();
            mesh.vertices.push(axis * h + r * (cos * u + sin * v));
        }
    }
    let end = mesh.vertices.len() as u32;
    mesh.vertices.push(axis * last.0);
    let at = |ring: usize, s: usize| (1 + ring * segments + s % segments) as u32;
    for s in 0..segments {
        mesh.triangles.push([0, at(0, s + 1), at(0, s)]);
        for ring in 1..rings.len() {
            let [a, b] = [at(ring - 1, s), at(ring - 1, s + 1)];
            let [c, d] = [at(ring, s), at(ring, s + 1)];
            mesh.triangles.push([a, b, d]);
            mesh.triangles.push([a, d, c]);
        }
        let top = rings.len() - 1;
        mesh.triangles.push([end, at(top, s), at(top, s + 1)]);
    }
    mesh
}

/// The ring that the closed outline `(distance along axis, radius)` sweeps around `axis` (unit
/// vector). All radii are positive; the outline runs outside upwards and inside downwards.
pub fn ring(axis: &Vec3, outline: &[(f64, f64)], segments: usize) -> Mesh {
    let [u, v] = tangent_frame(axis);
    let mut mesh = Mesh::default();
    for &(h, r) in outline {
        for s in 0..segments {
            let (sin, cos) = (TAU * s as f64 / segments as f64).sin_cos();
            mesh.vertices.push(axis * h + r * (cos * u + sin * v));
        }
    }
    let n = outline.len();
    let at = |i: usize, s: usize| (i % n * segments + s % segments) as u32;
    for i in 0..n {
        for s in 0..segments {
            let [a, b] = [at(i, s), at(i, s + 1)];
            let [c, d] = [at(i + 1, s), at(i + 1, s + 1)];
            mesh.triangles.push([a, b, d]);
            mesh.triangles.push([a, d, c]);
        }
    }
    mesh
}

/// The prism over a polygon (counter-clockwise in `e1`, `e2`) from `from` to `to` along `e1 x e2`,
/// with its origin at `origin`. All of the polygon must be seen from its point `kernel`.
pub fn prism(
    origin: &Vec3,
    [e1, e2]: [&Vec3; 2],
    polygon: &[(f64, f64)],
    kernel: (f64, f64),
    [from, to]: [f64; 2],
) -> Mesh {
    let e3 = e1.cross(e2);
    let n = polygon.len() as u32;
    let mut mesh = Mesh::default();
    for h in [from, to] {
        let point = |(a, b): (f64, f64)| origin + a * e1 + b * e2 + h * e3;
        mesh.vertices.extend(polygon.iter().copied().map(point));
        mesh.vertices.push(point(kernel));
    }
    let top = n + 1;
    for i in 0..n {
        let j = (i + 1) % n;
        mesh.triangles.push([n, j, i]);
        mesh.triangles.push([top + n, top + i, top + j]);
        mesh.triangles.push([i, j, top + j]);
        mesh.triangles.push([i, top + j, top + i]);
    }
    mesh
}

/// The solid through convex polygons of equally many points, one behind the other: each turns
/// counter-clockwise seen from the next.
pub fn loft(sections: &[Vec<Vec3>]) -> Mesh {
    let n = sections.first().map_or(0, Vec::len) as u32;
    let last = n * (sections.len().max(1) as u32 - 1);
    let mut mesh = Mesh {
        vertices: sections.concat(),
        triangles: Vec::new(),
    };
    for i in 1..n.saturating_sub(1) {
        mesh.triangles.push([0, i + 1, i]);
        mesh.triangles.push([last, last + i, last + i + 1]);
    }
    for base in (0..last).step_by(n.max(1) as usize) {
        for i in 0..n {
            let j = (i + 1) % n;
            mesh.triangles.push([base + i, base + j, base + n + j]);
            mesh.triangles.push([base + i, base + n + j, base + n + i]);
        }
    }
    mesh
}

/// The convex hull of points in the plane, counter-clockwise (A. M. Andrew's monotone chain, 1979).
pub fn convex_hull(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut sorted = points.to_vec();
    sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let turns_right = |hull: &[(f64, f64)], c: &(f64, f64)| match hull {
        [.., a, b] => (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0) <= 0.0,
        _ => false,
    };
    let chain = |points: &mut dyn Iterator<Item = &(f64, f64)>| {
        let mut hull: Vec<(f64, f64)> = Vec::new();
        for p in points {
            while turns_right(&hull, p) {
                hull.pop();
            }
            hull.push(*p);
        }
        hull.pop();
        hull
    };
    let mut hull = chain(&mut sorted.iter());
    hull.extend(chain(&mut sorted.iter().rev()));
    hull
}

/// Mean of points in the plane: inside their convex hull.
pub fn middle(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len().max(1) as f64;
    let sum = points
        .iter()
        .fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
    (sum.0 / n, sum.1 / n)
}

/// Points on a circle of `radius` about `center`, in the plane.
pub fn circle(center: (f64, f64), radius: f64, segments: usize) -> Vec<(f64, f64)> {
    (0..segments)
        .map(|s| {
            let (sin, cos) = (TAU * s as f64 / segments as f64).sin_cos();
            (center.0 + radius * cos, center.1 + radius * sin)
        })
        .collect()
}
