//! The camera of all frames, and what it and the outline finder do to every frame alike.
//!
//! Without intrinsics three things are unknown that all frames of a clip share:
//!
//! - one over the focal length in pixels, `1 / f`: the ball's distance follows from its radius;
//! - the tangents `(a_u, a_v)` of the angles between the camera's axis and the ball's center. An off-axis
//!   ball is seen as by a camera that points at it, turned by that angle: a point `x` (in radii from
//!   the center) moves by about `(r / f) (a . x) x`, up to 1 % of the radius at 5 degrees and 8 ball radii,
//!   which no turn of the ball and no other outline explains;
//! - the outlines' common error `(b_u, b_v, b_r)`: light from one side shifts every outline alike.
//!
//! Crops follow the ball: they see it by the same angle from the axis, of which ellipses say more than that balls are near it. In whole
//! pictures the axis stays and the ball moves: at `p` the angle's tangents are `a + (p - q) / f` with the balls' mean place `q`, and the
//! axis is near the picture's middle.
//!
//! The projection is that of a pinhole with these. Orientations are those in the view frame, whose z
//! points from the ball to the camera ([`BallView`]): the ball's place in the image is no part of them.

use nalgebra::{Matrix2, Matrix3, SVector, Vector2};

use super::BundleFrame;
use crate::geometry::{Rotation, Vec3};
use crate::vision::frame::config::CameraModel;
use crate::vision::optics::camera::{BallCircle, BallView, Camera, Intrinsics, Pixel};
use crate::vision::optics::oval::of_circle;

/// Expected tangent of the angle between the camera's axis and the ball, per axis, where only crops are seen: balls stand anywhere
/// in the inner half of a view of 50 degrees.
const AXIS_SIGMA: f64 = 0.1;
/// The same of what most of their outlines show that are ellipses.
const ELLIPSE_SIGMA: f64 = 0.05;
/// Smallest one over the focal length, in ball radii: parallel rays for every purpose.
const MIN_INVERSE_DISTANCE: f64 = 1e-4;
/// Steps of the differences by the radius (a share of it) and by the axis.
const DIFFERENCE: f64 = 1e-5;
/// Step of the difference by one over the focal length, ball radii. It does not shrink with it: for nearly
/// parallel rays a share of it would move no digit of the projection.
const FOCAL_DIFFERENCE: f64 = 1e-4;

/// Unknowns that all frames share besides the dots.
pub(super) const SHARED: usize = 6;
/// Those that move the projection: the focal length and the axis. The rest is the outlines' error.
pub(super) const OPTICS: usize = 3;

/// See the module's head.
#[derive(Debug, Clone, Copy)]
pub(super) struct SharedCamera {
    optics: Optics,
    /// The outlines' common error: u, v, radius, pixels.
    pub outline_bias: Vec3,
    /// Its standard deviations before the fit.
    outline_sigma: Vec3,
}

#[derive(Debug, Clone, Copy)]
enum Optics {
    Known(Camera),
    Unknown {
        inverse_focal: f64,
        /// At the balls' mean place.
        axis: Vector2<f64>,
        known_axis: AxisPrior,
        expected: f64,
        sigma: f64,
        /// Where rays count as parallel: the bound of `inverse_focal`.
        parallel: f64,
    },
}

/// What is known of the axis before the fit.
#[derive(Debug, Clone, Copy)]
enum AxisPrior {
    /// Crops follow the ball: the tangents, and their standard deviation.
    Crops { expected: Vector2<f64>, sigma: f64 },
    /// Whole pictures: the balls' mean place, pixels, from where the axis is expected to there, and the deviation of that at the focal
    /// length that was found last.
    Pictures {
        mean: Vector2<f64>,
        off: Vector2<f64>,
        sigma_px: f64,
        sigma: f64,
    },
}

impl AxisPrior {
    /// Of balls in these frames, at this mean place.
    fn new(mean: Vector2<f64>, frames: &[BundleFrame], inverse_focal: f64) -> Self {
        if let Some(axis) = frames.iter().find_map(|frame| frame.axis) {
            return Self::Pictures {
                mean,
                off: mean - Vector2::new(axis.middle.u, axis.middle.v),
                sigma_px: axis.sigma_px,
                sigma: axis.sigma_px * inverse_focal,
            };
        }
        match axis_of_ellipses(frames) {
            Some(expected) => Self::Crops {
                expected,
                sigma: ELLIPSE_SIGMA,
            },
            None => Self::Crops {
                expected: Vector2::zeros(),
                sigma: AXIS_SIGMA,
            },
        }
    }

