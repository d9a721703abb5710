//! Triangle meshes of solids, and the check that they bound one.
//!
//! A mesh is valid when every directed edge has exactly one opposite (closed and consistently
//! oriented), the triangles around each vertex form one fan, and the enclosed volume is positive.
//! The check works on indices alone, so [`Mesh::rounded`] first merges vertices that become equal
//! in the 32-bit floats of an STL file: a reader of that file sees exactly the topology that was
//! checked.

use std::collections::HashMap;

use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// A triangle mesh in millimeters; triangles turn counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Vertex positions, mm.
    pub vertices: Vec<Vec3>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// An axis-aligned box, mm.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct BoundingBox {
    /// Minimum x, y, z, mm.
    pub min_mm: [f64; 3],
    /// Maximum x, y, z, mm.
    pub max_mm: [f64; 3],
}

/// What [`Mesh::check`] found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MeshCheck {
    /// Number of vertices that triangles use.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Directed edges without exactly one opposite: zero for a closed, consistently oriented mesh.
    pub unmatched_edges: usize,
    /// Vertices whose triangles form more than one fan.
    pub pinched_vertices: usize,
    /// Triangles that use a vertex twice or have no area.
    pub degenerate_triangles: usize,
    /// Connected pieces of the surface.
    pub bodies: usize,
    /// Euler characteristic, vertices - edges + triangles.
    pub euler_characteristic: i64,
    /// Enclosed volume, mm^3.
    pub volume_mm3: f64,
    /// Smallest angle of a triangle, degrees.
    pub min_angle_deg: f64,
}

impl MeshCheck {
    /// Number of through-holes of a single closed body: `(2 - chi) / 2`.
    pub fn genus(&self) -> i64 {
        (2 - self.euler_characteristic) / 2
    }

    /// Rejects anything but one closed, oriented body of positive volume.
    ///
    /// # Errors
    /// [`Error::Internal`] naming `part` and the first value that fails.
    pub fn require_solid(&self, part: &str) -> Result<()> {
        let fail = |what: String| Err(Error::Internal(format!("{part}: {what}")));
        if self.triangles == 0 {
            return fail("the mesh is empty".into());
        }
        if self.unmatched_edges > 0 {
            return fail(format!("{} edges are not matched", self.unmatched_edges));
        }
        if self.pinched_vertices > 0 {
            return fail(format!("{} vertices are pinched", self.pinched_vertices));
        }
        if self.degenerate_triangles > 0 {
            return fail(format!(
                "{} triangles have no area",
                self.degenerate_triangles
            ));
        }
        if self.bodies != 1 {
            return fail(format!("expected one body, found {}", self.bodies));
        }
        if !self.volume_mm3.is_finite() || self.volume_mm3 <= 0.0 {
            return fail(format!("the volume is {} mm^3", self.volume_mm3));
        }
        Ok(())
    }
}

