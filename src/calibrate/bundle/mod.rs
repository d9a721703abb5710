//! Bundle adjustment on the sphere: the dots, the orientations, the outlines and the camera at once.
//!
//! With the dots' directions `d_j`, the orientation `R_k`, the outline `(u, v, r)_k` and the camera's
//! distance, a detection `p` has the residual `e = p - project(R_k d_j)`. Minimized is
//!
//! ```text
//! sum (nu + 2)/2 ln(1 + e^T S^-1 e / nu)  +  the priors of outlines, camera, dots and motion
//! ```
//!
//! Student's distribution with `nu` = 5 degrees of freedom as in the refinement of a frame, by
//! Levenberg-Marquardt on its weights `(nu + 2) / (nu + e^T S^-1 e)` (B. Triggs et al., "Bundle
//! adjustment: a modern synthesis", 2000; K. Lange et al., "Robust statistical modeling using the t
//! distribution", JASA 84, 1989). The frames are eliminated by the Schur complement ([`schur`]).
//!
//! # Gauge
//! Turning all dots one way and all frames back changes no residual. The dots are kept at the least
//! rotation from their nominal places, `sum n_j x d_j = 0` over the dots that were seen; the
//! covariances are those under this condition.
//!
//! # Scale of the noise
//! The detector states a covariance for each detection. They are scaled by one factor that the
//! residuals set, with the degrees of freedom that the fit uses taken off.

mod motion;
mod schur;

use nalgebra::{DMatrix, Matrix2, Matrix2x3, Matrix3, Matrix3x2, SMatrix, Vector2};

use crate::geometry::{Rotation, Vec3, kabsch, tangent_frame};
use crate::vision::camera::{BallCircle, BallView, Camera, Pixel};
use crate::vision::estimator::{CameraModel, Outline};
use motion::{MotionPrior, SPIN, TimedPose};
use schur::{BLOCK, Border, NormalEquations, Step};

/// Degrees of freedom of the detections' distribution.
const DEGREES: f64 = 5.0;
/// Maximum number of steps of one fit.
const MAX_STEPS: usize = 40;
/// A relative fall of the cost below this ends the iteration.
const CONVERGED: f64 = 1e-7;
/// First damping, its factors, and where the search gives up.
const DAMPING: f64 = 1e-4;
const DAMPING_DOWN: f64 = 0.2;
const DAMPING_UP: f64 = 8.0;
const MAX_DAMPING: f64 = 1e6;
/// Stiffness of the gauge's condition over the largest information of a dot.
const GAUGE: f64 = 1e3;
/// Fits with a new scale of the noise.
const SCALINGS: usize = 3;
/// Fits in which the prior of motion may turn out too strong.
const RELAXATIONS: usize = 5;
/// The scale of the detector's standard deviations stays within these.
const SCALES: [f64; 2] = [0.3, 5.0];
/// Minimum degrees of freedom from which the scale is estimated.
const MIN_FREEDOM: f64 = 10.0;
/// Largest ball radii over the camera's distance.
const MAX_INVERSE_DISTANCE: f64 = 0.3;

/// A dot before the fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct DotPrior {
    /// Where it should be, pattern frame.
    pub direction: Vec3,
    /// Standard deviation of its place per tangent axis, radians.
    pub sigma_rad: f64,
    /// Whether it takes part in the gauge: a dot of the nominal pattern.
    pub designed: bool,
}

/// A detection that is a dot's.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation {
    pub dot: usize,
    pub pixel: Pixel,
    pub covariance: Matrix2<f64>,
}

/// A frame.
#[derive(Debug, Clone)]
pub(super) struct BundleFrame {
    pub time_s: Option<f64>,
    /// Pattern to camera.
    pub rotation: Rotation,
    /// The outline as it is now, and as it was found.
    pub circle: BallCircle,
    pub outline: Outline,
    pub observations: Vec<Observation>,
}

/// The camera of all frames.
#[derive(Debug, Clone, Copy)]
enum SharedCamera {
    Known(Camera),
    /// One over the focal length in pixels: it fixes the distance of every ball by its radius.
    Unknown {
        inverse_focal: f64,
        expected: f64,
        sigma: f64,
    },
}