    /// The tangents that are expected at a focal length, their rate by its inverse, and their deviation.
    fn expected(&self, inverse_focal: f64) -> (Vector2<f64>, Vector2<f64>, f64) {
        match *self {
            Self::Crops { expected, sigma } => (expected, Vector2::zeros(), sigma),
            Self::Pictures { off, sigma, .. } => (off * inverse_focal, off, sigma),
        }
    }
}

/// The tangents of the angles from the axis that the frames' ellipses show, where most outlines are ellipses and most of these lie to one side.
fn axis_of_ellipses(frames: &[BundleFrame]) -> Option<Vector2<f64>> {
    let ellipses = frames.iter().map(|f| f.outline.circle);
    let ellipses = ellipses.filter(BallCircle::is_ellipse).map(|ellipse| {
        let e = ellipse.eccentricity;
        e / (1.0 - e.norm_squared()).sqrt()
    });
    let ellipses: Vec<Vector2<f64>> = ellipses.collect();
    let all: Matrix2<f64> = ellipses.iter().map(|e| e * e.transpose()).sum();
    let along = all.symmetric_eigen();
    let along = along.eigenvectors.column(along.eigenvalues.imax());
    // To which side of the axis the ball is, the dots have decided.
    let side: f64 = ellipses.iter().map(|e| e.dot(&along).signum()).sum();
    let is_clear = 2 * ellipses.len() > frames.len() && side.abs() > 0.5 * ellipses.len() as f64;
    is_clear.then(|| {
        let aligned = ellipses.iter().map(|e| e * (e.dot(&along) * side).signum());
        aligned.sum::<Vector2<f64>>() / ellipses.len() as f64
    })
}

/// The mean of an ellipse's half axes over the shorter one, as [`of_circle`] has it, by the tangents of a ball's angle from the axis.
fn growth(tangents: &Vector2<f64>) -> f64 {
    (1.0 + tangents.norm_squared()).sqrt().sqrt()
}

/// What is known beforehand of the shared unknowns: by each of them, how far that is off, and its information.
pub(super) struct SharedPrior {
    pub by_shared: SVector<f64, SHARED>,
    pub off: f64,
    pub information: f64,
}

/// A frame as the camera sees it.
#[derive(Debug, Clone, Copy)]
pub(in crate::calibrate) struct FrameView {
    pub view: BallView,
    /// Frame of the orientations to view frame.
    pub to_view: Rotation,
}

impl FrameView {
    /// The view under a camera, in whose frame the orientations are.
    pub fn of(view: BallView) -> Self {
        Self {
            to_view: view.to_camera().inverse(),
            view,
        }
    }

    /// How far a direction of the orientations' frame faces the camera: its z in the view frame, taken from the horizon up
    /// so that 0 is the limb and 1 the middle.
    pub fn depth(&self, direction: &Vec3) -> f64 {
        let horizon = self.view.horizon();
        ((self.to_view * direction).z - horizon) / (1.0 - horizon)
    }

    /// The direction of a pixel, in the orientations' frame; `None` off the ball.
    pub fn direction(&self, pixel: Pixel) -> Option<Vec3> {
        Some(self.to_view.inverse() * self.view.direction(pixel)?)
    }
}

/// Views for the differences by what the camera shares: `(f^-1, a_u, a_v)` and the radius.
pub(super) struct Neighbors {
    views: [BallView; OPTICS + 1],
    steps: [f64; OPTICS + 1],
}

impl Neighbors {
    /// Derivatives of a direction's pixel by the shared optics, then by the radius.
    pub fn derivatives(&self, direction: &Vec3, at: Pixel) -> [Vector2<f64>; OPTICS + 1] {
        std::array::from_fn(|i| {
            let moved = self.views[i].project(direction);
            Vector2::new(moved.u - at.u, moved.v - at.v) / self.steps[i]
        })
    }
}