impl Mesh {
    /// The corners of triangle `t`, mm.
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|v| self.vertices[v as usize])
    }

    /// Enclosed volume (divergence theorem), mm^3.
    pub fn volume_mm3(&self) -> f64 {
        (0..self.triangles.len())
            .map(|t| {
                let [a, b, c] = self.corners(t);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum()
    }

    /// The smallest box that holds all vertices.
    pub fn bounding_box(&self) -> BoundingBox {
        let mut min_mm = [f64::INFINITY; 3];
        let mut max_mm = [f64::NEG_INFINITY; 3];
        for v in &self.vertices {
            for i in 0..3 {
                min_mm[i] = min_mm[i].min(v[i]);
                max_mm[i] = max_mm[i].max(v[i]);
            }
        }
        BoundingBox { min_mm, max_mm }
    }

    /// The mesh with every vertex moved by `f`, which must keep orientation.
    pub fn mapped(&self, f: impl Fn(&Vec3) -> Vec3) -> Self {
        Self {
            vertices: self.vertices.iter().map(f).collect(),
            triangles: self.triangles.clone(),
        }
    }

    /// The mesh as a 32-bit file holds it: coordinates rounded, vertices that became equal merged.
    pub fn rounded(&self) -> Self {
        let mut index = HashMap::new();
        let mut vertices = Vec::new();
        let map: Vec<u32> = self
            .vertices
            .iter()
            .map(|v| {
                // Adding zero turns -0 into +0: the two compare equal but differ in bits.
                let r = [v.x as f32 + 0.0, v.y as f32 + 0.0, v.z as f32 + 0.0];
                *index.entry(r.map(f32::to_bits)).or_insert_with(|| {
                    vertices.push(Vec3::new(r[0].into(), r[1].into(), r[2].into()));
                    vertices.len() as u32 - 1
                })
            })
            .collect();
        let triangles = self
            .triangles
            .iter()
            .map(|t| t.map(|v| map[v as usize]))
            .collect();
        Self {
            vertices,
            triangles,
        }
    }

    /// Examines closedness, orientation, connectivity, volume and triangle shape.
    pub fn check(&self) -> MeshCheck {
        let mut directed: HashMap<(u32, u32), i32> = HashMap::new();
        for t in &self.triangles {
            for i in 0..3 {
                *directed.entry((t[i], t[(i + 1) % 3])).or_default() += 1;
            }
        }
        let unmatched_edges = directed
            .iter()
            .filter(|&(&(a, b), &n)| n != 1 || directed.get(&(b, a)) != Some(&1))
            .count();
        let fans = self.fans();
        let used = fans.iter().filter(|&&n| n > 0).count();
        let undirected = directed
            .keys()
            .filter(|&&(a, b)| a < b || !directed.contains_key(&(b, a)))
            .count();
        let angles = (0..self.triangles.len()).map(|t| min_angle(&self.corners(t)));
        MeshCheck {
            vertices: used,
            triangles: self.triangles.len(),
            unmatched_edges,
            pinched_vertices: fans.iter().filter(|&&n| n > 1).count(),
            degenerate_triangles: angles.clone().filter(|&a| a <= 0.0).count(),
            bodies: self.bodies(),
            euler_characteristic: used as i64 - undirected as i64 + self.triangles.len() as i64,
            volume_mm3: self.volume_mm3(),
            min_angle_deg: angles.fold(f64::INFINITY, f64::min).to_degrees(),
        }
    }

    /// For each vertex the number of separate fans that its triangles form.
    fn fans(&self) -> Vec<usize> {
        let mut next: Vec<HashMap<u32, u32>> = vec![HashMap::new(); self.vertices.len()];
        for t in &self.triangles {
            for i in 0..3 {
                next[t[i] as usize].insert(t[(i + 1) % 3], t[(i + 2) % 3]);
            }
        }
        next.into_iter()
            .map(|mut links| {
                let mut fans = 0;
                while let Some(&start) = links.keys().next() {
                    fans += 1;
                    let mut at = start;
                    while let Some(to) = links.remove(&at) {
                        at = to;
                    }
                }
                fans
            })
            .collect()
    }

    /// Number of connected pieces (union-find over triangles' vertices).
    fn bodies(&self) -> usize {
        let mut parent: Vec<u32> = (0..self.vertices.len() as u32).collect();
        fn root(parent: &mut [u32], mut v: u32) -> u32 {
            while parent[v as usize] != v {
                parent[v as usize] = parent[parent[v as usize] as usize];
                v = parent[v as usize];
            }
            v
        }
        for t in &self.triangles {
            let a = root(&mut parent, t[0]);
            for &v in &t[1..] {
                let b = root(&mut parent, v);
                parent[b as usize] = a;
            }
        }
        let mut roots: Vec<u32> = self
            .triangles
            .iter()
            .map(|t| root(&mut parent, t[0]))
            .collect();
        roots.sort_unstable();
        roots.dedup();
        roots.len()
    }
}

/// Minimum interior angle of a triangle, radians; zero where it has no area.
pub(super) fn min_angle(c: &[Vec3; 3]) -> f64 {
    let area = (c[1] - c[0]).cross(&(c[2] - c[0])).norm();
    (0..3)
        .map(|i| {
            let (p, q) = (c[(i + 1) % 3] - c[i], c[(i + 2) % 3] - c[i]);
            area.atan2(p.dot(&q))
        })
        .fold(f64::INFINITY, f64::min)
}
