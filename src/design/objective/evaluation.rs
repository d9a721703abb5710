//! What every objective returns.

use crate::geometry::{Spherical, Vec3};

/// A value of a pattern, with its derivative.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// The value.
    pub value: f64,
    /// Derivative with respect to each dot's coordinates (x, y, z). Only its part in the dot's
    /// tangent plane is meaningful; the rest depends on how the value is extended off the sphere.
    pub gradient: Vec<Vec3>,
}

impl Evaluation {
    /// Derivatives with respect to the spherical coordinates, `theta_0, phi_0, theta_1, ...`.
    pub fn spherical_gradient(&self, dots: &[Vec3]) -> Vec<f64> {
        dots.iter()
            .zip(&self.gradient)
            .flat_map(|(d, g)| {
                let j = Spherical::from_direction(d).jacobian();
                [j.d_theta.dot(g), j.d_phi.dot(g)]
            })
            .collect()
    }
}
