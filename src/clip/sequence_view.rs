//! The view frames of a sequence, brought into one.
//!
//! Without intrinsics an orientation is in the *view frame* ([`BallView`](crate::vision::optics::camera::BallView)), whose z points from the ball to the camera.
//! It turns as the ball crosses the picture, and a spin from such orientations lacks that turn. All frames of a clip are of one camera: a
//! pinhole with square pixels, the focal length `f` and the principal point `c`. With the outline's radius `r` a ball whose center is seen at
//! `p` under the angle `theta` to the axis, `tan theta = |p - c| / f`, has the inverse distance `k` and the eccentricity `e`
//!
//! ```text
//! tan^2 a = b^2 cos^2 theta / (1 + b^2 sin^2 theta),   b = r / f,   k = sin a,   e = sin theta / cos a  along p - c
//! ```
//!
//! Each frame says something of these two ([`ViewEvidence`](crate::vision::frame::ViewEvidence)); `(ln f, c)` are where all together, the middle of a whole picture, and what
//! is expected of the distance have their maximum. An orientation then is what it is with the camera at that place, and is turned to the
//! view frame of a reference, the median of the centers, by `V(reference)^-1 V(p)` with `V(p)` the smallest rotation from z to
//! the ray.
//!
//! The error of `(ln f, c)` is the same for all frames, and does not average out. What one standard deviation of each of its three
//! independent parts does to each orientation, its own error and its turn's, goes with the orientation: [`ViewTurn::shared_rad`].
//!
//! Not corrected: the camera's own motion, lenses that distort, and crops that follow the ball.

use nalgebra::{Matrix3, Vector2};

use crate::fit::Student;
use crate::geometry::{Rotation, Vec3, turned_covariance};
use crate::spin::shared::ViewTurn;
use crate::stats::median;
use crate::vision::frame::estimate::{FrameEstimate, Pose, SeenFrom};
use crate::vision::optics::camera::{BallCircle, Pixel};

/// Frames that are as good as independent in what they say of the camera: dots drawn off their places, and a biased outline, mislead all
/// alike, so that all together are worth one. With less the regions of spins hold too much, with more the mean of their squared distances grows
/// (docs/measurements/detector.md, "One camera for all frames").
const INDEPENDENT: f64 = 1.0;
/// Standard deviation of the principal point about the ball, over the focal length, where pictures may be crops.
const OFF_AXIS: f64 = 0.08;
/// A distance that is given is taken for known to this, ball radii over the distance.
const MIN_SIGMA: f64 = 1e-4;
/// Least inverse distance that a focal length is begun with: that of a ball a thousand radii away.
const FARTHEST: f64 = 1e-3;
/// Steps of the fit, and the one, in standard deviations, that ends it.
const STEPS: usize = 12;
const CONVERGED: f64 = 1e-3;
/// No step is longer: in ln f, and in focal lengths.
const LONGEST: f64 = 0.5;
/// Steps of the derivatives by ln f and by the principal point over the focal length: of what is seen, and of orientations.
const DIFFERENCE: f64 = 1e-5;
const SMALL: f64 = 1e-3;
/// The loss of what frames say: a wrong pose says anything.
const LOSS: Student = Student::new(5, 3);
/// A frame whose own camera is farther from that of all, in squared standard deviations, keeps its own orientation.
const ASTRAY: f64 = 16.0;

/// A pinhole camera with square pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SquarePinhole {
    ln_focal: f64,
    /// Principal point, pixels.
    center: Vector2<f64>,
}

impl SquarePinhole {
    fn focal(&self) -> f64 {
        self.ln_focal.exp()
    }

    /// Another one: steps of ln f, and of the principal point in focal lengths.
    fn moved(&self, by: &Vec3) -> Self {
        Self {
            ln_focal: self.ln_focal + by.x,
            center: self.center + Vector2::new(by.y, by.z) * self.focal(),
        }
    }

    /// The tangent of the angle from the axis to a pixel, along u and v.
    fn off_axis(&self, at: Pixel) -> Vector2<f64> {
        (Vector2::new(at.u, at.v) - self.center) / self.focal()
    }

    /// The rotation from the view frame of a ball that is seen at a pixel to the camera's.
    fn to_camera(self, at: Pixel) -> Rotation {
        let off = self.off_axis(at);
        let towards = Vec3::new(-off.x, off.y, 1.0);
        Rotation::rotation_between(&Vec3::z(), &towards).unwrap_or_default()
    }

