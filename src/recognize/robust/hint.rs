//! Prior knowledge of the orientation.
//!
//! With the probability `1 - wrong` the true rotation is `exp([e]x) R_hint` with `e ~ N(0, C)` in
//! the camera frame; otherwise any rotation is as likely as any other. The evidence of an
//! explanation whose own rotation has the covariance `H^-1` is multiplied by this prior's density
//! over the uniform one, `(1 - wrong) 8 pi^2 N(e; 0, C + H^-1) + wrong`.

use std::f64::consts::TAU;

use nalgebra::Matrix3;

use super::model::PreparedDot;
use crate::geometry::{ROTATIONS, to_rotation};
use crate::recognize::Hint;

/// Maximum widening of the dots' variances for the first assignment from the hint's rotation.
const MAX_WIDENING: f64 = 30.0;

/// A checked hint.
#[derive(Debug, Clone, Copy)]
pub(super) struct HintPrior {
    rotation: Matrix3<f64>,
    covariance: Matrix3<f64>,
    wrong: f64,
}

impl HintPrior {
    /// `None` where the covariance is not positive definite or `wrong` no probability in (0, 1).
    pub fn new(hint: &Hint) -> Option<Self> {
        let symmetric = 0.5 * (hint.covariance + hint.covariance.transpose());
        symmetric.cholesky()?;
        let is_probability = hint.wrong > 0.0 && hint.wrong < 1.0;
        let is_finite = hint.rotation.coords.iter().all(|x| x.is_finite());
        (is_probability && is_finite).then_some(Self {
            rotation: *hint.rotation.to_rotation_matrix().matrix(),
            covariance: symmetric,
            wrong: hint.wrong,
        })
    }

    pub fn rotation(&self) -> Matrix3<f64> {
        self.rotation
    }

    /// Variance ratio of a first assignment of dots that the hint's error has moved.
    pub fn widening(&self, dots: &[PreparedDot]) -> f64 {
        let max_radial = dots.iter().map(|d| d.radial).fold(0.0, f64::max);
        (1.0 + self.covariance.trace() / 3.0 * max_radial).min(MAX_WIDENING)
    }

    /// ln of the prior density at a rotation over the uniform density; `information` is the
    /// rotation's own.
    pub fn ln_ratio(&self, rotation: &Matrix3<f64>, information: Option<&Matrix3<f64>>) -> f64 {
        // By the quaternion: the logarithm of a matrix is undefined at a half-turn, where it is
        // symmetric.
        let e = to_rotation(&(rotation * self.rotation.transpose())).scaled_axis();
        let own = information.and_then(|h| h.try_inverse());
        let covariance = own.map_or(self.covariance, |own| self.covariance + own);
        let Some(factor) = covariance.cholesky() else {
            return self.wrong.ln();
        };
        let root_det = factor.l_dirty().diagonal().product();
        let distance = e.dot(&factor.solve(&e));
        let peak = ROTATIONS / (TAU.powf(1.5) * root_det);
        ((1.0 - self.wrong) * peak * (-0.5 * distance).exp() + self.wrong).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Rotation, Vec3, random_direction, random_rotation};
    use rand::SeedableRng;
    use std::f64::consts::PI;

    /// The prior at rotations that are known angles off, against the density written out.
    #[test]
    fn the_prior_is_its_density_up_to_half_a_turn() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let sigma = 0.8;
        for angle in [0.0, 1e-9, 0.3, 2.0, 3.0, PI - 1e-6, PI - 1e-9, PI] {
            for axis in [Vec3::x(), Vec3::y(), Vec3::z(), random_direction(&mut rng)] {
                let rotation = random_rotation(&mut rng);
                let prior =
                    HintPrior::new(&Hint::isotropic(rotation, sigma)).expect("a covariance");
                let moved = Rotation::from_scaled_axis(axis * angle) * rotation;
                let found = prior.ln_ratio(moved.to_rotation_matrix().matrix(), None);
                let normal = (-0.5 * (angle / sigma).powi(2)).exp() / (TAU.sqrt() * sigma).powi(3);
                let expected = (0.95 * ROTATIONS * normal + 0.05).ln();
                assert!(
                    (found - expected).abs() < 1e-6,
                    "{angle} about {axis}: {found}, expected {expected}"
                );
            }
        }
    }
}
