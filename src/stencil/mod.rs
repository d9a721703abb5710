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

mod clean;
mod config;
pub mod coupon;
mod export;
mod glyphs;
mod joint;
mod layout;
mod marks;
mod mesh;
mod parts;
mod pin;
mod seam;
pub mod shapes;
mod solid;
mod threemf;
mod windows;

pub use config::{Closure, StencilConfig};
pub use export::stl_bytes;
pub use joint::Joint;
pub use marks::{DotNumber, Label};
pub use mesh::{BoundingBox, Mesh, MeshCheck};
pub use pin::pin;
pub use seam::{Seam, max_margin_seam};
pub use windows::{ClosedZone, Window};

use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3, angle_between};
use crate::pattern::{KeepOut, Pattern};
use config::{MIN_HOLE_MM, MIN_WEB_MM};
use layout::{Cut, Layout};
use solid::Solid;

/// How far cleaning may move the surface, as fractions of the chord error: tried in this order.
const CLEANING: [f64; 3] = [0.2, 0.05, 0.005];
/// Chord errors that are tried, as shares of the one asked for.
const FINENESS: [f64; 4] = [1.0, 0.9, 0.8, 0.7];

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
    /// Where the dots' numbers are engraved.
    pub numbers: Vec<DotNumber>,
    /// Dots of this half whose number found no place.
    pub unnumbered: Vec<usize>,
    /// The half's name with the ball's diameter, and the pattern's id, where they found a place.
    pub labels: Vec<Label>,
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
    /// [`Error::Argument`] as [`Stencil::build`].
    pub fn check(pattern: &Pattern, config: &StencilConfig) -> Result<()> {
        Plan::new(pattern, config).map(drop)
    }

    /// The largest hole diameter, in steps of 0.1 mm, with which the stencil of `pattern` is
    /// possible when all else is as in `config`; `None` where there is none. Tries diameters one by
    /// one from the largest that webs between holes allow, each as long as [`Stencil::check`].
    pub fn largest_hole_mm(pattern: &Pattern, config: &StencilConfig) -> Option<f64> {
        let largest = widest_holes(pattern.dots(), config).min(0.5 * config.ball_diameter_mm);
        let from = (10.0 * largest + 1e-6).floor().max(0.0) as u32;
        let to = (10.0 * MIN_HOLE_MM) as u32;
        let diameters = (to..=from).rev().map(|tenths| f64::from(tenths) / 10.0);
        let mut sized = diameters.map(|hole_diameter_mm| StencilConfig {
            hole_diameter_mm,
            ..config.clone()
        });
        sized
            .find(|c| Self::check(pattern, c).is_ok())
            .map(|c| c.hole_diameter_mm)
    }

    /// Designs the stencil of `pattern`.
    ///
    /// # Errors
    /// [`Error::Argument`] where a parameter is outside its domain or the geometry cannot work
    /// (with the value that fails); [`Error::Internal`] where a mesh fails its own checks.
    pub fn build(pattern: &Pattern, config: &StencilConfig) -> Result<Self> {
        let Plan { joint, layout } = Plan::new(pattern, config)?;
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
                format!("{half} Ø{}", config.ball_diameter_mm),
                format!("#{id}"),
            ]
        };
        let a = half(&layout, HalfName::A, &labels("A"), config, &joint)?;
        let b = half(&layout, HalfName::B, &labels("B"), config, &joint)?;
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

    /// Minimum distance between a dot's hole and hinge or tab, mm.
    pub fn hinge_clearance_mm(&self) -> f64 {
        self.layout.clearance_mm
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
        self.config.outer_radius_mm() - marks::depth_mm(&self.config)
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

/// Rejects holes that leave too little material between them; names the pair that leaves least.
fn check_overlaps(dots: &[Vec3], config: &StencilConfig) -> Result<()> {
    let mut worst = (f64::INFINITY, 0, 0);
    for (i, a) in dots.iter().enumerate() {
        for (j, b) in dots[..i].iter().enumerate() {
            let sine = (0.5 * angle_between(a, b)).sin();
            // Along the chord, which is the shortest way, at both ends of the hole.
            let web = |radius: f64, hole: f64| 2.0 * radius * sine - 2.0 * hole;
            let inner = web(config.inner_radius_mm(), 0.5 * config.hole_diameter_mm);
            let outer = web(config.outer_radius_mm(), config.opening_radius_mm());
            let thinnest = inner.min(outer);
            if thinnest < worst.0 {
                worst = (thinnest, j, i);
            }
        }
    }
    let (thinnest, j, i) = worst;
    if thinnest >= config.min_web_mm {
        return Ok(());
    }
    let problem = format!(
        "the holes of dots {j} and {i} ({:.1} degrees apart) leave {thinnest:.2} mm between them, \
         expected at least {} mm; {}",
        angle_between(&dots[i], &dots[j]).to_degrees(),
        config.min_web_mm,
        fitting(dots, config, thinnest),
    );
    Err(Error::argument("hole_diameter_mm", problem))
}

/// The hole diameter at which the thinnest web between two holes is as thick as asked for, mm;
/// negative where no hole is small enough.
fn widest_holes(dots: &[Vec3], config: &StencilConfig) -> f64 {
    // How much wider a hole is at its outer end.
    let widening = 2.0 * config.opening_radius_mm() - config.hole_diameter_mm;
    let mut widest = f64::INFINITY;
    for (i, a) in dots.iter().enumerate() {
        for b in &dots[..i] {
            let chord = |radius: f64| 2.0 * radius * (0.5 * angle_between(a, b)).sin();
            let inner = chord(config.inner_radius_mm());
            let outer = chord(config.outer_radius_mm()) - widening;
            widest = widest.min(inner.min(outer) - config.min_web_mm);
        }
    }
    widest
}

/// Which holes, webs and balls fit, in words, where the thinnest web is `thinnest_mm`.
fn fitting(dots: &[Vec3], config: &StencilConfig, thinnest_mm: f64) -> String {
    let tenths = (10.0 * widest_holes(dots, config) + 1e-6).floor();
    let holes = if tenths < 10.0 * MIN_HOLE_MM {
        "no hole fits".to_owned()
    } else {
        format!("holes of at most {:.1} mm fit", 0.1 * tenths)
    };
    let web = (10.0 * thinnest_mm + 1e-6).floor();
    let webs = if web < 10.0 * MIN_WEB_MM {
        String::new()
    } else {
        format!(", or a web of at most {:.1} mm", 0.1 * web)
    };
    let ball = (10.0 * smallest_ball(dots, config) - 1e-6).ceil();
    format!("{holes}{webs}, or a ball of at least {:.1} mm", 0.1 * ball)
}

/// The ball's diameter from which all webs are as thick as asked for, mm.
fn smallest_ball(dots: &[Vec3], config: &StencilConfig) -> f64 {
    let mut radius = 0.0f64;
    for (i, a) in dots.iter().enumerate() {
        for b in &dots[..i] {
            let sine = (0.5 * angle_between(a, b)).sin();
            let at = |hole: f64| 0.5 * (hole + config.min_web_mm) / sine;
            // How far inner and outer surface lie beyond the ball.
            let beyond = [config.clearance_mm, config.clearance_mm + config.wall_mm];
            let inner = at(config.hole_diameter_mm) - beyond[0];
            let outer = at(2.0 * config.opening_radius_mm()) - beyond[1];
            radius = radius.max(inner).max(outer);
        }
    }
    2.0 * radius
}

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
fn half(
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
