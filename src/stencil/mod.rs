//! The stencil: two printable half shells that close around a ball, with a hole for each dot.
//!
//! Method: the pattern is turned so that the great circle farthest from all dots ([`max_margin_seam`])
//! along which hinge and thumb tab find room lies in the plane z = 0 of the *stencil frame*. The shell
//! between two spheres is parted there into half A (z > 0) and half B (z < 0), whose rims overlap by a
//! narrow band and meet in a cone ([`Joint`]); a tapered tool is subtracted for each dot by mesh
//! booleans. A dot near the seam leaves matching holes in both rims. Slivers are removed, and each half
//! is checked as one closed, oriented 2-manifold that does not cut itself and has exactly the expected
//! holes, after rounding to the 32-bit floats of STL; it is handed over rim down.
//!
//! Frames: `stencil = rotation * pattern`, origin at the ball's center, hinge towards +x with its axis
//! along y, thumb tab towards -x. Half A is laid as it is; half B is turned by half a turn about x (y and
//! z change sign). Both are then raised by the lip's height, so that the bed is z = 0.

mod clean;
mod config;
pub mod coupon;
mod export;
mod joint;
mod layout;
mod marks;
mod mesh;
mod parts;
mod seam;
pub mod shapes;
mod solid;

pub use config::StencilConfig;
pub use export::stl_bytes;
pub use joint::Joint;
pub use mesh::{BoundingBox, Mesh, MeshCheck};
pub use seam::{Seam, max_margin_seam};

use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3, angle_between};
use crate::pattern::Pattern;
use layout::{Cut, Layout, turn_over};
use solid::Solid;

/// How far cleaning may move the surface, as fractions of the chord error: tried in this order.
const CLEANING: [f64; 3] = [0.2, 0.05, 0.005];
/// Chord errors that are tried, as shares of the one asked for.
const FINENESS: [f64; 4] = [1.0, 0.9, 0.8, 0.7];

/// In which half a dot's hole lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HoleSide {
    /// Wholly in half A (z > 0 in the stencil frame).
    A,
    /// Wholly in half B.
    B,
    /// Through the band where the rims overlap: it cuts both halves.
    Both,
}

/// One printable half, rim down on the bed, the plane z = 0.
#[derive(Debug, Clone)]
pub struct Half {
    /// The mesh, mm, already rounded to 32-bit floats.
    pub mesh: Mesh,
    /// What was found when it was checked.
    pub check: MeshCheck,
    /// Holes that lead through it: those of dots, and the bores of its knuckles.
    pub through_holes: usize,
    /// Dots of this half beside whose hole there was no room for the number.
    pub unnumbered: Vec<usize>,
}

/// A stencil for one pattern.
#[derive(Debug, Clone)]
pub struct Stencil {
    config: StencilConfig,
    joint: Joint,
    pattern_sha256: String,
    layout: Layout,
    sides: Vec<HoleSide>,
    halves: [Half; 2],
}

impl Stencil {
    /// Refuses a pattern that leaves no room for the stencil's holes, rims, hinge or tab. Builds nothing,
    /// which takes thousands of times longer.
    ///
    /// # Errors
    /// [`Error::Argument`] as [`Stencil::build`].
    pub fn check(pattern: &Pattern, config: &StencilConfig) -> Result<()> {
        config.validate()?;
        let joint = Joint::new(config)?;
        refuse_overlaps(pattern.dots(), config)?;
        Layout::choose(pattern.dots(), config, &joint).map(|_| ())
    }

    /// Designs the stencil of `pattern`.
    ///
    /// # Errors
    /// [`Error::Argument`] where a parameter is outside its domain or the geometry cannot work (with
    /// the figure that fails); [`Error::Internal`] where a mesh fails its own checks.
    pub fn build(pattern: &Pattern, config: &StencilConfig) -> Result<Self> {
        config.validate()?;
        let joint = Joint::new(config)?;
        refuse_overlaps(pattern.dots(), config)?;
        let layout = Layout::choose(pattern.dots(), config, &joint)?;
        let sides = layout.dots.iter().zip(&layout.cuts).map(|(d, cuts)| {
            if !cuts.contains(&Cut::None) {
                HoleSide::Both
            } else if d.z > 0.0 {
                HoleSide::A
            } else {
                HoleSide::B
            }
        });
        let sides = sides.collect();
        let a = half(&layout, true, config, &joint)?;
        let b = half(&layout, false, config, &joint)?;
        Ok(Self {
            config: config.clone(),
            joint,
            pattern_sha256: pattern.sha256(),
            layout,
            sides,
            halves: [a, b],
        })
    }

    /// The parameters it was built with.
    pub fn config(&self) -> &StencilConfig {
        &self.config
    }

    /// Lengths of rims and hinge.
    pub fn joint(&self) -> &Joint {
        &self.joint
    }

    /// The rotation from the pattern's frame to the stencil's.
    pub fn rotation(&self) -> Rotation {
        self.layout.rotation
    }

    /// The dots in the stencil's frame, in the pattern's order.
    pub fn dots(&self) -> &[Vec3] {
        &self.layout.dots
    }