impl SharedCamera {
    fn of(&self, circle: &BallCircle) -> Camera {
        match *self {
            Self::Known(camera) => camera,
            Self::Unknown { inverse_focal, .. } => Camera::Near {
                inverse_distance: inverse_distance(inverse_focal * circle.radius),
            },
        }
    }
}

/// `sin(atan(ratio))`, for a radius of `ratio` focal lengths.
fn inverse_distance(ratio: f64) -> f64 {
    (ratio / ratio.hypot(1.0)).clamp(0.0, MAX_INVERSE_DISTANCE)
}

/// The joint problem, and where its solution stands.
#[derive(Debug, Clone)]
pub(super) struct Bundle {
    priors: Vec<DotPrior>,
    pub dots: Vec<Vec3>,
    pub frames: Vec<BundleFrame>,
    camera: SharedCamera,
    motion: Option<MotionPrior>,
    spins: Vec<Vec3>,
    /// Factor on the detector's variances.
    variance_scale: f64,
}

/// A dot's result.
#[derive(Debug, Clone, Copy)]
pub(super) struct DotFit {
    pub direction: Vec3,
    /// rad^2, in the tangent frame of the direction.
    pub covariance: Matrix2<f64>,
    pub views: usize,
}

/// The derivatives of a detection's expected place.
struct Projection {
    pixel: Pixel,
    by_turn: Matrix2x3<f64>,
    by_outline: Matrix2x3<f64>,
    by_dot: Matrix2<f64>,
    by_focal: Vector2<f64>,
}

impl Bundle {
    /// The problem of these dots, seen by one camera.
    pub fn new(priors: Vec<DotPrior>, frames: Vec<BundleFrame>, camera: &CameraModel) -> Self {
        let dots = priors.iter().map(|p| p.direction).collect();
        let radius =
            frames.iter().map(|f| f.circle.radius).sum::<f64>() / frames.len().max(1) as f64;
        let camera = match *camera {
            CameraModel::Known(camera) => SharedCamera::Known(camera),
            CameraModel::Unknown(prior) => {
                let k = prior.inverse_distance;
                let expected = k / (radius * (1.0 - k * k).sqrt());
                SharedCamera::Unknown {
                    inverse_focal: expected,
                    expected,
                    sigma: prior.sigma / radius,
                }
            }
        };
        let spins = vec![Vec3::zeros(); frames.len()];
        Self {
            priors,
            dots,
            frames,
            camera,
            motion: None,
            spins,
            variance_scale: 1.0,
        }
    }

    /// Fits everything: first without the prior of motion, then, where the times allow and `smooth`
    /// asks for it, with it.
    pub fn fit(&mut self, smooth: bool) {
        for _ in 0..SCALINGS {
            self.minimize();
            self.rescale();
        }
        self.minimize();
        if smooth && let Some(motion) = self.learn_motion() {
            self.spins.clone_from(&motion.spins);
            self.motion = Some(motion);
            for _ in 0..RELAXATIONS {
                self.minimize();
                let (rotations, spins) = (self.rotations(), self.spins.clone());
                if !self
                    .motion
                    .as_mut()
                    .is_some_and(|m| m.relax(&rotations, &spins))
                {
                    break;
                }
            }
        }
        self.align();
    }

    /// Standard deviation of the detections over what the detector states.
    pub fn noise_scale(&self) -> f64 {
        self.variance_scale.sqrt()
    }

    /// Whether a smooth rotation was used.
    pub fn is_smooth(&self) -> bool {
        self.motion.is_some()
    }

    /// Ball radii over the camera's distance, mean over the frames; `None` where it is known.
    pub fn inverse_distance(&self) -> Option<f64> {
        let SharedCamera::Unknown { inverse_focal, .. } = self.camera else {
            return None;
        };
        let of_frames = self
            .frames
            .iter()
            .map(|f| inverse_distance(inverse_focal * f.circle.radius));
        Some(of_frames.sum::<f64>() / self.frames.len().max(1) as f64)
    }

    /// Number of frames that see each dot.
    pub fn views(&self) -> Vec<usize> {
        let mut views = vec![0; self.dots.len()];
        for seen in self.frames.iter().flat_map(|f| &f.observations) {
            views[seen.dot] += 1;
        }
        views
    }

