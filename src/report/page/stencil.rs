//! The stencil of a design's page, from its folder.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::mesh::PageMesh;
use super::rounded;
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::Vec3;
use crate::report::folder::{parsed, same_pattern};
use crate::stencil::{Mesh, StencilConfig};

/// The parts of `stencil.json` that the page shows.
#[derive(Debug, Deserialize)]
struct StencilFile {
    pattern_sha256: String,
    rotation_pattern_to_stencil: Quaternion,
    seam: SeamPart,
    dots: Vec<Value>,
    half_a: HalfPart,
    half_b: HalfPart,
    parameters: Value,
    joint: JointPart,
    print_size_mm: Option<[f64; 3]>,
    #[serde(default)]
    beds: Vec<Value>,
}

#[derive(Debug, Deserialize)]
struct Quaternion {
    qw: f64,
    qx: f64,
    qy: f64,
    qz: f64,
}

#[derive(Debug, Deserialize)]
struct SeamPart {
    normal_pattern_frame: [f64; 3],
    min_dot_latitude_deg: f64,
}

#[derive(Debug, Deserialize)]
struct JointPart {
    axis_mm: f64,
    lip_mm: f64,
}

#[derive(Debug, Deserialize)]
struct HalfPart {
    file: String,
    check: CheckPart,
}

#[derive(Debug, Deserialize)]
struct CheckPart {
    volume_mm3: f64,
}

/// The stencil in a page.
#[derive(Debug, Serialize)]
pub(super) struct PageStencil {
    halves: [PageMesh; 2],
    boxes: [[f64; 3]; 2],
    volumes_mm3: [f64; 2],
    rotation_wxyz: [f64; 4],
    seam_normal: [f64; 3],
    seam_margin_deg: f64,
    axis_mm: f64,
    lip_mm: f64,
    dots: Vec<Value>,
    pub parameters: Value,
    /// Radius of the engraving's floor, mm.
    engraving_radius_mm: f64,
    /// Space that a half or piece takes on the bed, where the file says it, and beds that have it.
    print_size_mm: Option<[f64; 3]>,
    beds: Vec<Value>,
}

impl PageStencil {
    /// The stencil in `dir`, where there is one.
    pub fn read(dir: &Path, sha256: &str) -> Result<Option<Self>> {
        let path = dir.join("stencil.json");
        if !path.exists() {
            return Ok(None);
        }
        let file: StencilFile = parsed(&path)?;
        same_pattern(&path, "pattern_sha256", &file.pattern_sha256, sha256)?;
        let mesh = |half: &HalfPart| read_stl(&dir.join(&half.file));
        let [a, b] = [mesh(&file.half_a)?, mesh(&file.half_b)?];
        let sides = |m: &Mesh| {
            let bounds = m.bounding_box();
            [0, 1, 2].map(|i| rounded(bounds.max_mm[i] - bounds.min_mm[i]))
        };
        let number = |name: &str| {
            let found = file.parameters.get(name).and_then(Value::as_f64);
            found.ok_or_else(|| Error::input(&path, name, "expected a number"))
        };
        let config = StencilConfig {
            ball_diameter_mm: number("ball_diameter_mm")?,
            clearance_mm: number("clearance_mm")?,
            wall_mm: number("wall_mm")?,
            ..StencilConfig::default()
        };
        let q = &file.rotation_pattern_to_stencil;
        Ok(Some(Self {
            boxes: [sides(&a), sides(&b)],
            halves: [PageMesh::new(&a), PageMesh::new(&b)],
            volumes_mm3: [file.half_a.check.volume_mm3, file.half_b.check.volume_mm3],
            rotation_wxyz: [q.qw, q.qx, q.qy, q.qz],
            seam_normal: file.seam.normal_pattern_frame,
            seam_margin_deg: file.seam.min_dot_latitude_deg,
            axis_mm: file.joint.axis_mm,
            lip_mm: file.joint.lip_mm,
            dots: file.dots,
            engraving_radius_mm: config.engraving_radius_mm(),
            parameters: file.parameters,
            print_size_mm: file.print_size_mm,
            beds: file.beds,
        }))
    }
}

/// The mesh in a binary STL file.
fn read_stl(path: &Path) -> Result<Mesh> {
    let bytes = files::read_bytes(path)?;
    let stl = stl_io::read_stl(&mut std::io::Cursor::new(bytes))
        .map_err(|e| Error::input(path, "file", format!("expected a binary STL: {e}")))?;
    let vertex = |v: &stl_io::Vertex| Vec3::from(v.0.map(f64::from));
    Ok(Mesh {
        vertices: stl.vertices.iter().map(vertex).collect(),
        triangles: stl
            .faces
            .iter()
            .map(|f| f.vertices.map(|v| v as u32))
            .collect(),
    })
}
