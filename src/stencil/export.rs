//! The stencil's files: binary STL, 3MF and a JSON description.

use std::io::Cursor;
use std::path::Path;

use serde_json::json;
use threemf::model::{Build, Item, Metadata, Model, Object, Resources};

use crate::error::{Error, Result};
use crate::files;

use super::{HoleSide, Mesh, Stencil};

/// Gap between the two halves in the 3MF file, mm.
const LAYOUT_GAP_MM: f64 = 5.0;

impl Stencil {
    /// Writes `half_a.stl`, `half_b.stl`, `stencil.3mf` and `stencil.json` to `dir`, which is made if
    /// it does not exist. Each file appears whole or not at all.
    ///
    /// # Errors
    /// [`Error::Write`] where the system refuses.
    pub fn write(&self, dir: &Path) -> Result<()> {
        files::create_dir(dir)?;
        for (half, name) in self.halves.iter().zip(["half_a.stl", "half_b.stl"]) {
            files::write_bytes(&dir.join(name), &stl_bytes(&half.mesh)?)?;
        }
        files::write_bytes(&dir.join("stencil.3mf"), &self.threemf_bytes()?)?;
        let mut text = serde_json::to_string_pretty(&self.description())
            .map_err(|e| Error::Internal(e.to_string()))?;
        text.push('\n');
        files::write_bytes(&dir.join("stencil.json"), text.as_bytes())
    }

    /// What `stencil.json` holds: parameters, frames, dots' halves, and each half's figures.
    pub fn description(&self) -> serde_json::Value {
        let q = self.layout.rotation.quaternion();
        let indices = |side: HoleSide| -> Vec<usize> {
            (0..self.sides.len())
                .filter(|&i| self.sides[i] == side)
                .collect()
        };
        let half = |i: usize| {
            let h = &self.halves[i];
            let file = ["half_a.stl", "half_b.stl"][i];
            json!({
                "file": file,
                "check": h.check,
                "bounding_box": h.mesh.bounding_box(),
            })
        };
        json!({
            "format_version": 1,
            "spindoe_version": env!("CARGO_PKG_VERSION"),
            "pattern_sha256": self.pattern_sha256,
            "parameters": self.config,
            "joint": self.joint,
            "rotation_pattern_to_stencil": {
                "qw": q.w, "qx": q.i, "qy": q.j, "qz": q.k,
                "meaning": "stencil = R * pattern; origin at the ball's centre; seam in z = 0; \
                            half A is z > 0; half B is printed turned by 180 degrees about x",
            },
            "seam": {
                "normal_pattern_frame": self.layout.seam.normal.as_slice(),
                "least_dot_latitude_deg": self.layout.seam.margin_rad.to_degrees(),
            },
            "dots_in_half_a": indices(HoleSide::A),
            "dots_in_half_b": indices(HoleSide::B),
            "dots_through_both_rims": indices(HoleSide::Both),
            "half_a": half(0),
            "half_b": half(1),
        })
    }

    /// One 3MF model with both halves as named objects, side by side.
    fn threemf_bytes(&self) -> Result<Vec<u8>> {
        let tag = &self.pattern_sha256[..8.min(self.pattern_sha256.len())];
        let mut object = Vec::new();
        let mut item = Vec::new();
        let mut x = 0.0;
        for (i, half) in self.halves.iter().enumerate() {
            let bounds = half.mesh.bounding_box();
            let shift = x - bounds.min_mm[0];
            x += bounds.max_mm[0] - bounds.min_mm[0] + LAYOUT_GAP_MM;
            object.push(Object {
                id: i + 1,
                name: Some(format!("stencil {tag} half {}", ["A", "B"][i])),
                mesh: Some(threemf_mesh(&half.mesh, shift)),
                ..Object::default()
            });
            item.push(Item {
                objectid: i + 1,
                transform: None,
                partnumber: None,
            });
        }
        let model = Model {
            metadata: vec![Metadata {
                name: "Title".into(),
                value: Some(format!("Ball stencil for pattern {}", self.pattern_sha256)),
            }],
            resources: Resources {
                object,
                basematerials: None,
            },
            build: Build { item },
            ..Model::default()
        };
        let mut bytes = Cursor::new(Vec::new());
        threemf::write(&mut bytes, model).map_err(|e| Error::Internal(e.to_string()))?;
        Ok(bytes.into_inner())
    }
}

/// A mesh as the 3MF library holds it, moved along x by `shift_mm`.
fn threemf_mesh(mesh: &Mesh, shift_mm: f64) -> threemf::Mesh {
    let vertex = mesh.vertices.iter().map(|v| threemf::model::Vertex {
        x: v.x + shift_mm,
        y: v.y,
        z: v.z,
    });
    let triangle = mesh.triangles.iter().map(|t| threemf::model::Triangle {
        v1: t[0] as usize,
        v2: t[1] as usize,
        v3: t[2] as usize,
    });
    threemf::Mesh {
        vertices: threemf::model::Vertices {
            vertex: vertex.collect(),
        },
        triangles: threemf::model::Triangles {
            triangle: triangle.collect(),
        },
    }
}

/// A mesh as binary STL.
pub(super) fn stl_bytes(mesh: &Mesh) -> Result<Vec<u8>> {
    let vector =
        |v: &nalgebra::Vector3<f64>| stl_io::Vector::new([v.x as f32, v.y as f32, v.z as f32]);
    let triangles: Vec<_> = (0..mesh.triangles.len())
        .map(|t| {
            let corners = mesh.corners(t);
            let normal = (corners[1] - corners[0])
                .cross(&(corners[2] - corners[0]))
                .try_normalize(0.0)
                .unwrap_or_default();
            stl_io::Triangle {
                normal: vector(&normal),
                vertices: corners.each_ref().map(vector),
            }
        })
        .collect();
    let mut bytes = Vec::new();
    stl_io::write_stl(&mut bytes, triangles.iter()).map_err(|e| Error::Internal(e.to_string()))?;
    Ok(bytes)
}
