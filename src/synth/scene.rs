//! Everything about a frame, and how it is drawn at random.

use std::f64::consts::TAU;

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::sensor::Sensor;
use super::surface::Surface;
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3, random_direction, random_direction_above, random_rotation};
use crate::pattern::Pattern;
use crate::vision::camera::{BallCircle, Camera, Intrinsics, Pixel};

/// How far random frames reach. Pairs are `[least, most]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SynthConfig {
    /// Side of the square crop, pixels.
    pub size_px: [usize; 2],
    /// The ball's radius over half the crop's side.
    pub fill: [f64; 2],
    /// Most that the ball's center is off the crop's, along either axis, over half the side.
    pub off_center: f64,
    /// Angular radius of the dots, radians; one for a ball.
    pub dot_radius_rad: [f64; 2],
    /// Deviation of a hand-drawn dot per tangent axis, radians; one for a ball.
    pub misplacement_rad: [f64; 2],
    /// Probability that a dot was not drawn.
    pub left_out: f64,
    /// Probability of a logo.
    pub logo_probability: f64,
    /// Angular radius of the logo, radians.
    pub logo_radius_rad: [f64; 2],
    /// Whether the ball may be stained.
    pub stains: bool,
    /// Spin, revolutions per second.
    pub rps: [f64; 2],
    /// Most that the ball turns during the exposure, radians.
    pub max_arc_rad: f64,
    /// Most that the ball moves during the exposure, pixels.
    pub max_shift_px: f64,
    /// Distance of the camera in ball radii; half the frames are orthographic.
    pub distance: [f64; 2],
    /// Deviation of the lens' blur, pixels of a crop of 60.
    pub defocus_px: [f64; 2],
    /// Largest factor on the noise of a good camera.
    pub max_noise: f64,
    /// Share of frames far over- or under-exposed.
    pub bad_exposure: f64,
    /// Most brightness of the background against that of the ball's brightest part.
    pub max_background: f64,
}

impl Default for SynthConfig {
    fn default() -> Self {
        Self {
            size_px: [40, 200],
            fill: [0.72, 1.0],
            off_center: 0.12,
            dot_radius_rad: [0.040, 0.130],
            misplacement_rad: [0.008, 0.030],
            left_out: 0.01,
            logo_probability: 0.7,
            logo_radius_rad: [0.25, 0.75],
            stains: true,
            rps: [0.0, 150.0],
            max_arc_rad: 0.22,
            max_shift_px: 3.0,
            distance: [6.0, 60.0],
            defocus_px: [0.2, 1.3],
            max_noise: 4.0,
            bad_exposure: 0.12,
            max_background: 1.3,
        }
    }
}

impl SynthConfig {
    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        let [small, large] = self.size_px;
        if !(16..=4096).contains(&small) || !(small..=4096).contains(&large) {
            let problem = format!(
                "expected 16 to 4096 pixels, least first, found {:?}",
                self.size_px
            );
            return Err(Error::argument("size", problem));
        }
        let pairs = [
            ("fill", self.fill, 0.1, 1.5),
            ("dot radius", self.dot_radius_rad, 0.005, 0.5),
            ("misplacement", self.misplacement_rad, 0.0, 0.5),
            ("logo radius", self.logo_radius_rad, 0.01, 1.5),
            ("rps", self.rps, 0.0, 1e4),
            ("distance", self.distance, 1.5, 1e6),
            ("defocus", self.defocus_px, 0.0, 50.0),
        ];
        for (name, [low, high], least, most) in pairs {
            if !(low >= least && low <= high && high <= most) {
                let problem =
                    format!("expected {least} to {most}, least first, found {low} to {high}");
                return Err(Error::argument(name, problem));
            }
        }
        let single = [
            ("off-center", self.off_center, 1.0),
            ("left out", self.left_out, 1.0),
            ("logo probability", self.logo_probability, 1.0),
            ("arc", self.max_arc_rad, TAU),
            ("shift", self.max_shift_px, 1e3),
            ("noise", self.max_noise, 1e3),
            ("bad exposure", self.bad_exposure, 1.0),
            ("background", self.max_background, 100.0),
        ];
        for (name, value, most) in single {
            if !(0.0..=most).contains(&value) {
                let problem = format!("expected 0 to {most}, found {value}");
                return Err(Error::argument(name, problem));
            }
        }
        Ok(())
    }
}

