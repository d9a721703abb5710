//! The printed pin of the hinge: a shaft with a head, whose split end snaps behind the last knuckle.
//!
//! It is printed lying, on a flat of its whole length. Inserting it bends each of the end's prongs by the
//! barb's height over the slot's length; with the defaults that strains the plastic by 1.5 %
//! (3 t d / 2 l^2 for a beam of thickness t, length l and deflection d at its end).

use crate::error::{Error, Result};
use crate::geometry::Vec3;

use super::joint::Joint;
use super::mesh::Mesh;
use super::solid::Solid;
use super::{StencilConfig, shapes};

/// Thickness of the head, mm.
const HEAD_MM: f64 = 1.6;
/// Play of the knuckles between head and barb, mm.
const PLAY_MM: f64 = 0.6;
/// Height of the barb above the shaft, and length of its cylinder and cone, mm.
const BARB_MM: f64 = 0.3;
const BARB_LENGTH_MM: [f64; 2] = [0.4, 1.8];
/// Length and width of the slot in the split end, mm.
const SLOT_MM: [f64; 2] = [6.0, 0.6];
/// Depth of the flat below the axis, as a part of the shaft's radius.
const FLAT: f64 = 0.7;

/// The pin for a stencil of this configuration, lying on the bed, its axis along x.
///
/// # Errors
/// [`Error::Argument`] as [`Joint::new`]; [`Error::Internal`] where the mesh fails its checks.
pub fn pin(config: &StencilConfig) -> Result<Mesh> {
    config.validate()?;
    let joint = Joint::new(config)?;
    let radius = 0.5 * config.screw_diameter_mm;
    let end = HEAD_MM + config.hinge_length_mm + PLAY_MM;
    let [cylinder, cone] = BARB_LENGTH_MM;
    let tip = end + cylinder + cone;
    let barb = radius + BARB_MM;
    let outline = [
        (0.0, 0.0),
        (0.0, joint.knuckle_radius_mm),
        (HEAD_MM, joint.knuckle_radius_mm),
        (HEAD_MM, radius),
        (end, radius),
        (end, barb),
        (end + cylinder, barb),
        (tip, 0.7 * radius),
        (tip, 0.0),
    ];
    let segments = shapes::circle_segments(joint.knuckle_radius_mm, config.chord_error_mm);
    let body = Solid::new(&shapes::revolve(&Vec3::x(), &outline, segments))?;
    let far = 2.0 * joint.knuckle_radius_mm;
    let bar = |[x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: [f64; 2]| {
        let polygon = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)];
        let kernel = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
        let axes = [&Vec3::x(), &Vec3::y()];
        Solid::new(&shapes::prism(&Vec3::zeros(), axes, &polygon, kernel, z))
    };
    let [length, width] = SLOT_MM;
    let slot_start = (end - length).max(HEAD_MM + radius);
    let slot = bar(
        [slot_start, tip + 1.0],
        [-0.5 * width, 0.5 * width],
        [-far, far],
    )?;
    let below = bar([-1.0, tip + 1.0], [-far, far], [-far, -FLAT * radius])?;
    let up = Vec3::new(0.0, 0.0, FLAT * radius);
    let mesh = body
        .minus(&[slot, below])?
        .mesh()
        .mapped(|v| v + up)
        .rounded();
    let check = mesh.check();
    check.require_solid("the pin")?;
    if check.genus() != 0 || Solid::new(&mesh)?.self_intersects() {
        return Err(Error::Internal("the pin: not one simple body".into()));
    }
    Ok(mesh)
}
