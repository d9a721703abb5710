//! The coupon: rings to print before the stencil, to find the clearance that suits ball and
//! printer.
//!
//! Printers draw holes too small, by an amount that differs from one to the next, and balls of one
//! name differ in size. Each ring is the lowest part of a half shell with another clearance,
//! engraved with it in tenths of a millimeter: the clearance to use is the lowest number whose ring
//! takes the ball down to its equator without force.

use crate::error::Result;
use crate::geometry::Vec3;

use super::mesh::Mesh;
use super::solid::Solid;
use super::{StencilConfig, clean, marks, shapes};

/// Clearances of the rings, tenths of a millimeter.
const TENTHS: std::ops::RangeInclusive<u32> = 0..=5;
/// Rings in a row.
const IN_A_ROW: u32 = 3;
/// Height of a ring, mm, and its bound as a fraction of the ball's radius.
const HEIGHT: (f64, f64) = (6.0, 0.4);
/// Gap between rings, mm.
const GAP_MM: f64 = 4.0;

/// The rings as one mesh, side by side on the bed z = 0, rounded to 32-bit floats.
///
/// # Errors
/// [`crate::Error::Argument`] where a parameter is outside its domain; [`crate::Error::Internal`]
/// where a mesh fails its own checks.
pub fn coupon(config: &StencilConfig) -> Result<Mesh> {
    config.validate()?;
    let mut all = Mesh::default();
    let widest = f64::from(*TENTHS.end()) / 10.0;
    let pitch = config.ball_diameter_mm + 2.0 * (widest + config.wall_mm) + GAP_MM;
    for tenths in TENTHS {
        let ring = ring(tenths, config)?;
        let shift = Vec3::new(
            pitch * f64::from(tenths % IN_A_ROW),
            pitch * f64::from(tenths / IN_A_ROW),
            0.0,
        );
        let ring = ring.mapped(|v| v + shift).rounded();
        ring.check().require_solid("a ring of the coupon")?;
        let first = all.vertices.len() as u32;
        all.vertices.extend(ring.vertices);
        let triangles = ring.triangles.iter().map(|t| t.map(|v| v + first));
        all.triangles.extend(triangles);
    }
    Ok(all)
}

/// The ring with a clearance of `tenths` of a millimeter.
fn ring(tenths: u32, config: &StencilConfig) -> Result<Mesh> {
    let config = StencilConfig {
        clearance_mm: f64::from(tenths) / 10.0,
        ..config.clone()
    };
    let chord = config.chord_error_mm;
    let (inner, outer) = (config.inner_radius_mm(), config.outer_radius_mm());
    let height = HEIGHT.0.min(HEIGHT.1 * 0.5 * config.ball_diameter_mm);
    let far = 2.0 * outer;
    let segments = shapes::circle_segments(outer, chord);
    let below = [(-far, 0.0), (-far, far), (0.0, far), (0.0, 0.0)];
    let above = [(height, 0.0), (height, far), (far, far), (far, 0.0)];
    let tools = [
        shapes::sphere(inner, chord),
        shapes::revolve(&Vec3::z(), &below, segments),
        shapes::revolve(&Vec3::z(), &above, segments),
    ];
    let sine = 0.5 * height / outer;
    let front = Vec3::new(0.0, -(1.0 - sine * sine).sqrt(), sine);
    let mut tools: Vec<_> = tools.iter().map(Solid::new).collect::<Result<_>>()?;
    let words = marks::words_at(&front, 0.5 * height, &tenths.to_string(), &config)?;
    let floor = Solid::new(&marks::floor(&config))?;
    tools.push(Solid::new(&words)?.minus(&[floor])?);
    let body = Solid::new(&shapes::sphere(outer, chord))?;
    Ok(clean::cleaned(&body.minus(&tools)?.mesh(), 0.2 * chord))
}
