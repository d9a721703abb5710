//! The stencil: two printable half shells that close around a ball, with a hole for each dot.
//!
//! Method: the pattern is turned so that the great circle farthest from all dots ([`max_margin_seam`])
//! lies in the plane z = 0 of the *stencil frame*. The shell between two spheres is cut there into
//! half A (z > 0) and half B (z < 0), and a tapered tool is subtracted for each dot by mesh booleans. A
//! dot whose hole meets the seam leaves matching half-holes in both rims. Each half is checked as a
//! closed, oriented 2-manifold after rounding to the 32-bit floats of STL, and handed over rim down.
//!
//! Frames: `stencil = rotation * pattern`, origin at the ball's centre. Half A is laid as it is; half B
//! is turned by half a turn about x (y and z change sign).

mod config;
mod export;
mod mesh;
mod seam;
pub mod shapes;
mod solid;

pub use config::StencilConfig;
pub use mesh::{BoundingBox, Mesh, MeshCheck};
pub use seam::{Seam, max_margin_seam};

use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3, angle_between, tangent_frame};
use crate::pattern::Pattern;
use solid::Solid;

/// In which half a dot's hole lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HoleSide {
    /// Wholly in half A (z > 0 in the stencil frame).
    A,
    /// Wholly in half B.
    B,
    /// On the seam: a half-hole in each rim.
    Seam,
}

/// One printable half, rim down on the plane z = 0.
#[derive(Debug, Clone)]
pub struct Half {
    /// The mesh, mm, already rounded to 32-bit floats.
    pub mesh: Mesh,
    /// What was found when it was checked.
    pub check: MeshCheck,
}

/// A stencil for one pattern.
#[derive(Debug, Clone)]
pub struct Stencil {
    config: StencilConfig,
    pattern_sha256: String,
    rotation: Rotation,
    seam: Seam,
    sides: Vec<HoleSide>,
    halves: [Half; 2],
}

impl Stencil {
    /// Designs the stencil of `pattern`.
    ///
    /// # Errors
    /// [`Error::Argument`] where a parameter is outside its domain or the geometry cannot work (with
    /// the figure that fails); [`Error::Internal`] where a mesh fails its own checks.
    pub fn build(pattern: &Pattern, config: &StencilConfig) -> Result<Self> {
        config.validate()?;
        refuse_overlaps(pattern.dots(), config)?;
        let seam = max_margin_seam(pattern.dots());
        let [x, y] = tangent_frame(&seam.normal);
        let axes =
            nalgebra::Matrix3::from_rows(&[x.transpose(), y.transpose(), seam.normal.transpose()]);
        let rotation =
            Rotation::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(axes));
        let dots: Vec<Vec3> = pattern.dots().iter().map(|d| rotation * d).collect();
        let sides: Vec<_> = dots.iter().map(|d| side_of(d, config)).collect();
        let a = half(&dots, &sides, HoleSide::A, config)?;
        // Half B in its printing position is half A of the turned dots.
        let turned: Vec<_> = dots.iter().map(turn_over).collect();
        let b = half(&turned, &sides, HoleSide::B, config)?;
        Ok(Self {
            config: config.clone(),
            pattern_sha256: pattern.sha256(),
            rotation,
            seam,
            sides,
            halves: [a, b],
        })
    }

    /// The parameters it was built with.
    pub fn config(&self) -> &StencilConfig {
        &self.config
    }

    /// The rotation from the pattern's frame to the stencil's.
    pub fn rotation(&self) -> Rotation {
        self.rotation
    }

    /// The seam's great circle, in the pattern's frame.
    pub fn seam(&self) -> Seam {
        self.seam
    }

    /// For each dot, the half that holds its hole.
    pub fn sides(&self) -> &[HoleSide] {
        &self.sides
    }

    /// Halves A and B, each rim down.
    pub fn halves(&self) -> &[Half; 2] {
        &self.halves
    }

    /// Half `i` (0 is A, 1 is B) where it stands in the closed stencil, in the stencil frame.
    pub fn closed_half(&self, i: usize) -> Mesh {
        let mesh = &self.halves[i.min(1)].mesh;
        if i == 0 {
            mesh.clone()
        } else {
            mesh.mapped(turn_over)
        }
    }

    /// SHA-256 of the pattern it draws.
    pub fn pattern_sha256(&self) -> &str {
        &self.pattern_sha256
    }
}

/// Half a turn about x: half B between its printing position and its place in the closed stencil.
fn turn_over(v: &Vec3) -> Vec3 {
    Vec3::new(v.x, -v.y, -v.z)
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

/// Which half holds the hole of a dot, in the stencil frame.
fn side_of(dot: &Vec3, config: &StencilConfig) -> HoleSide {
    let latitude = dot.z.clamp(-1.0, 1.0).asin().abs();
    let gap = |radius: f64, hole: f64| radius * latitude.sin() - hole * latitude.cos();
    let inner = gap(config.inner_radius_mm(), 0.5 * config.hole_diameter_mm);
    let outer = gap(config.outer_radius_mm(), config.opening_radius_mm());
    if inner.min(outer) < config.min_web_mm {
        HoleSide::Seam
    } else if dot.z > 0.0 {
        HoleSide::A
    } else {
        HoleSide::B
    }
}

/// Builds and checks the half above z = 0 that carries the holes of `side` and of the seam.
fn half(dots: &[Vec3], sides: &[HoleSide], side: HoleSide, config: &StencilConfig) -> Result<Half> {
    let chord = config.chord_error_mm;
    let outer = Solid::new(&shapes::sphere(config.outer_radius_mm(), chord))?;
    let inner = Solid::new(&shapes::sphere(config.inner_radius_mm(), chord))?;
    let mut tools = Vec::new();
    let mut through = 0;
    for (dot, &s) in dots.iter().zip(sides) {
        if s == side {
            through += 1;
        }
        if s == side || s == HoleSide::Seam {
            tools.push(Solid::new(&drill(dot, config))?);
            if s == HoleSide::Seam {
                // The bridge towards the seam would be too thin to print: open it.
                let below = Vec3::new(dot.x, dot.y, -dot.z.abs()).normalize();
                tools.push(Solid::new(&drill(&below, config))?);
            }
        }
    }
    tools.push(inner);
    let mesh = outer.minus(&tools)?.above_seam()?.mesh().rounded();
    let check = mesh.check();
    let name = if side == HoleSide::A {
        "half A"
    } else {
        "half B"
    };
    check.require_solid(name)?;
    if check.genus() != through {
        return Err(Error::Internal(format!(
            "{name}: expected {through} through-holes, found {}",
            check.genus()
        )));
    }
    Ok(Half { mesh, check })
}

/// The tool that cuts a dot's hole: a throat of the dot's diameter, then a cone.
fn drill(dot: &Vec3, config: &StencilConfig) -> Mesh {
    let r = 0.5 * config.hole_diameter_mm;
    let throat_end = config.inner_radius_mm() + config.throat_mm;
    let end = config.outer_radius_mm() + 1.0;
    let end_radius = r + (end - throat_end).max(0.0) * config.taper_deg.to_radians().tan();
    let start = 0.6 * config.inner_radius_mm();
    let outline = [
        (start, 0.0),
        (start, r),
        (throat_end, r),
        (end, end_radius),
        (end, 0.0),
    ];
    let segments = shapes::circle_segments(end_radius, config.chord_error_mm).max(32);
    shapes::lathe(dot, &outline, segments)
}
