//! Configuration of the robust recognizer: the expected images, and the extent of the search.

use crate::error::{Result, require};

/// Distribution of the displacements of real dots, for a given covariance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseShape {
    /// A mixture of two Gaussians: nine dots in ten with the given covariance `C`, one in ten from
    /// a Gaussian twice as wide. Manual placement and detectors have heavier tails than one
    /// Gaussian. At the Mahalanobis distance `u` it has `0.9 exp(-u^2 / 2) + 0.1 / 4 exp(-u^2 / 8)`
    /// times the Gaussian's density at 0.
    Gaussian,
    /// A rotation about an axis uniform on the sphere by a normal angle, as the SpinDOE paper makes
    /// its noise. With the standard deviation `s` per tangent axis the displacement `s u` has
    /// `sqrt(pi / 6) / u erfc(u / sqrt 6)` times the Gaussian's density at 0: peaked, with heavy
    /// tails.
    RandomAxis,
}

/// What the recognizer expects of the images, and the extent of its search.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RobustConfig {
    /// Minimum z of a visible dot (camera frame, ball of radius 1).
    pub visibility_limit: f64,
    /// Probability that a dot well inside the visible cap is detected.
    pub detection_probability: f64,
    /// Expected number of false dots in a view.
    pub expected_false_dots: f64,
    /// Number of false dots that nearly every view has, where it is known (a mark on the ball, a
    /// protocol with a fixed number); `None` where it varies (Poisson).
    pub usual_false_dots: Option<u16>,
    /// Prior probability that a view does not show the pattern at all.
    pub null_prior: f64,
    /// Distribution of the real dots' displacements.
    pub noise: NoiseShape,
    /// Maximum number of pairs of observed dots that the search aligns with the pattern.
    pub passes: usize,
    /// Probability of the pose below which a view is also searched mirrored; 1 searches every view.
    #[serde(default = "default_mirror_doubt")]
    pub mirror_doubt: f64,
}

/// Below this a view is searched mirrored by default.
fn default_mirror_doubt() -> f64 {
    0.9
}

impl Default for RobustConfig {
    /// z > 0 visible, 90 % detected, half a false dot a view, one view in five of something else,
    /// noise of a detector, at most 64 pairs; mirrored where the pose is less likely than 0.9.
    fn default() -> Self {
        Self {
            visibility_limit: 0.0,
            detection_probability: 0.9,
            expected_false_dots: 0.5,
            usual_false_dots: None,
            null_prior: 0.2,
            noise: NoiseShape::Gaussian,
            passes: 64,
            mirror_doubt: default_mirror_doubt(),
        }
    }
}

impl RobustConfig {
    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) naming the parameter.
    pub fn check(&self) -> Result<()> {
        let is_probability = |x: f64| x > 0.0 && x < 1.0;
        let z = self.visibility_limit;
        let inside = (-1.0..1.0).contains(&z);
        require(inside, "visibility_limit", "a z in [-1, 1)", z)?;
        let p = self.detection_probability;
        let expected = "a probability in (0, 1)";
        require(is_probability(p), "detection_probability", expected, p)?;
        let mean = self.expected_false_dots;
        let inside = mean > 0.0 && mean.is_finite();
        require(inside, "expected_false_dots", "a positive number", mean)?;
        let p = self.null_prior;
        require(is_probability(p), "null_prior", expected, p)?;
        require(self.passes > 0, "passes", "1 or more", self.passes)?;
        let p = self.mirror_doubt;
        let inside = (0.0..=1.0).contains(&p);
        require(inside, "mirror_doubt", "a probability", p)?;
        Ok(())
    }
}
