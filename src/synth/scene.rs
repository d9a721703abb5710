//! A scene: the complete description of a frame, and how it is drawn at random.

use std::f64::consts::TAU;

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::background::Background;
use super::ball_image::{BallImage, ImageOf};
use super::color::luma;
use super::config::{SynthConfig, SynthKind};
use super::ground::Ground;
use super::light::Light;
use super::occlusion::Occluder;
use super::random::{Stream, Streams, between, log_between};
use super::sensor::{Encoding, Sensor};
use super::surface::Surface;
use super::view::View;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3, random_direction, random_rotation};
use crate::pattern::Pattern;
use crate::vision::optics::camera::{BallCircle, Camera, Intrinsics, Pixel};

/// Longest exposure that is drawn, s.
const MAX_EXPOSURE_S: f64 = 4e-3;
/// Exposure of a ball at rest, s.
const REST_EXPOSURE_S: f64 = 1e-3;
/// Standard deviation of a camera's principal point about the middle of its picture, of the longer side, along either
/// axis: that of cheap modules; calibrated ones are within 0.01.
const PRINCIPAL_SPREAD: f64 = 0.025;
/// Half the field of a wide lens without distortion, radians.
const MAX_FIELD_RAD: f64 = 0.6;
/// Minimum distance, in ball radii, at which the optical axis may leave the ball.
const NEAREST: f64 = 1.5;

/// A frame before it is taken. Directions are in the camera's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// What is shown.
    pub kind: SynthKind,
    /// Columns and rows of the image.
    pub size: [usize; 2],
    /// The ball and what is on it.
    pub surface: Surface,
    /// Where the ball is at mid-exposure, as [`View::new`] takes it: for parallel rays, or on the
    /// optical axis, its outline.
    pub circle: BallCircle,
    /// The camera.
    pub camera: Camera,
    /// Orientation at mid-exposure, pattern to camera frame.
    pub rotation: Rotation,
    /// Spin, camera frame, rad/s.
    pub spin: Vec3,
    /// Duration of the exposure, s.
    pub exposure_s: f64,
    /// Displacement of the ball's center during the exposure, pixels (u, v).
    pub shift_px: [f64; 2],
    /// Time between the exposures of two rows of a rolling shutter, the upper first, s; 0 of a global one. Rotation and circle are those
    /// of the row in which the ball's center is seen.
    pub row_s: f64,
    /// Velocity of the ball's center from row to row, pixels a second (u, v).
    pub velocity_px_s: [f64; 2],
    /// The light on the ball.
    pub light: Light,
    /// What is behind.
    pub background: Background,
    /// What is before it.
    pub occluder: Option<Occluder>,
    /// The camera's sensor.
    pub sensor: Sensor,
    /// Seed of the sensor's noise.
    pub noise_seed: u64,
    /// Whether the image is flipped left to right.
    pub mirrored: bool,
    /// Which image of which ball the scene's own is.
    pub image: ImageOf,
    /// Its time after that of the frame's first one, s.
    pub late_s: f64,
    /// Further images of balls in the frame, see [`several`](super::several).
    pub others: Vec<BallImage>,
}

impl Scene {
    /// A random frame of a ball with the given pattern. The generator gives one number, from which
    /// each part of the scene has a stream of its own: all but the dots is the same for every
    /// pattern.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the configuration is out of its domain.
    pub fn random<R: Rng + ?Sized>(
        pattern: &Pattern,
        config: &SynthConfig,
        rng: &mut R,
    ) -> Result<Self> {
        config.check()?;
        let streams = Streams::new(rng);
        let mut surface = Surface::random(pattern, config, streams);
        let place = &mut streams.of(Stream::Camera);
        let BallPlace { size, side, circle } = BallPlace::random(config, place);
        let camera = random_camera(&circle, config, size, place);
        let motion = &mut streams.of(Stream::Pose);
        let mut moved = Movement::random(config, side, motion);
        if config.kind == SynthKind::Wheel {
            // A wheel faces the camera and turns about its axle.
            let towards = View::new(&camera, circle)?.towards();
            moved.spin = towards * moved.spin.norm();
            for mark in &mut surface.marks {
                mark.move_to(moved.rotation.inverse() * towards);
            }
        }
        let light = Light::random(config, &mut streams.of(Stream::Light));
        let brightest = light.brightest() * luma(surface.ball);
        Ok(Self {
            kind: config.kind,
            size,
            surface,
            circle,
            camera,
            rotation: moved.rotation,
            spin: moved.spin,
            exposure_s: moved.exposure_s,
            shift_px: moved.shift_px,
            row_s: 0.0,
            velocity_px_s: [0.0; 2],
            light,
            background: random_background(brightest, size, circle, config, streams),
            occluder: random_occluder(config, streams),
            sensor: random_sensor(brightest, side, config, streams),
            noise_seed: streams.of(Stream::Noise).random(),
            mirrored: config.mirrored,
            image: ImageOf::default(),
            late_s: 0.0,
            others: Vec::new(),
        })
    }