    /// The dots with their covariances; `None` where the problem is singular.
    pub fn dot_fits(&self) -> Option<Vec<DotFit>> {
        let mut equations = self.equations();
        self.linearize(&mut equations)?;
        let covariance = equations.border_covariance()?;
        let fits = self.dots.iter().zip(self.views()).enumerate();
        let fits = fits.map(|(j, (direction, views))| DotFit {
            direction: *direction,
            covariance: covariance.fixed_view::<2, 2>(2 * j, 2 * j).into_owned(),
            views,
        });
        Some(fits.collect())
    }

    fn equations(&self) -> NormalEquations {
        NormalEquations::new(self.frames.len(), 2 * self.dots.len() + 1)
    }

    /// Levenberg-Marquardt from where it stands.
    fn minimize(&mut self) {
        let mut equations = self.equations();
        let mut damping = DAMPING;
        let Some(mut cost) = self.linearize(&mut equations) else {
            return;
        };
        for _ in 0..MAX_STEPS {
            let moved = equations.solve(damping).map(|step| self.moved(&step));
            let better = moved.and_then(|m| Some((m.cost()?, m)).filter(|(c, _)| *c < cost));
            let Some((lower, moved)) = better else {
                damping *= DAMPING_UP;
                if damping > MAX_DAMPING {
                    return;
                }
                continue;
            };
            *self = moved;
            let fall = cost - lower;
            cost = lower;
            damping *= DAMPING_DOWN;
            equations.clear();
            if fall < CONVERGED * cost.max(1.0) || self.linearize(&mut equations).is_none() {
                return;
            }
        }
    }

    /// The problem after a step.
    fn moved(&self, step: &Step) -> Self {
        let mut moved = self.clone();
        for (j, dot) in moved.dots.iter_mut().enumerate() {
            let [e1, e2] = tangent_frame(dot);
            *dot = (*dot + e1 * step.border[2 * j] + e2 * step.border[2 * j + 1]).normalize();
        }
        for ((frame, spin), x) in moved
            .frames
            .iter_mut()
            .zip(&mut moved.spins)
            .zip(&step.frames)
        {
            let turn = Rotation::from_scaled_axis(Vec3::new(x[0], x[1], x[2]));
            frame.rotation = Rotation::new_normalize((turn * frame.rotation).into_inner());
            frame.circle.center.u += x[3];
            frame.circle.center.v += x[4];
            frame.circle.radius += x[5];
            *spin += Vec3::new(x[SPIN], x[SPIN + 1], x[SPIN + 2]);
        }
        if let SharedCamera::Unknown { inverse_focal, .. } = &mut moved.camera {
            *inverse_focal = (*inverse_focal + step.border[2 * self.dots.len()]).max(0.0);
        }
        moved
    }

    fn view(&self, frame: &BundleFrame) -> Option<BallView> {
        BallView::new(&self.camera.of(&frame.circle), frame.circle).ok()
    }

    /// The cost; `None` where an outline has left its domain.
    fn cost(&self) -> Option<f64> {
        let mut cost = self.prior_cost();
        for frame in &self.frames {
            let view = self.view(frame)?;
            let to_view = view.to_camera().inverse() * frame.rotation;
            for seen in &frame.observations {
                let at = view.project(&(to_view * self.dots[seen.dot]));
                let inverse = (seen.covariance * self.variance_scale).try_inverse()?;
                let off = offset(seen.pixel, at);
                let distance = off.dot(&(inverse * off));
                cost += 0.5 * (DEGREES + 2.0) * (distance / DEGREES).ln_1p();
            }
            let off = outline_offset(frame);
            cost += 0.5 * off.dot(&(frame.outline.covariance.try_inverse()? * off));
        }
        Some(cost)
    }

    /// The part of the cost from the priors of dots, camera and motion.
    fn prior_cost(&self) -> f64 {
        let mut cost = 0.0;
        for (dot, prior) in self.dots.iter().zip(&self.priors) {
            cost += 0.5 * (dot - prior.direction).norm_squared() / prior.sigma_rad.powi(2);
        }
        if let SharedCamera::Unknown {
            inverse_focal,
            expected,
            sigma,
        } = self.camera
        {
            cost += 0.5 * ((inverse_focal - expected) / sigma).powi(2);
        }
        if let Some(motion) = &self.motion {
            cost += motion.cost(&self.rotations(), &self.spins);
        }
        cost
    }

