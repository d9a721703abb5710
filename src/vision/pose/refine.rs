//! The orientation that fits the named dots best in the image, with the outline's error taken into account.
//!
//! Parameters are a turn `R -> exp([x]x) R`, a change of the outline `(u, v, r)`, for which the fit of the outline is a Gaussian prior, and
//! where the camera's distance is unknown, ball radii over that distance, with a prior of its own. With the residual `e = p - project(R d)`
//! and the covariance `S = S_detector + s^2 J T T^T J^T` (the placement error `s` in the tangent plane `T`, or a calibrated dot's own
//! covariance), each dot has the weight of Student's distribution with `nu` degrees of freedom, `(nu + 2) / (nu + e^T S^-1 e)`; Gauss-Newton
//! on that (K. Lange et al., "Robust statistical modeling using the t distribution", JASA 84, 1989).

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2};

use crate::geometry::{Position, Rotation, Vec3, angle_between, turned_covariance};
use crate::vision::frame::config::{CameraDistance, CameraModel, EstimatorConfig};
use crate::vision::frame::estimate::{Axis, FrameEstimate, Pose};
use crate::vision::frame::position;
use crate::vision::frame::view_evidence::ViewEvidence;
use crate::vision::optics::camera::{BallCircle, BallView, Camera, Pixel};

/// Of the turn, the outline, the distance and the axis.
const PARAMETERS: usize = 9;
/// Standard deviation of the eccentricity along either axis of the image, where the outline is a circle and where an ellipse was
/// fitted: a ball 5 degrees off the axis has 0.087.
const ECCENTRICITY: [f64; 2] = [0.08, 0.05];
/// Of what the axis' place says of the eccentricity to first order.
const FIRST_ORDER: f64 = 0.005;
/// One that stays as it is.
const FIXED: f64 = 1e-6;
/// That of a ball far outside any camera's view.
const MAX_ECCENTRICITY: f64 = 0.9;
/// Step of the finite differences by the eccentricity.
const DIFFERENCE: f64 = 1e-4;
/// Maximum number of steps.
const STEPS: usize = 12;
/// A shorter step, radians, ends the iteration.
const CONVERGED: f64 = 1e-5;
/// Degrees of freedom of the dots' distribution: drawn dots and detectors err with heavy tails.
const DEGREES: f64 = 5.0;
/// A detection nearer to an expected dot than this many standard deviations takes its name.
const TAKEN_UP: f64 = 3.0;
/// One farther off than this loses it.
const DROPPED: f64 = 5.0;
/// Residuals beyond the fitted parameters from which on a placement is estimated.
const LEAST_FREE: f64 = 3.0;
/// The least variance of the placement over the stated one: none that is seen.
const LEAST_PLACEMENT: f64 = 1e-6;
/// Minimum number of named dots that fix an orientation.
const MIN_MATCHES: usize = 2;

/// A detection and its name.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    detection: usize,
    name: u16,
}

/// A refined frame.
pub(crate) struct Refined {
    pub view: BallView,
    /// In the view frame of the corrected outline.
    pub rotation: Rotation,
    /// Of the rotation, in the camera's frame.
    pub covariance: Matrix3<f64>,
    /// Where the intrinsics are known.
    pub position: Option<Position>,
    /// Ball radii over the camera's distance, where there are no intrinsics.
    pub distance: Option<CameraDistance>,
    /// The same.
    pub evidence: Option<ViewEvidence>,
    pub residual_rad: f64,
    pub residual_px: f64,
}

impl Refined {
    /// The pose, in the camera's frame.
    pub fn pose(&self, dots_confidence: f64, confidence: f64, hinted: bool) -> Pose {
        Pose {
            rotation: self.view.to_camera() * self.rotation,
            covariance: self.covariance,
            dots_confidence,
            confidence,
            residual_rad: self.residual_rad,
            residual_px: self.residual_px,
            distance: self.distance,
            view: self.evidence,
            position: self.position,
            hinted,
        }
    }

