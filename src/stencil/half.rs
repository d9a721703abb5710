//! One half: its marks chosen, its solid built, cleaned and checked.

use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3};

use super::layout::{Cut, Layout};
use super::mesh::{Mesh, MeshCheck};
use super::segments::HalfCuts;
use super::solid::Solid;
use super::{Half, HalfName, Joint, Piece, StencilConfig, clean, marks, obstacles, parts};

/// How far cleaning may move the surface, as fractions of the chord error: tried in this order.
const CLEANING: [f64; 3] = [0.2, 0.05, 0.005];
/// Chord errors that are tried, as shares of the one asked for.
const FINENESS: [f64; 4] = [1.0, 0.9, 0.8, 0.7];
/// Directions in which a piece is laid on the bed, over half a turn: the one that takes the smallest square.
const TURNS: usize = 90;

/// The numbers to engrave in one half, and its holes (both in its own frame).
fn marks(
    layout: &Layout,
    name: HalfName,
    labels: &[String],
    cuts: Option<&HalfCuts>,
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
    let mut obstacles = obstacles::hinge_points(config, joint);
    if name == HalfName::A {
        obstacles.extend(obstacles::tab_points(config, joint));
    }
    let windows = layout.windows.iter().filter(|w| w.half == name);
    obstacles.extend(windows.flat_map(|w| w.points(config)));
    obstacles.extend(cuts.iter().flat_map(|cuts| cuts.points(config)));
    let around = marks::NumberSurroundings {
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
    let cuts = HalfCuts::choose(layout, name, config, joint)?;
    let marks = marks(layout, name, labels, cuts.as_ref(), config, joint)?;
    let mut outcome = Err(Error::Internal(format!(
        "{name}: no tessellation was tried"
    )));
    // Nearly coincident surfaces may make the mesh intersect itself; other facets may avoid that.
    // Where cleaning causes it, less cleaning may avoid it.
    for fineness in FINENESS {
        let tessellated = StencilConfig {
            chord_error_mm: fineness * config.chord_error_mm,
            ..config.clone()
        };
        let holes = layout.dots.iter().zip(&layout.cuts);
        let windows = layout.windows.iter().filter(|w| w.half == name);
        outcome = tried(
            &parts::Shell {
                config: &tessellated,
                joint,
                name,
                holes: holes
                    .map(|(d, cuts)| (name.own_frame(d), cuts[name as usize]))
                    .collect(),
                windows: windows
                    .map(|w| (name.own_frame(&w.axis), w.radius_mm))
                    .collect(),
                marks: marks.tools.clone(),
                cuts: cuts.as_ref(),
            },
            config,
        );
        if outcome.is_ok() {
            break;
        }
    }
    outcome.map(|half| Half {
        numbers: marks.numbers,
        unnumbered: marks.left_out,
        labels: marks.labels,
        ..half
    })
}

/// A half with these facets, on the bed and checked; what is engraved is not told yet.
fn tried(part: &parts::Shell<'_>, config: &StencilConfig) -> Result<Half> {
    let up = Vec3::new(0.0, 0.0, part.joint.lip_mm);
    let solid = part.solid()?;
    let (mesh, check) = finished(&solid.mesh().mapped(|v| v + up), config, |mesh| {
        checked(mesh, &part.name.to_string(), part.through_holes())
    })?;
    Ok(Half {
        mesh,
        check,
        through_holes: part.through_holes(),
        pieces: pieces(&solid, part, up)?,
        screws: part.cuts.map_or(0, |cuts| cuts.screw_count(config)),
        numbers: Vec::new(),
        unnumbered: Vec::new(),
        labels: Vec::new(),
    })
}

/// The pieces of a half, each as it is printed; none of a half that stays whole.
fn pieces(solid: &Solid, part: &parts::Shell<'_>, up: Vec3) -> Result<Vec<Piece>> {
    let Some(cuts) = part.cuts else {
        return Ok(Vec::new());
    };
    let piece = |(k, wedge): (usize, Mesh)| {
        let raw = solid.within(&Solid::new(&wedge)?)?.mesh();
        let (turn_rad, raw) = laid(&raw.mapped(|v| v + up));
        let through_holes = part.through_holes_of(k, cuts);
        let name = format!("piece {} of {}", k + 1, part.name);
        let (mesh, check) = finished(&raw, part.config, |mesh| {
            checked(mesh, &name, through_holes)
        })?;
        Ok(Piece {
            mesh,
            check,
            through_holes,
            turn_rad,
        })
    };
    cuts.wedges().into_iter().enumerate().map(piece).collect()
}

/// The mesh turned about z so that it takes the smallest square, and the turn.
fn laid(mesh: &Mesh) -> (f64, Mesh) {
    let turned = |angle: f64| {
        let turn = Rotation::from_axis_angle(&Vec3::z_axis(), angle);
        mesh.mapped(|v| turn * v)
    };
    let sides = (0..TURNS).map(|k| {
        let angle = std::f64::consts::PI * k as f64 / TURNS as f64;
        let bounds = turned(angle).bounding_box();
        let [x, y] = [0, 1].map(|i| bounds.max_mm[i] - bounds.min_mm[i]);
        (x.max(y), angle)
    });
    let smallest = sides.min_by(|a, b| a.0.total_cmp(&b.0));
    let angle = smallest.map_or(0.0, |(_, angle)| angle);
    (angle, turned(angle))
}

/// `raw` without slivers and rounded, and what `check` says of it: cleaned as much as passes.
fn finished(
    raw: &Mesh,
    config: &StencilConfig,
    check: impl Fn(&Mesh) -> Result<MeshCheck>,
) -> Result<(Mesh, MeshCheck)> {
    let mut outcome = Err(Error::Internal("no cleaning was tried".into()));
    for share in CLEANING {
        let mesh = clean::cleaned(raw, share * config.chord_error_mm).rounded();
        outcome = check(&mesh).map(|check| (mesh, check));
        if outcome.is_ok() {
            break;
        }
    }
    outcome
}

/// What is found of a mesh with so many through-holes, if it passes all checks.
fn checked(mesh: &Mesh, name: &str, through_holes: usize) -> Result<MeshCheck> {
    let check = mesh.check();
    check.require_solid(name)?;
    if check.genus() != through_holes as i64 {
        return Err(Error::Internal(format!(
            "{name}: expected {through_holes} through-holes, found {}",
            check.genus()
        )));
    }
    if Solid::new(mesh)?.self_intersects() {
        return Err(Error::Internal(format!(
            "{name}: the surface intersects itself"
        )));
    }
    Ok(check)
}
