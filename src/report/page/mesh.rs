//! Meshes in a page: corners on a grid of 65 535 steps along each side of their box, as base64.

use std::collections::HashMap;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use crate::stencil::Mesh;

/// Steps of the grid along each side of the box: under 1 um for a shell of 60 mm.
const STEPS: f64 = 65535.0;

/// A mesh for a page.
#[derive(Debug, Serialize)]
pub(super) struct PageMesh {
    /// Lowest corner of its box, mm.
    low: [f64; 3],
    /// Sides of its box, mm.
    size: [f64; 3],
    /// Corners, three u16 each, little-endian.
    places: String,
    /// Triangles, three u32 each, little-endian, counter-clockwise from outside.
    triangles: String,
}

impl PageMesh {
    /// The mesh with corners that coincide joined.
    pub fn new(mesh: &Mesh) -> Self {
        let bounds = mesh.bounding_box();
        let low = bounds.min_mm;
        let size = [0, 1, 2].map(|i| (bounds.max_mm[i] - low[i]).max(1e-9));
        let mut index: HashMap<[u16; 3], u32> = HashMap::new();
        let mut places: Vec<u8> = Vec::new();
        let joined: Vec<u32> = mesh
            .vertices
            .iter()
            .map(|v| {
                let key = [0, 1, 2].map(|i| ((v[i] - low[i]) / size[i] * STEPS).round() as u16);
                let next = index.len() as u32;
                *index.entry(key).or_insert_with(|| {
                    places.extend(key.iter().flat_map(|c| c.to_le_bytes()));
                    next
                })
            })
            .collect();
        let triangles: Vec<u8> = mesh
            .triangles
            .iter()
            .map(|t| t.map(|v| joined[v as usize]))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .flatten()
            .flat_map(u32::to_le_bytes)
            .collect();
        Self {
            low,
            size,
            places: STANDARD.encode(places),
            triangles: STANDARD.encode(triangles),
        }
    }
}
