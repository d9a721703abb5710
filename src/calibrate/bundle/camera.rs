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
//! The projection is that of a pinhole with these. Orientations are those in the view frame, whose z
//! points from the ball to the camera ([`BallView`]): the ball's place in the image is no part of them.

use nalgebra::{Matrix2x3, Vector2};

use crate::geometry::{Rotation, Vec3};
use crate::vision::frame::config::CameraModel;
use crate::vision::optics::camera::{BallCircle, BallView, Camera, Intrinsics, Pixel};

/// Expected tangent of the angle between the camera's axis and the ball, per axis: balls stand anywhere
/// in the inner half of a view of 50 degrees.
const AXIS_SIGMA: f64 = 0.1;
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
        axis: Vector2<f64>,
        expected: f64,
        sigma: f64,
        /// Where rays count as parallel: the bound of `inverse_focal`.
        parallel: f64,
    },
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
    /// What is known before the fit of a camera that sees balls of this mean radius (pixels), with
    /// outlines of these mean variances.
    pub fn new(model: &CameraModel, radius: f64, outline_variances: Vec3) -> Self {
        let optics = match *model {
            CameraModel::Known(camera) => Optics::Known(camera),
            CameraModel::Unknown(prior) => {
                let k = prior.inverse_distance;
                let expected = k / (radius * (1.0 - k * k).sqrt());
                Optics::Unknown {
                    inverse_focal: expected,
                    axis: Vector2::zeros(),
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
            outline_sigma: outline_variances.map(|v| v.max(0.0).sqrt()),
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
            Optics::Unknown {
                inverse_focal,
                axis,
                ..
            } => {
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

    /// Where the outline's center lies from where the ball's center is seen, pixels: the ellipse of an
    /// off-axis ball lies farther out by the share `tan^2` of the ball's half angle.
    pub fn ellipse_shift(&self, circle: &BallCircle) -> Vector2<f64> {
        match self.optics {
            Optics::Known(_) => Vector2::zeros(),
            Optics::Unknown {
                inverse_focal,
                axis,
                ..
            } => axis * (circle.radius * circle.radius * inverse_focal),
        }
    }

    /// Derivatives of [`ellipse_shift`](Self::ellipse_shift) by the shared optics and by the radius.
    pub fn ellipse_shift_derivatives(&self, circle: &BallCircle) -> (Matrix2x3<f64>, Vector2<f64>) {
        let Optics::Unknown {
            inverse_focal,
            axis,
            ..
        } = self.optics
        else {
            return (Matrix2x3::zeros(), Vector2::zeros());
        };
        let square = circle.radius * circle.radius;
        let by_axis = square * inverse_focal;
        let by_optics =
            Matrix2x3::new(axis.x * square, by_axis, 0.0, axis.y * square, 0.0, by_axis);
        (by_optics, axis * (2.0 * circle.radius * inverse_focal))
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

    /// Information of each shared unknown before the fit, and how far it lies off what is expected. A
    /// known camera's optics are held.
    pub fn prior(&self) -> [(f64, f64); SHARED] {
        let mut prior = [(1.0, 0.0); SHARED];
        if let Optics::Unknown {
            inverse_focal,
            axis,
            expected,
            sigma,
            ..
        } = self.optics
        {
            prior[0] = (sigma.powi(-2), inverse_focal - expected);

            prior[1] = (AXIS_SIGMA.powi(-2), axis.x);
            prior[2] = (AXIS_SIGMA.powi(-2), axis.y);
        }
        for i in 0..3 {
            let sigma = self.outline_sigma[i];
            prior[OPTICS + i] = (sigma.powi(-2), self.outline_bias[i]);
        }
        prior
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
