//! How much noise a pattern tolerates for certain, whatever the view: its distance to the nearest
//! confusion, with a certificate that can be checked.
//!
//! An error-correcting code has a Hamming distance: fewer errors than half of it never turn one word
//! into another. A pattern has such a distance too. Let `k` of its dots be detected, each displaced by
//! less than an angle `e`. A wrong pose explains them as well, where it also leaves every one of them
//! within `e` of a dot: then some rotation lays the `k` dots within `2 e` of `k` others. With the
//! smallest such angle `d_k` over all rotations, all `k` dots that some view shows together, and all
//! ways to take at least one of them for another,
//!
//! ```text
//! e_k = d_k / 2
//! ```
//!
//! is guaranteed: as long as every displacement stays below it, no wrong explanation is as good as the
//! right one, by the largest displacement that each needs. Any number of the other dots may be missed.
//! The same holds for the dots of the mirror image: below their `e_k` no flipped image is taken for
//! one of the ball.
//!
//! The distance is found by branch and bound ([`certify`]) to within a tolerance, which is subtracted.
//! [`Certificate::check`] verifies a certificate by other means and without the search: it looks at
//! the example of each nearest confusion, and covers all rotations again, by another parameterization,
//! to see that there is no nearer one.
//!
//! It does not cover false dots, and it says nothing about noise above `e_k`: most displacements that
//! are larger cause no confusion either.

mod check;
mod search;
mod visible;

#[cfg(feature = "native")]
use std::path::Path;

use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

use crate::concurrency;
#[cfg(feature = "native")]
use crate::error::Error;
use crate::error::{Result, require};
#[cfg(feature = "native")]
use crate::files;
use crate::pattern::Pattern;
use search::{Found, Problem};
use visible::VisibleSets;

/// Version of the certificate's format.
pub const CERTIFICATE_VERSION: u32 = 1;
/// Fewest detected dots of a guarantee: two leave mirror images open.
pub const MIN_COUNT: usize = 3;
/// Most detected dots of a guarantee. What holds for so many holds for more.
pub const MAX_COUNT: usize = 8;

/// Configuration of a certificate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CertifyConfig {
    /// Minimum z of a dot that can be detected.
    pub visibility_limit: f64,
    /// The guaranteed displacement lies below the true one by at most this, radians.
    pub tolerance_rad: f64,
}

impl Default for CertifyConfig {
    /// Dots with z > 0.15, as in the `image` protocol; 0.02 degrees.
    fn default() -> Self {
        Self {
            visibility_limit: 0.15,
            tolerance_rad: 0.02f64.to_radians(),
        }
    }
}

impl CertifyConfig {
    fn check(&self) -> Result<()> {
        let limit = self.visibility_limit;
        let inside = (0.0..1.0).contains(&limit);
        require(inside, "visibility_limit", "a z in [0, 1)", limit)?;
        let degrees = self.tolerance_rad.to_degrees();
        let inside = (1e-3..=5.0).contains(&degrees);
        require(inside, "tolerance_rad", "0.001 to 5 degrees", degrees)
    }
}

/// What dots are taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TakenFor {
    /// Other dots of the pattern.
    Others,
    /// Dots of its mirror image: each opposite to one of the pattern's.
    Mirrored,
}

impl TakenFor {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Others, Self::Mirrored];

    fn is_mirrored(self) -> bool {
        self == Self::Mirrored
    }
}

/// The guarantee for one number of detected dots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Guarantee {
    /// What the dots are taken for.
    pub taken_for: TakenFor,
    /// Detected dots, or more.
    pub detected: usize,
    /// Displacements below this are never confused, radians.
    pub guaranteed_rad: f64,
    /// Displacements of this size are confused in the example, radians.
    pub confused_rad: f64,
    /// The example's rotation, a unit quaternion `w, x, y, z`: it lays the seen dots near the others.
    pub rotation: [f64; 4],
    /// The example's dots.
    pub seen: Vec<usize>,
    /// The dots that they are taken for, in this order.
    pub other: Vec<usize>,
}

/// A pattern's guarantees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// [`CERTIFICATE_VERSION`].
    pub format_version: u32,
    /// SHA-256 of the pattern.
    pub pattern_sha256: String,
    /// Minimum z of a dot that can be detected.
    pub visibility_limit: f64,
    /// Fewest dots that a view shows.
    pub min_visible: usize,
    /// By what they are taken for and their number; none for more than any view shows.
    pub guarantees: Vec<Guarantee>,
}

