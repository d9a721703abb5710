//! The stencil: two printable half shells that close around a ball, with a hole for each dot.
//!
//! Method: the pattern is rotated so that the great circle farthest from all dots
//! ([`max_margin_seam`]) along which hinge and thumb tab keep clear of the holes lies in the plane
//! z = 0 of the *stencil frame*. The shell between two spheres is parted there into half A (z > 0)
//! and half B (z < 0), whose rims overlap by a narrow band and meet in a cone ([`Joint`]); a
//! tapered tool is subtracted for each dot by mesh booleans. A dot near the seam leaves matching
//! holes in both rims. Zones that the pattern keeps free of dots become windows. Slivers are removed.
//!
//! Guaranteed: each half is one closed, oriented 2-manifold that does not intersect itself and has
//! exactly the expected holes, after rounding to the 32-bit floats of STL. Not guaranteed: that a
//! printer keeps the modeled clearances ([`coupon`]).
//!
//! Units: angles in radians. Lengths are millimeters, as in the files that leave this module (STL,
//! 3MF), and carry `_mm` in their names.
//!
//! Frames: `stencil = rotation * pattern`, origin at the ball's center, hinge towards +x with its
//! axis along y, thumb tab towards -x. Half A is laid as it is; half B is turned by half a turn
//! about x (y and z change sign). Both are then raised by the lip's height, so that the bed is z =
//! 0.
//!
//! ```
//! use spindoe::geometry::spiral_directions;
//! use spindoe::pattern::Pattern;
//! use spindoe::stencil::{Stencil, StencilConfig};
//!
//! # fn main() -> spindoe::Result<()> {
//! let pattern = Pattern::new(spiral_directions(12).collect())?;
//! let config = StencilConfig {
//!     ball_diameter_mm: 40.3,
//!     ..StencilConfig::default()
//! };
//! // Takes milliseconds; `Stencil::build` makes the solids.
//! Stencil::check(&pattern, &config)?;
//! # Ok(())
//! # }
//! ```

mod bed;
mod clean;
mod config;
pub mod coupon;
mod export;
mod glyphs;
mod half;
mod joint;
mod layout;
mod marks;
mod mesh;
mod obstacles;
mod parts;
mod pin;
mod seam;
mod segments;
pub mod shapes;
mod solid;
mod threemf;
mod webs;
mod windows;

pub use bed::{Bed, COMMON_BEDS};
pub use config::{Closure, StencilConfig};
pub use export::{piece_files, stl_bytes};
#[cfg(feature = "plot")]
pub(crate) use glyphs::BOLD_FONT;
pub use joint::Joint;
pub use marks::{DotNumber, Label};
pub use mesh::{BoundingBox, Mesh, MeshCheck};
pub use pin::pin;
pub use seam::{Seam, max_margin_seam};
pub use windows::{ClosedZone, Window};

use crate::error::Result;
use crate::geometry::{Rotation, Vec3};
use crate::pattern::{KeepOut, Pattern};
use config::MIN_HOLE_MM;
use layout::{Cut, Layout};
use webs::{check_overlaps, widest_holes};

/// One of the two halves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HalfName {
    /// The half with z > 0 in the stencil frame, the hinge's outer knuckles and the thumb tab.
    A,
    /// The half with z < 0.
    B,
}

impl HalfName {
    /// Both, in the order in which [`Stencil::halves`] holds them.
    pub const BOTH: [Self; 2] = [Self::A, Self::B];

    /// A point between the stencil's frame and this half's own (dome up): the map is its own
    /// inverse.
    fn own_frame(self, v: &Vec3) -> Vec3 {
        match self {
            Self::A => *v,
            Self::B => Vec3::new(v.x, -v.y, -v.z),
        }
    }

    /// Whether the half holds a dot at `z` of the stencil frame.
    fn holds(self, z: f64) -> bool {
        (z > 0.0) == (self == Self::A)
    }
}

impl std::fmt::Display for HalfName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::A => "half A",
            Self::B => "half B",
        })
    }
}

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
    /// What is printed in its place where it is cut; empty where it stays whole
    /// ([`StencilConfig::segments`]).
    pub pieces: Vec<Piece>,
    /// Screws that hold the pieces together.
    pub screws: usize,
    /// Where the dots' numbers are engraved.
    pub numbers: Vec<DotNumber>,
    /// Dots of this half whose number found no place.
    pub unnumbered: Vec<usize>,
    /// The half's name with the ball's diameter, and the pattern's id, where they found a place.
    pub labels: Vec<Label>,
}

/// A piece of a half that is cut.
#[derive(Debug, Clone)]
pub struct Piece {
    /// The mesh, mm, already rounded to 32-bit floats.
    pub mesh: Mesh,
    /// What was found when it was checked.
    pub check: MeshCheck,
    /// Holes that lead through it: those of dots and screws, and the bores of its knuckles.
    pub through_holes: usize,
    /// Turn about z from the half's place on the bed to the piece's, radians.
    pub turn_rad: f64,
}