    /// The same pose, refined.
    pub fn of(&self, pose: &Pose) -> Pose {
        self.pose(pose.dots_confidence, pose.confidence, pose.hinted)
    }
}

/// The refinement's settings.
#[derive(Debug, Clone)]
pub(crate) struct Refiner {
    placement: Placement,
    min_depth: f64,
    dot_probability: f64,
    ball_radius_m: f64,
}

/// Normal equations, and minus two log-likelihoods.
struct Equations {
    information: SMatrix<f64, PARAMETERS, PARAMETERS>,
    gradient: SVector<f64, PARAMETERS>,
    cost: f64,
}

/// Where the iteration stands.
struct State {
    camera: Camera,
    view: BallView,
    rotation: Rotation,
    information: SMatrix<f64, PARAMETERS, PARAMETERS>,
    /// Variance of the placement over the stated one.
    placement: f64,
    /// Minus two log-likelihoods of all that is fitted.
    cost: f64,
}

/// What is known before the dots are fitted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prior {
    /// The outline, and the covariance of its u, v and radius.
    pub outline: (BallCircle, Matrix3<f64>),
    /// What is known of the camera.
    pub camera: CameraModel,
    /// Where the search for the distance starts: the camera under which the dots are identified.
    pub start: Camera,
    pub drawn: Drawn,
    /// Where the camera's axis is expected.
    pub axis: Option<Axis>,
}

impl Prior {
    /// What it says at a view; `of_outline` is the inverse of the outline's covariance.
    fn equations(&self, of_outline: &Matrix3<f64>, view: &BallView) -> Equations {
        let (mut all, camera) = (self.of_outline(of_outline, view), self.of_camera(view));
        all.information += camera.information;
        all.gradient += camera.gradient;
        all.cost += camera.cost;
        all
    }

    /// What the outline says.
    fn of_outline(&self, of_outline: &Matrix3<f64>, view: &BallView) -> Equations {
        let (circle, now) = (&self.outline.0, view.circle());
        let moved = offset(circle.center, now.center);
        let (growth, by_eccentricity) = match circle.is_ellipse() {
            true => (1.0, Vector2::zeros()),
            false => of_circle(&now.eccentricity),
        };
        let back = Vec3::new(moved.x, moved.y, circle.radius - growth * now.radius);
        let mut by = SMatrix::<f64, 3, PARAMETERS>::zeros();
        (by[(0, 3)], by[(1, 4)], by[(2, 5)]) = (1.0, 1.0, growth);
        (0..2).for_each(|k| by[(2, 7 + k)] = now.radius * by_eccentricity[k]);
        let pull = of_outline * back;
        let mut information = by.transpose() * of_outline * by;
        let mut gradient = by.transpose() * pull;
        let mut cost = back.dot(&pull);
        if self.has_oval() {
            cost += self.add_eccentricity(&mut information, &mut gradient, view);
        }
        Equations {
            information,
            gradient,
            cost,
        }
    }

    /// Whether the outline shows how far it is drawn out, and the dots may follow.
    fn has_oval(&self) -> bool {
        let is_unknown = matches!(self.camera, CameraModel::Unknown(_));
        is_unknown && self.outline.0.is_ellipse() && self.drawn == Drawn::AsSeen
    }

    /// What the outline says of the eccentricity, or where it is a circle that most balls are near the axis. Minus two
    /// log-likelihoods.
    fn add_eccentricity(
        &self,
        information: &mut SMatrix<f64, PARAMETERS, PARAMETERS>,
        gradient: &mut SVector<f64, PARAMETERS>,
        view: &BallView,
    ) -> f64 {
        let circle = &self.outline.0;
        let sigma = match self.drawn {
            Drawn::AsSeen => ECCENTRICITY[usize::from(circle.is_ellipse())],
            // Dots that may lie anywhere about their places say nothing of the axis.
            Drawn::AsStated => FIXED,
        };
        let away = circle.eccentricity - view.circle().eccentricity;
        for k in 0..2 {
            information[(7 + k, 7 + k)] += sigma.powi(-2);
            gradient[7 + k] += away[k] / sigma.powi(2);
        }
        away.norm_squared() / sigma.powi(2)
    }