/// Lamps and gloss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Light from everywhere.
    pub ambient: f32,
    /// Light from one direction.
    pub diffuse: f32,
    /// That direction, view frame.
    pub from: Vec3,
    /// Strength of the highlight.
    pub gloss: f32,
    /// Sharpness of the highlight (Blinn and Phong's exponent).
    pub sharpness: f32,
}

/// What is behind the ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    /// Color in the middle, linear light.
    pub color: [f32; 3],
    /// Change of brightness over the crop, along u and v.
    pub slope: [f32; 2],
    /// Soft discs: position (crop = 0 to 1), radius, color.
    pub discs: Vec<([f32; 2], f32, [f32; 3])>,
    /// Amplitude, direction and frequency of waves.
    pub waves: [f32; 3],
}

impl Background {
    /// One color (linear light) all over.
    pub fn plain(color: [f32; 3]) -> Self {
        Self {
            color,
            slope: [0.0; 2],
            discs: Vec::new(),
            waves: [0.0; 3],
        }
    }
}

/// A frame before it is taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Columns and rows of the image.
    pub size: [usize; 2],
    /// The ball and what is on it.
    pub surface: Surface,
    /// The ball's outline at mid-exposure.
    pub circle: BallCircle,
    /// Distance of the camera in ball radii, on the ray to the ball's center; `None` for parallel rays.
    pub distance: Option<f64>,
    /// Orientation at mid-exposure, pattern to view frame.
    pub rotation: Rotation,
    /// Spin, view frame, rad/s.
    pub spin: Vec3,
    /// Duration of the exposure, s.
    pub exposure_s: f64,
    /// Way of the ball's center during the exposure, pixels (u, v).
    pub shift_px: [f64; 2],
    /// Lamps.
    pub light: Light,
    /// What is behind.
    pub background: Background,
    /// The camera's sensor.
    pub sensor: Sensor,
    /// Seed of the sensor's noise.
    pub noise_seed: u64,
}

impl Scene {
    /// A random frame of a ball with the given pattern.
    ///
    /// # Errors
    /// [`Error::Argument`] where the configuration is out of its domain.
    pub fn random<R: Rng + ?Sized>(
        pattern: &Pattern,
        config: &SynthConfig,
        rng: &mut R,
    ) -> Result<Self> {
        config.check()?;
        let surface = Surface::random(pattern, config, rng);
        let [small, large] = config.size_px.map(|n| (n as f64).ln());
        let side = (small + (large - small) * rng.random::<f64>())
            .exp()
            .round();
        let circle = random_circle(side, config, rng);
        let light = random_light(rng);
        let (spin, exposure_s) = random_motion(config, rng);
        let most = config.max_shift_px * side / 60.0;
        let (s, c) = rng.random_range(0.0..TAU).sin_cos();
        let way = most * rng.random::<f64>().powi(2);
        let brightest = (light.ambient + light.diffuse) * luma(surface.ball);
        Ok(Self {
            size: [side as usize; 2],
            circle,
            distance: rng.random_bool(0.5).then(|| between(config.distance, rng)),
            rotation: random_rotation(rng),
            spin,
            exposure_s,
            shift_px: [way * c, way * s],
            background: random_background(brightest, config, rng),
            sensor: Sensor::random(brightest, side, config, rng),
            noise_seed: rng.random(),
            surface,
            light,
        })
    }

