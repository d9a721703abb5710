//! The stencil's files: binary STL, 3MF and a JSON description.

#[cfg(feature = "native")]
use std::path::Path;

use serde_json::json;

use crate::error::{Error, Result};
#[cfg(feature = "native")]
use crate::files;

#[cfg(feature = "native")]
use super::Closure;
use super::config::degrees;
use super::{HalfName, HoleSide, Mesh, Stencil, segments, threemf};

/// Gap between the two halves in the 3MF file, mm.
const LAYOUT_GAP_MM: f64 = 5.0;

/// Names of the halves' files.
const HALF_FILES: [&str; 2] = ["half_a.stl", "half_b.stl"];
/// Version of `stencil.json`.
const FORMAT_VERSION: u32 = 1;
/// First bytes of an STL file's header.
const STL_HEADER: &str = "spindoe pattern";
/// How the frames are related, in words.
const FRAMES: &str = "stencil = R * pattern, R the unit quaternion given; millimeters, origin in the \
    ball's center, seam in z = 0, half A in z > 0, hinge axis along y through (axis_mm, 0, 0), thumb tab \
    towards -x. A point (x, y, z) of half_a.stl lies at (x, y, z - lip_mm), a point of half_b.stl at \
    (x, -y, lip_mm - z).";

impl Stencil {
    /// Writes `half_a.stl`, `half_b.stl`, `stencil.3mf` and `stencil.json` to `dir`, which is made
    /// if it does not exist, `pin.stl` for a hinge that has one, and `half_a_1.stl` and so on for halves
    /// that are cut into pieces. Each file is written atomically.
    ///
    /// # Errors
    /// [`Error::Write`] where the system refuses.
    #[cfg(feature = "native")]
    pub fn write(&self, dir: &Path) -> Result<()> {
        files::create_dir(dir)?;
        for (half, name) in HalfName::BOTH.into_iter().zip(HALF_FILES) {
            files::write_bytes(&dir.join(name), &self.half_stl_bytes(half)?)?;
        }
        for half in HalfName::BOTH {
            for k in 0..segments::MAX_PIECES {
                let path = dir.join(piece_file(half, k));
                match self.half(half).pieces.get(k) {
                    Some(piece) => files::write_bytes(&path, &self.stl_bytes(&piece.mesh)?)?,
                    // That of a stencil which is replaced.
                    None => files::remove_if_present(&path)?,
                }
            }
        }
        let pin = dir.join("pin.stl");
        match self.config.closure {
            Closure::Pin => files::write_bytes(&pin, &stl_bytes(&super::pin(&self.config)?)?)?,
            // That of a stencil which is replaced.
            Closure::Screw => files::remove_if_present(&pin)?,
        }
        files::write_bytes(&dir.join("stencil.3mf"), &self.threemf_bytes()?)?;
        let mut text = serde_json::to_string_pretty(&self.description()?)
            .map_err(|e| Error::Internal(e.to_string()))?;
        text.push('\n');
        files::write_bytes(&dir.join("stencil.json"), text.as_bytes())
    }

    /// What `stencil.json` holds (angles in degrees): parameters, frames, where each dot lies, and
    /// what each half's check found.
    pub fn description(&self) -> Result<serde_json::Value> {
        let q = self.layout.rotation.quaternion();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        let indices = |side: HoleSide| -> Vec<usize> {
            (0..self.sides.len())
                .filter(|&i| self.sides[i] == side)
                .collect()
        };
        let dots = self.layout.dots.iter().zip(&self.sides).enumerate();
        let dots = dots.map(|(i, (d, side))| {
            json!({
                "dot": i,
                "half": if d.z > 0.0 { "a" } else { "b" },
                "through_both_rims": *side == HoleSide::Both,
                "latitude_deg": d.z.clamp(-1.0, 1.0).asin().to_degrees(),
                "azimuth_deg": d.y.atan2(d.x).to_degrees(),
            })
        });
        Ok(json!({
            "format_version": FORMAT_VERSION,
            "spindoe_version": env!("CARGO_PKG_VERSION"),
            "pattern_sha256": self.pattern_sha256,
            "frames": FRAMES,
            "rotation_pattern_to_stencil": {
                "qw": sign * q.w, "qx": sign * q.i, "qy": sign * q.j, "qz": sign * q.k,
            },
            "seam": {
                "normal_pattern_frame": self.layout.seam.normal.as_slice(),
                "min_dot_latitude_deg": self.layout.seam.margin_rad.to_degrees(),
                "wanted_deg": degrees(self.config.seam_margin_rad),
            },
            "hinge_to_nearest_hole_mm": self.layout.clearance_mm,
            "dots_in_half_a": indices(HoleSide::A),
            "dots_in_half_b": indices(HoleSide::B),
            "dots_through_both_rims": indices(HoleSide::Both),
            "dots": dots.collect::<Vec<_>>(),
            "print_size_mm": self.print_size_mm(),
            "beds": self.beds().collect::<Vec<_>>(),
            "windows": self.layout.windows,
            "zones_without_window": self.layout.closed,
            "half_a": self.half_description(0),
            "half_b": self.half_description(1),
            "parameters": self.parameters()?,
            "joint": self.joint,
        }))
    }