impl SharedCamera {
    /// What is known before the fit of a camera that sees balls in these frames.
    pub fn new(model: &CameraModel, frames: &[BundleFrame]) -> Self {
        let count = frames.len().max(1) as f64;
        let mean = |of: fn(&BundleFrame) -> Vec3| frames.iter().map(of).sum::<Vec3>() / count;
        let outline = mean(|f| Vec3::new(f.circle.center.u, f.circle.center.v, f.circle.radius));
        let variances = mean(|f| f.outline.covariance.diagonal());
        let radius = outline.z;
        let optics = match *model {
            CameraModel::Known(camera) => Optics::Known(camera),
            CameraModel::Unknown(prior) => {
                let k = prior.inverse_distance;
                let expected = k / (radius * (1.0 - k * k).sqrt());
                let known_axis = AxisPrior::new(outline.xy(), frames, expected);
                Optics::Unknown {
                    inverse_focal: expected,
                    axis: known_axis.expected(expected).0,
                    known_axis,
                    expected,
                    sigma: prior.sigma / radius,
                    // Above the bound for every frame, whose radii are not all the mean.
                    parallel: 2.0 * MIN_INVERSE_DISTANCE / radius,
                }
            }
        };
        Self {
            optics,
            outline_bias: Vec3::zeros(),
            outline_sigma: variances.map(|v| v.max(0.0).sqrt()),
        }
    }

    /// The view of a ball with this outline; `None` where the outline has left its domain.
    pub fn view(&self, circle: &BallCircle) -> Option<FrameView> {
        let view = BallView::new(&self.of(circle), *circle).ok()?;
        let to_view = match self.optics {
            Optics::Known(_) => view.to_camera().inverse(),
            Optics::Unknown { .. } => Rotation::identity(),
        };
        Some(FrameView { view, to_view })
    }

    /// The views that differ a little in what is unknown; `None` for a known camera.
    pub fn neighbors(&self, circle: &BallCircle) -> Option<Neighbors> {
        let Optics::Unknown { .. } = self.optics else {
            return None;
        };
        let steps = [
            FOCAL_DIFFERENCE / circle.radius,
            DIFFERENCE,
            DIFFERENCE,
            DIFFERENCE * circle.radius,
        ];
        let view = |i: usize| {
            let mut change = [0.0; OPTICS];
            let mut circle = *circle;
            match change.get_mut(i) {
                Some(change) => *change = steps[i],
                None => circle.radius += steps[i],
            }
            let moved = self.moved(&change, &Vec3::zeros());
            BallView::new(&moved.of(&circle), circle).ok()
        };
        Some(Neighbors {
            views: [view(0)?, view(1)?, view(2)?, view(3)?],
            steps,
        })
    }

    fn of(&self, circle: &BallCircle) -> Camera {
        match self.optics {
            Optics::Known(camera) => camera,
            Optics::Unknown { inverse_focal, .. } => {
                let axis = self.axis_at(circle);
                let [min, max] = [MIN_INVERSE_DISTANCE, CameraModel::MAX_INVERSE_DISTANCE];
                let focal = circle.radius / (inverse_focal * circle.radius).clamp(min, max);
                // The radius is that of the ray to the center, at its length: see BallView::new.
                Camera::Perspective(Intrinsics::pinhole(
                    focal,
                    focal,
                    circle.center.u - focal * axis.x,
                    circle.center.v - focal * axis.y,
                ))
            }
        }
    }

    /// Zero where the camera is known.
    fn inverse_focal(&self) -> f64 {
        match self.optics {
            Optics::Known(_) => 0.0,
            Optics::Unknown { inverse_focal, .. } => inverse_focal,
        }
    }

    /// The tangents of the angles between the axis and a ball, where they are not known.
    fn axis_at(&self, circle: &BallCircle) -> Vector2<f64> {
        let Optics::Unknown {
            inverse_focal,
            axis,
            known_axis,
            ..
        } = self.optics
        else {
            return Vector2::zeros();
        };
        match known_axis {
            AxisPrior::Crops { .. } => axis,
            AxisPrior::Pictures { mean, .. } => {
                let at = Vector2::new(circle.center.u, circle.center.v);
                axis + (at - mean) * inverse_focal
            }
        }
    }

    /// From a ball's circle to its outline: where its center lies from where the ball's center is seen, and by how much the mean of its half axes is
    /// more than the radius, pixels. The ellipse of an off-axis ball lies farther out by the share `tan^2` of the ball's half angle, and is drawn out.
    pub fn beyond_circle(&self, circle: &BallCircle) -> Vec3 {
        let axis = self.axis_at(circle);
        let shift = axis * (circle.radius * circle.radius * self.inverse_focal());
        Vec3::new(shift.x, shift.y, circle.radius * (growth(&axis) - 1.0))
    }

    /// What is compared with that: the mean of an outline's half axes, or the radius that a known camera has found.
    pub fn mean_radius(&self, found: &BallCircle) -> f64 {
        match self.optics {
            Optics::Known(_) => found.radius,
            Optics::Unknown { .. } => found.radius * of_circle(&found.eccentricity).0,
        }
    }