    /// Inverse distance and eccentricity of a ball's outline.
    fn sees(&self, circle: &BallCircle) -> Vec3 {
        let off = self.off_axis(circle.center);
        let square = off.norm_squared();
        let (sin2, cos2) = (square / (1.0 + square), 1.0 / (1.0 + square));
        // The outline is measured by the mean of its half axes, whatever its eccentricity.
        let round = |e2: f64| (1.0 - e2.min(0.9)).powf(0.25);
        let mean = circle.radius / round(circle.eccentricity.norm_squared());
        let mut tan2 = 0.0;
        for _ in 0..3 {
            let b = mean * round(sin2 * (1.0 + tan2)) / self.focal();
            tan2 = b * b * cos2 / (1.0 + b * b * sin2);
        }
        let inverse_distance = (tan2 / (1.0 + tan2)).sqrt();
        // sin theta along the direction: that of tan theta, times cos theta.
        let eccentricity = off * (cos2 * (1.0 + tan2)).sqrt();
        Vec3::new(inverse_distance, eccentricity.x, eccentricity.y)
    }

    /// Derivative of that by the steps of [`SquarePinhole::moved`].
    fn by_steps(&self, circle: &BallCircle) -> Matrix3<f64> {
        let rate = |k: usize| {
            let step = Vec3::ith(k, DIFFERENCE);
            (self.moved(&step).sees(circle) - self.moved(&-step).sees(circle)) / (2.0 * DIFFERENCE)
        };
        Matrix3::from_columns(&[rate(0), rate(1), rate(2)])
    }
}

/// How the view frame turns over a sequence without intrinsics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequenceView {
    /// The ball's center in the image, pixels, whose view frame the orientations are turned into.
    pub reference: Pixel,
    camera: SquarePinhole,
    /// A root of the covariance of the camera, in the steps of [`SquarePinhole::moved`].
    root: Matrix3<f64>,
}

/// An orientation in the view frame of a sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InSequence {
    /// Pattern to the sequence's view frame.
    pub rotation: Rotation,
    /// Its covariance, in that frame, rad^2, without what all of the sequence share.
    pub own: Matrix3<f64>,
    /// The turn that it contains, and what is uncertain in all alike.
    pub turn: ViewTurn,
}

impl InSequence {
    /// Its whole covariance, rad^2.
    pub fn covariance(&self) -> Matrix3<f64> {
        self.own + self.turn.shared_covariance()
    }
}

impl SequenceView {
    /// That of frames of one ball, about the median of their centers; `None` without any.
    fn of(seen: impl Iterator<Item = SeenFrom> + Clone) -> Option<Self> {
        let values = |f: fn(&BallCircle) -> f64| {
            let mut values: Vec<f64> = seen.clone().map(|one| f(&one.circle)).collect();
            median(&mut values)
        };
        let reference = Pixel {
            u: values(|c| c.center.u),
            v: values(|c| c.center.v),
        };
        Self::about(reference, seen)
    }

    /// That of estimated frames; `None` where the camera's intrinsics are known, or no frame has a pose.
    pub fn of_frames<'a>(frames: impl Iterator<Item = &'a FrameEstimate> + Clone) -> Option<Self> {
        Self::of(frames.filter_map(FrameEstimate::seen_from))
    }

    /// The same about another reference.
    pub(crate) fn about(
        reference: Pixel,
        seen: impl Iterator<Item = SeenFrom> + Clone,
    ) -> Option<Self> {
        let PathFit { camera, root } = fit(reference, seen)?;
        Some(Self {
            reference,
            camera,
            root,
        })
    }

    /// The rotation from the view frame of a ball at `center` to that of the reference.
    pub fn turn(&self, center: Pixel) -> Rotation {
        turn_by(&self.camera, center, self.reference)
    }

    /// The orientation of a frame in the view frame of the reference, with what all frames say of their camera.
    pub fn place(&self, circle: &BallCircle, pose: &Pose) -> InSequence {
        let alone = seen_alone(circle, pose.distance.map_or(0.0, |d| d.inverse_distance));
        let near = pose.view.filter(|view| {
            let off = self.camera.sees(circle) - alone;
            off.dot(&(view.information * off)) < ASTRAY
        });
        let seen = |camera: &SquarePinhole| {
            let own = near.map_or(Vec3::zeros(), |view| {
                view.gain * (camera.sees(circle) - alone)
            });
            turn_by(camera, circle.center, self.reference) * Rotation::from_scaled_axis(own)
        };
        let turn = seen(&self.camera);
        // To first order: far away the focal length may be anything, and the turns are small all the same.
        let shared_rad = [0, 1, 2].map(|k| {
            let whole = self.root.column(k).into_owned();
            let part = SMALL / whole.amax().max(SMALL);
            let step = whole * part;
            let [there, back] = [step, -step].map(|step| seen(&self.camera.moved(&step)));
            (there * back.inverse()).scaled_axis() / (2.0 * part)
        });
        let own = near.map_or(pose.covariance, |view| view.own);
        InSequence {
            rotation: turn * pose.rotation,
            own: turned_covariance(&turn, &own),
            turn: ViewTurn {
                turn_rad: self.turn(circle.center).scaled_axis(),
                shared_rad,
            },
        }
    }
}