    /// What it says of the camera alone.
    fn of_camera(&self, view: &BallView) -> Equations {
        let mut information = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
        let mut gradient = SVector::<f64, PARAMETERS>::zeros();
        let mut cost = 0.0;
        match self.camera {
            CameraModel::Unknown(known) => {
                information[(6, 6)] += known.sigma.powi(-2);
                let away = known.inverse_distance - view.horizon();
                gradient[6] = away / known.sigma.powi(2);
                cost += (away / known.sigma).powi(2);
                let axis = self.axis.filter(|_| self.drawn == Drawn::AsSeen);
                // Without an ellipse the picture says more of the axis than that most balls are near it.
                if axis.is_none() && !self.has_oval() {
                    cost += self.add_eccentricity(&mut information, &mut gradient, view);
                }
                if let Some(axis) = axis {
                    cost += axis.add_to(&mut information, &mut gradient, view);
                }
            }
            // No dot depends on these: they stay where they are.
            CameraModel::Known(_) => (6..PARAMETERS).for_each(|k| information[(k, k)] += 1.0),
        }
        Equations {
            information,
            gradient,
            cost,
        }
    }
}

impl Axis {
    /// What it says of the eccentricity and the distance at a view: to first order a ball at `off` radii from the axis
    /// has the eccentricity `off / distance`. Minus two log-likelihoods.
    fn add_to(
        &self,
        information: &mut SMatrix<f64, PARAMETERS, PARAMETERS>,
        gradient: &mut SVector<f64, PARAMETERS>,
        view: &BallView,
    ) -> f64 {
        let (now, horizon) = (view.circle(), view.horizon());
        let off = offset(now.center, self.middle) / now.radius;
        let sigma = self.sigma_px / now.radius * horizon;
        let variance = sigma.powi(2) + FIRST_ORDER.powi(2);
        let misfit = off * horizon - now.eccentricity;
        for k in 0..2 {
            let by = [(6, -off[k]), (7 + k, 1.0)];
            for (i, by_i) in by {
                gradient[i] += by_i * misfit[k] / variance;
                for (j, by_j) in by {
                    information[(i, j)] += by_i * by_j / variance;
                }
            }
        }
        misfit.norm_squared() / variance
    }
}

impl State {
    /// Takes a step.
    fn go(&mut self, step: &SVector<f64, PARAMETERS>, prior: &Prior) -> Option<()> {
        let turn = step.fixed_rows::<3>(0).into_owned();
        let turned = Rotation::from_scaled_axis(turn) * self.rotation;
        self.rotation = Rotation::new_normalize(turned.into_inner());
        let now = self.view.circle();
        let changed = BallCircle {
            center: Pixel {
                u: now.center.u + step[3],
                v: now.center.v + step[4],
            },
            radius: now.radius + step[5],
            eccentricity: bounded(now.eccentricity + step.fixed_rows::<2>(7)),
        };
        if let CameraModel::Unknown(_) = prior.camera {
            let at = self.view.horizon() + step[6];
            self.camera = Camera::Near {
                inverse_distance: at.clamp(0.0, CameraModel::MAX_INVERSE_DISTANCE),
            };
        }
        self.view = BallView::new(&self.camera, changed).ok()?;
        Some(())
    }
}

/// How far the dots of a ball are believed to lie from where its placement has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drawn {
    /// As far as it states.
    AsStated,
    /// As far as they are seen to, at most as it states.
    AsSeen,
}

/// How far the drawn dots may lie from the pattern's.
#[derive(Debug, Clone)]
pub(crate) enum Placement {
    /// All alike: variance per tangent axis, rad^2.
    Alike(f64),
    /// Measured: each dot's covariance, rad^2, pattern frame.
    Measured(Vec<Matrix3<f64>>),
}