    /// Derivatives of [`beyond_circle`](Self::beyond_circle) by the shared optics and by the radius.
    pub fn beyond_circle_derivatives(&self, circle: &BallCircle) -> (Matrix3<f64>, Vec3) {
        let Optics::Unknown {
            inverse_focal,
            axis,
            ..
        } = self.optics
        else {
            return (Matrix3::zeros(), Vec3::zeros());
        };
        let square = circle.radius * circle.radius;
        let now = self.axis_at(circle);
        // By the focal length the axis moves where the ball is off its mean place.
        let axis_by_focal = (now - axis) / inverse_focal;
        let of_shift = square * inverse_focal;
        let shift_by_focal = now * square + axis_by_focal * of_shift;
        let grown = growth(&now);
        let by_axis = now * (0.5 * circle.radius / grown.powi(3));
        let growth_by_focal = by_axis.dot(&axis_by_focal);
        let by_optics = Matrix3::new(
            shift_by_focal.x,
            of_shift,
            0.0,
            shift_by_focal.y,
            0.0,
            of_shift,
            growth_by_focal,
            by_axis.x,
            by_axis.y,
        );
        let shift_by_radius = now * (2.0 * circle.radius * inverse_focal);
        let by_radius = Vec3::new(shift_by_radius.x, shift_by_radius.y, grown - 1.0);
        (by_optics, by_radius)
    }

    /// The camera after a change.
    pub fn moved(&self, optics: &[f64; OPTICS], outline: &Vec3) -> Self {
        let mut moved = *self;
        if let Optics::Unknown {
            inverse_focal,
            axis,
            parallel,
            ..
        } = &mut moved.optics
        {
            *inverse_focal = (*inverse_focal + optics[0]).max(*parallel);
            *axis += Vector2::new(optics[1], optics[2]);
        }
        moved.outline_bias += outline;
        moved
    }

    /// The change of the first of the shared unknowns to where rays are parallel; `None` for a known
    /// camera.
    pub fn change_to_parallel(&self) -> Option<f64> {
        match self.optics {
            Optics::Known(_) => None,
            Optics::Unknown {
                inverse_focal,
                parallel,
                ..
            } => Some(parallel - inverse_focal),
        }
    }

    /// What is known of the shared unknowns before the fit. A known camera's optics are held.
    pub fn prior(&self) -> [SharedPrior; SHARED] {
        let mut prior: [SharedPrior; SHARED] = std::array::from_fn(|i| SharedPrior {
            by_shared: SVector::ith(i, 1.0),
            off: 0.0,
            information: 1.0,
        });
        if let Optics::Unknown {
            inverse_focal,
            axis,
            known_axis,
            expected,
            sigma,
            ..
        } = self.optics
        {
            prior[0].information = sigma.powi(-2);
            prior[0].off = inverse_focal - expected;
            let (expected, rate, sigma) = known_axis.expected(inverse_focal);
            for k in 0..2 {
                let of_axis = &mut prior[1 + k];
                of_axis.by_shared[0] = -rate[k];
                of_axis.off = axis[k] - expected[k];
                of_axis.information = sigma.powi(-2);
            }
        }
        for i in 0..3 {
            prior[OPTICS + i].information = self.outline_sigma[i].powi(-2);
            prior[OPTICS + i].off = self.outline_bias[i];
        }
        prior
    }

    /// Sets how well the axis is known beforehand to what the picture says at the focal length that was found.
    pub fn settle(&mut self) {
        if let Optics::Unknown {
            inverse_focal,
            known_axis: AxisPrior::Pictures {
                sigma_px, sigma, ..
            },
            ..
        } = &mut self.optics
        {
            *sigma = *sigma_px * *inverse_focal;
        }
    }

    /// Ball radii over the camera's distance for a ball of this radius in pixels; `None` where the
    /// camera is known.
    pub fn inverse_distance(&self, radius: f64) -> Option<f64> {
        let Optics::Unknown { inverse_focal, .. } = self.optics else {
            return None;
        };
        let ratio = inverse_focal * radius;
        Some((ratio / ratio.hypot(1.0)).clamp(0.0, CameraModel::MAX_INVERSE_DISTANCE))
    }

