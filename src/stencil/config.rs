//! The stencil's parameters, their defaults and their domains.

use super::segments;
use crate::ball::{USUAL_BALL_MM, usual_dot_mm};
use crate::error::{Result, require};

/// Smallest hole that is made, mm.
pub(super) const MIN_HOLE_MM: f64 = 0.5;
/// Thinnest web that is made, mm.
pub(super) const MIN_WEB_MM: f64 = 0.2;
/// Half-angle of the part of the dome's inside that is relieved. Printed rim down in layers of height h
/// and lines of width w, the dome's layers lean out by more than a line where it is flatter than
/// atan(h / w): 24 degrees for 0.2 and 0.45 mm.
const CEILING_RAD: f64 = 25.0 * std::f64::consts::PI / 180.0;
/// The hinge's screws, nominal diameters, mm: a small ball's rim leaves room for a thin one only.
const SCREWS_MM: [f64; 4] = [3.0, 2.5, 2.0, 1.6];
/// Clearance of a pen's tip in its hole, per side, mm: printers draw holes too small.
const PEN_PLAY_MM: f64 = 0.2;

/// Depth of the engraving as a fraction of the wall, and its bound, mm.
const ENGRAVED: (f64, f64) = (0.2, 0.5);

/// What holds the hinge together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Closure {
    /// A machine screw with a lock nut.
    #[default]
    Screw,
    /// A pin that is printed with the halves and snaps in.
    Pin,
}

impl Closure {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Screw, Self::Pin];

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Screw => "screw",
            Self::Pin => "pin",
        }
    }
}

impl std::str::FromStr for Closure {
    type Err = crate::error::Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "closure", name)
    }
}

/// Parameters of a stencil. Angles in radians; lengths in millimeters, the unit of the files it is
/// written to.
///
/// Clearances are modeled gaps: what a printer makes of them is measured with the coupon
/// ([`super::coupon`]).
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StencilConfig {
    /// Diameter of the ball, mm, 10 to 400. Default 40.0. Table-tennis balls are 40.0 to 40.6 mm: measure
    /// yours.
    pub ball_diameter_mm: f64,
    /// Gap between ball and shell, per side, mm. Default 0.2.
    pub clearance_mm: f64,
    /// Thickness of the shell, mm. Default 2.8.
    pub wall_mm: f64,
    /// How much farther from the ball the dome's inside lies within 25 degrees of its top, mm. Default
    /// 0.3. There it is printed on air and comes out rough, which would hold the ball off. At most half
    /// the throat and a quarter of the wall are used, see [`StencilConfig::ceiling_depth_mm`].
    #[serde(default)]
    pub ceiling_relief_mm: f64,
    /// Diameter of a dot on the ball, mm. Default 4.0.
    pub hole_diameter_mm: f64,
    /// Length of the cylindrical throat at the ball before a hole widens, mm. Default 0.8.
    pub throat_mm: f64,
    /// Half-angle of the cone by which a hole widens outwards, radians. Default 30 degrees.
    pub taper_rad: f64,
    /// Minimum material between two holes, and between a hole and a rim, the hinge or the tab, mm.
    /// Default 0.8.
    pub min_web_mm: f64,
    /// Wanted distance of the dots' centers from the seam, radians. Default 10 degrees. Where no
    /// plane keeps it, the plane that comes nearest is taken and holes pass through both rims.
    pub seam_margin_rad: f64,
    /// Gap between the two rims, square to their cone, mm. Default 0.2.
    pub seam_gap_mm: f64,
    /// What holds the hinge together. Default: a screw.
    #[serde(default)]
    pub closure: Closure,
    /// Nominal diameter of the hinge's screw or pin, mm. Default 3.0 (M3).
    pub screw_diameter_mm: f64,
    /// By how much the bore is wider than the screw, mm. Default 0.2.
    pub bore_allowance_mm: f64,
    /// Length of the hinge along its screw, mm. Default 15.
    pub hinge_length_mm: f64,
    /// Number of interleaved knuckles, odd; half A has the outer ones. Default 3.
    pub knuckles: usize,
    /// Gap between knuckles, and between knuckles and the other half's shell, mm. Default 0.4.
    pub knuckle_clearance_mm: f64,
    /// Material around the screw's bore, mm. Default 1.2.
    pub knuckle_wall_mm: f64,
    /// How far the thumb tab reaches beyond the shell, mm. Default 6.
    pub tab_mm: f64,
    /// Number of pieces of each half, screwed together, for printers whose bed holds no whole half. Default
    /// 1.
    #[serde(default = "whole")]
    pub segments: usize,
    /// Whether the dots' numbers are engraved beside their holes, and each half's name, the ball's
    /// diameter and the pattern's id. Default true.
    pub numbers: bool,
    /// Width of the printer's nozzle, mm: no wall may be thinner. Default 0.4.
    pub nozzle_mm: f64,
    /// Distance of a facet from the surface that it stands for, mm: at most so much as it is made, and up to a fifth more where slivers
    /// are removed. Default 0.02.
    pub chord_error_mm: f64,
}

