//! The orientation that fits the named dots best in the image, with the outline's error taken into account.
//!
//! Parameters are a turn `R -> exp([x]x) R`, a change of the outline `(u, v, r)`, for which the fit of the outline is a Gaussian prior, and
//! where the camera's distance is unknown, ball radii over that distance, with a prior of its own. With the residual `e = p - project(R d)`
//! and the covariance `S = S_detector + s^2 J T T^T J^T` (the placement error `s` in the tangent plane `T`, or a calibrated dot's own
//! covariance), each dot has the weight of Student's distribution with `nu` degrees of freedom, `(nu + 2) / (nu + e^T S^-1 e)`; Gauss-Newton
//! on that (K. Lange et al., "Robust statistical modeling using the t distribution", JASA 84, 1989).

mod alternatives;
mod placement;
mod prior;

use nalgebra::{Matrix3, SMatrix, SVector, Vector2};

use self::alternatives::OutlineReading;
pub(crate) use self::placement::DrawnPlacement;
use self::placement::{DotMisfit, PlacementSpread, misfit};
use self::prior::bounded;
pub(crate) use self::prior::{Drawn, PosePrior};
use crate::fit::{Normal, Student};
use crate::geometry::{Position, Rotation, Vec3, angle_between, turned_covariance};
use crate::vision::frame::config::{CameraDistance, CameraModel, EstimatorConfig};
use crate::vision::frame::estimate::{FrameEstimate, Pose};
use crate::vision::frame::position;
use crate::vision::frame::view_evidence::ViewEvidence;
use crate::vision::optics::camera::{BallCircle, BallView, Camera, Pixel};

/// Of the turn, the outline, the distance and the axis.
const PARAMETERS: usize = 9;
/// Step of the finite differences by the eccentricity.
const DIFFERENCE: f64 = 1e-4;
/// Maximum number of steps.
const STEPS: usize = 12;
/// A shorter step, radians, ends the iteration.
const CONVERGED: f64 = 1e-5;
/// The dots' loss: drawn dots and detectors err with heavy tails.
const LOSS: Student = Student::new(5, 2);
/// A detection nearer to an expected dot than this many standard deviations takes its name.
const TAKEN_UP: f64 = 3.0;
/// One farther off than this loses it.
const DROPPED: f64 = 5.0;
/// Minimum number of named dots that fix an orientation.
const MIN_MATCHES: usize = 2;

/// A detection and its name.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    detection: usize,
    name: u16,
}

/// A refined frame.
pub(crate) struct RefinedFrame {
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

impl RefinedFrame {
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
pub(crate) struct PoseRefiner {
    placement: DrawnPlacement,
    min_depth: f64,
    dot_probability: f64,
    ball_radius_m: f64,
}

/// Normal equations, and minus two log-likelihoods.
type PoseEquations = Normal<PARAMETERS>;

/// Where the iteration stands.
#[derive(Clone, Copy)]
struct PoseState {
    camera: Camera,
    view: BallView,
    rotation: Rotation,
    information: SMatrix<f64, PARAMETERS, PARAMETERS>,
    /// Variance of the placement over the stated one.
    placement: f64,
    /// Minus two log-likelihoods of all that is fitted, but for what the dots' covariances add.
    cost: f64,
    /// That: the sum of the logarithms of their determinants.
    ln_spread: f64,
}

impl PoseState {
    /// At the outline of a prior.
    fn new(prior: &PosePrior, rotation: &Rotation) -> Option<Self> {
        Some(Self {
            camera: prior.start,
            view: BallView::new(&prior.start, prior.outline.circle).ok()?,
            rotation: *rotation,
            information: SMatrix::zeros(),
            placement: 1.0,
            cost: f64::INFINITY,
            ln_spread: 0.0,
        })
    }

