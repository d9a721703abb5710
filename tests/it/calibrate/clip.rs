//! Clips as a perfect detector would see them: exact projections, Gaussian errors, misses, false dots.

use nalgebra::{Matrix2, Matrix3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use spindoe::Pattern;
use spindoe::ball::Ball;
use spindoe::calibrate::identify_frames;
use spindoe::geometry::{Rotation, Vec3, random_rotation, tangent_frame};
use spindoe::synth::view::View;
use spindoe::vision::frame::Outline;
use spindoe::vision::{
    BallCircle, Camera, DotDetection, EstimatorConfig, FrameEstimate, Intrinsics, Pixel,
};

/// What a clip shows.
#[derive(Debug, Clone)]
pub struct ClipConfig {
    pub frames: usize,
    /// Radius of the ball, pixels, and distance of the camera, ball radii.
    pub radius: f64,
    pub distance: f64,
    /// Standard deviation of a detection per axis, and of the outline, pixels.
    pub sigma_px: f64,
    pub outline_px: f64,
    /// Radius of the outlines over that of the ball's.
    pub outline_scale: f64,
    /// Probability that a dot is missed, and number of false dots a frame.
    pub missed: f64,
    pub false_dots: usize,
    /// Dots that the detector doubts.
    pub unlike: Vec<usize>,
    /// Turn from frame to frame, radians, and of the axis over the clip.
    pub step: f64,
    pub precession: f64,
    pub seed: u64,
}

impl Default for ClipConfig {
    fn default() -> Self {
        Self {
            frames: 120,
            radius: 30.0,
            distance: 12.0,
            sigma_px: 0.3,
            outline_px: 0.2,
            outline_scale: 1.0,
            missed: 0.08,
            false_dots: 0,
            unlike: Vec::new(),
            step: 0.16,
            precession: std::f64::consts::PI,
            seed: 1,
        }
    }
}

/// A clip with its truth.
pub struct Clip {
    pub frames: Vec<FrameEstimate>,
    pub rotations: Vec<Rotation>,
    pub times_s: Vec<f64>,
}

/// The dots of a pattern, each moved by a normal error per tangent axis.
pub fn drawn(pattern: &Pattern, sigma_rad: f64, seed: u64) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut moved = |dot: &Vec3| {
        let [e1, e2] = tangent_frame(dot);
        let [a, b]: [f64; 2] = [0, 1].map(|_| StandardNormal.sample(&mut rng));
        (dot + (e1 * a + e2 * b) * sigma_rad).normalize()
    };
    pattern.dots().iter().map(&mut moved).collect()
}

/// A ball with dots in these directions, turned before the camera; detections alone.
pub fn detections(dots: &[Vec3], config: &ClipConfig) -> Clip {
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    let mut rotation = random_rotation(&mut rng);
    let mut axis = spindoe::geometry::random_direction(&mut rng);
    let turn = tangent_frame(&axis)[0] * (config.precession / config.frames as f64);
    let precession = Rotation::from_scaled_axis(turn);
    let mut clip = Clip {
        frames: Vec::new(),
        rotations: Vec::new(),
        times_s: (0..config.frames).map(|k| k as f64 / 30.0).collect(),
    };
    for _ in 0..config.frames {
        clip.frames.push(frame(dots, &rotation, config, &mut rng));
        clip.rotations.push(rotation);
        rotation = Rotation::from_scaled_axis(axis * config.step) * rotation;
        axis = precession * axis;
    }
    clip
}

/// As [`detections`], identified with `pattern`.
pub fn identified(pattern: &Pattern, dots: &[Vec3], config: &ClipConfig) -> Clip {
    let mut clip = detections(dots, config);
    let estimator = EstimatorConfig::default();
    clip.frames = identify_frames(&Ball::new(pattern.clone()), &estimator, &clip.frames).unwrap();
    clip
}

fn frame<R: Rng>(
    dots: &[Vec3],
    rotation: &Rotation,
    config: &ClipConfig,
    rng: &mut R,
) -> FrameEstimate {
    let middle = Pixel { u: 39.5, v: 40.5 };
    // A pinhole that looks straight at the ball.
    let focal = config.radius / (1.0 / config.distance).asin().tan();
    let camera = Camera::Perspective(Intrinsics::pinhole(focal, focal, middle.u, middle.v));
    let circle = BallCircle::new(middle, config.radius);
    let view = View::new(&camera, circle).unwrap();
    let mut normal = |sigma: f64| -> f64 {
        let x: f64 = StandardNormal.sample(rng);
        x * sigma
    };
    let exact = view.outline().circle();
    let outline = BallCircle::new(
        Pixel {
            u: exact.center.u + normal(config.outline_px),
            v: exact.center.v + normal(config.outline_px),
        },
        exact.radius * config.outline_scale + normal(config.outline_px),
    );
    let mut seen: Vec<(Pixel, f64)> = Vec::new();
    for (j, dot) in dots.iter().enumerate() {
        let at = rotation * dot;
        if view.facing(&at) > 0.15 && rng.random::<f64>() >= config.missed {
            let probability = if config.unlike.contains(&j) {
                0.6
            } else {
                0.95
            };
            seen.push((view.project(&at), probability));
        }
    }
    for _ in 0..config.false_dots {
        let at = spindoe::geometry::random_direction_above(rng, 0.3);
        seen.push((view.project(&at), 0.95));
    }
    let mut normal = |sigma: f64| -> f64 {
        let x: f64 = StandardNormal.sample(rng);
        x * sigma
    };
    let detection = |(at, probability): (Pixel, f64)| DotDetection {
        pixel: Pixel {
            u: at.u + normal(config.sigma_px),
            v: at.v + normal(config.sigma_px),
        },
        covariance: Matrix2::identity() * config.sigma_px.powi(2),
        probability,
    };
    let dots: Vec<DotDetection> = seen.into_iter().map(detection).collect();
    let outline = Outline::given(outline, Matrix3::identity() * config.outline_px.powi(2));
    FrameEstimate::from_detections(outline, dots)
}