    fn rotations(&self) -> Vec<Rotation> {
        self.frames.iter().map(|f| f.rotation).collect()
    }

    /// Fills the normal equations, which are zero; returns the cost.
    fn linearize(&self, equations: &mut NormalEquations) -> Option<f64> {
        let axes: Vec<Matrix3x2<f64>> = self
            .dots
            .iter()
            .map(|d| Matrix3x2::from_columns(&tangent_frame(d)))
            .collect();
        for (k, frame) in self.frames.iter().enumerate() {
            let view = self.view(frame)?;
            let inverse = frame.outline.covariance.try_inverse()?;
            let mut outline = equations.diagonal[k].fixed_view_mut::<3, 3>(3, 3);
            outline += inverse;
            let mut gradient = equations.gradient[k].fixed_rows_mut::<3>(3);
            gradient -= inverse * outline_offset(frame);
            for seen in &frame.observations {
                let p = self.projection(&view, frame, seen.dot, &axes[seen.dot]);
                self.add_observation(equations, k, seen, &p)?;
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

    fn projection(
        &self,
        view: &BallView,
        frame: &BundleFrame,
        dot: usize,
        axes: &Matrix3x2<f64>,
    ) -> Projection {
        let to_view = view.to_camera().inverse().to_rotation_matrix();
        let turned = frame.rotation * self.dots[dot];
        let q = to_view * turned;
        let by_direction = view.jacobian(&q) * to_view.matrix();
        let mut by_outline = view.by_outline(&q);
        let mut by_focal = Vector2::zeros();
        if let (SharedCamera::Unknown { inverse_focal, .. }, Some(by_distance)) =
            (&self.camera, view.by_inverse_distance(&q))
        {
            // k = sin(atan(r m)): dk/d(r m) = (1 + (r m)^2)^(-3/2).
            let radius = frame.circle.radius;
            let rate = (1.0 + (radius * inverse_focal).powi(2)).powf(-1.5);
            by_focal = by_distance * (rate * radius);
            let mut growth = by_outline.column_mut(2);
            growth += by_distance * (rate * inverse_focal);
        }
        Projection {
            pixel: view.project(&q),
            // d(R d) = x cross R d.
            by_turn: by_direction * -turned.cross_matrix(),
            by_outline,
            by_dot: by_direction * frame.rotation.to_rotation_matrix().matrix() * axes,
            by_focal,
        }
    }

    fn add_observation(
        &self,
        equations: &mut NormalEquations,
        k: usize,
        seen: &Observation,
        p: &Projection,
    ) -> Option<()> {
        let inverse = (seen.covariance * self.variance_scale).try_inverse()?;
        let residual = offset(seen.pixel, p.pixel);
        let distance = residual.dot(&(inverse * residual));
        let information = inverse * ((DEGREES + 2.0) / (DEGREES + distance));
        let mut of_frame = SMatrix::<f64, 2, BLOCK>::zeros();
        of_frame.fixed_view_mut::<2, 3>(0, 0).copy_from(&p.by_turn);
        of_frame
            .fixed_view_mut::<2, 3>(0, 3)
            .copy_from(&p.by_outline);
        let weighted = of_frame.transpose() * information;
        equations.diagonal[k] += weighted * of_frame;
        equations.gradient[k] += weighted * residual;
        let at = 2 * seen.dot;
        let border: &mut Border = &mut equations.border[k];
        let mut of_dot = border.fixed_columns_mut::<2>(at);
        of_dot += weighted * p.by_dot;
        let focal = 2 * self.dots.len();
        let mut of_focal = border.column_mut(focal);
        of_focal += weighted * p.by_focal;
        let dot_weighted = p.by_dot.transpose() * information;
        let corner = &mut equations.corner;
        let mut own = corner.fixed_view_mut::<2, 2>(at, at);
        own += dot_weighted * p.by_dot;
        let mixed = dot_weighted * p.by_focal;
        for i in 0..2 {
            corner[(at + i, focal)] += mixed[i];
            corner[(focal, at + i)] += mixed[i];
        }
        corner[(focal, focal)] += p.by_focal.dot(&(information * p.by_focal));
        let mut gradient = equations.corner_gradient.fixed_rows_mut::<2>(at);
        gradient += dot_weighted * residual;
        equations.corner_gradient[focal] += p.by_focal.dot(&(information * residual));
        Some(())
    }

    /// Adds the priors of dots, camera and motion, and the gauge.
    fn add_priors(&self, equations: &mut NormalEquations, axes: &[Matrix3x2<f64>]) {
        let focal = 2 * self.dots.len();
        let stiffness = GAUGE
            * equations
                .corner
                .view((0, 0), (focal, focal))
                .diagonal()
                .max();
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
            let mut corner = equations.corner.view_mut((0, 0), (focal, focal));
            corner.gemm_tr(stiffness, &gauge, &gauge, 1.0);
        }
        match self.camera {
            SharedCamera::Known(_) => equations.corner[(focal, focal)] = 1.0,
            SharedCamera::Unknown {
                inverse_focal,
                expected,
                sigma,
            } => {
                equations.corner[(focal, focal)] += sigma.powi(-2);
                equations.corner_gradient[focal] += (expected - inverse_focal) / (sigma * sigma);
            }
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

    /// Turns the pattern to the least rotation from the nominal one, and the frames back.
    fn align(&mut self) {
        let views = self.views();
        let seen = |j: &usize| self.priors[*j].designed && views[*j] > 0;
        let seen: Vec<usize> = (0..self.dots.len()).filter(seen).collect();
        let from: Vec<Vec3> = seen.iter().map(|&j| self.dots[j]).collect();
        let to: Vec<Vec3> = seen.iter().map(|&j| self.priors[j].direction).collect();
        // Too few dots leave the gauge where the steps' condition has kept it.
        let Ok(turn) = kabsch(&from, &to, None) else {
            return;
        };
        for (dot, views) in self.dots.iter_mut().zip(&views) {
            if *views > 0 {
                *dot = (turn * *dot).normalize();
            }
        }
        for frame in &mut self.frames {
            frame.rotation =
                Rotation::new_normalize((frame.rotation * turn.inverse()).into_inner());
        }
    }

    /// Sets the scale of the noise to what the residuals say.
    fn rescale(&mut self) {
        let (mut sum, mut count) = (0.0, 0usize);
        for frame in &self.frames {
            let Some(view) = self.view(frame) else {
                continue;
            };
            let to_view = view.to_camera().inverse() * frame.rotation;
            for seen in &frame.observations {
                let at = view.project(&(to_view * self.dots[seen.dot]));
                let scaled = seen.covariance * self.variance_scale;
                if let Some(inverse) = scaled.try_inverse() {
                    let off = offset(seen.pixel, at);
                    let distance = off.dot(&(inverse * off));
                    // At the true scale this is 2 on average.
                    sum += (DEGREES + 2.0) / (DEGREES + distance) * distance;
                    count += 2;
                }
            }
        }
        let seen = self.views().iter().filter(|v| **v > 0).count();
        let used = 3 * self.frames.len() + 2 * seen;
        let freedom = count as f64 - used as f64;
        if freedom >= MIN_FREEDOM {
            let [min, max] = SCALES.map(|s| s * s);
            self.variance_scale = (self.variance_scale * sum / freedom).clamp(min, max);
        }
    }

    fn learn_motion(&self) -> Option<MotionPrior> {
        let mut equations = self.equations();
        self.linearize(&mut equations)?;
        let poses: Option<Vec<TimedPose>> = self
            .frames
            .iter()
            .zip(&equations.diagonal)
            .map(|(frame, information)| {
                let of_pose = information.fixed_view::<6, 6>(0, 0).into_owned();
                let covariance: Matrix3<f64> =
                    of_pose.try_inverse()?.fixed_view::<3, 3>(0, 0).into();
                Some(TimedPose {
                    time_s: frame.time_s?,
                    rotation: frame.rotation,
                    variance: covariance.trace() / 3.0,
                })
            })
            .collect();
        MotionPrior::learn(&poses?)
    }
}

/// From the outline as found to the outline as it is: center and radius.
fn outline_offset(frame: &BundleFrame) -> Vec3 {
    let found = &frame.outline.circle;
    let moved = offset(frame.circle.center, found.center);
    Vec3::new(moved.x, moved.y, frame.circle.radius - found.radius)
}

/// From `b` to `a`, pixels.
fn offset(a: Pixel, b: Pixel) -> Vector2<f64> {
    Vector2::new(a.u - b.u, a.v - b.v)
}
