//! Which of several readings of an outline the dots speak for.
//!
//! Without intrinsics an ellipse is that of a ball to either side of the camera's axis. And now and then an outline is not the ball's:
//! a side that no lamp reaches is lost before a dark wall, a shadow or a hand joins it. Its error is then far beyond what its edges
//! state, and dots that are drawn well show it.
//!
//! Readings are compared by Laplace's approximation of their evidence, `-2 ln p = cost + sum ln det S + ln det C + ln det H`, of the dots'
//! covariances `S`, the outline's `C` and the information `H` at the minimum (D. MacKay, "Information Theory, Inference, and Learning Algorithms", 2003, ch. 28).

use nalgebra::{Matrix3, SMatrix, SVector};

use super::{Drawn, Match, PARAMETERS, PoseState, Prior, Refiner, offset};
use crate::geometry::{Rotation, Vec3};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::FrameEstimate;

/// Shares of the outlines that were found whose error is as stated, or has a further standard deviation of center and radius, radii.
const ERRORS: [OutlineError; 3] = [
    OutlineError {
        share: 0.75,
        radii: 0.0,
    },
    OutlineError {
        share: 0.2,
        radii: 0.02,
    },
    OutlineError {
        share: 0.05,
        radii: 0.06,
    },
];
/// To either side, with each error.
const MAX_READINGS: usize = 2 * ERRORS.len();
/// A reading less likely than this beside the best adds nothing to the covariance.
const LEAST_SHARE: f64 = 1e-3;

struct OutlineError {
    share: f64,
    radii: f64,
}

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

    /// The outline with a further error, where it was found and the dots can say so.
    fn with_error(&self, error: &OutlineError) -> Option<Self> {
        let mut other = *self;
        let sigma = error.radii * self.outline.circle.radius;
        other.outline.covariance += Matrix3::from_diagonal_element(sigma * sigma);
        let is_open = self.drawn == Drawn::AsSeen && !self.outline.is_given();
        (is_open || error.radii == 0.0).then_some(other)
    }
}

impl Refiner {
    /// The fit under the reading that has most evidence, with the covariance of all, and the reading.
    pub(super) fn fit_best(
        &self,
        names: &[Vec3],
        prior: &Prior,
        rotation: &Rotation,
        frame: &FrameEstimate,
        matches: &[Match],
    ) -> Option<(PoseState, Prior)> {
        let mut readings: [Option<Reading>; MAX_READINGS] = Default::default();
        let sides = [Some(*prior), prior.other_side()];
        let sides = sides.into_iter().flatten();
        let all = sides.flat_map(|side| {
            ERRORS.iter().filter_map(move |error| {
                let prior = side.with_error(error)?;
                let state = self.fit(names, &prior, rotation, frame, matches)?;
                let cost = state.ln_evidence_cost(&prior)? - 2.0 * error.share.ln();
                Some(Reading { state, prior, cost })
            })
        });
        for (place, reading) in readings.iter_mut().zip(all) {
            *place = Some(reading);
        }
        let seen = readings.iter().flatten();
        let best = seen.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        let (mut sum, mut total) = (SMatrix::zeros(), 0.0);
        for reading in readings.iter().flatten() {
            let share = (0.5 * (best.cost - reading.cost)).exp();
            if share < LEAST_SHARE {
                continue;
            }
            let off = reading.state.off(&best.state);
            sum += (reading.state.covariance()? + off * off.transpose()) * share;
            total += share;
        }
        let covariance = sum / total;
        let index = readings
            .iter()
            .position(|r| r.as_ref().is_some_and(|r| std::ptr::eq(r, best)))?;
        let best = readings[index].take()?;
        let state = PoseState {
            information: covariance.try_inverse()?,
            ..best.state
        };
        Some((state, best.prior))
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

    fn covariance(&self) -> Option<SMatrix<f64, PARAMETERS, PARAMETERS>> {
        self.information.try_inverse()
    }

    /// How far it is from another, in the fitted parameters.
    fn off(&self, from: &Self) -> SVector<f64, PARAMETERS> {
        let turn = (self.rotation * from.rotation.inverse()).scaled_axis();
        let (now, then) = (self.view.circle(), from.view.circle());
        let moved = offset(now.center, then.center);
        let drawn_out = now.eccentricity - then.eccentricity;
        let away = self.view.horizon() - from.view.horizon();
        let grown = now.radius - then.radius;
        SVector::from([
            turn.x,
            turn.y,
            turn.z,
            moved.x,
            moved.y,
            grown,
            away,
            drawn_out.x,
            drawn_out.y,
        ])
    }
}