impl Placement {
    /// Covariance in the view frame of dot `name`, expected at `expected` under `rotation`.
    fn covariance(&self, name: usize, rotation: &Rotation, expected: &Vec3) -> Matrix3<f64> {
        match self {
            Self::Alike(variance) => {
                (Matrix3::identity() - expected * expected.transpose()) * *variance
            }
            Self::Measured(covariances) => {
                let turn = rotation.to_rotation_matrix();
                turn.matrix() * covariances[name] * turn.matrix().transpose()
            }
        }
    }
}

impl Refiner {
    /// With dots that were measured.
    pub fn with_placement(mut self, placement: Placement) -> Self {
        self.placement = placement;
        self
    }

    pub fn new(config: &EstimatorConfig, ball_radius_m: f64) -> Self {
        Self {
            placement: Placement::Alike(config.placement_sigma_rad.powi(2)),
            // What the recognizer does not see is still there to be named.
            min_depth: 0.7 * config.recognizer.view.visibility_limit,
            dot_probability: config.dot_probability[1],
            ball_radius_m,
        }
    }

    /// Refines `rotation` (view frame), corrects the frame's names. `None` where too few dots are left.
    pub fn refine(
        &self,
        names: &[Vec3],
        prior: &Prior,
        rotation: &Rotation,
        frame: &mut FrameEstimate,
        matches: &mut Vec<Match>,
    ) -> Option<Refined> {
        matches.clear();
        matches.extend(named(frame));
        let (mut state, prior) = self.fit_sides(names, prior, rotation, frame, matches)?;
        if self.rename(names, &state, frame, matches) {
            state = self.fit(names, &prior, &state.rotation, frame, matches)?;
        }
        frame.assignment.fill(None);
        let (mut angles, mut distances) = (0.0, 0.0);
        for m in &*matches {
            frame.assignment[m.detection] = Some(m.name);
            let expected = state.rotation * names[usize::from(m.name)];
            let pixel = frame.dots[m.detection].pixel;
            distances += offset(pixel, state.view.project(&expected)).norm_squared();
            if let Some(seen) = state.view.direction(pixel) {
                angles += angle_between(&seen, &expected).powi(2);
            }
        }
        let count = matches.len() as f64;
        let covariance = state.information.try_inverse()?;
        let joint = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let placed = position::of_pose(&state.view, &joint, self.ball_radius_m);
        let (position, of_rotation) = match placed {
            Some((position, of_rotation)) => (Some(position), of_rotation),
            None => {
                let of_turn = covariance.fixed_view::<3, 3>(0, 0).into_owned();
                (None, turned_covariance(&state.view.to_camera(), &of_turn))
            }
        };
        Some(Refined {
            view: state.view,
            rotation: state.rotation,
            covariance: of_rotation,
            position,
            distance: match prior.camera {
                CameraModel::Unknown(_) => Some(CameraDistance {
                    inverse_distance: state.view.horizon(),
                    sigma: covariance[(6, 6)].max(0.0).sqrt(),
                }),
                CameraModel::Known(Camera::Perspective(_)) => None,
                CameraModel::Known(_) => Some(CameraDistance {
                    inverse_distance: state.view.horizon(),
                    sigma: 0.0,
                }),
            },
            evidence: self.evidence(names, &prior, &state, frame, matches),
            residual_rad: (angles / count).sqrt(),
            residual_px: (distances / count).sqrt(),
        })
    }

    /// Minus two log-likelihoods of a frame's dots under the pose that fits them best, where a dot without a name is as likely as one
    /// that just takes its name up; a constant is left out.
    pub fn misfit(
        &self,
        names: &[Vec3],
        prior: &Prior,
        rotation: &Rotation,
        frame: &FrameEstimate,
    ) -> f64 {
        let mut matches: Vec<Match> = named(frame).collect();
        let Some(mut state) = self.fit(names, prior, rotation, frame, &matches) else {
            return 0.0;
        };
        if self.rename(names, &state, frame, &mut matches)
            && let Some(again) = self.fit(names, prior, &state.rotation, frame, &matches)
        {
            state = again;
        }
        let unnamed = (DEGREES + 2.0) * (1.0 + TAKEN_UP * TAKEN_UP / DEGREES).ln();
        state.cost - unnamed * matches.len() as f64
    }