    /// The camera whose view the scene is: its optical axis goes through the ball's center.
    pub fn camera(&self) -> Camera {
        match self.distance {
            None => Camera::Orthographic,
            Some(distance) => {
                let half_angle = (1.0 / distance).asin();
                let focal = self.circle.radius / half_angle.tan();
                Camera::Perspective(Intrinsics {
                    fx: focal,
                    fy: focal,
                    cx: self.circle.center.u,
                    cy: self.circle.center.v,
                })
            }
        }
    }

    /// Most that the surface moves in the image during the exposure, pixels.
    pub fn blur_px(&self) -> f64 {
        let [u, v] = self.shift_px;
        (self.spin.norm() * self.exposure_s * self.circle.radius).max(u.hypot(v))
    }
}

/// Gray of a color in linear light.
pub(super) fn luma(c: [f32; 3]) -> f32 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

fn between<R: Rng + ?Sized>([low, high]: [f64; 2], rng: &mut R) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

fn random_circle<R: Rng + ?Sized>(side: f64, config: &SynthConfig, rng: &mut R) -> BallCircle {
    let radius = 0.5 * side * between(config.fill, rng);
    let off = |rng: &mut R| {
        // Mostly near the middle, as a ball detector would cut it.
        let reach = 0.5 * side * config.off_center;
        (0.4 * reach * rng.sample::<f64, _>(StandardNormal)).clamp(-reach, reach)
    };
    BallCircle {
        center: Pixel {
            u: 0.5 * (side - 1.0) + off(rng),
            v: 0.5 * (side - 1.0) + off(rng),
        },
        radius,
    }
}

fn random_light<R: Rng + ?Sized>(rng: &mut R) -> Light {
    let diffuse = rng.random_range(0.2..1.0f32);
    let glossy = rng.random_bool(0.6);
    Light {
        ambient: rng.random_range(0.1..0.9),
        diffuse,
        from: random_direction_above(rng, 0.1),
        gloss: if glossy {
            rng.random_range(0.0..0.5)
        } else {
            0.0
        },
        sharpness: rng.random_range(8.0..80.0),
    }
}

/// Spin and exposure such that the arc stays within its bound, short arcs as often as long ones.
fn random_motion<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> (Vec3, f64) {
    let speed = TAU * between(config.rps, rng);
    let arc = config.max_arc_rad * rng.random::<f64>().powi(2);
    let exposure_s = if speed > 0.0 {
        (arc / speed).min(4e-3)
    } else {
        1e-3
    };
    (random_direction(rng) * speed, exposure_s)
}

#[expect(
    clippy::approx_constant,
    reason = "nearly a turn: the shipped weights saw frames drawn so"
)]
fn random_background<R: Rng + ?Sized>(
    brightest: f32,
    config: &SynthConfig,
    rng: &mut R,
) -> Background {
    let level = match rng.random_range(0..10) {
        0..5 => rng.random_range(0.0..0.06),
        5..8 => rng.random_range(0.05..0.4),
        _ => rng.random_range(0.3..1.3f32),
    }
    .min(config.max_background as f32)
        * brightest;
    let tint = |rng: &mut R| {
        let base: [f32; 3] = match rng.random_range(0..4) {
            0 => [0.4, 1.0, 0.6],
            1 => [0.5, 0.7, 1.0],
            _ => [1.0; 3],
        };
        base.map(|c| level * c * rng.random_range(0.7..1.3f32))
    };
    let color = tint(rng);
    let cluttered = rng.random_bool(0.4);
    let discs = (0..if cluttered {
        rng.random_range(1..=5)
    } else {
        0
    })
        .map(|_| {
            let at = [rng.random_range(-0.2..1.2), rng.random_range(-0.2..1.2)];
            let color = tint(rng).map(|c| c * rng.random_range(0.2..2.5f32));
            (at, rng.random_range(0.05..0.5), color)
        })
        .collect();
    Background {
        color,
        slope: [rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5)],
        discs,
        waves: if cluttered {
            [
                rng.random_range(0.0..0.4),
                rng.random_range(0.0..6.28),
                rng.random_range(5.0..60.0),
            ]
        } else {
            [0.0; 3]
        },
    }
}
