//! The cost of a bundle, and its normal equations at the point where it stands.

use nalgebra::{
    DMatrix, Matrix2, Matrix2x3, Matrix3, Matrix3x2, Matrix3x6, SMatrix, SVector, Vector2,
};

use super::camera::{FrameView, Neighbors, OPTICS, SHARED};
use super::motion::SPIN;
use super::schur::{BLOCK, NormalEquations};
use super::{Bundle, BundleFrame, LOSS, Observation, Weighting, offset};
use crate::geometry::{Rotation, Vec3, tangent_frame};
use crate::vision::optics::camera::Pixel;

/// Stiffness of the gauge's condition over the largest information of a dot.
const GAUGE: f64 = 1e3;
/// Share of an outline's error that the next frame's keeps beside what all frames share: the light and
/// the ball's marks turn on slowly.
const KEPT: f64 = 0.5;
/// Start of the outline within a frame's block.
const OUTLINE: usize = 3;

/// The derivatives of a detection's expected place.
pub(super) struct ProjectionJacobian {
    pub pixel: Pixel,
    pub of_frame: SMatrix<f64, 2, BLOCK>,
    by_dot: Matrix2<f64>,
    by_shared: SMatrix<f64, 2, SHARED>,
}

impl Bundle {
    pub(super) fn view(&self, frame: &BundleFrame) -> Option<FrameView> {
        self.camera.view(&frame.circle)
    }

    /// The cost; `None` where an outline has left its domain.
    pub(super) fn cost(&self) -> Option<f64> {
        let mut cost = self.prior_cost() + self.outline_cost()?;
        for frame in &self.frames {
            let FrameView { view, to_view } = self.view(frame)?;
            let turn = to_view * frame.rotation;
            for seen in &frame.observations {
                let at = view.project(&(turn * self.dots[seen.dot]));
                let inverse = (seen.covariance * self.variance_scale).try_inverse()?;
                let off = offset(seen.pixel, at);
                let distance = off.dot(&(inverse * off));
                cost += 0.5 * LOSS.cost(distance);
            }
        }
        Some(cost)
    }

    /// The part of the cost from the priors of dots, camera and motion.
    fn prior_cost(&self) -> f64 {
        let mut cost = 0.0;
        for (dot, prior) in self.dots.iter().zip(&self.priors) {
            cost += 0.5 * (dot - prior.direction).norm_squared() / prior.sigma_rad.powi(2);
        }
        for known in self.camera.prior() {
            cost += 0.5 * known.information * known.off * known.off;
        }
        if let Some(motion) = &self.motion {
            cost += motion.cost(&self.rotations(), &self.spins);
        }
        cost
    }

    pub(super) fn rotations(&self) -> Vec<Rotation> {
        self.frames.iter().map(|f| f.rotation).collect()
    }

    /// From the outline as found to the outline as it is seen: center and mean of the half axes.
    fn outline_offset(&self, frame: &BundleFrame) -> Vec3 {
        let found = &frame.outline.circle;
        let moved = offset(frame.circle.center, found.center);
        let grown = frame.circle.radius - self.camera.mean_radius(found);
        let beyond_circle = self.camera.beyond_circle(&frame.circle);
        Vec3::new(moved.x, moved.y, grown) + beyond_circle + self.camera.outline_bias
    }

    /// The axes of the dots' coordinates.
    pub(super) fn axes(&self) -> Vec<Matrix3x2<f64>> {
        let of = |d: &Vec3| Matrix3x2::from_columns(&tangent_frame(d));
        self.dots.iter().map(of).collect()
    }

    /// Fills the normal equations, which are zero; returns the cost.
    pub(super) fn linearize(
        &self,
        equations: &mut NormalEquations,
        weighting: Weighting,
    ) -> Option<f64> {
        let axes = self.axes();
        for (k, frame) in self.frames.iter().enumerate() {
            let view = self.view(frame)?;
            let neighbors = self.camera.neighbors(&frame.circle);
            self.add_outline(equations, k, frame)?;
            for seen in &frame.observations {
                let axes = &axes[seen.dot];
                let p = self.projection(&view, neighbors.as_ref(), frame, seen.dot, axes);
                self.add_observation(equations, k, seen, &p, weighting)?;
            }
            if self.motion.is_none() {
                for i in SPIN..BLOCK {
                    equations.diagonal[k][(i, i)] = 1.0;
                }
            }
        }
        self.add_priors(equations, &axes);
        self.cost()
    }

