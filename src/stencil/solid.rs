//! Boolean operations on solids.
//!
//! They are Manifold's (E. Lalish), in its pure-Rust port: results stay closed whatever coincides,
//! because ties are broken by symbolic perturbation. Only this file depends on the library.

use manifold_rust::linalg::Vec2;
use manifold_rust::manifold::Manifold;
use manifold_rust::types::{Error as ManifoldError, MeshGL64, OpType};

use crate::error::{Error, Result};
use crate::geometry::Vec3;

use super::mesh::Mesh;

/// A closed solid.
#[derive(Clone)]
pub(super) struct Solid(Manifold);

impl Solid {
    /// The solid that `mesh` bounds.
    ///
    /// # Errors
    /// [`Error::Internal`] where the mesh is not closed.
    pub fn new(mesh: &Mesh) -> Result<Self> {
        let gl = MeshGL64 {
            num_prop: 3,
            vert_properties: mesh.vertices.iter().flat_map(|v| [v.x, v.y, v.z]).collect(),
            tri_verts: mesh
                .triangles
                .iter()
                .flatten()
                .map(|&v| u64::from(v))
                .collect(),
            ..MeshGL64::default()
        };
        Self(Manifold::from_mesh_gl64(&gl)).checked("a building block")
    }

    /// The prism over outlines in the plane (outer ones counter-clockwise, holes clockwise), from z
    /// = 0 to `height`.
    ///
    /// # Errors
    /// [`Error::Internal`] where the engine fails.
    pub fn extruded(outlines: &[Vec<(f64, f64)>], height: f64) -> Result<Self> {
        let section = outlines
            .iter()
            .map(|outline| outline.iter().map(|&(x, y)| Vec2::new(x, y)).collect())
            .collect();
        Self(Manifold::extrude(
            &section,
            height,
            0,
            0.0,
            Vec2::new(1.0, 1.0),
        ))
        .checked("a prism")
    }

    /// Passes the solid on unless the library flagged an error.
    fn checked(self, what: &str) -> Result<Self> {
        match self.0.status() {
            ManifoldError::NoError => Ok(self),
            e => Err(Error::Internal(format!("{what}: boolean engine: {e:?}"))),
        }
    }

    /// This solid without `others`.
    ///
    /// # Errors
    /// [`Error::Internal`] where the engine fails.
    pub fn minus(&self, others: &[Self]) -> Result<Self> {
        if others.is_empty() {
            return Ok(self.clone());
        }
        let parts: Vec<_> = others.iter().map(|s| s.0.clone()).collect();
        let tool = Manifold::batch_boolean(&parts, OpType::Add);
        Self(self.0.difference(&tool)).checked("difference")
    }

    /// What this solid and `other` share.
    ///
    /// # Errors
    /// [`Error::Internal`] where the engine fails.
    pub fn within(&self, other: &Self) -> Result<Self> {
        Self(self.0.intersection(&other.0)).checked("intersection")
    }

    /// This solid together with `others`.
    ///
    /// # Errors
    /// [`Error::Internal`] where the engine fails.
    pub fn plus(&self, others: &[Self]) -> Result<Self> {
        let mut parts = vec![self.clone()];
        parts.extend_from_slice(others);
        Self::union(&parts)
    }

    /// All of `parts` together.
    ///
    /// # Errors
    /// [`Error::Internal`] where the engine fails.
    pub fn union(parts: &[Self]) -> Result<Self> {
        let parts: Vec<_> = parts.iter().map(|s| s.0.clone()).collect();
        Self(Manifold::batch_boolean(&parts, OpType::Add)).checked("union")
    }

    /// Whether some of its triangles cut through each other (an exact test).
    pub fn self_intersects(&self) -> bool {
        self.0.has_self_intersections()
    }

    /// The boundary as a mesh.
    pub fn mesh(&self) -> Mesh {
        let gl = self.0.get_mesh_gl64(-1);
        Mesh {
            vertices: (0..gl.num_vert())
                .map(|i| Vec3::from(gl.get_vert_pos(i)))
                .collect(),
            triangles: gl
                .tri_verts
                .chunks_exact(3)
                .map(|t| [t[0] as u32, t[1] as u32, t[2] as u32])
                .collect(),
        }
    }
}