    /// The seam's great circle, in the pattern's frame.
    pub fn seam(&self) -> Seam {
        self.layout.seam
    }

    /// Least distance between a dot's hole and hinge or tab, mm.
    pub fn hinge_room_mm(&self) -> f64 {
        self.layout.room_mm
    }

    /// For each dot, the half that holds its hole.
    pub fn sides(&self) -> &[HoleSide] {
        &self.sides
    }

    /// Halves A and B, each rim down.
    pub fn halves(&self) -> &[Half; 2] {
        &self.halves
    }

    /// Half `i` (0 is A, 1 is B) where it stands in the stencil frame when half B is opened by
    /// `opening_rad` about the hinge (0 is closed).
    pub fn placed_half(&self, i: usize, opening_rad: f64) -> Mesh {
        let up = Vec3::new(0.0, 0.0, self.joint.lip_mm);
        let mesh = &self.halves[i.min(1)].mesh;
        if i == 0 {
            return mesh.mapped(|v| v - up);
        }
        // Half B's far side swings downwards.
        let turn = Rotation::from_axis_angle(&Vec3::y_axis(), -opening_rad);
        let hinge = Vec3::new(self.joint.axis_mm, 0.0, 0.0);
        mesh.mapped(|v| turn * (turn_over(&(v - up)) - hinge) + hinge)
    }

    /// SHA-256 of the pattern it draws.
    pub fn pattern_sha256(&self) -> &str {
        &self.pattern_sha256
    }
}

/// Refuses holes that leave too little material between them.
fn refuse_overlaps(dots: &[Vec3], config: &StencilConfig) -> Result<()> {
    for (i, a) in dots.iter().enumerate() {
        for (j, b) in dots[..i].iter().enumerate() {
            let angle = angle_between(a, b);
            // Along the chord, which is the shortest way, at both ends of the hole.
            let web = |radius: f64, hole: f64| 2.0 * radius * (0.5 * angle).sin() - 2.0 * hole;
            let inner = web(config.inner_radius_mm(), 0.5 * config.hole_diameter_mm);
            let outer = web(config.outer_radius_mm(), config.opening_radius_mm());
            let least = inner.min(outer);
            if least < config.min_web_mm {
                return Err(Error::argument(
                    "hole diameter",
                    format!(
                        "the holes of dots {j} and {i} ({:.1} degrees apart) leave {least:.2} mm \
                         between them, expected at least {} mm",
                        angle.to_degrees(),
                        config.min_web_mm
                    ),
                ));
            }
        }
    }
    Ok(())
}

/// The numbers to engrave in one half, and its holes (both in its own frame).
fn marks(layout: &Layout, is_a: bool, config: &StencilConfig, joint: &Joint) -> marks::Marks {
    let own = |d: &Vec3| if is_a { *d } else { turn_over(d) };
    let mut numbered = Vec::new();
    let mut holes = Vec::new();
    for (i, (dot, cuts)) in layout.dots.iter().zip(&layout.cuts).enumerate() {
        if cuts[usize::from(!is_a)] != Cut::None {
            holes.push(own(dot));
        }
        if config.numbers && (dot.z > 0.0) == is_a {
            numbered.push((i, own(dot)));
        }
    }
    let mut obstacles = layout::hinge_points(config, joint);
    if is_a {
        obstacles.extend(layout::tab_points(config, joint));
    }
    marks::numbers(&numbered, &holes, &obstacles, config, joint)
}

/// Builds one half, lays it on the bed and checks it.
fn half(layout: &Layout, is_a: bool, config: &StencilConfig, joint: &Joint) -> Result<Half> {
    let name = if is_a { "half A" } else { "half B" };
    let own = |d: &Vec3| if is_a { *d } else { turn_over(d) };
    let marks = marks(layout, is_a, config, joint);
    let up = Vec3::new(0.0, 0.0, joint.lip_mm);
    let mut outcome = Err(Error::Internal(format!(
        "{name}: no tessellation was tried"
    )));
    // Where surfaces that all but coincide make the mesh cut itself, other facets may not; and where
    // cleaning does, less of it may not.
    'tried: for fineness in FINENESS {
        let tessellated = StencilConfig {
            chord_error_mm: fineness * config.chord_error_mm,
            ..config.clone()
        };
        let part = parts::Half {
            config: &tessellated,
            joint,
            is_a,
            holes: layout
                .dots
                .iter()
                .map(own)
                .zip(layout.cuts.iter().map(|c| c[usize::from(!is_a)]))
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
        unnumbered: marks.left_out,
        ..half
    })
}

/// The half with this mesh, if it is what it should be.
fn checked(mesh: Mesh, name: &str, through_holes: usize) -> Result<Half> {
    let check = mesh.check();
    check.require_solid(name)?;
    if check.genus() != through_holes as i64 {
        return Err(Error::Internal(format!(
            "{name}: expected {through_holes} through-holes, found {}",
            check.genus()
        )));
    }
    if Solid::new(&mesh)?.self_intersects() {
        return Err(Error::Internal(format!("{name}: the surface cuts itself")));
    }
    Ok(Half {
        mesh,
        check,
        through_holes,
        unnumbered: Vec::new(),
    })
}