impl Half {
    /// What is printed: the half, or its pieces.
    pub fn printed(&self) -> Vec<&Mesh> {
        match self.pieces.as_slice() {
            [] => vec![&self.mesh],
            pieces => pieces.iter().map(|piece| &piece.mesh).collect(),
        }
    }
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

/// The layout of a stencil, before any solid is built.
struct Plan {
    joint: Joint,
    layout: Layout,
}

impl Plan {
    fn new(pattern: &Pattern, config: &StencilConfig) -> Result<Self> {
        config.validate()?;
        let joint = Joint::new(config)?;
        check_overlaps(pattern.dots(), config)?;
        let layout = Layout::choose(pattern, config, &joint)?;
        Ok(Self { joint, layout })
    }
}

impl Stencil {
    /// Checks that a pattern leaves space for the stencil's holes, rims, hinge and tab. Builds
    /// nothing, which takes thousands of times longer.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] as [`Stencil::build`].
    pub fn check(pattern: &Pattern, config: &StencilConfig) -> Result<()> {
        Plan::new(pattern, config).map(drop)
    }

    /// The largest hole diameter, in steps of 0.1 mm, with which the stencil of `pattern` is
    /// possible when all else is as in `config`; `None` where there is none. Takes about as long as
    /// [`Stencil::check`] of a stencil that is not possible.
    pub fn largest_hole_mm(pattern: &Pattern, config: &StencilConfig) -> Option<f64> {
        let dots = pattern.dots();
        let largest = widest_holes(dots, config).min(0.5 * config.ball_diameter_mm);
        let from = (10.0 * largest + 1e-6).floor().max(0.0) as u32;
        let to = (10.0 * MIN_HOLE_MM) as u32;
        let diameters = (to..=from).rev().map(|tenths| f64::from(tenths) / 10.0);
        let diameters: Vec<f64> = diameters.collect();
        let smallest = StencilConfig {
            hole_diameter_mm: *diameters.last()?,
            ..config.clone()
        };
        smallest.validate().ok()?;
        let joint = Joint::new(&smallest).ok()?;
        check_overlaps(dots, &smallest).ok()?;
        Layout::largest_hole_mm(dots, &diameters, &smallest, &joint)
    }

    /// Designs the stencil of `pattern`.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where a parameter is outside its domain or the geometry cannot work
    /// (with the value that fails); [`crate::Error::Internal`] where a mesh fails its own checks.
    pub fn build(pattern: &Pattern, config: &StencilConfig) -> Result<Self> {
        Self::build_with(pattern, config, &|_| {})
    }

    /// The same; `done` hears of the plan and of each half, whose number is 0, 1 and 2.
    ///
    /// # Errors
    /// As [`Stencil::build`].
    pub fn build_with(
        pattern: &Pattern,
        config: &StencilConfig,
        done: &dyn Fn(usize),
    ) -> Result<Self> {
        let Plan { joint, layout } = Plan::new(pattern, config)?;
        done(0);
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
        let id: String = pattern.sha256().chars().take(marks::ID_DIGITS).collect();
        let labels = |half: &str| {
            [
                format!(
                    "{half} Ø{}",
                    (100.0 * config.ball_diameter_mm).round() / 100.0
                ),
                format!("#{id}"),
            ]
        };
        let a = half::build(&layout, HalfName::A, &labels("A"), config, &joint)?;
        done(1);
        let b = half::build(&layout, HalfName::B, &labels("B"), config, &joint)?;
        done(2);
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

    /// For each dot, the half that holds its hole.
    pub fn sides(&self) -> &[HoleSide] {
        &self.sides
    }

    /// The pattern's zones without dots, in the stencil's frame.
    pub fn zones(&self) -> &[KeepOut] {
        &self.layout.zones
    }

    /// Radius of the engraving's floor, mm.
    pub fn engraving_radius_mm(&self) -> f64 {
        self.config.engraving_radius_mm()
    }

    /// Openings over the pattern's zones without dots.
    pub fn windows(&self) -> &[Window] {
        &self.layout.windows
    }

    /// Zones for whose window there is no space: arrows point to them.
    pub fn closed_zones(&self) -> &[ClosedZone] {
        &self.layout.closed
    }

    /// Halves A and B, each rim down.
    pub fn halves(&self) -> &[Half; 2] {
        &self.halves
    }

    /// One half, rim down.
    pub fn half(&self, name: HalfName) -> &Half {
        let [a, b] = &self.halves;
        match name {
            HalfName::A => a,
            HalfName::B => b,
        }
    }

    /// A half where it stands in the stencil frame when half B is opened by `opening_rad` about the
    /// hinge (0 is closed).
    pub fn placed_half(&self, name: HalfName, opening_rad: f64) -> Mesh {
        let up = Vec3::new(0.0, 0.0, self.joint.lip_mm);
        let mesh = &self.half(name).mesh;
        if name == HalfName::A {
            return mesh.mapped(|v| v - up);
        }
        // Half B's far side swings downwards.
        let turn = Rotation::from_axis_angle(&Vec3::y_axis(), -opening_rad);
        let hinge = Vec3::new(self.joint.axis_mm, 0.0, 0.0);
        mesh.mapped(|v| turn * (HalfName::B.own_frame(&(v - up)) - hinge) + hinge)
    }

    /// SHA-256 of the pattern it draws.
    pub fn pattern_sha256(&self) -> &str {
        &self.pattern_sha256
    }
}
