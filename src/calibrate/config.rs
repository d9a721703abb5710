//! Settings of the calibration.

use crate::error::{Result, require};
use crate::vision::EstimatorConfig;

/// What is expected of the ball and of the clip.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationConfig {
    /// The estimator's settings: its camera holds for the clip. Its placement error is that of the
    /// first identification, before anything is calibrated.
    pub estimator: EstimatorConfig,
    /// Expected standard deviation of a drawn dot from its nominal place along one tangent axis,
    /// radians. It is the prior of every dot: what no frame shows stays there, with this error.
    pub placement_sigma_rad: f64,
    /// Standard deviation of the error that all views of a dot share, along one tangent axis, radians:
    /// its ink is not where its middle is, and the detector prefers one side. No view shows it; it is
    /// added to every dot's covariance. Beside print and on seams it is larger, and so are the variances
    /// that the detector states: where these are larger than those of the ball's middle dot, this
    /// standard deviation grows with their ratio.
    pub shared_sigma_rad: f64,
    /// Maximum angle from its nominal place at which a mark is taken for a dot drawn far off, radians.
    pub max_offset_rad: f64,
    /// Minimum number of frames with an orientation.
    pub min_frames: usize,
    /// Minimum probability of an orientation that takes part in the fit.
    pub trusted: f64,
    /// Minimum share of the frames with a ball that must be identified: fewer show another ball.
    pub min_identified: f64,
    /// Maximum number of rounds of fit and identification.
    pub rounds: usize,
    /// Whether steady marks that the pattern lacks are taken into it.
    pub learn_extra: bool,
    /// Whether a smooth rotation is used where the times allow.
    pub smooth: bool,
}

impl Default for CalibrationConfig {
    /// Dots drawn to 3 deg, with 0.05 deg that all views of a dot share (measured on rendered clips), marks
    /// up to 12 deg off; 5 frames or more of a probability of 0.9, a third of those with a ball; 4 rounds;
    /// nothing extra; a smooth rotation.
    fn default() -> Self {
        Self {
            estimator: EstimatorConfig::default(),
            placement_sigma_rad: 3f64.to_radians(),
            shared_sigma_rad: 0.05f64.to_radians(),
            max_offset_rad: 12f64.to_radians(),
            min_frames: 5,
            trusted: 0.9,
            min_identified: 1.0 / 3.0,
            rounds: 4,
            learn_extra: false,
            smooth: true,
        }
    }
}

impl CalibrationConfig {
    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) naming the setting.
    pub fn check(&self) -> Result<()> {
        self.estimator.check()?;
        let sigma = self.placement_sigma_rad;
        let expected = "a positive angle below 0.5 rad";
        let inside = sigma > 0.0 && sigma < 0.5;
        require(inside, "placement_sigma_rad", expected, sigma)?;
        let shared = self.shared_sigma_rad;
        let inside = (0.0..0.5).contains(&shared);
        let expected_shared = "0 or more and below 0.5 rad";
        require(inside, "shared_sigma_rad", expected_shared, shared)?;
        let offset = self.max_offset_rad;
        let inside = offset > 0.0 && offset < 0.5;
        require(inside, "max_offset_rad", expected, offset)?;
        let expected = "3 frames or more";
        require(
            self.min_frames >= 3,
            "min_frames",
            expected,
            self.min_frames,
        )?;
        for (name, p) in [
            ("trusted", self.trusted),
            ("min_identified", self.min_identified),
        ] {
            require((0.0..=1.0).contains(&p), name, "a probability", p)?;
        }
        require(self.rounds > 0, "rounds", "1 or more", self.rounds)
    }
}
