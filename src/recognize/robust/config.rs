//! What the robust recognizer is told of the images, and how far it searches.

use crate::error::{Error, Result};

/// How the displacements of real dots are distributed, for a given covariance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseShape {
    /// Gaussian, with one dot in ten from a Gaussian twice as wide: hands and detectors err with
    /// heavier tails than one Gaussian has.
    Gaussian,
    /// A rotation about an axis uniform on the sphere by a normal angle, as the SpinDOE paper makes its
    /// noise. With the standard deviation `s` per tangent axis the displacement `s u` has
    /// `sqrt(pi / 6) / u erfc(u / sqrt 6)` times the Gaussian's density at 0: peaked, with heavy tails.
    RandomAxis,
}

/// What the recognizer expects of the images.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RobustConfig {
    /// Least z of a dot that can be seen (camera frame, ball of radius 1).
    pub visibility_limit: f64,
    /// Probability that a dot well inside the visible cap is detected.
    pub detection_probability: f64,
    /// Expected number of false dots in a view.
    pub expected_false_dots: f64,
    /// Number of false dots that nearly every view has, where that is known (a mark on the ball, a
    /// protocol that adds so many); `None` where their number varies (Poisson).
    pub usual_false_dots: Option<u16>,
    /// Prior probability that a view does not show the pattern at all.
    pub null_prior: f64,
    /// How real dots are displaced.
    pub noise: NoiseShape,
    /// Most pairs of observed dots that are laid on the pattern before the search ends.
    pub passes: usize,
}

impl Default for RobustConfig {
    /// z > 0 visible, 90 % detected, half a false dot a view, one view in five of something else, noise of
    /// a detector, at most 64 pairs.
    fn default() -> Self {
        Self {
            visibility_limit: 0.0,
            detection_probability: 0.9,
            expected_false_dots: 0.5,
            usual_false_dots: None,
            null_prior: 0.2,
            noise: NoiseShape::Gaussian,
            passes: 64,
        }
    }
}

impl RobustConfig {
    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        let open_unit = |x: f64| x > 0.0 && x < 1.0;
        let fail =
            |name: &'static str, what: &str| Err(Error::argument(name, format!("expected {what}")));
        if !(-1.0..1.0).contains(&self.visibility_limit) {
            return fail("visibility_limit", "a z in [-1, 1)");
        }
        if !open_unit(self.detection_probability) {
            return fail("detection_probability", "a probability in (0, 1)");
        }
        if !(self.expected_false_dots > 0.0 && self.expected_false_dots.is_finite()) {
            return fail("expected_false_dots", "a positive number");
        }
        if !open_unit(self.null_prior) {
            return fail("null_prior", "a probability in (0, 1)");
        }
        if self.passes == 0 {
            return fail("passes", "at least 1");
        }
        Ok(())
    }
}
