//! Where the halves meet: the rims' cone and the hinge, as lengths.
//!
//! Both halves are printed rim down and share one hinge pin, so each half must reach around the pin
//! and yet lie on the bed: with flat rims that is impossible. The rims therefore overlap by a band
//! as high as a knuckle. In the stencil frame half A keeps the outer layer of the wall down to `z =
//! -lip`, half B the inner layer up to `z = +lip`, and a cone parts them: it widens downwards, so
//! that it centers the halves and lets go at once when they open. Each rim's lowest ring and its
//! knuckles stand on the bed, and what overhangs is a ledge less than a lip wide.
//!
//! The hinge's axis runs along y through `(axis, 0, 0)`. A point of half B at `(-d, z)` from the
//! axis moves on a circle about it; B's lip stays clear of A's as long as it is farther from the
//! axis than A's innermost rim edge, or has passed it: what comes nearer is cut away
//! ([`Joint::relief_mm`]).

use crate::error::{Error, Result};

use super::StencilConfig;

/// The part of the wall that the cone's widening takes, as a fraction.
const CONE_FRACTION: f64 = 0.2;
/// How deep a knuckle is cut flat where it stands on the bed, mm.
const FLAT_MM: f64 = 0.4;
/// Gap between a rim and the other half's ledge, mm: the halves rest on each other here.
const LEDGE_GAP_MM: f64 = 0.1;
/// How far the arms of the hinge rise above the ledge, mm, and at most as a part of the shell's radius.
const ARM: (f64, f64) = (3.0, 0.14);
/// Thickness of the thumb tab, mm, and at most as a part of the shell's radius.
const TAB_THICKNESS: (f64, f64) = (3.0, 0.14);
/// Width of the thumb tab, mm, and at most as a part of the shell's radius.
const TAB_WIDTH: (f64, f64) = (12.0, 0.5);
/// How far the inner lip may narrow the ball's passage, as a fraction of the ball's radius: more
/// would overstretch a printed ring.
const MAX_SNAP: f64 = 0.012;

/// Lengths of rims, hinge and tab, mm.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Joint {
    /// Half the height of the band in which the rims overlap; each half stands on its own `z =
    /// -lip`.
    pub lip_mm: f64,
    /// Radius of the middle of the cone's gap at the outer lip's edge.
    pub cone_wide_mm: f64,
    /// Radius of the middle of the cone's gap at the inner lip's edge.
    pub cone_narrow_mm: f64,
    /// Half the cone's gap, measured along the radius.
    pub half_gap_mm: f64,
    /// Gap between a rim and the other half's ledge.
    pub ledge_gap_mm: f64,
    /// Thickness of each lip at its edge.
    pub lip_thickness_mm: f64,
    /// Distance of the hinge's axis from the ball's center.
    pub axis_mm: f64,
    /// Outer radius of a knuckle.
    pub knuckle_radius_mm: f64,
    /// Radius of the bore.
    pub bore_radius_mm: f64,
    /// Length of a knuckle.
    pub knuckle_mm: f64,
    /// Height above the ball's center at which the hinge's arms meet the shell.
    pub arm_mm: f64,
    /// Thickness of the thumb tab.
    pub tab_thickness_mm: f64,
    /// Width of the thumb tab.
    pub tab_width_mm: f64,
}

