//! Zones of a ball that stay free of dots, such as a printed logo.

use super::Pattern;
use crate::error::{Error, Result, require};
use crate::geometry::{Vec3, angle_between};

/// A dot may lie this much inside a zone, radians: a search meets its constraints to 1e-3.
const TOLERANCE_RAD: f64 = 2e-3;
/// Maximum number of zones.
const MAX_ZONES: usize = 8;

/// A cone that must stay free of dots: a printed logo.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct KeepOut {
    /// Unit vector to the cone's center, pattern frame.
    pub axis: Vec3,
    /// Angle between the axis and the nearest dot's center, radians.
    pub half_angle_rad: f64,
}

impl KeepOut {
    /// Checks axis and angle.
    ///
    /// # Errors
    /// [`Error::Argument`] for `keep_out` with what was expected.
    pub fn check(&self) -> Result<()> {
        let is_unit = (self.axis.norm() - 1.0).abs() < super::LENGTH_TOLERANCE;
        require(is_unit, "keep_out", "a unit axis", self.axis.norm())?;
        let degrees = self.half_angle_rad.to_degrees();
        require(
            degrees > 0.0 && degrees <= 90.0,
            "keep_out",
            "a half angle of 0 to 90 degrees",
            degrees,
        )
    }
}

impl Pattern {
    /// The same dots with zones that they stay out of.
    ///
    /// # Errors
    /// [`Error::Argument`] for a zone that is none, too many of them, or a dot within one.
    pub fn with_keep_out(mut self, zones: Vec<KeepOut>) -> Result<Self> {
        require(
            zones.len() <= MAX_ZONES,
            "keep_out",
            &format!("at most {MAX_ZONES} zones"),
            zones.len(),
        )?;
        for (k, zone) in zones.iter().enumerate() {
            zone.check()?;
            for (i, dot) in self.dots.iter().enumerate() {
                let apart = angle_between(dot, &zone.axis);
                if apart < zone.half_angle_rad - TOLERANCE_RAD {
                    let problem = format!(
                        "dot {i} lies in zone {k}: {:.2} degrees from its axis, expected at least {:.2}",
                        apart.to_degrees(),
                        zone.half_angle_rad.to_degrees()
                    );
                    return Err(Error::argument("keep_out", problem));
                }
            }
        }
        self.keep_out = zones;
        Ok(self)
    }

    /// The zones without dots.
    pub fn keep_out(&self) -> &[KeepOut] {
        &self.keep_out
    }
}
