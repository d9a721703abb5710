//! The stencil's parameters, their defaults and their domains.

use crate::error::{Error, Result};

/// Parameters of a stencil. Lengths in millimetres, angles in degrees.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct StencilConfig {
    /// Diameter of the ball, mm. Default 40.0. Table-tennis balls are 40.0 to 40.6 mm: measure yours.
    pub ball_diameter_mm: f64,
    /// Gap between ball and shell, per side, mm. Default 0.2.
    pub clearance_mm: f64,
    /// Thickness of the shell, mm. Default 2.4.
    pub wall_mm: f64,
    /// Diameter of a dot on the ball, mm. Default 4.0.
    pub hole_diameter_mm: f64,
    /// Length of the cylindrical throat at the ball before a hole widens, mm. Default 0.8.
    pub throat_mm: f64,
    /// Half-angle of the cone by which a hole widens outwards, degrees. Default 15.
    pub taper_deg: f64,
    /// Least material between two holes, or between a hole and the seam, mm. Default 0.8.
    pub min_web_mm: f64,
    /// Greatest distance of a facet from the surface that it stands for, mm. Default 0.02.
    pub chord_error_mm: f64,
}

impl Default for StencilConfig {
    fn default() -> Self {
        Self {
            ball_diameter_mm: 40.0,
            clearance_mm: 0.2,
            wall_mm: 2.4,
            hole_diameter_mm: 4.0,
            throat_mm: 0.8,
            taper_deg: 15.0,
            min_web_mm: 0.8,
            chord_error_mm: 0.02,
        }
    }
}

impl StencilConfig {
    /// Inner radius of the shell, mm.
    pub fn inner_radius_mm(&self) -> f64 {
        0.5 * self.ball_diameter_mm + self.clearance_mm
    }

    /// Outer radius of the shell, mm.
    pub fn outer_radius_mm(&self) -> f64 {
        self.inner_radius_mm() + self.wall_mm
    }

    /// Radius of a hole at the outer end of its taper, mm.
    pub fn opening_radius_mm(&self) -> f64 {
        let rise = (self.wall_mm - self.throat_mm).max(0.0);
        0.5 * self.hole_diameter_mm + rise * self.taper_deg.to_radians().tan()
    }

    /// Least angle between two dots whose holes leave [`Self::min_web_mm`] between them, radians.
    pub fn least_separation_rad(&self) -> f64 {
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
    /// [`Error::Argument`] naming the parameter and what was expected.
    pub fn validate(&self) -> Result<()> {
        let r = 0.5 * self.ball_diameter_mm;
        let domains = [
            ("ball diameter", self.ball_diameter_mm, 10.0, 400.0, "mm"),
            ("clearance", self.clearance_mm, 0.0, 0.1 * r, "mm"),
            ("wall", self.wall_mm, 0.8, 0.5 * r, "mm"),
            ("hole diameter", self.hole_diameter_mm, 0.5, r, "mm"),
            ("throat", self.throat_mm, 0.2, self.wall_mm, "mm"),
            ("taper", self.taper_deg, 0.0, 45.0, "degrees"),
            ("least web", self.min_web_mm, 0.2, 5.0, "mm"),
            ("chord error", self.chord_error_mm, 0.002, 0.005 * r, "mm"),
        ];
        for (name, value, low, high, unit) in domains {
            if !(low..=high).contains(&value) {
                return Err(Error::argument(
                    name,
                    format!("expected {low} to {high} {unit}, found {value}"),
                ));
            }
        }
        Ok(())
    }
}