/// A half that is one piece.
fn whole() -> usize {
    1
}

impl Default for StencilConfig {
    fn default() -> Self {
        Self {
            ball_diameter_mm: 40.0,
            clearance_mm: 0.2,
            wall_mm: 2.8,
            ceiling_relief_mm: 0.3,
            hole_diameter_mm: 4.0,
            throat_mm: 0.8,
            taper_rad: 30f64.to_radians(),
            min_web_mm: 0.8,
            seam_margin_rad: 10f64.to_radians(),
            seam_gap_mm: 0.2,
            closure: Closure::Screw,
            screw_diameter_mm: 3.0,
            bore_allowance_mm: 0.2,
            hinge_length_mm: 15.0,
            knuckles: 3,
            knuckle_clearance_mm: 0.4,
            knuckle_wall_mm: 1.2,
            tab_mm: 6.0,
            segments: whole(),
            numbers: true,
            nozzle_mm: 0.4,
            chord_error_mm: 0.02,
        }
    }
}

impl StencilConfig {
    /// The defaults for a ball of this diameter, mm: [`StencilConfig::default`] but for dots of a tenth of it. Below
    /// 40 mm shell, hinge, tab and webs become smaller, less than in proportion: at 10 mm they are as thin as a
    /// nozzle of 0.4 mm prints them and as short as knuckles may be.
    pub fn for_ball(ball_diameter_mm: f64) -> Self {
        let usual = Self {
            ball_diameter_mm,
            hole_diameter_mm: usual_dot_mm(ball_diameter_mm),
            ..Self::default()
        };
        if ball_diameter_mm.is_nan() || ball_diameter_mm >= USUAL_BALL_MM {
            return usual;
        }
        let of = |least: f64, of_ball: f64| least + of_ball * ball_diameter_mm;
        let screws = SCREWS_MM.into_iter();
        Self {
            wall_mm: of(1.2, 0.04),
            taper_rad: of(10.0, 0.5).to_radians(),
            min_web_mm: of(0.4, 0.01),
            screw_diameter_mm: screws.fold(SCREWS_MM[0], |thick, thin| {
                if thick > of(1.2, 0.045) { thin } else { thick }
            }),
            hinge_length_mm: of(2.4, 0.315),
            knuckle_wall_mm: of(0.7, 0.0125),
            tab_mm: of(1.5, 0.1125),
            ..usual
        }
    }

    /// Inner radius of the shell, mm.
    pub fn inner_radius_mm(&self) -> f64 {
        0.5 * self.ball_diameter_mm + self.clearance_mm
    }

    /// Outer radius of the shell, mm.
    pub fn outer_radius_mm(&self) -> f64 {
        self.inner_radius_mm() + self.wall_mm
    }

    /// Radius of the engraving's floor, mm: four fifths of the wall remain, which is more than a nozzle's width.
    pub fn engraving_radius_mm(&self) -> f64 {
        self.outer_radius_mm() - (ENGRAVED.0 * self.wall_mm).min(ENGRAVED.1)
    }

    /// How far the dome's inside is relieved around its top, mm.
    pub fn ceiling_depth_mm(&self) -> f64 {
        self.ceiling_relief_mm
            .min(0.5 * self.throat_mm)
            .min(0.25 * self.wall_mm)
    }

