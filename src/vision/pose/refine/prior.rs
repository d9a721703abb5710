//! What is known before the dots are fitted: the outline, the camera's distance and axis.

use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2};

use super::{PARAMETERS, PoseEquations, offset};
use crate::geometry::Vec3;
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::PrincipalPointPrior;
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::{BallCircle, BallView, Camera};
use crate::vision::optics::oval::{Oval, drawn_out, of_circle};

/// Standard deviation of the eccentricity along either axis of the image, where the outline is a circle and where an ellipse was
/// fitted: a ball 5 degrees off the axis has 0.087.
pub(super) const ECCENTRICITY: [f64; 2] = [0.08, 0.05];
/// Of what the axis' place says of the eccentricity to first order.
pub(super) const FIRST_ORDER: f64 = 0.005;
/// One that stays as it is.
pub(super) const FIXED: f64 = 1e-6;
/// That of a ball far outside any camera's view.
pub(super) const MAX_ECCENTRICITY: f64 = 0.9;

/// What is known before the dots are fitted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PosePrior {
    pub outline: Outline,
    /// By how much the outline is drawn out in all, where the image's rim says.
    pub oval: Option<Oval>,
    /// What is known of the camera.
    pub camera: CameraModel,
    /// Where the search for the distance starts: the camera under which the dots are identified.
    pub start: Camera,
    pub drawn: Drawn,
    /// Where the camera's axis is expected.
    pub axis: Option<PrincipalPointPrior>,
}

impl PosePrior {
    /// What it says at a view; `of_outline` is the inverse of the outline's covariance.
    pub(super) fn equations(&self, of_outline: &Matrix3<f64>, view: &BallView) -> PoseEquations {
        let mut all = self.of_outline(of_outline, view);
        self.add_camera(&mut all, view);
        all
    }

    /// What the outline says.
    pub(super) fn of_outline(&self, of_outline: &Matrix3<f64>, view: &BallView) -> PoseEquations {
        let (circle, now) = (&self.outline.circle, view.circle());
        let moved = offset(circle.center, now.center);
        // The mean of the half axes is known, whatever the eccentricity.
        let (growth, by_eccentricity) = of_circle(&now.eccentricity);
        let mean = circle.radius * of_circle(&circle.eccentricity).0;
        let back = Vec3::new(moved.x, moved.y, mean - growth * now.radius);
        let mut by = SMatrix::<f64, 3, PARAMETERS>::zeros();
        (by[(0, 3)], by[(1, 4)], by[(2, 5)]) = (1.0, 1.0, growth);
        (0..2).for_each(|k| by[(2, 7 + k)] = now.radius * by_eccentricity[k]);
        let mut equations = PoseEquations::default();
        equations.add(&by, &back, of_outline);
        equations.cost += back.dot(&(of_outline * back));
        match self.oval.filter(|_| self.drawn == Drawn::AsSeen) {
            Some(oval) => add_oval(&oval, &mut equations, now),
            None if self.has_oval() => self.add_eccentricity(&mut equations, view),
            None => {}
        }
        equations
    }

    /// Whether the outline shows how far it is drawn out, and the dots may follow.
    pub(super) fn has_oval(&self) -> bool {
        let is_unknown = matches!(self.camera, CameraModel::Unknown(_));
        is_unknown && self.outline.circle.is_ellipse() && self.drawn == Drawn::AsSeen
    }

    /// What the outline says of the eccentricity, or where it is a circle that most balls are near the axis.
    pub(super) fn add_eccentricity(&self, equations: &mut PoseEquations, view: &BallView) {
        let circle = &self.outline.circle;
        let sigma = match self.drawn {
            Drawn::AsSeen => ECCENTRICITY[usize::from(circle.is_ellipse())],
            // Dots that may lie anywhere about their places say nothing of the axis.
            Drawn::AsStated => FIXED,
        };
        let away = circle.eccentricity - view.circle().eccentricity;
        (0..2).for_each(|k| equations.hold(7 + k, away[k], sigma));
    }

    /// What it says of the camera alone.
    pub(super) fn add_camera(&self, equations: &mut PoseEquations, view: &BallView) {
        match self.camera {
            CameraModel::Unknown(known) => {
                equations.hold(6, known.inverse_distance - view.horizon(), known.sigma);
                let axis = self.axis.filter(|_| self.drawn == Drawn::AsSeen);
                // Without an ellipse the picture says more of the axis than that most balls are near it.
                if axis.is_none() && !self.has_oval() {
                    self.add_eccentricity(equations, view);
                }
                if let Some(axis) = axis {
                    axis.add_to(equations, view);
                }
            }
            // No dot depends on these: they stay where they are.
            CameraModel::Known(_) => (6..PARAMETERS).for_each(|k| equations.hold(k, 0.0, 1.0)),
        }
    }
}

