//! Bundle adjustment on the sphere: the dots, the orientations, the outlines and the camera at once.
//!
//! With the dots' directions `d_j`, the orientation `R_k`, the outline `(u, v, r)_k` and what all frames
//! share ([`camera`]: the distance, the axis, the outlines' common error), a detection `p` has the residual `e = p - project(R_k d_j)`. Minimized is
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
//! # Covariances
//! The weights' mean is 1, but a detection says less than that: the information of Student's
//! distribution in two dimensions is `S^-1 (nu + 2) / (nu + 4)` (Lange et al., Appendix B). The
//! covariances are the inverse of that information, those of the steps would be too small by 2/9.
//!
//! # Gauge
//! Turning all dots one way and all frames back changes no residual. The dots are kept at the least
//! rotation from their nominal places, `sum n_j x d_j = 0` over the dots that were seen; the
//! covariances are those under this condition.
//!
//! # Scale of the noise
//! The detector states a covariance for each detection. They are scaled by one factor that the
//! residuals set, with the degrees of freedom that the fit uses taken off. A frame uses fewer than its
//! six, as far as its outline is known already: with the detections' information `A` and that of the
//! outline `P` it is the trace of `(A + P)^-1 A`.

mod camera;
mod equations;
mod motion;
mod schur;

pub(super) use camera::FrameView;

use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2};

use crate::fit::{DampedDescent, Damping, Student};
use crate::geometry::{Rotation, Vec3, kabsch, tangent_frame};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::PrincipalPointPrior;
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::{BallCircle, Pixel};
use camera::{OPTICS, SHARED, SharedCamera};
use motion::{MotionPrior, SPIN, TimedPose};
use schur::{BundleStep, NormalEquations};

/// The detections' loss.
const LOSS: Student = Student::new(5, 2);
/// A relative fall of the cost below this ends the iteration.
const CONVERGED: f64 = 1e-7;
/// The steps of one fit.
const DAMPING: Damping = Damping {
    first: 1e-4,
    down: 0.2,
    up: 8.0,
    most: 1e6,
    steps: 40,
};
/// Fits with a new scale of the noise.
const SCALINGS: usize = 3;
/// Fits in which the prior of motion may turn out too strong.
const RELAXATIONS: usize = 5;
/// The scale of the detector's standard deviations stays within these.
const SCALES: [f64; 2] = [0.3, 5.0];
/// Minimum degrees of freedom from which the scale is estimated.
const MIN_FREEDOM: f64 = 10.0;

/// Prior of a dot's place of which hardly anything is known, radians.
const FREE_SIGMA_RAD: f64 = 0.3;
/// Fewer dots leave a frame's orientation open where nothing else fixes it.
const MIN_OBSERVED: usize = 2;

/// What a detection counts for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Weighting {
    /// In a step towards the minimum.
    Step,
    /// In the covariance: see the module's head.
    Information,
}

impl Weighting {
    fn share(self) -> f64 {
        match self {
            Self::Step => 1.0,
            Self::Information => LOSS.information(),
        }
    }
}

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

