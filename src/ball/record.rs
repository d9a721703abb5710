//! What a ball's file records beside its dots: the recognizer that its table is made for, the
//! objective that it was designed for, and how its dots were measured.

use serde::{Deserialize, Serialize};

use crate::error::{Result, require};

/// The sum that forms a basis' score in the paper's recognizer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VoteSum {
    /// The sum of `max(ln p, ln 1e-10)`, as in the authors' published code.
    ///
    /// Poor votes are negative, but a dot that casts no vote counts as zero. The correct basis,
    /// supported by many dots of which some are far off, can score below a wrong one with a single
    /// vote. It then drops out of the better half and is never verified.
    LogDensity,
    /// The sum of `p`: a vote never lowers a score, and the correct basis rarely drops out.
    Density,
}

/// Parameters of the paper's recognizer, and of the images that it expects.
///
/// A table's file records them. The last three are in the file where they differ from the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperConfig {
    /// Standard deviation of an observed dot's angular error, radians.
    pub sigma_rad: f64,
    /// Concentration of the Kent density.
    pub kappa: f64,
    /// Ovalness of the Kent density, `0 <= 2 beta < kappa`.
    pub beta: f64,
    /// Standard deviation of `|x|` about 1 in the score, without unit.
    pub alpha: f64,
    /// Minimum z (camera frame, ball of radius 1) of a visible dot.
    pub visibility_limit: f64,
    /// Number of nearest features that vote for each further dot.
    #[serde(default = "paper_k", skip_serializing_if = "is_paper_k")]
    pub k: usize,
    /// Fraction of the bases with votes that is verified, best scores first, in (0, 1].
    #[serde(
        default = "paper_verify_fraction",
        skip_serializing_if = "is_paper_verify_fraction"
    )]
    pub verify_fraction: f64,
    /// The sum that forms a basis' score.
    #[serde(default = "paper_vote_sum", skip_serializing_if = "is_paper_vote_sum")]
    pub vote_sum: VoteSum,
}

impl PaperConfig {
    /// The values of the paper and of its published code: 3 degrees, half the ball visible.
    pub const PAPER: Self = Self {
        sigma_rad: 3f64.to_radians(),
        kappa: 500.0,
        beta: 0.0,
        alpha: 0.03,
        visibility_limit: 0.0,
        k: 20,
        verify_fraction: 0.5,
        vote_sum: VoteSum::LogDensity,
    };
}

fn paper_k() -> usize {
    PaperConfig::PAPER.k
}

fn is_paper_k(k: &usize) -> bool {
    *k == PaperConfig::PAPER.k
}

fn paper_verify_fraction() -> f64 {
    PaperConfig::PAPER.verify_fraction
}

fn is_paper_verify_fraction(fraction: &f64) -> bool {
    *fraction == PaperConfig::PAPER.verify_fraction
}

fn paper_vote_sum() -> VoteSum {
    PaperConfig::PAPER.vote_sum
}

fn is_paper_vote_sum(sum: &VoteSum) -> bool {
    *sum == PaperConfig::PAPER.vote_sum
}

impl Default for PaperConfig {
    /// [`PaperConfig::PAPER`].
    fn default() -> Self {
        Self::PAPER
    }
}

impl PaperConfig {
    /// Checks the fields' domains.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) naming the field.
    pub fn check(&self) -> Result<()> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let (sigma, alpha) = (self.sigma_rad, self.alpha);
        let (kappa, beta) = (self.kappa, self.beta);
        let expected = "a positive number";
        require(positive(sigma), "recognizer.sigma_rad", expected, sigma)?;
        require(positive(alpha), "recognizer.alpha", expected, alpha)?;
        let inside = kappa.is_finite() && kappa >= 0.0;
        require(inside, "recognizer.kappa", "a number not below 0", kappa)?;
        let inside = beta == 0.0 || (beta > 0.0 && 2.0 * beta < kappa);
        require(inside, "recognizer.beta", "0 <= 2 beta < kappa", beta)?;
        let z = self.visibility_limit;
        let inside = (-1.0..1.0).contains(&z);
        let expected = "a number in [-1, 1)";
        require(inside, "recognizer.visibility_limit", expected, z)?;
        require(self.k > 0, "recognizer.k", "at least 1", self.k)?;
        let fraction = self.verify_fraction;
        let inside = fraction > 0.0 && fraction <= 1.0;
        let expected = "a fraction in (0, 1]";
        require(inside, "recognizer.verify_fraction", expected, fraction)
    }
}

/// The objective that a pattern was optimized for, and its value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectiveRecord {
    /// The objective's name.
    pub name: String,
    /// Its value for this pattern.
    pub value: f64,
}

/// How the dots of a calibrated ball were measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationRecord {
    /// [`Pattern::sha256`](crate::Pattern::sha256) of the nominal pattern; `None` where the pattern
    /// was built from images alone.
    pub nominal_sha256: Option<String>,
    /// For each dot its number in the nominal pattern; `None` for a mark that the pattern lacks.
    pub nominal_numbers: Vec<Option<u16>>,
    /// Number of frames that saw each dot; 0 for one that is where the nominal pattern has it.
    pub views: Vec<u32>,
}