    /// Without intrinsics an ellipse is that of a ball to either side of the camera's axis: the dots decide. Also the prior of
    /// that side.
    fn fit_sides(
        &self,
        names: &[Vec3],
        prior: &Prior,
        rotation: &Rotation,
        frame: &FrameEstimate,
        matches: &[Match],
    ) -> Option<(State, Prior)> {
        let near = self.fit(names, prior, rotation, frame, matches);
        let near = near.map(|state| (state, *prior));
        let is_known = matches!(prior.camera, CameraModel::Known(_));
        if is_known || !prior.outline.0.is_ellipse() {
            return near;
        }
        let mut other = *prior;
        other.outline.0.eccentricity = -other.outline.0.eccentricity;
        let far = self.fit(names, &other, rotation, frame, matches);
        let far = far.map(|state| (state, other));
        let both = near.into_iter().chain(far);
        both.min_by(|a, b| a.0.cost.total_cmp(&b.0.cost))
    }

    /// What dots and outline say of a camera that is not known, about a solution.
    fn evidence(
        &self,
        names: &[Vec3],
        prior: &Prior,
        state: &State,
        frame: &FrameEstimate,
        matches: &[Match],
    ) -> Option<ViewEvidence> {
        let CameraModel::Unknown(expected) = prior.camera else {
            return None;
        };
        let mut seen = prior.of_outline(&prior.outline.1.try_inverse()?, &state.view);
        self.add_dots(names, prior, state, frame, matches, &mut seen)?;
        ViewEvidence::new(&seen.information, &seen.gradient, expected, prior.axis)
    }

    fn fit(
        &self,
        names: &[Vec3],
        prior: &Prior,
        rotation: &Rotation,
        frame: &FrameEstimate,
        matches: &[Match],
    ) -> Option<State> {
        if matches.len() < MIN_MATCHES {
            return None;
        }
        let (circle, covariance) = &prior.outline;
        let of_outline = covariance.try_inverse()?;
        let mut state = State {
            camera: prior.start,
            view: BallView::new(&prior.start, *circle).ok()?,
            rotation: *rotation,
            information: SMatrix::zeros(),
            placement: 1.0,
            cost: f64::INFINITY,
        };
        for _ in 0..STEPS {
            let mut equations = prior.equations(&of_outline, &state.view);
            let known = equations.information;
            let spread = self.add_dots(names, prior, &state, frame, matches, &mut equations)?;
            let factor = equations.information.cholesky()?;
            let step = factor.solve(&equations.gradient);
            if prior.drawn == Drawn::AsSeen {
                let held = (factor.inverse() * known).trace();
                state.placement = spread.scaled(state.placement, PARAMETERS as f64 - held);
            }
            state.go(&step, prior)?;
            (state.information, state.cost) = (equations.information, equations.cost);
            if step.norm() < CONVERGED {
                break;
            }
        }
        Some(state)
    }

    /// Adds what the named dots say; what they say of the placement.
    fn add_dots(
        &self,
        names: &[Vec3],
        prior: &Prior,
        state: &State,
        frame: &FrameEstimate,
        matches: &[Match],
        equations: &mut Equations,
    ) -> Option<Spread> {
        let mut spread = Spread::default();
        let off_axis = state.view.off_axis(DIFFERENCE);
        for m in matches {
            let dot = &frame.dots[m.detection];
            let name = usize::from(m.name);
            let expected = state.rotation * names[name];
            let hand = self.placement.covariance(name, &state.rotation, &expected);
            let hand = hand * state.placement;
            let Misfit {
                residual,
                inverse,
                hand,
            } = misfit(&state.view, &expected, dot.pixel, &dot.covariance, &hand)?;
            let mut by_parameters = by_parameters(&state.view, &off_axis, &expected)?;
            if matches!(prior.camera, CameraModel::Known(_)) {
                by_parameters.fixed_columns_mut::<3>(6).fill(0.0);
            }
            let distance = residual.dot(&(inverse * residual));
            let weight = (DEGREES + 2.0) / (DEGREES + distance);
            equations.cost += (DEGREES + 2.0) * (1.0 + distance / DEGREES).ln();
            let weighted = by_parameters.transpose() * inverse * weight;
            equations.information += weighted * by_parameters;
            equations.gradient += weighted * residual;
            if prior.drawn == Drawn::AsSeen {
                spread.add(&(inverse * hand), &(inverse * residual), &hand, weight);
            }
        }
        Some(spread)
    }