    /// Radius of the relieved part about the dome's axis, mm.
    pub fn ceiling_radius_mm(&self) -> f64 {
        self.inner_radius_mm() * CEILING_RAD.sin()
    }

    /// Diameter of the hole through which a pen's tip of `pen_diameter_mm` just goes, mm: 0.2 mm of
    /// clearance on each side.
    pub fn hole_for_pen_mm(pen_diameter_mm: f64) -> f64 {
        pen_diameter_mm + 2.0 * PEN_PLAY_MM
    }

    /// Radius of a hole `height_mm` from the ball's center along its axis, mm.
    pub fn hole_radius_mm(&self, height_mm: f64) -> f64 {
        let rise = height_mm - self.inner_radius_mm() - self.throat_mm;
        0.5 * self.hole_diameter_mm + rise.max(0.0) * self.taper_rad.tan()
    }

    /// Radius of a hole at the outer end of its taper, mm.
    pub fn opening_radius_mm(&self) -> f64 {
        self.hole_radius_mm(self.outer_radius_mm())
    }

    /// Minimum angle between two dots whose holes leave [`Self::min_web_mm`] between them, radians.
    pub fn min_separation_rad(&self) -> f64 {
        let angle = |radius: f64, hole: f64| {
            2.0 * ((hole + 0.5 * self.min_web_mm) / radius).min(1.0).asin()
        };
        let inner = angle(self.inner_radius_mm(), 0.5 * self.hole_diameter_mm);
        let outer = angle(self.outer_radius_mm(), self.opening_radius_mm());
        inner.max(outer)
    }

    /// Checks every parameter's domain.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] naming the parameter and what was expected.
    pub fn validate(&self) -> Result<()> {
        let r = 0.5 * self.ball_diameter_mm;
        let lengths = [
            ("ball_diameter_mm", self.ball_diameter_mm, 10.0, 400.0),
            ("clearance_mm", self.clearance_mm, 0.0, 0.1 * r),
            ("nozzle_mm", self.nozzle_mm, 0.1, 1.2),
            ("wall_mm", self.wall_mm, 2.0 * self.nozzle_mm, 0.5 * r),
            ("ceiling_relief_mm", self.ceiling_relief_mm, 0.0, 2.0),
            ("hole_diameter_mm", self.hole_diameter_mm, MIN_HOLE_MM, r),
            ("throat_mm", self.throat_mm, 0.2, self.wall_mm),
            ("min_web_mm", self.min_web_mm, MIN_WEB_MM, 5.0),
            ("seam_gap_mm", self.seam_gap_mm, 0.05, 1.0),
            ("screw_diameter_mm", self.screw_diameter_mm, 1.0, 8.0),
            ("bore_allowance_mm", self.bore_allowance_mm, 0.0, 1.0),
            ("hinge_length_mm", self.hinge_length_mm, 4.0, 1.2 * r),
            ("knuckle_clearance_mm", self.knuckle_clearance_mm, 0.1, 2.0),
            ("knuckle_wall_mm", self.knuckle_wall_mm, 0.8, 5.0),
            ("tab_mm", self.tab_mm, 2.0, 20.0),
            ("chord_error_mm", self.chord_error_mm, 0.002, 0.005 * r),
        ];
        for (name, value, low, high) in lengths {
            let expected = format!("{low} to {high} mm");
            require((low..=high).contains(&value), name, &expected, value)?;
        }
        for (name, radians, high_deg) in [
            ("taper_rad", self.taper_rad, 60.0),
            ("seam_margin_rad", self.seam_margin_rad, 45.0),
        ] {
            let degrees = degrees(radians);
            let expected = format!("0 to {high_deg} degrees");
            require(
                (0.0..=high_deg).contains(&degrees),
                name,
                &expected,
                degrees,
            )?;
        }
        segments::check(self.segments)?;
        require(
            (3..=9).contains(&self.knuckles) && !self.knuckles.is_multiple_of(2),
            "knuckles",
            "3, 5, 7 or 9",
            self.knuckles,
        )
    }
}

/// An angle in degrees as a person wrote it: rounded to 1e-9, since radians hold few degrees
/// exactly.
pub(super) fn degrees(radians: f64) -> f64 {
    (radians.to_degrees() * 1e9).round() / 1e9
}
