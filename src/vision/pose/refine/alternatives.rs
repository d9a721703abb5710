//! Which of several readings of an outline the dots speak for.
//!
//! Without intrinsics an ellipse is that of a ball to either side of the camera's axis. And now and then an outline is not the ball's:
//! a side that no lamp reaches is lost before a dark wall, a shadow or a hand joins it. Its error is then far beyond what its edges
//! state, and dots that are drawn well show it.
//!
//! Readings are compared by Laplace's approximation of their evidence, `-2 ln p = cost + sum ln det S + ln det C + ln det H`, of the dots'
//! covariances `S`, the outline's `C` and the information `H` at the minimum (D. MacKay, "Information Theory, Inference, and Learning Algorithms", 2003, ch. 28).

use nalgebra::Matrix3;

use super::{Drawn, Match, PoseState, Prior, Refiner};
use crate::geometry::{Rotation, Vec3};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::FrameEstimate;

/// Share of the outlines that were found whose error is another than they state.
const ASTRAY: f64 = 0.05;
/// Standard deviation of center and radius of those, radii.
const ASTRAY_RADII: f64 = 0.06;

/// A reading of the outline.
struct Reading {
    state: PoseState,
    prior: Prior,
    /// Minus two logarithms of its evidence.
    cost: f64,
}

impl Prior {
    /// The outline as that of a ball to the other side of the camera's axis, where it may be.
    fn other_side(&self) -> Option<Self> {
        let is_known = matches!(self.camera, CameraModel::Known(_));
        let mut other = *self;
        other.outline.circle.eccentricity = -other.outline.circle.eccentricity;
        (!is_known && self.outline.circle.is_ellipse()).then_some(other)
    }

    /// The outline as one that is astray, where it was found and the dots can say so.
    fn astray(&self) -> Option<Self> {
        let mut other = *self;
        let sigma = ASTRAY_RADII * self.outline.circle.radius;
        other.outline.covariance += Matrix3::from_diagonal_element(sigma * sigma);
        (self.drawn == Drawn::AsSeen && !self.outline.is_given()).then_some(other)
    }
}

impl Refiner {
    /// The fit under the reading that has most evidence, and the reading.
    pub(super) fn fit_best(
        &self,
        names: &[Vec3],
        prior: &Prior,
        rotation: &Rotation,
        frame: &FrameEstimate,
        matches: &[Match],
    ) -> Option<(PoseState, Prior)> {
        let read = |prior: Prior, odds: f64| {
            let state = self.fit(names, &prior, rotation, frame, matches)?;
            let cost = state.ln_evidence_cost(&prior)? - 2.0 * odds.ln();
            Some(Reading { state, prior, cost })
        };
        let sides = [Some(*prior), prior.other_side()];
        let as_stated = sides.into_iter().flatten();
        let near = as_stated.filter_map(|prior| read(prior, 1.0 - ASTRAY));
        let astray = sides.into_iter().flatten().filter_map(|side| side.astray());
        let far = astray.filter_map(|prior| read(prior, ASTRAY));
        let best = near.chain(far).min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        Some((best.state, best.prior))
    }
}

impl PoseState {
    /// Minus two logarithms of the evidence of a reading, but for what all have in common.
    fn ln_evidence_cost(&self, prior: &Prior) -> Option<f64> {
        let information = self.information.cholesky()?;
        let ln_information: f64 = information.l().diagonal().iter().map(|d| d.ln()).sum();
        let ln_outline = prior.outline.covariance.determinant().ln();
        Some(self.cost + self.ln_spread + ln_outline + 2.0 * ln_information)
    }
}