    /// Names detections that lie where a dot is expected, unnames those that lie elsewhere; whether anything changed.
    fn rename(
        &self,
        names: &[Vec3],
        state: &State,
        frame: &FrameEstimate,
        matches: &mut Vec<Match>,
    ) -> bool {
        let distance = |name: usize, detection: usize| -> f64 {
            let dot = &frame.dots[detection];
            let expected = state.rotation * names[name];
            let hand = self.placement.covariance(name, &state.rotation, &expected);
            let hand = hand * state.placement;
            match misfit(&state.view, &expected, dot.pixel, &dot.covariance, &hand) {
                Some(Misfit {
                    residual, inverse, ..
                }) => residual.dot(&(inverse * residual)),
                None => f64::INFINITY,
            }
        };
        let before = matches.len();
        matches.retain(|m| distance(usize::from(m.name), m.detection) < DROPPED * DROPPED);
        let mut changed = matches.len() != before;
        let min_depth = self.min_depth.max(state.view.horizon());
        for (name, dot) in names.iter().enumerate() {
            let hidden = (state.rotation * dot).z < min_depth;
            if hidden || matches.iter().any(|m| usize::from(m.name) == name) {
                continue;
            }
            let free = |i: &usize| {
                frame.dots[*i].probability >= self.dot_probability
                    && matches.iter().all(|m| m.detection != *i)
            };
            let nearest = (0..frame.dots.len())
                .filter(free)
                .map(|i| (distance(name, i), i))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, detection)) = nearest.filter(|n| n.0 < TAKEN_UP * TAKEN_UP) {
                matches.push(Match {
                    detection,
                    name: name as u16,
                });
                changed = true;
            }
        }
        changed
    }
}

/// The detections that have a name.
fn named(frame: &FrameEstimate) -> impl Iterator<Item = Match> {
    let named = frame.assignment.iter().enumerate();
    named.filter_map(|(detection, name)| {
        Some(Match {
            detection,
            name: (*name)?,
        })
    })
}

/// What the residuals say of the placement's variance `t`, by the restricted likelihood's fixed point
/// `t -> t sum e^T S^-1 P S^-1 e / sum tr(S^-1 P)` (D. Harville, JASA 72, 1977), `P` its part of the dots' covariances `S`.
#[derive(Debug, Clone, Copy, Default)]
struct Spread {
    seen: f64,
    expected: f64,
    residuals: f64,
}

impl Spread {
    /// A dot: `S^-1 P`, `S^-1 e`, `P` and its weight.
    fn add(
        &mut self,
        share: &Matrix2<f64>,
        pull: &Vector2<f64>,
        placement: &Matrix2<f64>,
        weight: f64,
    ) {
        self.seen += weight * pull.dot(&(placement * pull));
        self.expected += share.trace();
        self.residuals += 2.0;
    }

    /// The variance over the stated one, from the one in use and the number of fitted parameters: its mean where its
    /// logarithm may be anything, at most the stated one.
    fn scaled(&self, now: f64, fitted: f64) -> f64 {
        let free = self.residuals - fitted;
        if free <= LEAST_FREE {
            return 1.0;
        }
        let expected = self.expected * free / self.residuals;
        let mean = free / (free - 2.0);
        (now * mean * self.seen / expected).clamp(LEAST_PLACEMENT, 1.0)
    }
}

