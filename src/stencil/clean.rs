//! Removes slivers from a mesh without opening it or moving its surface beyond a tolerance.
//!
//! Booleans leave needles (one very short edge) and caps (a corner almost on the opposite edge),
//! some of which lose their area or change sides once coordinates are rounded to 32 bits. Two
//! operations remove them, both of which keep a closed 2-manifold closed: collapsing an edge whose
//! ends share exactly two neighbors (the link condition: H. Edelsbrunner, "Geometry and Topology
//! for Mesh Generation", 2001, sec. 4.2), and flipping an edge. An operation is skipped where it
//! would move the surface by more than a tolerance or turn a triangle over.
//!
//! Guaranteed: the mesh stays a closed 2-manifold. Not guaranteed: that no sliver remains, where
//! edges of the solid meet at small angles.

use crate::geometry::Vec3;

use super::mesh::{Mesh, min_angle};

/// Edges shorter than this go first, wherever their ends lie, mm.
const SHORT_MM: f64 = 0.002;
/// Triangles with a smaller angle are slivers, radians (3 degrees).
const SLIVER_RAD: f64 = 0.052;
/// Maximum rounds; each stops early when nothing changes.
const ROUNDS: usize = 12;
/// A triangle flatter than this has no side that it could be turned over from, mm.
const FLAT_MM: f64 = 1e-4;

/// `mesh` without slivers as far as that goes with moves of the surface up to `tolerance_mm`;
/// unused vertices are dropped.
pub(super) fn cleaned(mesh: &Mesh, tolerance_mm: f64) -> Mesh {
    let mut work = CleanWork::new(mesh, tolerance_mm);
    for _ in 0..ROUNDS {
        if work.round() == 0 {
            break;
        }
    }
    work.mesh()
}

/// A mesh under repair.
struct CleanWork {
    vertices: Vec<Vec3>,
    triangles: Vec<Option<[u32; 3]>>,
    /// The triangles around each vertex.
    around: Vec<Vec<u32>>,
    tolerance_mm: f64,
}