impl Joint {
    /// Lays out rims and hinge.
    ///
    /// # Errors
    /// [`Error::Argument`] with the value where a wall would be thinner than the nozzle, knuckles
    /// have no length, or the ball would not pass the inner lip.
    pub fn new(config: &StencilConfig) -> Result<Self> {
        let (inner, outer) = (config.inner_radius_mm(), config.outer_radius_mm());
        let bore_radius_mm = 0.5 * (config.screw_diameter_mm + config.bore_allowance_mm);
        let knuckle_radius_mm = bore_radius_mm + config.knuckle_wall_mm;
        let lip_mm = knuckle_radius_mm - FLAT_MM;
        let narrow = |radius: f64| (radius * radius - lip_mm * lip_mm).max(0.0).sqrt();
        let snap = 0.5 * config.ball_diameter_mm - narrow(inner);
        let max_snap = MAX_SNAP * 0.5 * config.ball_diameter_mm;
        if snap > max_snap {
            return Err(Error::argument(
                "screw_diameter_mm",
                format!(
                    "the rim that its hinge needs narrows the ball's way by {snap:.2} mm, expected at \
                     most {max_snap:.2} mm: take a thinner screw or more clearance"
                ),
            ));
        }
        let width = narrow(outer) - narrow(inner);
        let lip_thickness_mm = 0.5 * (width * (1.0 - CONE_FRACTION) - config.seam_gap_mm);
        // Along the radius the gap is wider than square to the cone.
        let slope = CONE_FRACTION * width / (2.0 * lip_mm);
        let half_gap_mm = 0.5 * config.seam_gap_mm * slope.hypot(1.0);
        let cone_wide_mm = narrow(outer) - lip_thickness_mm - half_gap_mm;
        let cone_narrow_mm = narrow(inner) + lip_thickness_mm + half_gap_mm;
        let axis_mm = outer + config.knuckle_clearance_mm + knuckle_radius_mm;
        let gaps = (config.knuckles - 1) as f64 * config.knuckle_clearance_mm;
        let at_most = |(mm, of_radius): (f64, f64)| mm.min(of_radius * outer);
        let joint = Self {
            lip_mm,
            cone_wide_mm,
            cone_narrow_mm,
            half_gap_mm,
            ledge_gap_mm: LEDGE_GAP_MM,
            lip_thickness_mm,
            axis_mm,
            knuckle_radius_mm,
            bore_radius_mm,
            knuckle_mm: (config.hinge_length_mm - gaps) / config.knuckles as f64,
            arm_mm: lip_mm + LEDGE_GAP_MM + at_most(ARM),
            tab_thickness_mm: at_most(TAB_THICKNESS),
            tab_width_mm: at_most(TAB_WIDTH),
        };
        joint.refuse_thin_walls(config)?;
        Ok(joint)
    }

    /// Rejects walls that the nozzle cannot draw.
    fn refuse_thin_walls(&self, config: &StencilConfig) -> Result<()> {
        let relieved = self.axis_mm - self.relief_mm(0.0, config) - config.inner_radius_mm();
        for (name, what, value, min_thickness) in [
            (
                "wall_mm",
                "a rim's lip",
                self.lip_thickness_mm,
                config.nozzle_mm,
            ),
            (
                "wall_mm",
                "the inner lip at the hinge",
                relieved,
                config.nozzle_mm,
            ),
            ("hinge_length_mm", "a knuckle", self.knuckle_mm, 1.5),
        ] {
            if value < min_thickness {
                return Err(Error::argument(
                    name,
                    format!(
                        "{what} would be {value:.2} mm thick, expected at least {min_thickness} mm"
                    ),
                ));
            }
        }
        Ok(())
    }

    /// Where knuckle `k` starts and ends along y, mm. Even knuckles are half A's.
    pub fn knuckle_range(&self, k: usize, config: &StencilConfig) -> (f64, f64) {
        let from = -0.5 * config.hinge_length_mm
            + k as f64 * (self.knuckle_mm + config.knuckle_clearance_mm);
        (from, from + self.knuckle_mm)
    }

    /// How far from the hinge's axis half B's lip must stay at `y_mm` along it: as far as the inner
    /// edge of half A's rim, and half the gap between the rims: a whole gap would graze the lip's
    /// own edge.
    pub fn relief_mm(&self, y_mm: f64, config: &StencilConfig) -> f64 {
        let edge = self.cone_wide_mm + self.half_gap_mm;
        let x = (edge * edge - y_mm * y_mm).max(0.0).sqrt();
        (self.axis_mm - x).hypot(self.lip_mm) + 0.5 * config.seam_gap_mm
    }

    /// The distance along the hinge's axis beyond which half B's lip keeps [`Joint::relief_mm`]
    /// without being cut, mm.
    pub fn relief_half_width(&self, config: &StencilConfig) -> f64 {
        let clear = |y: f64| {
            (0..=40).all(|i| {
                let z = self.lip_mm * (f64::from(i) / 20.0 - 1.0);
                let face = self.cone_mm(z) - self.half_gap_mm;
                let x = (face * face - y * y).max(0.0).sqrt();
                (self.axis_mm - x).hypot(z) > self.relief_mm(y, config)
            })
        };
        let steps = (self.cone_narrow_mm / 0.25) as usize;
        let widths = (1..steps).map(|i| 0.25 * i as f64);
        widths
            .clone()
            .find(|&y| clear(y))
            .unwrap_or(0.8 * self.cone_narrow_mm)
    }

    /// Radius of the middle of the cone's gap at height `z_mm` of the stencil frame.
    pub fn cone_mm(&self, z_mm: f64) -> f64 {
        let t = (z_mm + self.lip_mm) / (2.0 * self.lip_mm);
        self.cone_wide_mm + t * (self.cone_narrow_mm - self.cone_wide_mm)
    }
}