    /// Puts a pinhole at the given distance, in ball radii, on the ray through the ball's center,
    /// which is its optical axis.
    #[must_use]
    pub fn with_camera_at(mut self, distance: f64) -> Self {
        self.camera = pinhole(&self.circle, distance, 0.0, 0.0);
        self
    }

    /// The rotation from the camera's frame to the view frame, see [`Rendering`](super::Rendering).
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the circle or the camera is not finite or not positive.
    pub fn to_view(&self) -> Result<Rotation> {
        Ok(View::new(&self.camera, self.circle)?.to_view())
    }

    /// Maximum of the surface's motion in the image during the exposure, pixels: the rotation and
    /// the displacement of the ball.
    pub fn blur_px(&self) -> f64 {
        let [u, v] = self.shift_px;
        self.spin.norm() * self.exposure_s * self.circle.radius + u.hypot(v)
    }
}

/// Where the ball lies in the image.
struct BallPlace {
    size: [usize; 2],
    /// Side of the crop, which the image need not be.
    side: f64,
    circle: BallCircle,
}

impl BallPlace {
    fn random<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Self {
        let fill = between(config.fill, rng);
        let side = match config.ball_px {
            Some(range) => (log_between(range, rng) / fill).round().max(16.0),
            None => log_between(config.size_px.map(|n| n as f64), rng).round(),
        };
        let radius = 0.5 * side * fill;
        let size = config.image_px.unwrap_or([side as usize; 2]);
        let mut axis = |n: usize| {
            let middle = 0.5 * (n as f64 - 1.0);
            let limit = 0.5 * side * config.off_center;
            // Mostly near the middle, as a ball detector would cut it.
            let near = (0.4 * limit * rng.sample::<f64, _>(StandardNormal)).clamp(-limit, limit);
            let free = (0.5 * n as f64 - radius).max(0.0);
            let anywhere = free * rng.random_range(-1.0..1.0);
            middle
                + if config.image_px.is_some() {
                    anywhere
                } else {
                    near
                }
        };
        let mut center = Pixel {
            u: axis(size[0]),
            v: axis(size[1]),
        };
        let is_cut = rng.random_bool(config.cut_share);
        let beyond = 2.0 * radius * config.max_cut * rng.random::<f64>();
        let side_cut = rng.random_range(0..4);
        if is_cut {
            match side_cut {
                0 => center.u = radius - beyond,
                1 => center.u = size[0] as f64 - radius + beyond,
                2 => center.v = radius - beyond,
                _ => center.v = size[1] as f64 - radius + beyond,
            }
        }
        Self {
            size,
            side,
            circle: BallCircle::new(center, radius),
        }
    }
}

fn random_camera<R: Rng + ?Sized>(
    circle: &BallCircle,
    config: &SynthConfig,
    size: [usize; 2],
    rng: &mut R,
) -> Camera {
    let is_parallel = rng.random_bool(config.parallel_share);
    let distance = log_between(config.camera_distance_radii, rng);
    if is_parallel {
        Camera::Orthographic
    } else if config.image_px.is_some() {
        let [width, height] = size.map(|n| n as f64);
        let mut near_middle = |n: f64| {
            let off = PRINCIPAL_SPREAD * width.max(height) * rng.sample::<f64, _>(StandardNormal);
            0.5 * (n - 1.0) + off
        };
        let (u, v) = (near_middle(width), near_middle(height));
        pinhole_through(circle, distance, Pixel { u, v })
    } else {
        // A crop may be cut anywhere.
        let off_axis = config.max_off_axis_rad * rng.random::<f64>();
        let azimuth = rng.random_range(0.0..TAU);
        pinhole(circle, distance, off_axis, azimuth)
    }
}

