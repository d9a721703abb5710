//! One half: its marks chosen, its solid built, cleaned and checked.

use crate::error::{Error, Result};
use crate::geometry::Vec3;

use super::layout::{self, Cut, Layout};
use super::mesh::Mesh;
use super::solid::Solid;
use super::{Half, HalfName, Joint, StencilConfig, clean, marks, parts};

/// How far cleaning may move the surface, as fractions of the chord error: tried in this order.
const CLEANING: [f64; 3] = [0.2, 0.05, 0.005];
/// Chord errors that are tried, as shares of the one asked for.
const FINENESS: [f64; 4] = [1.0, 0.9, 0.8, 0.7];

/// The numbers to engrave in one half, and its holes (both in its own frame).
fn marks(
    layout: &Layout,
    name: HalfName,
    labels: &[String],
    config: &StencilConfig,
    joint: &Joint,
) -> Result<marks::Marks> {
    let mut numbered = Vec::new();
    let mut holes = Vec::new();
    for (i, (dot, cuts)) in layout.dots.iter().zip(&layout.cuts).enumerate() {
        if cuts[name as usize] != Cut::None {
            holes.push(name.own_frame(dot));
        }
        if config.numbers && name.holds(dot.z) {
            numbered.push((i, name.own_frame(dot)));
        }
    }
    let mut obstacles = layout::hinge_points(config, joint);
    if name == HalfName::A {
        obstacles.extend(layout::tab_points(config, joint));
    }
    let windows = layout.windows.iter().filter(|w| w.half == name);
    obstacles.extend(windows.flat_map(|w| w.points(config)));
    let around = marks::Surroundings {
        holes: &holes,
        obstacles: &obstacles,
    };
    let mut marks = marks::numbers(&numbered, &around, config, joint)?;
    if config.numbers {
        for zone in layout.closed.iter().filter(|z| name.holds(z.axis.z)) {
            marks.add_arrow(&name.own_frame(&zone.axis), &around, config, joint)?;
        }
        marks.add_labels(labels, &around, config, joint)?;
    }
    Ok(marks)
}

/// Builds one half, lays it on the bed and checks it.
pub(super) fn build(
    layout: &Layout,
    name: HalfName,
    labels: &[String],
    config: &StencilConfig,
    joint: &Joint,
) -> Result<Half> {
    let marks = marks(layout, name, labels, config, joint)?;
    let up = Vec3::new(0.0, 0.0, joint.lip_mm);
    let mut outcome = Err(Error::Internal(format!(
        "{name}: no tessellation was tried"
    )));
    // Nearly coincident surfaces may make the mesh intersect itself; other facets may avoid that.
    // Where cleaning causes it, less cleaning may avoid it.
    'tried: for fineness in FINENESS {
        let tessellated = StencilConfig {
            chord_error_mm: fineness * config.chord_error_mm,
            ..config.clone()
        };
        let part = parts::Shell {
            config: &tessellated,
            joint,
            name,
            holes: layout
                .dots
                .iter()
                .map(|d| name.own_frame(d))
                .zip(layout.cuts.iter().map(|c| c[name as usize]))
                .collect(),
            windows: layout
                .windows
                .iter()
                .filter(|w| w.half == name)
                .map(|w| (name.own_frame(&w.axis), w.radius_mm))
                .collect(),
            marks: marks.tools.clone(),
        };
        let raw = part.solid()?.mesh().mapped(|v| v + up);
        for share in CLEANING {
            let mesh = clean::cleaned(&raw, share * config.chord_error_mm).rounded();
            outcome = checked(mesh, name, part.through_holes());
            if outcome.is_ok() {
                break 'tried;
            }
        }
    }
    outcome.map(|half| Half {
        numbers: marks.numbers,
        unnumbered: marks.left_out,
        labels: marks.labels,
        ..half
    })
}

/// The half with this mesh, if it passes all checks.
fn checked(mesh: Mesh, name: HalfName, through_holes: usize) -> Result<Half> {
    let check = mesh.check();
    check.require_solid(&name.to_string())?;
    if check.genus() != through_holes as i64 {
        return Err(Error::Internal(format!(
            "{name}: expected {through_holes} through-holes, found {}",
            check.genus()
        )));
    }
    if Solid::new(&mesh)?.self_intersects() {
        return Err(Error::Internal(format!(
            "{name}: the surface intersects itself"
        )));
    }
    Ok(Half {
        mesh,
        check,
        through_holes,
        numbers: Vec::new(),
        unnumbered: Vec::new(),
        labels: Vec::new(),
    })
}
