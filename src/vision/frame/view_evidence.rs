//! What a frame says of a camera whose intrinsics are not known, and what its orientation makes of more that is known of it.
//!
//! The fit of a frame without intrinsics has the camera `x = (k, e)` among its unknowns: ball radii over the distance and the outline's
//! eccentricity. Dots and outline alone, without what was expected of the camera, have the logarithmic likelihood `s (x - x0) - (x - x0)^T D (x
//! - x0) / 2` about the solution. Where the camera is at `x`, the orientation is turned by `G (x - x0)` and has the covariance `C`: with `H` the
//! information of turn and outline, `B` that of these with `x`, and the gradients `g` of turn and outline and `g_x` of the camera,
//!
//! ```text
//! D = H_xx - B^T H^-1 B,   s = g_x - B^T H^-1 g,   G = -(H^-1 B)_turn,   C = (H^-1)_turn
//! ```
//!
//! Frames of one camera have these in common ([`SequenceView`](crate::clip::SequenceView)).

use nalgebra::{Matrix3, SMatrix, SVector};

use super::config::CameraDistance;
use super::estimate::PrincipalPointPrior;
use crate::geometry::Vec3;

/// Of the turn and the outline.
const OTHERS: usize = 6;
/// And of the camera.
const ALL: usize = 9;

/// A frame's part in what all frames say of their camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewEvidence {
    /// `D`, of the inverse distance and the eccentricity along u and v.
    pub(crate) information: Matrix3<f64>,
    /// `s`.
    pub(crate) slope: Vec3,
    /// `G`.
    pub(crate) gain: Matrix3<f64>,
    /// `C`, rad^2.
    pub(crate) own: Matrix3<f64>,
    /// What was expected of the distance.
    pub(crate) expected: CameraDistance,
    /// Where the camera's axis was expected, in whole pictures.
    pub(crate) axis: Option<PrincipalPointPrior>,
}

impl ViewEvidence {
    /// By the information and the gradient of turn, outline and camera that dots and outline have; `None` where they leave turn or outline
    /// open.
    pub(crate) fn new(
        seen: &SMatrix<f64, ALL, ALL>,
        gradient: &SVector<f64, ALL>,
        expected: CameraDistance,
        axis: Option<PrincipalPointPrior>,
    ) -> Option<Self> {
        let others = seen.fixed_view::<OTHERS, OTHERS>(0, 0).into_owned();
        let inverse = others.cholesky()?.inverse();
        let with_camera = seen.fixed_view::<OTHERS, 3>(0, OTHERS).into_owned();
        let moved = inverse * with_camera;
        let information = seen.fixed_view::<3, 3>(OTHERS, OTHERS) - with_camera.transpose() * moved;
        Some(Self {
            information: 0.5 * (information + information.transpose()),
            slope: gradient.fixed_rows::<3>(OTHERS)
                - moved.transpose() * gradient.fixed_rows::<OTHERS>(0),
            gain: -moved.fixed_rows::<3>(0),
            own: inverse.fixed_view::<3, 3>(0, 0).into_owned(),
            expected,
            axis,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the solution of the whole system with the camera held elsewhere.
    #[test]
    fn a_camera_held_elsewhere_turns_the_orientation() {
        let root = SMatrix::<f64, ALL, ALL>::from_fn(|i, j| {
            ((3 * i + 5 * j) as f64).sin() + if i == j { 4.0 } else { 0.0 }
        });
        let seen = root * root.transpose();
        let mut gradient = SVector::<f64, ALL>::zeros();
        gradient
            .fixed_rows_mut::<3>(OTHERS)
            .copy_from(&Vec3::new(0.3, -0.2, 0.1));
        let evidence = ViewEvidence::new(&seen, &gradient, CameraDistance::default(), None);
        let evidence = evidence.expect("determined");
        let off = Vec3::new(0.02, -0.01, 0.03);
        // Minimum of x^T S x / 2 over turn and outline.
        let held = seen.fixed_view::<OTHERS, 3>(0, OTHERS) * off;
        let others = seen.fixed_view::<OTHERS, OTHERS>(0, 0).into_owned();
        let others: SVector<f64, OTHERS> = -others.try_inverse().expect("regular") * held;
        let turned = evidence.gain * off;
        assert!((turned - others.fixed_rows::<3>(0)).norm() < 1e-12);
        let mut all = SVector::<f64, ALL>::zeros();
        all.fixed_rows_mut::<OTHERS>(0).copy_from(&others);
        all.fixed_rows_mut::<3>(OTHERS).copy_from(&off);
        let squares = all.dot(&(seen * all));
        let by_camera = off.dot(&(evidence.information * off));
        assert!((squares - by_camera).abs() < 1e-12 * squares.abs());
        assert_eq!(evidence.slope, gradient.fixed_rows::<3>(OTHERS));
    }
}