impl CleanWork {
    fn new(mesh: &Mesh, tolerance_mm: f64) -> Self {
        let mut around = vec![Vec::new(); mesh.vertices.len()];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            for &v in corners {
                around[v as usize].push(t as u32);
            }
        }
        Self {
            vertices: mesh.vertices.clone(),
            triangles: mesh.triangles.iter().copied().map(Some).collect(),
            around,
            tolerance_mm,
        }
    }

    /// One pass over all triangles; the number of changes.
    fn round(&mut self) -> usize {
        (0..self.triangles.len())
            .filter(|&t| self.fix(t as u32))
            .count()
    }

    fn at(&self, v: u32) -> Vec3 {
        self.vertices[v as usize]
    }

    fn corners(&self, t: [u32; 3]) -> [Vec3; 3] {
        t.map(|v| self.at(v))
    }

    /// Improves triangle `t` if it is a sliver and can be fixed.
    fn fix(&mut self, t: u32) -> bool {
        let Some(v) = self.triangles[t as usize] else {
            return false;
        };
        let p = self.corners(v);
        let length = |i: usize| (p[(i + 1) % 3] - p[i]).norm();
        let shortest = (0..3).fold(0, |s, i| if length(i) < length(s) { i } else { s });
        let (a, b) = (v[shortest], v[(shortest + 1) % 3]);
        if length(shortest) < SHORT_MM {
            return self.collapse(a, b, length(shortest) + self.tolerance_mm)
                || self.collapse(b, a, length(shortest) + self.tolerance_mm);
        }
        if min_angle(&p) >= SLIVER_RAD {
            return false;
        }
        let longest = (0..3).fold(0, |s, i| if length(i) > length(s) { i } else { s });
        self.flip(t, longest)
            || self.collapse(a, b, self.tolerance_mm)
            || self.collapse(b, a, self.tolerance_mm)
    }

    /// The vertices next to `v`.
    fn neighbors(&self, v: u32) -> Vec<u32> {
        let mut found: Vec<u32> = self.around[v as usize]
            .iter()
            .filter_map(|&t| self.triangles[t as usize])
            .flatten()
            .filter(|&u| u != v)
            .collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Moves `from` into its neighbor `to`, if that keeps the surface.
    fn collapse(&mut self, from: u32, to: u32, tolerance: f64) -> bool {
        let near = self.neighbors(to);
        let shared = self.neighbors(from);
        if shared
            .iter()
            .filter(|v| near.binary_search(v).is_ok())
            .count()
            != 2
        {
            return false;
        }
        let target = self.at(to);
        let ring = self.around[from as usize].clone();
        for &t in &ring {
            let Some(old) = self.triangles[t as usize] else {
                return false;
            };
            let before = normal(&self.corners(old));
            let (n, height) = before;
            if height > FLAT_MM && (target - self.at(from)).dot(&n).abs() > tolerance {
                return false;
            }
            if old.contains(&to) {
                continue;
            }
            let moved = old.map(|v| if v == from { to } else { v });
            let (m, new_height) = normal(&self.corners(moved));
            if new_height < FLAT_MM || (height > FLAT_MM && n.dot(&m) < 0.5) {
                return false;
            }
            // A needle must not become a worse one.
            if min_angle(&self.corners(moved)) < min_angle(&self.corners(old)).min(SLIVER_RAD) {
                return false;
            }
        }
        for t in ring {
            let Some(old) = self.triangles[t as usize] else {
                continue;
            };
            if old.contains(&to) {
                self.triangles[t as usize] = None;
                for v in old {
                    self.around[v as usize].retain(|&other| other != t);
                }
            } else {
                self.triangles[t as usize] = Some(old.map(|v| if v == from { to } else { v }));
                self.around[to as usize].push(t);
            }
        }
        self.around[from as usize].clear();
        true
    }

    /// Replaces edge `i` of triangle `t` by the other diagonal of its two triangles, if that widens
    /// their smallest angle and keeps the surface.
    fn flip(&mut self, t: u32, i: usize) -> bool {
        let Some(first) = self.triangles[t as usize] else {
            return false;
        };
        let (a, b, c) = (first[i], first[(i + 1) % 3], first[(i + 2) % 3]);
        let across = self.around[a as usize].iter().copied().find(|&u| {
            let corners = self.triangles[u as usize].unwrap_or_default();
            (0..3).any(|k| corners[k] == b && corners[(k + 1) % 3] == a)
        });
        let Some((other, second)) = across.and_then(|u| Some((u, self.triangles[u as usize]?)))
        else {
            return false;
        };
        let Some(&d) = second.iter().find(|&&v| v != a && v != b) else {
            return false;
        };
        if c == d || self.neighbors(c).binary_search(&d).is_ok() {
            return false;
        }
        let (new_first, new_second) = ([a, d, c], [d, b, c]);
        let worst =
            |x: [u32; 3], y: [u32; 3]| min_angle(&self.corners(x)).min(min_angle(&self.corners(y)));
        if worst(new_first, new_second) <= worst(first, second) {
            return false;
        }
        let (n, height) = normal(&self.corners(second));
        let off_plane = (self.at(c) - self.at(a)).dot(&n).abs();
        let edge = self.at(b) - self.at(a);
        let off_edge = edge.cross(&(self.at(c) - self.at(a))).norm() / edge.norm();
        let faces = [new_first, new_second].map(|f| normal(&self.corners(f)));
        let keeps = off_plane.min(off_edge) < self.tolerance_mm
            && height > FLAT_MM
            && faces.iter().all(|(m, h)| *h > FLAT_MM && n.dot(m) > 0.9);
        if !keeps {
            return false;
        }
        self.triangles[t as usize] = Some(new_first);
        self.triangles[other as usize] = Some(new_second);
        self.around[b as usize].retain(|&x| x != t);
        self.around[d as usize].push(t);
        self.around[a as usize].retain(|&x| x != other);
        self.around[c as usize].push(other);
        true
    }

    /// What is left, with vertices renumbered.
    fn mesh(&self) -> Mesh {
        let mut index = vec![None; self.vertices.len()];
        let mut mesh = Mesh::default();
        for corners in self.triangles.iter().flatten() {
            let triangle = corners.map(|v| {
                *index[v as usize].get_or_insert_with(|| {
                    mesh.vertices.push(self.at(v));
                    mesh.vertices.len() as u32 - 1
                })
            });
            mesh.triangles.push(triangle);
        }
        mesh
    }
}

/// Unit normal of a triangle (zero where it has none) and its smallest height, mm.
fn normal(c: &[Vec3; 3]) -> (Vec3, f64) {
    let n = (c[1] - c[0]).cross(&(c[2] - c[0]));
    let longest = (0..3)
        .map(|i| (c[(i + 1) % 3] - c[i]).norm())
        .fold(0.0, f64::max);
    let double = n.norm();
    (
        n.try_normalize(1e-30).unwrap_or_default(),
        double / longest.max(1e-30),
    )
}