impl PrincipalPointPrior {
    /// What it says of the eccentricity and the distance at a view: to first order a ball at `off` radii from the axis
    /// has the eccentricity `off / distance`.
    pub(super) fn add_to(&self, equations: &mut PoseEquations, view: &BallView) {
        let (now, horizon) = (view.circle(), view.horizon());
        let off = offset(now.center, self.middle) / now.radius;
        let sigma = self.sigma_px / now.radius * horizon;
        let variance = sigma.powi(2) + FIRST_ORDER.powi(2);
        let misfit = off * horizon - now.eccentricity;
        let mut by = SMatrix::<f64, 2, PARAMETERS>::zeros();
        for k in 0..2 {
            (by[(k, 6)], by[(k, 7 + k)]) = (-off[k], 1.0);
        }
        equations.add(
            &by,
            &misfit,
            &Matrix2::from_diagonal_element(1.0 / variance),
        );
        equations.cost += misfit.norm_squared() / variance;
    }
}

/// What a measured oval says of eccentricity and radius.
fn add_oval(oval: &Oval, equations: &mut PoseEquations, now: &BallCircle) {
    let (expected, by) = drawn_out(now);
    let misfit = oval.stretch_px - expected;
    let Some(inverse) = oval.covariance.try_inverse() else {
        return;
    };
    let mut by_parameters = SMatrix::<f64, 2, PARAMETERS>::zeros();
    by_parameters
        .fixed_columns_mut::<1>(5)
        .copy_from(&by.column(0));
    by_parameters
        .fixed_columns_mut::<2>(7)
        .copy_from(&by.fixed_columns::<2>(1));
    equations.add(&by_parameters, &misfit, &inverse);
    equations.cost += misfit.dot(&(inverse * misfit));
}

/// How far the dots of a ball are believed to lie from where its placement has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drawn {
    /// As far as it states.
    AsStated,
    /// As far as they are seen to, at most as it states.
    AsSeen,
}

/// An eccentricity that an outline can have.
pub(super) fn bounded(eccentricity: Vector2<f64>) -> Vector2<f64> {
    let length = eccentricity.norm();
    eccentricity * (MAX_ECCENTRICITY / length.max(MAX_ECCENTRICITY))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::optics::camera::Pixel;

    /// What the axis says, as a cost; its gradient is minus a half of the cost's.
    #[test]
    fn the_gradient_of_the_axis_is_that_of_its_cost() {
        let axis = PrincipalPointPrior {
            middle: Pixel { u: 319.5, v: 239.5 },
            sigma_px: 25.6,
        };
        let at = |inverse_distance: f64, eccentricity: Vector2<f64>| {
            let circle = BallCircle {
                center: Pixel { u: 500.0, v: 100.0 },
                radius: 30.0,
                eccentricity,
            };
            let camera = Camera::Near { inverse_distance };
            let view = BallView::new(&camera, circle).expect("a view");
            let mut said = PoseEquations::default();
            axis.add_to(&mut said, &view);
            (said.cost, said.gradient, said.information, view.horizon())
        };
        let e = Vector2::new(0.2, -0.1);
        let (_, gradient, information, _) = at(0.05, e);
        let step = 1e-6;
        for k in 0..2 {
            let mut moved = [e, e];
            moved[0][k] += step;
            moved[1][k] -= step;
            let [more, less] = moved.map(|e| at(0.05, e).0);
            let slope = (more - less) / (2.0 * step);
            let off = (slope + 2.0 * gradient[7 + k]).abs();
            assert!(off < 1e-4 * slope.abs().max(1.0), "{slope} {gradient:?}");
        }
        // By the distance the spread changes, too, which a step of Gauss and Newton leaves out: its sign is right.
        let (far, near) = (at(0.05 - step, e), at(0.05 + step, e));
        assert!((near.3 - far.3 - 2.0 * step).abs() < 1e-9);
        assert!((information - information.transpose()).norm() == 0.0);
        let misfit = offset(Pixel { u: 500.0, v: 100.0 }, axis.middle) / 30.0 * 0.05 - e;
        assert_eq!(gradient[7].signum(), misfit.x.signum());
    }
}