/// The turn to the view frame of a reference.
fn turn_by(camera: &SquarePinhole, center: Pixel, reference: Pixel) -> Rotation {
    camera.to_camera(reference).inverse() * camera.to_camera(center)
}

/// Inverse distance and eccentricity as a frame has them alone.
fn seen_alone(circle: &BallCircle, inverse_distance: f64) -> Vec3 {
    Vec3::new(
        inverse_distance,
        circle.eccentricity.x,
        circle.eccentricity.y,
    )
}

/// A camera, and a root of its covariance.
struct PathFit {
    camera: SquarePinhole,
    root: Matrix3<f64>,
}

/// The camera of which all frames together say most.
fn fit(reference: Pixel, seen: impl Iterator<Item = SeenFrom> + Clone) -> Option<PathFit> {
    let (mut count, mut weights, mut steps) = (0.0, 0.0, 0.0);
    for SeenFrom {
        circle, distance, ..
    } in seen.clone()
    {
        let weight = (circle.radius / distance.sigma.max(MIN_SIGMA)).powi(2);
        count += 1.0;
        weights += weight;
        steps += weight * distance.inverse_distance.max(FARTHEST) / circle.radius;
    }
    if count == 0.0 {
        return None;
    }
    let middle = seen.clone().find_map(|one| one.evidence?.axis);
    let about = middle.map_or(reference, |axis| axis.middle);
    let about = Vector2::new(about.u, about.v);
    let mut camera = SquarePinhole {
        ln_focal: -(steps / weights).ln(),
        center: about,
    };
    let worth = (INDEPENDENT / count).min(1.0);
    let mut information = Matrix3::identity();
    for _ in 0..STEPS {
        let sigma = middle.map_or(OFF_AXIS, |axis| axis.sigma_px / camera.focal());
        let away = (about - camera.center) / camera.focal();
        information = Matrix3::from_diagonal(&Vec3::new(0.0, sigma.powi(-2), sigma.powi(-2)));
        let mut gradient = Vec3::new(0.0, away.x, away.y) / (sigma * sigma);
        for one in seen.clone() {
            let part = FrameInformation::of(&camera, &one);
            // What is expected of the distance counts once.
            information += part.seen * worth + part.expected / count;
            gradient += part.pull * worth + part.expected_pull / count;
        }
        let step = information.cholesky()?.solve(&gradient);
        camera = camera.moved(&(step * (LONGEST / step.amax()).min(1.0)));
        if step.dot(&(information * step)) < CONVERGED * CONVERGED {
            break;
        }
    }
    let covariance = information.cholesky()?.inverse();
    let root = covariance.cholesky()?.l();
    Some(PathFit { camera, root })
}

/// What a frame says of a camera: information and gradient in the steps of [`SquarePinhole::moved`].
#[derive(Default)]
struct FrameInformation {
    seen: Matrix3<f64>,
    pull: Vec3,
    expected: Matrix3<f64>,
    expected_pull: Vec3,
}