impl DotPrior {
    /// A dot of whose place hardly anything is known but where to begin.
    fn free(direction: &Vec3) -> Self {
        Self {
            direction: *direction,
            sigma_rad: FREE_SIGMA_RAD,
            designed: true,
        }
    }
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
    /// Where its picture expects the camera's axis.
    pub axis: Option<PrincipalPointPrior>,
    pub observations: Vec<Observation>,
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

impl Bundle {
    /// The problem of these dots, seen by one camera.
    pub fn new(priors: Vec<DotPrior>, frames: Vec<BundleFrame>, camera: &CameraModel) -> Self {
        let dots = priors.iter().map(|p| p.direction).collect();
        let camera = SharedCamera::new(camera, &frames);
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

    /// The problem of dots of whose places hardly anything is known, in the frames, each with its number, that show [`MIN_OBSERVED`] of
    /// them; also the numbers of these.
    pub fn of_free_dots(
        dots: impl Iterator<Item = Vec3>,
        frames: impl Iterator<Item = (usize, BundleFrame)>,
        camera: &CameraModel,
    ) -> (Self, Vec<usize>) {
        let fixed = frames.filter(|(_, frame)| frame.observations.len() >= MIN_OBSERVED);
        let (which, frames) = fixed.unzip();
        let priors = dots.map(|direction| DotPrior::free(&direction)).collect();
        (Self::new(priors, frames, camera), which)
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
        let of_frames: Option<Vec<f64>> = self
            .frames
            .iter()
            .map(|f| self.camera.inverse_distance(f.circle.radius))
            .collect();
        Some(of_frames?.iter().sum::<f64>() / self.frames.len().max(1) as f64)
    }

    /// How the camera sees a ball with this outline; `None` where the outline is none of a ball's.
    pub fn view_of(&self, circle: &BallCircle) -> Option<FrameView> {
        self.camera.view(circle)
    }

    /// Mean difference of the fitted outlines from those found, in radii.
    pub fn outline_shift(&self) -> Vec3 {
        let sum: Vec3 = self
            .frames
            .iter()
            .map(|f| {
                let (now, found) = (f.circle, f.outline.circle);
                let [du, dv] = [now.center.u - found.center.u, now.center.v - found.center.v];
                Vec3::new(du, dv, now.radius - found.radius) / found.radius
            })
            .sum();
        sum / self.frames.len().max(1) as f64
    }

    /// Angle between the camera's axis and the ball, radians; `None` where the camera is known.
    pub fn axis_rad(&self) -> Option<f64> {
        self.camera.axis_rad()
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
        self.linearize(&mut equations, Weighting::Information)?;
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
        NormalEquations::new(self.frames.len(), 2 * self.dots.len() + SHARED)
    }

    /// Levenberg-Marquardt from where it stands.
    fn minimize(&mut self) {
        let mut equations = self.equations();
        if let Some(cost) = self.linearize(&mut equations, Weighting::Step) {
            let start = Linearized {
                bundle: self.clone(),
                cost,
                equations: Some(equations),
            };
            *self = DAMPING.descend(start).bundle;
        }
    }

    /// The step of these equations that keeps the camera in its domain. Rays that are parallel or nearly so
    /// lie at its bound: there the distance is held, and the rest moves as it would without it.
    fn step(&self, equations: &NormalEquations, damping: f64) -> Option<BundleStep> {
        let step = equations.solve(damping)?;
        let at = 2 * self.dots.len();
        match self.camera.change_to_parallel() {
            Some(back) if step.border[at] < back => equations.solve_given(damping, at, back),
            _ => Some(step),
        }
    }

    /// The problem after a step.
    fn moved(&self, step: &BundleStep) -> Self {
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
        let shared = step.border.rows(2 * self.dots.len(), SHARED);
        let outline = Vec3::new(shared[OPTICS], shared[OPTICS + 1], shared[OPTICS + 2]);
        moved.camera = self
            .camera
            .moved(&std::array::from_fn(|i| shared[i]), &outline);
        moved
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

    /// Sets the scale of the noise to what the residuals say, and what the axis' place says to the focal length.
    fn rescale(&mut self) {
        self.camera.settle();
        let axes = self.axes();
        let seen = self.views().iter().filter(|v| **v > 0).count();
        let (mut sum, mut freedom) = (0.0, -2.0 * seen as f64);
        for frame in &self.frames {
            let (Some(view), Some(of_outline)) =
                (self.view(frame), frame.outline.covariance.try_inverse())
            else {
                continue;
            };
            let neighbors = self.camera.neighbors(&frame.circle);
            let mut prior = Matrix6::zeros();
            let mut own = prior.fixed_view_mut::<3, 3>(3, 3);
            own += of_outline;
            let mut all = prior;
            for seen in &frame.observations {
                let axes = &axes[seen.dot];
                let p = self.projection(&view, neighbors.as_ref(), frame, seen.dot, axes);
                if let Some((residual, information)) = self.weighted(seen, p.pixel) {
                    // At the true scale this is 2 on average.
                    sum += residual.dot(&(information * residual));
                    freedom += 2.0;
                    let of_frame = p.of_frame.fixed_columns::<6>(0);
                    all += of_frame.transpose() * information * of_frame;
                }
            }
            if let Some(inverse) = all.try_inverse() {
                freedom -= 6.0 - (inverse * prior).trace();
            }
        }
        if freedom >= MIN_FREEDOM {
            let [min, max] = SCALES.map(|s| s * s);
            self.variance_scale = (self.variance_scale * sum / freedom).clamp(min, max);
        }
    }

    fn learn_motion(&self) -> Option<MotionPrior> {
        let mut equations = self.equations();
        self.linearize(&mut equations, Weighting::Information)?;
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

/// A problem on its way to the minimum.
struct Linearized {
    bundle: Bundle,
    cost: f64,
    /// Where a step is to follow.
    equations: Option<NormalEquations>,
}

impl DampedDescent for Linearized {
    fn cost(&self) -> f64 {
        self.cost
    }

    fn stepped(&self, damping: f64) -> Option<Self> {
        let step = self.bundle.step(self.equations.as_ref()?, damping)?;
        let bundle = self.bundle.moved(&step);
        Some(Self {
            cost: bundle.cost()?,
            bundle,
            equations: None,
        })
    }

    fn follow(&mut self, before: Self) -> bool {
        let has_settled = before.cost - self.cost < CONVERGED * self.cost.max(1.0);
        self.equations = before.equations.filter(|_| !has_settled);
        self.equations.as_mut().is_some_and(|equations| {
            equations.clear();
            let linearized = self.bundle.linearize(equations, Weighting::Step);
            linearized.is_some()
        })
    }
}

/// From `b` to `a`, pixels.
fn offset(a: Pixel, b: Pixel) -> Vector2<f64> {
    Vector2::new(a.u - b.u, a.v - b.v)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::angle_between;
    use crate::vision::EstimatorConfig;
    use crate::vision::optics::camera::{BallView, Camera, Intrinsics};
    use crate::vision::optics::oval::of_circle;

    const FOCAL: f64 = 1660.0;
    const DISTANCE: f64 = 60.0;

    /// The outline that an ellipse's fit finds of the ball that is seen at a pixel, and the ball's circle.
    fn seen_at(center: Pixel) -> (BallCircle, BallView) {
        let k = Intrinsics::pinhole(FOCAL, FOCAL, 641.0, 510.0);
        let off = Vector2::new(center.u - k.cx, center.v - k.cy) / FOCAL;
        let ray = (1.0 + off.norm_squared()).sqrt();
        let half = (1.0 / DISTANCE).asin();
        let radius = FOCAL * ray * half.tan();
        let view = BallView::new(&Camera::Perspective(k), BallCircle::new(center, radius));
        // Ends of the ellipse along the axis, and half of it across: of the cone about the ball.
        let angle = off.norm().atan();
        let [near, far] = [-half, half].map(|by| FOCAL * (angle + by).tan());
        let across = FOCAL * half.sin() / (angle.cos().powi(2) - half.sin().powi(2)).sqrt();
        let along = 0.5 * (far - near);
        let middle = off.normalize() * (0.5 * (far + near));
        let at = Pixel {
            u: k.cx + middle.x,
            v: k.cy + middle.y,
        };
        let mut outline = BallCircle::new(at, across);
        outline.eccentricity = off.normalize() * (1.0 - (across / along).powi(2)).sqrt();
        (outline, view.expect("a view"))
    }

    /// By how much dots of a ball are off, at worst, that crosses the corner of a picture, or stays there and is cut out of it: exact projections by a
    /// camera that nobody knows, degrees. Some outlines are found as circles, the others as ellipses.
    fn worst_of(is_whole: bool) -> f64 {
        let step_px = if is_whole { 4.0 } else { 0.0 };
        let rng = &mut ChaCha8Rng::seed_from_u64(6_412_001);
        let spread = |k: usize, n: usize| {
            let z = 1.0 - (2.0 * k as f64 + 1.0) / n as f64;
            let turn = 2.4 * k as f64;
            let aside = (1.0 - z * z).sqrt();
            Vec3::new(aside * turn.cos(), aside * turn.sin(), z)
        };
        let dots: Vec<Vec3> = (0..14).map(|k| spread(k, 14)).collect();
        let mut jitter = |sigma: f64| {
            Rotation::from_scaled_axis(Vec3::from_fn(|_, _| rng.random_range(-sigma..sigma)))
        };
        let priors = dots.iter().map(|dot| DotPrior {
            direction: jitter(0.03) * dot,
            sigma_rad: 0.03,
            designed: true,
        });
        let priors: Vec<DotPrior> = priors.collect();
        let mut frames = Vec::new();
        for k in 0..30 {
            let center = Pixel {
                u: 1210.0 - step_px * f64::from(k),
                v: 940.0 - step_px * f64::from(k),
            };
            let (outline, view) = seen_at(center);
            let rotation = Rotation::from_scaled_axis(Vec3::y() * (0.3 * f64::from(k)))
                * Rotation::from_scaled_axis(Vec3::new(1.0, 0.2, 0.1) * (0.17 * f64::from(k)));
            let turned = dots.iter().map(|dot| rotation * dot).enumerate();
            let facing = turned.filter(|(_, d)| d.z > 0.35);
            let observations = facing.map(|(dot, direction)| Observation {
                dot,
                pixel: view.project(&direction),
                covariance: Matrix2::identity() * 0.01,
            });
            let observations = observations.collect();
            let mean = outline.radius * of_circle(&outline.eccentricity).0;
            let round = BallCircle::new(outline.center, mean);
            let found = if k % 3 == 0 { round } else { outline };
            let axis = PrincipalPointPrior::of_picture(1280, 1024, &outline);
            frames.push(BundleFrame {
                time_s: None,
                rotation: jitter(0.02) * rotation,
                circle: found,
                outline: Outline::given(found, Matrix3::from_diagonal_element(0.01)),
                axis: axis.filter(|_| is_whole),
                observations,
            });
        }
        let mut bundle = Bundle::new(priors, frames, &EstimatorConfig::default().camera);
        bundle.fit(false);
        // What is expected of the distance counts, too.
        let off = bundle.inverse_distance().expect("unknown") * DISTANCE - 1.0;
        assert!(off.abs() < 0.2, "{off}");
        let mut worst = 0.0f64;
        for (i, a) in dots.iter().enumerate() {
            for (j, b) in dots.iter().enumerate().take(i) {
                let off = angle_between(&bundle.dots[i], &bundle.dots[j]) - angle_between(a, b);
                worst = worst.max(off.abs().to_degrees());
            }
        }
        worst
    }

    #[test]
    fn dots_of_a_ball_in_the_corner_of_a_picture_are_where_they_are() {
        let worst = worst_of(true);
        assert!(worst < 0.02, "{worst}");
    }

    /// Crops say by ellipses where the axis is.
    #[test]
    fn dots_of_crops_that_show_ellipses_are_where_they_are() {
        let worst = worst_of(false);
        assert!(worst < 0.02, "{worst}");
    }
}