    fn half_description(&self, i: usize) -> serde_json::Value {
        let half = &self.halves[i];
        let pieces = half.pieces.iter().enumerate().map(|(k, piece)| {
            json!({
                "file": piece_file(HalfName::BOTH[i], k),
                "turn_deg": degrees(piece.turn_rad),
                "check": piece.check,
                "through_holes": piece.through_holes,
                "bounding_box": piece.mesh.bounding_box(),
            })
        });
        json!({
            "file": HALF_FILES[i],
            "check": half.check,
            "through_holes": half.through_holes,
            "numbers": half.numbers,
            "unnumbered_dots": half.unnumbered,
            "labels": half.labels,
            "bounding_box": half.mesh.bounding_box(),
            "pieces": pieces.collect::<Vec<_>>(),
            "screws": half.screws,
        })
    }

    /// The configuration as files and the command give it: angles in degrees.
    fn parameters(&self) -> Result<serde_json::Value> {
        let internal = |e: serde_json::Error| Error::Internal(e.to_string());
        let mut value = serde_json::to_value(&self.config).map_err(internal)?;
        if let Some(fields) = value.as_object_mut() {
            for (name, angle) in [
                ("taper", self.config.taper_rad),
                ("seam_margin", self.config.seam_margin_rad),
            ] {
                fields.remove(&format!("{name}_rad"));
                fields.insert(format!("{name}_deg"), json!(degrees(angle)));
            }
        }
        Ok(value)
    }

    /// A half as binary STL, millimeters, whose header names the pattern.
    ///
    /// # Errors
    /// [`Error::Internal`] where the mesh cannot be encoded.
    pub fn half_stl_bytes(&self, name: HalfName) -> Result<Vec<u8>> {
        self.stl_bytes(&self.half(name).mesh)
    }

    fn stl_bytes(&self, mesh: &Mesh) -> Result<Vec<u8>> {
        let mut bytes = stl_bytes(mesh)?;
        // 80 bytes: the hash takes 64 of them. A binary file must not begin with "solid".
        let header = format!("{STL_HEADER:<16}{:.64}", self.pattern_sha256);
        for (byte, &c) in bytes[..80].iter_mut().zip(header.as_bytes()) {
            *byte = c;
        }
        Ok(bytes)
    }

    /// One 3MF model with both halves, or their pieces, as named objects, side by side.
    ///
    /// # Errors
    /// [`Error::Internal`] where the archive cannot be packed.
    pub fn threemf_bytes(&self) -> Result<Vec<u8>> {
        let tag = &self.pattern_sha256[..8.min(self.pattern_sha256.len())];
        let mut x = 0.0;
        let mut objects = Vec::new();
        for name in HalfName::BOTH {
            let half = self.half(name);
            for (k, mesh) in half.printed().into_iter().enumerate() {
                let bounds = mesh.bounding_box();
                let shift_mm = x - bounds.min_mm[0];
                x += bounds.max_mm[0] - bounds.min_mm[0] + LAYOUT_GAP_MM;
                let piece = match half.pieces.len() {
                    0 => String::new(),
                    count => format!(", piece {} of {count}", k + 1),
                };
                objects.push(threemf::Object {
                    name: format!("stencil {tag} {name}{piece}"),
                    mesh,
                    shift_mm,
                });
            }
        }
        let title = format!("Ball stencil for pattern {}", self.pattern_sha256);
        threemf::package(&title, &objects)
    }
}

/// Name of the file of a half's piece.
fn piece_file(half: HalfName, piece: usize) -> String {
    let half = match half {
        HalfName::A => "a",
        HalfName::B => "b",
    };
    format!("half_{half}_{}.stl", piece + 1)
}

/// Names of the files of all pieces that there can be.
pub fn piece_files() -> Vec<String> {
    let halves = HalfName::BOTH.into_iter();
    halves
        .flat_map(|half| (0..segments::MAX_PIECES).map(move |k| piece_file(half, k)))
        .collect()
}

/// A mesh as binary STL, millimeters.
///
/// # Errors
/// [`Error::Internal`] where the library fails.
pub fn stl_bytes(mesh: &Mesh) -> Result<Vec<u8>> {
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
