//! How far the dots of a measured ball may lie from where its pattern has them.
//!
//! A calibration leaves each dot a covariance. The image refinement takes it as it is. A recognizer
//! takes a variance per tangent axis: for the covariance `C` of a dot, singular along the dot, it is
//! `tr C / 2`. The smallest one is common to all dots and counts as noise of the observed ones; what
//! a dot has beyond it makes that dot count less than the others.

use nalgebra::{Matrix2, Matrix3};

use super::record::CalibrationRecord;
use crate::error::{Error, Result, require};
use crate::geometry::{Vec3, tangent_frame};

/// A variance beyond this is no measurement, rad^2.
const MAX_VARIANCE: f64 = 1.0;

/// Variances of the places of a measured ball's dots, per tangent axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// What every dot has, rad^2.
    pub common_rad2: f64,
    /// What each dot has beyond that, rad^2.
    pub beyond_rad2: Vec<f64>,
}

impl Placement {
    /// The variances of dots with these covariances, rad^2.
    pub(super) fn of(covariances: &[Matrix3<f64>]) -> Self {
        let variances: Vec<f64> = covariances.iter().map(|c| 0.5 * c.trace()).collect();
        let common_rad2 = variances.iter().copied().fold(f64::INFINITY, f64::min);
        Self {
            common_rad2,
            beyond_rad2: variances.iter().map(|v| v - common_rad2).collect(),
        }
    }
}

/// Checks that there is a covariance and a record for each dot.
pub(super) fn check(
    dots: &[Vec3],
    covariances: &[Matrix3<f64>],
    record: &CalibrationRecord,
) -> Result<()> {
    let n = dots.len();
    for (name, found) in [
        ("dot_covariances", covariances.len()),
        ("nominal_numbers", record.nominal_numbers.len()),
        ("views", record.views.len()),
    ] {
        require(found == n, name, &format!("{n} of them"), found)?;
    }
    let mut each = dots.iter().zip(covariances);
    if let Some(j) = each.position(|(d, c)| !is_covariance(d, c)) {
        let problem = format!(
            "dot {j}: expected a covariance in the plane across the dot, found {:?}",
            covariances[j].as_slice()
        );
        return Err(Error::argument("dot_covariances", problem));
    }
    Ok(())
}

/// Whether this is a covariance of a direction: symmetric, of positive variance in the plane across it,
/// of none along it.
fn is_covariance(direction: &Vec3, covariance: &Matrix3<f64>) -> bool {
    let scale = covariance.trace();
    let [e1, e2] = tangent_frame(direction);
    let across = Matrix2::new(
        e1.dot(&(covariance * e1)),
        e1.dot(&(covariance * e2)),
        e2.dot(&(covariance * e1)),
        e2.dot(&(covariance * e2)),
    );
    let small = 1e-6 * scale;
    // A NaN fails the first comparison.
    scale > 0.0
        && scale <= MAX_VARIANCE
        && (covariance - covariance.transpose()).amax() <= small
        && (covariance * direction).amax() <= small
        && across.determinant() > 0.0
}