    pub(super) fn projection(
        &self,
        FrameView { view, to_view }: &FrameView,
        neighbors: Option<&Neighbors>,
        frame: &BundleFrame,
        dot: usize,
        axes: &Matrix3x2<f64>,
    ) -> ProjectionJacobian {
        let to_view = to_view.to_rotation_matrix();
        let turned = frame.rotation * self.dots[dot];
        let q = to_view * turned;
        let pixel = view.project(&q);
        let by_direction = view.jacobian(&q) * to_view.matrix();
        let mut by_outline: Matrix2x3<f64> = view.by_outline(&q);
        let mut by_shared = SMatrix::<f64, 2, SHARED>::zeros();
        if let Some(neighbors) = neighbors {
            let derivatives = neighbors.derivatives(&q, pixel);
            for (i, derivative) in derivatives[..OPTICS].iter().enumerate() {
                by_shared.set_column(i, derivative);
            }
            by_outline.set_column(2, &derivatives[OPTICS]);
        }
        let mut of_frame = SMatrix::<f64, 2, BLOCK>::zeros();
        // d(R d) = x cross R d.
        let by_turn: Matrix2x3<f64> = by_direction * -turned.cross_matrix();
        of_frame.fixed_view_mut::<2, 3>(0, 0).copy_from(&by_turn);
        of_frame
            .fixed_view_mut::<2, 3>(0, OUTLINE)
            .copy_from(&by_outline);
        ProjectionJacobian {
            pixel,
            of_frame,
            by_dot: by_direction * frame.rotation.to_rotation_matrix().matrix() * axes,
            by_shared,
        }
    }

    /// Half the squared Mahalanobis length of the outlines' errors.
    fn outline_cost(&self) -> Option<f64> {
        let mut cost = 0.0;
        let mut before: Option<Vec3> = None;
        for frame in &self.frames {
            let here = self.outline_offset(frame);
            let (kept, information) = outline_chain(frame, before.is_some())?;
            let off = here - before.unwrap_or_default() * kept;
            cost += 0.5 * off.dot(&(information * off));
            before = Some(here);
        }
        Some(cost)
    }

    /// Adds the prior of the outline of frame `k`, given that of the frame before.
    fn add_outline(
        &self,
        equations: &mut NormalEquations,
        k: usize,
        frame: &BundleFrame,
    ) -> Option<()> {
        let before = k.checked_sub(1).map(|k| &self.frames[k]);
        let (kept, information) = outline_chain(frame, before.is_some())?;
        let (here, mut by_shared) = self.outline_derivatives(frame);
        let mut off = self.outline_offset(frame);
        if let Some(before) = before {
            let (there, shared_there) = self.outline_derivatives(before);
            let there = there * -kept;
            by_shared -= shared_there * kept;
            off -= self.outline_offset(before) * kept;
            let weighted = there.transpose() * information;
            equations.diagonal[k - 1] += weighted * there;
            equations.coupling[k - 1] += weighted * here;
            equations.gradient[k - 1] -= weighted * off;
            let at = 2 * self.dots.len();
            let mut border = equations.border[k - 1].fixed_columns_mut::<SHARED>(at);
            border += weighted * by_shared;
        }
        self.add_of_frame(equations, k, &here, &by_shared, &information, &-off);
        Some(())
    }

    /// Derivatives of [`outline_offset`](Self::outline_offset) by the frame's unknowns and the shared.
    fn outline_derivatives(&self, frame: &BundleFrame) -> (SMatrix<f64, 3, BLOCK>, Matrix3x6<f64>) {
        let (by_optics, by_radius) = self.camera.beyond_circle_derivatives(&frame.circle);
        let mut of_outline = Matrix3::identity();
        of_outline.set_column(2, &(Vec3::z() + by_radius));
        let mut of_frame = SMatrix::<f64, 3, BLOCK>::zeros();
        of_frame
            .fixed_view_mut::<3, 3>(0, OUTLINE)
            .copy_from(&of_outline);
        let mut by_shared = Matrix3x6::zeros();
        by_shared
            .fixed_view_mut::<3, OPTICS>(0, 0)
            .copy_from(&by_optics);
        let mut of_bias = by_shared.fixed_view_mut::<3, 3>(0, OPTICS);
        of_bias.fill_with_identity();
        (of_frame, by_shared)
    }

    /// Adds a residual's part in the frame's unknowns and the shared ones.
    fn add_of_frame<const M: usize>(
        &self,
        equations: &mut NormalEquations,
        k: usize,
        of_frame: &SMatrix<f64, M, BLOCK>,
        by_shared: &SMatrix<f64, M, SHARED>,
        information: &SMatrix<f64, M, M>,
        residual: &SVector<f64, M>,
    ) {
        let at = 2 * self.dots.len();
        let weighted = of_frame.transpose() * information;
        equations.diagonal[k] += weighted * of_frame;
        equations.gradient[k] += weighted * residual;
        let mut border = equations.border[k].fixed_columns_mut::<SHARED>(at);
        border += weighted * by_shared;
        let weighted = by_shared.transpose() * information;
        let mut corner = equations.corner.fixed_view_mut::<SHARED, SHARED>(at, at);
        corner += weighted * by_shared;
        let mut gradient = equations.corner_gradient.fixed_rows_mut::<SHARED>(at);
        gradient += weighted * residual;
    }