impl FrameInformation {
    fn of(camera: &SquarePinhole, one: &SeenFrom) -> Self {
        let SeenFrom {
            circle,
            distance,
            evidence,
        } = one;
        let by = camera.by_steps(circle);
        let now = camera.sees(circle);
        let alone = seen_alone(circle, distance.inverse_distance);
        let of_distance = by.row(0).transpose();
        let Some(view) = evidence else {
            // A distance that is given.
            let sigma = distance.sigma.max(MIN_SIGMA);
            return Self {
                expected: of_distance * of_distance.transpose() / (sigma * sigma),
                expected_pull: of_distance * (alone.x - now.x) / (sigma * sigma),
                ..Self::default()
            };
        };
        let off = now - alone;
        let squared = off.dot(&(view.information * off)).max(0.0);
        let weight = LOSS.weight(squared);
        let sigma = view.expected.sigma.max(MIN_SIGMA);
        let towards = view.expected.inverse_distance - now.x;
        Self {
            seen: by.transpose() * view.information * by * weight,
            pull: by.transpose() * (view.slope - view.information * off) * weight,
            expected: of_distance * of_distance.transpose() / (sigma * sigma),
            expected_pull: of_distance * towards / (sigma * sigma),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::ViewEvidence;
    use crate::vision::optics::camera::Intrinsics;

    /// A camera's ellipses, and back.
    #[test]
    fn outlines_have_the_distance_and_eccentricity_of_a_pinhole() {
        for (at, tan_half) in [
            ((500.0, 100.0), 0.1f64),
            ((319.0, 238.0), 0.02),
            ((60.0, 400.0), 0.15),
        ] {
            let k = Intrinsics::pinhole(600.0, 600.0, 321.0, 243.0);
            let center = Pixel { u: at.0, v: at.1 };
            let ray = k.ray(center).expect("a ray").normalize();
            let cos = -ray.z;
            let (half, theta) = (tan_half.atan(), cos.acos());
            // Half axes of the cone's section, Apollonius.
            let across = 600.0 * half.sin() / (theta.cos().powi(2) - half.sin().powi(2)).sqrt();
            let e = theta.sin() / half.cos();
            let along = (Vector2::new(at.0 - 321.0, at.1 - 243.0)).normalize();
            let circle = BallCircle {
                center,
                radius: across,
                eccentricity: along * e,
            };
            let camera = SquarePinhole {
                ln_focal: 600f64.ln(),
                center: Vector2::new(321.0, 243.0),
            };
            let seen = camera.sees(&circle);
            assert!((seen.x - half.sin()).abs() < 1e-4, "{seen} {}", half.sin());
            assert!((Vector2::new(seen.y, seen.z) - circle.eccentricity).norm() < 1e-4);
            let view = crate::vision::optics::camera::BallView::new(
                &crate::vision::optics::camera::Camera::Perspective(k),
                BallCircle::new(center, 30.0),
            );
            let to_camera = view.expect("a view").to_camera();
            assert!(to_camera.angle_to(&camera.to_camera(center)) < 1e-9);
        }
    }

    #[test]
    fn frames_of_one_camera_find_it() {
        let truth = SquarePinhole {
            ln_focal: 900f64.ln(),
            center: Vector2::new(330.0, 250.0),
        };
        let seen = (0..8).map(|i| {
            let center = Pixel {
                u: 80.0 + 60.0 * f64::from(i),
                v: 120.0 + 25.0 * f64::from(i),
            };
            let circle = BallCircle::new(center, 40.0);
            let x = truth.sees(&circle);
            let circle = BallCircle {
                eccentricity: Vector2::new(x.y, x.z),
                radius: 40.0 * (1.0 - x.y * x.y - x.z * x.z).powf(0.25),
                ..circle
            };
            let evidence = ViewEvidence {
                information: Matrix3::from_diagonal_element(1e10),
                slope: Vec3::zeros(),
                gain: Matrix3::zeros(),
                own: Matrix3::identity(),
                expected: Default::default(),
                axis: None,
            };
            SeenFrom {
                circle,
                distance: crate::vision::frame::CameraDistance {
                    inverse_distance: x.x,
                    sigma: 0.01,
                },
                evidence: Some(evidence),
            }
        });
        let reference = Pixel { u: 300.0, v: 200.0 };
        let view = SequenceView::about(reference, seen).expect("a camera");
        assert!((view.camera.focal() / 900.0 - 1.0).abs() < 1e-3, "{view:?}");
        assert!((view.camera.center - truth.center).norm() < 1.0, "{view:?}");
    }

    /// A camera that is given as one of parallel rays: it may as well be ten thousand radii away.
    #[test]
    fn parallel_rays_do_not_turn() {
        let distance = crate::vision::frame::CameraDistance {
            inverse_distance: 0.0,
            sigma: 0.0,
        };
        let at = |i: i32| {
            let u = 100.0 + 50.0 * f64::from(i);
            BallCircle::new(Pixel { u, v: 120.0 }, 40.0)
        };
        let seen = (0..6).map(|i| SeenFrom {
            circle: at(i),
            distance,
            evidence: None,
        });
        let view = SequenceView::about(at(0).center, seen).expect("a camera");
        let pose = Pose {
            rotation: Rotation::identity(),
            covariance: Matrix3::from_diagonal_element(1e-4),
            dots_confidence: 1.0,
            confidence: 1.0,
            residual_rad: 0.0,
            residual_px: 0.0,
            distance: Some(distance),
            view: None,
            position: None,
            hinted: false,
        };
        let placed = view.place(&at(5), &pose);
        assert!(placed.turn.turn_rad.norm() < 1e-3, "{placed:?}");
        assert!(
            placed.turn.shared_rad.iter().all(|s| s.norm() < 2e-3),
            "{placed:?}"
        );
        assert!((placed.covariance() - pose.covariance).norm() < 1e-5);
    }
}