/// How far a dot is seen from where it is expected.
struct Misfit {
    residual: Vector2<f64>,
    /// Inverse of its covariance.
    inverse: Matrix2<f64>,
    /// The placement's part of the covariance.
    hand: Matrix2<f64>,
}

/// The misfit of a dot whose place has the covariance `placement` (view frame).
fn misfit(
    view: &BallView,
    expected: &Vec3,
    pixel: Pixel,
    covariance: &Matrix2<f64>,
    placement: &Matrix3<f64>,
) -> Option<Misfit> {
    let by_direction = view.jacobian(expected);
    let hand = by_direction * placement * by_direction.transpose();
    Some(Misfit {
        residual: offset(pixel, view.project(expected)),
        inverse: (covariance + hand).try_inverse()?,
        hand,
    })
}

/// Derivative of a dot's pixel by turn, outline, inverse distance and axis; `off_axis` are the views by a step of the axis.
fn by_parameters(
    view: &BallView,
    off_axis: &[Option<BallView>; 2],
    expected: &Vec3,
) -> Option<SMatrix<f64, 2, PARAMETERS>> {
    let mut by = SMatrix::<f64, 2, PARAMETERS>::zeros();
    // d(R d) = x cross R d.
    by.fixed_view_mut::<2, 3>(0, 0)
        .copy_from(&(view.jacobian(expected) * -expected.cross_matrix()));
    by.fixed_view_mut::<2, 3>(0, 3)
        .copy_from(&view.by_outline(expected));
    if let Some(rate) = view.by_inverse_distance(expected) {
        by.fixed_view_mut::<2, 1>(0, 6).copy_from(&rate);
        let at = view.project(expected);
        for (k, moved) in off_axis.iter().enumerate() {
            let rate = offset(moved.as_ref()?.project(expected), at) / DIFFERENCE;
            by.fixed_view_mut::<2, 1>(0, 7 + k).copy_from(&rate);
        }
    }
    Some(by)
}

/// An eccentricity that an outline can have.
fn bounded(eccentricity: Vector2<f64>) -> Vector2<f64> {
    let length = eccentricity.norm();
    eccentricity * (MAX_ECCENTRICITY / length.max(MAX_ECCENTRICITY))
}

/// The radius of the circle that was fitted to an ellipse, the geometric mean of the half axes, over the shorter one; and
/// its derivative by the eccentricity.
fn of_circle(eccentricity: &Vector2<f64>) -> (f64, Vector2<f64>) {
    let rest = 1.0 - eccentricity.norm_squared();
    let growth = rest.powf(-0.25);
    (growth, eccentricity * (0.5 * growth / rest))
}

/// From `b` to `a`, pixels.
fn offset(a: Pixel, b: Pixel) -> Vector2<f64> {
    Vector2::new(a.u - b.u, a.v - b.v)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the axis says, as a cost; its gradient is minus a half of the cost's.
    #[test]
    fn the_gradient_of_the_axis_is_that_of_its_cost() {
        let axis = Axis {
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
            let mut information = SMatrix::zeros();
            let mut gradient = SVector::zeros();
            let cost = axis.add_to(&mut information, &mut gradient, &view);
            (cost, gradient, information, view.horizon())
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

    /// A circle about an ellipse of half axes `radius / sqrt(1 - e^2)` and `radius`.
    #[test]
    fn the_circle_of_an_ellipse_has_the_mean_of_its_half_axes() {
        let e = Vector2::new(0.3, 0.2);
        let (growth, by) = of_circle(&e);
        let long = 1.0 / (1.0 - e.norm_squared()).sqrt();
        assert!((growth - (long * 1.0).sqrt()).abs() < 1e-12);
        let step = Vector2::new(1e-6, 0.0);
        let slope = (of_circle(&(e + step)).0 - of_circle(&(e - step)).0) / 2e-6;
        assert!((slope - by.x).abs() < 1e-8);
    }
}