/// Finds the guarantees of a pattern. The time grows with the number of dots and the inverse of the
/// smallest distance: below a second for 20 dots, some seconds for 32.
///
/// # Errors
/// [`Error::Argument`] for a configuration outside its domain.
pub fn certify(pattern: &Pattern, config: &CertifyConfig) -> Result<Certificate> {
    config.check()?;
    let visible = VisibleSets::new(pattern.dots(), config.visibility_limit);
    // The search is exact in the distance between two dots, of which each displacement is half.
    let tolerance = 2.0 * config.tolerance_rad;
    let found = concurrency::map(&TakenFor::ALL, |taken_for| {
        Problem::new(pattern.dots(), &visible, taken_for.is_mirrored()).nearest(tolerance)
    });
    let mut guarantees = Vec::new();
    for (taken_for, nearest) in TakenFor::ALL.into_iter().zip(found) {
        for (detected, found) in nearest.into_iter().enumerate() {
            if let Some(found) = found {
                guarantees.push(guarantee(taken_for, detected, found, tolerance));
            }
        }
    }
    Ok(Certificate {
        format_version: CERTIFICATE_VERSION,
        pattern_sha256: pattern.sha256(),
        visibility_limit: config.visibility_limit,
        min_visible: pattern.min_visible(config.visibility_limit),
        guarantees,
    })
}

fn guarantee(taken_for: TakenFor, detected: usize, found: Found, tolerance: f64) -> Guarantee {
    let q = UnitQuaternion::from_scaled_axis(found.rotation_vector);
    Guarantee {
        taken_for,
        detected,
        guaranteed_rad: 0.5 * (found.angle - tolerance).max(0.0),
        confused_rad: 0.5 * found.angle,
        rotation: [q.w, q.i, q.j, q.k],
        seen: found.seen,
        other: found.other,
    }
}

/// Whether `detected` dots of any view, each displaced by less than `angle_rad`, are never taken for
/// others. Faster than [`certify`], which finds the largest such angle.
///
/// # Errors
/// [`Error::Argument`] for a number of dots or an angle outside their domains.
pub fn is_guaranteed(
    pattern: &Pattern,
    visibility_limit: f64,
    detected: usize,
    angle_rad: f64,
) -> Result<bool> {
    let inside = (MIN_COUNT..=MAX_COUNT).contains(&detected);
    require(inside, "detected", "3 to 8 dots", detected)?;
    let degrees = angle_rad.to_degrees();
    let inside = degrees > 0.0 && degrees < 90.0;
    require(
        inside,
        "min_certified_rad",
        "an angle of 0 to 90 degrees",
        degrees,
    )?;
    let visible = VisibleSets::new(pattern.dots(), visibility_limit);
    let problem = Problem::new(pattern.dots(), &visible, false);
    Ok(problem.guaranteed(detected, 2.0 * angle_rad))
}

impl Certificate {
    /// The guarantee for so many detected dots, or for [`MAX_COUNT`] where there are more; `None` where
    /// no view shows so many.
    pub fn guarantee(&self, taken_for: TakenFor, detected: usize) -> Option<&Guarantee> {
        let detected = detected.min(MAX_COUNT);
        let of = |g: &&Guarantee| g.taken_for == taken_for && g.detected == detected;
        self.guarantees.iter().find(of)
    }

    /// The guarantee where at most so many of the visible dots of any view are missed; `None` where
    /// that may leave fewer than three.
    pub fn with_missed(&self, taken_for: TakenFor, missed: usize) -> Option<&Guarantee> {
        let detected = self.min_visible.checked_sub(missed)?;
        self.guarantee(taken_for, detected)
    }

    /// Reads a certificate.
    ///
    /// # Errors
    /// [`Error::Read`] where the file cannot be read, [`Error::Input`] where it is no certificate of
    /// this version.
    #[cfg(feature = "native")]
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = files::read_bytes(path)?;
        let found: Self = serde_json::from_slice(&bytes)
            .map_err(|e| Error::input(path, format!("line {}", e.line()), e.to_string()))?;
        if found.format_version != CERTIFICATE_VERSION {
            let problem = format!(
                "expected {CERTIFICATE_VERSION}, found {}",
                found.format_version
            );
            return Err(Error::input(path, "format_version", problem));
        }
        Ok(found)
    }

    /// Writes the certificate, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure.
    #[cfg(feature = "native")]
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut json = serde_json::to_vec_pretty(self)
            .map_err(|e| Error::Internal(format!("certificate as JSON: {e}")))?;
        json.push(b'\n');
        files::write_bytes(path, &json)
    }
}
