//! Theoretical decay of a ball's spin in air.
//!
//! A thin shell of mass m and radius r has the moment of inertia `2/3 m r^2`. In creeping flow the
//! air's torque is `8 pi mu r^3 w` (G. Kirchhoff, 1876; H. Lamb, "Hydrodynamics", 6th ed., sec.
//! 334), with the dynamic viscosity mu, so that the spin decays as `exp(-c t)` with
//!
//! ```text
//! c = 12 pi mu r / m
//! ```
//!
//! For a table tennis ball (20 mm, 2.7 g; mu = 18.1 uPa s) that is 0.00505 /s: the paper's "about
//! 0.005 /s" holds, if its nu is read as the dynamic viscosity (the kinematic one would not even
//! have the unit).
//!
//! The formula is far outside its range, however: it demands a Reynolds number `Re = w r^2 / nu`
//! well below 1, and at 50 revolutions per second Re is 8400. There the torque is that of a laminar
//! boundary layer,
//!
//! ```text
//! T = 1/2 rho w^2 r^5 (6.45 / sqrt(Re) + 32.1 / Re)
//! ```
//!
//! (S. C. R. Dennis, S. N. Singh, D. B. Ingham, "The steady flow due to a rotating sphere at low
//! and moderate Reynolds numbers", J. Fluid Mech. 101, 1980; the leading term is the layer's),
//! which gives 0.063 /s at 50 and 0.087 /s at 100 revolutions per second, within the error of the
//! paper's measured 0.091 +- 0.03 /s. The translation of the ball is left out in both.

/// A ball, as a thin shell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlyingBall {
    /// Radius, meters.
    pub radius_m: f64,
    /// Mass, kilograms.
    pub mass_kg: f64,
}

impl Default for FlyingBall {
    /// Table tennis: 40 mm across, 2.7 g.
    fn default() -> Self {
        Self {
            radius_m: 0.020,
            mass_kg: 0.0027,
        }
    }
}

/// Still air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Air {
    /// Dynamic viscosity mu, Pa s.
    pub viscosity_pa_s: f64,
    /// Density rho, kg/m^3.
    pub density_kg_m3: f64,
}

impl Default for Air {
    /// Dry air at 20 degrees Celsius and 101 325 Pa.
    fn default() -> Self {
        Self {
            viscosity_pa_s: 1.81e-5,
            density_kg_m3: 1.204,
        }
    }
}

/// Rate of decay in creeping flow, `12 pi mu r / m`, 1/s: the paper's formula.
pub fn creeping_decay(ball: &FlyingBall, air: &Air) -> f64 {
    12.0 * std::f64::consts::PI * air.viscosity_pa_s * ball.radius_m / ball.mass_kg
}

/// Rate of decay `-(dw/dt) / w` with a laminar boundary layer, 1/s, at `spin_rad_s` > 0.
///
/// Good for Reynolds numbers from about 10 (where the air is no longer dragged along) to 4e4 (where
/// the layer becomes turbulent): 0.06 to 240 revolutions per second for a table tennis ball.
pub fn boundary_layer_decay(ball: &FlyingBall, air: &Air, spin_rad_s: f64) -> f64 {
    let r = ball.radius_m;
    let reynolds = air.density_kg_m3 * spin_rad_s * r * r / air.viscosity_pa_s;
    let coefficient = 6.45 / reynolds.sqrt() + 32.1 / reynolds;
    let torque = 0.5 * air.density_kg_m3 * spin_rad_s.powi(2) * r.powi(5) * coefficient;
    let inertia = 2.0 / 3.0 * ball.mass_kg * r * r;
    torque / (inertia * spin_rad_s)
}