/// A pinhole at the given distance with this principal point; farther away where a lens would have to see more than
/// [`MAX_FIELD_RAD`] to either side.
fn pinhole_through(circle: &BallCircle, distance: f64, principal: Pixel) -> Camera {
    let (u, v) = (circle.center.u - principal.u, circle.center.v - principal.v);
    // Of the angle off the axis the sine is off tan(half angle) / radius.
    let off = u.hypot(v) / circle.radius;
    let half_angle = (1.0 / distance.max(NEAREST)).asin();
    let widest = (MAX_FIELD_RAD.sin() / off).atan();
    let half_angle = half_angle.min(widest);
    let off_axis = (off * half_angle.tan()).asin();
    pinhole(circle, 1.0 / half_angle.sin(), off_axis, v.atan2(u))
}

/// A pinhole at the given distance whose optical axis leaves the ball's center under the angle
/// `off_axis`; `azimuth` leads, in the image, from the principal point to the ball.
pub(super) fn pinhole(circle: &BallCircle, distance: f64, off_axis: f64, azimuth: f64) -> Camera {
    let half_angle = (1.0 / distance.max(NEAREST)).asin();
    // The outline must not reach the plane of the camera.
    let off_axis = off_axis.min(0.9 * (std::f64::consts::FRAC_PI_2 - half_angle));
    let focal = circle.radius * off_axis.cos() / half_angle.tan();
    let off = focal * off_axis.tan();
    let (s, c) = azimuth.sin_cos();
    Camera::Perspective(Intrinsics::pinhole(
        focal,
        focal,
        circle.center.u - off * c,
        circle.center.v - off * s,
    ))
}

/// How the ball lies and moves while it is exposed.
struct Movement {
    rotation: Rotation,
    spin: Vec3,
    exposure_s: f64,
    shift_px: [f64; 2],
}

impl Movement {
    fn random<R: Rng + ?Sized>(config: &SynthConfig, side: f64, rng: &mut R) -> Self {
        let rotation = random_rotation(rng);
        let (spin, exposure_s) = random_motion(config, rng);
        let max = config.max_shift_px * side / 60.0;
        let (s, c) = rng.random_range(0.0..TAU).sin_cos();
        let displacement = max * rng.random::<f64>().powi(2);
        Self {
            rotation,
            spin,
            exposure_s,
            shift_px: [displacement * c, displacement * s],
        }
    }
}

fn random_background(
    brightest: f32,
    size: [usize; 2],
    circle: BallCircle,
    config: &SynthConfig,
    streams: Streams,
) -> Background {
    let reach = 0.5 * size[0].max(size[1]) as f64 / circle.radius;
    let behind = &mut streams.of(Stream::Background);
    let mut background = Background::random(brightest, reach as f32, config, behind);
    let ground = &mut streams.of(Stream::Ground);
    if ground.random_bool(config.ground_share) {
        background.ground = Some(Ground::random(brightest, config, ground));
    }
    background.origin = circle.center;
    background.radius_px = circle.radius;
    background
}

/// Cords, or what else hides a part of the ball.
fn random_occluder(config: &SynthConfig, streams: Streams) -> Option<Occluder> {
    let occlusion = &mut streams.of(Stream::Occlusion);
    let is_hidden = occlusion.random_bool(config.occlusion_share);
    let cords = &mut streams.of(Stream::Cords);
    if cords.random_bool(config.cords_share) {
        Some(Occluder::cords(cords))
    } else {
        is_hidden.then(|| Occluder::random(config, occlusion))
    }
}

fn random_sensor(brightest: f32, side: f64, config: &SynthConfig, streams: Streams) -> Sensor {
    let noise = &mut streams.of(Stream::Sensor);
    let mut sensor = Sensor::random(brightest, side / 60.0, config, noise);
    if config.infrared {
        (sensor.has_color, sensor.has_mosaic) = (false, false);
        (sensor.color_noise, sensor.encoding) = (0.0, Encoding::Linear);
    }
    sensor
}

/// Spin and exposure such that the arc stays within its bound, short arcs as often as long ones.
fn random_motion<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> (Vec3, f64) {
    let speed = TAU * between(config.rps, rng);
    let arc = config.max_arc_rad * rng.random::<f64>().powi(2);
    let exposure_s = if speed > 0.0 {
        (arc / speed).min(MAX_EXPOSURE_S)
    } else {
        REST_EXPOSURE_S
    };
    (random_direction(rng) * speed, exposure_s)
}