    /// Takes a step.
    fn go(&mut self, step: &SVector<f64, PARAMETERS>, prior: &PosePrior) -> Option<()> {
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

impl PoseRefiner {
    /// With dots that were measured.
    pub fn with_placement(mut self, placement: DrawnPlacement) -> Self {
        self.placement = placement;
        self
    }

    pub fn new(config: &EstimatorConfig, ball_radius_m: f64) -> Self {
        Self {
            placement: DrawnPlacement::Alike(config.placement_sigma_rad.powi(2)),
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
        prior: &PosePrior,
        rotation: &Rotation,
        frame: &mut FrameEstimate,
        matches: &mut Vec<Match>,
    ) -> Option<RefinedFrame> {
        matches.clear();
        matches.extend(named(frame));
        let mut readings = self.read(names, prior, rotation, frame, matches)?;
        let found = &readings.best.state;
        if self.rename(names, found, frame, matches) {
            readings = self.read(names, prior, &found.rotation, frame, matches)?;
        }
        let OutlineReading {
            state,
            prior: reading,
            ..
        } = &readings.best;
        frame.assignment.fill(None);
        for m in &*matches {
            frame.assignment[m.detection] = Some(m.name);
        }
        let [residual_rad, residual_px] = residuals(names, state, frame, matches);
        let covariance = readings.covariance()?;
        let joint = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let placed = position::of_pose(&state.view, &joint, self.ball_radius_m);
        let (position, of_rotation) = match placed {
            Some((position, of_rotation)) => (Some(position), of_rotation),
            None => {
                let of_turn = covariance.fixed_view::<3, 3>(0, 0).into_owned();
                (None, turned_covariance(&state.view.to_camera(), &of_turn))
            }
        };
        Some(RefinedFrame {
            view: state.view,
            rotation: state.rotation,
            covariance: of_rotation,
            position,
            distance: match prior.camera {
                CameraModel::Unknown(_) => Some(covariance[(6, 6)].max(0.0).sqrt()),
                CameraModel::Known(Camera::Perspective(_)) => None,
                CameraModel::Known(_) => Some(0.0),
            }
            .map(|sigma| CameraDistance {
                inverse_distance: state.view.horizon(),
                sigma,
            }),
            evidence: self.evidence(names, reading, state, frame, matches),
            residual_rad,
            residual_px,
        })
    }

    /// Minus two log-likelihoods of a frame's dots under the pose that fits them best, where a dot without a name is as likely as one
    /// that just takes its name up; a constant is left out.
    pub fn misfit(
        &self,
        names: &[Vec3],
        prior: &PosePrior,
        rotation: &Rotation,
        frame: &FrameEstimate,
    ) -> f64 {
        let mut matches: Vec<Match> = named(frame).collect();
        let fit = |rotation: &Rotation, matches: &[Match]| {
            let start = PoseState::new(prior, rotation)?;
            self.fit(names, prior, start, frame, matches)
        };
        let Some(mut state) = fit(rotation, &matches) else {
            return 0.0;
        };
        if self.rename(names, &state, frame, &mut matches)
            && let Some(again) = fit(&state.rotation, &matches)
        {
            state = again;
        }
        let unnamed = LOSS.cost(TAKEN_UP * TAKEN_UP);
        state.cost - unnamed * matches.len() as f64
    }

    /// What dots and outline say of a camera that is not known, about a solution.
    fn evidence(
        &self,
        names: &[Vec3],
        prior: &PosePrior,
        state: &PoseState,
        frame: &FrameEstimate,
        matches: &[Match],
    ) -> Option<ViewEvidence> {
        let CameraModel::Unknown(expected) = prior.camera else {
            return None;
        };
        let mut seen = prior.of_outline(&prior.outline.covariance.try_inverse()?, &state.view);
        self.add_dots(names, prior, state, frame, matches, &mut seen)?;
        ViewEvidence::new(&seen.information, &seen.gradient, expected, prior.axis)
    }

    /// From where an iteration stands to the minimum under a prior.
    fn fit(
        &self,
        names: &[Vec3],
        prior: &PosePrior,
        mut state: PoseState,
        frame: &FrameEstimate,
        matches: &[Match],
    ) -> Option<PoseState> {
        if matches.len() < MIN_MATCHES {
            return None;
        }
        let of_outline = prior.outline.covariance.try_inverse()?;
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
            state.ln_spread = spread.ln_determinants;
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
        prior: &PosePrior,
        state: &PoseState,
        frame: &FrameEstimate,
        matches: &[Match],
        equations: &mut PoseEquations,
    ) -> Option<PlacementSpread> {
        let mut spread = PlacementSpread::default();
        let off_axis = state.view.off_axis(DIFFERENCE);
        for m in matches {
            let dot = &frame.dots[m.detection];
            let name = usize::from(m.name);
            let expected = state.rotation * names[name];
            let hand = self.placement.covariance(name, &state.rotation, &expected);
            let hand = hand * state.placement;
            let DotMisfit {
                residual,
                inverse,
                hand,
            } = misfit(&state.view, &expected, dot.pixel, &dot.covariance, &hand)?;
            let mut by_parameters = by_parameters(&state.view, &off_axis, &expected)?;
            if matches!(prior.camera, CameraModel::Known(_)) {
                by_parameters.fixed_columns_mut::<3>(6).fill(0.0);
            }
            let distance = residual.dot(&(inverse * residual));
            let weight = LOSS.weight(distance);
            equations.add(&by_parameters, &residual, &(inverse * weight));
            equations.cost += LOSS.cost(distance);
            spread.ln_determinants -= inverse.determinant().ln();
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
        state: &PoseState,
        frame: &FrameEstimate,
        matches: &mut Vec<Match>,
    ) -> bool {
        let distance = |name: usize, detection: usize| -> f64 {
            let dot = &frame.dots[detection];
            let expected = state.rotation * names[name];
            let hand = self.placement.covariance(name, &state.rotation, &expected);
            let hand = hand * state.placement;
            match misfit(&state.view, &expected, dot.pixel, &dot.covariance, &hand) {
                Some(DotMisfit {
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

/// Root mean squares between where dots are seen and where the pose has them: angles, radians, and distances, pixels.
fn residuals(
    names: &[Vec3],
    state: &PoseState,
    frame: &FrameEstimate,
    matches: &[Match],
) -> [f64; 2] {
    let (mut angles, mut distances) = (0.0, 0.0);
    for m in matches {
        let expected = state.rotation * names[usize::from(m.name)];
        let pixel = frame.dots[m.detection].pixel;
        distances += offset(pixel, state.view.project(&expected)).norm_squared();
        if let Some(seen) = state.view.direction(pixel) {
            angles += angle_between(&seen, &expected).powi(2);
        }
    }
    [angles, distances].map(|sum: f64| (sum / matches.len() as f64).sqrt())
}

/// From `b` to `a`, pixels.
fn offset(a: Pixel, b: Pixel) -> Vector2<f64> {
    Vector2::new(a.u - b.u, a.v - b.v)
}