    /// Angle between the camera's axis and the ball, radians; `None` where the camera is known.
    pub fn axis_rad(&self) -> Option<f64> {
        match self.optics {
            Optics::Known(_) => None,
            Optics::Unknown { axis, .. } => Some(axis.norm().atan()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::EstimatorConfig;
    use crate::vision::frame::estimate::PrincipalPointPrior;
    use crate::vision::frame::outline::Outline;

    const MEAN: BallCircle = BallCircle::new(
        Pixel {
            u: 1170.0,
            v: 890.0,
        },
        28.0,
    );

    /// A frame of that, whose outline is drawn out.
    fn frame(eccentricity: Vector2<f64>, axis: Option<PrincipalPointPrior>) -> BundleFrame {
        let outline = BallCircle {
            eccentricity,
            ..MEAN
        };
        BundleFrame {
            time_s: None,
            rotation: Rotation::identity(),
            circle: outline,
            outline: Outline::given(outline, Matrix3::from_diagonal_element(0.01)),
            axis,
            observations: Vec::new(),
        }
    }

    /// A camera that is not known, and stands somewhere.
    fn somewhere(axis: Option<PrincipalPointPrior>) -> SharedCamera {
        let model = EstimatorConfig::default().camera;
        let camera = SharedCamera::new(&model, &[frame(Vector2::zeros(), axis)]);
        camera.moved(&[-1e-3, 0.3, 0.2], &Vec3::new(0.1, 0.0, -0.1))
    }

    fn of_picture() -> PrincipalPointPrior {
        PrincipalPointPrior::of_picture(1280, 1024, &MEAN).expect("whole")
    }

    #[test]
    fn ellipses_say_where_the_axis_of_crops_is() {
        let e = Vector2::new(0.3, -0.1);
        let of = |signs: &[f64]| {
            let frames = signs.iter().map(|sign| frame(e * *sign, None));
            axis_of_ellipses(&frames.collect::<Vec<_>>())
        };
        let tangents = e / (1.0 - e.norm_squared()).sqrt();
        // One is a circle, one is taken to be on the other side.
        let found = of(&[1.0, 1.0, 0.0, 1.0, -1.0, 1.0, 1.0]).expect("clear");
        assert!((found - tangents).norm() < 1e-12, "{found}");
        let other = of(&[-1.0, -1.0, -1.0]).expect("clear");
        assert!((other + tangents).norm() < 1e-12, "{other}");
        assert_eq!(of(&[1.0, 0.0, 0.0]), None);
        assert_eq!(of(&[1.0, -1.0, 1.0]), None);
        assert_eq!(of(&[]), None);
    }

    #[test]
    fn the_derivatives_of_an_outline_are_those_of_differences() {
        let circle = BallCircle::new(
            Pixel {
                u: 1130.0,
                v: 930.0,
            },
            26.0,
        );
        for axis in [None, Some(of_picture())] {
            let camera = somewhere(axis);
            let (by_optics, by_radius) = camera.beyond_circle_derivatives(&circle);
            for (k, step) in [1e-8, 1e-5, 1e-5].into_iter().enumerate() {
                let by = |step: f64| {
                    let mut change = [0.0; OPTICS];
                    change[k] = step;
                    let moved = camera.moved(&change, &Vec3::zeros());
                    moved.beyond_circle(&circle)
                };
                let found = (by(step) - by(-step)) / (2.0 * step);
                let off = found - by_optics.column(k);
                assert!(off.norm() < 1e-5 * (1.0 + found.norm()), "{k}: {off}");
            }
            let by = |step: f64| {
                let radius = circle.radius + step;
                camera.beyond_circle(&BallCircle { radius, ..circle })
            };
            let found = (by(1e-4) - by(-1e-4)) / 2e-4;
            assert!((found - by_radius).norm() < 1e-6, "{found} {by_radius}");
        }
    }

    #[test]
    fn the_axis_of_a_picture_is_expected_near_its_middle() {
        let mut camera = somewhere(Some(of_picture()));
        camera.settle();
        // Where the principal point is the middle, the axis is as expected at any focal length.
        let off = Vector2::new(MEAN.center.u - 639.5, MEAN.center.v - 511.5);
        let inverse_focal = camera.inverse_focal();
        for (k, off) in [off.x, off.y].into_iter().enumerate() {
            let prior = &camera.prior()[1 + k];
            let axis = [0.3, 0.2][k] + off * (inverse_focal + 1e-3);
            let expected = axis - off * inverse_focal;
            assert!((prior.off - expected).abs() < 1e-12);
            assert!((prior.by_shared[0] + off).abs() < 1e-12);
            let sigma = 0.04 * 1280.0 * inverse_focal;
            assert!((prior.information * sigma * sigma - 1.0).abs() < 1e-9);
        }
    }
}