    fn add_observation(
        &self,
        equations: &mut NormalEquations,
        k: usize,
        seen: &Observation,
        p: &ProjectionJacobian,
        weighting: Weighting,
    ) -> Option<()> {
        let (residual, information) = self.weighted(seen, p.pixel)?;
        let information = information * weighting.share();
        self.add_of_frame(
            equations,
            k,
            &p.of_frame,
            &p.by_shared,
            &information,
            &residual,
        );
        let at = 2 * seen.dot;
        let shared = 2 * self.dots.len();
        let mut of_dot = equations.border[k].fixed_columns_mut::<2>(at);
        of_dot += p.of_frame.transpose() * information * p.by_dot;
        let weighted = p.by_dot.transpose() * information;
        let corner = &mut equations.corner;
        let mut own = corner.fixed_view_mut::<2, 2>(at, at);
        own += weighted * p.by_dot;
        let mixed = weighted * p.by_shared;
        let mut right = corner.fixed_view_mut::<2, SHARED>(at, shared);
        right += mixed;
        let mut below = corner.fixed_view_mut::<SHARED, 2>(shared, at);
        below += mixed.transpose();
        let mut gradient = equations.corner_gradient.fixed_rows_mut::<2>(at);
        gradient += weighted * residual;
        Some(())
    }

    /// A detection's residual, and its information in a step of the weighted least squares.
    pub(super) fn weighted(
        &self,
        seen: &Observation,
        at: Pixel,
    ) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let inverse = (seen.covariance * self.variance_scale).try_inverse()?;
        let residual = offset(seen.pixel, at);
        let distance = residual.dot(&(inverse * residual));
        Some((residual, inverse * LOSS.weight(distance)))
    }

    /// Adds the priors of dots, camera and motion, and the gauge.
    fn add_priors(&self, equations: &mut NormalEquations, axes: &[Matrix3x2<f64>]) {
        let shared = 2 * self.dots.len();
        let of_dots = equations.corner.view((0, 0), (shared, shared));
        let stiffness = GAUGE * of_dots.diagonal().max();
        for (j, (prior, axes)) in self.priors.iter().zip(axes).enumerate() {
            let information = prior.sigma_rad.powi(-2);
            let back = axes.transpose() * (prior.direction - self.dots[j]) * information;
            for i in 0..2 {
                equations.corner[(2 * j + i, 2 * j + i)] += information;
                equations.corner_gradient[2 * j + i] += back[i];
            }
        }
        if stiffness > 0.0 {
            let gauge = self.gauge(axes);
            let mut corner = equations.corner.view_mut((0, 0), (shared, shared));
            corner.gemm_tr(stiffness, &gauge, &gauge, 1.0);
        }
        for known in self.camera.prior() {
            let weighted = known.by_shared * known.information;
            let corner = &mut equations.corner;
            let mut own = corner.fixed_view_mut::<SHARED, SHARED>(shared, shared);
            own += weighted * known.by_shared.transpose();
            let mut gradient = equations.corner_gradient.fixed_rows_mut::<SHARED>(shared);
            gradient -= weighted * known.off;
        }
        if let Some(motion) = &self.motion {
            motion.add_to(equations, &self.rotations(), &self.spins);
        }
    }

    /// The gauge's condition `sum n_j x d_j = 0` by the dots' tangent coordinates, 3 x 2n.
    fn gauge(&self, axes: &[Matrix3x2<f64>]) -> DMatrix<f64> {
        let mut gauge = DMatrix::zeros(3, 2 * self.dots.len());
        let views = self.views();
        for (j, (prior, axes)) in self.priors.iter().zip(axes).enumerate() {
            if prior.designed && views[j] > 0 {
                let rate = prior.direction.cross_matrix() * axes;
                gauge.fixed_view_mut::<3, 2>(0, 2 * j).copy_from(&rate);
            }
        }
        gauge
    }
}

/// The share of the error before that an outline's keeps, and the information of the rest.
fn outline_chain(frame: &BundleFrame, follows: bool) -> Option<(f64, Matrix3<f64>)> {
    let information = frame.outline.covariance.try_inverse()?;
    Some(match follows {
        true => (KEPT, information / (1.0 - KEPT * KEPT)),
        false => (0.0, information),
    })
}
